"""All touches that some charges may come from, and what they say together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pvdf_fem.arrays import Array
from pvdf_fem.readout.channel import READINGS
from pvdf_fem.touch.posterior import Posterior, posterior
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.touch import Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A second touch with at least this share of the likelihood makes a location ambiguous.
SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Location:
    """All touches that may have given some charges."""

    touches: tuple[Touch, ...]  #: The likeliest first; empty when no search ended.
    unknown: tuple[str, ...]  #: What was sought.
    degrees_of_freedom: int  #: Charges less unknown quantities; negative with too few charges.
    #: Logarithm of the probability density of the charges, whatever the touch is, with all places,
    #: rotations and magnitudes of the force in the model's domain equally likely before.
    log_evidence: float
    problem: Problem  #: The charges, and what explains them.
    reading: str = "total"  #: What the readings were taken for, of `READINGS`.
    #: The likeliest touch if they are the other, or in another unit, where only that explains them,
    #: and in words what they are then.
    other_reading: Touch | None = None
    other_words: str = ""

    def __repr__(self) -> str:
        values = [f"{n} = {getattr(self.best, n):.4g}" for n in self.unknown if self.touches]
        listed = f"touches listed: {len(self.touches)}"
        return f"<Location: {'; '.join([', '.join(values), listed, *self.remarks])}>"

    @property
    def explained(self) -> bool:
        """Whether a touch of the model's domain gives such charges."""
        return bool(self.touches) and self.best.explained

    @property
    def best(self) -> Touch:
        """The likeliest touch."""
        return self.touches[0]

    @cached_property
    def posterior(self) -> Posterior:
        """The probability of touches near those listed; a few milliseconds the first time."""
        return posterior(self.problem, self.touches)

    @property
    def deviations(self) -> dict[str, float]:
        """Calibrated errors of the best touch by unknown.

        As much as it is off, or less, with a probability of 68.3 %: one standard deviation if the
        errors are normal. All touches count, those on a ridge of the likelihood and about its
        other maxima, too.
        """
        return self.deviations_of(self.best)

    def deviations_of(self, touch: Touch) -> dict[str, float]:
        """The same of another touch: large where another one is likelier."""
        sizes = self.posterior.deviations(self._sought(touch)).tolist()
        return dict(zip(self.unknown, sizes, strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance (unknown, unknown) with the squares of these on its diagonal."""
        return self.posterior.covariance(self._sought(self.best))

    def _sought(self, touch: Touch) -> Array:
        return touch.values[self.problem.unknown]

    @property
    def alternatives(self) -> int:
        """Number of other touches that are likely as well."""
        return sum(touch.weight > SHARE for touch in self.touches[1:])

    @property
    def ambiguous(self) -> bool:
        """Whether there are any."""
        return self.alternatives > 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What keeps the best touch from being the answer, in sentences."""
        texts = []
        if touch := self.other_reading:
            texts.append(
                f"wrong reading: as {READINGS[self.reading]} no touch explains what was given; "
                f"{self.other_words} one does, at ({touch.x_mm:.4g}, {touch.y_mm:.4g}) mm, "
                f"{touch.force_N:.4g} N"
            )
        if not self.touches:
            return (*texts, "no search ended: the charges fit no touch of the model's domain")
        best = self.best
        if not best.explained:
            often = f"chi-square {best.chi_square:.3g}"
            if self.degrees_of_freedom > 0:
                often = (
                    f"a touch gives such charges once in {1 / max(best.p_value, 1e-99):.0e} cases "
                    f"({often} with {self.degrees_of_freedom} degrees of freedom)"
                )
            texts.append(f"unexplained: no touch of the model's domain fits; {often}")
        if self.ambiguous:
            texts.append(f"ambiguous: {1 + self.alternatives} touches are likely")
        if not best.determined:
            few = self.degrees_of_freedom < 0
            short = "fewer charges than unknown quantities; " if few else ""
            free = " and ".join(_direction(best.unknown, row) for row in best.null_directions)
            texts.append(f"undetermined: {short}free along {free}")
        if best.at_edge:
            limits = ", ".join(best.at_edge)
            texts.append(f"at the edge of the model's domain ({limits}): the touch may lie beyond")
        return tuple(texts)

    def plot(self) -> Figure:
        """Draw the likelihood over the film and near the likeliest touch, with the ellipse of one
        standard deviation and the rivals. What else was sought is the likeliest at each place.
        Raises ValueError without a touch of which x and y were sought."""
        from pvdf_fem.output.touch_map import likelihood_map  # output/ is above

        return likelihood_map(self)

    def to_json(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "reading": self.reading,
            "other_reading": self.other_reading and self.other_reading.to_json(),
            "unknown": list(self.unknown),
            "degrees_of_freedom": self.degrees_of_freedom,
            "ambiguous": self.ambiguous,
            "remarks": list(self.remarks),
            "deviations": self.deviations if self.touches else {},
            "touches": [
                {
                    **touch.to_json(),
                    "standard_deviations": self.deviations_of(touch),
                    "covariance": self.posterior.covariance(self._sought(touch)).tolist(),
                }
                for touch in self.touches
            ],
        }


def _direction(unknown: tuple[str, ...], row: Array) -> str:
    pairs = zip(unknown, row, strict=True)
    return f"({', '.join(f'{value:+.3g} {name}' for name, value in pairs if abs(value) > 1e-6)})"
