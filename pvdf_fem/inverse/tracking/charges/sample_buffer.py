"""Samples of a contact in bounded memory: the older a contact, the coarser they are kept."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample

#: Number of rows, which is halved when it is reached. A contact then keeps at least 256 rows, of
#: which an end of 1/16 (`TrackOptions.still_fraction`) has 16.
CAPACITY = 512


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

    def select(self, index: slice) -> BufferedSamples:
        """Return some of the samples, without copying them."""
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


class SampleBuffer:
    """A growing number of samples in a bounded number of rows.

    When all rows are filled, each pair of neighbours is replaced by its mean. From then on each
    row is the mean of twice as many samples.

    Parameters
    ----------
    electrode_count : int
        Number of electrodes.
    """

    def __init__(self, electrode_count: int) -> None:
        # Walk variance, drift and voltages, which are averaged with equal weights, in one array.
        self._averaged = np.zeros((CAPACITY, 3, electrode_count))
        self._rows = BufferedSamples(
            np.zeros(CAPACITY),
            np.zeros((CAPACITY, electrode_count)),
            noise_variance=np.zeros((CAPACITY, electrode_count)),
            walk_variance=self._averaged[:, 0],
            drift_pC=self._averaged[:, 1],
            sampling_variance=np.zeros(CAPACITY),
            is_clipped=np.zeros((CAPACITY, electrode_count), dtype=bool),
            voltages=self._averaged[:, 2],
        )
        self.row_count = 0  #: Number of complete rows.
        self.samples_per_row = 1
        self._partial_count = 0  # Number of samples in the row that is not complete.

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
        return self._rows.select(slice(self.row_count))

    def add(self, sample: ChargeSample, voltages: Array) -> None:
        """Add a sample.

        Parameters
        ----------
        sample : ChargeSample
            The sample.
        voltages : ndarray, shape (electrodes,)
            Its voltages in V above the line of the baseline.
        """
        index = self.row_count
        if self._partial_count == 0:
            self._set_row(index, sample, voltages)
        else:
            self._merge_into_row(index, sample, voltages)
        self._partial_count += 1
        if self._partial_count == self.samples_per_row:
            self._partial_count = 0
            self.row_count += 1
        if self.row_count == CAPACITY:
            self._halve()

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
        marked = self._rows.select(slice(max(first, 0), end))
        marked.is_clipped[:, number] = True
        marked.noise_variance[:, number] = ChargeSample.MISSING

    def exclude_channel(self, number: int) -> None:
        """Count the charges of an electrode as missing in all rows, also the incomplete one."""
        self._rows.charges_pC[:, number] = 0.0
        self._rows.noise_variance[:, number] = ChargeSample.MISSING

    def _set_row(self, index: int, sample: ChargeSample, voltages: Array) -> None:
        """Set a row to a sample and its voltages."""
        rows = self._rows
        rows.time_s[index] = sample.time_s
        rows.charges_pC[index] = sample.charges_pC
        rows.noise_variance[index] = sample.noise_variance
        rows.walk_variance[index] = sample.walk_variance
        rows.drift_pC[index] = sample.drift_pC
        rows.sampling_variance[index] = sample.sampling_variance
        rows.is_clipped[index] = sample.is_clipped
        rows.voltages[index] = voltages

    def _merge_into_row(self, index: int, sample: ChargeSample, voltages: Array) -> None:
        """Merge a sample into the row that is not complete, as its mean with the earlier samples.

        Charges are weighted by the inverse variance of their noise, so that missing ones do not
        count.
        """
        rows = self._rows
        weight = 1.0 / (self._partial_count + 1.0)
        rows.time_s[index] += weight * (sample.time_s - rows.time_s[index])
        earlier_weight = 1.0 / rows.noise_variance[index]
        new_weight = 1.0 / sample.noise_variance
        total_weight = earlier_weight + new_weight
        change = sample.charges_pC - rows.charges_pC[index]
        rows.charges_pC[index] += new_weight / total_weight * change
        rows.noise_variance[index] = 1.0 / total_weight
        excess = sample.sampling_variance - rows.sampling_variance[index]
        rows.sampling_variance[index] += weight * excess
        rows.is_clipped[index] |= sample.is_clipped
        earlier = rows.voltages[index].copy()
        averaged = self._averaged[index]
        averaged += weight * (
            np.array([sample.walk_variance, sample.drift_pC, voltages]) - averaged
        )
        if math.isnan(averaged[2].sum()):
            only = np.where(np.isnan(earlier), voltages, earlier)
            mean = averaged[2]
            rows.voltages[index] = np.where(np.isnan(mean), only, mean)

    def _halve(self) -> None:
        """Replace each pair of rows by its mean."""
        rows = self._rows
        half = CAPACITY // 2
        first = rows.select(slice(0, None, 2))
        second = rows.select(slice(1, None, 2))
        first_weight = 1.0 / first.noise_variance
        second_weight = 1.0 / second.noise_variance
        total_weight = first_weight + second_weight
        weighted = first_weight * first.charges_pC + second_weight * second.charges_pC
        mean = (first.voltages + second.voltages) / 2.0
        only = np.where(np.isnan(first.voltages), second.voltages, first.voltages)
        merged = BufferedSamples(
            (first.time_s + second.time_s) / 2.0,
            weighted / total_weight,
            noise_variance=1.0 / total_weight,
            walk_variance=(first.walk_variance + second.walk_variance) / 2.0,
            drift_pC=(first.drift_pC + second.drift_pC) / 2.0,
            sampling_variance=(first.sampling_variance + second.sampling_variance) / 2.0,
            is_clipped=first.is_clipped | second.is_clipped,
            voltages=np.where(np.isnan(mean), only, mean),
        )
        for values, new in zip(rows, merged, strict=True):
            values[:half] = new
        self.row_count = half
        self.samples_per_row *= 2
