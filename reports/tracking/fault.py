"""A fault of a measuring chain, and small helpers that several faults share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from pvdf_fem.arrays import Indices
from reports.tracking.stream import Stream


class Stage(IntEnum):
    """Stages of a measuring chain, in the order in which they act on a signal."""

    SIGNAL = 0  #: The analogue signal.
    CONVERTER = 1  #: The range and the resolution of the converter.
    SAMPLE = 2  #: Single converted values.
    ROW = 3  #: Rows of the record.
    COUNTER = 4  #: The counter that gives the times of the rows.
    STAMP = 5  #: Times as the logger writes them.


@dataclass(frozen=True)
class Fault:
    """A kind of fault; each stream draws its parameters anew.

    Parameters
    ----------
    name : str
        Name in tables.
    apply : callable
        Function of a stream and a random generator that returns the faulty stream.
    stage : Stage
        Where in the measuring chain the fault acts.
    message : str
        Regular expression that a message, a status or a list of missing channels has to match. It
        is empty if no message is required.
    rate_Hz : float, optional
        Sampling rate that the fault requires.
    least_rate_Hz : float
        Lowest sampling rate at which the fault makes sense.
    sets_origin : bool
        Whether the fault determines the first time of the record.
    is_event : bool
        Whether the fault occurs at one time, so that a long stream may have it many times.
    is_early : bool
        Whether there is a press while the tracker settles.
    mixes : bool
        Whether the fault may be combined with others.
    """

    name: str
    apply: Callable[[Stream, np.random.Generator], Stream]
    stage: Stage
    message: str = ""
    rate_Hz: float | None = None
    least_rate_Hz: float = 0.0
    sets_origin: bool = False
    is_event: bool = False
    is_early: bool = False
    mixes: bool = True


def apply_faults(stream: Stream, faults: tuple[Fault, ...], random: np.random.Generator) -> Stream:
    """Apply faults in the order of the measuring chain.

    Parameters
    ----------
    stream : Stream
        The stream.
    faults : tuple of Fault
        The faults, in any order.
    random : numpy.random.Generator
        Source of the parameters of the faults.

    Returns
    -------
    Stream
    """
    for fault in sorted(faults, key=lambda fault: fault.stage):
        stream = fault.apply(stream, random)
    return stream


def draw_row(stream: Stream, random: np.random.Generator) -> int:
    """Draw any row in the window of the stream, with or without a press."""
    return int(np.searchsorted(stream.true_s, random.uniform(*stream.window)))


def draw_row_in_press(stream: Stream, random: np.random.Generator) -> int:
    """Draw a row during a press in the window of the stream; any row if there is no press."""
    presses = stream.presses_in_window
    if not presses:
        return draw_row(stream, random)
    press = presses[random.integers(len(presses))]
    time_s = press.begin_s + random.uniform(0.15, 0.85) * press.duration_s
    return int(np.searchsorted(stream.true_s, time_s))


def draw_channel(stream: Stream, random: np.random.Generator) -> int:
    """Draw the index of a channel."""
    return int(random.integers(len(stream.names)))


def replace_readings(
    stream: Stream, rows: slice | int | Indices, channels: slice | int, value_V: float
) -> Stream:
    """Replace readings by a value that has nothing to do with their channels.

    Parameters
    ----------
    stream : Stream
        The stream.
    rows : slice, int or array of int
        Rows to replace.
    channels : slice or int
        Channels to replace.
    value_V : float
        New readings in V; NaN for empty cells.
    """
    readings_V = stream.readings_V.copy()
    readings_V[rows, channels] = value_V
    is_seen = stream.is_seen.copy()
    is_seen[rows, channels] = False
    return replace(stream, readings_V=readings_V, is_seen=is_seen)


def excuse_press_at(stream: Stream, row: int) -> Stream:
    """Excuse a press at a row where the time is lost."""
    time_s = float(stream.true_s[row])
    interval_s = 1.0 / stream.rate_Hz
    return stream.excuse(time_s - interval_s, time_s + interval_s)


def excuse_hidden_presses(stream: Stream) -> Stream:
    """Excuse presses in which at least half of the rows are incomplete."""
    is_complete = np.all(stream.is_seen, axis=1)
    for press in stream.presses:
        begin, end = np.searchsorted(stream.true_s, [press.begin_s, press.end_s])
        if 2 * np.count_nonzero(is_complete[begin:end]) <= end - begin:
            stream = stream.excuse(press.begin_s, press.end_s)
    return stream
