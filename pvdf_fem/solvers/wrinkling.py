"""Newton's method for a film that wrinkles: interior points from afar, the exact law near by.

The energy of the tension field is convex, but its second derivative jumps where the film begins to
wrinkle, and against a small load the film is so stiff that stresses of trial strains mean little.
So the geometric stiffness takes the stress that the last step predicted, not that of the strain
(Magisano, Leonetti, Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 496-514), and the start
comes from `pvdf_fem.solvers.interior_point` unless it is known to be near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import WrinklingMembrane, strain_rate
from pvdf_fem.film.term import State
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solvers.interior_point import interior_points
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
from pvdf_fem.solvers.settled import ChargeWatch, Settled
from pvdf_fem.solvers.status import Status

#: Strain of the load over the film's excess below which a film that no solve balances is called
#: slack. Its tension runs in lines as wide as the root of that ratio times its radius.
BARELY_LOADED = 0.1


def load_strain(scene: Scene) -> float:
    """(F/(E h a))^(2/3), of the order of the strain that the load makes in a flat film."""
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    force = sum(np.linalg.norm(touch.load.components) for touch in scene.loaded_probes)
    return float(np.cbrt(force / (stiffness * film.radius)) ** 2)


def barely_loaded(scene: Scene) -> bool:
    """Whether a film is much larger than its rim in all directions, against the load's strain."""
    excess = -scene.film.strain_at_rest[:2].max()
    return bool(load_strain(scene) < BARELY_LOADED * excess)


@dataclass(frozen=True)
class WrinklingOptions:
    """When Newton's method for the exact law goes on and when it gives up."""

    #: Tension that holds slack film in a step, over the mean tension and the size of the last step.
    damping: float = 1e-2
    #: Factor on the damping after a step shorter than `stalled`, until a full step is made.
    stiffening: float = 4.0
    stalled: float = 0.05  #: Length of a step that stalls.
    largest_step: float = 3.0  #: A larger step leads nowhere.
    #: middling_step, shortest_length: Nor does a step larger than the one that has to be shortened
    #: to the other.
    middling_step: float = 0.05
    shortest_length: float = 0.02
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
    `predicted` (elements, points, 3) is the stress to start with, by default that of the strain;
    the last steps must leave the charges of `settled` as they are."""

    def __init__(
        self,
        equilibrium: Equilibrium,
        tolerance: float,
        settled: Settled | None,
        predicted: Array | None = None,
        options: WrinklingOptions | None = None,
    ) -> None:
        super().__init__(equilibrium)
        self.options = WrinklingOptions() if options is None else options
        self.tolerance, self.settled, self._predicted = tolerance, settled, predicted
        self._watch: ChargeWatch | None = None
        self._allowed = equilibrium.model.imbalance
        self._size, self._stiffer, self._quiet = self.options.damping, 1.0, 0
        self.max_iterations = 2 * self.options.max_iterations

    @property
    def membrane(self) -> WrinklingMembrane:
        """The membrane term, with the tension field's law."""
        membrane = self.equilibrium.membrane
        assert isinstance(membrane, WrinklingMembrane)
        return membrane

    def tangent(self, state: State, table: Sequence[Iteration]) -> tuple[Tangent, bool]:
        if self._watch is None:
            self._watch = ChargeWatch(self.settled, state)
        predicted = state.stress if self._predicted is None else self._predicted
        damping = self._stiffer * self.options.damping * min(self._size, 1.0)
        mixed = self.membrane.predicted(state, predicted, damping)
        return Tangent(factorise(self.equilibrium.tangent(mixed))), True

    def size(self, q: Array, state: State, slope: float) -> float:
        """Energy norm of a step over the smaller of the load's work and twice the energy."""
        work, energy = self.equilibrium.work(state, q), self.membrane.energy(state)
        scale = abs(min(work, 2.0 * energy))
        self._size = float(np.sqrt(abs(slope) / scale)) if scale > 0.0 else np.inf
        return self._size

    def length(self, step: Step) -> float:
        """Where along a step the energy, which is convex, stops falling; 1 if that is near."""
        if not step.size < self.options.largest_step:
            return 0.0
        if not self.equilibrium.conservative:
            return 1.0
        return self._line_search(step)

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
        short = length < options.shortest_length and step.size > options.middling_step
        if not step.size < options.largest_step or short:
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
        gradient = self.equilibrium.space.gradient(self.equilibrium.step(step.state, step.change))
        rate = strain_rate(step.state.deformation_gradient, gradient)
        self._predicted = self.membrane.stress(step.state.strain + rate)

    def _next_stiffer(self, length: float) -> float:
        """The damping of the next step over the usual one, from that of a step of this length."""
        if length < self.options.stalled:
            return self.options.stiffening * self._stiffer
        return max(self._stiffer / self.options.stiffening, 1.0) if length == 1.0 else self._stiffer


@dataclass(frozen=True)
class InteriorPointOptions:
    """When interior points give way to Newton's method for the exact law."""

    #: Integral of S : P over the work below which Newton's method is tried.
    first_gap: float = 1e-6
    narrowing: float = 1e-2  #: It is tried again when the gap is smaller by this factor.
    last_gap: float = 1e-15  #: Smallest gap.
    max_iterations: int = 300
    least_iterations: int = 20  #: A budget of fewer interior points leads nowhere.


def from_afar(
    equilibrium: Equilibrium,
    q: Array,
    tolerance: float,
    settled: Settled | None,
    max_iterations: int,
    options: InteriorPointOptions | None = None,
) -> NewtonResult:
    """The equilibrium under a dead load from any start: interior points, then Newton's method."""
    options = InteriorPointOptions() if options is None else options
    most = min(max(max_iterations, options.least_iterations), options.max_iterations)
    table: list[Iteration] = []
    points, gap = interior_points(equilibrium, q), options.first_gap
    while len(table) < most and gap > options.narrowing * options.last_gap:
        point = next(points)
        table.append(Iteration(point.gap, point.length, True, True))
        if 0.0 < point.gap < gap:
            exact = newton(PredictedStress(equilibrium, tolerance, settled, point.stress), point.q)
            table.extend(exact.iterations)
            if exact.converged:
                return NewtonResult(exact.q, exact.status, tuple(table), exact.factors)
            gap = options.narrowing * point.gap
    return NewtonResult(q, Status.MAX_ITERATIONS, tuple(table), None)
