"""Times of the samples of a stream from their stamps, for each kind of stamps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

from pvdf_fem.inverse.tracking.signal.stamps.filter import StampFilter
from pvdf_fem.inverse.tracking.signal.stamps.fit import StampFit, StampKind

#: Steps of regular stamps deviate by at most this fraction of the interval.
REGULAR_TOLERANCE = 0.5
#: Number of stamps from which the interval of regular stamps is estimated.
REGULAR_MEMORY = 64
#: Regular stamps that are this number of intervals away from the filter reset its time.
MAX_FILTER_ERROR = 4.0
#: Longest step of irregular stamps, in mean intervals, that is not a gap.
IRREGULAR_TOLERANCE = 10.0
#: Weight of a new step in the mean interval of irregular stamps.
IRREGULAR_WEIGHT = 1.0 / 64.0
#: Number of jittered stamps from which time and interval are estimated.
JITTERED_MEMORY = 256
#: Jittered stamps are suspicious beyond this multiple of their band plus half an interval.
BAND_MARGIN = 1.5
#: Number of stamps from which a line is found with a fraction of the uncertainty of the first ones.
UNCERTAINTY = 16.0
#: Fraction of the excess by which the band of jitter grows with each stamp outside of it.
BAND_ATTACK = 0.25
#: Fraction by which the band shrinks with each chunk of stamps inside of it.
BAND_DECAY = 1.0 / 512.0
#: Band of jitter, as a multiple of the first deviation that was too large for the band before.
BAND_SURPLUS = 1.5
#: Mean number of stamps in succession that deviate to the same side, for independent ones.
WHITE_CHUNK_SIZE = 2.0
#: Weight of a new number in this mean, and the largest factor by which it extends the memory.
CHUNK_WEIGHT = 1.0 / 16.0
MAX_MEMORY_FACTOR = 16.0
#: Deviations below this fraction of the interval are not counted.
SMALL_LAG = 0.1
#: The interval is doubtful when this many stamps, or mean numbers, deviate to the same side.
MIN_LAG_COUNT = 24
MAX_LAG_CHUNKS = 5.0
#: Largest change of an interval, as a fraction of it, by which jittered times are corrected.
MAX_SLEW = 0.04
#: Larger differences are corrected in about this number of rows, but by no more than this fraction.
SLEW_ROWS = 50.0
MAX_CATCH_UP = 0.9
#: Memory of the filter after a jump, in stamps.
FEW_STAMPS = 16


class TimeBase(ABC):
    """Times of rows, from the stamps of those that continue the stream.

    Parameters
    ----------
    fit : StampFit
        Kind, interval and jitter of the stamps.
    time_s : float
        Time of the last row in s.

    Attributes
    ----------
    time_s : float
        Time that the last row was given, in s.
    reference_s : float
        Time of the last row by its stamp or by the filter, with which the next stamps are compared.
        It differs from `time_s` while that is brought back to it.
    stamp_s, stamp_row : float, float
        Last stamp that was believed, and the number of its row; NaN and -inf before the first.
    tolerance_s : float
        Largest difference from the expected stamp that is not suspicious.
    """

    kind: ClassVar[StampKind]
    memory: ClassVar[int]

    def __init__(self, fit: StampFit, time_s: float) -> None:
        self.filter = StampFilter(time_s, fit.interval_s, fit.stamp_count, self.memory)
        self.time_s = time_s
        self.reference_s = time_s
        self.stamp_s = math.nan
        self.stamp_row: float = -math.inf
        #: Last stamp that was not believed; others repeat it if it was that of a block.
        self.wrong_stamp_s = math.nan
        #: Number of stamps in succession by which the filter was late, or early, and the number
        #: beyond which its interval is doubtful.
        self.lag_count = 0
        self.max_lag_count = MIN_LAG_COUNT
        #: Number of rows with one stamp of late.
        self.block_size = 1
        #: Mean number of stamps in succession that deviate to the same side.
        self.chunk_size = WHITE_CHUNK_SIZE
        self.band_s = fit.band_s
        self.repeat_s = fit.repeat_s
        self.tolerance_s = 0.0
        self.update_tolerance()

    @property
    def interval_s(self) -> float:
        """Sampling interval in s."""
        return self.filter.interval_s

    def is_repeated(self, stamp_s: float) -> bool:
        """Whether a stamp is expected to repeat the last one."""
        return False

    @abstractmethod
    def update_tolerance(self) -> None:
        """Compute the tolerance from the interval."""

    @abstractmethod
    def accept(self, row: int, stamp_s: float) -> float | None:
        """Return the time of a row that continues the stream, or None if its stamp is suspicious.

        Parameters
        ----------
        row : int
            Number of the row.
        stamp_s : float
            Its stamp in s.
        """

    def estimate(self, step_s: float | None = None) -> float:
        """Return the time of a row without a usable stamp.

        Parameters
        ----------
        step_s : float, optional
            Step from the last row in s; one interval by default.
        """
        self.filter.time_s += self.filter.interval_s
        return self._advance(self.filter.interval_s if step_s is None else step_s)

    def begin_after_gap(self, row: int, stamp_s: float) -> float:
        """Return the time of the first row after a gap.

        Parameters
        ----------
        row : int
            Number of the row.
        stamp_s : float
            Its stamp in s.
        """
        self.filter.time_s = stamp_s
        self.believe(row, stamp_s)
        return self._advance(stamp_s - self.reference_s)

    def continue_from(self, before: TimeBase, row: int, time_s: float) -> None:
        """Continue the stream of another time base.

        Parameters
        ----------
        before : TimeBase
            Time base until now.
        row : int
            Number of the last row.
        time_s : float
            Time of the last row by the line fitted to the stamps, in s.
        """
        self.filter.time_s = time_s
        self.stamp_s = before.stamp_s
        self.stamp_row = before.stamp_row
        self.reference_s = before.stamp_s + (row - before.stamp_row) * self.interval_s

    def believe(self, row: int, stamp_s: float) -> None:
        """Record a stamp that is not wrong, and the number of its row."""
        self.stamp_s = stamp_s
        self.stamp_row = row

    def _advance(self, step_s: float) -> float:
        """Return the time of the next row, which is brought back to the reference if it is ahead.

        Parameters
        ----------
        step_s : float
            Step of the reference in s.
        """
        self.reference_s += step_s
        slow_time = self.time_s + (1.0 - MAX_CATCH_UP) * step_s
        self.time_s = max(self.reference_s, slow_time)
        return self.time_s


class RegularTimeBase(TimeBase):
    """Time base of stamps that are the times, at a constant interval but for gaps."""

    kind = StampKind.REGULAR
    memory = REGULAR_MEMORY

    def update_tolerance(self) -> None:
        """Compute the tolerance from the interval."""
        self.tolerance_s = REGULAR_TOLERANCE * self.filter.interval_s

    def accept(self, row: int, stamp_s: float) -> float | None:
        """Return the stamp of a row that continues the stream, or None if it is suspicious."""
        stamp_filter = self.filter
        interval = stamp_filter.interval_s
        step = stamp_s - self.reference_s
        error = stamp_s - stamp_filter.time_s - interval
        tolerance = self.tolerance_s
        if step <= 0.0 or (abs(step - interval) > tolerance and abs(error) > tolerance):
            return None
        stamp_filter.time_s += interval
        if abs(error) > MAX_FILTER_ERROR * interval:
            stamp_filter.time_s = stamp_s
        else:
            stamp_filter.correct(error, 1)
            self.tolerance_s = REGULAR_TOLERANCE * stamp_filter.interval_s
        self.believe(row, stamp_s)
        return self._advance(step)


class IrregularTimeBase(TimeBase):
    """Time base of stamps that are the times, at random intervals."""

    kind = StampKind.IRREGULAR
    memory = REGULAR_MEMORY

    def update_tolerance(self) -> None:
        """Compute the tolerance from the mean interval."""
        self.tolerance_s = IRREGULAR_TOLERANCE * self.filter.interval_s

    def accept(self, row: int, stamp_s: float) -> float | None:
        """Return the stamp of a row that continues the stream, or None if it is suspicious."""
        step = stamp_s - self.reference_s
        if not 0.0 < step <= self.tolerance_s:
            return None
        stamp_filter = self.filter
        stamp_filter.time_s = stamp_s
        stamp_filter.interval_s += IRREGULAR_WEIGHT * (step - stamp_filter.interval_s)
        self.update_tolerance()
        self.believe(row, stamp_s)
        return self._advance(step)


class JitteredTimeBase(TimeBase):
    """Time base of stamps that deviate from constant intervals, repeat, or go back.

    The times are those of the filter. The tolerance follows the largest deviation of late.
    """

    kind = StampKind.JITTERED
    memory = JITTERED_MEMORY

    def __init__(self, fit: StampFit, time_s: float) -> None:
        super().__init__(fit, time_s)
        self._error_s = 0.0
        self._repeat_count = 0

    def is_repeated(self, stamp_s: float) -> bool:
        """Whether a stamp repeats the last one, as all those of a block do."""
        is_repeated = 0.0 <= stamp_s - self.stamp_s <= self.repeat_s
        return is_repeated or stamp_s == self.wrong_stamp_s

    def update_tolerance(self) -> None:
        """Compute the tolerance from the band of jitter and the interval."""
        interval = self.filter.interval_s
        margin = BAND_MARGIN * (1.0 + UNCERTAINTY / self.filter.count)
        self.tolerance_s = margin * self.band_s + REGULAR_TOLERANCE * interval

    def accept(self, row: int, stamp_s: float) -> float | None:
        """Return the regressed time of a row, or None if its stamp is suspicious."""
        stamp_filter = self.filter
        if self.is_repeated(stamp_s):
            if stamp_s != self.wrong_stamp_s:
                self.stamp_s = stamp_s
                self._repeat_count += 1
            return self.estimate()
        error = stamp_s - stamp_filter.time_s - stamp_filter.interval_s
        if abs(error) > self.tolerance_s:
            return None
        stamp_filter.time_s += stamp_filter.interval_s
        stamp_filter.correct(error, row - self.stamp_row)
        if abs(error) > SMALL_LAG * stamp_filter.interval_s:
            if error * self._error_s > 0.0:
                self.lag_count += 1
            else:
                self._end_lag()
            self._error_s = error
        excess = abs(error) - self.band_s
        if excess > 0.0:
            self.band_s += BAND_ATTACK * excess
            stamp_filter.end_skip()
        else:
            self.band_s -= BAND_DECAY / self.chunk_size * self.band_s
        self.update_tolerance()
        self.block_size = max(self._repeat_count + 1, self.block_size - 1)
        self._repeat_count = 0
        self.believe(row, stamp_s)
        return self._advance(stamp_filter.interval_s)

    def begin_after_gap(self, row: int, stamp_s: float) -> float:
        """Return the time of the first row after a gap."""
        gap = stamp_s - self.filter.time_s - self.filter.interval_s
        self.filter.end_skip()
        self.filter.time_s = stamp_s
        self.time_s += gap
        self.believe(row, stamp_s)
        return self._advance(self.filter.interval_s)

    def continue_from(self, before: TimeBase, row: int, time_s: float) -> None:
        """Continue the stream of another time base."""
        super().continue_from(before, row, time_s)
        self.reference_s = time_s

    def _end_lag(self) -> None:
        """Adapt the memory to the number of stamps that deviate alike, as those of a chunk do."""
        self.chunk_size += CHUNK_WEIGHT * (self.lag_count + 1 - self.chunk_size)
        self.lag_count = 0
        self.filter.memory = round(JITTERED_MEMORY * self._memory_factor)
        self.max_lag_count = round(max(self.chunk_size * MAX_LAG_CHUNKS, MIN_LAG_COUNT))

    @property
    def _memory_factor(self) -> float:
        """Factor of the memory due to chunks, in which stamps are not independent."""
        return min(max(1.0, self.chunk_size / WHITE_CHUNK_SIZE), MAX_MEMORY_FACTOR)

    def expect_chunks(self, chunk_size: int) -> None:
        """Prepare for chunks of stamps that deviate alike, in a stream whose interval is known.

        Parameters
        ----------
        chunk_size : int
            Number of stamps in a chunk.
        """
        self.chunk_size = float(chunk_size)
        self._end_lag()
        self.filter.count = self.filter.memory
        self.filter.forget(self.filter.memory)

    def widen_band(self, offset_s: float) -> None:
        """Widen the band of jitter to a deviation.

        Parameters
        ----------
        offset_s : float
            Deviation of a stamp in s.
        """
        self.band_s = max(self.band_s, BAND_SURPLUS * abs(offset_s))
        self.update_tolerance()

    def forget_most(self) -> None:
        """Let the next stamps count more, as after a jump."""
        self.filter.forget(round(FEW_STAMPS * self._memory_factor))

    def _advance(self, step_s: float) -> float:
        """Return the time of the next row, whose interval differs but little from the nominal one.

        Parameters
        ----------
        step_s : float
            Nominal interval in s.
        """
        self.reference_s = self.filter.time_s
        expected = self.time_s + step_s
        difference = self.reference_s - expected
        limit = min(max(MAX_SLEW * step_s, abs(difference) / SLEW_ROWS), MAX_CATCH_UP * step_s)
        self.time_s = expected + max(-limit, min(limit, difference))
        return self.time_s


_TIME_BASES: dict[StampKind, type[TimeBase]] = {}
for _time_base in (RegularTimeBase, IrregularTimeBase, JitteredTimeBase):
    _TIME_BASES[_time_base.kind] = _time_base


def make_time_base(fit: StampFit, time_s: float) -> TimeBase:
    """Make the time base for the kind of stamps that a fit has found.

    Parameters
    ----------
    fit : StampFit
        Kind, interval and jitter of the stamps.
    time_s : float
        Time of the last row in s.
    """
    return _TIME_BASES[fit.kind](fit, time_s)
