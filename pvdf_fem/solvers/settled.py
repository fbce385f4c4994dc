"""Whether an iteration has settled the charges, for which it is made.

Newton's last step is small in the energy of the whole film. A film that wrinkles may carry nearly
all of its load the short way between a probe and the rim, and the little that reaches a far
electrode does not count in that energy. Where its state changes from point to point, steps shrink
only linearly, so the change by all further steps is extrapolated from the last two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import charge_sizes, charges_of, goal_forces
from pvdf_fem.charges.goals import Goal
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.term import State

OF_TOLERANCE = 0.1  #: Change of a charge that may be left, over its tolerance.
OF_CORRECTION = 0.2  #: The same over the charge's correction, where a solution is corrected.
#: A step is taken to be at most this part of the one before, and this part where only one is known.
SLOWEST = 0.8


@dataclass(frozen=True, eq=False)
class Settled:
    """The change of the charges by the steps of an equilibrium's iteration."""

    goals: Sequence[Goal]
    equilibrium: Equilibrium
    #: The solution that the iteration corrects, if it does, (unknowns,).
    start: Array | None = None

    def change(self, before: State, after: State) -> float:
        """Largest change of a charge between two states, over the change that may be left."""
        tolerance, new = self.equilibrium.scene.numerics.tolerance, self._forces(after.dofs)
        space = self.equilibrium.space
        allowed = OF_TOLERANCE * tolerance * charge_sizes(self.goals, after, new, space)
        if self.start is not None:
            old = self._forces(self.equilibrium.dofs(self.start))
            correction = np.abs(charges_of(self.goals, new - old))
            allowed = np.maximum(allowed, OF_CORRECTION * correction)
        change = np.abs(charges_of(self.goals, new - self._forces(before.dofs)))
        return float(np.max(change / allowed, initial=0.0))

    def _forces(self, x: Array) -> Array:
        return goal_forces(self.goals, self.equilibrium.membrane, x, self.equilibrium.part)


class ChargeWatch:
    """The charges' changes along an iteration from the state `before`; none without charges."""

    def __init__(self, settled: Settled | None, before: State) -> None:
        self._settled, self._before, self._last = settled, before, 0.0

    def left(self, now: State) -> float:
        """Change by all further steps, over that allowed, if they shrink as the last two did."""
        if self._settled is None:
            return 0.0
        change = self._settled.change(self._before, now)
        rate = min(change / self._last, SLOWEST) if self._last > 0.0 else SLOWEST
        self._before, self._last = now, change
        return change * rate / (1.0 - rate)
