"""The baseline: voltages of the channels while nothing touches the film, and their noise."""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.options import TrackOptions


class Baseline:
    """Level, slope and noise of the voltages without a contact.

    The level follows the samples as a straight line. First the line is the least-squares line
    through all samples (the expanding-memory filter); later the memory fades exponentially (the
    critically damped α-β filter). A contact leaves voltages that decay through the resistances;
    they are estimated from the samples since, and added to the line.

    The caller adds samples only after a delay, when a slow contact that begins in them would have
    been detected.

    Notes
    -----
    With the prediction error e of sample k, its level gains (4k - 2)/(k (k + 1)) e and the slope
    6/(k (k + 1)) e per interval, as long as these gains are above 2/m and 1/m², those of a fading
    memory of m samples. See E. Brookner, Tracking and Kalman Filtering Made Easy (Wiley, 1998),
    sections 1.2.6 and 1.2.10.
    """

    def __init__(self, circuit: ReadoutCircuit, options: TrackOptions) -> None:
        self.circuit = circuit
        self.options = options
        self.sample_count = 0
        zeros = np.zeros_like(circuit.noise)
        self.noise_variance = zeros  #: Of a voltage, as estimated from the samples, in V².
        self._time_s = 0.0
        self._level = zeros
        self._slope = zeros
        # Voltages that the last contact left, at which time, and the samples since.
        self._residual = zeros
        self._residual_at_s = 0.0
        self._residual_samples = 0

    def predict(self, time_s: float) -> Array:
        """Predict the voltages without a contact at a time, (electrodes,), in V."""
        line = self._level + self._slope * (time_s - self._time_s)
        return line + self.predict_residual(time_s)

    def predict_residual(self, time_s: float) -> Array:
        """Predict what is left at a time of the voltages that the last contact left, in V."""
        return self._residual * self.circuit.compute_decay(time_s - self._residual_at_s)

    @property
    def noise_V(self) -> Array:
        """Standard deviation of a voltage, (electrodes,), at least that of the circuit."""
        minimum = np.maximum(self.circuit.noise, self.options.min_noise_V)
        return np.maximum(np.sqrt(self.noise_variance), minimum)

    def compute_relative_error(self, time_s: float, extrapolated: float = 0.0) -> Array:
        """Compute the standard deviation of the predicted voltages over that of the noise.

        Parameters
        ----------
        time_s : float
            Time of the prediction.
        extrapolated : float
            Number of samples since the last one that was added.

        Returns
        -------
        array, (electrodes,)

        Notes
        -----
        The end of a least-squares line through n samples has 4/n of the variance of a sample, the
        filter with a memory of m samples 5/(4 m). The residual of a contact is the mean of few
        samples, and decays.
        """
        # A line through 3.2 m samples is as exact as the filter: 4/(3.2 m) is 5/(4 m).
        count = min(self.sample_count, 3.2 * self.options.memory_samples)
        line_error = 2.0 / math.sqrt(count) * (1.0 + extrapolated / count)
        decay = self.circuit.compute_decay(time_s - self._residual_at_s)
        return np.hypot(line_error, decay / math.sqrt(self._residual_samples))

    def add_residual(self, start_s: float, end_s: float, voltages: Array) -> None:
        """Add the voltages that a contact has left.

        Parameters
        ----------
        start_s, end_s : float
            Time before the first of the samples after the contact, and time of the last one.
        voltages : array, (samples, electrodes)
            Voltages over the line in these samples, in V, NaN where they are missing.
        """
        remaining_s = np.linspace(end_s - start_s, 0.0, len(voltages) + 1)[1:]
        decayed = voltages * self.circuit.compute_decay(remaining_s)
        self._residual = np.nan_to_num(decayed.mean(axis=0))
        self._residual_at_s = end_s
        self._residual_samples = len(voltages)

    def add(self, time_s: float, voltages: Array) -> None:
        """Add a sample without a contact; restart if a channel is measured for the first time."""
        self.sample_count += 1
        is_new = np.isnan(self._level) & ~np.isnan(voltages)
        if self.sample_count == 1 or is_new.any():
            self._restart(time_s, voltages)
            return
        self._residual_samples += 1
        count = self.sample_count
        memory_share = 1.0 / self.options.memory_samples
        step = time_s - self._time_s
        error = np.nan_to_num(voltages - self.predict(time_s))
        level_gain = max(2.0 * (2 * count - 1) / (count * (count + 1)), 2.0 * memory_share)
        slope_gain = max(6.0 / (count * (count + 1)), memory_share**2)

        # The residual is a mean over its samples, less the part that the level has followed.
        decay = np.maximum(self.circuit.compute_decay(time_s - self._residual_at_s), 1e-100)
        residual_gain = np.maximum(1.0 / self._residual_samples - level_gain / decay, 0.0)

        self._level = self._level + self._slope * step + level_gain * error
        self._residual = self._residual + residual_gain * error
        self._slope = self._slope + slope_gain / step * error
        self._time_s = time_s
        if count > 2:
            self._update_noise(error)

    def _update_noise(self, error: Array) -> None:
        """Update the variance of the noise by the error of a predicted sample."""
        count = self.sample_count
        # Variance of the prediction error of a line through count - 1 samples, over the noise's.
        ratio = count * (count + 1) / ((count - 1) * (count - 2))
        weight = max(1.0 / (count - 2), 1.0 / self.options.memory_samples)
        self.noise_variance = self.noise_variance + weight * (
            np.square(error) / ratio - self.noise_variance
        )

    def _restart(self, time_s: float, voltages: Array) -> None:
        """Start anew with one sample."""
        self.sample_count = 1
        self._residual_samples = 1
        self._time_s = time_s
        self._level = voltages
        self._slope = np.zeros_like(voltages)
        self.noise_variance = np.zeros_like(voltages)
