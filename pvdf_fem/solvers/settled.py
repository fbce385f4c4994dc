"""Whether an iteration has settled the charges, for which it is made.

Newton's last step is small in the energy of the whole film. A film that wrinkles may carry nearly
all of its load the short way between a probe and the rim, and what is left of it for an electrode
far away is nothing against that energy. Where its state changes from point to point steps shrink
but linearly, so what all further ones would add is reckoned from the last two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.charges.forces import Goal, charge_sizes, charges_of, goal_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Array, MembraneState

# Of the tolerance of the charges, and of their corrections where they are corrected.
OF_TOLERANCE, OF_CORRECTION = 0.1, 0.2
# Of a step, what the next one is of it: at the most, and where only one is known.
SLOWEST = 0.8


@dataclass(frozen=True, eq=False)
class Settled:
    """What the steps of an equilibrium's iteration change of the charges.

    Attributes
    ----------
    goals : sequence of Goal
    equilibrium : Equilibrium
    start : (unknowns,), optional
        What the iteration corrects, if it is a solution already.
    """

    goals: Sequence[Goal]
    equilibrium: Equilibrium
    start: Array | None = None

    def change(self, before: MembraneState, after: MembraneState) -> float:
        """Largest change of a charge between two states, over that which may be left in the end."""
        tolerance, new = self.equilibrium.scene.numerics.tolerance, self._forces(after.dofs)
        weights = self.equilibrium.membrane.weights
        allowed = OF_TOLERANCE * tolerance * charge_sizes(self.goals, after, new, weights)
        if self.start is not None:
            old = self._forces(self.equilibrium.unknowns.expand(self.start))
            correction = np.abs(charges_of(self.goals, new - old))
            allowed = np.maximum(allowed, OF_CORRECTION * correction)
        change = np.abs(charges_of(self.goals, new - self._forces(before.dofs)))
        return float(np.max(change / allowed, initial=0.0))

    def _forces(self, x: Array) -> Array:
        return goal_forces(self.goals, self.equilibrium.membrane, x, self.equilibrium.part)


class Watch:
    """The charges' changes along an iteration from the state `before`, if they matter."""

    def __init__(self, settled: Settled | None, before: MembraneState) -> None:
        self._settled, self._before, self._last = settled, before, 0.0

    def left(self, now: MembraneState) -> float:
        """What all further steps would change, if they shrink as the last two did."""
        if self._settled is None:
            return 0.0
        change = self._settled.change(self._before, now)
        rate = min(change / self._last, SLOWEST) if self._last > 0.0 else SLOWEST
        self._before, self._last = now, change
        return change * rate / (1.0 - rate)
