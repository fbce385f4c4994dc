"""A solution in elements of the next order on the same mesh, and the elements' error shares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import Output
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.estimate.correction import Correction, correct_in_richer_space
from pvdf_fem.solver.mesh_level import compute_error_indicators
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.nonlinear.newton import NewtonResult
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status


class FactorisedSolution(NamedTuple):
    """The equations of a whole film with their solution and the factors of their tangent."""

    equilibrium: Equilibrium
    q: Array  #: (unknowns,)
    factors: SuperLU


def factorise_tangent(discrete: DiscreteSolution) -> FactorisedSolution:
    """Factorise the tangent of a solution on the whole film.

    Newton's last factors may be of an earlier state, so they are not used.

    Raises
    ------
    NotConvergedError
        If the tangent is exactly singular, as that of a slack film without a load.
    """
    equilibrium = discrete.equilibrium
    q = equilibrium.restrict(discrete.displacement)
    try:
        factors = factorise(equilibrium.tangent(discrete.state))
    except RuntimeError:  # SuperLU: exactly singular
        raise NotConvergedError(f"{Status.SINGULAR}: {Status.SINGULAR.advice}") from None
    return FactorisedSolution(equilibrium, q, factors)


def solve_next_order(solution: FactorisedSolution) -> Correction:
    """Solve in the order above on the same mesh.

    Raises
    ------
    NotConvergedError
        If the richer equations have no solution.
    """
    coarse = solution.equilibrium
    correction = correct_in_richer_space(
        coarse,
        solution.q,
        factors=solution.factors,
        rich=coarse.at_order(coarse.space.order + 1),
        budget=Budget.for_problem(coarse.problem),
    )
    if isinstance(correction, NewtonResult):
        raise NotConvergedError(f"{correction.status}: {correction.status.advice}")
    return correction


def compute_error_contributions(discrete: DiscreteSolution, outputs: Sequence[Output]) -> Array:
    """Compute the shares of the elements in the errors of charges, in C, (elements, outputs)."""
    solution = factorise_tangent(discrete)
    correction = solve_next_order(solution)
    _, shares = compute_error_indicators(correction, solution.factors, outputs)
    return shares
