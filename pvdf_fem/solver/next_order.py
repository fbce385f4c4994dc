"""A solution in elements of the next order on the same mesh, and every element's share in the
error."""

from __future__ import annotations

from collections.abc import Sequence

from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.outputs import Output
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.estimate import Correction, correct_in_richer_space
from pvdf_fem.solver.mesh_level import compute_error_indicators
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.newton import NewtonResult, factorise
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status


def factorise_tangent(fields: DiscreteSolution) -> tuple[Equilibrium, Array, SuperLU]:
    """The whole film's equations with their unknowns and the tangent's factors."""
    solved = fields.equilibrium
    q = solved.restrict(fields.displacement)
    try:  # anew, since Newton's last factors may be of an earlier state
        return solved, q, factorise(solved.tangent(fields.state))
    except RuntimeError:  # SuperLU: exactly singular, as for a slack film without a load
        raise NotConvergedError(f"{Status.SINGULAR}: {Status.SINGULAR.advice}") from None


def solve_next_order(solved: Equilibrium, q: Array, factors: SuperLU) -> Correction:
    """The solution in the order above on the same mesh; raises `NotConvergedError`."""
    rich = solved.with_(order=solved.space.order + 1)
    correction = correct_in_richer_space(solved, q, factors, rich, Budget.of(solved.scene))
    if isinstance(correction, NewtonResult):
        raise NotConvergedError(f"{correction.status}: {correction.status.advice}")
    return correction


def compute_error_shares(fields: DiscreteSolution, outputs: Sequence[Output]) -> Array:
    """Shares of the elements in the errors of charges by the mesh, in C, (elements, goals)."""
    solved, q, factors = factorise_tangent(fields)
    return compute_error_indicators(solve_next_order(solved, q, factors), factors, outputs)[1]
