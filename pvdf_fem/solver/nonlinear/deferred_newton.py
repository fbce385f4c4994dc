"""Newton's method for films that do not wrinkle: with deferred tangents, or with full steps only.

The energy of such a film along a Newton direction is exactly a quartic polynomial of the step
length, so that an exact line search is cheap. An initial guess often has compressive stress that
the solution does not have, and that would make the tangent indefinite. Far from the solution the
geometric stiffness is therefore computed from the tensile part of the stress only.
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
from pvdf_fem.solver.nonlinear.stability import is_compressed, may_be_stable
from pvdf_fem.solver.nonlinear.status import Status


@dataclass(frozen=True)
class NewtonOptions:
    """Thresholds of `DeferredNewton`: when tangents are renewed, and when the iteration ends.

    Sizes are energy norms of steps relative to that of the solution.
    """

    #: The iteration converges if the next step is expected to be smaller than this squared.
    tolerance: float = STEP_TOLERANCE
    #: After a larger step the convex tangent is used, so that every step lowers the energy.
    near_size: float = 0.1
    #: At most this size, full steps are made without a line search: convergence is quadratic.
    local_size: float = 1e-2
    #: A tangent is used again only after a step of at most this size ...
    defer_size: float = 0.3
    #: ... and while each step is at most this fraction of the step before.
    contraction: float = 0.5
    max_iterations: int = 60  #: Maximum number of iterations under conservative loads.
    max_following: int = 30  #: Maximum number of iterations under loads that follow the film.
    #: After this number of iterations a film counts as unstable if it is still in compression, and
    #: if its last step was large or made with a convex tangent.
    patience: int = 30


class DeferredNewton(NewtonVariant):
    """Newton's method with an exact line search, which reuses tangents near the solution.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    options : NewtonOptions
        Thresholds for renewing tangents and for ending.
    near : bool
        Whether the initial guess is close to the solution, such as the solution of another mesh or
        order; the first tangent then includes compressive stress unless it would be indefinite.
    """

    _tangent: FactorisedTangent | None = None

    def __init__(self, equilibrium: Equilibrium, options: NewtonOptions, *, near: bool) -> None:
        super().__init__(equilibrium)
        self.options = options
        self.max_iterations = options.max_following
        if equilibrium.conservative:
            self.max_iterations = options.max_iterations
        #: Size of the step before the first one, which only selects the first tangent.
        self._initial_size = options.near_size if near else np.inf

    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Return the last tangent if its steps are small and shrink fast, otherwise a new one."""
        if self._tangent is not None and not self._is_tangent_outdated(self._tangent, iterations):
            return self._tangent
        last_size = iterations[-1].step_size if iterations else self._initial_size
        self._tangent = self._make_tangent(state, last_size)
        return self._tangent

    def _is_tangent_outdated(
        self, tangent: FactorisedTangent, iterations: Sequence[Iteration]
    ) -> bool:
        """Return whether the tangent is convex, or its steps are large or shrink slowly."""
        last = iterations[-1]
        if tangent.is_convex or last.step_size > self.options.defer_size:
            return True
        if last.has_new_tangent:
            return False
        return last.step_size > self.options.contraction * iterations[-2].step_size

    def _make_tangent(self, state: State, last_size: float) -> FactorisedTangent:
        """Factorise the full tangent if it is safe, otherwise the convex tangent.

        The full tangent is used if no stress is compressive, or if the last step was small and the
        tangent is positive definite.
        """
        is_state_compressed = is_compressed(state)
        if last_size <= self.options.near_size or not is_state_compressed:
            factors = factorise(self.equilibrium.tangent(state))
            if not is_state_compressed or count_negative_pivots(factors) == 0:
                return FactorisedTangent(factors)
        convex = make_convex_tangent(self.equilibrium, state)
        return FactorisedTangent(factorise(convex), is_convex=True)

    def choose_length(self, step: NewtonStep) -> float:
        """Return the step length that minimises the energy; 1 for a small step."""
        if step.size <= self.options.local_size:
            return 1.0
        energy = self.equilibrium.energy_along(step.state, step.direction, step.slope)
        return find_minimizing_length(energy)

    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """End if the next step would be negligible, or if the film stays in compression.

        If the iteration converges, `factors` are set to those of the full tangent. An equilibrium
        in compression is unstable if these prove it.
        """
        tangent = self._tangent
        assert tangent is not None
        still_moves = step.size > self.options.local_size**2 or tangent.is_convex
        is_late = len(iterations) >= self.options.patience
        if still_moves and is_late and is_compressed(state):
            return Status.UNSTABLE
        if not self._is_next_step_small(iterations):
            return None
        is_state_compressed = is_compressed(state)
        self.factors = tangent.factors
        if tangent.is_convex or is_state_compressed:
            self.factors = factorise(self.equilibrium.tangent(state))
        if is_state_compressed and not may_be_stable(self.equilibrium, self.factors):
            return Status.UNSTABLE
        return Status.CONVERGED

    def _is_next_step_small(self, iterations: Sequence[Iteration]) -> bool:
        """Return whether the next step is expected to be smaller than the squared tolerance.

        After a step s with a new tangent the next is about s² (quadratic convergence). With a
        reused tangent the ratio of the last two steps is extrapolated.
        """
        last = iterations[-1]
        reduction = last.step_size
        if not last.has_new_tangent:
            reduction = last.step_size / iterations[-2].step_size
        return last.step_size * reduction < self.options.tolerance**2


class UndampedNewton(NewtonVariant):
    """Newton's method with full steps and a new tangent for each; it needs a close initial guess.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    tolerance : float
        The iteration ends after a step below this relative size in the energy norm.
    """

    max_iterations = 20

    def __init__(self, equilibrium: Equilibrium, tolerance: float) -> None:
        super().__init__(equilibrium)
        self.tolerance = tolerance

    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Factorise the full tangent at the state, and store it in `factors`."""
        self.factors = factorise(self.equilibrium.tangent(state))
        return FactorisedTangent(self.factors)

    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """Return `Status.CONVERGED` after a step below the tolerance."""
        return Status.CONVERGED if step.size < self.tolerance else None


def make_convex_tangent(
    equilibrium: Equilibrium, state: State, min_tension: float = 1e-6
) -> sp.csc_matrix | LowRankUpdate:
    """Assemble the tangent without the geometric stiffness of compressive stress.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations that are linearised.
    state : State
        The state at which they are linearised.
    min_tension : float, optional
        Isotropic tension that is added everywhere, as a fraction of the largest stress component;
        it keeps the tangent regular where the film is slack.

    Returns
    -------
    csc_matrix or LowRankUpdate, shape (unknowns, unknowns)
        The tangent in N/m. The membrane adds no negative stiffness to it.
    """
    uniform_tension = np.array([1.0, 1.0, 0.0])
    floor = min_tension * np.abs(state.stress).max() * uniform_tension
    stress = compute_tensile_part(state.stress) + floor
    return equilibrium.tangent(replace(state, stress=stress))


def find_minimizing_length(energy: Array) -> float:
    """Find the step length s > 0 that minimises a quartic energy.

    Parameters
    ----------
    energy : ndarray, shape (5,)
        Coefficients of 1, s, ... s⁴ in J.

    Returns
    -------
    float
        The positive stationary point with the lowest energy; 1 if there is none.
    """
    derivative = polynomial.polyder(energy)
    roots = np.roots(derivative[::-1])  # np.roots expects the highest power first
    is_real = np.abs(roots.imag) <= 1e-9 * np.abs(roots)
    lengths = roots.real[is_real & (roots.real > 0)]
    if len(lengths) == 0:
        return 1.0
    energies = polynomial.polyval(lengths, energy)
    return float(lengths[np.argmin(energies)])
