"""The public entry point: charges and fields of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from skfem import MeshTri2

from pvdf_fem.film.loads.load_spec import Pressure
from pvdf_fem.mesh.mesh_file import resolve_mesh
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, coerce
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.first_sizes import ORDER
from pvdf_fem.solver.mesh_level import UNKNOWNS_PER_ELEMENT
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.sensitivity.uncertainty import (
    require_differentiable,
    uncertainty,
    with_uncertain_numbers,
)
from pvdf_fem.solver.solution import Solution


def solve(
    scene: SceneLike,
    *,
    mesh: MeshTri2 | str | Path | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
    pressure: Pressure | None = None,
    uncertain: Mapping[str, float | str] | None = None,
) -> Solution:
    """Compute the charges and fields of a scene, and the charges of its unloaded film.

    Parameters
    ----------
    scene : Scene, path, dict or result
        The scene, the path of its file, a dict of its tables, or a result that has a scene.
    mesh : MeshTri2 or path, optional
        Mesh of the whole film from `mesh_scene`, or a file for `read_mesh`. It is not refined, so
        that errors may exceed ``numerics.tolerance``. If it is changed, as by curving straight
        sides onto the rim, a warning says so. By default meshes are refined until the errors are
        within the tolerance.
    order : int, optional
        Polynomial order of the displacement: 1, 2 or 3.
    budget : Budget, optional
        Limits of unknowns and work, by default those of ``numerics``. If the unloaded film needs a
        solve, its work counts, too. The work is added to the budget.
    pressure : callable, optional
        Pressure ``p(x_mm, y_mm)`` that replaces ``load.profile``. It takes arrays of shape (n,) in
        the probe's own axes, and returns n values or a single one, which are scaled to the force of
        the scene. It is not stored in the scene but in `Solution.pressure`, and used by
        `gradients`.
    uncertain : mapping, optional
        Standard deviations by key, such as ``{"film.thickness_um": "5 %"}``, which replace
        `uncertain` of the scene; see `uncertainty`. If there are any, `Solution.uncertainty` has
        the standard deviations of the charges.

    Returns
    -------
    Solution
        Check its `status`: a solve that fails does not raise an exception.

    Raises
    ------
    MeshFileError, FileError
        If the mesh does not fit the scene, or if a file cannot be read. Both are ValueErrors.
    SceneError
        If the scene is not valid, if the pressure cannot be used or the scene has no single dead
        load for it, or if charges have no derivative with respect to an uncertain key. It is a
        ValueError.

    Examples
    --------
    >>> solution = solve(Scene.example("triangle"))
    >>> print(solution)
    >>> solution.charge_changes_pC["A"]
    """
    problem = Problem.from_scene(with_uncertain_numbers(scene, uncertain), pressure=pressure)
    problem.resolve()
    order = coerce("order", order, int, (1, max(UNKNOWNS_PER_ELEMENT)))
    if budget is not None:
        budget = coerce("budget", budget, Budget)
    given = None if mesh is None else resolve_mesh(mesh, problem.scene)
    require_differentiable(problem)
    solution = solve_problem(
        problem, mesh=None if given is None else given.mesh, order=order, budget=budget
    )
    if given is not None:
        solution = replace(solution, warnings=(*given.notes, *solution.warnings))
    if not problem.scene.uncertain or solution.status is not Status.CONVERGED:
        return solution
    try:
        return replace(solution, uncertainty=uncertainty(solution))
    except NotConvergedError as error:  # the unloaded film has no result
        warnings = (*solution.warnings, f"uncertain: {error}")
        return replace(solution, warnings=warnings)
