"""Rows of a stream, before and after they are given a time."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from typing import NamedTuple


class ClockEvent(Enum):
    """Relation between a sample and the one before."""

    FIRST = auto()  #: There is no sample before.
    TICK = auto()  #: The sample follows the one before.
    ESTIMATED = auto()  #: The sample follows the one before; its stamp was useless.
    GAP = auto()  #: Samples are missing between the two.
    RESTART = auto()  #: The stamps went back; the time continues.


class StreamRow(NamedTuple):
    """Sample as it was received."""

    number: int  #: Number in the stream, from 0.
    stamp_s: float
    values: Sequence[float]


class TimedRow(NamedTuple):
    """Sample with its time relative to the first stamp."""

    time_s: float
    values: Sequence[float]
    event: ClockEvent
    gap_s: float = 0.0  #: Time that is missing before it, beyond one interval.
