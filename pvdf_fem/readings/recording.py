"""Recordings: sampled channels of a logger's file, which are read in blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from typing import NamedTuple

from pvdf_fem.arrays import Array
from pvdf_fem.readings.columns import Column


class SampleBlock(NamedTuple):
    """Consecutive samples of all channels of a recording."""

    times_s: Array  #: Shape (samples,), in s; NaN if they are not known.
    #: Shape (samples, channels), each channel in its unit. NaN is a missing sample; ∞ and -∞ are
    #: samples that the instrument has marked as above or below its range.
    values: Array


@dataclass(frozen=True, eq=False)
class Recording:
    """The samples of channels in a logger's file.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    columns : tuple of Column
        The channels with their units: the name is that of an electrode, and the heading the address
        of the channel in the file.
    blocks : iterator of SampleBlock
        The samples, which are read from the file while it is open. It can be used once.
    has_times : bool
        Whether the times of the samples are known.
    start : datetime, optional
        The time at which `times_s` is 0, if the file has it before its samples.
    rate_Hz : float, optional
        The nominal sampling rate, if the file has it.
    notes : list of str
        Sentences about anything in the file that its user should know, such as a last block that
        is incomplete. Reading the blocks may append to it.
    """

    name: str
    columns: tuple[Column, ...]
    blocks: Iterator[SampleBlock]
    has_times: bool = True
    start: datetime | None = None
    rate_Hz: float | None = None
    notes: list[str] = field(default_factory=list)
