"""All touches that some charges may come from, and what they say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import READINGS
from pvdf_fem.inverse.posterior import Posterior, profile_chi_square, sample_posterior
from pvdf_fem.inverse.touch.location_problem import (
    LocationProblem,
    compute_extents,
    get_base_quantity,
)
from pvdf_fem.inverse.touch.touch import DETERMINED_RATIO, Touch, TouchStatus, decide_status
from pvdf_fem.summary import Result, Summary, TextTable, format_with_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A second touch with at least this share of the likelihood makes a location ambiguous.
AMBIGUOUS_SHARE = 0.01


class Explanation(NamedTuple):
    """A mistake in readings without which a touch explains them."""

    text: str
    touch: Touch


@dataclass(frozen=True, eq=False, repr=False)
class Location(Result):
    """Candidate touches for measured charges; a touch is by a single probe or by two at once."""

    touches: tuple[Touch, ...]  #: The likeliest first; empty when no search ended.
    unknown: tuple[str, ...]  #: What was sought.
    #: Logarithm of the probability density of the charges, whatever the touch is, with all places,
    #: rotations and magnitudes of the force in the model's domain equally likely before.
    log_evidence: float
    problem: LocationProblem  #: The charges, and what explains them.
    #: Mistakes in readings that would explain them, where no touch does.
    explanations: tuple[Explanation, ...] = ()

    def summary(self) -> Summary:
        """Status, number of touches with remarks, a table per touch, and footnotes."""
        grids = [self._grid(number, touch) for number, touch in enumerate(self.touches, 1)]
        how = f"{len(self.touches)} {'touch' if len(self.touches) == 1 else 'touches'} listed"
        if self.status is TouchStatus.UNEXPLAINED:
            notes = ["the nearest touch does not fit the readings, so ± tells nothing of the truth"]
        else:
            notes = ["± : the true value is within, with a probability of 68 %"] if grids else []
        sentences = [f"{how}, from {READINGS[self.reading]}", *self.remarks]
        return Summary(self.status, sentences, tables=grids, notes=notes)

    def _grid(self, number: int, touch: Touch) -> TextTable:
        deviations, rows = self.compute_deviations(touch), []
        for name, value in touch.by_name.items():
            if name in deviations:
                error = deviations[name]
                finest = min(error, touch.deviations[name])
                rows.append((name, format_with_error(value, finest)[0], f"{error:.2g}"))
            else:
                rows.append((name, f"{value:.6g}", "known"))
        rows.append(("chi-square", f"{touch.chi_square:.3g}", ""))
        rows.append(("degrees of freedom", f"{self.degrees_of_freedom}", ""))
        rows.append(("share of likelihood", f"{touch.weight:.3g}", ""))
        return TextTable((f"touch {number}", "", "±"), tuple(rows))

    @property
    def status(self) -> TouchStatus:
        """Whether the best touch is the answer, and else why not."""
        if not self.problem.is_determinable:
            return TouchStatus.UNDETERMINED
        if not self.touches:
            return TouchStatus.NOT_FOUND
        return decide_status(self.best.explained, self.ambiguous, bool(self.best.at_edge))

    @property
    def degrees_of_freedom(self) -> int:
        """Charges less unknown quantities; negative with too few charges."""
        return self.problem.degrees_of_freedom

    @property
    def reading(self) -> str:
        """What the readings were taken for, of `READINGS`."""
        return self.problem.reading

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
        return sample_posterior(self.problem, self.touches)

    @property
    def deviations(self) -> dict[str, float]:
        """Calibrated errors of the best touch by unknown.

        As much as it is off, or less, with a probability of 68.3 %: one standard deviation if the
        errors are normal. All touches count, those on a ridge of the likelihood and about its
        other maxima, too. A model by full solves (not `is_fast`) gives `Touch.deviations` instead.
        """
        return self.compute_deviations(self.best)

    def compute_deviations(self, touch: Touch) -> dict[str, float]:
        """Calibrated errors of another touch: large where a touch elsewhere is likelier."""
        sizes = np.sqrt(np.diag(self.compute_covariance(touch))).tolist()
        return dict(zip(self.unknown, sizes, strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance (unknown, unknown) with squares of the calibrated errors on its diagonal."""
        return self.compute_covariance(self.best)

    def compute_covariance(self, touch: Touch) -> Array:
        """Covariance (unknown, unknown) about another touch."""
        if not self.problem.response.is_fast:
            return touch.covariance
        return self.posterior.compute_covariance(touch.values[self.problem.unknown])

    @cached_property
    def _rivals(self) -> list[set[str]]:
        """The unknowns in which each touch with a weight above the limit is farther from the best
        than the sum of both deviations; "rotation_deg" stands for the rotation of any probe."""
        rivals = [touch for touch in self.touches[1:] if touch.weight > AMBIGUOUS_SHARE]
        apart = [
            self.problem.compute_differences(touch.values, self.best.values) for touch in rivals
        ]
        both = [(touch.deviations, self.best.deviations) for touch in rivals]
        kinds = {name: get_base_quantity(name) for name in self.unknown}
        return [
            {
                kinds[name]
                for name, index in zip(self.unknown, self.problem.unknown, strict=True)
                if abs(difference[index]) > one[name] + other[name]
            }
            for difference, (one, other) in zip(apart, both, strict=True)
        ]

    @property
    def _determines_place(self) -> bool:
        """Whether the charges determine every unknown of the best touch but rotations: null
        directions move it by less than the share of the domain that counts as determined."""
        problem, touch = self.problem, self.best
        scale = problem.compute_touch_scale(touch.values[None])[0]
        widths = (compute_extents(problem.response) * scale)[problem.unknown]
        others = [get_base_quantity(name) != "rotation_deg" for name in self.unknown]
        shares = np.abs(touch.null_directions / widths)[:, others]
        return bool((shares < 1.0 / DETERMINED_RATIO).all())

    @property
    def alternatives(self) -> int:
        """Number of likely touches (weight above the limit) besides the best that have another
        place or force, by more than the deviations; touches that are only turned do not count."""
        return sum(bool(kinds - {"rotation_deg"}) for kinds in self._rivals)

    @property
    def ambiguous(self) -> bool:
        """Whether there are alternatives."""
        return self.alternatives > 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What keeps the best touch from being the answer, in sentences."""
        if not self.problem.is_determinable:
            count, names = len(self.problem.electrodes), ", ".join(self.unknown)
            few = f"{count} {'charge does' if count == 1 else 'charges do'} not tell {names}"
            return (f"undetermined: {few}; read more electrodes, or seek less",)
        if not self.touches:
            return (*self._mistakes(), "no search ended: the charges fit no touch of the domain")
        best, texts = self.best, [*self._mistakes()]
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
        if not self._determines_place:
            free = " and ".join(_direction(best.unknown, row) for row in best.null_directions)
            texts.append(f"undetermined: free along {free}")
        elif not best.determined or {"rotation_deg"} in self._rivals:
            rest = "" if self.ambiguous else "; place and force are"
            texts.append(f"rotation is not determined{rest}")
        if best.at_edge:
            limits = ", ".join(best.at_edge)
            texts.append(f"at the edge of the model's domain ({limits}): the touch may lie beyond")
        return tuple(texts)

    def _mistakes(self) -> Sequence[str]:
        """The mistakes in readings that would explain them."""
        return [
            f"wrong readings: if {text}, a touch at ({touch.x_mm:.4g}, {touch.y_mm:.4g}) mm with"
            f" {touch.force_N:.4g} N explains them"
            for text, touch in self.explanations
        ]

    def plot(self) -> Figure:
        """Draw the likelihood over the film and near the likeliest touch, with the ellipse of one
        standard deviation and the rivals. What else was sought is the likeliest at each place.
        Where each charge takes a solve, and of two touches at once, there are ellipses alone.
        Raises ValueError without a touch of which x and y were sought."""
        from pvdf_fem.view.touch_map import draw_likelihood_map, draw_touch_ellipses

        keys = [n for n in self.unknown if n.endswith("x_mm") and f"{n[:-4]}y_mm" in self.unknown]
        if not self.touches or not keys:
            raise ValueError("a map of the likelihood needs a touch of which x and y were sought")
        model, touches = self.problem.response, self.to_json()["touches"]
        if not model.is_fast:
            return draw_touch_ellipses(model.scene, model.domain.reach_mm, touches, keys)
        about = model.scene, model.domain.reach_mm, touches
        return draw_likelihood_map(*about, self._apart, self.remarks)

    def _apart(self, places_mm: Array) -> Array:
        """√(2 ln(L max/L)), (n,), of the likelihood L of places (n, 2)."""
        least = profile_chi_square(self.problem, self.best, places_mm)
        return np.sqrt(np.maximum(least - self.best.chi_square, 0.0))

    def to_json(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "status": str(self.status),
            "reading": self.reading,
            "explanations": [{"if": text, **touch.to_json()} for text, touch in self.explanations],
            "unknown": list(self.unknown),
            "degrees_of_freedom": self.degrees_of_freedom,
            "ambiguous": self.ambiguous,
            "remarks": list(self.remarks),
            "deviations": self.deviations if self.touches else {},
            "touches": [
                {
                    **touch.to_json(),
                    "standard_deviations": self.compute_deviations(touch),
                    "covariance": np.asarray(self.compute_covariance(touch)).tolist(),
                }
                for touch in self.touches
            ],
        }


def _direction(unknown: tuple[str, ...], row: Array) -> str:
    pairs = zip(unknown, row, strict=True)
    return f"({', '.join(f'{value:+.3g} {name}' for name, value in pairs if abs(value) > 1e-6)})"
