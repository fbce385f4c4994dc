"""What a tracker tells: a row for each sample, and a summary of each touch."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from pvdf_fem.arrays import finite

NAN = float("nan")
#: What rows and summaries tell of a touch.
NUMBERS = (
    *("x_mm", "y_mm", "force_N", "rotation_deg"),
    *("x_deviation_mm", "y_deviation_mm", "force_deviation_N", "rotation_deviation_deg"),
)


class _Plain:
    def to_json(self) -> dict[str, Any]:
        """Plain values for JSON, None for what is not known."""
        values = asdict(self)  # type: ignore[call-overload]
        return {k: finite(v) if isinstance(v, float) else v for k, v in values.items()}


@dataclass(frozen=True)
class Row(_Plain):
    """What is known at a sample. Numbers that are not are NaN.

    The status is one of: ``settling`` (the baseline is not known yet), ``quiet``, ``starting`` (a
    touch that is too faint yet to be located), ``touch``, ``too_light`` (the force is below the
    model's least: the place is that of before), ``too_strong`` (it is above the largest),
    ``unexplained`` (no touch of this probe gives such charges), ``lost`` (what the touch was cannot
    be told any longer; a new baseline begins), ``clock`` (the time did not grow: all begins anew).
    """

    t_s: float
    status: str
    #: Number of the touch, from 1; 0 for none.
    touch: int = 0
    x_mm: float = NAN
    y_mm: float = NAN
    force_N: float = NAN
    rotation_deg: float = NAN
    #: Standard deviations. That of the place counts all places that may be touched.
    x_deviation_mm: float = NAN
    y_deviation_mm: float = NAN
    force_deviation_N: float = NAN
    rotation_deviation_deg: float = NAN
    #: Of the charges of this sample, with one degree of freedom less than there are channels.
    chi_square: float = NAN
    #: Number of places with a hundredth of the likelihood or more.
    alternatives: int = 0
    #: Channels without a reading, by name: ``A C``.
    missing: str = ""


@dataclass(frozen=True)
class TouchSummary(_Plain):
    """A touch from onset to end."""

    number: int
    onset_s: float
    end_s: float
    #: The place, and the force at its peak, with standard deviations; NaN where not located.
    x_mm: float
    y_mm: float
    force_N: float
    rotation_deg: float
    x_deviation_mm: float
    y_deviation_mm: float
    force_deviation_N: float
    rotation_deviation_deg: float
    peak_s: float
    #: Integral of the force over time in N s.
    impulse_N_s: float
    alternatives: int
    remarks: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """From onset to end."""
        return self.end_s - self.onset_s

    def __str__(self) -> str:
        """A line for people."""
        line = f"touch {self.number}: {self.onset_s:.4f} to {self.end_s:.4f} s"
        if self.alternatives:
            line += (
                f", x {self.x_mm:.2f} ± {self.x_deviation_mm:.2f} mm"
                f", y {self.y_mm:.2f} ± {self.y_deviation_mm:.2f} mm"
                f", peak {self.force_N:.3f} ± {self.force_deviation_N:.3f} N"
            )
            if self.rotation_deviation_deg:
                line += f", {self.rotation_deg:.0f} ± {self.rotation_deviation_deg:.0f}°"
        return "; ".join([line, *self.remarks])
