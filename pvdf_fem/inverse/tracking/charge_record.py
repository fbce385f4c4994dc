"""The charges of a contact since its onset: their peak, the end of the contact, and its errors."""

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
    """Charges of a contact, sample by sample, from the onset on."""

    def __init__(
        self, circuit: ReadoutCircuit, onset_s: float, residual: Array, options: TrackOptions
    ) -> None:
        """Start at the onset.

        Parameters
        ----------
        circuit : ReadoutCircuit
            Capacitances and resistances of the channels.
        onset_s : float
            Time just before the contact.
        residual : array, (electrodes,)
            Voltages in V that the contact before has left at this time.
        options : TrackOptions
            When the contact has ended.
        """
        self.circuit = circuit
        self.options = options
        self.onset_s = onset_s
        self.end_s = onset_s  #: Time of the last sample, or of the end once it is known.
        self.samples: list[ChargeSample] = []
        self.largest_index = 0  #: Index of the sample with the largest charges.
        self.still_count = 0  #: Number of samples after the end, as `detect_end` has found it.
        self._voltages = [residual]  # Over the baseline's line, from the onset on.
        self._integrator = ChargeIntegrator(circuit, onset_s, residual)

    def __len__(self) -> int:
        return len(self.samples)

    def add(self, time_s: float, voltages: Array, noise_V: Array, drift_pC: Array) -> ChargeSample:
        """Add a sample, and return its charges.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : array, (electrodes,)
            Voltages over the baseline's line in V, NaN where they are missing.
        noise_V : array, (electrodes,)
            Standard deviations of the voltages.
        drift_pC : array, (electrodes,)
            Standard deviations of the charges that the error of the baseline has added by now.
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
        """The sample with the largest charges."""
        return self.samples[self.largest_index]

    @property
    def charges_pC(self) -> Array:
        """Charges of all samples, (samples, electrodes), in pC."""
        return np.array([sample.charges_pC for sample in self.samples])

    @property
    def accumulated_variance(self) -> Array:
        """Variances in pC² of the errors that have accumulated since the onset, (electrodes,)."""
        last = self.samples[-1]
        along = np.square(self.largest.direction)
        return last.walk_variance + np.square(last.drift_pC) + last.sampling_variance * along

    @property
    def relative_error(self) -> float:
        """Standard deviation of the accumulated errors over the largest charges."""
        deviation = np.linalg.norm(np.sqrt(self.accumulated_variance))
        largest = np.linalg.norm(self.largest.charges_pC)
        return float(deviation / largest) if largest else math.inf

    def compute_peak(self) -> ChargeSample:
        """Return the charges at the peak of the contact, smoothed over its flat top.

        Notes
        -----
        The largest of many noisy charges is too large in the mean. So a parabola is fitted to the
        charges in a window, and its value at the centre is taken, with the variance of its noise.
        The window is as long as the number of samples within three standard deviations of the
        largest, and placed where its mean charge is largest.
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
        degrees = min(3, len(offsets))  # Number of coefficients: 3 of a parabola.
        weights = np.linalg.pinv(np.vander(offsets, degrees))[-1]
        first = int(np.argmax(np.convolve(sizes, np.ones(len(offsets)), "valid")))
        window = slice(first, first + len(offsets))

        noise = np.array([sample.noise_variance for sample in self.samples[window]])
        weights_by_channel = weights[:, None] * (noise < ChargeSample.MISSING)
        total = weights_by_channel.sum(axis=0)
        noise_variance = (np.square(weights_by_channel) * noise).sum(axis=0)
        # A channel counts if it is measured in the greater part of the window.
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
        """Return whether the contact has ended, and remember its `still_count`.

        A contact has ended when the charges have stopped changing and are zero within their
        errors. Where they are small, but not zero within their errors, they must have stopped for
        four times as long.
        """
        options = self.options
        count = self._count_still_samples(options.still_share)
        self.still_count = count
        if not count:
            return False
        largest = self.largest
        residual, noise_variance = self._average(-count, count)
        variance = self.accumulated_variance + noise_variance
        if _is_within_noise(residual, variance):
            # Charges that are no larger than their noise yet may still grow.
            change = largest.charges_pC - residual
            has_risen = not _is_within_noise(change, variance + largest.noise_variance)
            return has_risen or len(self.samples) > options.patience_samples
        projection = residual @ largest.charges_pC
        limit = options.max_residual_share * np.square(largest.charges_pC).sum()
        return bool(projection < limit and self._count_still_samples(4.0 * options.still_share))

    def _count_still_samples(self, share: float) -> int:
        """Return how many of the last samples have the same mean as as many before, or 0.

        `share` is the number of these samples over the number of all samples.
        """
        count = max(self.options.min_still_samples, int(share * len(self.samples)))
        if len(self.samples) <= 2 * count:
            return 0
        earlier, earlier_noise = self._average(-2 * count, count)
        later, later_noise = self._average(-count, count)
        walk = self._compute_variance_since(self.samples[-2 * count])
        is_still = _is_within_noise(later - earlier, walk + earlier_noise + later_noise)
        return count if is_still else 0

    def _average(self, first: int, count: int) -> tuple[Array, Array]:
        """Return the mean charges of `count` samples from `first` on, and its variance by noise."""
        samples = self.samples[first:][:count]
        weights = 1.0 / np.array([sample.noise_variance for sample in samples])
        variance = 1.0 / weights.sum(axis=0)
        charges = np.array([sample.charges_pC for sample in samples])
        return variance * (weights * charges).sum(axis=0), variance

    def _compute_variance_since(self, sample: ChargeSample) -> Array:
        """Compute the variances in pC² of the errors accumulated since a sample, (electrodes,)."""
        last = self.samples[-1]
        walk = last.walk_variance - sample.walk_variance
        return walk + np.square(last.drift_pC - sample.drift_pC)

    def get_voltages_after_end(self) -> tuple[float, Array]:
        """Return the time of the end, and the voltages (samples, electrodes) after it."""
        count = max(self.still_count, 1)
        times_s = [self.onset_s, *(sample.time_s for sample in self.samples)]
        return times_s[-1 - count], np.array(self._voltages[-count:])

    def subtract_drift(self) -> None:
        """Correct the charges of a finished contact by the charge that is left at its end.

        The residual charge of a finished contact must be zero, so the random-walk drift is
        conditioned on that end point (Brownian bridge) and subtracted. The end becomes the last
        time at which the charges differed from the residual.
        """
        residual, noise_variance = self._average(-self.still_count, self.still_count)
        direction = self.largest.direction
        total = self.accumulated_variance + noise_variance
        pressed = self.samples[: -self.still_count]
        charges = np.array([sample.charges_pC for sample in pressed])
        sizes = (charges - residual) @ direction
        variances = []
        for sample in pressed:
            since_variance = self._compute_variance_since(sample)
            variances.append(since_variance + sample.noise_variance + noise_variance)
        limits = 4.0 * np.sqrt(np.array(variances) @ np.square(direction))
        is_changed = np.flatnonzero(sizes > limits)
        self.end_s = pressed[max(is_changed, default=0)].time_s
        self.samples = [self._condition(sample, residual, total) for sample in self.samples]
        self.largest_index = int(np.argmax(np.linalg.norm(self.charges_pC, axis=1)))

    def _condition(self, sample: ChargeSample, residual: Array, total: Array) -> ChargeSample:
        """Condition the errors of a sample on the residual at the end.

        Parameters
        ----------
        sample : ChargeSample
            The sample to correct.
        residual : array, (electrodes,)
            Mean charges in pC after the end, which are errors.
        total : array, (electrodes,)
            Variance of these errors in pC².

        Notes
        -----
        Errors e(t) are normal with the covariance c(t) = cov(e(t), e(T)) with those at the end T:
        the variance of the walk at t, the product of the drifts at t and T, and the sampling
        variance at t. Given e(T) = r, e(t) has the mean r c/v and the variance var(e(t)) - c²/v,
        with the variance v of r (Rasmussen and Williams, Gaussian Processes for Machine Learning,
        2006, eq. A.6). The direction of the sampling error is that of the charges; the other
        errors along it count as its noise.
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
    """Test whether a difference (electrodes,) is common for errors with a variance."""
    statistic = np.square(difference) @ (1.0 / variance)
    return bool(statistic < compute_chi_square_limit(len(difference)))
