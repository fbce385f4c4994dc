"""Newton's method: a loop whose variants choose the tangents, step lengths and end."""

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

#: Relative size of the last Newton step in the energy norm, if its tangent is new. As convergence
#: is quadratic, the next step would be about 1e-12.
STEP_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Iteration:
    """Record of one Newton iteration."""

    step_size: float  #: Energy norm of the full step, relative to that of the displacement.
    step_length: float  #: Factor on the full step that was made.
    has_convex_tangent: bool  #: Whether compressive stress was left out of the tangent.
    has_new_tangent: bool  #: Whether the tangent was factorised for this step.


@dataclass(frozen=True)
class FailedAttempt:
    """Record of a solver that failed before another solver or space was tried."""

    solver: str  #: Name of the solver, as shown to users.
    status: Status  #: Reason for the failure.
    iterations: int  #: Number of Newton iterations.
    tangent_count: int  #: Number of those iterations with a new tangent.


@dataclass(frozen=True)
class NewtonResult:
    """The outcome of Newton's method, whether it converged or not."""

    q: Array  #: The last unknowns, shape (unknowns,).
    status: Status  #: `Status.CONVERGED`, or the reason for the failure.
    iterations: tuple[Iteration, ...]  #: Iterations of the solve that led to `q`.
    #: Factors of a tangent near `q`; None for the flat film and without convergence.
    factors: SuperLU | None
    #: Solvers that failed before; their iterations are not in `iterations`.
    failed_attempts: tuple[FailedAttempt, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether `q` is an equilibrium."""
        return self.status is Status.CONVERGED

    @property
    def tangent_count(self) -> int:
        """Number of iterations with a new tangent, including those of failed attempts."""
        earlier = sum(attempt.tangent_count for attempt in self.failed_attempts)
        return earlier + self._own_tangent_count

    @property
    def _own_tangent_count(self) -> int:
        """Number of iterations with a new tangent, without those of failed attempts."""
        return sum(iteration.has_new_tangent for iteration in self.iterations)

    def as_failed_attempts(self, solver: str) -> tuple[FailedAttempt, ...]:
        """Return the failed attempts of this result, followed by a record of the result itself.

        A later result stores them as its `failed_attempts`.

        Parameters
        ----------
        solver : str
            Name of the solver that returned this result.
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
    """A Newton step: its start, the full step, and the length that is made of it."""

    q: Array  #: Unknowns before the step, shape (unknowns,).
    state: State  #: State at `q`.
    direction: Array  #: The full step, shape (unknowns,).
    slope: float  #: Derivative of the energy at `q` along the full step, in J.
    size: float  #: Energy norm of the full step, relative to that of the displacement.
    length: float = 1.0  #: Factor on the full step.

    @property
    def change(self) -> Array:
        """Change of the unknowns in the step, shape (unknowns,)."""
        return self.length * self.direction


class NewtonVariant(ABC):
    """Base class of Newton variants, which choose tangents, step lengths and when to end.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    """

    max_iterations = 60
    #: Factors of a tangent near the solution; the variant sets them before it reports convergence.
    factors: SuperLU | None = None

    def __init__(self, equilibrium: Equilibrium) -> None:
        self.equilibrium = equilibrium

    @abstractmethod
    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Return the factorised tangent for the next step, new or from an earlier state.

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
            Derivative of the energy along the full step in J: minus the squared norm of the step.

        Returns
        -------
        float
            Norm of the step divided by that of the displacement; infinite if the latter is zero.
        """
        squared_norm = abs(self.compute_squared_norm(q, state))
        return float(np.sqrt(abs(slope) / squared_norm)) if squared_norm > 0.0 else np.inf

    def compute_squared_norm(self, q: Array, state: State) -> float:
        """Compute the squared energy norm of the displacement in J, to which steps are relative.

        Default: the work of the loads, which may be negative. Subclasses may override it.

        Parameters
        ----------
        q : ndarray, shape (unknowns,)
            Unknowns of the displacement.
        state : State
            State at `q`.
        """
        return self.equilibrium.work(state, q)

    def choose_length(self, step: NewtonStep) -> float:
        """Return the factor on the full step. Default: 1. Subclasses may override it."""
        return 1.0

    @abstractmethod
    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """Return the status if the iteration ends after a step; None to continue.

        Parameters
        ----------
        step : NewtonStep
            The last step.
        state : State
            State after the step.
        iterations : sequence of Iteration
            The iterations so far, including the last step.
        """


@np.errstate(over="raise", invalid="raise")
def run_newton(variant: NewtonVariant, q: Array) -> NewtonResult:
    """Solve the equations R(q) = 0 of a variant by Newton's method.

    Parameters
    ----------
    variant : NewtonVariant
        The equations, and the choice of tangents, step lengths and end. It stores what it has to
        remember from step to step, so each solve needs a new object.
    q : ndarray, shape (unknowns,)
        Initial guess.

    Returns
    -------
    NewtonResult
        The status is the one that the variant returned, or `Status.SINGULAR` if a tangent is
        exactly singular, or `Status.MAX_ITERATIONS` if there are too many iterations or a
        floating-point overflow.
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
    except FloatingPointError:  # the steps diverged
        status = Status.MAX_ITERATIONS
    except RuntimeError:  # raised by SuperLU: "Factor is exactly singular"
        status = Status.SINGULAR
    if status is None:
        status = Status.MAX_ITERATIONS
    factors = variant.factors if status is Status.CONVERGED else None
    return NewtonResult(q, status, tuple(iterations), factors=factors)


def _log_iteration(variant: NewtonVariant, iterations: Sequence[Iteration]) -> None:
    """Log the last iteration at level DEBUG."""
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
