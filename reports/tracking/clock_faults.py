"""Faults of the times of rows: stamps that repeat, jitter, wrap or jump, and rows that are missing.

`Stream.stamps_s` are the times that the logger writes; the true times do not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from reports.tracking.fault import draw_row, excuse_press_at
from reports.tracking.stream import ClockJump, Stream

#: Time in s after which a counter of 32 bits begins anew.
MICROSECOND_WRAP_S = 2.0**32 * 1e-6
MILLISECOND_WRAP_S = 2.0**32 * 1e-3
#: Stamps of rows that a disturbed logger writes.
WILD_STAMPS_S = (0.0, -1.0, 1e5, 4294.967295, 1e9, 1e300, -1e300, np.inf)


def repeat_one_stamp(stream: Stream, random: np.random.Generator) -> Stream:
    """Write one time twice."""
    row = draw_row(stream, random)
    stamps_s = stream.stamps_s.copy()
    stamps_s[row] = stamps_s[row - 1]
    return stream.describe(f"stamp {row} repeats", stamps_s=stamps_s)


def repeat_stamps(stream: Stream, random: np.random.Generator) -> Stream:
    """Write the time of the row before in 1 % of the rows."""
    is_repeated = (random.random(len(stream.true_s)) < 0.01) & stream.is_in_window
    rows = np.flatnonzero(is_repeated)
    stamps_s = stream.stamps_s.copy()
    stamps_s[rows] = stamps_s[rows - 1]
    return stream.describe(f"{len(rows)} stamps repeat", stamps_s=stamps_s)


def exchange_rows(stream: Stream, random: np.random.Generator) -> Stream:
    """Exchange up to five pairs of neighbouring rows."""
    order = np.arange(len(stream.true_s))
    count = int(random.integers(1, 6))
    for _ in range(count):
        row = draw_row(stream, random)
        order[[row, row + 1]] = order[[row + 1, row]]
    return stream.select_rows(order).describe(f"{count} pairs of rows exchanged")


def _jitter(stream: Stream, random: np.random.Generator, intervals: float) -> Stream:
    """Add Gaussian jitter to the stamps.

    Parameters
    ----------
    stream : Stream
        The stream.
    random : numpy.random.Generator
        Source of the jitter.
    intervals : float
        Standard deviation of the jitter in sampling intervals.
    """
    jitter_s = intervals / stream.rate_Hz * random.standard_normal(len(stream.true_s))
    jitter_s[~stream.is_in_window] = 0.0
    story = f"jitter of {intervals:.2f} intervals"
    return stream.describe(story, stamps_s=stream.stamps_s + jitter_s)


def jitter_stamps(stream: Stream, random: np.random.Generator) -> Stream:
    """Let the stamps jitter, but so little that hardly any two are exchanged."""
    return _jitter(stream, random, random.uniform(0.05, 0.3))


def jitter_stamps_backwards(stream: Stream, random: np.random.Generator) -> Stream:
    """Let the stamps jitter so much that they go backwards, as those of streaming inlets may."""
    return _jitter(stream, random, random.uniform(0.6, 3.0))


def stamp_bursts(stream: Stream, random: np.random.Generator) -> Stream:
    """Write one time for each block of rows, like a driver that reads a buffer."""
    size = int(random.choice([2, 4, 8, 16, 32, 64]))
    block = np.arange(len(stream.true_s)) // size * size
    return stream.describe(f"blocks of {size} rows", stamps_s=stream.stamps_s[block])


def stamp_chunks(stream: Stream, random: np.random.Generator) -> Stream:
    """Write the time of the last row for each chunk of random size, like Lab Streaming Layer."""
    count = len(stream.true_s)
    sizes = 1 + random.poisson(max(2.0, 0.02 * stream.rate_Hz), size=count)
    ends = np.minimum(np.cumsum(sizes), count) - 1
    last = ends[np.searchsorted(ends, np.arange(count))]
    delay_s = 1e-3 * np.abs(random.standard_normal(count))
    stamps_s = stream.stamps_s[last] + delay_s[last]
    return stream.describe(f"chunks of about {sizes.mean():.0f} rows", stamps_s=stamps_s)


def truncate_stamps(stream: Stream, random: np.random.Generator) -> Stream:
    """Write times in whole milliseconds."""
    stamps_s = np.floor(1e3 * stream.stamps_s + 1e-6) / 1e3
    return stream.describe("times in whole ms", stamps_s=stamps_s)


def _wrap(
    stream: Stream, random: np.random.Generator, *, period_s: float, tick_s: float, low_s: float
) -> Stream:
    """Count the time in ticks, by a counter that wraps during the stream.

    Parameters
    ----------
    stream : Stream
        The stream.
    random : numpy.random.Generator
        Source of the time of the wrap.
    period_s : float
        Period of the counter in s.
    tick_s : float
        Resolution of the counter in s.
    low_s : float
        Lowest time of the counter in s, at which it begins anew.
    """
    wrap_s = random.uniform(0.3, stream.seconds)
    counted_s = stream.stamps_s - stream.stamps_s[0] - wrap_s + period_s
    ticks = np.floor(np.mod(counted_s, period_s) / tick_s + 1e-6)
    stamps_s = tick_s * ticks + low_s
    return stream.describe(f"wraps after {wrap_s:.2f} s", stamps_s=stamps_s)


def wrap_microseconds(stream: Stream, random: np.random.Generator) -> Stream:
    """Count microseconds in 32 bits without a sign."""
    return _wrap(stream, random, period_s=MICROSECOND_WRAP_S, tick_s=1e-6, low_s=0.0)


def wrap_signed_microseconds(stream: Stream, random: np.random.Generator) -> Stream:
    """Count microseconds in 32 bits with a sign, so that the counter wraps to a negative time."""
    low_s = -0.5 * MICROSECOND_WRAP_S
    return _wrap(stream, random, period_s=MICROSECOND_WRAP_S, tick_s=1e-6, low_s=low_s)


def wrap_milliseconds(stream: Stream, random: np.random.Generator) -> Stream:
    """Count milliseconds in 32 bits without a sign."""
    return _wrap(stream, random, period_s=MILLISECOND_WRAP_S, tick_s=1e-3, low_s=0.0)


def start_below_zero(stream: Stream, random: np.random.Generator) -> Stream:
    """Begin at a negative time, like recordings with a trigger."""
    begin_s = -float(random.choice([1.0, 20.0, 30.0, 50.0, 100.0, 1e4]))
    return stream.describe(f"begins at {begin_s:g} s", stamps_s=stream.stamps_s + begin_s)


def start_at_date(stream: Stream, random: np.random.Generator) -> Stream:
    """Write the seconds since 1970."""
    return stream.describe("seconds since 1970", stamps_s=stream.stamps_s + 1.7644e9)


def _jump(stream: Stream, row: int, step_s: float) -> Stream:
    """Let the clock jump, and excuse a press at this time.

    Parameters
    ----------
    stream : Stream
        The stream.
    row : int
        First row after the jump.
    step_s : float
        Change of the stamps in s; negative for a jump back.
    """
    stamps_s = stream.stamps_s.copy()
    stamps_s[row:] += step_s
    if step_s > 0.0:
        jump = ClockJump(float(stream.true_s[row]), step_s)
        stream = replace(stream, forward_jumps=(*stream.forward_jumps, jump))
    stream = excuse_press_at(stream, row)
    return stream.describe(f"jumps by {step_s:+.3f} s at row {row}", stamps_s=stamps_s)


def jump_back(stream: Stream, random: np.random.Generator) -> Stream:
    """Set the clock back by 35 ms to 13 s."""
    step_s = random.choice([0.05, 0.5, 1.5, 10.0]) * random.uniform(0.7, 1.3)
    return _jump(stream, draw_row(stream, random), -step_s)


def restart_clock(stream: Stream, random: np.random.Generator) -> Stream:
    """Let the clock start again at its first time."""
    row = draw_row(stream, random)
    return _jump(stream, row, stream.stamps_s[0] - stream.stamps_s[row])


def jump_forward(stream: Stream, random: np.random.Generator) -> Stream:
    """Set the clock forward by 0.2 s to more than an hour."""
    step_s = random.choice([0.3, 2.0, 60.0, 3600.0]) * random.uniform(0.7, 1.3)
    return _jump(stream, draw_row(stream, random), step_s)


def drop_rows(stream: Stream, random: np.random.Generator) -> Stream:
    """Write no rows for 0.5 to 1.5 s; presses in this time are excused."""
    length_s = random.uniform(0.5, 1.5)
    window = stream.window
    begin_s = random.uniform(window.begin_s, window.end_s - length_s)
    end_s = begin_s + length_s
    is_kept = (stream.true_s < begin_s) | (stream.true_s >= end_s)
    stream = stream.select_rows(is_kept).excuse(begin_s, end_s)
    return stream.describe(f"no rows from {begin_s:.2f} to {end_s:.2f} s")


def drop_single_rows(stream: Stream, random: np.random.Generator) -> Stream:
    """Leave out 0.5 % of the rows."""
    is_dropped = (random.random(len(stream.true_s)) < 0.005) & stream.is_in_window
    return stream.select_rows(~is_dropped).describe(f"{is_dropped.sum()} single rows missing")


def _replace_stamps(
    stream: Stream, random: np.random.Generator, values_s: Sequence[float]
) -> Stream:
    """Replace up to three stamps by random values.

    Parameters
    ----------
    stream : Stream
        The stream.
    random : numpy.random.Generator
        Source of the rows and the values.
    values_s : sequence of float
        Values in s from which those of the stamps are drawn.
    """
    stamps_s = stream.stamps_s.copy()
    count = int(random.integers(1, 4))
    for _ in range(count):
        stamps_s[draw_row(stream, random)] = random.choice(values_s)
    return stream.describe(f"{count} stamps replaced", stamps_s=stamps_s)


def lose_stamps(stream: Stream, random: np.random.Generator) -> Stream:
    """Write no time in up to three rows."""
    return _replace_stamps(stream, random, [np.nan])


def make_stamps_wild(stream: Stream, random: np.random.Generator) -> Stream:
    """Write arbitrary times in up to three rows."""
    return _replace_stamps(stream, random, WILD_STAMPS_S)


def change_rate(stream: Stream, random: np.random.Generator) -> Stream:
    """Let the rate of the clock change slowly by up to 0.2 %."""
    change = random.uniform(-2e-3, 2e-3)
    rates = 1.0 + change * np.linspace(0.0, 1.0, len(stream.true_s) - 1)
    steps_s = np.diff(stream.stamps_s) * rates
    stamps_s = stream.stamps_s[0] + np.concatenate([[0.0], np.cumsum(steps_s)])
    return replace(stream, stamps_s=stamps_s).describe(f"rate changes by {change:+.4f}")
