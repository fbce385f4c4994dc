"""The baseline of one channel: its voltage while nothing touches the film, and its noise."""

from __future__ import annotations

import math
from typing import NamedTuple

from pvdf_fem.inverse.tracking.signal.decay_fit import DecayFit, compute_decay

#: A channel takes part in the detection of contacts when its line holds this many samples.
MIN_LINE_SAMPLES = 8
#: After this number of memories m, the gains of the filter are those of its memory: the gains 4/k
#: and 6/k² of k samples have fallen below 2/m and 1/m².
STEADY_MEMORIES = 2.5
#: From this number of samples on, the errors of lines and residuals change by less than 1 % with
#: each sample.
MANY_SAMPLES = 64
#: A line is not extrapolated if its standard error would exceed this number of noise deviations.
MAX_SLOPE_ERROR = 1.0
#: A level is known when its standard error is below this number of noise deviations.
MAX_LEVEL_ERROR = 0.5
#: Residual voltages are neglected after this number of time constants, exp(-40) = 4e-18.
MAX_TIME_CONSTANTS = 40.0


class ChannelSnapshot(NamedTuple):
    """The baseline of a channel at the onset of a contact."""

    time_s: float  #: Time of the last sample of the line.
    level: float  #: Voltage in V on the line at this time.
    slope: float  #: In V/s.
    noise_V: float  #: Standard deviation of a voltage.
    line_count: float  #: Number of samples that the line is as accurate as.
    residual: float  #: Residual voltage of the last contact in V.
    residual_at_s: float  #: Time of the residual.
    residual_count: float  #: Number of samples that the residual is the mean of.
    decay_rate: float  #: Rate 1/(R C) in 1/s.
    drift_error: float  #: Error by drifts that the line has not followed, relative to the noise.

    def predict_line(self, time_s: float) -> float:
        """Predict the voltage in V without the residual of the last contact."""
        return self.level + self.slope * (time_s - self.time_s)

    def predict_residual(self, time_s: float) -> float:
        """Predict the residual voltage of the last contact in V."""
        return self.residual * compute_decay(self.decay_rate, time_s - self.residual_at_s)

    def compute_error(self, time_s: float, interval_s: float) -> float:
        """Compute the standard error of the predicted voltage in V.

        See `ChannelBaseline.compute_relative_error`; the line is extrapolated from its last sample.

        Parameters
        ----------
        time_s : float
            Time of the prediction.
        interval_s : float
            Sampling interval.
        """
        extrapolated = (time_s - self.time_s) / interval_s
        line_error = _compute_line_error(self.line_count, extrapolated)
        residual_error = 0.0
        if self.residual:
            decay = compute_decay(self.decay_rate, time_s - self.residual_at_s)
            residual_error = decay / math.sqrt(self.residual_count)
        return self.noise_V * math.hypot(line_error, self.drift_error, residual_error)


class ChannelBaseline:
    """Level, slope and noise of the voltage of one channel without a contact.

    All numbers are plain floats, because a stream has many samples of few channels.

    Parameters
    ----------
    decay_rate : float
        Rate 1/(R C) in 1/s at which the voltage decays; zero without a resistance.
    min_noise_V : float
        Lower bound of the standard deviation of a voltage.

    Notes
    -----
    Let e be the prediction error of sample k. The level is corrected by (4k - 2)/(k (k + 1)) e and
    the slope by 6/(k (k + 1)) e per sampling interval (least-squares line through k samples, an
    expanding-memory filter), until these gains fall to 2/m and 1/m², those of a fading memory of m
    samples (critically damped α-β filter). See E. Brookner, Tracking and Kalman Filtering Made
    Easy (Wiley, 1998), sections 1.2.6 and 1.2.10.
    """

    __slots__ = (
        "_decay_fit",
        "_decay_rate",
        "_level",
        "_memory",
        "_min_noise_V",
        "_residual",
        "_residual_at_s",
        "_residual_count",
        "_slope",
        "_steady_count",
        "_steady_level_gain",
        "_steady_slope_gain",
        "line_count",
        "noise_V",
        "noise_count",
        "noise_variance",
        "time_s",
    )

    def __init__(self, decay_rate: float, min_noise_V: float) -> None:
        self._decay_rate = decay_rate
        self._min_noise_V = min_noise_V
        self.set_memory(math.inf)
        self.line_count = 0  #: Number of samples that the line holds.
        self.noise_count = 0  #: Number of samples that the noise was estimated from.
        self.noise_variance = 0.0  #: Estimated variance of a voltage in V².
        #: Standard deviation of a voltage in V: the estimate, or its lower bound.
        self.noise_V = min_noise_V
        self.time_s = 0.0  #: Time of the last sample of the line.
        self._level = 0.0
        self._slope = 0.0
        # Residual voltage of the last contact, its time, and the number of samples since then.
        self._residual = 0.0
        self._residual_at_s = 0.0
        self._residual_count = 1
        self._decay_fit: DecayFit | None = None  # While the line is learned again.

    def set_memory(self, memory: float) -> None:
        """Set the memory of the filter in samples."""
        self._memory = memory
        self._steady_count = STEADY_MEMORIES * memory
        self._steady_level_gain = 2.0 / memory
        self._steady_slope_gain = 1.0 / memory**2

    @property
    def is_settled(self) -> bool:
        """Whether the line holds enough samples to predict the next one."""
        return self.line_count >= MIN_LINE_SAMPLES

    def take_snapshot(self, drift_error: float) -> ChannelSnapshot:
        """Return the present state, with which voltages are predicted during a contact.

        Parameters
        ----------
        drift_error : float
            Error by drifts that the line has not followed, relative to the noise.
        """
        return ChannelSnapshot(
            time_s=self.time_s,
            level=self._level,
            slope=self._slope,
            noise_V=self.noise_V,
            line_count=self._equivalent_count,
            residual=self._residual,
            residual_at_s=self._residual_at_s,
            residual_count=self._residual_count,
            decay_rate=self._decay_rate,
            drift_error=drift_error,
        )

    def set_line(
        self, time_s: float, level: float, slope: float, *, noise_V: float, count: int
    ) -> None:
        """Set the line and the noise, and remove the residual of earlier contacts.

        Parameters
        ----------
        time_s : float
            Time of `level`: the last sample of the line.
        level : float
            Voltage in V.
        slope : float
            Slope in V/s.
        noise_V : float
            Standard deviation of a voltage.
        count : int
            Number of samples that level, slope and noise were estimated from.
        """
        self.time_s = time_s
        self._level = level
        self._slope = slope
        self._decay_fit = None
        self.line_count = count
        self._residual = 0.0
        self._residual_at_s = time_s
        if count:
            self.noise_count = count
            self._set_noise_variance(noise_V**2)

    def set_min_noise(self, noise_V: float) -> None:
        """Set the lower bound of the standard deviation of a voltage."""
        self._min_noise_V = noise_V
        self.noise_V = max(self.noise_V, noise_V)

    def forget_line(self) -> None:
        """Forget the line, so that it is learned again from the next samples; keep the noise.

        If the channel has a resistance, the level and a residual that decays are fitted together.
        """
        self.line_count = 0
        self._residual = 0.0
        self._decay_fit = DecayFit(self._decay_rate) if self._decay_rate else None

    def predict_line(self, time_s: float) -> float:
        """Predict the voltage in V without the residual of the last contact."""
        return self._level + self._slope * (time_s - self.time_s)

    def predict_residual(self, time_s: float) -> float:
        """Predict the residual voltage of the last contact in V, decayed until a given time."""
        if not self._residual:
            return 0.0
        return self._residual * self._compute_decay(time_s)

    def predict(self, time_s: float) -> float:
        """Predict the voltage in V without a contact."""
        return self.predict_line(time_s) + self.predict_residual(time_s)

    def compute_deviation(self, time_s: float, voltage: float) -> float:
        """Compute the deviation of a voltage from the prediction, in noise deviations.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltage : float
            Voltage in V.

        Returns
        -------
        float
            0 if the voltage is missing or the line is not known.
        """
        if math.isnan(voltage) or self.line_count < MIN_LINE_SAMPLES:
            return 0.0
        deviation_V = voltage - self._level - self._slope * (time_s - self.time_s)
        if self._residual:
            deviation_V -= self._residual * self._compute_decay(time_s)
        return deviation_V / self.noise_V

    def _compute_decay(self, time_s: float) -> float:
        """Compute the fraction of the residual that remains at a given time."""
        return compute_decay(self._decay_rate, time_s - self._residual_at_s)

    def compute_relative_error(self, time_s: float, interval_s: float) -> float:
        """Compute the standard error of the predicted voltage, relative to the noise.

        Parameters
        ----------
        time_s : float
            Time of the prediction.
        interval_s : float
            Sampling interval.

        Returns
        -------
        float
            Standard error divided by the standard deviation of a voltage.

        Notes
        -----
        At its end, a least-squares line through n samples has 4/n of the variance of one sample;
        the filter with a memory of m samples has 5/(4 m). The residual of a contact is a mean over
        the samples after it, so that its error is 1/√(number of samples), and decays with it.
        """
        line_error = self._compute_line_error(time_s, interval_s)
        if not self._residual:
            return line_error
        return math.hypot(line_error, self._compute_decay(time_s) / math.sqrt(self._residual_count))

    def _compute_line_error(self, time_s: float, interval_s: float) -> float:
        """Compute the error of the line; see `compute_relative_error`."""
        extrapolated = (time_s - self.time_s) / interval_s
        return _compute_line_error(self._equivalent_count, extrapolated)

    @property
    def _equivalent_count(self) -> float:
        """Number of samples of the least-squares line that is as accurate as the filter."""
        # A line through 3.2 m samples is as accurate as the filter: 4/(3.2 m) = 5/(4 m).
        return max(min(self.line_count, 3.2 * self._memory), 1.0)

    def stop_uncertain_slope(self, time_s: float, interval_s: float) -> None:
        """Set the slope to zero if the line would be too uncertain after a pause.

        Parameters
        ----------
        time_s : float
            End of the pause.
        interval_s : float
            Sampling interval.
        """
        if self._compute_line_error(time_s, interval_s) > MAX_SLOPE_ERROR:
            self._slope = 0.0
            self.time_s = time_s

    def age(self, time_s: float, interval_s: float) -> None:
        """Forget as much of the line as a pause has made uncertain.

        Parameters
        ----------
        time_s : float
            End of the pause.
        interval_s : float
            Sampling interval.
        """
        error = self._compute_line_error(time_s, interval_s)
        # A line through 4/e² samples has the error e.
        self.line_count = max(min(self.line_count, int(4.0 / error**2)), 1)

    def has_changing_error(self) -> bool:
        """Whether the line or the residual holds so few samples that its error changes quickly."""
        is_new = bool(self._residual) and self._residual_count < MANY_SAMPLES
        return is_new or self.line_count < MANY_SAMPLES

    def replace_residual(self, time_s: float, voltage: float, count: int) -> None:
        """Replace the residual of the last contact.

        Parameters
        ----------
        time_s : float
            Time of the residual.
        voltage : float
            Residual voltage above the line in V.
        count : int
            Number of samples that it is the mean of.
        """
        self._residual = voltage
        self._residual_at_s = time_s
        self._residual_count = max(count, 1)

    def add(self, time_s: float, voltage: float, interval_s: float) -> None:
        """Update line, residual and noise with a sample without a contact.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltage : float
            Voltage in V.
        interval_s : float
            Sampling interval.
        """
        if self._decay_fit:
            self._add_to_decay_fit(time_s, voltage, self._decay_fit)
            return
        count = self.line_count + 1
        self.line_count = count
        if count == 1:
            self._level = voltage - self.predict_residual(time_s)
            self._slope = 0.0
            self.time_s = time_s
            return
        level_gain = self._steady_level_gain
        slope_gain = self._steady_slope_gain
        if count <= self._steady_count:
            pairs = count * (count + 1.0)
            level_gain = max((4.0 * count - 2.0) / pairs, level_gain)
            slope_gain = max(6.0 / pairs, slope_gain)
        step_s = time_s - self.time_s
        line = self._level + self._slope * step_s
        error = voltage - line
        if self._residual:
            error -= self._correct_residual(time_s, error, level_gain)
        self._level = line + level_gain * error
        # Two samples with almost the same time must not turn noise into a slope.
        self._slope += slope_gain * error / (step_s if step_s > interval_s else interval_s)
        self.time_s = time_s
        if count > 2:
            self._update_noise(error)

    def _add_to_decay_fit(self, time_s: float, voltage: float, fit: DecayFit) -> None:
        """Add a sample to the fit of level and residual, and continue from it when it is known.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltage : float
            Voltage in V.
        fit : DecayFit
            Fit to the samples before.
        """
        fit.add(time_s, voltage)
        if fit.count < MANY_SAMPLES / 2 or fit.count % MIN_LINE_SAMPLES:
            return
        fitted = fit.solve()
        if fitted.relative_error > MAX_LEVEL_ERROR:
            return
        self._decay_fit = None
        self.time_s = time_s
        self._level = fitted.level_V
        self._slope = 0.0
        # A line through 4/e² samples has the error e.
        self.line_count = int(4.0 / fitted.relative_error**2)
        self.replace_residual(time_s, fitted.residual_V, count=self.line_count)

    def _correct_residual(self, time_s: float, error: float, level_gain: float) -> float:
        """Correct the residual by a sample, and return the residual that was predicted for it.

        The gain 1/n makes the residual a mean over its n samples. The part of the error that the
        level absorbs is subtracted, so that it does not count twice.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        error : float
            Voltage of the sample above the line.
        level_gain : float
            Fraction of the prediction error that the level absorbs.
        """
        decay = self._compute_decay(time_s)
        predicted = self._residual * decay
        self._residual_count += 1
        if self._decay_rate * (time_s - self._residual_at_s) > MAX_TIME_CONSTANTS:
            self._residual = 0.0
            return predicted
        gain = max(1.0 / self._residual_count - level_gain / decay, 0.0)
        self._residual += gain * (error - predicted)
        return predicted

    def _update_noise(self, error: float) -> None:
        """Update the noise variance with the prediction error of a sample."""
        count = self.line_count
        # Variance of the prediction error of a line through count - 1 samples, divided by the
        # variance of the noise.
        ratio = count * (count + 1.0) / ((count - 1.0) * (count - 2.0))
        self.noise_count += 1
        few = self.noise_count - 2
        memory = self._memory if few > self._memory else max(few, 1)
        variance = self.noise_variance
        self._set_noise_variance(variance + (error * error / ratio - variance) / memory)

    def _set_noise_variance(self, variance: float) -> None:
        """Set the noise variance, and the standard deviation that it gives."""
        self.noise_variance = variance
        noise_V = math.sqrt(variance)
        self.noise_V = noise_V if noise_V > self._min_noise_V else self._min_noise_V


def _compute_line_error(count: float, extrapolated: float) -> float:
    """Compute the standard error of a least-squares line, relative to the noise of a sample.

    Parameters
    ----------
    count : float
        Number of samples on the line.
    extrapolated : float
        Number of sampling intervals since the last of them.
    """
    return 2.0 / math.sqrt(count) * (1.0 + extrapolated / count)
