"""The solution of the next order, and the contributions of elements to the errors of charges."""

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
    """The equations of a whole film, their solution, and the factorised tangent at the solution."""

    equilibrium: Equilibrium
    q: Array  #: Unknowns at the solution, shape (unknowns,).
    factors: SuperLU


def factorise_tangent(discrete: DiscreteSolution) -> FactorisedSolution:
    """Factorise the tangent at a solution, on the whole film even if a sector was solved.

    The factors of Newton's method are not used because they may belong to an earlier state.

    Raises
    ------
    NotConvergedError
        If the tangent is exactly singular, such as for a slack film without a load.
    """
    equilibrium = discrete.equilibrium
    q = equilibrium.restrict(discrete.displacement)
    try:
        factors = factorise(equilibrium.tangent(discrete.state))
    except RuntimeError:  # raised by SuperLU: "Factor is exactly singular"
        raise NotConvergedError(f"{Status.SINGULAR}: {Status.SINGULAR.advice}") from None
    return FactorisedSolution(equilibrium, q, factors)


def solve_next_order(solution: FactorisedSolution) -> Correction:
    """Correct a solution in elements of the next order on the same mesh.

    Raises
    ------
    NotConvergedError
        If the correction needs a solve of the next order's equations, and this solve fails.
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
    """Compute the absolute contribution of each element to the errors of charges.

    Returns
    -------
    ndarray, shape (elements, outputs)
        Contributions in C, for the elements of the whole film.

    Raises
    ------
    NotConvergedError
        If the tangent is singular, or if there is no solution of the next order.
    """
    solution = factorise_tangent(discrete)
    correction = solve_next_order(solution)
    _, by_element = compute_error_indicators(correction, solution.factors, outputs)
    return by_element
