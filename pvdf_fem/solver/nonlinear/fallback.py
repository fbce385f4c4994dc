"""The fallback chain: solvers that are tried one after another until one finds an equilibrium.

Each solver says whether it applies to a task. The result of the first solver that converges is
returned, with a record of the solvers that failed before. A film that does not wrinkle has a single
solver: `TipStiffnessContinuation` if a tip presses it, otherwise `LineSearchNewton`.
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

#: Relative size of the last Newton step for a wrinkling film, divided by the tolerance of the
#: charges. At the onset of wrinkles the steps shrink only linearly, and in a stiff film round-off
#: soon stops them from shrinking.
WRINKLING_STEP_FRACTION = 1e-2


@dataclass(frozen=True, eq=False)
class EquilibriumTask:
    """The equations, accuracy, initial guess and budget of a search for an equilibrium."""

    equilibrium: Equilibrium
    budget: Budget
    #: Unknowns near the solution, shape (unknowns,); None if no similar film was solved.
    initial_guess: Array | None = None
    #: Relative size of Newton's last step in the energy norm.
    tolerance: float = STEP_TOLERANCE

    @property
    def affordable_iterations(self) -> int:
        """Number of Newton iterations that the budget allows; only `LoadContinuation` uses it."""
        return self.budget.count_affordable_iterations(self.equilibrium)

    @property
    def wrinkles(self) -> bool:
        """Whether the film model is a tension field, which carries no compression."""
        return self.equilibrium.model.wrinkles

    @property
    def wrinkling_tolerance(self) -> float:
        """Relative size of Newton's last step for a film that wrinkles; at least `tolerance`."""
        charge_tolerance = self.equilibrium.scene.numerics.tolerance
        return max(self.tolerance, WRINKLING_STEP_FRACTION * charge_tolerance)


class FallbackSolver(ABC):
    """Base class of the solvers in the fallback chain."""

    name: str  #: Name in records of failed attempts.

    @abstractmethod
    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the solver should be tried for the task."""

    @abstractmethod
    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Search for the equilibrium; the status of the result says whether it was found."""


class TipStiffnessContinuation(FallbackSolver):
    """Undamped Newton from the task's initial guess or from the equilibrium of softer tips."""

    name = "continuation in the stiffness of tips"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether a term of the equations changes abruptly, such as the contact of a tip."""
        return task.equilibrium.is_abrupt

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Solve from the task's initial guess or, if this fails, from the solution of softer tips.

        Without an initial guess, softer tips are solved at once. Their equilibrium is found by the
        whole fallback chain, so that tips may be softened repeatedly. If it is not found, that
        failed result is returned.
        """
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
        """Return whether the film does not wrinkle and no term changes abruptly."""
        return not task.wrinkles and not task.equilibrium.is_abrupt

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Solve by Newton's method with line search.

        It starts from the task's initial guess or, without one, from the
        deflection of a linear membrane.
        """
        is_near = task.initial_guess is not None
        initial_guess = task.initial_guess
        if initial_guess is None:
            initial_guess = compute_initial_guess(task.equilibrium)
        options = NewtonOptions(tolerance=task.tolerance)
        return run_newton(DeferredNewton(task.equilibrium, options, near=is_near), initial_guess)


class WrinklingNewton(FallbackSolver):
    """Newton's method with predicted stress for a film that wrinkles, from an initial guess."""

    name = "Newton with predicted stress"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the film wrinkles and the task has an initial guess."""
        return task.wrinkles and task.initial_guess is not None

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Run `PredictedStressNewton` from the initial guess of the task."""
        assert task.initial_guess is not None
        variant = PredictedStressNewton(task.equilibrium, task.wrinkling_tolerance)
        return run_newton(variant, task.initial_guess)


class LoadContinuation(FallbackSolver):
    """Continuation from larger loads for a film that wrinkles; the initial guess is ignored."""

    name = "continuation in the load"

    def applies(self, task: EquilibriumTask) -> bool:
        """Return whether the film is a tension field."""
        return task.wrinkles

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Solve under dead loads, then under loads that follow the film if the task has these."""
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
    """Find an equilibrium by the fallback chain, for any film model and loads.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    initial_guess : ndarray, shape (unknowns,), optional
        Unknowns near the solution, such as those of a coarser mesh.
    tolerance : float, optional
        Relative size of Newton's last step in the energy norm.
    budget : Budget, optional
        Limits the iterations of `LoadContinuation`, for films that wrinkle; by default the budget
        of the scene's numerics. The work is not added to it.

    Returns
    -------
    NewtonResult
        The status says whether an equilibrium was found.
    """
    if budget is None:
        budget = Budget.for_problem(equilibrium.problem)
    task = EquilibriumTask(equilibrium, budget, initial_guess=initial_guess, tolerance=tolerance)
    return run_fallback_chain(task)


def run_fallback_chain(task: EquilibriumTask) -> NewtonResult:
    """Try the solvers that apply to a task until one converges.

    If no force deflects or stretches the film, the flat film is returned without any solver.

    Parameters
    ----------
    task : EquilibriumTask
        The equilibrium to find.

    Returns
    -------
    NewtonResult
        The result of the first solver that converged, or of the last one if all failed; its
        `failed_attempts` begin with the solvers before it.
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
    """Return the flat film as the result, with the status `Status.UNSTABLE` if it buckles.

    The caller ensures that the flat film is in equilibrium. In compression it is unstable, unless
    the film model is a tension field or the bending stiffness prevents buckling. The result has no
    factors and no iterations.
    """
    q = np.zeros(equilibrium.unknowns.count)
    state = equilibrium.state(q)
    smallest, largest = compute_principal_values(state.stress)
    has_compression = smallest.min() < -ROUND_OFF * np.abs(largest).max()
    is_stable = equilibrium.model.wrinkles or not has_compression  # zero stress counts as stable
    if not is_stable and equilibrium.model.bends:
        factors = factorise(equilibrium.tangent(state))
        is_stable = count_negative_pivots(factors) == 0
    status = Status.CONVERGED if is_stable else Status.UNSTABLE
    return NewtonResult(q, status, (), factors=None)
