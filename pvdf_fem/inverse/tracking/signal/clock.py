"""The clock of a sampled stream: times that increase, from stamps that may be faulty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from pvdf_fem.inverse.tracking.signal.stamps.learning_buffer import LearningBuffer
from pvdf_fem.inverse.tracking.signal.stamps.options import ClockOptions
from pvdf_fem.inverse.tracking.signal.stamps.repair_log import Repair, RepairLog
from pvdf_fem.inverse.tracking.signal.stamps.rows import ClockEvent, StreamRow, TimedRow
from pvdf_fem.inverse.tracking.signal.stamps.timeline import Timeline
from pvdf_fem.inverse.tracking.stream_notes import StreamNote

#: Stamps beyond this number of seconds, which is more than that of the nanoseconds since 1970, are
#: no times: sums and squares of them would overflow.
MAX_STAMP_S = 1e20

__all__ = ["ClockEvent", "ClockOptions", "Repair", "SampleClock", "StampedSample"]


class StampedSample(NamedTuple):
    """Sample with a time that is behind those of all samples before."""

    time_s: float
    values: Sequence[float]  #: Readings, shape (electrodes,).
    event: ClockEvent
    gap_s: float  #: Time in s that is missing before the sample, beyond one interval.


class SampleClock:
    """Clock that gives each sample of a stream a time, and repairs faults of the time stamps.

    Parameters
    ----------
    options : ClockOptions
        Bounds on the number of samples that are held back.

    Notes
    -----
    The first samples are held until their interval is known (`LearningBuffer`). From then on, a
    sample is passed on at once if its stamp continues the stream; otherwise, it is held until a few
    more samples explain its stamp (`Timeline`). Times are computed relative to the first stamp,
    since the resolution of seconds since 1970 is 0.24 µs only.

    Examples
    --------
    >>> clock = SampleClock()
    >>> for stamp_s, readings in stream:
    ...     for sample in clock.receive(stamp_s, readings):
    ...         print(sample.time_s, sample.event, sample.values)
    >>> samples = clock.flush()
    >>> print(clock.notes, clock.repairs)
    """

    def __init__(self, options: ClockOptions | None = None) -> None:
        self._options = options or ClockOptions()
        self._log = RepairLog()
        self._learning = LearningBuffer(self._options)
        self._timeline: Timeline | None = None
        self._row_count = 0
        self._start_s = 0.0
        self._time_s = -math.inf

    @property
    def interval_s(self) -> float:
        """Sampling interval in s; infinite until it has been learned."""
        return self._timeline.interval_s if self._timeline else math.inf

    @property
    def notes(self) -> list[str]:
        """Sentence for the first repair of each kind, and for each restart."""
        return [note.text for note in self._log.notes]

    @property
    def repair_notes(self) -> list[StreamNote]:
        """The same sentences with the kinds of the repairs."""
        return self._log.notes

    @property
    def repairs(self) -> Counter[Repair]:
        """Number of repairs of each kind."""
        return self._log.counts

    def receive(self, stamp_s: float, values: Sequence[float]) -> list[StampedSample]:
        """Receive a sample, and return those whose times are decided.

        Parameters
        ----------
        stamp_s : float
            Stamp of the sample in s. It is missing if it is NaN, infinite, or beyond `MAX_STAMP_S`.
        values : sequence of float
            Readings, which are passed on unchanged.

        Returns
        -------
        list of StampedSample
            Samples in order of time; none while samples are held back.
        """
        if not abs(stamp_s) <= MAX_STAMP_S:
            stamp_s = math.nan
        row = StreamRow(self._row_count, stamp_s, values)
        self._row_count += 1
        if self._timeline:
            return self._stamp(self._timeline.add(row))
        fit = self._learning.add(row)
        if fit:
            return self._begin(Timeline(fit, self._learning.start_s, self._options, self._log))
        if len(self._learning.rows) > self._options.max_learning_samples:
            untimed = self._learning.rows.popleft()
            self._log.add(Repair.UNTIMED_ROW, untimed.number)
        return []

    def flush(self) -> list[StampedSample]:
        """Return the samples that are held back at the end of the stream."""
        samples: list[StampedSample] = []
        if self._timeline is None:
            fit = self._learning.finish()
            if fit is None:
                count = len(self._learning.rows)
                if count:
                    self._log.add(Repair.UNTIMED_ROW, self._row_count - 1, count=count)
                return samples
            samples = self._begin(Timeline(fit, self._learning.start_s, self._options, self._log))
        if self._timeline:
            samples.extend(self._stamp(self._timeline.flush()))
        return samples

    def _begin(self, timeline: Timeline) -> list[StampedSample]:
        """Pass on the samples from which the interval has been learned."""
        self._timeline = timeline
        self._start_s = self._learning.start_s
        samples: list[StampedSample] = []
        for row in self._learning.rows:
            samples.extend(self._stamp(timeline.add(row)))
        self._learning.rows.clear()
        return samples

    def _stamp(self, rows: Iterable[TimedRow]) -> list[StampedSample]:
        """Return samples with absolute times, each behind the last one."""
        samples = []
        for row in rows:
            time = row.time_s + self._start_s
            event = row.event
            if time <= self._time_s:
                time = math.nextafter(self._time_s, math.inf)
            if self._time_s == -math.inf:
                event = ClockEvent.FIRST
            self._time_s = time
            samples.append(StampedSample(time, row.values, event, row.gap_s))
        return samples
