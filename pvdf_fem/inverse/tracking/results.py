"""What a tracker tells: a row for each sample, and a summary of each touch."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from pvdf_fem.summary import Result, Summary, format_with_error


@dataclass(frozen=True, repr=False)
class TrackRow(Result):
    """What is known at a sample. Numbers that are not are NaN.

    The status is one of: ``settling`` (the baseline is not known yet), ``quiet``, ``starting`` (a
    touch that is too faint yet to be located), ``touch``, ``too_light`` (the force is below the
    model's least: the place is that of before), ``too_strong`` (it is above the largest),
    ``unexplained`` (no touch of this probe gives such charges), ``lost`` (what the touch was cannot
    be told any longer; a new baseline begins), ``clock`` (the time did not grow: all begins anew).
    A force that is far above the model's largest is NaN.
    """

    t_s: float
    status: str
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
    #: Seconds until touches are looked for, if samples come as before; NaN while unknown.
    settling_s: float = 0.0
    missing: str = ""  #: Channels without a reading, by name: ``A C``.

    def summary(self) -> Summary:
        """A line for people."""
        line = f"{self._when} s"
        if self.alternatives:
            for name, unit in (("x", "mm"), ("y", "mm"), ("force", "N"), ("rotation", "deg")):
                value, error = (getattr(self, f"{name}{of}_{unit}") for of in ("", "_deviation"))
                if error > 0.0:  # neither known nor NaN
                    line += f", {name} {' ± '.join(format_with_error(value, error))} {unit}"
        if self.alternatives > 1:
            line += f"; {self.alternatives} places are likely"
        if self.touch and not self.alternatives:
            line += "; not located"
        if self.touch and self.status not in ("touch", "starting"):
            line += f"; {self.status}"
        if self.alternatives and math.isnan(self.force_N):
            line += ": the force is far above the model's largest"
        line += f"; without {self.missing} for a while" if self.missing else ""
        return Summary(f"touch {self.touch}" if self.touch else self.status, [line])

    @property
    def _when(self) -> str:
        return f"{self.t_s:.4f}"

    def to_json(self) -> dict[str, Any]:
        """The values by name, None for NaN."""
        return {k: None if v != v else v for k, v in asdict(self).items()}


@dataclass(frozen=True, repr=False)
class TouchSummary(TrackRow):
    """A touch that has ended: its row at the peak of its charges, by the whole course.

    The status is ``starting`` if no place was found; `missing` are channels that had no reading for
    a while.
    """

    onset_s: float = math.nan
    end_s: float = math.nan
    impulse_N_s: float = math.nan  #: Integral of the force over time.

    @property
    def _when(self) -> str:
        return f"{self.onset_s:.4f} to {self.end_s:.4f}"
