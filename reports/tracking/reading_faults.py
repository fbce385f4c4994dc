"""Faults of single readings: empty cells and rows, channels that fail, and spikes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from reports.tracking.fault import (
    draw_channel,
    draw_row,
    draw_row_in_press,
    excuse_hidden_presses,
    replace_readings,
)
from reports.tracking.stream import Stream

EVERY = slice(None)  #: All channels, or all rows.
SPIKES_V = (5.0, -5.0, 1000.0, -1e300, 1e160)  #: Values of disturbed samples.
#: Further values: 0.3 V is in the range of a touch, and the square of 1e308 overflows.
ALL_SPIKES_V = (0.3, *SPIKES_V, 1e308)
SETTLING_S = 0.4  #: Spikes while settling are within this time from the start.


def empty_cell(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty one cell."""
    row = draw_row(stream, random)
    stream = replace_readings(stream, row, draw_channel(stream, random), np.nan)
    return stream.describe(f"a cell of row {row} is empty")


def empty_cell_at_onset(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty one cell within a few rows of the start of a press."""
    press = stream.presses[random.integers(len(stream.presses))]
    row = int(np.searchsorted(stream.true_s, press.begin_s) + random.integers(-3, 8))
    stream = replace_readings(stream, row, draw_channel(stream, random), np.nan)
    return stream.describe(f"a cell of row {row} is empty")


def empty_row(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty one row during a press."""
    row = draw_row_in_press(stream, random)
    return replace_readings(stream, row, EVERY, np.nan).describe(f"row {row} is empty")


def empty_rows(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty 10 to 30 rows during a press."""
    begin = draw_row_in_press(stream, random)
    end = begin + int(random.integers(10, 31))
    stream = replace_readings(stream, slice(begin, end), EVERY, np.nan)
    return excuse_hidden_presses(stream).describe(f"rows {begin} to {end} are empty")


def empty_rows_before_press(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty 10 to 30 rows that end 0.1 s before a press."""
    press = stream.presses[random.integers(len(stream.presses))]
    end = int(np.searchsorted(stream.true_s, press.begin_s - 0.1))
    begin = max(end - int(random.integers(10, 31)), 0)
    stream = replace_readings(stream, slice(begin, end), EVERY, np.nan)
    return stream.describe(f"rows {begin} to {end} are empty")


def empty_cells(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty 0.5 % of the cells."""
    is_empty = random.random(stream.readings_V.shape) < 0.005
    is_empty[~stream.is_in_window] = False
    readings_V = np.where(is_empty, np.nan, stream.readings_V)
    is_seen = stream.is_seen & ~is_empty
    return stream.describe("0.5 % of the cells are empty", readings_V=readings_V, is_seen=is_seen)


def lack_channel(stream: Stream, random: np.random.Generator) -> Stream:
    """Empty a channel for the whole stream."""
    channel = draw_channel(stream, random)
    stream = replace_readings(stream, EVERY, channel, np.nan)
    return stream.describe(f"{stream.names[channel]} is empty")


def _fail_channel(
    stream: Stream, random: np.random.Generator, value_V: float | None, *, returns: bool
) -> Stream:
    """Let a channel fail at a random time.

    Parameters
    ----------
    stream : Stream
        The stream.
    random : numpy.random.Generator
        Source of the channel and of the times.
    value_V : float or None
        Readings from then on. None repeats the last reading.
    returns : bool
        Whether the channel works again after 0.3 to 2 s, with another offset.
    """
    channel = draw_channel(stream, random)
    begin = draw_row(stream, random)
    end = len(stream.true_s)
    offset_V = 0.0
    if returns:
        end_s = stream.true_s[begin] + random.uniform(0.3, 2.0)
        end = int(np.searchsorted(stream.true_s, end_s))
        offset_V = random.uniform(-0.4, 0.4)
    if value_V is None:
        value_V = float(stream.readings_V[begin - 1, channel])
    stream = replace_readings(stream, slice(begin, end), channel, value_V)
    readings_V = stream.readings_V.copy()
    readings_V[end:, channel] += offset_V
    story = f"{stream.names[channel]} reads {value_V:.3g} V in rows {begin} to {end}"
    stream = replace(stream, readings_V=readings_V)
    return stream.describe(f"{story}, then {offset_V:+.3f} V more")


def fail_to_zero(stream: Stream, random: np.random.Generator) -> Stream:
    """Let a channel read 0 for a while, and then work again with an offset."""
    return _fail_channel(stream, random, 0.0, returns=True)


def fail_to_empty(stream: Stream, random: np.random.Generator) -> Stream:
    """Let the cells of a channel be empty for a while, and then have an offset."""
    return _fail_channel(stream, random, np.nan, returns=True)


def freeze_channel(stream: Stream, random: np.random.Generator) -> Stream:
    """Let a channel repeat its last reading for a while, and then work again with an offset."""
    return _fail_channel(stream, random, None, returns=True)


def kill_channel(stream: Stream, random: np.random.Generator) -> Stream:
    """Let a channel read 0 until the end."""
    return _fail_channel(stream, random, 0.0, returns=False)


def _spike(
    stream: Stream,
    rows: Sequence[int],
    channels: Sequence[int],
    value_V: float,
    *,
    length: int = 1,
) -> Stream:
    """Replace readings of one or several rows by a value, each time in one channel.

    Parameters
    ----------
    stream : Stream
        The stream.
    rows, channels : sequence of int
        First row and channel of each spike.
    value_V : float
        Reading during a spike in V.
    length : int, optional
        Number of rows of a spike.
    """
    for row, channel in zip(rows, channels, strict=True):
        stream = replace_readings(stream, slice(row, row + length), channel, value_V)
    return stream.describe(f"{len(rows)} spikes of {value_V:g} V and {length} rows")


def add_spike(stream: Stream, random: np.random.Generator) -> Stream:
    """Add one spike."""
    value_V = float(random.choice(ALL_SPIKES_V))
    return _spike(stream, [draw_row(stream, random)], [draw_channel(stream, random)], value_V)


def add_spike_in_press(stream: Stream, random: np.random.Generator) -> Stream:
    """Add one spike during a press."""
    row = draw_row_in_press(stream, random)
    value_V = float(random.choice(SPIKES_V))
    return _spike(stream, [row], [draw_channel(stream, random)], value_V)


def add_spikes(stream: Stream, random: np.random.Generator) -> Stream:
    """Replace 0.2 % of the readings by 5 V."""
    is_spike = random.random(stream.readings_V.shape) < 0.002
    is_spike[~stream.is_in_window] = False
    readings_V = np.where(is_spike, 5.0, stream.readings_V)
    is_seen = stream.is_seen & ~is_spike
    return stream.describe("0.2 % spikes of 5 V", readings_V=readings_V, is_seen=is_seen)


def add_spikes_while_settling(stream: Stream, random: np.random.Generator) -> Stream:
    """Add up to three spikes while the tracker settles."""
    count = int(random.integers(1, 4))
    rows = random.integers(0, int(SETTLING_S * stream.rate_Hz), size=count)
    channels = random.integers(0, len(stream.names), size=count)
    return _spike(stream, rows.tolist(), channels.tolist(), float(random.choice(SPIKES_V)))


def add_spike_bursts(stream: Stream, random: np.random.Generator) -> Stream:
    """Add up to five spikes of two to four rows."""
    count = int(random.integers(1, 6))
    rows = [draw_row(stream, random) for _ in range(count)]
    channels = random.integers(0, len(stream.names), size=count)
    value_V = float(random.choice(SPIKES_V))
    return _spike(stream, rows, channels.tolist(), value_V, length=int(random.integers(2, 5)))


def add_common_spikes(stream: Stream, random: np.random.Generator) -> Stream:
    """Add up to five spikes that occur in all channels at once."""
    rows = np.array([draw_row(stream, random) for _ in range(random.integers(1, 6))])
    stream = replace_readings(stream, rows, EVERY, 5.0)
    return stream.describe(f"rows {rows.tolist()} read 5 V")
