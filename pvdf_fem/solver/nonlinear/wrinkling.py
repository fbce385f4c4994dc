"""Newton's method for a film that wrinkles, and continuation from larger loads.

The energy of the tension field is convex, but its second derivative jumps at the onset of wrinkles.
Under a small load the stress of an iterate is far from that of the solution, since the film is
much stiffer in its plane than across it. The geometric stiffness is therefore computed from the
stress that the last step predicts by linearisation, not from the stress of the iterate (Magisano,
Leonetti, Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 496-514).

If this does not converge, the loads are first increased until they pull the slack film taut, and
then decreased step by step. Each equilibrium has stress, and therefore stiffness, in the parts of
the film that carry the next smaller load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.membrane import compute_strain_rate
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.factors import FactorisedTangent, factorise
from pvdf_fem.solver.nonlinear.initial_guess import compute_initial_guess
from pvdf_fem.solver.nonlinear.newton import (
    Iteration,
    NewtonResult,
    NewtonStep,
    NewtonVariant,
    run_newton,
)
from pvdf_fem.solver.nonlinear.status import Status


def estimate_load_strain(scene: Scene) -> float:
    """Estimate the magnitude of the strain that the loads cause in a film without pretension.

    Notes
    -----
    The strain is (F/(E h a))^(2/3) with the sum F of the forces, the radius a and the thickness h
    of the film, and the mean E of the in-plane stiffness matrix without shear.
    """
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    forces = [np.linalg.norm(probe.load.components) for probe in scene.loaded_probes]
    force = film.distributed_force + sum(forces)
    return float(np.cbrt(force / (stiffness * film.radius)) ** 2)


def compute_excess_strain(scene: Scene) -> float:
    """Compute the strain by which a film is too large for its rim.

    This is the smaller of the strains along x and y. It is negative if the film is stretched in
    either direction.
    """
    return -float(scene.film.prestrain[:2].max())


def is_barely_loaded(scene: Scene, max_fraction: float = 0.1) -> bool:
    """Return whether the loads are too small to pull a slack film taut.

    The tension is then concentrated in narrow lines, whose width is about the film's radius times
    the square root of the ratio of load strain and excess strain.

    Parameters
    ----------
    scene : Scene
        The scene with the loads and the film.
    max_fraction : float, optional
        Fraction of `compute_excess_strain` below which the load strain counts as small.
    """
    return estimate_load_strain(scene) < max_fraction * compute_excess_strain(scene)


@dataclass(frozen=True)
class WrinklingOptions:
    """Damping, line search and iteration limit of Newton's method for a film that wrinkles."""

    #: Artificial tension that stabilises slack film in a step, divided by the mean tension and by
    #: the relative size of the last step (at most 1).
    damping: float = 1e-2
    max_iterations: int = 25
    #: The line search ends if the slope of the energy is below this fraction of the initial slope.
    line_search_slope: float = 0.5
    line_search_trials: int = 6  #: Maximum number of step lengths tried after the full step.
    #: Each trial shortens the interval of the line search by at least this fraction at either end.
    line_search_cut: float = 0.1


class PredictedStressNewton(NewtonVariant):
    """Newton's method for a film that wrinkles, with tangents at predicted stresses.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    tolerance : float
        The iteration ends after a step below this relative size in the energy norm.
    options : WrinklingOptions, optional
        Damping, line search and iteration limit.
    """

    def __init__(
        self, equilibrium: Equilibrium, tolerance: float, options: WrinklingOptions | None = None
    ) -> None:
        super().__init__(equilibrium)
        self.options = WrinklingOptions() if options is None else options
        self.tolerance = tolerance
        self.max_iterations = self.options.max_iterations
        self._predicted_stress: Array | None = None
        self._last_size = self.options.damping

    def choose_tangent(self, state: State, iterations: Sequence[Iteration]) -> FactorisedTangent:
        """Factorise a tangent with the predicted stress and an artificial tension.

        The first tangent has the stress of `state`. The tension falls with the size of the steps.
        """
        stress = state.stress if self._predicted_stress is None else self._predicted_stress
        damping = self.options.damping * min(self._last_size, 1.0)
        predicted = self.equilibrium.membrane.with_predicted_stress(state, stress, damping)
        return FactorisedTangent(factorise(self.equilibrium.tangent(predicted)))

    def measure_step(self, q: Array, state: State, slope: float) -> float:
        """Compute the relative size of a full step, and store it for the damping of the next."""
        self._last_size = super().measure_step(q, state, slope)
        return self._last_size

    def compute_squared_norm(self, q: Array, state: State) -> float:
        """Compute the smaller of the loads' work and twice the membrane's energy, in J."""
        work = super().compute_squared_norm(q, state)
        return min(work, 2.0 * self.equilibrium.membrane.energy(state))

    def choose_length(self, step: NewtonStep) -> float:
        """Choose a step length near the minimum of the energy along the full step.

        The energy is convex, so that its slope has at most one zero, which is approximated by
        regula falsi. The full step is made if the energy hardly rises at its end, or if
        nonconservative loads leave no energy to minimise.
        """
        if not self.equilibrium.conservative:
            return 1.0
        options = self.options
        small_slope = options.line_search_slope * abs(step.slope)
        low_length = 0.0
        low_slope = step.slope
        high_length = 1.0
        high_slope = self._compute_energy_slope(step, high_length)
        if not high_slope > small_slope:
            return high_length
        for _ in range(options.line_search_trials):
            width = high_length - low_length
            cut = options.line_search_cut * width
            length = low_length - width * low_slope / (high_slope - low_slope)
            length = float(np.clip(length, low_length + cut, high_length - cut))
            slope = self._compute_energy_slope(step, length)
            if abs(slope) < small_slope:
                break
            if slope > 0.0:
                high_length = length
                high_slope = slope
            else:
                low_length = length
                low_slope = slope
        return length

    def _compute_energy_slope(self, step: NewtonStep, length: float) -> float:
        """Compute the derivative of the energy with respect to the step length, in J."""
        state = self.equilibrium.state(step.q + length * step.direction)
        return float(self.equilibrium.residual(state) @ step.direction)

    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """Return `Status.CONVERGED` after a step below the tolerance, and set `factors`.

        The predicted stress for the next tangent is stored in any case.
        """
        self._predicted_stress = self._predict_stress(step)
        if not step.size < self.tolerance:
            return None
        self.factors = factorise(self.equilibrium.tangent(state))
        return Status.CONVERGED

    def _predict_stress(self, step: NewtonStep) -> Array:
        """Compute the stress of the strain that is linearised in the step.

        Returns
        -------
        ndarray, shape (elements, points, 3)
            Stress in Pa, at the quadrature points.
        """
        x = self.equilibrium.unknowns.expand(step.change)
        gradient = self.equilibrium.space.displacement_gradient(x)
        strain_change = compute_strain_rate(step.state.deformation_gradient, gradient)
        return self.equilibrium.membrane.resultant(step.state.strain + strain_change)


def continue_from_larger_loads(
    equilibrium: Equilibrium,
    tolerance: float,
    *,
    affordable_iterations: int,
    max_iterations: int = 300,
    passing_tolerance: float = 0.1,
    ratio: float = 8.0,
) -> NewtonResult:
    """Find the equilibrium under dead loads from equilibria under larger loads.

    The first load is large enough that its strain equals the film's excess strain. It is increased
    until Newton's method converges from the deflection of a linear membrane. Then the load
    decreases to the given one, each time starting from the last equilibrium.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations, with dead loads.
    tolerance : float
        Relative size of the last Newton step under the given load, in the energy norm.
    affordable_iterations, max_iterations : int
        The smaller one limits the total number of Newton iterations. It is checked between loads,
        so the last of the larger loads may exceed it.
    passing_tolerance : float, optional
        Relative size of the last Newton step under larger loads.
    ratio : float, optional
        Ratio of successive loads. After a failed decrease, the square root of the last ratio is
        used from then on.

    Returns
    -------
    NewtonResult
        The last result, with the iterations under all loads. The status is `Status.CONVERGED`, or
        `Status.MAX_ITERATIONS` after any failure.
    """
    max_total = min(affordable_iterations, max_iterations)
    growth = ratio
    factor = _compute_tautening_load_factor(equilibrium.scene)
    solved_factor = factor
    solved_q: Array | None = None
    iterations: list[Iteration] = []
    while True:
        is_last_load = factor == 1.0
        loaded = equilibrium.with_scaled_loads(factor)
        if is_last_load:
            options = WrinklingOptions(max_iterations=max_total - len(iterations))
            variant = PredictedStressNewton(loaded, tolerance, options=options)
        else:
            variant = PredictedStressNewton(loaded, passing_tolerance)
        initial_guess = compute_initial_guess(loaded) if solved_q is None else solved_q
        result = run_newton(variant, initial_guess)
        iterations.extend(result.iterations)
        has_converged = result.converged and is_last_load
        if has_converged or len(iterations) >= max_total:
            break
        if result.converged:
            solved_q = result.q
            solved_factor = factor
        elif solved_q is not None:
            ratio = (solved_factor / factor) ** 0.5  # a smaller step down from the last load
        if solved_q is None:
            factor *= growth  # no load was large enough yet
        else:
            factor = max(solved_factor / ratio, 1.0)
    status = Status.CONVERGED if has_converged else Status.MAX_ITERATIONS
    return replace(result, status=status, iterations=tuple(iterations))


def _compute_tautening_load_factor(scene: Scene) -> float:
    """Compute the factor on the loads at which their strain equals the film's excess strain.

    It is 1 if the strain is already larger, or if there are no loads.
    """
    strain = estimate_load_strain(scene)
    excess = compute_excess_strain(scene)
    if not 0.0 < strain < excess:
        return 1.0
    return float((excess / strain) ** 1.5)
