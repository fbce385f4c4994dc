"""Newton's method for a film that wrinkles, and continuation in the load where no start is near.

The energy of the tension field is convex, but its second derivative jumps where the film begins to
wrinkle, and against a small load the film is so stiff that stresses of trial strains mean little.
So the geometric stiffness takes the stress that the last step predicted, not that of the strain
(Magisano, Leonetti, Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 496-514). A slack film is
found from larger loads, which pull it taut: a film that is unloaded has stress, and so stiffness,
wherever the next equilibrium needs them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import strain_rate
from pvdf_fem.film.term import State
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solvers.newton import (
    Iteration,
    NewtonResult,
    Step,
    Tangent,
    Variant,
    balanced,
    factorise,
    newton,
)
from pvdf_fem.solvers.seed import deflected_film
from pvdf_fem.solvers.settled import ChargeWatch, Settled
from pvdf_fem.solvers.status import Status

#: Strain of the load over the film's excess below which a film that no solve balances is called
#: slack. Its tension runs in lines as wide as the root of that ratio times its radius.
BARELY_LOADED = 0.1
#: Factor between the loads of two equilibria of a continuation, until one is not found. Strains
#: change by its power 2/3.
LOAD_FACTOR = 8.0
#: Relative size of Newton's last step under a load that the continuation passes through.
PASSING = 0.1
#: Most and least Newton iterations of a continuation, whatever the budget.
ITERATIONS = (20, 300)


def load_strain(scene: Scene) -> float:
    """(F/(E h a))^(2/3), of the order of the strain that the load makes in a flat film."""
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    by_probes = sum(np.linalg.norm(touch.load.components) for touch in scene.loaded_probes)
    force = film.spread_force + by_probes
    return float(np.cbrt(force / (stiffness * film.radius)) ** 2)


def excess_strain(scene: Scene) -> float:
    """How much larger than its rim a film is, in the direction in which that is least."""
    return -float(scene.film.strain_at_rest[:2].max())


def barely_loaded(scene: Scene) -> bool:
    """Whether a film is much larger than its rim in all directions, against the load's strain."""
    return load_strain(scene) < BARELY_LOADED * excess_strain(scene)


@dataclass(frozen=True)
class WrinklingOptions:
    """When Newton's method for the exact law goes on and when it gives up."""

    #: Tension that holds slack film in a step, over the mean tension and the size of the last step.
    damping: float = 1e-2
    #: Factor on the damping after a step shorter than `stalled`, until a full step is made.
    stiffening: float = 4.0
    stalled: float = 0.05  #: Length of a step that stalls.
    #: A larger step leads nowhere under a load that follows the film, without a line search.
    largest_step: float = 3.0
    max_iterations: int = 25  #: Steps; twice as many where the charges have settled.
    #: late, quiet: From the late step on the iteration ends when the charges were settled that
    #: often in a row.
    late: int = 12
    quiet: int = 3
    #: Part of the slope of the energy at a step's start that may be left at its end.
    line_search_slope: float = 0.5
    line_search_trials: int = 6


class PredictedStress(Variant):
    """Newton's method for the exact law with predicted stresses, of a film that wrinkles.
    The last steps must leave the charges of `settled` as they are."""

    def __init__(
        self,
        equilibrium: Equilibrium,
        tolerance: float,
        settled: Settled | None,
        options: WrinklingOptions | None = None,
    ) -> None:
        super().__init__(equilibrium)
        self.options = WrinklingOptions() if options is None else options
        self.tolerance, self.settled = tolerance, settled
        self._predicted: Array | None = None
        self._watch: ChargeWatch | None = None
        self._allowed = equilibrium.model.imbalance
        self._size, self._stiffer, self._quiet = self.options.damping, 1.0, 0
        self.max_iterations = 2 * self.options.max_iterations

    def tangent(self, state: State, table: Sequence[Iteration]) -> tuple[Tangent, bool]:
        if self._watch is None:
            self._watch = ChargeWatch(self.settled, state)
        predicted = state.stress if self._predicted is None else self._predicted
        damping = self._stiffer * self.options.damping * min(self._size, 1.0)
        mixed = self.equilibrium.membrane.predicted(state, predicted, damping)
        return Tangent(factorise(self.equilibrium.tangent(mixed))), True

    def size(self, q: Array, state: State, slope: float) -> float:
        """Energy norm of a step over the smaller of the load's work and twice the energy."""
        work, energy = self.equilibrium.work(state, q), self.equilibrium.membrane.energy(state)
        scale = abs(min(work, 2.0 * energy))
        self._size = float(np.sqrt(abs(slope) / scale)) if scale > 0.0 else np.inf
        return self._size

    def length(self, step: Step) -> float:
        """Where along a step the energy, which is convex, stops falling; 1 if that is near."""
        if self.equilibrium.conservative:
            return self._line_search(step)
        return 1.0 if step.size < self.options.largest_step else 0.0

    def _line_search(self, step: Step) -> float:
        """Regula falsi for the slope of the energy along the step."""

        def slope_at(length: float) -> float:
            state = self.equilibrium.state(step.q + length * step.change)
            return float(self.equilibrium.residual(state) @ step.change)

        enough = self.options.line_search_slope * abs(step.slope)
        low, high = (0.0, step.slope), (1.0, slope_at(1.0))
        if not high[1] > enough:
            return 1.0
        for _ in range(self.options.line_search_trials):
            width = high[0] - low[0]
            length = low[0] - width * low[1] / (high[1] - low[1])
            length = float(np.clip(length, low[0] + 0.1 * width, high[0] - 0.1 * width))
            trial = length, slope_at(length)
            if abs(trial[1]) < enough:
                break
            low, high = (low, trial) if trial[1] > 0.0 else (trial, high)
        return length

    def ended(self, step: Step, state: State, table: Sequence[Iteration]) -> Status | None:
        """Converged when steps are small and the charges settled."""
        options, length = self.options, table[-1].length
        if length == 0.0 or not np.isfinite(step.size):
            return Status.MAX_ITERATIONS
        self._predict(step)
        self._stiffer = self._next_stiffer(length)
        assert self._watch is not None
        left = self._watch.left(state)
        self._quiet = self._quiet + 1 if self.settled and left <= 1.0 else 0
        small, steps = step.size < self.tolerance, len(table)
        late = steps > options.late and self._quiet >= options.quiet and step.size < self._allowed
        if late or (small and left <= 1.0):
            self.factors = factorise(self.equilibrium.tangent(state))
            undamped = small and self._stiffer == 1.0
            if undamped or balanced(self.equilibrium, state, self.factors, self._allowed):
                return Status.CONVERGED
        if steps >= options.max_iterations and self._quiet < options.quiet:
            return Status.MAX_ITERATIONS
        return None

    def _predict(self, step: Step) -> None:
        """The stress of the strain that the step would have in a linear film."""
        gradient = self.equilibrium.space.gradient(self.equilibrium.unknowns.expand(step.change))
        rate = strain_rate(step.state.deformation_gradient, gradient)
        self._predicted = self.equilibrium.membrane.resultant(step.state.strain + rate)

    def _next_stiffer(self, length: float) -> float:
        """Factor on the damping of the next step, after a step of this `length`."""
        if length < self.options.stalled:
            return self.options.stiffening * self._stiffer
        return max(self._stiffer / self.options.stiffening, 1.0) if length == 1.0 else self._stiffer


class Passing(PredictedStress):
    """Newton's method under a load that a continuation passes through: near is enough."""

    def __init__(self, equilibrium: Equilibrium) -> None:
        super().__init__(equilibrium, PASSING, None)
        self.max_iterations = self.options.max_iterations

    def ended(self, step: Step, state: State, table: Sequence[Iteration]) -> Status | None:
        """Near when a step is small."""
        self._predict(step)
        self._stiffer = self._next_stiffer(table[-1].length)
        return Status.CONVERGED if step.size < self.tolerance else None


def from_larger_loads(
    equilibrium: Equilibrium, tolerance: float, settled: Settled | None, max_iterations: int
) -> NewtonResult:
    """The equilibrium under a dead load, from equilibria under larger ones that come down to it.

    The first load makes strains as large as the film's excess, or is what Newton's method needs to
    converge from the linear membrane's deflection. The ratio of two loads is halved, in its
    logarithm, when the second is not found. The last equilibrium may take what iterations are left.
    """
    most = int(np.clip(max_iterations, *ITERATIONS))
    factor, ratio, q = _taut(equilibrium.scene), LOAD_FACTOR, None
    table: list[Iteration] = []
    while len(table) < most:
        loaded = equilibrium.under(factor)
        variant: PredictedStress = Passing(loaded)
        if factor == 1.0:
            options = WrinklingOptions(max_iterations=most - len(table))
            variant = PredictedStress(loaded, tolerance, settled, options)
        result = newton(variant, deflected_film(loaded) if q is None else q)
        table.extend(result.iterations)
        if result.converged and factor == 1.0:
            return replace(result, iterations=tuple(table))
        if result.converged:
            q, last = result.q, factor
        elif q is None:
            factor *= LOAD_FACTOR
            continue
        else:
            ratio = (last / factor) ** 0.5
        factor = max(last / ratio, 1.0)
    return NewtonResult(result.q, Status.MAX_ITERATIONS, tuple(table), None)


def _taut(scene: Scene) -> float:
    """Factor on a load, at least 1, by which its strain is as large as the film's excess."""
    strain, excess = load_strain(scene), excess_strain(scene)
    return float((excess / strain) ** 1.5) if 0.0 < strain < excess else 1.0
