"""The voltages while nothing touches, their noise, and when a touch begins."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from scipy.stats import chi2

from pvdf_fem.arrays import Array
from pvdf_fem.tracking.circuit import LEAST_NOISE, Circuit

#: Samples over which deviations are summed up to see a touch.
WINDOWS = np.array([1, 2, 4, 8, 16, 32, 64])
#: Bound on the probability of a false alarm in a sample, split evenly over the windows.
FALSE_ALARM = 1e-7
LEFT = 0.1  #: Share of voltages that are left of a touch when they stay.
#: First samples, whose deviations from the line through those before tell nothing of the noise.
EARLY = 8
#: Samples with the same weight that give a line's end the variance of the filter's, per memory.
MEMORY_WORTH = 3.2


class Baseline:
    """Level and slope of quiet voltages. They follow the samples by the least squares of a line,
    first through all samples, later with a memory of `memory` samples that fades exponentially (the
    α-β filter that is critically damped). They are given samples only when these are so old that a
    slow touch would have been seen."""

    def __init__(self, circuit: Circuit, memory: int) -> None:
        self.circuit, self.memory, self.count = circuit, memory, 0
        self.fresh = 0  #: Samples since a touch from which the level was taken anew.
        none = np.zeros_like(circuit.noise)
        self.time, self.level, self.slope, self.square = 0.0, none, none, none
        self.left, self.left_at = none, 0.0  #: Voltages that a touch left, and when; they decay.

    def at(self, time: float) -> Array:
        """Quiet voltages at a time."""
        return self.level + self.slope * (time - self.time) + self.remaining(time)

    def remaining(self, time: float) -> Array:
        """What is left at a time of the voltages that a touch left."""
        return self.left * self.circuit.decay(time - self.left_at) if self.left.any() else self.left

    @property
    def noise(self) -> Array:
        """Standard deviation of the voltages: that of the quiet signal, at least the scene's."""
        return np.maximum(np.sqrt(self.square), np.maximum(self.circuit.noise, LEAST_NOISE))

    def relative_error(self, samples: float = 0.0) -> float:
        """Standard deviation of the level over the noise, after samples without a look at it. It is
        that of the end of a straight line through as many samples as the memory is worth."""
        count = min(self.count, MEMORY_WORTH * self.memory)
        return math.hypot(2.0 / math.sqrt(count) * (1.0 + samples / count), self.fresh**-0.5)

    def keep(self, since: float, time: float, voltages: Array) -> None:
        """Go on after a touch that leaves voltages (n, channels) over the level, NaN for none. They
        are of the samples after `since` to `time`. Where they stay, the level is learned anew."""
        decay = self.circuit.decay(np.linspace(time - since, 0.0, len(voltages) + 1)[1:])
        stay = decay[0].max() > LEFT
        self.left = np.nan_to_num((voltages * decay).mean(axis=0) if stay else voltages[-1])
        self.left_at, self.fresh = time, len(voltages) if stay else self.fresh

    def follow(self, time: float, voltage: Array) -> None:
        """Take a quiet sample in; a channel that was never heard before begins all anew."""
        self.count += 1
        if self.count == 1 or (np.isnan(self.level) & ~np.isnan(voltage)).any():
            self.count, self.fresh, self.time, self.level = 1, 1, time, voltage
            self.slope, self.square = np.zeros_like(voltage), np.zeros_like(voltage)
            return
        self.fresh += 1
        k, share = self.count, 1.0 / self.memory
        step, surprise = time - self.time, np.nan_to_num(voltage - self.at(time))
        gain = max(2.0 * (2 * k - 1) / (k * (k + 1)), 2.0 * share, 1.0 / self.fresh)
        bend = max(6.0 / (k * (k + 1)), share**2)
        self.level = self.level + self.slope * step + gain * surprise
        self.slope = self.slope + bend / step * surprise
        self.time = time
        if k > EARLY:
            weight = max(1.0 / (k - EARLY), share)
            self.square = self.square + weight * (np.square(surprise) - self.square)


class Watch:
    """Deviations of the last samples from the baseline, summed up over several windows. A touch is
    seen when one of the sums of squares over the channels, each over its variance, is above what
    noise exceeds in one of 1/`FALSE_ALARM` samples."""

    def __init__(self, channels: int) -> None:
        #: Times, voltages, and deviations over the noise.
        self.samples: deque[tuple[float, Array, Array]] = deque()
        self.threshold = float(chi2.isf(FALSE_ALARM / len(WINDOWS), channels))

    def touched(self, error: float) -> int:
        """Number of the last samples that belong to a touch, 0 if none is seen. `error` is the
        standard deviation of the baseline over the noise. Backwards from the window that sees it,
        the touch lasts as long as further samples make the mean deviation more significant, and
        then a quarter of that and two samples more."""
        sums = np.cumsum([deviation for *_, deviation in reversed(self.samples)], axis=0)
        windows = WINDOWS[: np.searchsorted(WINDOWS, len(sums), side="right")]
        squares = np.square(sums[windows - 1]).sum(axis=1)
        squares /= windows + np.square(windows * error)
        if squares.max() <= self.threshold:
            return 0
        along = sums @ sums[windows[squares.argmax()] - 1]
        size = int(np.argmax(along / np.sqrt(np.arange(1, len(along) + 1)))) + 1
        return min(size + size // 4 + 2, len(along))
