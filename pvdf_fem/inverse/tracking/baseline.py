"""The baseline: the channel voltages while nothing touches the film, and their noise."""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.options import TrackOptions


class Baseline:
    """Level, slope and noise of the channel voltages without a contact.

    A straight line per channel follows the samples. At first it is the least-squares line through
    all samples (expanding-memory filter); later old samples are forgotten exponentially
    (critically damped α-β filter). A contact leaves residual voltages, which decay through the
    resistances. They are estimated from the samples after the contact and added to the line.

    The tracker adds each sample with a delay. By then, a contact that begins slowly in that sample
    would have been detected, so that it does not enter the baseline.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Capacitances, resistances and noise of the channels.
    options : TrackOptions
        Memory of the filter and the minimum noise.

    Notes
    -----
    Let e be the prediction error of sample k. The level is corrected by (4k - 2)/(k (k + 1)) e and
    the slope by 6/(k (k + 1)) e per sampling interval, until these gains fall to 2/m and 1/m²,
    those of a fading memory of m samples. See E. Brookner, Tracking and Kalman Filtering Made Easy
    (Wiley, 1998), sections 1.2.6 and 1.2.10.
    """

    def __init__(self, circuit: ReadoutCircuit, options: TrackOptions) -> None:
        self.circuit = circuit
        self.options = options
        self.sample_count = 0
        zeros = np.zeros_like(circuit.noise)
        #: Variance of a voltage in V², estimated from the samples, shape (electrodes,).
        self.noise_variance = zeros
        self._time_s = 0.0
        self._level = zeros
        self._slope = zeros
        # Residual voltages of the last contact, their time, and the number of samples since then.
        self._residual = zeros
        self._residual_at_s = 0.0
        self._residual_samples = 0

    def predict(self, time_s: float) -> Array:
        """Predict the voltages in V that the channels would have without a contact.

        Parameters
        ----------
        time_s : float
            Time of the prediction.

        Returns
        -------
        ndarray, shape (electrodes,)
            Line plus residual; NaN for channels that have not been measured yet.
        """
        line = self._level + self._slope * (time_s - self._time_s)
        return line + self.predict_residual(time_s)

    def predict_residual(self, time_s: float) -> Array:
        """Predict the residual voltages of the last contact in V, decayed until a given time."""
        return self._residual * self.circuit.compute_decay(time_s - self._residual_at_s)

    @property
    def noise_V(self) -> Array:
        """Estimated standard deviation of each voltage in V, shape (electrodes,).

        It is at least the noise of the channel and `TrackOptions.min_noise_V`.
        """
        minimum = np.maximum(self.circuit.noise, self.options.min_noise_V)
        return np.maximum(np.sqrt(self.noise_variance), minimum)

    def compute_relative_error(self, time_s: float, extrapolated: float = 0.0) -> Array:
        """Compute the standard errors of the predicted voltages, relative to the noise.

        Parameters
        ----------
        time_s : float
            Time of the prediction.
        extrapolated : float
            Number of sampling intervals since the last sample that was added.

        Returns
        -------
        ndarray, shape (electrodes,)
            Standard error of the prediction divided by the standard deviation of a voltage.

        Notes
        -----
        At its end, a least-squares line through n samples has 4/n of the variance of one sample;
        the filter with a memory of m samples has 5/(4 m). The residual of a contact is a mean over
        the samples after it, so that its error is 1/√(number of samples), and decays with it.
        """
        # A line through 3.2 m samples is as accurate as the filter: 4/(3.2 m) = 5/(4 m).
        count = min(self.sample_count, 3.2 * self.options.memory_samples)
        line_error = 2.0 / math.sqrt(count) * (1.0 + extrapolated / count)
        decay = self.circuit.compute_decay(time_s - self._residual_at_s)
        return np.hypot(line_error, decay / math.sqrt(self._residual_samples))

    def replace_residual(self, start_s: float, end_s: float, voltages: Array) -> None:
        """Replace the residual by the mean of the decayed voltages that a contact has left.

        Parameters
        ----------
        start_s : float
            End of the contact: the time of the last sample before `voltages`.
        end_s : float
            Time of the last row of `voltages`.
        voltages : ndarray, shape (samples, electrodes)
            Voltages in V above the line, sampled at equal intervals after the contact. A channel
            with a missing voltage (NaN) gets the residual 0.
        """
        remaining_s = np.linspace(end_s - start_s, 0.0, len(voltages) + 1)[1:]
        decayed = voltages * self.circuit.compute_decay(remaining_s)
        self._residual = np.nan_to_num(decayed.mean(axis=0))
        self._residual_at_s = end_s
        self._residual_samples = len(voltages)

    def add(self, time_s: float, voltages: Array) -> None:
        """Update the line, the residual and the noise with a sample without a contact.

        The line and the noise of all channels restart from this sample if it is the first one, or
        if a channel is measured for the first time.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : ndarray, shape (electrodes,)
            Voltages in V. A missing one (NaN) counts as equal to its prediction.
        """
        self.sample_count += 1
        is_new = np.isnan(self._level) & ~np.isnan(voltages)
        if self.sample_count == 1 or is_new.any():
            self._restart(time_s, voltages)
            return
        self._residual_samples += 1
        count = self.sample_count
        inverse_memory = 1.0 / self.options.memory_samples
        step = time_s - self._time_s
        error = np.nan_to_num(voltages - self.predict(time_s))
        level_gain = max(2.0 * (2 * count - 1) / (count * (count + 1)), 2.0 * inverse_memory)
        slope_gain = max(6.0 / (count * (count + 1)), inverse_memory**2)

        # The gain 1/n makes the residual a mean over its n samples. The part of the error that the
        # level has just absorbed is subtracted, so that it does not count twice.
        decay = np.maximum(self.circuit.compute_decay(time_s - self._residual_at_s), 1e-100)
        residual_gain = np.maximum(1.0 / self._residual_samples - level_gain / decay, 0.0)

        self._level = self._level + self._slope * step + level_gain * error
        self._residual = self._residual + residual_gain * error
        self._slope = self._slope + slope_gain / step * error
        self._time_s = time_s
        if count > 2:
            self._update_noise(error)

    def _update_noise(self, error: Array) -> None:
        """Update the noise variance with the prediction error of a sample."""
        count = self.sample_count
        # Variance of the prediction error of a line through count - 1 samples, divided by the
        # variance of the noise.
        ratio = count * (count + 1) / ((count - 1) * (count - 2))
        weight = max(1.0 / (count - 2), 1.0 / self.options.memory_samples)
        self.noise_variance = self.noise_variance + weight * (
            np.square(error) / ratio - self.noise_variance
        )

    def _restart(self, time_s: float, voltages: Array) -> None:
        """Restart the line from one sample with zero slope and noise; the residual remains."""
        self.sample_count = 1
        self._residual_samples = 1
        self._time_s = time_s
        self._level = voltages
        self._slope = np.zeros_like(voltages)
        self.noise_variance = np.zeros_like(voltages)
