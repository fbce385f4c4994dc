"""Samples of a contact in bounded memory: the older a contact, the coarser they are kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample, ChargeValues

#: Number of rows, which is halved when it is reached. A contact then keeps at least 256 rows, of
#: which an end of 1/16 (`TrackOptions.still_fraction`) has 16.
CAPACITY = 512
#: Number of samples of an incomplete row that are averaged together, in a tenth of the time
#: of averaging them one by one.
BLOCK_SIZE = 16


class BufferedSamples(NamedTuple):
    """Samples in arrays whose first axis is that of the samples; see `ChargeSample`."""

    time_s: Array  #: Shape (samples,).
    charges_pC: Array  #: Shape (samples, electrodes), as the next ones.
    noise_variance: Array
    walk_variance: Array
    drift_pC: Array
    sampling_variance: Array  #: Shape (samples,).
    is_clipped: Mask
    voltages: Array  #: Voltages in V above the line of the baseline; NaN where missing.

    def select(self, index: slice | int) -> BufferedSamples:
        """Return some of the samples, or a single one, without copying them."""
        return BufferedSamples(
            self.time_s[index],
            self.charges_pC[index],
            noise_variance=self.noise_variance[index],
            walk_variance=self.walk_variance[index],
            drift_pC=self.drift_pC[index],
            sampling_variance=self.sampling_variance[index],
            is_clipped=self.is_clipped[index],
            voltages=self.voltages[index],
        )

    def get_sample(self, index: int) -> ChargeSample:
        """Return one of the samples."""
        return ChargeSample(
            float(self.time_s[index]),
            self.charges_pC[index],
            noise_variance=self.noise_variance[index],
            walk_variance=self.walk_variance[index],
            drift_pC=self.drift_pC[index],
            sampling_variance=float(self.sampling_variance[index]),
            is_clipped=self.is_clipped[index],
        )


class SampleArrays:
    """Arrays of a fixed number of samples, into which one is written at a time.

    Parameters
    ----------
    count : int
        Number of samples.
    electrode_count : int
        Number of electrodes.
    """

    def __init__(self, count: int, electrode_count: int) -> None:
        # One array, into which the numbers of a sample are written at once.
        self._numbers = np.zeros((count, 5, electrode_count))
        self.samples = BufferedSamples(
            np.zeros(count),
            self._numbers[:, 0],
            noise_variance=self._numbers[:, 1],
            walk_variance=self._numbers[:, 2],
            drift_pC=self._numbers[:, 3],
            sampling_variance=np.zeros(count),
            is_clipped=np.zeros((count, electrode_count), dtype=bool),
            voltages=self._numbers[:, 4],
        )

    def write(
        self, index: int, sample: ChargeValues | ChargeSample, voltages: Sequence[float] | Array
    ) -> None:
        """Write a sample and its voltages.

        Parameters
        ----------
        index : int
            Number of the sample in the arrays.
        sample : ChargeValues or ChargeSample
            Charges and their errors.
        voltages : sequence of float
            Voltages in V above the line of the baseline.
        """
        self._numbers[index] = (
            sample.charges_pC,
            sample.noise_variance,
            sample.walk_variance,
            sample.drift_pC,
            voltages,
        )
        self.samples.time_s[index] = sample.time_s
        self.samples.sampling_variance[index] = sample.sampling_variance
        self.samples.is_clipped[index] = sample.is_clipped

    def replace(self, index: int | slice, samples: BufferedSamples) -> None:
        """Replace one or several samples by others."""
        for values, new in zip(self.samples, samples, strict=True):
            values[index] = new

    def mark_clipped(self, number: int, index: slice) -> None:
        """Mark the charges of an electrode as limits, which have no variance of their own."""
        self.samples.is_clipped[index, number] = True
        self.samples.noise_variance[index, number] = ChargeSample.MISSING

    def exclude_channel(self, number: int) -> None:
        """Count the charges of an electrode as missing in all samples."""
        self.samples.charges_pC[:, number] = 0.0
        self.samples.noise_variance[:, number] = ChargeSample.MISSING


class SampleBuffer:
    """A growing number of samples in a bounded number of rows.

    When all rows are filled, each pair of neighbours is replaced by its mean. From then on each
    row is the mean of twice as many samples. The last samples wait in a block until they are
    averaged, see `BLOCK_SIZE`.

    Parameters
    ----------
    electrode_count : int
        Number of electrodes.
    """

    def __init__(self, electrode_count: int) -> None:
        self._rows = SampleArrays(CAPACITY, electrode_count)
        self._block = SampleArrays(BLOCK_SIZE, electrode_count)
        self.row_count = 0  #: Number of complete rows.
        self.samples_per_row = 1
        self._partial_count = 0  # Number of samples in the row that is not complete, ...
        self._block_count = 0  # ... and how many of them are still in the block.

    def __len__(self) -> int:
        return self.row_count

    @property
    def sample_count(self) -> int:
        """Number of samples that were added."""
        return self.row_count * self.samples_per_row + self._partial_count

    @property
    def is_halved_by_next(self) -> bool:
        """Whether the next sample completes the last row, so that the rows become coarser."""
        is_last_row = self.row_count == CAPACITY - 1
        return is_last_row and self._partial_count == self.samples_per_row - 1

    @property
    def rows(self) -> BufferedSamples:
        """The complete rows."""
        return self._rows.samples.select(slice(self.row_count))

    def add(self, sample: ChargeValues | ChargeSample, voltages: Sequence[float] | Array) -> None:
        """Add a sample.

        Parameters
        ----------
        sample : ChargeValues or ChargeSample
            The sample.
        voltages : sequence of float
            Its voltages in V above the line of the baseline.
        """
        if self.samples_per_row == 1:
            self._rows.write(self.row_count, sample, voltages)
            self.row_count += 1
        else:
            self._add_to_block(sample, voltages)
        if self.row_count == CAPACITY:
            self._halve()

    def _add_to_block(
        self, sample: ChargeValues | ChargeSample, voltages: Sequence[float] | Array
    ) -> None:
        """Add a sample to the incomplete row; see `add`."""
        self._block.write(self._block_count, sample, voltages)
        self._block_count += 1
        self._partial_count += 1
        is_complete = self._partial_count == self.samples_per_row
        if is_complete or self._block_count == BLOCK_SIZE:
            self._merge_block()
        if is_complete:
            self._partial_count = 0
            self.row_count += 1

    def mark_clipped(self, number: int, count: int) -> None:
        """Mark the charges of an electrode in the rows of the last samples as limits.

        Parameters
        ----------
        number : int
            Number of the electrode.
        count : int
            Number of samples. Rows that hold only some of them are marked, too, and the row that is
            not complete.
        """
        partial_count = self._partial_count
        complete_count = max(count - partial_count, 0)
        first = self.row_count - math.ceil(complete_count / self.samples_per_row)
        end = self.row_count + 1 if partial_count else self.row_count
        self._rows.mark_clipped(number, slice(max(first, 0), end))
        self._block.mark_clipped(number, slice(self._block_count))

    def exclude_channel(self, number: int) -> None:
        """Count the charges of an electrode as missing in all rows, also the incomplete one."""
        self._rows.exclude_channel(number)
        self._block.exclude_channel(number)

    def _merge_block(self) -> None:
        """Merge the samples of the block into the row that is not complete."""
        merged = average_samples(self._block.samples.select(slice(self._block_count)))
        share = self._block_count / self._partial_count
        if share < 1.0:
            row = self._rows.samples.select(self.row_count)
            merged = merge_means(row, merged, share)
        self._rows.replace(self.row_count, merged)
        self._block_count = 0

    def _halve(self) -> None:
        """Replace each pair of rows by its mean."""
        half = CAPACITY // 2
        first = self._rows.samples.select(slice(0, None, 2))
        second = self._rows.samples.select(slice(1, None, 2))
        self._rows.replace(slice(half), merge_means(first, second, share=0.5))
        self.row_count = half
        self.samples_per_row *= 2


def average_samples(samples: BufferedSamples) -> BufferedSamples:
    """Average samples to a single one, whose arrays have no axis of samples.

    Charges are weighted by the inverse variance of their noise, so that missing ones do not count.
    """
    weights = 1.0 / samples.noise_variance
    total_weight = weights.sum(axis=0)
    voltages = samples.voltages.mean(axis=0)
    if math.isnan(voltages.sum()):
        is_measured = ~np.isnan(samples.voltages)
        sums = np.where(is_measured, samples.voltages, 0.0).sum(axis=0)
        counts = is_measured.sum(axis=0)
        voltages = np.where(counts > 0, sums / np.maximum(counts, 1), math.nan)
    return BufferedSamples(
        samples.time_s.mean(),
        (weights * samples.charges_pC).sum(axis=0) / total_weight,
        noise_variance=1.0 / total_weight,
        walk_variance=samples.walk_variance.mean(axis=0),
        drift_pC=samples.drift_pC.mean(axis=0),
        sampling_variance=samples.sampling_variance.mean(),
        is_clipped=np.asarray(samples.is_clipped.any(axis=0)),
        voltages=voltages,
    )


def merge_means(first: BufferedSamples, second: BufferedSamples, share: float) -> BufferedSamples:
    """Merge means of samples, one or several, with the means of other samples.

    Parameters
    ----------
    first, second : BufferedSamples
        Means, as by `average_samples`.
    share : float
        Number of samples of the second mean, as a fraction of those of both.
    """
    first_weight = 1.0 / first.noise_variance
    second_weight = 1.0 / second.noise_variance
    total_weight = first_weight + second_weight
    weighted = first_weight * first.charges_pC + second_weight * second.charges_pC
    mean = _interpolate(first.voltages, second.voltages, share)
    only = np.where(np.isnan(first.voltages), second.voltages, first.voltages)
    return BufferedSamples(
        _interpolate(first.time_s, second.time_s, share),
        weighted / total_weight,
        noise_variance=1.0 / total_weight,
        walk_variance=_interpolate(first.walk_variance, second.walk_variance, share),
        drift_pC=_interpolate(first.drift_pC, second.drift_pC, share),
        sampling_variance=_interpolate(first.sampling_variance, second.sampling_variance, share),
        is_clipped=first.is_clipped | second.is_clipped,
        voltages=np.where(np.isnan(mean), only, mean),
    )


def _interpolate(first: Array, second: Array, share: float) -> Array:
    """Return the mean of two values, of which the second has a share of the weight."""
    return first + share * (second - first)
