"""Fit of a sampling interval to a few time stamps that may be jittered, blocked, or faulty."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask

#: Shortest sampling interval in s. Stamps that differ by less have none.
MIN_INTERVAL_S = 1e-12
#: Steps beyond this multiple of the median step separate segments, as gaps and wild stamps do.
LARGE_STEP = 10.0
#: Steps within this fraction of the median step agree with it. Jitter below it is left alone.
AGREEMENT = 0.1
#: Fraction of steps that must agree for the median step to be the sampling interval.
AGREEING_FRACTION = 0.6
#: Fraction of steps that agree in chunks, whose stamps jitter as a whole.
CHUNK_FRACTION = 0.85
#: Smallest number of longer and of shorter steps that count as jitter, outside of chunks.
MIN_MIXED_STEPS = 2
#: Steps of bursts below this fraction of the interval count as repeated stamps.
BURST_STEP = 0.2
#: Smallest number of different stamps to fit.
MIN_STAMPS = 4
#: Smallest number of longer steps whose even distances show rounded stamps and not missing rows.
MIN_LONG_STEPS = 5
#: Residuals of rounded stamps stay within this multiple of the excess of the longer steps.
MAX_ROUNDING = 1.1
#: Smallest number of steps backward that count as jitter and not as single faults.
MIN_BACKWARD_STEPS = 3
#: Largest ratio of the variances of residuals and steps of jitter, which is a half for white jitter
#: and infinitely many stamps. Increasing stamps that are trusted by mistake do little harm.
JITTER_GROWTH = 0.75
#: Smallest number of rows between jumps that makes them jitter of chunks and not single faults.
MIN_CHUNK = 3
#: Jump of the deviations, in intervals, that separates chunks, and largest number of those that are
#: gaps if none goes back.
JUMP = 0.3
MAX_GAPS = 2
#: Fraction of steps that must be multiples of the interval if many rows are missing, and of those
#: that must be one interval.
MULTIPLE_FRACTION = 0.85
SINGLE_FRACTION = 0.3


class StampKind(Enum):
    """Relation between the stamps of a stream and the times of its samples."""

    REGULAR = auto()  #: Stamps are the times, at a constant interval but for gaps.
    IRREGULAR = auto()  #: Stamps are the times, at random intervals.
    JITTERED = auto()  #: Times have a constant interval; stamps deviate, repeat, or go back.


class StampFit(NamedTuple):
    """Sampling interval, and deviations of the stamps from it."""

    kind: StampKind
    interval_s: float
    #: Time of row 0, extrapolated from the first usable stamps.
    origin_s: float
    #: Time of row 0, extrapolated from the last usable stamps.
    last_origin_s: float
    #: Largest deviation of a stamp from the line of constant interval.
    band_s: float
    #: Steps of at most this size count as repeated stamps.
    repeat_s: float
    #: Number of stamps in the fit.
    stamp_count: int
    #: Fraction of the steps that are one interval.
    agreement: float
    #: Number of jumps forward, if none goes back.
    gap_count: int = 0


class _Segment(NamedTuple):
    """Different stamps without a large jump, by the numbers of their rows."""

    rows: Indices
    stamps: Array

    @property
    def row_steps(self) -> Indices:
        """Differences of the numbers of successive rows, shape (stamps - 1,)."""
        return np.diff(self.rows)

    @property
    def time_steps(self) -> Array:
        """Differences of successive stamps in s, shape (stamps - 1,)."""
        return np.diff(self.stamps)


def fit_stamps(rows: Sequence[int], stamps: Sequence[float]) -> StampFit | None:
    """Fit a sampling interval, and find what kind of stamps a stream has.

    Parameters
    ----------
    rows : sequence of int
        Numbers of the rows, in order of arrival.
    stamps : sequence of float
        Stamps of the rows in s, finite. A stamp differs from the one before.

    Returns
    -------
    StampFit or None
        None if there are too few stamps without a large jump.

    Notes
    -----
    Where most steps agree, the interval is their mean; gaps, wild and exchanged stamps then do not
    matter. Otherwise, it is the median of the slopes of all pairs of stamps (Theil, 1950; Sen,
    1968, J. Am. Stat. Assoc. 63, 1379). Jitter and irregular sampling differ in how deviations
    grow: the variance of the residuals is half that of the steps for white jitter of the stamps,
    and about n/15 of it for n independent intervals with the trend removed.
    """
    if len(stamps) < MIN_STAMPS:
        return None
    whole = _Segment(np.asarray(rows), np.asarray(stamps, dtype=float))
    heads = _select_burst_heads(whole)
    segments = _split_at_large_steps(whole if heads is None else heads)
    longest = max(segments, key=lambda segment: len(segment.rows))
    if len(longest.rows) < MIN_STAMPS:
        return None
    agreed = _find_agreed_interval(longest)
    interval = _find_median_slope(longest) if agreed is None else agreed
    if interval < MIN_INTERVAL_S:
        return None
    rates = longest.time_steps / longest.row_steps
    kind = _classify(longest, interval, agreed is not None)
    usable = [segment for segment in segments if len(segment.rows) >= MIN_CHUNK]
    first = usable[0]
    levels = _split_at_gaps(first, interval)
    origin = float(np.median(levels[0]))
    if kind is not StampKind.JITTERED:
        origin = _find_anchor(first, interval, kind)
    # The largest deviation of few stamps is exceeded soon.
    band = (1.0 + 8.0 / len(longest.rows)) * _measure_band(longest, interval)
    return StampFit(
        kind=kind,
        interval_s=interval,
        origin_s=origin,
        last_origin_s=float(np.median(_split_at_gaps(usable[-1], interval)[-1])),
        band_s=band if kind is StampKind.JITTERED else 0.0,
        repeat_s=0.0 if heads is None else BURST_STEP * interval,
        stamp_count=len(longest.rows),
        gap_count=_count_gaps(longest, interval),
        agreement=float(np.mean(np.abs(rates / interval - 1.0) <= AGREEMENT)),
    )


def _select_burst_heads(whole: _Segment) -> _Segment | None:
    """Select the first stamps of bursts, as buffers make them that are stamped when read.

    Parameters
    ----------
    whole : _Segment
        All stamps. The stamps of a burst follow each other in a small fraction of its duration.

    Returns
    -------
    _Segment or None
        None if the stamps do not come in bursts.
    """
    steps = whole.time_steps
    large = np.abs(steps) > LARGE_STEP * np.median(np.abs(steps))
    pauses = large & (steps > 0.0)
    backward_count = np.count_nonzero(large & (steps < 0.0))
    pause_count = np.count_nonzero(pauses)
    if pause_count < 3 or backward_count > 0.2 * pause_count:
        return None
    sizes = steps[pauses]
    typical = np.median(sizes)
    is_similar = np.mean(np.abs(sizes - typical) < 0.7 * typical) > 0.7
    if not is_similar or np.sum(sizes) < 0.9 * (whole.stamps[-1] - whole.stamps[0]):
        return None
    heads = np.flatnonzero(pauses) + 1
    return _Segment(whole.rows[heads], whole.stamps[heads])


def _split_at_large_steps(whole: _Segment) -> list[_Segment]:
    """Split stamps where they jump by more than `LARGE_STEP` median steps."""
    size = np.abs(whole.time_steps)
    jumps = np.flatnonzero(size > LARGE_STEP * np.median(size)) + 1
    parts = zip(np.split(whole.rows, jumps), np.split(whole.stamps, jumps), strict=True)
    return [_Segment(rows, stamps) for rows, stamps in parts]


def _find_agreed_interval(segment: _Segment) -> float | None:
    """Return the mean of the steps that agree with their median, or None if too few agree."""
    rates = segment.time_steps / segment.row_steps
    median = np.median(rates)
    if median < MIN_INTERVAL_S:
        return None
    agree = _select_agreeing_steps(segment)
    multiples = np.round(rates / median)
    is_multiple = (np.abs(rates / median - multiples) <= AGREEMENT) & (multiples >= 1.0)
    has_gaps = np.mean(is_multiple) > MULTIPLE_FRACTION and np.mean(agree) > SINGLE_FRACTION
    if not (has_gaps or np.mean(agree) >= AGREEING_FRACTION):
        return None
    long_count = np.count_nonzero(rates > (1.0 + JUMP) * median)
    short_count = np.count_nonzero(rates < (1.0 - JUMP) * median)
    is_mixed = min(long_count, short_count) >= MIN_MIXED_STEPS
    if (is_mixed and np.mean(agree) < CHUNK_FRACTION) or _is_rounded(segment, agree):
        return None
    return float(np.sum(segment.time_steps[agree]) / np.sum(segment.row_steps[agree]))


def _select_agreeing_steps(segment: _Segment) -> Mask:
    """Return whether each step, for each row, agrees with the median one."""
    rates = segment.time_steps / segment.row_steps
    median = np.median(rates)
    return np.asarray(np.abs(rates - median) <= AGREEMENT * np.abs(median))


def _is_rounded(segment: _Segment, agree: Mask) -> bool:
    """Whether longer steps come so evenly that they are due to rounding of the stamps.

    Parameters
    ----------
    segment : _Segment
        Stamps. Those at 700 Hz in whole milliseconds have steps of 1 ms and 2 ms, like those at
        1 kHz with missing rows.
    agree : ndarray of bool, shape (stamps - 1,)
        Whether the step is the usual one.

    Notes
    -----
    Rounded stamps deviate from a line by less than the difference of long and short steps, and the
    distances of long steps differ by at most one row. Missing rows make the deviations a random
    walk.
    """
    if not np.any(agree):
        return False
    excess = segment.time_steps[~agree] - np.median(segment.time_steps[agree])
    if excess.size < MIN_LONG_STEPS or np.any(segment.row_steps > 1) or np.any(excess <= 0.0):
        return False
    distances = np.diff(np.flatnonzero(~agree))
    if np.max(distances) - np.min(distances) > 1 or np.ptp(excess) > AGREEMENT * np.max(excess):
        return False
    line = np.polyfit(segment.rows, segment.stamps - segment.stamps[0], 1)
    residuals = segment.stamps - segment.stamps[0] - np.polyval(line, segment.rows)
    return bool(np.ptp(residuals) <= MAX_ROUNDING * np.max(excess))


def _find_median_slope(segment: _Segment) -> float:
    """Return the median of the slopes of all pairs of stamps."""
    first, second = np.triu_indices(len(segment.rows), k=1)
    rise = segment.stamps[second] - segment.stamps[first]
    return float(np.median(rise / (segment.rows[second] - segment.rows[first])))


def _classify(segment: _Segment, interval: float, steps_agree: bool) -> StampKind:
    """Classify stamps as regular, irregular, or jittered.

    Parameters
    ----------
    segment : _Segment
        Stamps without a large jump.
    interval : float
        Sampling interval in s.
    steps_agree : bool
        Whether most steps equal the interval.
    """
    steps = segment.time_steps
    if np.mean(segment.row_steps > 1) > 0.3:
        return StampKind.JITTERED
    backward_count = np.count_nonzero(steps <= 0.0)
    if steps_agree:
        is_disordered = backward_count >= MIN_BACKWARD_STEPS or _has_chunk_jitter(segment, interval)
        if is_disordered and not _is_regular_when_sorted(segment, interval):
            return StampKind.JITTERED
        return StampKind.REGULAR
    if backward_count or _is_rounded(segment, _select_agreeing_steps(segment)):
        return StampKind.JITTERED
    residuals = segment.stamps - interval * segment.rows
    growth = np.var(residuals) / np.var(steps - interval * segment.row_steps)
    return StampKind.IRREGULAR if growth > JITTER_GROWTH else StampKind.JITTERED


def _is_regular_when_sorted(segment: _Segment, interval: float) -> bool:
    """Whether the stamps are regular once they are sorted, as those of exchanged rows."""
    steps = np.diff(np.sort(segment.stamps)) / interval
    return bool(np.mean(np.abs(steps - np.round(steps)) < AGREEMENT) > 0.9 and np.min(steps) > 0.5)


def _has_chunk_jitter(segment: _Segment, interval: float) -> bool:
    """Whether stamps jump back for several rows, as those of chunks with jitter do.

    Parameters
    ----------
    segment : _Segment
        Stamps without a large jump.
    interval : float
        Sampling interval in s.
    """
    levels = []
    for chunk in _split_at_jumps(segment, interval):
        if len(chunk) >= MIN_CHUNK:
            levels.append(np.median(chunk))
    return bool(np.any(np.diff(levels) < -JUMP * interval))


def _split_at_jumps(segment: _Segment, interval: float) -> list[Array]:
    """Split the deviations of stamps from constant intervals where they jump."""
    residuals = segment.stamps - interval * segment.rows
    jumps = np.flatnonzero(np.abs(np.diff(residuals)) > JUMP * interval) + 1
    return np.split(residuals, jumps)


def _split_at_gaps(segment: _Segment, interval: float) -> list[Array]:
    """Split the deviations of stamps at gaps, unless they jump back as well, as jitter does.

    Parameters
    ----------
    segment : _Segment
        Stamps without a large jump.
    interval : float
        Sampling interval in s.
    """
    if 0 < _count_gaps(segment, interval) <= MAX_GAPS:
        return _split_at_jumps(segment, interval)
    return [segment.stamps - interval * segment.rows]


def _count_gaps(segment: _Segment, interval: float) -> int:
    """Return the number of jumps of the deviations, or zero if one of them goes back."""
    jumps = np.diff(segment.stamps - interval * segment.rows)
    if np.any(jumps < -JUMP * interval):
        return 0
    return int(np.count_nonzero(jumps > JUMP * interval))


def _measure_band(segment: _Segment, interval: float) -> float:
    """Return the largest deviation of stamps from constant intervals between gaps."""
    sizes = []
    for part in _split_at_gaps(segment, interval):
        sizes.append(np.max(np.abs(part - np.median(part))))
    return float(max(sizes))


def _find_anchor(segment: _Segment, interval: float, kind: StampKind) -> float:
    """Return the time of row 0 from the first stamp that another one follows as it should.

    Parameters
    ----------
    segment : _Segment
        First stamps without a large jump.
    interval : float
        Sampling interval in s.
    kind : StampKind
        Kind of the stamps: regular ones are followed by another one an interval later, or several.
    """
    if kind is StampKind.REGULAR and _is_regular_when_sorted(segment, interval):
        return float(np.min(segment.stamps) - interval * segment.rows[0])
    rates = segment.time_steps / segment.row_steps / interval
    multiples = np.maximum(np.round(rates), 1.0)
    pairs = np.flatnonzero(np.abs(rates - multiples) <= JUMP)
    anchor = pairs[0] if pairs.size and kind is StampKind.REGULAR else 0
    return float(segment.stamps[anchor] - interval * segment.rows[anchor])
