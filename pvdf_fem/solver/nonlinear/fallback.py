"""The fallback chain: solvers that are tried for an equilibrium, one after another.

Each solver of the chain says whether it applies. The first that converges ends the chain, and the
result keeps a record of those that failed before. A loaded film that does not wrinkle needs
`LineSearchNewton` only.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.film.models import ROUND_OFF
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.deferred_newton import (
    DeferredNewton,
    NewtonOptions,
    UndampedNewton,
)
from pvdf_fem.solver.nonlinear.factors import count_negative_pivots, factorise
from pvdf_fem.solver.nonlinear.initial_guess import compute_initial_guess
from pvdf_fem.solver.nonlinear.newton import (
    STEP_TOLERANCE,
    FailedAttempt,
    NewtonResult,
    run_newton,
)
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import PredictedStressNewton, continue_from_larger_loads

logger = logging.getLogger(__name__)

#: Size of the last Newton step for a wrinkling film, over the charges' tolerance. Where the film
#: begins to wrinkle, steps shrink only linearly, and in a stiff film rounding soon keeps them from
#: shrinking further.
WRINKLING_STEP_SHARE = 1e-2


@dataclass(frozen=True, eq=False)
class EquilibriumTask:
    """An equilibrium that is to be found."""

    equilibrium: Equilibrium
    budget: Budget
    #: Unknowns near the solution, (unknowns,), if there are any.
    initial_guess: Array | None = None
    #: Relative size of Newton's last step in the energy norm.
    tolerance: float = STEP_TOLERANCE

    @property
    def affordable_iterations(self) -> int:
        """Number of Newton iterations that the budget pays for."""
        return self.budget.count_affordable_iterations(self.equilibrium)

    @property
    def wrinkles(self) -> bool:
        """Whether the film is one that wrinkles, a tension field."""
        return self.equilibrium.model.wrinkles

    @property
    def wrinkling_tolerance(self) -> float:
        """Relative size of Newton's last step for a film that wrinkles."""
        charge_tolerance = self.equilibrium.scene.numerics.tolerance
        return max(self.tolerance, WRINKLING_STEP_SHARE * charge_tolerance)


class FallbackSolver(ABC):
    """A solver of the fallback chain."""

    name: str

    @abstractmethod
    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the solver can solve the task."""

    @abstractmethod
    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Look for the equilibrium."""


class TipStiffnessContinuation(FallbackSolver):
    """Undamped Newton from the equilibrium of softer tips, or from a near initial guess."""

    name = "continuation in the stiffness of tips"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether terms change abruptly, as where a tip begins to touch."""
        return task.equilibrium.is_abrupt

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Try the initial guess if there is one, then find the equilibrium of softer tips first."""
        equilibrium = task.equilibrium
        if task.initial_guess is not None:
            result = run_newton(UndampedNewton(equilibrium, task.tolerance), task.initial_guess)
            if result.converged:
                return result
        softer = equilibrium.map_terms(lambda term: term.relaxed())
        softer_task = EquilibriumTask(softer, task.budget, tolerance=task.tolerance)
        softer_result = run_fallback_chain(softer_task)
        if not softer_result.converged:
            return softer_result
        initial_guess = equilibrium.complete_initial_guess(softer.dofs(softer_result.q))
        return run_newton(UndampedNewton(equilibrium, task.tolerance), initial_guess)


class LineSearchNewton(FallbackSolver):
    """Newton's method with an exact line search."""

    name = "Newton"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the film carries compression, and no term changes abruptly."""
        return not task.wrinkles and not task.equilibrium.is_abrupt

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Start from the task's initial guess, otherwise from that of a linear membrane."""
        is_near = task.initial_guess is not None
        initial_guess = task.initial_guess
        if initial_guess is None:
            initial_guess = compute_initial_guess(task.equilibrium)
        options = NewtonOptions(tolerance=task.tolerance)
        return run_newton(DeferredNewton(task.equilibrium, options, near=is_near), initial_guess)


class WrinklingNewton(FallbackSolver):
    """Newton's method with predicted stress for a film that wrinkles, from a near initial guess."""

    name = "Newton with predicted stress"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the film wrinkles and there is an initial guess."""
        return task.wrinkles and task.initial_guess is not None

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Start from the initial guess."""
        assert task.initial_guess is not None
        variant = PredictedStressNewton(task.equilibrium, task.wrinkling_tolerance)
        return run_newton(variant, task.initial_guess)


class LoadContinuation(FallbackSolver):
    """Continuation from larger loads for a film that wrinkles; it needs no initial guess."""

    name = "continuation in the load"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the film wrinkles."""
        return task.wrinkles

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Solve under dead loads; a pressure that follows the film starts from that equilibrium."""
        tolerance = task.wrinkling_tolerance
        under_dead_loads = task.equilibrium.map_terms(lambda term: term.with_frozen_loads())
        result = continue_from_larger_loads(
            under_dead_loads, tolerance, affordable_iterations=task.affordable_iterations
        )
        if task.equilibrium.conservative or not result.converged:
            return result
        last = run_newton(PredictedStressNewton(task.equilibrium, tolerance), result.q)
        return replace(last, failed_attempts=result.as_failed_attempts("dead pressure"))


FALLBACK_CHAIN: tuple[FallbackSolver, ...] = (
    TipStiffnessContinuation(),
    LineSearchNewton(),
    WrinklingNewton(),
    LoadContinuation(),
)


def find_equilibrium(
    equilibrium: Equilibrium,
    initial_guess: Array | None = None,
    *,
    tolerance: float = STEP_TOLERANCE,
    budget: Budget | None = None,
) -> NewtonResult:
    """Find an equilibrium, whatever the film and the loads are.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations.
    initial_guess : ndarray, shape (unknowns,), optional
        Unknowns near the solution.
    tolerance : float, optional
        Relative size of Newton's last step in the energy norm.
    budget : Budget, optional
        What the solve may cost, by default what the scene's numerics allow.

    Returns
    -------
    NewtonResult
        Its status says whether an equilibrium was found.
    """
    if budget is None:
        budget = Budget.for_problem(equilibrium.problem)
    task = EquilibriumTask(equilibrium, budget, initial_guess=initial_guess, tolerance=tolerance)
    return run_fallback_chain(task)


def run_fallback_chain(task: EquilibriumTask) -> NewtonResult:
    """Try the solvers of the chain until one converges.

    Parameters
    ----------
    task : EquilibriumTask
        The equilibrium to be found.

    Returns
    -------
    NewtonResult
        The result of the solver that converged, or of the last one that applies. Of a flat film
        that is in balance it is the flat film.
    """
    if task.equilibrium.is_flat:
        return solve_flat_film(task.equilibrium)
    applicable = [solver for solver in FALLBACK_CHAIN if solver.applies(task)]
    failed: tuple[FailedAttempt, ...] = ()
    for solver in applicable:
        result = solver.solve(task)
        logger.debug("%s: %s", solver.name, result.status)
        if result.converged:
            break
        if solver is not applicable[-1]:
            failed += result.as_failed_attempts(solver.name)
    return replace(result, failed_attempts=failed + result.failed_attempts)


def solve_flat_film(equilibrium: Equilibrium) -> NewtonResult:
    """Return the flat film as the result, and whether it is stable.

    It is an equilibrium for every tension. It is unstable in compression, unless it wrinkles or
    its bending stiffness keeps it from buckling.
    """
    q = np.zeros(equilibrium.unknowns.count)
    state = equilibrium.state(q)
    smallest, largest = compute_principal_values(state.stress)
    has_compression = smallest.min() < -ROUND_OFF * np.abs(largest).max()
    is_stable = equilibrium.model.wrinkles or not has_compression  # a slack film is stable, too
    if not is_stable and equilibrium.model.bends:
        factors = factorise(equilibrium.tangent(state))
        is_stable = count_negative_pivots(factors) == 0
    status = Status.CONVERGED if is_stable else Status.UNSTABLE
    return NewtonResult(q, status, (), factors=None)
