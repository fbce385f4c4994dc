"""Learning the baseline: the first samples in which nothing touches the film."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.mains_hum import MainsHum
from pvdf_fem.inverse.tracking.signal.reading_filter import FilteredSample

#: Fewest samples from which a baseline is learned, however slow the sampling is.
MIN_SETTLING_SAMPLES = 16
#: Number of parts of the samples whose means must lie on a line.
PART_COUNT = 8
#: Probability that noise alone is taken for a touch.
UNSTEADY_PROBABILITY = 1e-6
#: Means of parts that deviate from a line by less than this, in noise deviations, are steady.
MIN_UNSTEADY_DEVIATION = 0.5
#: Residuals from the line beyond this number of robust deviations are spikes.
SPIKE_DEVIATIONS = 6.0
#: A median of absolute values of a normal variable times this number is its standard deviation.
MEDIAN_TO_DEVIATION = 1.4826


@dataclass(frozen=True, eq=False)
class SettledBaseline:
    """Straight lines through samples without a touch, in arrays of shape (electrodes,)."""

    time_s: float  #: Time of the last sample.
    level: Array  #: Voltages in V on the lines at this time.
    slope: Array  #: In V/s.
    noise_V: Array  #: Standard deviations of a voltage about the lines.
    count: Array  #: Number of voltages on each line; 0 for a channel without a signal.


class Settling:
    """Collects samples until they are long enough and nothing touches the film.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Noise of the channels.
    hum : MainsHum
        Mains hum, which is learned from the same samples.
    duration_s : float
        Time without a touch from which the baseline is learned.
    min_noise_V : float
        Lower bound of the standard deviation of a voltage.

    Attributes
    ----------
    touched_from_s, touched_to_s : float
        Begin and end of a touch in the samples; NaN if there was none.
    """

    def __init__(
        self, circuit: ReadoutCircuit, hum: MainsHum, duration_s: float, min_noise_V: float
    ) -> None:
        self._hum = hum
        self._duration_s = duration_s
        self._min_noise_V = np.maximum(circuit.noise, min_noise_V)
        self.samples: list[FilteredSample] = []
        self._next_attempt_s = math.nan
        self.touched_from_s = math.nan
        self.touched_to_s = math.nan

    @property
    def ends_s(self) -> float:
        """Time in s at which the baseline is learned if nothing touches the film until then."""
        return self._next_attempt_s

    def add(self, sample: FilteredSample) -> SettledBaseline | None:
        """Add a sample, and learn the baseline if there are enough.

        Returns
        -------
        SettledBaseline or None
            None as long as the samples are too few, or the film is touched.
        """
        if not self.samples:
            self._next_attempt_s = sample.time_s + self._duration_s
        self.samples.append(sample)
        is_early = sample.time_s < self._next_attempt_s
        if is_early or len(self.samples) < MIN_SETTLING_SAMPLES:
            return None
        return self._learn()

    def _learn(self) -> SettledBaseline | None:
        """Learn the baseline from the samples, or drop their older half if the film is touched."""
        times_s = np.array([sample.time_s for sample in self.samples])
        voltages = np.array([sample.voltages for sample in self.samples])
        is_measured = _find_signals(voltages)
        voltages = _remove_spikes(times_s, voltages)
        self._hum.learn(times_s, voltages)
        voltages = _remove_spikes(times_s, self._hum.subtract_block(times_s, voltages))
        baseline = _fit_lines(times_s, voltages, self._min_noise_V)
        line = baseline.level + baseline.slope * (times_s - baseline.time_s)[:, None]
        residuals = np.where(is_measured, voltages - line, np.nan)
        noise_V = np.maximum(_estimate_fast_noise(voltages), self._min_noise_V)
        if _is_steady(residuals, noise_V):
            if not math.isnan(self.touched_from_s):
                self.touched_to_s = float(times_s[0])
            return SettledBaseline(
                baseline.time_s,
                baseline.level,
                baseline.slope,
                noise_V=baseline.noise_V,
                count=np.where(is_measured, baseline.count, 0),
            )
        if math.isnan(self.touched_from_s):
            self.touched_from_s = _find_onset(times_s, voltages, noise_V)
        self.samples = self.samples[len(self.samples) // 2 :]
        self._next_attempt_s = self.samples[0].time_s + self._duration_s
        return None


def _find_signals(voltages: Array) -> Mask:
    """Mark the channels that have a signal, shape (electrodes,).

    A channel has no signal if most of its voltages are missing, or if they are all equal although
    those of another channel are not.
    """
    is_measured = ~np.isnan(voltages)
    has_values = is_measured.sum(axis=0) > len(voltages) // 2
    lowest = np.where(is_measured, voltages, np.inf).min(axis=0)
    highest = np.where(is_measured, voltages, -np.inf).max(axis=0)
    varies = lowest < highest
    return np.asarray(has_values & (varies | ~varies.any()))


def _remove_spikes(times_s: Array, voltages: Array) -> Array:
    """Replace voltages far from a robust line by NaN.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times of the samples.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V.

    Returns
    -------
    ndarray, shape (n, electrodes)
        Copy of the voltages. A voltage is a spike only if the sample before or after it, at a
        distance of up to a sixteenth of the samples, is not: longer deviations are touches.
    """
    local = _compute_local_medians(voltages)
    residuals = voltages - local
    deviation = MEDIAN_TO_DEVIATION * _compute_medians(np.abs(residuals))
    limit = SPIKE_DEVIATIONS * np.maximum(deviation, 1e-12 * np.abs(local))
    return np.where(np.abs(residuals) > limit, np.nan, voltages)


def _compute_local_medians(voltages: Array) -> Array:
    """Compute the median of each voltage and those around it, shape (n, electrodes)."""
    half = max(len(voltages) // (2 * PART_COUNT), 2)
    padded = np.pad(voltages, ((half, half), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    return _compute_medians(np.moveaxis(windows, -1, 0))


def _compute_medians(values: Array) -> Array:
    """Compute medians along the first axis without missing values; 0 where all are missing."""
    is_measured = ~np.isnan(values)
    ordered = np.sort(values, axis=0)  # NaN comes last
    count = is_measured.sum(axis=0)
    middle = np.maximum(count - 1, 0) // 2
    median = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.where(count > 0, median, 0.0)


def _fit_lines(times_s: Array, voltages: Array, min_noise_V: Array) -> SettledBaseline:
    """Fit a least-squares line to the voltages of each channel.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times of the samples.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V; NaN where they are missing.
    min_noise_V : ndarray, shape (electrodes,)
        Lower bounds of the standard deviations.
    """
    end_s = float(times_s[-1])
    is_measured = ~np.isnan(voltages)
    count = is_measured.sum(axis=0)
    divisor = np.maximum(count, 1)
    weights = is_measured.astype(float)
    offsets = (times_s - end_s)[:, None]
    values = np.where(is_measured, voltages, 0.0)
    mean_offset = (weights * offsets).sum(axis=0) / divisor
    mean_value = values.sum(axis=0) / divisor
    centred = weights * (offsets - mean_offset)
    spread = np.maximum(np.square(centred).sum(axis=0), math.ulp(0.0))
    slope = (centred * values).sum(axis=0) / spread
    level = mean_value - slope * mean_offset
    residuals = weights * (values - level - slope * offsets)
    variance = np.square(residuals).sum(axis=0) / np.maximum(count - 2, 1)
    noise_V = np.maximum(np.sqrt(variance), min_noise_V)
    return SettledBaseline(end_s, level, slope, noise_V=noise_V, count=count)


def _estimate_fast_noise(voltages: Array) -> Array:
    """Estimate the noise from second differences, which hardly contain the signal of a touch.

    Returns
    -------
    ndarray, shape (electrodes,)
        Standard deviations in V.
    """
    differences = np.diff(voltages, n=2, axis=0)
    # The squared coefficients of a second difference are 1 + 4 + 1.
    return MEDIAN_TO_DEVIATION * _compute_medians(np.abs(differences)) / math.sqrt(6.0)


def _is_steady(residuals: Array, noise_V: Array) -> bool:
    """Test whether the means of parts of the residuals are explained by the noise.

    Parameters
    ----------
    residuals : ndarray, shape (n, electrodes)
        Voltages above the lines in V; NaN where they are missing.
    noise_V : ndarray, shape (electrodes,)
        Standard deviations of a voltage.
    """
    statistic = 0.0
    degrees_of_freedom = 0
    largest = 0.0
    for part in np.array_split(residuals / noise_V, PART_COUNT):
        is_measured = ~np.isnan(part)
        count = is_measured.sum(axis=0)
        total = np.where(is_measured, part, 0.0).sum(axis=0)
        divisor = np.maximum(count, 1)
        statistic += float((np.square(total) / divisor).sum())
        degrees_of_freedom += int((count > 0).sum())
        largest = max(largest, float(np.abs(total / divisor).max()))
    limit = chdtri(max(degrees_of_freedom, 1), UNSTEADY_PROBABILITY)
    return statistic < limit or largest < MIN_UNSTEADY_DEVIATION


def _find_onset(times_s: Array, voltages: Array, noise_V: Array) -> float:
    """Find the time at which the voltages leave those of the first samples.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times of the samples.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V; NaN where they are missing.
    noise_V : ndarray, shape (electrodes,)
        Standard deviations of a voltage.

    Returns
    -------
    float
        Time in s.
    """
    first_count = max(len(voltages) // PART_COUNT, 2)
    start = _compute_medians(voltages[:first_count])
    deviations = np.abs(voltages - start) / noise_V
    is_changed = (deviations > SPIKE_DEVIATIONS).any(axis=1)
    return float(times_s[int(np.argmax(is_changed))])
