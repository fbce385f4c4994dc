"""Scene to solution, with what the scene's uncertain numbers make of the charges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from skfem import MeshTri2

from pvdf_fem.derivatives.uncertainty import require_known, uncertainty, with_uncertain
from pvdf_fem.film.loads.posed import Pressure
from pvdf_fem.scene.given import SceneLike
from pvdf_fem.solution.first_sizes import ORDER
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve as solve_certain
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.status import NotConvergedError, Status


def solve(
    scene: SceneLike,
    *,
    mesh: MeshTri2 | str | Path | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
    pressure: Pressure | None = None,
    uncertain: Mapping[str, float | str] | None = None,
) -> Solution:
    """Charges and fields of a scene, and its charges at rest: where these need a solve, it is made
    within the same budget.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
    mesh : MeshTri2 or path, optional
        Solve on this mesh of `mesh_scene`, or in a file that `read_mesh` reads, of the whole film,
        whatever the error, instead of meshing for ``scene.numerics.tolerance``.
    order : int, optional
        Polynomial order of the displacement, 1, 2 or 3.
    budget : Budget, optional
        What the solve may cost, by default what the scene's numerics say.
    pressure : callable, optional
        ``p(x_mm, y_mm)`` for arrays (n,) in the probe's own axes, in place of ``load.profile``: one
        value for each point, or one for all. It is scaled to the scene's force. It is no part of
        the scene: `Solution.pressure` keeps it, and `gradients` of the solution are under it.
    uncertain : mapping, optional
        Standard deviations as for `uncertainty`, ``{"film.thickness_um": "5 %"}``, in place of the
        scene's `uncertain`. With them the solution has the standard deviations of its charges,
        `Solution.uncertainty`.

    Returns
    -------
    Solution
        Its `status` tells whether there is a result; printed, it tells how the solve went.

    Raises
    ------
    MeshFileError, FileError
        For a mesh of another scene; for a file that cannot be read. Both are ValueErrors.
    SceneError
        For a pressure that cannot be used or has no single dead load, and for an uncertain key that
        charges have no derivative by; it is a ValueError, too.
    """
    scene = with_uncertain(scene, uncertain)
    require_known(scene, pressure)
    solution = solve_certain(scene, mesh=mesh, order=order, budget=budget, pressure=pressure)
    if not scene.uncertain or solution.status is not Status.CONVERGED:
        return solution
    try:
        return replace(solution, uncertainty=uncertainty(solution))
    except NotConvergedError as error:  # of the untouched film
        return replace(solution, warnings=(*solution.warnings, f"uncertain: {error}"))
