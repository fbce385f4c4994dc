"""Newton's method: one loop, whose variants choose tangents, step lengths and ends."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import FactorisedTangent
from pvdf_fem.solver.nonlinear.status import Status

logger = logging.getLogger(__name__)

#: Relative size, in the energy norm, of the last Newton step that is made with a new tangent. The
#: next one, by the quadratic convergence, would be about 1e-12.
STEP_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Iteration:
    """One row of the iteration table."""

    step_size: float  #: Energy norm of the full Newton step over that of the solution.
    step_length: float  #: Part of the full step that the line search chose.
    has_convex_tangent: bool  #: Whether compressive stress was left out of the tangent.
    has_new_tangent: bool  #: Whether the tangent is that of this state, not of an earlier one.


@dataclass(frozen=True)
class FailedAttempt:
    """A solver that found no equilibrium, before another was tried."""

    solver: str  #: Its name.
    status: Status
    iterations: int
    tangent_count: int  #: Number of its iterations with a new tangent.


@dataclass(frozen=True)
class NewtonResult:
    """How Newton's method ended."""

    q: Array  #: The last unknowns, (unknowns,).
    status: Status
    iterations: tuple[Iteration, ...]  #: The table of the solve that led to `q`.
    #: Factors of the last tangent; None for the flat film and without convergence.
    factors: SuperLU | None
    failed_attempts: tuple[FailedAttempt, ...] = ()  #: Solvers that failed before.

    @property
    def converged(self) -> bool:
        """Whether `q` is an equilibrium."""
        return self.status is Status.CONVERGED

    @property
    def tangent_count(self) -> int:
        """Number of factorised tangents, those of failed attempts included."""
        earlier = sum(attempt.tangent_count for attempt in self.failed_attempts)
        return earlier + self._own_tangent_count

    @property
    def _own_tangent_count(self) -> int:
        return sum(iteration.has_new_tangent for iteration in self.iterations)

    def as_failed_attempts(self, solver: str) -> tuple[FailedAttempt, ...]:
        """Return this result, behind its own failed attempts, as those of a later result.

        Parameters
        ----------
        solver : str
            The name of the solver that this result is of.
        """
        attempt = FailedAttempt(
            solver,
            self.status,
            iterations=len(self.iterations),
            tangent_count=self._own_tangent_count,
        )
        return (*self.failed_attempts, attempt)


@dataclass(frozen=True)
class NewtonStep:
    """A Newton step."""

    q: Array  #: Unknowns where it starts, (unknowns,).
    state: State  #: The state there.
    direction: Array  #: The full step, (unknowns,).
    slope: float  #: Derivative of the energy along the full step in J.
    size: float  #: Relative size of the full step in the energy norm.
    length: float = 1.0  #: Part of the full step that is made.

    @property
    def change(self) -> Array:
        """Change of the unknowns, (unknowns,)."""
        return self.length * self.direction


class NewtonVariant(ABC):
    """A variant of Newton's method: its tangents, step lengths and end.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    """

    max_iterations = 60
    #: Factors of the tangent at the solution, when the iteration has converged.
    factors: SuperLU | None = None

    def __init__(self, equilibrium: Equilibrium) -> None:
        self.equilibrium = equilibrium

    @abstractmethod
    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Return the tangent for the next step: a new one, or one of an earlier state.

        Parameters
        ----------
        state : State
            The state where the step starts.
        iterations : sequence of Iteration
            The iterations so far.
        """

    def measure_step(self, q: Array, state: State, slope: float) -> float:
        """Compute the relative size of a full step in the energy norm.

        Parameters
        ----------
        q : ndarray, shape (unknowns,)
            Unknowns where the step starts.
        state : State
            The state there.
        slope : float
            Derivative of the energy along the full step in J, the negative of its squared norm.

        Returns
        -------
        float
            The norm over that of the displacement; infinite where that is zero.
        """
        squared_norm = abs(self.compute_squared_norm(q, state))
        return float(np.sqrt(abs(slope) / squared_norm)) if squared_norm > 0.0 else np.inf

    def compute_squared_norm(self, q: Array, state: State) -> float:
        """Compute the squared energy norm of a displacement in J: here the work of the loads.

        Parameters
        ----------
        q : ndarray, shape (unknowns,)
            Unknowns of the displacement.
        state : State
            Its state.
        """
        return self.equilibrium.work(state, q)

    def choose_length(self, step: NewtonStep) -> float:
        """Choose the part of a full step that is made; here all of it."""
        return 1.0

    @abstractmethod
    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """Return the status with which the iteration ends after a step; None to go on.

        Parameters
        ----------
        step : NewtonStep
            The last step.
        state : State
            The state where it ends.
        iterations : sequence of Iteration
            The iterations so far, with that of the step.
        """


@np.errstate(over="raise", invalid="raise")
def run_newton(variant: NewtonVariant, q: Array) -> NewtonResult:
    """Solve the equations R(q) = 0 of a variant by Newton's method.

    Parameters
    ----------
    variant : NewtonVariant
        The equations, and the choice of tangents, step lengths and the end.
    q : ndarray, shape (unknowns,)
        Initial guess.

    Returns
    -------
    NewtonResult
        Its status is `Status.CONVERGED`, the variant's reason to give up, `Status.SINGULAR` for an
        exactly singular tangent, or `Status.MAX_ITERATIONS`, also where the steps diverge.
    """
    equilibrium = variant.equilibrium
    iterations: list[Iteration] = []
    state = equilibrium.state(q)
    status = None
    try:
        while status is None and len(iterations) < variant.max_iterations:
            tangent = variant.choose_tangent(state, iterations)
            residual = equilibrium.residual(state)
            direction = tangent.compute_step(residual)
            slope = float(residual @ direction)
            size = variant.measure_step(q, state, slope)
            step = NewtonStep(q, state, direction, slope=slope, size=size)
            step = replace(step, length=variant.choose_length(step))
            iteration = Iteration(
                step.size,
                step.length,
                has_convex_tangent=tangent.is_convex,
                has_new_tangent=tangent.is_new,
            )
            iterations.append(iteration)
            _log_iteration(variant, iterations)

            change = step.change
            tangent.remember(residual, change)
            q = q + change
            state = equilibrium.state(q)
            status = variant.find_end(step, state, iterations)
    except FloatingPointError:  # the steps diverge
        status = Status.MAX_ITERATIONS
    except RuntimeError:  # SuperLU: exactly singular
        status = Status.SINGULAR
    if status is None:
        status = Status.MAX_ITERATIONS
    factors = variant.factors if status is Status.CONVERGED else None
    return NewtonResult(q, status, tuple(iterations), factors=factors)


def _log_iteration(variant: NewtonVariant, iterations: Sequence[Iteration]) -> None:
    """Log the last iteration."""
    if not logger.isEnabledFor(logging.DEBUG):
        return
    last = iterations[-1]
    logger.debug(
        "%s, iteration %d: step %.2e, length %.3g, %s%s tangent",
        type(variant).__name__,
        len(iterations),
        last.step_size,
        last.step_length,
        "new" if last.has_new_tangent else "earlier",
        " convex" if last.has_convex_tangent else "",
    )
