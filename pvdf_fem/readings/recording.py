"""Recordings: sampled channels of a logger's file."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from pvdf_fem.arrays import Array
from pvdf_fem.readings.columns import Column


@dataclass(frozen=True, eq=False)
class Recording:
    """The samples of channels in a logger's file.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    columns : tuple of Column
        The channels with their units. The times are not among them.
    values : ndarray, shape (samples, channels)
        The samples of each channel in its unit. NaN is a missing sample; ∞ and -∞ are samples that
        the instrument has marked as above or below its range.
    times_s : ndarray, shape (samples,), optional
        Times of the samples, in s from `start` if that is known. None if the file has neither
        times nor a rate.
    start : datetime, optional
        The time at which `times_s` is 0, if the file has it.
    rate_Hz : float, optional
        The nominal sampling rate, if the file has it.
    notes : tuple of str
        Sentences about anything in the file that its user should know, such as a last block that
        is incomplete.
    """

    name: str
    columns: tuple[Column, ...]
    values: Array
    times_s: Array | None = None
    start: datetime | None = None
    rate_Hz: float | None = None
    notes: tuple[str, ...] = ()
