"""The public entry point: charges and fields of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from skfem import MeshTri2

from pvdf_fem.film.loads.load_spec import Pressure
from pvdf_fem.mesh.mesh_file import as_mesh
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
    """Solve a scene for its charges, and for those of the unloaded film.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
        What is solved.
    mesh : MeshTri2 or path, optional
        Solve on this mesh of the whole film, whatever the error, instead of meshing for
        ``scene.numerics.tolerance``. It is made by `mesh_scene`, or in a file that `read_mesh`
        reads.
    order : int, optional
        Polynomial order of the displacement, 1, 2 or 3.
    budget : Budget, optional
        What the solve may cost, by default what the scene's numerics allow. Where the unloaded film
        needs a solve, it is made within the same budget.
    pressure : callable, optional
        ``p(x_mm, y_mm)`` for arrays (n,) in the probe's own axes, in place of ``load.profile``: one
        value for each point, or one for all. It is scaled to the scene's force. It is not part of
        the scene: `Solution.pressure` keeps it, and `gradients` of the solution are under it.
    uncertain : mapping, optional
        Standard deviations as for `uncertainty`, ``{"film.thickness_um": "5 %"}``, in place of the
        scene's `uncertain`. With them the solution has the standard deviations of its charges,
        `Solution.uncertainty`.

    Returns
    -------
    Solution
        Its `status` says whether there is a result; `print` shows how the solve went.

    Raises
    ------
    MeshFileError, FileError
        For a mesh of another scene; for a file that cannot be read. Both are ValueErrors.
    SceneError
        For a pressure that cannot be used or has no single dead load, and for an uncertain key that
        charges have no derivative by; it is a ValueError, too.

    Examples
    --------
    >>> solution = solve(Scene.example("triangle"))
    >>> print(solution)
    >>> solution.charge_changes_pC["A"]
    """
    problem = Problem.from_scene(with_uncertain_numbers(scene, uncertain), pressure=pressure)
    order = coerce("order", order, int, (1, max(UNKNOWNS_PER_ELEMENT)))
    if budget is not None:
        budget = coerce("budget", budget, Budget)
    if mesh is not None:
        mesh = as_mesh(mesh, problem.scene)
    require_differentiable(problem)
    solution = solve_problem(problem, mesh=mesh, order=order, budget=budget)
    if not problem.scene.uncertain or solution.status is not Status.CONVERGED:
        return solution
    try:
        return replace(solution, uncertainty=uncertainty(solution))
    except NotConvergedError as error:  # the unloaded film has no result
        warnings = (*solution.warnings, f"uncertain: {error}")
        return replace(solution, warnings=warnings)
