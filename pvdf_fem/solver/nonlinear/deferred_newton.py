"""Newton's method for films that do not wrinkle: line search, deferred and undamped variants.

The energy along a Newton direction of a film that does not wrinkle is an exact quartic, and its
minimum costs a few sums. The compressive stresses of an initial guess, which the solution does not
have, would make the tangent indefinite. Far from the solution the geometric stiffness therefore
takes only the tensile part of the stress.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import polynomial

from pvdf_fem.arrays import Array
from pvdf_fem.film.low_rank import LowRankUpdate
from pvdf_fem.film.membrane import compute_tensile_part
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import (
    FactorisedTangent,
    count_negative_pivots,
    factorise,
)
from pvdf_fem.solver.nonlinear.newton import (
    STEP_TOLERANCE,
    Iteration,
    NewtonStep,
    NewtonVariant,
)
from pvdf_fem.solver.nonlinear.stability import is_compressed, is_stable
from pvdf_fem.solver.nonlinear.status import Status


@dataclass(frozen=True)
class NewtonOptions:
    """Choice of tangents in `DeferredNewton`, and when it gives up.

    Sizes of steps are relative, in the energy norm.
    """

    tolerance: float = STEP_TOLERANCE  #: Size of a last step with a new tangent.
    #: After a larger step compressive stress adds no stiffness, so that every step lowers the
    #: energy.
    near_size: float = 0.1
    #: Below this size full steps keep the quadratic convergence, and no line search is made.
    local_size: float = 1e-2
    defer_size: float = 0.3  #: A tangent is used again after a smaller step ...
    contraction: float = 0.5  #: ... as long as each step is at most this part of the one before.
    max_iterations: int = 60
    #: The same under a load that follows the film, whose energy along a step is unknown.
    max_following: int = 30
    #: A film that is still in compression after so many iterations, and moves or has an indefinite
    #: tangent, has no stable equilibrium.
    patience: int = 30


class DeferredNewton(NewtonVariant):
    """Newton's method with an exact line search, which uses a tangent again near the solution.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    options : NewtonOptions
        Choice of tangents, and when to give up.
    near : bool
        Whether the initial guess is the solution of another mesh or order, which is near.
    """

    _tangent: FactorisedTangent | None = None

    def __init__(self, equilibrium: Equilibrium, options: NewtonOptions, *, near: bool) -> None:
        super().__init__(equilibrium)
        self.options = options
        self.max_iterations = options.max_following
        if equilibrium.conservative:
            self.max_iterations = options.max_iterations
        #: The first tangent is chosen as after a step of this size.
        self._initial_size = options.near_size if near else np.inf

    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Return the last tangent while steps with it shrink fast, otherwise a new one."""
        if self._tangent is not None and not self._is_outdated(self._tangent, iterations):
            return self._tangent
        last_size = iterations[-1].step_size if iterations else self._initial_size
        self._tangent = self._make_tangent(state, last_size)
        return self._tangent

    def _is_outdated(self, tangent: FactorisedTangent, iterations: Sequence[Iteration]) -> bool:
        """Return whether steps with the tangent are large, or shrink slowly."""
        last = iterations[-1]
        if tangent.is_convex or last.step_size > self.options.defer_size:
            return True
        if last.has_new_tangent:
            return False
        return last.step_size > self.options.contraction * iterations[-2].step_size

    def _make_tangent(self, state: State, last_size: float) -> FactorisedTangent:
        """Return the full tangent near the solution, otherwise the convex one.

        Where no stress is compressive both are the same, and positive definite.
        """
        is_state_compressed = is_compressed(state)
        if last_size <= self.options.near_size or not is_state_compressed:
            factors = factorise(self.equilibrium.tangent(state))
            if not is_state_compressed or count_negative_pivots(factors) == 0:
                return FactorisedTangent(factors)
        convex = make_convex_tangent(self.equilibrium, state)
        return FactorisedTangent(factorise(convex), is_convex=True)

    def choose_length(self, step: NewtonStep) -> float:
        """Return the length with the least energy; 1 of a small step."""
        if step.size <= self.options.local_size:
            return 1.0
        energy = self.equilibrium.energy_along(step.state, step.direction, step.slope)
        return find_least_energy(energy)

    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """End after a small step, or with a film that stays in compression."""
        tangent = self._tangent
        assert tangent is not None
        still_moves = step.size > self.options.local_size**2 or tangent.is_convex
        is_late = len(iterations) >= self.options.patience
        if still_moves and is_late and is_compressed(state):
            return Status.UNSTABLE
        if not self._is_last_step_small(iterations):
            return None
        is_state_compressed = is_compressed(state)
        self.factors = tangent.factors
        if tangent.is_convex or is_state_compressed:
            self.factors = factorise(self.equilibrium.tangent(state))
        if is_state_compressed and not is_stable(self.equilibrium, self.factors):
            return Status.UNSTABLE
        return Status.CONVERGED

    def _is_last_step_small(self, iterations: Sequence[Iteration]) -> bool:
        """Return whether the next step would be smaller than the squared tolerance.

        Steps shrink quadratically with new tangents, otherwise at the rate of the last two.
        """
        last = iterations[-1]
        reduction = last.step_size
        if not last.has_new_tangent:
            reduction = last.step_size / iterations[-2].step_size
        return last.step_size * reduction < self.options.tolerance**2


class UndampedNewton(NewtonVariant):
    """Newton's method with full steps and a new tangent for each, from a near initial guess.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    tolerance : float
        Relative size of the last step in the energy norm.
    """

    max_iterations = 20

    def __init__(self, equilibrium: Equilibrium, tolerance: float) -> None:
        super().__init__(equilibrium)
        self.tolerance = tolerance

    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Return the tangent of the state."""
        self.factors = factorise(self.equilibrium.tangent(state))
        return FactorisedTangent(self.factors)

    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """End after a step below the tolerance."""
        return Status.CONVERGED if step.size < self.tolerance else None


def make_convex_tangent(
    equilibrium: Equilibrium, state: State, least_tension: float = 1e-6
) -> sp.csc_matrix | LowRankUpdate:
    """Make the tangent without the geometric stiffness of compressive stress.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations.
    state : State
        The state.
    least_tension : float, optional
        Tension that is added everywhere, over the largest stress. It keeps the tangent regular
        where the film is slack.

    Returns
    -------
    (unknowns, unknowns) csc_matrix or LowRankUpdate
        The tangent in N/m, which is never indefinite.
    """
    uniform_tension = np.array([1.0, 1.0, 0.0])
    floor = least_tension * np.abs(state.stress).max() * uniform_tension
    stress = compute_tensile_part(state.stress) + floor
    return equilibrium.tangent(replace(state, stress=stress))


def find_least_energy(energy: Array) -> float:
    """Find the step length s > 0 at which the energy is least.

    Parameters
    ----------
    energy : ndarray, shape (5,)
        Coefficients in J of 1, s, ... s⁴.

    Returns
    -------
    float
        The stationary point with the least energy; 1 if there is none.
    """
    derivative = polynomial.polyder(energy)
    roots = np.roots(derivative[::-1])
    is_real = np.abs(roots.imag) <= 1e-9 * np.abs(roots)
    lengths = roots.real[is_real & (roots.real > 0)]
    if len(lengths) == 0:
        return 1.0
    energies = polynomial.polyval(lengths, energy)
    return float(lengths[np.argmin(energies)])
