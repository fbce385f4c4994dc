"""The charges of a contact since its onset: their peak, their errors and the end of the contact."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charges.charge_integrator import ChargeIntegrator
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample, ChargeValues
from pvdf_fem.inverse.tracking.charges.charge_tests import find_only_charge, is_within_noise
from pvdf_fem.inverse.tracking.charges.drift_bridge import compute_accumulated_variance
from pvdf_fem.inverse.tracking.charges.peak import choose_larger_peak, compute_peak
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples, SampleBuffer
from pvdf_fem.inverse.tracking.charges.touch_record import (
    ReleasedRows,
    TouchRecord,
    average_charges,
    split_at_pauses,
)
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit

#: The end of a contact is looked for each time the number of rows has grown by this fraction.
END_CHECK_GROWTH = 1.0 / 64.0
#: Number of rows from which the slope of the charges before a pause is estimated.
SLOPE_ROWS = 4
#: A pause may have hidden the peak if the charges in it may have exceeded the measured peak by this
#: factor. A smaller excess changes the force by two percent or so.
HIDDEN_PEAK_FACTOR = 1.02


class ChargeChange(NamedTuple):
    """Change of the mean charges between two equally long series of rows."""

    row_count: int  #: Number of rows in each series.
    difference: Array  #: Charges of the later less those of the earlier rows in pC.
    variance: Array  #: Variance of the difference in pC² by noise and drift.


class ChargeRecord:
    """Charges of a contact, sample by sample, since its onset.

    The samples are kept in a `SampleBuffer`, whose rows are means of more and more samples the
    longer the contact lasts. A peak from a time when the rows were finer is kept apart.
    """

    def __init__(
        self,
        circuit: ReadoutCircuit,
        onset_s: float,
        residual: Sequence[float],
        options: TrackOptions,
    ) -> None:
        """Start an empty record at the onset of a contact.

        Parameters
        ----------
        circuit : ReadoutCircuit
            Capacitances and resistances of the channels.
        onset_s : float
            Time just before the first sample of the contact.
        residual : sequence of float
            Voltages in V at this time that are left from the previous contact.
        options : TrackOptions
            Thresholds by which the end of the contact is detected.
        """
        self.options = options
        self.onset_s = onset_s
        self.end_s = onset_s  #: Time of the last sample.
        self.largest: ChargeSample | None = None  #: Sample with the largest charges.
        self.still_count = 0  #: Number of rows after the end; set by `detect_end`.
        self._buffer = SampleBuffer(len(residual))
        self._integrator = ChargeIntegrator(circuit, onset_s, residual)
        self._last: ChargeValues | None = None
        self._kept_peak: ChargeSample | None = None
        self._largest_size = -1.0
        self._last_size = 0.0
        self._hidden_size = 0.0  # Size in pC that the charges may have had during a pause.
        self._excluded: set[int] = set()  # Channels that count as missing.
        self._next_end_check = 0.0

    def __len__(self) -> int:
        """Return the number of samples."""
        return self._buffer.sample_count

    @property
    def rows(self) -> BufferedSamples:
        """Samples or means of samples, see `SampleBuffer`."""
        return self._buffer.rows

    def add(
        self,
        time_s: float,
        voltages: Sequence[float],
        is_clipped: Sequence[bool],
        *,
        noise_V: Sequence[float],
        drift_pC: Sequence[float],
    ) -> ChargeValues:
        """Integrate the voltages of a sample, append its charges to the record and return them.

        Parameters
        ----------
        time_s, voltages, is_clipped, noise_V
            See `ChargeIntegrator.add`; the voltages are those above the line of the baseline.
        drift_pC : sequence of float
            Standard deviations of the charges that are due to the error of the baseline and have
            accumulated since the onset.

        Returns
        -------
        ChargeValues
            Charges since the onset, with their variances.
        """
        integrator = self._integrator
        charges_pC = integrator.add(time_s, voltages, is_clipped, noise_V)
        noise_variance = integrator.compute_noise_variance(voltages, is_clipped, noise_V)
        for number in self._excluded:
            charges_pC[number] = 0.0
            noise_variance[number] = ChargeSample.MISSING
        values = ChargeValues(
            time_s,
            charges_pC,
            noise_variance=noise_variance,
            walk_variance=integrator.walk_variance,
            drift_pC=drift_pC,
            sampling_variance=integrator.sampling_variance,
            is_clipped=is_clipped,
        )
        if self._buffer.is_halved_by_next:
            # The rows become coarser with this sample.
            self._kept_peak = self.compute_peak()
        self._buffer.add(values, voltages)
        size_pC = values.size_pC
        if size_pC > self._largest_size:
            self._largest_size = size_pC
            self.largest = values.to_sample()
        self._last = values
        self._last_size = size_pC
        self.end_s = time_s
        return values

    @property
    def last(self) -> ChargeSample | None:
        """Last sample; None if there is none."""
        return self._last.to_sample() if self._last else None

    @property
    def remaining_fraction(self) -> float:
        """Size of the last charges as a fraction of the largest size."""
        return self._last_size / max(self._largest_size, math.ulp(0.0))

    @property
    def is_peak_hidden(self) -> bool:
        """Whether the charges may have been largest during a pause of the readings."""
        return self._hidden_size > HIDDEN_PEAK_FACTOR * self._largest_size

    def note_pause(self, duration_s: float) -> None:
        """Note that readings are missing since the last sample.

        Parameters
        ----------
        duration_s : float
            Length of the pause.

        Notes
        -----
        A parabola that begins with the slope s and comes back after the time w rises by s w/4.
        """
        rows = self.rows.select(slice(-SLOPE_ROWS, None))
        if len(rows.time_s) < 2:
            self._hidden_size = math.inf
            return
        sizes = np.linalg.norm(rows.charges_pC, axis=1)
        slope = max(float(sizes[-1] - sizes[0]), 0.0) / float(rows.time_s[-1] - rows.time_s[0])
        self._hidden_size = max(self._hidden_size, float(sizes[-1]) + slope * duration_s / 4.0)

    def find_stepped_channel(self) -> int | None:
        """Return the channel whose charge alone is left, as after a step of its offset, or None."""
        options = self.options
        count = max(options.min_still_samples, int(options.still_fraction * len(self._buffer)))
        if len(self._buffer) < count:
            return None
        charges_pC, noise_variance = self._average_charges(-count, count)
        last = self._require(self.last)
        variance = noise_variance + last.walk_variance + np.square(last.drift_pC)
        return find_only_charge(charges_pC, variance, self._largest_size, options)

    def mark_clipped(self, number: int, count: int) -> None:
        """Mark the charges of an electrode in the last `count` samples as limits."""
        self._buffer.mark_clipped(number, count)

    def exclude_channel(self, number: int) -> None:
        """Count the charges of an electrode as missing in all samples, also in later ones."""
        self._excluded.add(number)
        self._buffer.exclude_channel(number)
        self._kept_peak = self._kept_peak and self._kept_peak.without_channel(number)
        self.largest = self.largest and self.largest.without_channel(number)
        if self.largest:
            self._largest_size = float(np.linalg.norm(self.largest.charges_pC))

    @property
    def accumulated_variance(self) -> Array:
        """Variance in pC² of the errors from the onset to the last sample, shape (electrodes,)."""
        return compute_accumulated_variance(
            self._require(self.last), self._require(self.largest).direction
        )

    @staticmethod
    def _require(sample: ChargeSample | None) -> ChargeSample:
        """Return a sample; a record without samples has none."""
        if sample is None:
            raise ValueError("the record has no samples; add one")
        return sample

    @property
    def relative_error(self) -> float:
        """Standard deviation of the accumulated errors as a fraction of the largest charges.

        Infinite if all charges are zero.
        """
        deviation = np.linalg.norm(np.sqrt(self.accumulated_variance))
        return float(deviation / self._largest_size) if self._largest_size else math.inf

    def compute_peak(self) -> ChargeSample:
        """Compute the charges at the peak of the contact; see `peak.compute_peak`."""
        return choose_larger_peak(compute_peak(self.rows), self._kept_peak, self.rows)

    def detect_end(self) -> bool:
        """Decide whether the contact has ended, and set `still_count` in either case.

        A contact has ended when its charges have stopped changing and are zero within their errors,
        or when they are negligible and hardly change. If they are small, they must have been
        constant for four times as long. Charges that have never exceeded the noise end the contact
        only after `TrackOptions.patience_samples`. A contact does not end while it is clipped.

        Returns
        -------
        bool
            Whether the contact has ended. If so, the last `still_count` rows are after its end.
        """
        if self._buffer.sample_count < self._next_end_check:
            return False
        self._next_end_check = (1.0 + END_CHECK_GROWTH) * self._buffer.sample_count
        options = self.options
        last = self._require(self.last)
        self.still_count = 0
        change = self._compare_last_rows(options.still_fraction)
        if change is None or last.is_clipped.any():
            return False
        largest = self._require(self.largest)
        residual, noise_variance = self._average_charges(-change.row_count, change.row_count)
        size_square = float(np.square(largest.charges_pC).sum())
        fraction = float(residual @ largest.charges_pC) / size_square if size_square else 0.0
        is_negligible = fraction < options.negligible_residual_fraction
        is_still = is_within_noise(change.difference, change.variance)
        if not is_still:
            limit = options.negligible_change_fraction**2 * size_square
            is_still = is_negligible and float(np.square(change.difference).sum()) < limit
        if not is_still:
            return False
        self.still_count = change.row_count
        variance = self.accumulated_variance + noise_variance
        if is_within_noise(residual, variance):
            # Charges that have not exceeded their noise so far may still grow.
            rise = largest.charges_pC - residual
            has_risen = not is_within_noise(rise, variance + largest.noise_variance)
            return has_risen or len(self) > options.patience_samples
        if is_negligible:
            return True
        if fraction > options.max_residual_fraction:
            return False
        longer = self._compare_last_rows(4.0 * options.still_fraction)
        return longer is not None and is_within_noise(longer.difference, longer.variance)

    def _compare_last_rows(self, fraction: float) -> ChargeChange | None:
        """Compare the mean charges of the last rows with that of equally many rows before them.

        Parameters
        ----------
        fraction : float
            Number of rows to compare, as a fraction of all rows of the contact; at least
            `TrackOptions.min_still_samples` are compared.

        Returns
        -------
        ChargeChange or None
            None if there are too few rows.
        """
        row_count = len(self._buffer)
        count = max(self.options.min_still_samples, int(fraction * row_count))
        if row_count <= 2 * count:
            return None
        earlier, earlier_noise = self._average_charges(-2 * count, count)
        later, later_noise = self._average_charges(-count, count)
        walk = self._compute_error_variance_since(row_count - 2 * count)
        return ChargeChange(count, later - earlier, variance=walk + earlier_noise + later_noise)

    def _average_charges(self, first: int, count: int) -> tuple[Array, Array]:
        """Average the charges of consecutive rows, weighted by the inverse noise variance.

        Parameters
        ----------
        first : int
            Index of the first row; negative indices count from the end.
        count : int
            Number of rows.

        Returns
        -------
        mean : ndarray, shape (electrodes,)
            Mean charges in pC.
        variance : ndarray, shape (electrodes,)
            Variance of the mean in pC² due to the noise of the samples.
        """
        start = first % len(self._buffer)
        return average_charges(self.rows.select(slice(start, start + count)))

    def _compute_error_variance_since(self, row: int) -> Array:
        """Compute the variance in pC² of the errors accumulated since a row, per electrode."""
        last = self._require(self.last)
        rows = self.rows
        walk = last.walk_variance - rows.walk_variance[row]
        return walk + np.square(last.drift_pC - rows.drift_pC[row])

    def get_voltages_after_end(self) -> tuple[Array, Array]:
        """Return the voltages measured after the end of the contact.

        Returns
        -------
        times_s : ndarray, shape (rows,)
            Times of the last `still_count` rows, or of the last row if that number is 0.
        voltages : ndarray, shape (rows, electrodes)
            Voltages in V above the line of the baseline; NaN where they are missing.
        """
        count = max(self.still_count, 1)
        rows = self.rows.select(slice(-count, None))
        return rows.time_s, rows.voltages

    def split(self) -> list[TouchRecord]:
        """Split the record of a contact that has ended at the pauses between its touches.

        Returns
        -------
        list of TouchRecord
            A record of each touch, without drift.
        """
        # The baseline may have been learned again before the end was detected.
        still_count = max(self.still_count, self.options.min_still_samples)
        whole = ReleasedRows(
            self.rows,
            last=self._require(self.last),
            onset_s=self.onset_s,
            still_count=still_count,
            kept_peak=self._kept_peak,
        )
        return split_at_pauses(whole)
