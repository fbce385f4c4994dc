"""The voltages while nothing touches, their noise, and when a touch begins."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from scipy.stats import chi2

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.options import TrackOptions


class Baseline:
    """Level and slope of quiet voltages. They follow the samples by the least squares of a line,
    first through all samples, later with a memory of samples that fades exponentially (the α-β
    filter that is critically damped). Samples are given to them only when these are so old that a
    slow touch would have been seen."""

    def __init__(self, circuit: ReadoutCircuit, options: TrackOptions) -> None:
        self.circuit, self.options, self.count = circuit, options, 0
        self.fresh = 0  #: Samples since a touch from which the level was taken anew.
        none = np.zeros_like(circuit.noise)
        self.time, self.level, self.slope, self.square = 0.0, none, none, none
        self.left, self.left_at = none, 0.0  #: Voltages that a touch left, and when; they decay.

    def at(self, time: float) -> Array:
        """Quiet voltages at a time."""
        return self.level + self.slope * (time - self.time) + self.remaining(time)

    def remaining(self, time: float) -> Array:
        """What is left at a time of the voltages that a touch left."""
        return self.left * self.circuit.decay(time - self.left_at)

    @property
    def noise(self) -> Array:
        """Standard deviation of the quiet voltages, at least the scene's."""
        least = np.maximum(self.circuit.noise, self.options.least_noise_V)
        return np.maximum(np.sqrt(self.square), least)

    def relative_error(self, time: float, samples: float = 0.0) -> Array:
        """Standard deviation of the quiet voltages over the noise, (electrodes,), after samples
        without a look at them. The variance of a line's end is 4/n of the noise's, and 5/4 of
        1/memory for the filter; what a touch left is the mean of few samples, and decays."""
        count = min(self.count, 3.2 * self.options.memory)
        line = 2.0 / math.sqrt(count) * (1.0 + samples / count)
        return np.hypot(line, self.circuit.decay(time - self.left_at) / math.sqrt(self.fresh))

    def keep(self, since: float, time: float, voltages: Array) -> None:
        """Go on after a touch that leaves voltages (n, channels) over the level, NaN for none. They
        are of the samples after `since` to `time`."""
        decay = self.circuit.decay(np.linspace(time - since, 0.0, len(voltages) + 1)[1:])
        self.left, self.left_at = np.nan_to_num((voltages * decay).mean(axis=0)), time
        self.fresh = len(voltages)

    def follow(self, time: float, voltage: Array) -> None:
        """Take a quiet sample in; a channel that was never heard before begins all anew."""
        self.count += 1
        if self.count == 1 or (np.isnan(self.level) & ~np.isnan(voltage)).any():
            self.count, self.fresh, self.time, self.level = 1, 1, time, voltage
            self.slope, self.square = np.zeros_like(voltage), np.zeros_like(voltage)
            return
        self.fresh += 1
        k, share = self.count, 1.0 / self.options.memory
        step, surprise = time - self.time, np.nan_to_num(voltage - self.at(time))
        line = max(2.0 * (2 * k - 1) / (k * (k + 1)), 2.0 * share)
        kept = np.maximum(self.circuit.decay(time - self.left_at), 1e-100)
        bend = max(6.0 / (k * (k + 1)), share**2)
        self.level = self.level + self.slope * step + line * surprise
        self.left = self.left + np.maximum(1.0 / self.fresh - line / kept, 0.0) * surprise
        self.slope = self.slope + bend / step * surprise
        self.time = time
        if k > 2:  # the line through k - 1 samples goes on with this variance over the noise's
            variance = k * (k + 1) / ((k - 1) * (k - 2))
            weight = max(1.0 / (k - 2), share)
            self.square = self.square + weight * (np.square(surprise) / variance - self.square)


class ContactDetector:
    """Deviations of the last samples from the baseline, summed up over several windows. A touch is
    seen when one of the sums of squares over the channels, each over its variance, is above what
    noise exceeds in a share `false_alarm` of the samples."""

    def __init__(self, channels: int, options: TrackOptions) -> None:
        #: Times, voltages, and deviations over the noise.
        self.samples: deque[tuple[float, Array, Array]] = deque()
        self.windows = options.windows
        self.threshold = float(chi2.isf(options.false_alarm / len(self.windows), channels))

    def touched(self, error: Array) -> int:
        """Number of the last samples that belong to a touch, 0 if none is seen. `error` is the
        standard deviation of the baseline over the noise, (electrodes,). Backwards from the window
        that sees the touch, the touch lasts as long as further samples make the mean deviation more
        significant, and then a quarter of that and two samples more."""
        sums = np.cumsum([deviation for *_, deviation in reversed(self.samples)], axis=0)
        windows = self.windows[: np.searchsorted(self.windows, len(sums), side="right")]
        variances = windows[:, None] + np.square(windows[:, None] * error)
        squares = (np.square(sums[windows - 1]) / variances).sum(axis=1)
        if squares.max() <= self.threshold:
            return 0
        along = sums @ sums[windows[squares.argmax()] - 1]
        size = int(np.argmax(along / np.sqrt(np.arange(1, len(along) + 1)))) + 1
        return min(size + size // 4 + 2, len(along))
