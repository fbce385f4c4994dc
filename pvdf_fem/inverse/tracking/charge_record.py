"""The charges of a contact since its onset: their peak, their errors and the end of the contact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.touch.touch import compute_chi_square_limit
from pvdf_fem.inverse.tracking.charge_integrator import ChargeIntegrator
from pvdf_fem.inverse.tracking.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.options import TrackOptions


class ChargeRecord:
    """Charges of a contact, sample by sample, since its onset."""

    def __init__(
        self, circuit: ReadoutCircuit, onset_s: float, residual: Array, options: TrackOptions
    ) -> None:
        """Start an empty record at the onset of a contact.

        Parameters
        ----------
        circuit : ReadoutCircuit
            Capacitances and resistances of the channels.
        onset_s : float
            Time just before the first sample of the contact.
        residual : ndarray, shape (electrodes,)
            Voltages in V at this time that are left from the previous contact.
        options : TrackOptions
            Thresholds by which the end of the contact is detected.
        """
        self.circuit = circuit
        self.options = options
        self.onset_s = onset_s
        #: Time of the last sample; after `subtract_drift` the time of the end of the contact.
        self.end_s = onset_s
        self.samples: list[ChargeSample] = []
        self.largest_index = 0  #: Index of the sample with the largest charges.
        self.still_count = 0  #: Number of samples after the end; set by `detect_end`.
        self._voltages = [residual]  # Above the line of the baseline, starting at the onset.
        self._integrator = ChargeIntegrator(circuit, onset_s, residual)

    def __len__(self) -> int:
        return len(self.samples)

    def add(self, time_s: float, voltages: Array, noise_V: Array, drift_pC: Array) -> ChargeSample:
        """Integrate the voltages of a sample, append its charges to the record and return them.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : ndarray, shape (electrodes,)
            Voltages in V above the line of the baseline, NaN where they are missing.
        noise_V : ndarray, shape (electrodes,)
            Standard deviations of the voltages.
        drift_pC : ndarray, shape (electrodes,)
            Standard deviations of the charges that are due to the error of the baseline and have
            accumulated since the onset.

        Returns
        -------
        ChargeSample
            Charges since the onset, with their variances.
        """
        charges_pC = self._integrator.add(time_s, voltages, noise_V)
        noise_variance = np.square(self.circuit.capacitance * noise_V)
        noise_variance[np.isnan(voltages)] = ChargeSample.MISSING
        sample = ChargeSample(
            time_s,
            charges_pC,
            noise_variance=noise_variance,
            walk_variance=self._integrator.walk_variance,
            drift_pC=drift_pC,
            sampling_variance=self._integrator.sampling_variance,
        )
        self.samples.append(sample)
        self._voltages.append(voltages)
        if np.linalg.norm(charges_pC) > np.linalg.norm(self.largest.charges_pC):
            self.largest_index = len(self.samples) - 1
        self.end_s = time_s
        return sample

    @property
    def largest(self) -> ChargeSample:
        """Sample with the largest charges (Euclidean norm over the electrodes)."""
        return self.samples[self.largest_index]

    @property
    def charges_pC(self) -> Array:
        """Charges of all samples in pC.

        Returns
        -------
        ndarray, shape (samples, electrodes)
        """
        return np.array([sample.charges_pC for sample in self.samples])

    @property
    def accumulated_variance(self) -> Array:
        """Variance in pC² of the errors from the onset to the last sample, shape (electrodes,)."""
        last = self.samples[-1]
        along = np.square(self.largest.direction)
        return last.walk_variance + np.square(last.drift_pC) + last.sampling_variance * along

    @property
    def relative_error(self) -> float:
        """Standard deviation of the accumulated errors as a fraction of the largest charges.

        Infinite if all charges are zero.
        """
        deviation = np.linalg.norm(np.sqrt(self.accumulated_variance))
        largest = np.linalg.norm(self.largest.charges_pC)
        return float(deviation / largest) if largest else math.inf

    def compute_peak(self) -> ChargeSample:
        """Compute the charges at the peak of the contact by smoothing.

        Returns
        -------
        ChargeSample
            Smoothed charges at the time of the window's centre, with the reduced variance of their
            noise. Channels without a reading in most of the window count as missing.

        Notes
        -----
        The maximum of many noisy charges is biased upwards. Therefore a parabola is fitted to the
        charges in a window and evaluated at its centre. The length of the window is the number of
        samples whose charges are within three standard deviations of the maximum; the window is
        placed where its mean charge is largest.
        """
        charges = self.charges_pC
        sizes = np.linalg.norm(charges, axis=1)
        largest = self.largest
        measured = largest.is_measured
        along = np.square(largest.direction[measured])
        deviation = math.sqrt(along @ largest.noise_variance[measured])
        top_count = int((sizes >= sizes.max() - 3.0 * deviation).sum())
        half = (top_count - 1) // 2
        offsets = np.arange(-half, half + 1)
        coefficient_count = min(3, len(offsets))  # A parabola has three coefficients.
        # The value of the parabola at the offset 0 is its last coefficient, a weighted sum.
        weights = np.linalg.pinv(np.vander(offsets, coefficient_count))[-1]
        window_sums = np.convolve(sizes, np.ones(len(offsets)), "valid")
        first = int(np.argmax(window_sums))
        window = slice(first, first + len(offsets))

        noise = np.array([sample.noise_variance for sample in self.samples[window]])
        weights_by_channel = weights[:, None] * (noise < ChargeSample.MISSING)
        total = weights_by_channel.sum(axis=0)
        noise_variance = (np.square(weights_by_channel) * noise).sum(axis=0)
        # A channel counts as measured if its readings carry most of the weight of the window.
        is_measured = total > 0.5
        total = np.where(is_measured, total, 1.0)
        return replace(
            self.samples[first + half],
            charges_pC=(weights_by_channel * charges[window]).sum(axis=0) / total,
            noise_variance=np.where(
                is_measured, noise_variance / np.square(total), ChargeSample.MISSING
            ),
        )

    def detect_end(self) -> bool:
        """Decide whether the contact has ended, and set `still_count` in either case.

        A contact has ended when its charges have stopped changing and are zero within their
        errors. If they are small but not zero within their errors, they must have been constant
        for four times as long. Charges that have never been significantly above the noise end the
        contact only after `TrackOptions.patience_samples`.

        Returns
        -------
        bool
            Whether the contact has ended. If so, the last `still_count` samples are after its end.
        """
        options = self.options
        count = self._count_still_samples(options.still_fraction)
        self.still_count = count
        if not count:
            return False
        largest = self.largest
        residual, noise_variance = self._average_charges(-count, count)
        variance = self.accumulated_variance + noise_variance
        if _is_within_noise(residual, variance):
            # Charges that have not exceeded their noise so far may still grow.
            change = largest.charges_pC - residual
            has_risen = not _is_within_noise(change, variance + largest.noise_variance)
            return has_risen or len(self.samples) > options.patience_samples
        projection = residual @ largest.charges_pC
        limit = options.max_residual_fraction * np.square(largest.charges_pC).sum()
        return bool(projection < limit and self._count_still_samples(4.0 * options.still_fraction))

    def _count_still_samples(self, fraction: float) -> int:
        """Return the number of last samples that are compared if their charges are constant, or 0.

        The charges were constant if the mean of these samples equals, within its error, the mean
        of equally many samples before them.

        Parameters
        ----------
        fraction : float
            Number of samples to compare, as a fraction of all samples of the contact; at least
            `TrackOptions.min_still_samples` are compared.
        """
        count = max(self.options.min_still_samples, int(fraction * len(self.samples)))
        if len(self.samples) <= 2 * count:
            return 0
        earlier, earlier_noise = self._average_charges(-2 * count, count)
        later, later_noise = self._average_charges(-count, count)
        walk = self._compute_error_variance_since(self.samples[-2 * count])
        is_still = _is_within_noise(later - earlier, walk + earlier_noise + later_noise)
        return count if is_still else 0

    def _average_charges(self, first: int, count: int) -> tuple[Array, Array]:
        """Average the charges of consecutive samples, weighted by the inverse noise variance.

        Parameters
        ----------
        first : int
            Index of the first sample; negative indices count from the end.
        count : int
            Number of samples.

        Returns
        -------
        mean : ndarray, shape (electrodes,)
            Mean charges in pC.
        variance : ndarray, shape (electrodes,)
            Variance of the mean in pC² due to the noise of the samples.
        """
        samples = self.samples[first:][:count]
        weights = 1.0 / np.array([sample.noise_variance for sample in samples])
        variance = 1.0 / weights.sum(axis=0)
        charges = np.array([sample.charges_pC for sample in samples])
        return variance * (weights * charges).sum(axis=0), variance

    def _compute_error_variance_since(self, sample: ChargeSample) -> Array:
        """Compute the variance in pC² of the errors accumulated since a sample, per electrode."""
        last = self.samples[-1]
        walk = last.walk_variance - sample.walk_variance
        return walk + np.square(last.drift_pC - sample.drift_pC)

    def get_voltages_after_end(self) -> tuple[float, Array]:
        """Return the voltages measured after the end of the contact.

        Returns
        -------
        end_s : float
            Time of the last sample before these voltages.
        voltages : ndarray, shape (samples, electrodes)
            Voltages in V above the line of the baseline, of the last `still_count` samples or of
            the last sample if that number is 0.
        """
        count = max(self.still_count, 1)
        times_s = [self.onset_s, *(sample.time_s for sample in self.samples)]
        return times_s[-1 - count], np.array(self._voltages[-count:])

    def subtract_drift(self) -> None:
        """Subtract the drift from the charges of a contact that has ended, see `detect_end`.

        After the contact the charge must be zero, so that the measured residual is a drift. The
        errors of all samples are conditioned on this residual (Brownian bridge), and their
        conditional mean is subtracted. The corrected samples replace those of the record. `end_s`
        becomes the last time at which the charges differed significantly from the residual, or the
        time of the first sample if they never did.
        """
        residual, noise_variance = self._average_charges(-self.still_count, self.still_count)
        direction = self.largest.direction
        total = self.accumulated_variance + noise_variance
        pressed = self.samples[: -self.still_count]
        charges = np.array([sample.charges_pC for sample in pressed])
        sizes = (charges - residual) @ direction
        variances = []
        for sample in pressed:
            since_variance = self._compute_error_variance_since(sample)
            variances.append(since_variance + sample.noise_variance + noise_variance)
        limits = 4.0 * np.sqrt(np.array(variances) @ np.square(direction))
        is_changed = np.flatnonzero(sizes > limits)
        self.end_s = pressed[max(is_changed, default=0)].time_s
        self.samples = [
            self._condition_on_residual(sample, residual, total) for sample in self.samples
        ]
        self.largest_index = int(np.argmax(np.linalg.norm(self.charges_pC, axis=1)))

    def _condition_on_residual(
        self, sample: ChargeSample, residual: Array, total: Array
    ) -> ChargeSample:
        """Return a copy of a sample whose errors are conditioned on the residual at the end.

        Parameters
        ----------
        sample : ChargeSample
            Sample to correct.
        residual : ndarray, shape (electrodes,)
            Mean charges r in pC after the end. The true charges are zero there, so that r is the
            accumulated error.
        total : ndarray, shape (electrodes,)
            Variance v of the residual in pC².

        Notes
        -----
        The errors e(t) are normally distributed. Their covariance with the error at the end T,
        c(t) = cov(e(t), e(T)), is the sum of the random-walk variance at t, the product of the
        drifts at t and T, and the sampling variance at t. Conditional on e(T) = r, the error e(t)
        has the mean r c/v and the variance var(e(t)) - c²/v (Rasmussen and Williams, Gaussian
        Processes for Machine Learning, 2006, eq. A.6). The variance of the sampling error is kept
        as a scalar along the direction of the charges; for its correction, the projections of the
        other errors onto this direction count as noise.
        """
        last = self.samples[-1]
        along = np.square(self.largest.direction)
        covariance = sample.walk_variance + sample.drift_pC * last.drift_pC
        sampling = sample.sampling_variance * along
        others = float(along @ (total - last.sampling_variance * along))
        sampling_total = last.sampling_variance + others
        walk_variance = sample.walk_variance + np.square(sample.drift_pC)
        walk_variance = walk_variance - np.square(covariance) / total
        return replace(
            sample,
            charges_pC=sample.charges_pC - residual * (covariance + sampling) / total,
            walk_variance=np.maximum(walk_variance, 0.0),
            drift_pC=np.zeros_like(residual),
            sampling_variance=sample.sampling_variance
            * (1.0 - sample.sampling_variance / sampling_total),
        )


def _is_within_noise(difference: Array, variance: Array) -> bool:
    """Test by chi-square whether a difference of charges is explained by its variance."""
    statistic = np.square(difference) @ (1.0 / variance)
    return bool(statistic < compute_chi_square_limit(len(difference)))
