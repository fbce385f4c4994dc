"""All touches that are consistent with measured charges: the result of `locate`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import READINGS
from pvdf_fem.inverse.clipping import CLIPPED_ADVICE
from pvdf_fem.inverse.coordinates import compute_extents, get_base_quantity
from pvdf_fem.inverse.posterior import Posterior, profile_chi_square, sample_posterior
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.touch import DETERMINED_RATIO, Touch, TouchStatus, decide_status
from pvdf_fem.summary import Result, Summary, TextTable, format_with_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A second touch whose weight exceeds this makes a location ambiguous.
MIN_ALTERNATIVE_WEIGHT = 0.01


class Explanation(NamedTuple):
    """A mistake in readings whose correction lets a touch explain them."""

    text: str  #: The mistake in words.
    touch: Touch  #: The best touch for the corrected readings.


@dataclass(frozen=True, eq=False, repr=False)
class Location(Result):
    """All likely touches for measured charges; each is a touch of one probe or of two."""

    #: The touches, with the lowest chi-square first; without degrees of freedom those that explain
    #: the charges first, and then by weight. Empty if no search converged.
    touches: tuple[Touch, ...]
    unknown: tuple[str, ...]  #: Names of the free quantities.
    #: Logarithm of the evidence: the probability density of the charges, averaged over all touches
    #: with a prior as wide as the response's domain.
    log_evidence: float
    problem: LocationProblem  #: The measured charges and the response.
    #: Mistakes in the readings whose correction lets a touch explain them. Empty if a touch
    #: explains the readings as they are, and if the response solves scenes.
    explanations: tuple[Explanation, ...] = ()

    # ---- status

    @property
    def status(self) -> TouchStatus:
        """`TouchStatus.LOCATED`, or the reason why the best touch may not be the true one."""
        if not self.problem.is_determinable:
            return TouchStatus.CLIPPED if self.clipped else TouchStatus.UNDETERMINED
        if not self.touches:
            return TouchStatus.NOT_FOUND
        return decide_status(self.best.explained, self.ambiguous, bool(self.best.at_edge))

    @property
    def best(self) -> Touch:
        """The most likely touch, the first of `touches`; `IndexError` if there is none."""
        return self.touches[0]

    @property
    def explained(self) -> bool:
        """Whether the best touch explains the charges; false if there is none."""
        return bool(self.touches) and self.best.explained

    @property
    def degrees_of_freedom(self) -> int:
        """Number of charges that are values minus number of unknowns; may be negative."""
        return int(self.problem.degrees_of_freedom[0])

    @property
    def reading(self) -> str:
        """Meaning of the readings, a key of `READINGS`."""
        return self.problem.reading

    @property
    def clipped(self) -> tuple[str, ...]:
        """Names of the electrodes whose readings are clipped: limits instead of values."""
        (indices,) = np.nonzero(self.problem.is_clipped[0])
        names = self.problem.response.names
        return tuple(names[electrode] for electrode in self.problem.electrodes[indices])

    # ---- uncertainty

    @cached_property
    def posterior(self) -> Posterior:
        """Posterior distribution of the touch, sampled at the first access, then cached."""
        return sample_posterior(self.problem, self.touches)

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the best touch by the name of the unknown.

        See `compute_deviations`.
        """
        return self.compute_deviations(self.best)

    def compute_deviations(self, touch: Touch) -> dict[str, float]:
        """Compute standard deviations of one of the touches from the posterior distribution.

        The true value is within the standard deviation of the touch's value with a probability of
        68.3 %. Noise of the readings and errors of the response are included, as are ridges and
        other maxima of the likelihood: the standard deviations are large if the true touch is more
        probably near another one of `touches`.

        Parameters
        ----------
        touch : Touch
            One of `touches`.

        Returns
        -------
        dict of str to float
            Standard deviations by the name of the unknown: `Touch.deviations`, for this touch
            alone, if the response solves scenes.
        """
        deviations = np.sqrt(np.diag(self.compute_covariance(touch)))
        return dict(zip(self.unknown, deviations.tolist(), strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance of the unknowns about the best touch; shape (unknown, unknown).

        The diagonal has the squares of `deviations`. See `compute_covariance`.
        """
        return self.compute_covariance(self.best)

    def compute_covariance(self, touch: Touch) -> Array:
        """Compute the covariance of the unknowns about one of the touches.

        The variances are the squared standard deviations of `compute_deviations`, and the
        correlations are those of the posterior distribution about the touch.

        Parameters
        ----------
        touch : Touch
            One of `touches`.

        Returns
        -------
        ndarray, shape (unknown, unknown)
            Covariance in the units of the unknowns: `Touch.covariance`, for this touch alone, if
            the response solves scenes, since sampling the posterior would take too long.
        """
        if not self.problem.response.is_fast:
            return touch.covariance
        return self.posterior.compute_covariance(touch.values[self.problem.unknown])

    # ---- ambiguity

    @property
    def alternatives(self) -> int:
        """Number of further likely touches at another position or with another force.

        A touch is likely if its weight exceeds `MIN_ALTERNATIVE_WEIGHT`. It counts if an unknown
        other than a rotation differs from that of the best touch by more than the sum of the
        `Touch.deviations` of both.
        """
        count = 0
        for quantities in self._unknowns_distinguishing_alternatives:
            if quantities - {"rotation_deg"}:
                count += 1
        return count

    @property
    def ambiguous(self) -> bool:
        """Whether there are any `alternatives`."""
        return self.alternatives > 0

    @cached_property
    def _unknowns_distinguishing_alternatives(self) -> list[set[str]]:
        """Unknowns in which each further likely touch differs from the best one.

        There is a set for each of these touches, with the names of the quantities without indices.
        """
        likely = [touch for touch in self.touches[1:] if touch.weight > MIN_ALTERNATIVE_WEIGHT]
        if not likely:
            return []
        columns = self.problem.unknown.tolist()
        best_deviations = self.best.deviations
        found = []
        for touch in likely:
            differences = self.problem.compute_differences(touch.values, self.best.values)
            deviations = touch.deviations
            quantities = set()
            for name, column in zip(self.unknown, columns, strict=True):
                if abs(differences[column]) > deviations[name] + best_deviations[name]:
                    quantities.add(get_base_quantity(name))
            found.append(quantities)
        return found

    @property
    def _determines_position_and_force(self) -> bool:
        """Whether the charges determine every unknown of the best touch except for rotations.

        An unknown is determined if one standard deviation along each of `Touch.null_directions`
        changes it by less than the extent of the domain divided by `DETERMINED_RATIO`.
        """
        problem = self.problem
        scale = problem.compute_touch_scale(self.best.values[None])[0]
        widths = (compute_extents(problem.response) * scale)[problem.unknown]
        is_counted = [get_base_quantity(name) != "rotation_deg" for name in self.unknown]
        fractions = np.abs(self.best.null_directions / widths)[:, is_counted]
        return bool((fractions < 1.0 / DETERMINED_RATIO).all())

    # ---- text, figure and JSON

    @property
    def notes(self) -> tuple[str, ...]:
        """Reasons why the best touch may not be the true one, in words; empty if there are none."""
        clipped = f"clipped: {', '.join(self.clipped)}"
        if not self.problem.is_determinable:
            count = int(self.problem.value_counts[0])
            charges = f"{count} {'charge does' if count == 1 else 'charges do'}"
            reason = f"{charges} not determine {', '.join(self.unknown)}"
            if self.clipped:
                return (f"{clipped}; the other {reason}; {CLIPPED_ADVICE}",)
            return (f"undetermined: {reason}; use more electrodes, or fix more quantities",)
        notes = self._format_explanations()
        if self.clipped:
            notes.append(f"{clipped}: the readings are limits, not values; {CLIPPED_ADVICE}")
        if not self.touches:
            return (*notes, "no search converged: the charges fit no touch of the domain")
        best = self.best
        if not best.explained:
            notes.append(
                f"unexplained: no touch of the response's domain fits; {self._goodness_of_fit}"
            )
        if self.ambiguous:
            notes.append(f"ambiguous: {1 + self.alternatives} touches are likely")
        if not self._determines_position_and_force:
            directions = [_format_direction(self.unknown, row) for row in best.null_directions]
            notes.append(f"undetermined: free along {' and '.join(directions)}")
        elif not best.determined or {"rotation_deg"} in self._unknowns_distinguishing_alternatives:
            others = "" if self.ambiguous else "; position and force are"
            notes.append(f"rotation is not determined{others}")
        if best.at_edge:
            limits = ", ".join(best.at_edge)
            reason = "the touch may lie beyond"
            notes.append(f"at the edge of the response's domain ({limits}): {reason}")
        return tuple(notes)

    def _format_explanations(self) -> list[str]:
        """Format a note on each of `explanations`, with the touch for the corrected readings."""
        sentences = []
        for text, touch in self.explanations:
            position = f"({touch.x_mm:.4g}, {touch.y_mm:.4g}) mm"
            explanation = f"a touch at {position} with {touch.force_N:.4g} N explains them"
            sentences.append(f"wrong readings: if {text}, {explanation}")
        return sentences

    @property
    def _goodness_of_fit(self) -> str:
        """Chi-square of the best touch in words, with the rarity of a value at least as large.

        The rarity is left out without degrees of freedom.
        """
        chi_square = f"chi-square {self.best.chi_square:.3g}"
        if self.degrees_of_freedom <= 0:
            return chi_square
        cases = 1 / max(self.best.p_value, 1e-99)
        freedom = f"{self.degrees_of_freedom} degrees of freedom"
        return f"a touch gives such charges once in {cases:.0e} cases ({chi_square} with {freedom})"

    def summary(self) -> Summary:
        """Summarize status and remarks, with a table for each touch and a note on ±."""
        tables = []
        for number, touch in enumerate(self.touches, start=1):
            tables.append(self._make_table(number, touch))
        notes = []
        if self.status is TouchStatus.UNEXPLAINED:
            notes.append("the best touch does not fit the readings, so the ± are meaningless")
        elif tables:
            notes.append("±: the true value is within this of the value with a probability of 68 %")
        count = len(self.touches)
        listed = f"{count} {'touch' if count == 1 else 'touches'} listed"
        sentences = [f"{listed}, from {READINGS[self.reading]}", *self.notes]
        return Summary(self.status, sentences, tables=tables, notes=notes)

    def _make_table(self, number: int, touch: Touch) -> TextTable:
        """Make the table of quantities, standard deviations and fit of a touch for `summary`."""
        deviations = self.compute_deviations(touch)
        rows = []
        for name, value in touch.by_name.items():
            if name not in deviations:
                rows.append((name, f"{value:.6g}", "known"))
                continue
            deviation = deviations[name]
            # Another likely touch may increase the deviation, but the value keeps its digits.
            finest = min(deviation, touch.deviations[name])
            text, _ = format_with_error(value, finest)
            rows.append((name, text, f"{deviation:.2g}"))
        rows.append(("chi-square", f"{touch.chi_square:.3g}", ""))
        rows.append(("degrees of freedom", f"{self.degrees_of_freedom}", ""))
        rows.append(("probability", f"{touch.weight:.3g}", ""))
        return TextTable((f"touch {number}", "", "±"), tuple(rows))

    def plot(self) -> Figure:
        """Draw the likelihood of positions, on the whole film and near the most likely touch.

        Returns
        -------
        matplotlib.figure.Figure
            The likelihood at each position for the most likely force and rotation there, with the
            ellipse of one standard deviation and the other touches. If the response solves scenes,
            the figure has ellipses but no likelihood.

        Raises
        ------
        ValueError
            If there is no touch, or if x and y were not both unknown.
        """
        from pvdf_fem.view.touch_map import draw_likelihood_map, draw_touch_ellipses

        x_keys = []
        for name in self.unknown:
            if name.endswith("x_mm") and f"{name.removesuffix('x_mm')}y_mm" in self.unknown:
                x_keys.append(name)
        if not self.touches or not x_keys:
            reason = "plot: needs a touch with unknown x_mm and y_mm"
            raise ValueError(f"{reason}; locate one without fixing its position")
        response = self.problem.response
        reach_mm = response.domain.reach_mm
        touches = self.to_json()["touches"]
        if not response.is_fast:
            return draw_touch_ellipses(response.scene, reach_mm, touches, x_keys)
        return draw_likelihood_map(
            response.scene, reach_mm, touches, self._compute_distances, self.notes
        )

    def _compute_distances(self, positions_mm: Array) -> Array:
        """Compute the distance of positions from the most likely touch in standard deviations.

        Parameters
        ----------
        positions_mm : ndarray, shape (n, 2)
            Positions in the frame of the scene's stage.

        Returns
        -------
        ndarray, shape (n,)
            √(2 ln(max L / L)). The profile likelihood L of a position is the maximum over force and
            rotation there.
        """
        excess = profile_chi_square(self.problem, self.best, positions_mm) - self.best.chi_square
        return np.sqrt(np.maximum(excess, 0.0))

    def to_json(self) -> dict[str, Any]:
        """Return status, notes and touches as plain values for JSON.

        ``deviations`` are those of the best touch, empty if there is none.
        """
        touches = []
        for touch in self.touches:
            uncertainty = {
                "standard_deviations": self.compute_deviations(touch),
                "covariance": np.asarray(self.compute_covariance(touch)).tolist(),
            }
            touches.append({**touch.to_json(), **uncertainty})
        return {
            "status": str(self.status),
            "reading": self.reading,
            "explanations": [{"if": text, **touch.to_json()} for text, touch in self.explanations],
            "unknown": list(self.unknown),
            "degrees_of_freedom": self.degrees_of_freedom,
            "ambiguous": self.ambiguous,
            "clipped": list(self.clipped),
            "remarks": list(self.notes),
            "deviations": self.deviations if self.touches else {},
            "touches": touches,
        }


def _format_direction(unknown: tuple[str, ...], direction: Array) -> str:
    """Format a direction in the space of the unknowns, without components that are nearly zero.

    Parameters
    ----------
    unknown : tuple of str
        Names of the unknowns.
    direction : ndarray, shape (unknown,)
        Components of the direction.
    """
    components = []
    for name, value in zip(unknown, direction, strict=True):
        if abs(value) > 1e-6:
            components.append(f"{value:+.3g} {name}")
    return f"({', '.join(components)})"
