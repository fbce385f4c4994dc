"""All touches that may have given some charges, with uncertainties, a status and remarks."""

from __future__ import annotations

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

    text: str  #: The mistake in words.
    touch: Touch  #: The touch without the mistake.


@dataclass(frozen=True, eq=False, repr=False)
class Location(Result):
    """Candidate touches for measured charges; each is of one probe or of two at once."""

    touches: tuple[Touch, ...]  #: The most likely one first; empty when no search converged.
    unknown: tuple[str, ...]  #: Quantities that were free.
    #: Logarithm of the probability density of the charges for any touch, if all places, rotations
    #: and logarithms of the force in the response's domain were equally likely before.
    log_evidence: float
    problem: LocationProblem  #: The charges and the response.
    #: Mistakes in the readings without which a touch explains them, where no touch does.
    explanations: tuple[Explanation, ...] = ()

    # ---- status

    @property
    def status(self) -> TouchStatus:
        """Whether the best touch is the answer, and if not, why."""
        if not self.problem.is_determinable:
            return TouchStatus.UNDETERMINED
        if not self.touches:
            return TouchStatus.NOT_FOUND
        return decide_status(self.best.explained, self.ambiguous, bool(self.best.at_edge))

    @property
    def best(self) -> Touch:
        """The most likely touch."""
        return self.touches[0]

    @property
    def explained(self) -> bool:
        """Whether a touch in the response's domain explains the charges."""
        return bool(self.touches) and self.best.explained

    @property
    def degrees_of_freedom(self) -> int:
        """Charges less unknown quantities; negative with too few charges."""
        return self.problem.degrees_of_freedom

    @property
    def reading(self) -> str:
        """Meaning of the readings, of `READINGS`."""
        return self.problem.reading

    # ---- uncertainty

    @cached_property
    def posterior(self) -> Posterior:
        """Posterior distribution of the touch; takes a few milliseconds the first time."""
        return sample_posterior(self.problem, self.touches)

    @property
    def deviations(self) -> dict[str, float]:
        """Calibrated errors of the best touch by unknown.

        The touch is off by this or less with a probability of 68.3 %, which is one standard
        deviation if errors are normal. All touches count, also those on a ridge of the likelihood
        and about its other maxima. Full solves give `Touch.deviations` instead.
        """
        return self.compute_deviations(self.best)

    def compute_deviations(self, touch: Touch) -> dict[str, float]:
        """Compute calibrated errors of one of the touches, by unknown.

        They are large where a touch elsewhere is more likely.
        """
        deviations = np.sqrt(np.diag(self.compute_covariance(touch)))
        return dict(zip(self.unknown, deviations.tolist(), strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance (unknown, unknown) with squares of the calibrated errors on its diagonal."""
        return self.compute_covariance(self.best)

    def compute_covariance(self, touch: Touch) -> Array:
        """Compute the covariance (unknown, unknown) about one of the touches."""
        if not self.problem.response.is_fast:
            return touch.covariance
        return self.posterior.compute_covariance(touch.values[self.problem.unknown])

    # ---- ambiguity

    @property
    def alternatives(self) -> int:
        """Number of likely touches besides the best one that have another place or force.

        A likely touch has a weight above `AMBIGUOUS_SHARE`. It differs from the best one by more
        than the sum of both deviations. A touch with another rotation alone does not count.
        """
        return sum(1 for quantities in self._rival_differences if quantities - {"rotation_deg"})

    @property
    def ambiguous(self) -> bool:
        """Whether there are alternatives."""
        return self.alternatives > 0

    @cached_property
    def _rival_differences(self) -> list[set[str]]:
        """Base names of the unknowns in which each likely touch differs from the best one."""
        rivals = [touch for touch in self.touches[1:] if touch.weight > AMBIGUOUS_SHARE]
        if not rivals:
            return []
        columns = self.problem.unknown.tolist()
        best_deviations = self.best.deviations
        found = []
        for rival in rivals:
            differences = self.problem.compute_differences(rival.values, self.best.values)
            deviations = rival.deviations
            quantities = set()
            for name, column in zip(self.unknown, columns, strict=True):
                if abs(differences[column]) > deviations[name] + best_deviations[name]:
                    quantities.add(get_base_quantity(name))
            found.append(quantities)
        return found

    @property
    def _determines_place_and_force(self) -> bool:
        """Whether the charges determine every unknown of the best touch except rotations.

        They do if null directions move such an unknown by less than the share of the domain that
        counts as determined.
        """
        problem = self.problem
        scale = problem.compute_touch_scale(self.best.values[None])[0]
        widths = (compute_extents(problem.response) * scale)[problem.unknown]
        is_counted = [get_base_quantity(name) != "rotation_deg" for name in self.unknown]
        shares = np.abs(self.best.null_directions / widths)[:, is_counted]
        return bool((shares < 1.0 / DETERMINED_RATIO).all())

    # ---- text, figure and JSON

    @property
    def remarks(self) -> tuple[str, ...]:
        """Reasons why the best touch may not be the answer, in sentences."""
        if not self.problem.is_determinable:
            count = len(self.problem.electrodes)
            charges = f"{count} {'charge does' if count == 1 else 'charges do'}"
            reason = f"{charges} not determine {', '.join(self.unknown)}"
            return (f"undetermined: {reason}; read more electrodes, or fix more quantities",)
        remarks = self._list_explanations()
        if not self.touches:
            return (*remarks, "no search converged: the charges fit no touch of the domain")
        best = self.best
        if not best.explained:
            remarks.append(f"unexplained: no touch of the response's domain fits; {self._fit}")
        if self.ambiguous:
            remarks.append(f"ambiguous: {1 + self.alternatives} touches are likely")
        if not self._determines_place_and_force:
            directions = [_format_direction(self.unknown, row) for row in best.null_directions]
            remarks.append(f"undetermined: free along {' and '.join(directions)}")
        elif not best.determined or {"rotation_deg"} in self._rival_differences:
            others = "" if self.ambiguous else "; place and force are"
            remarks.append(f"rotation is not determined{others}")
        if best.at_edge:
            limits = ", ".join(best.at_edge)
            reason = "the touch may lie beyond"
            remarks.append(f"at the edge of the response's domain ({limits}): {reason}")
        return tuple(remarks)

    def _list_explanations(self) -> list[str]:
        """List the mistakes in the readings without which a touch explains them."""
        sentences = []
        for text, touch in self.explanations:
            place = f"({touch.x_mm:.4g}, {touch.y_mm:.4g}) mm"
            explanation = f"a touch at {place} with {touch.force_N:.4g} N explains them"
            sentences.append(f"wrong readings: if {text}, {explanation}")
        return sentences

    @property
    def _fit(self) -> str:
        """How badly the best touch fits, in words."""
        chi_square = f"chi-square {self.best.chi_square:.3g}"
        if self.degrees_of_freedom <= 0:
            return chi_square
        cases = 1 / max(self.best.p_value, 1e-99)
        freedom = f"{self.degrees_of_freedom} degrees of freedom"
        return f"a touch gives such charges once in {cases:.0e} cases ({chi_square} with {freedom})"

    def summary(self) -> Summary:
        """Return status, remarks, a table for each touch, and a footnote on the ±."""
        tables = []
        for number, touch in enumerate(self.touches, start=1):
            tables.append(self._make_table(number, touch))
        notes = []
        if self.status is TouchStatus.UNEXPLAINED:
            notes.append("the nearest touch does not fit the readings, so the ± are meaningless")
        elif tables:
            notes.append("± : the true value is within, with a probability of 68 %")
        count = len(self.touches)
        listed = f"{count} {'touch' if count == 1 else 'touches'} listed"
        sentences = [f"{listed}, from {READINGS[self.reading]}", *self.remarks]
        return Summary(self.status, sentences, tables=tables, notes=notes)

    def _make_table(self, number: int, touch: Touch) -> TextTable:
        """Return the quantities of a touch with their errors."""
        deviations = self.compute_deviations(touch)
        rows = []
        for name, value in touch.by_name.items():
            if name not in deviations:
                rows.append((name, f"{value:.6g}", "known"))
                continue
            error = deviations[name]
            finest = min(error, touch.deviations[name])
            text, _ = format_with_error(value, finest)
            rows.append((name, text, f"{error:.2g}"))
        rows.append(("chi-square", f"{touch.chi_square:.3g}", ""))
        rows.append(("degrees of freedom", f"{self.degrees_of_freedom}", ""))
        rows.append(("share of likelihood", f"{touch.weight:.3g}", ""))
        return TextTable((f"touch {number}", "", "±"), tuple(rows))

    def plot(self) -> Figure:
        """Draw the likelihood over the film and near the most likely touch.

        Returns
        -------
        matplotlib.figure.Figure
            The likelihood of the best force and rotation at each place, with the ellipse of one
            standard deviation and the other touches. For full solves, and for two touches at once,
            there are ellipses alone.

        Raises
        ------
        ValueError
            Without a touch whose x and y were unknown.
        """
        from pvdf_fem.view.touch_map import draw_likelihood_map, draw_touch_ellipses

        x_keys = []
        for name in self.unknown:
            if name.endswith("x_mm") and f"{name.removesuffix('x_mm')}y_mm" in self.unknown:
                x_keys.append(name)
        if not self.touches or not x_keys:
            raise ValueError("plot: needs a touch whose x_mm and y_mm were unknown")
        response = self.problem.response
        reach_mm = response.domain.reach_mm
        touches = self.to_json()["touches"]
        if not response.is_fast:
            return draw_touch_ellipses(response.scene, reach_mm, touches, x_keys)
        return draw_likelihood_map(
            response.scene, reach_mm, touches, self._compute_distances, self.remarks
        )

    def _compute_distances(self, places_mm: Array) -> Array:
        """Compute √(2 ln(L max/L)), (n,), of the profile likelihood L at places (n, 2)."""
        excess = profile_chi_square(self.problem, self.best, places_mm) - self.best.chi_square
        return np.sqrt(np.maximum(excess, 0.0))

    def to_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        touches = []
        for touch in self.touches:
            errors = {
                "standard_deviations": self.compute_deviations(touch),
                "covariance": np.asarray(self.compute_covariance(touch)).tolist(),
            }
            touches.append({**touch.to_json(), **errors})
        return {
            "status": str(self.status),
            "reading": self.reading,
            "explanations": [{"if": text, **touch.to_json()} for text, touch in self.explanations],
            "unknown": list(self.unknown),
            "degrees_of_freedom": self.degrees_of_freedom,
            "ambiguous": self.ambiguous,
            "remarks": list(self.remarks),
            "deviations": self.deviations if self.touches else {},
            "touches": touches,
        }


def _format_direction(unknown: tuple[str, ...], direction: Array) -> str:
    """Format a combination (unknown,) of unknowns, leaving out those without a part in it."""
    parts = []
    for name, value in zip(unknown, direction, strict=True):
        if abs(value) > 1e-6:
            parts.append(f"{value:+.3g} {name}")
    return f"({', '.join(parts)})"
