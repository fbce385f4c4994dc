"""Results of the tracker: a row for each sample, and a summary of each touch."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Self

from pvdf_fem.summary import Result, Summary, format_with_error


class TrackStatus(StrEnum):
    """State of the tracker at a sample, and outcome of a touch that has ended."""

    SETTLING = "settling"  #: The baseline is being estimated; contacts are not detected yet.
    QUIET = "quiet"  #: Nothing touches the film.
    STARTING = "starting"  #: There is a contact that is not located yet.
    TOUCH = "touch"  #: The touch is located.
    TOO_LIGHT = "too_light"  #: The force is below those of the response.
    TOO_STRONG = "too_strong"  #: The force is above those of the response.
    UNEXPLAINED = "unexplained"  #: No touch of this probe explains the charges.
    CLIPPED = "clipped"  #: Too many channels were clipped at the peak of the charges.
    #: The contact is hidden by drift, or readings are missing where its charges may be largest.
    LOST = "lost"


@dataclass(frozen=True, repr=False)
class TrackRow(Result):
    """State of the tracker at one sample; unknown numbers are NaN.

    The force is NaN where it is far above the maximum force of the response. Position and rotation
    are those of the last location, which may be some samples old; only the force is fitted to each
    sample.
    """

    t_s: float
    status: str  #: A value of `TrackStatus`.
    touch: int = 0  #: Number of the touch, starting at 1; 0 without a contact.
    x_mm: float = math.nan
    y_mm: float = math.nan
    force_N: float = math.nan
    rotation_deg: float = math.nan
    #: Standard deviations about these values, for the mixture of all likely touches.
    x_deviation_mm: float = math.nan
    y_deviation_mm: float = math.nan
    force_deviation_N: float = math.nan
    rotation_deviation_deg: float = math.nan
    #: Chi-square of the charges of the sample, with one degree of freedom less than channels.
    chi_square: float = math.nan
    alternatives: int = 0  #: Number of likely touches, including the reported one.
    #: Seconds until contacts are detected, at the present sampling rate; NaN while unknown.
    settling_s: float = 0.0
    missing: str = ""  #: Names of the channels without a reading, separated by spaces: ``A C``.
    clipped: str = ""  #: Names of the channels whose readings were clipped.

    def copy_with(self, **changes: Any) -> Self:
        """Return a copy with other values of some quantities.

        It takes a fifth of the time of `dataclasses.replace`, and a stream has many rows.
        """
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__, **changes)
        return copy

    def summary(self) -> Summary:
        """Return the row as a line of text."""
        line = f"{self._format_time()} s{self._format_quantities()}"
        if self.alternatives > 1:
            line += f"; {self.alternatives} touches are likely"
        if self.touch and not self.alternatives:
            line += "; not located"
        if self.touch and self.status not in (TrackStatus.TOUCH, TrackStatus.STARTING):
            line += f"; {self.status}"
        if self.status == TrackStatus.CLIPPED:
            line += ": too few channels are within their range at the peak"
        elif self.alternatives and math.isnan(self.force_N):
            line += ": the force is far above the model's largest"
        if self.missing:
            line += f"; without {self.missing} for a while"
        if self.clipped:
            line += f"; {self.clipped} clipped"
        return Summary(f"touch {self.touch}" if self.touch else self.status, [line])

    def _format_quantities(self) -> str:
        """Format position, force and rotation with their standard deviations, if located."""
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
            # The deviation of a fixed quantity is 0, that of an unknown quantity is NaN.
            if deviation > 0.0 and not math.isnan(value):
                text += f", {name} {' ± '.join(format_with_error(value, deviation))} {unit}"
        return text

    def _format_time(self) -> str:
        """Format the time of the sample in s."""
        return f"{self.t_s:.4f}"

    def to_json(self) -> dict[str, Any]:
        """Return the values by name, with None in place of NaN."""
        values = {}
        for name, value in asdict(self).items():
            is_nan = isinstance(value, float) and math.isnan(value)
            values[name] = None if is_nan else value
        return values


@dataclass(frozen=True, repr=False)
class TouchSummary(TrackRow):
    """A touch that has ended or was cut off: the row at the peak of its charges.

    A touch that has ended is located again from all its samples; one that was cut off has its last
    location. The status of a touch that has ended is ``starting`` if no location was found.
    `missing` and `clipped` name the channels that had no reading, or a clipped one, in some samples
    of the touch. A touch while the baseline was learned has the status ``settling`` and no
    position.
    """

    onset_s: float = math.nan
    end_s: float = math.nan
    #: Integral of the force over time since the touch was first located; NaN without a force.
    impulse_N_s: float = math.nan

    def _format_time(self) -> str:
        """Format the times of the begin and the end of the touch in s."""
        return f"{self.onset_s:.4f} to {self.end_s:.4f}"
