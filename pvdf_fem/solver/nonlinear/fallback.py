"""The ladder: solvers to try for an equilibrium, in order.

A rung is a solver that says whether it applies; the first to converge wins, and the result keeps
earlier failures. A loaded film that does not wrinkle needs `LineSearchNewton` only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.film.models import ROUNDING
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.initial_guess import compute_initial_guess
from pvdf_fem.solver.nonlinear.newton import (
    STEP_TOLERANCE,
    DeferredNewton,
    NewtonOptions,
    NewtonResult,
    UndampedNewton,
    count_negative_pivots,
    factorise,
    run_newton,
)
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import PredictedStressNewton, continue_from_larger_loads

#: Last Newton step for a wrinkling film, over the charges' tolerance: where the film's
#: state changes from point to point steps shrink only linearly, and rounding in a stiff film ends
#: that early.
LAST_STEP = 1e-2


@dataclass
class EquilibriumTask:
    """An equilibrium to be found."""

    equilibrium: Equilibrium
    budget: Budget
    start: Array | None = None  #: Unknowns near the solution, if they are known.
    tolerance: float = STEP_TOLERANCE  #: Relative size of Newton's last step in the energy norm.
    failed_attempts: list[tuple[str, NewtonResult]] = field(default_factory=list)

    @property
    def iterations(self) -> int:
        """Newton iterations that the budget pays for."""
        return self.budget.iterations(self.equilibrium)

    @property
    def wrinkles(self) -> bool:
        """Whether the film wrinkles."""
        return self.equilibrium.model.wrinkles

    @property
    def last_step(self) -> float:
        """`tolerance` of a film that wrinkles."""
        return max(self.tolerance, LAST_STEP * self.equilibrium.scene.numerics.tolerance)


class FallbackSolver(ABC):
    """A solver of the ladder."""

    name: str

    @abstractmethod
    def applies(self, task: EquilibriumTask) -> bool:
        """Whether the solver can serve."""

    @abstractmethod
    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """How it ends."""


class TipStiffnessContinuation(FallbackSolver):
    """Undamped Newton, after continuation in the stiffness of tips where there is no near start."""

    name = "continuation in the stiffness of tips"

    def applies(self, task: EquilibriumTask) -> bool:
        """Where terms change abruptly."""
        return task.equilibrium.is_abrupt

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """From the start if there is one, otherwise from the equilibrium of softer tips."""
        equilibrium = task.equilibrium
        if task.start is not None:
            near = run_newton(UndampedNewton(equilibrium, task.tolerance), task.start)
            if near.converged:
                return near
        softer = equilibrium.map_terms(lambda term: term.relaxed())
        result = run_fallback_chain(EquilibriumTask(softer, task.budget, tolerance=task.tolerance))
        if not result.converged:
            return result
        start = equilibrium.complete_initial_guess(softer.dofs(result.q))
        return run_newton(UndampedNewton(equilibrium, task.tolerance), start)


class LineSearchNewton(FallbackSolver):
    """Newton's method with an exact line search, from the start or from a seed."""

    name = "Newton"

    def applies(self, task: EquilibriumTask) -> bool:
        """A film that carries compression, where no term changes abruptly."""
        return not task.wrinkles and not task.equilibrium.is_abrupt

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """With the full tangent from near, with the convex one from the seed."""
        start = compute_initial_guess(task.equilibrium) if task.start is None else task.start
        options = NewtonOptions(tolerance=task.tolerance)
        near = task.start is not None
        return run_newton(DeferredNewton(task.equilibrium, options, near=near), start)


class WrinklingNewton(FallbackSolver):
    """Newton's method for a film that wrinkles, from a near start."""

    name = "Newton with predicted stress"

    def applies(self, task: EquilibriumTask) -> bool:
        """With a start."""
        return task.wrinkles and task.start is not None

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """From the start."""
        assert task.start is not None
        return run_newton(PredictedStressNewton(task.equilibrium, task.last_step), task.start)


class LoadContinuation(FallbackSolver):
    """Continuation from larger loads for a film that wrinkles, from anywhere."""

    name = "continuation in the load"

    def applies(self, task: EquilibriumTask) -> bool:
        """From anywhere."""
        return task.wrinkles

    def solve(self, task: EquilibriumTask) -> NewtonResult:
        """Under dead loads; a pressure that follows the film starts from their equilibrium."""
        film = task.equilibrium.map_terms(lambda term: term.with_frozen_loads())
        result = continue_from_larger_loads(film, task.last_step, task.iterations)
        if task.equilibrium.conservative or not result.converged:
            return result
        last = run_newton(PredictedStressNewton(task.equilibrium, task.last_step), result.q)
        return replace(last, failed_attempts=result.as_failed_attempts("dead pressure"))


FALLBACK_CHAIN: tuple[FallbackSolver, ...] = (
    TipStiffnessContinuation(),
    LineSearchNewton(),
    WrinklingNewton(),
    LoadContinuation(),
)


def find_equilibrium(
    equilibrium: Equilibrium,
    start: Array | None = None,
    tolerance: float = STEP_TOLERANCE,
    *,
    budget: Budget | None = None,
) -> NewtonResult:
    """The equilibrium of a scene, whatever its film and load are; see `EquilibriumTask`."""
    budget = Budget.for_problem(equilibrium.problem) if budget is None else budget
    task = EquilibriumTask(equilibrium, budget, start, tolerance)
    return run_fallback_chain(task)


def run_fallback_chain(task: EquilibriumTask) -> NewtonResult:
    """The flat film where it is in balance; else the result of the first converging rung, or of the
    last applicable rung."""
    if task.equilibrium.is_flat:
        return solve_flat_film(task.equilibrium)
    for rung in FALLBACK_CHAIN:
        if not rung.applies(task):
            continue
        result = rung.solve(task)
        task.failed_attempts.append((rung.name, result))
        if result.converged:
            break
    earlier = tuple(
        entry
        for name, failed in task.failed_attempts[:-1]
        for entry in failed.as_failed_attempts(name)
    )
    last = task.failed_attempts[-1][1]
    return replace(last, failed_attempts=(*earlier, *last.failed_attempts))


def solve_flat_film(equilibrium: Equilibrium) -> NewtonResult:
    """The unloaded film: an equilibrium for every tension, stable unless compressed."""
    q = np.zeros(equilibrium.unknowns.count)
    state = equilibrium.state(q)
    least, largest = compute_principal_values(state.stress)
    # a slack film is stable, too
    wrinkles = equilibrium.model.wrinkles
    stable = wrinkles or least.min() >= -ROUNDING * np.abs(largest).max()
    if not stable and equilibrium.model.bends:  # it bears less than makes it buckle
        stable = count_negative_pivots(factorise(equilibrium.tangent(state))) == 0
    return NewtonResult(q, Status.CONVERGED if stable else Status.UNSTABLE, (), None)
