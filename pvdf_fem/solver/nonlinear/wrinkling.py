"""Newton's method for a film that wrinkles, and continuation from larger loads.

The energy of the tension field is convex, but its second derivative jumps where the film begins to
wrinkle. Under a small load the film is so stiff that the stresses of trial strains mean little. The
geometric stiffness therefore takes the stress that the last step predicts, not the stress of the
strain (Magisano, Leonetti, Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 496-514).

Larger loads pull a slack film taut. While the film is unloaded, it has stress, and therefore
stiffness, wherever the next equilibrium needs them.
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
    """Estimate the magnitude of the strain by the loads in a flat film without tension.

    Notes
    -----
    (F/(E h a))^(2/3) with the sum F of all forces, and the film's mean stiffness E, thickness h and
    radius a.
    """
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    forces = [np.linalg.norm(probe.load.components) for probe in scene.loaded_probes]
    force = film.distributed_force + sum(forces)
    return float(np.cbrt(force / (stiffness * film.radius)) ** 2)


def compute_excess_strain(scene: Scene) -> float:
    """Compute by which strain a film is larger than its rim, in the direction with least excess."""
    return -float(scene.film.prestrain[:2].max())


def is_barely_loaded(scene: Scene, share: float = 0.1) -> bool:
    """Return whether the strain by the loads is small against a film's excess.

    The tension then runs in narrow lines, whose width is about the root of the ratio times the
    film's radius.

    Parameters
    ----------
    scene : Scene
        The scene.
    share : float, optional
        Share of the excess in every direction below which the strain is small.
    """
    return estimate_load_strain(scene) < share * compute_excess_strain(scene)


@dataclass(frozen=True)
class WrinklingOptions:
    """When Newton's method for a film that wrinkles goes on, and when it gives up."""

    #: Artificial tension that holds slack film in a step, over the mean tension and the relative
    #: size of the last step.
    damping: float = 1e-2
    max_iterations: int = 25
    #: The line search ends where the energy's slope is at most this share of the initial slope.
    line_search_slope: float = 0.5
    line_search_trials: int = 6
    #: The line search cuts at least this share off either end of its interval.
    line_search_cut: float = 0.1


class PredictedStressNewton(NewtonVariant):
    """Newton's method for a film that wrinkles, whose tangents take predicted stresses.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations to solve.
    tolerance : float
        Relative size of the last step in the energy norm.
    options : WrinklingOptions, optional
        Damping, line search, and when to give up.
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
        """Return the tangent with the predicted stress, damped until steps are small."""
        stress = state.stress if self._predicted_stress is None else self._predicted_stress
        damping = self.options.damping * min(self._last_size, 1.0)
        predicted = self.equilibrium.membrane.with_predicted_stress(state, stress, damping)
        return FactorisedTangent(factorise(self.equilibrium.tangent(predicted)))

    def measure_step(self, q: Array, state: State, slope: float) -> float:
        """Compute the relative size of a full step in the energy norm, and keep it."""
        self._last_size = super().measure_step(q, state, slope)
        return self._last_size

    def compute_squared_norm(self, q: Array, state: State) -> float:
        """Compute the smaller of the loads' work and twice the energy in J."""
        work = super().compute_squared_norm(q, state)
        return min(work, 2.0 * self.equilibrium.membrane.energy(state))

    def choose_length(self, step: NewtonStep) -> float:
        """Choose where the energy along a full step nearly stops falling.

        The energy is convex, so that a single zero of its slope is searched by regula falsi. All of
        the step is made where the energy still falls at its end, or where there is no energy.
        """
        if not self.equilibrium.conservative:
            return 1.0
        options = self.options
        small_slope = options.line_search_slope * abs(step.slope)
        low_length = 0.0
        low_slope = step.slope
        high_length = 1.0
        high_slope = self._compute_slope(step, high_length)
        if not high_slope > small_slope:
            return high_length
        for _ in range(options.line_search_trials):
            width = high_length - low_length
            cut = options.line_search_cut * width
            length = low_length - width * low_slope / (high_slope - low_slope)
            length = float(np.clip(length, low_length + cut, high_length - cut))
            slope = self._compute_slope(step, length)
            if abs(slope) < small_slope:
                break
            if slope > 0.0:
                high_length = length
                high_slope = slope
            else:
                low_length = length
                low_slope = slope
        return length

    def _compute_slope(self, step: NewtonStep, length: float) -> float:
        """Compute the derivative of the energy in J by the length of a step."""
        state = self.equilibrium.state(step.q + length * step.direction)
        return float(self.equilibrium.residual(state) @ step.direction)

    def find_end(
        self, step: NewtonStep, state: State, iterations: Sequence[Iteration]
    ) -> Status | None:
        """End after a step below the tolerance; otherwise predict the stress of the next."""
        self._predicted_stress = self._predict_stress(step)
        if not step.size < self.tolerance:
            return None
        self.factors = factorise(self.equilibrium.tangent(state))
        return Status.CONVERGED

    def _predict_stress(self, step: NewtonStep) -> Array:
        """Compute the stress in Pa of the strain linearised in the step, (elements, points, 3)."""
        x = self.equilibrium.unknowns.expand(step.change)
        gradient = self.equilibrium.space.displacement_gradient(x)
        strain_change = compute_strain_rate(step.state.deformation_gradient, gradient)
        return self.equilibrium.membrane.resultant(step.state.strain + strain_change)


def continue_from_larger_loads(
    equilibrium: Equilibrium,
    tolerance: float,
    *,
    affordable_iterations: int,
    most_iterations: int = 300,
    passing_tolerance: float = 0.1,
    ratio: float = 8.0,
) -> NewtonResult:
    """Find the equilibrium under dead loads from equilibria under larger loads.

    Loads decrease from the first that makes strains as large as the film's excess, or that is large
    enough for Newton's method to converge from the deflection of a linear membrane.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations, with dead loads.
    tolerance : float
        Relative size of the last step in the energy norm.
    affordable_iterations, most_iterations : int
        Limits of the number of Newton iterations, of which the smaller holds. The last equilibrium
        may take all that remain.
    passing_tolerance : float, optional
        Relative size of the last step to an equilibrium under a larger load.
    ratio : float, optional
        Ratio of two successive loads. It becomes its root when the equilibrium under the second is
        not found. Strains change by its power 2/3.

    Returns
    -------
    NewtonResult
        The last result, with the iterations under all loads.
    """
    most = min(affordable_iterations, most_iterations)
    growth = ratio
    factor = _compute_taut_factor(equilibrium.scene)
    solved_factor = factor
    solved_q: Array | None = None
    iterations: list[Iteration] = []
    while True:
        is_last_load = factor == 1.0
        loaded = equilibrium.with_scaled_loads(factor)
        if is_last_load:
            options = WrinklingOptions(max_iterations=most - len(iterations))
            variant = PredictedStressNewton(loaded, tolerance, options=options)
        else:
            variant = PredictedStressNewton(loaded, passing_tolerance)
        initial_guess = compute_initial_guess(loaded) if solved_q is None else solved_q
        result = run_newton(variant, initial_guess)
        iterations.extend(result.iterations)
        has_converged = result.converged and is_last_load
        if has_converged or len(iterations) >= most:
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


def _compute_taut_factor(scene: Scene) -> float:
    """Compute the factor on the loads, at least 1, that makes their strain the film's excess."""
    strain = estimate_load_strain(scene)
    excess = compute_excess_strain(scene)
    if not 0.0 < strain < excess:
        return 1.0
    return float((excess / strain) ** 1.5)
