"""The first samples of a stream, and channels without a signal or at a limit in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample

#: Smallest fraction of the readings that a channel with a signal has; loggers that read four
#: channels in turn leave a quarter.
MIN_MEASURED_FRACTION = 0.15
MIN_CAPACITY = 64  #: Number of samples that the arrays of `FirstSamples` hold at first.
#: A channel lies at the end of its range if more than this fraction of its readings equal its
#: extreme one, though it has so many different readings.
MAX_EXTREME_FRACTION = 0.2
MIN_DISTINCT_VOLTAGES = 10


class FirstSamples:
    """Samples in arrays that grow.

    Many samples as objects would let Python's garbage collector visit all objects of the program,
    which stops a stream for tens of milliseconds.

    Parameters
    ----------
    channel_count : int
        Number of channels.
    """

    def __init__(self, channel_count: int) -> None:
        self._count = 0
        self._times_s = np.zeros(MIN_CAPACITY)
        self._voltages = np.zeros((MIN_CAPACITY, channel_count))
        self._is_clipped = np.zeros((MIN_CAPACITY, channel_count), dtype=bool)
        self._follows_pause = np.zeros(MIN_CAPACITY, dtype=bool)
        self._clipped_before = np.zeros((MIN_CAPACITY, channel_count), dtype=int)

    def __len__(self) -> int:
        return self._count

    @property
    def times_s(self) -> Array:
        """Times of the samples, shape (n,)."""
        return self._times_s[: self._count]

    @property
    def voltages(self) -> Array:
        """Voltages in V, NaN where they are missing or clipped, shape (n, electrodes)."""
        voltages = self._voltages[: self._count]
        return np.where(self._is_clipped[: self._count], np.nan, voltages)

    def add(self, sample: FilteredSample) -> None:
        """Add a sample."""
        index = self._count
        if index == len(self._times_s):
            self._keep_rows(slice(None), 2 * index)
        self._times_s[index] = sample.time_s
        self._voltages[index] = sample.voltages
        self._is_clipped[index] = sample.is_clipped
        self._follows_pause[index] = sample.follows_pause
        self._clipped_before[index] = sample.clipped_before or 0
        self._count = index + 1

    def drop_older_half(self) -> None:
        """Remove the older half of the samples."""
        newer = slice(self._count // 2, self._count)
        self._keep_rows(newer, len(self._times_s))
        self._count -= newer.start

    def _keep_rows(self, rows: slice, capacity: int) -> None:
        """Replace the arrays by others with some of the rows in front."""
        self._times_s = _copy_rows(self._times_s[rows], capacity)
        self._voltages = _copy_rows(self._voltages[rows], capacity)
        self._is_clipped = _copy_rows(self._is_clipped[rows], capacity)
        self._follows_pause = _copy_rows(self._follows_pause[rows], capacity)
        self._clipped_before = _copy_rows(self._clipped_before[rows], capacity)

    def make_samples(self, first: int, voltages: Array) -> list[FilteredSample]:
        """Make the samples from one on, with other voltages.

        Parameters
        ----------
        first : int
            Number of the first sample.
        voltages : ndarray, shape (samples, electrodes)
            Voltages in V; NaN where they are missing.
        """
        rows = slice(first, self._count)
        samples = []
        for time_s, cleaned, is_clipped, follows_pause, clipped_before in zip(
            self._times_s[rows].tolist(),
            voltages.tolist(),
            self._is_clipped[rows].tolist(),
            self._follows_pause[rows].tolist(),
            self._clipped_before[rows].tolist(),
            strict=True,
        ):
            counts = clipped_before if any(clipped_before) else ()
            samples.append(
                FilteredSample(time_s, cleaned, is_clipped, follows_pause, clipped_before=counts)
            )
        return samples


def _copy_rows(values: NDArray[Any], capacity: int) -> NDArray[Any]:
    """Copy rows to the front of an array with more rows, the others of which are zero."""
    copy = np.zeros((capacity, *values.shape[1:]), dtype=values.dtype)
    copy[: len(values)] = values
    return copy


def find_signals(voltages: Array) -> Mask:
    """Mark the channels that have a signal, shape (electrodes,).

    A channel has no signal if all but a few of its voltages are missing, or if they are all equal
    although those of another channel are not.
    """
    is_measured = ~np.isnan(voltages)
    has_values = is_measured.sum(axis=0) > MIN_MEASURED_FRACTION * len(voltages)
    lowest = np.where(is_measured, voltages, np.inf).min(axis=0)
    highest = np.where(is_measured, voltages, -np.inf).max(axis=0)
    varies = lowest < highest
    return np.asarray(has_values & (varies | ~varies.any()))


def find_channels_at_limit(voltages: Array) -> Mask:
    """Mark the channels whose unloaded reading lies at the end of a converter's range.

    Many of their voltages then equal the lowest or the highest one, though others are spread.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V; NaN where they are missing.

    Returns
    -------
    ndarray of bool, shape (electrodes,)
    """
    is_at_limit = []
    for values in voltages.T:
        measured = values[~np.isnan(values)]
        if len(np.unique(measured)) < MIN_DISTINCT_VOLTAGES:
            is_at_limit.append(False)
            continue
        share = max(np.mean(measured == measured.min()), np.mean(measured == measured.max()))
        is_at_limit.append(bool(share > MAX_EXTREME_FRACTION))
    return np.array(is_at_limit)


def compute_medians(values: Array) -> Array:
    """Compute medians along the first axis without missing values; 0 where all are missing."""
    is_measured = ~np.isnan(values)
    ordered = np.sort(values, axis=0)  # NaN comes last
    count = is_measured.sum(axis=0)
    middle = np.maximum(count - 1, 0) // 2
    median = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.where(count > 0, median, 0.0)
