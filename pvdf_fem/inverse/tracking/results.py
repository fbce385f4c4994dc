"""Results of the tracker: a row for each sample, and a summary of each touch."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from pvdf_fem.summary import Result, Summary, format_with_error


class TrackStatus(StrEnum):
    """State of the tracker at a sample, and of a touch that has ended."""

    SETTLING = "settling"  #: The baseline is being learned.
    QUIET = "quiet"  #: Nothing touches.
    STARTING = "starting"  #: A contact that is not located yet.
    TOUCH = "touch"  #: A located touch.
    TOO_LIGHT = "too_light"  #: The force is below those of the response.
    TOO_STRONG = "too_strong"  #: The force is above those of the response.
    UNEXPLAINED = "unexplained"  #: No touch of this probe gives such charges.
    LOST = "lost"  #: Drift hides the contact, or the readings paused: a new baseline begins.
    CLOCK = "clock"  #: The time did not grow: everything begins anew.


@dataclass(frozen=True, repr=False)
class TrackRow(Result):
    """State of the tracker at one sample; unknown numbers are NaN.

    The force is NaN where it is far above the largest force of the response. While the status is
    ``too_light``, the place is that of the samples before.
    """

    t_s: float
    status: str  #: Of `TrackStatus`.
    touch: int = 0  #: Number of the touch, from 1; 0 for none.
    x_mm: float = math.nan
    y_mm: float = math.nan
    force_N: float = math.nan
    rotation_deg: float = math.nan
    #: Standard deviations about this place, over the mixture of the likely places.
    x_deviation_mm: float = math.nan
    y_deviation_mm: float = math.nan
    force_deviation_N: float = math.nan
    rotation_deviation_deg: float = math.nan
    #: Chi-square of the sample's charges; degrees of freedom: number of channels less 1.
    chi_square: float = math.nan
    alternatives: int = 0  #: Number of places with a hundredth of the likelihood or more.
    #: Seconds until contacts are detected, if samples come as before; NaN while unknown.
    settling_s: float = 0.0
    missing: str = ""  #: Channels without a reading, by name: ``A C``.

    def summary(self) -> Summary:
        """Return the row as a line of text."""
        line = f"{self._format_time()} s{self._format_quantities()}"
        if self.alternatives > 1:
            line += f"; {self.alternatives} places are likely"
        if self.touch and not self.alternatives:
            line += "; not located"
        if self.touch and self.status not in (TrackStatus.TOUCH, TrackStatus.STARTING):
            line += f"; {self.status}"
        if self.alternatives and math.isnan(self.force_N):
            line += ": the force is far above the model's largest"
        if self.missing:
            line += f"; without {self.missing} for a while"
        return Summary(f"touch {self.touch}" if self.touch else self.status, [line])

    def _format_quantities(self) -> str:
        """Format place, force and rotation with their deviations, where these are known."""
        if not self.alternatives:
            return ""
        quantities = (
            ("x", self.x_mm, self.x_deviation_mm, "mm"),
            ("y", self.y_mm, self.y_deviation_mm, "mm"),
            ("force", self.force_N, self.force_deviation_N, "N"),
            ("rotation", self.rotation_deg, self.rotation_deviation_deg, "deg"),
        )
        text = ""
        for name, value, deviation, unit in quantities:
            if deviation > 0.0:  # A fixed quantity has none, and an unknown one NaN.
                text += f", {name} {' ± '.join(format_with_error(value, deviation))} {unit}"
        return text

    def _format_time(self) -> str:
        return f"{self.t_s:.4f}"

    def to_json(self) -> dict[str, Any]:
        """Return the values by name, None in place of NaN."""
        values = {}
        for name, value in asdict(self).items():
            is_nan = isinstance(value, float) and math.isnan(value)
            values[name] = None if is_nan else value
        return values


@dataclass(frozen=True, repr=False)
class TouchSummary(TrackRow):
    """A touch that has ended: its row at the peak of its charges, by the whole course.

    The status is ``starting`` if the touch was not located; `missing` are the channels that had no
    reading for a while.
    """

    onset_s: float = math.nan
    end_s: float = math.nan
    impulse_N_s: float = math.nan  #: Integral of the force over time.

    def _format_time(self) -> str:
        return f"{self.onset_s:.4f} to {self.end_s:.4f}"
