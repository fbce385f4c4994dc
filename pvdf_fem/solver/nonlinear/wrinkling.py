"""Newton's method for a film that wrinkles, and continuation in the load where no start is near.

The energy of the tension field is convex, but its second derivative jumps where the film begins to
wrinkle, and against a small load the film is so stiff that stresses of trial strains mean little.
The geometric stiffness therefore takes the stress predicted by the last step, not the strain's
stress (Magisano, Leonetti, Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 496-514). Larger
loads pull a slack film taut: an unloading film has stress and therefore stiffness wherever the next
equilibrium needs them.
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
from pvdf_fem.solver.nonlinear.initial_guess import compute_initial_guess
from pvdf_fem.solver.nonlinear.newton import (
    Iteration,
    NewtonResult,
    NewtonVariant,
    Step,
    Tangent,
    factorise,
    run_newton,
)
from pvdf_fem.solver.nonlinear.status import Status


def estimate_load_strain(scene: Scene) -> float:
    """(F/(E h a))^(2/3): magnitude of the load's strain in a flat film."""
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    by_probes = sum(np.linalg.norm(touch.load.components) for touch in scene.loaded_probes)
    force = film.distributed_force + by_probes
    return float(np.cbrt(force / (stiffness * film.radius)) ** 2)


def compute_excess_strain(scene: Scene) -> float:
    """Excess of a film over its rim, in the direction with least excess."""
    return -float(scene.film.prestrain[:2].max())


def is_barely_loaded(scene: Scene, part: float = 0.1) -> bool:
    """Whether the load's strain is below this `part` of the film's excess in every direction. The
    tension runs in lines; their width is the root of the ratio times the film's radius."""
    return estimate_load_strain(scene) < part * compute_excess_strain(scene)


@dataclass(frozen=True)
class WrinklingOptions:
    """When Newton's method for the exact law goes on and when it gives up."""

    #: Tension that holds slack film in a step, over the mean tension and the size of the last step.
    damping: float = 1e-2
    max_iterations: int = 25
    #: Largest remaining part of the energy's slope at a step's end.
    line_search_slope: float = 0.5
    line_search_trials: int = 6


class PredictedStressNewton(NewtonVariant):
    """Newton's method for the exact law with predicted stresses, of a film that wrinkles. It ends
    with a step below `tolerance` in the energy norm."""

    def __init__(
        self, equilibrium: Equilibrium, tolerance: float, options: WrinklingOptions | None = None
    ) -> None:
        super().__init__(equilibrium)
        self.options = WrinklingOptions() if options is None else options
        self.tolerance, self.max_iterations = tolerance, self.options.max_iterations
        self._predicted: Array | None = None
        self._size = self.options.damping

    def tangent(self, state: State, table: Sequence[Iteration]) -> tuple[Tangent, bool]:
        predicted = state.stress if self._predicted is None else self._predicted
        damping = self.options.damping * min(self._size, 1.0)
        mixed = self.equilibrium.membrane.predicted(state, predicted, damping)
        return Tangent(factorise(self.equilibrium.tangent(mixed))), True

    def size(self, q: Array, state: State, slope: float) -> float:
        """Energy norm of a step over the smaller of the load's work and twice the energy."""
        work, energy = self.equilibrium.work(state, q), self.equilibrium.membrane.energy(state)
        scale = abs(min(work, 2.0 * energy))
        self._size = float(np.sqrt(abs(slope) / scale)) if scale > 0.0 else np.inf
        return self._size

    def length(self, step: Step) -> float:
        """Where along a step the energy, which is convex, stops falling; 1 if that is near, or if
        there is no energy."""
        if not self.equilibrium.conservative:
            return 1.0

        def slope_at(length: float) -> float:
            state = self.equilibrium.state(step.q + length * step.change)
            return float(self.equilibrium.residual(state) @ step.change)

        enough = self.options.line_search_slope * abs(step.slope)
        low, high = (0.0, step.slope), (1.0, slope_at(1.0))
        if not high[1] > enough:
            return 1.0
        for _ in range(self.options.line_search_trials):  # regula falsi
            width = high[0] - low[0]
            length = low[0] - width * low[1] / (high[1] - low[1])
            length = float(np.clip(length, low[0] + 0.1 * width, high[0] - 0.1 * width))
            trial = length, slope_at(length)
            if abs(trial[1]) < enough:
                break
            low, high = (low, trial) if trial[1] > 0.0 else (trial, high)
        return length

    def ended(self, step: Step, state: State, table: Sequence[Iteration]) -> Status | None:
        self._predict(step)
        if not step.size < self.tolerance:
            return None
        self.factors = factorise(self.equilibrium.tangent(state))
        return Status.CONVERGED

    def _predict(self, step: Step) -> None:
        """The stress of the strain that the step would have in a linear film."""
        gradient = self.equilibrium.space.gradient(self.equilibrium.unknowns.expand(step.change))
        rate = compute_strain_rate(step.state.deformation_gradient, gradient)
        self._predicted = self.equilibrium.membrane.resultant(step.state.strain + rate)


def continue_from_larger_loads(
    equilibrium: Equilibrium,
    tolerance: float,
    affordable_iterations: int,
    *,
    most_iterations: int = 300,
    passing: float = 0.1,
    ratio: float = 8.0,
) -> NewtonResult:
    """The equilibrium under a dead load, from equilibria under larger loads in descending order.

    The first load makes strains as large as the film's excess, or is what Newton's method needs to
    converge from the linear membrane's deflection. Strains change by the power 2/3 of the `ratio`
    of two loads, which is halved, in its logarithm, when the second is not found. Equilibria on the
    way meet the tolerance `passing`; the last equilibrium may take the remaining iterations.
    """
    factor, q, growth = _taut(equilibrium.scene), None, ratio
    most = min(affordable_iterations, most_iterations)
    table: list[Iteration] = []
    while True:
        loaded, left = equilibrium.with_scaled_loads(factor), most - len(table)
        variant = PredictedStressNewton(loaded, passing)
        if factor == 1.0:
            variant = PredictedStressNewton(
                loaded, tolerance, WrinklingOptions(max_iterations=left)
            )
        result = run_newton(variant, compute_initial_guess(loaded) if q is None else q)
        table.extend(result.iterations)
        if (result.converged and factor == 1.0) or len(table) >= most:
            break
        if result.converged:
            q, last = result.q, factor
        elif q is None:
            factor *= growth
            continue
        else:
            ratio = (last / factor) ** 0.5
        factor = max(last / ratio, 1.0)
    done = result.converged and factor == 1.0
    status = Status.CONVERGED if done else Status.MAX_ITERATIONS
    return replace(result, status=status, iterations=tuple(table))


def _taut(scene: Scene) -> float:
    """Factor on a load, at least 1, that makes its strain equal to the film's excess."""
    strain, excess = estimate_load_strain(scene), compute_excess_strain(scene)
    return float((excess / strain) ** 1.5) if 0.0 < strain < excess else 1.0
