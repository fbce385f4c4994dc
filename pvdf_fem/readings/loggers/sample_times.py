"""The times of samples: from the stamps in a channel, or from a constant rate."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.units import Unit

#: Larger times, of more than three years, are counted from an epoch.
EPOCH_TIME_S = 1e8
#: Times from 2001 to 2038 in s since 1970.
UNIX_TIMES_S = (1e9, 2**31)


class StampConverter:
    """Converts stamps to times in s, block after block.

    Stamps with a date, and numbers that are counted from an epoch, are counted from the first
    stamp, since a float has too few digits for both the date and a microsecond.

    Parameters
    ----------
    unit : Unit
        Unit of the stamps, which is ignored for those of type ``datetime64``.
    """

    def __init__(self, unit: Unit) -> None:
        self.unit = unit
        self.start: datetime | None = None  #: The time 0, once it is known.
        self._origin: Any = None  #: The stamp of time 0, of the type of the stamps.

    def convert(self, stamps: Array) -> Array:
        """Return the times of a block in s; NaN for missing stamps."""
        if self._origin is None:
            self._set_origin(stamps)
        if stamps.dtype.kind == "M":
            since_start: Any = stamps - self._origin
            return np.asarray(since_start / np.timedelta64(1, "s"), dtype=float)
        return np.asarray(self.unit.scale * (stamps - self._origin).astype(float))

    def _set_origin(self, stamps: Array) -> None:
        """Set the origin of times to the first stamp that is not missing."""
        if stamps.dtype.kind == "M":
            present = stamps[~np.isnat(stamps)]
            self._origin = present[0] if len(present) else np.datetime64(0, "ns")
            since_epoch = self._origin - np.datetime64(0, "ns")
            self.start = _make_datetime(float(since_epoch / np.timedelta64(1, "s")))
            return
        present = stamps[np.isfinite(stamps)]
        self._origin = stamps.dtype.type(0)
        if len(present) and self.unit.scale * abs(float(present[0])) > EPOCH_TIME_S:
            self._origin = present[0]
            first_s = self.unit.scale * float(present[0])
            if UNIX_TIMES_S[0] <= first_s <= UNIX_TIMES_S[1]:
                self.start = _make_datetime(first_s)


def _make_datetime(since_epoch_s: float) -> datetime:
    """Return the time that is some seconds after 1970."""
    return datetime.fromtimestamp(since_epoch_s, UTC)
