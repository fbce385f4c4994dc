"""Learning the baseline: the first samples in which nothing touches the film."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.signal.baseline import SettledBaseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample, SettledSamples
from pvdf_fem.inverse.tracking.signal.first_samples import (
    FirstSamples,
    compute_medians,
    find_channels_at_limit,
    find_signals,
)
from pvdf_fem.inverse.tracking.signal.mains_hum import MainsHum
from pvdf_fem.inverse.tracking.signal.spike_filter import remove_spikes

#: Smallest number of samples from which a baseline is learned, however slow the sampling is: two
#: for each part.
MIN_SETTLING_SAMPLES = 16
MIN_FIT_SAMPLES = 4  #: Smallest number of voltages of a channel to which a line is fitted.
#: Number of parts of the samples whose means must lie on a line.
PART_COUNT = 8
#: Probability, each time the baseline is learned, that noise alone is taken for a touch.
UNSTEADY_PROBABILITY = 1e-6
#: Means of parts that deviate from a line by less than this, in noise deviations, are steady.
MIN_UNSTEADY_DEVIATION = 0.5
#: Deviations from the first samples that begin a touch, in noise deviations. Noise exceeds them in
#: one of 500 million voltages.
ONSET_DEVIATIONS = 6.0
#: Residuals are stationary noise if their sizes in so many attempts differ by less than a factor,
#: and their peak by less than another from the last size.
STATIONARY_ATTEMPTS = 3
MAX_SIZE_RATIO = 2.5
MAX_CREST = 5.0
#: A residual voltage is distinguished from the level if it decays by this number of time constants
#: at least during the samples.
MIN_TIME_CONSTANTS = 0.05
#: A median of absolute values of a normal variable times this number is its standard deviation.
MEDIAN_TO_DEVIATION = 1.4826


class FittedBaseline(NamedTuple):
    """Baseline, and the voltages that it does not explain."""

    baseline: SettledBaseline
    errors_V: Array  #: Voltages less those of the baseline, shape (n, electrodes).


class Settling:
    """Collection of samples until they are long enough and nothing touches the film.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Noise of the channels.
    hum : MainsHum or None
        Mains hum that is learned from the same samples; None if it is already subtracted.
    duration_s : float
        Time without a touch from which the baseline is learned.
    min_noise_V : float
        Lower bound of the standard deviation of a voltage.
    max_noise_V : ndarray, shape (electrodes,)
        Largest standard deviation of coloured noise, above which it may be touches.
    expects_residual : bool
        Whether a touch before may have left voltages that still decay.

    Attributes
    ----------
    touched_from_s, touched_to_s : float
        Begin and end of a touch in the samples; NaN if there was none.
    """

    def __init__(
        self,
        circuit: ReadoutCircuit,
        hum: MainsHum | None,
        *,
        duration_s: float,
        min_noise_V: float,
        max_noise_V: Array,
        expects_residual: bool = False,
    ) -> None:
        self._hum = hum
        self._duration_s = duration_s
        self._min_noise_V = np.maximum(circuit.noise, min_noise_V)
        self._decay_rate = circuit.conductance / circuit.capacitance
        self._expects_residual = expects_residual
        self._max_noise_V = max_noise_V
        self._sizes: list[Array] = []  # Sizes of the residuals in the last unsteady attempts.
        self._samples = FirstSamples(len(self._min_noise_V))
        self._next_attempt_s = math.nan
        self.touched_from_s = math.nan
        self.touched_to_s = math.nan

    @property
    def sample_count(self) -> int:
        """Number of samples that are kept."""
        return len(self._samples)

    @property
    def ends_s(self) -> float:
        """Time in s at which the baseline is learned if nothing touches the film until then."""
        return self._next_attempt_s

    def add(self, sample: FilteredSample) -> SettledSamples | None:
        """Add a sample, and learn the baseline if there are enough.

        Returns
        -------
        SettledSamples or None
            None as long as the samples are too few, or the film is touched.
        """
        if self.sample_count == 0:
            self._next_attempt_s = sample.time_s + self._duration_s
        self._samples.add(sample)
        is_early = sample.time_s < self._next_attempt_s
        if is_early or self.sample_count < MIN_SETTLING_SAMPLES:
            return None
        return self._learn()

    def _learn(self) -> SettledSamples | None:
        """Learn the baseline from the samples, or drop their older half if the film is touched."""
        samples = self._samples
        times_s = samples.times_s
        voltages = samples.voltages
        unchanged = voltages
        is_missing = np.isnan(voltages)
        voltages = remove_spikes(voltages, self._estimate_noise(voltages))
        if self._hum is not None:
            self._hum.learn(times_s, voltages)
            voltages = voltages - self._hum.predict(times_s)
            voltages = remove_spikes(voltages, self._estimate_noise(voltages))
        is_spike = np.isnan(voltages) & ~is_missing
        noise_V = self._estimate_noise(voltages)
        has_signal = find_signals(voltages)
        count = len(samples) - len(samples) // PART_COUNT
        fitted = self._fit(times_s[:count], voltages[:count])
        residuals = np.where(has_signal, fitted.errors_V, np.nan)
        baseline = fitted.baseline
        if not _is_steady(residuals, noise_V):
            coloured = self._resolve_coloured_noise(residuals)
            if coloured is None:
                self._drop_older_half(times_s, voltages, noise_V)
                return None
            self.touched_from_s = math.nan
            noise_V = np.maximum(coloured, baseline.noise_V)
            baseline = replace(baseline, noise_V=noise_V, is_coloured=True)
        if not math.isnan(self.touched_from_s):
            self.touched_to_s = float(times_s[0])
        line_count = np.where(has_signal, baseline.count, 0)
        return SettledSamples(
            replace(baseline, count=line_count),
            count,
            spike_counts=is_spike.sum(axis=0).tolist(),
            is_at_limit=find_channels_at_limit(unchanged).tolist(),
            pending=samples.make_samples(count, voltages[count:]),
        )

    def _estimate_noise(self, voltages: Array) -> Array:
        """Estimate the noise from second differences, which hardly contain the signal of a touch.

        Returns
        -------
        ndarray, shape (electrodes,)
            Standard deviations in V, at least the given noise.
        """
        deviation = np.zeros(voltages.shape[1])
        for channel, values in enumerate(voltages.T):
            differences = np.diff(values[~np.isnan(values)], n=2)
            if len(differences):
                # The squared coefficients of a second difference are 1 + 4 + 1.
                median = float(np.median(np.abs(differences)))
                deviation[channel] = MEDIAN_TO_DEVIATION * median / math.sqrt(6.0)
        return np.maximum(deviation, self._min_noise_V)

    def _fit(self, times_s: Array, voltages: Array) -> FittedBaseline:
        """Fit the voltages of each channel by a line, or by a level and a residual that decays.

        The residual of a touch is curved, which a line and a residual would share. Therefore the
        slope is zero where there is a residual.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Times of the samples.
        voltages : ndarray, shape (n, electrodes)
            Voltages in V; NaN where they are missing.
        """
        offsets_s = times_s - times_s[-1]
        decays = self._decay_rate * (times_s[-1] - times_s[0]) > MIN_TIME_CONSTANTS
        has_residual = decays & self._expects_residual
        channel_count = voltages.shape[1]
        level = np.zeros(channel_count)
        slope = np.zeros(channel_count)
        residual = np.zeros(channel_count)
        noise_V = self._min_noise_V.copy()
        count = np.zeros(channel_count, dtype=int)
        errors_V = np.full(voltages.shape, np.nan)
        for channel in range(channel_count):
            is_measured = ~np.isnan(voltages[:, channel])
            count[channel] = is_measured.sum()
            if count[channel] < MIN_FIT_SAMPLES:
                continue
            x = offsets_s[is_measured]
            # Relative to the first sample: many time constants before the last one would overflow.
            decay = np.exp(-self._decay_rate[channel] * (x - x[0]))
            shape = decay if has_residual[channel] else x
            basis = np.column_stack([np.ones_like(x), shape])
            values = voltages[is_measured, channel]
            (level[channel], second), *_ = np.linalg.lstsq(basis, values, rcond=None)
            if has_residual[channel]:
                residual[channel] = second * np.exp(self._decay_rate[channel] * x[0])
            else:
                slope[channel] = second
            errors = values - basis @ np.array([level[channel], second])
            errors_V[is_measured, channel] = errors
            deviation = math.sqrt(errors @ errors / (len(errors) - 2))
            noise_V[channel] = max(deviation, noise_V[channel])
        baseline = SettledBaseline(
            float(times_s[-1]), level, slope, residual=residual, noise_V=noise_V, count=count
        )
        return FittedBaseline(baseline, errors_V)

    def _resolve_coloured_noise(self, residuals: Array) -> Array | None:
        """Return the noise if the residuals are stationary noise that is not white, else None.

        The noise of filtered amplifiers, vibrations and 1/f noise move the means of parts more than
        white noise does. It is recognised by its size, which is the same in several attempts and
        small compared with the lightest touch.

        Parameters
        ----------
        residuals : ndarray, shape (n, electrodes)
            Voltages above the lines in V; NaN where they are missing.

        Returns
        -------
        ndarray, shape (electrodes,)
            Standard deviations in V of the white noise whose means over parts deviate as much.
        """
        size = np.sqrt(np.nanmean(np.square(np.nan_to_num(residuals)), axis=0))
        self._sizes = [*self._sizes, size][-STATIONARY_ATTEMPTS:]
        if len(self._sizes) < STATIONARY_ATTEMPTS:
            return None
        smallest = np.min(self._sizes, axis=0)
        largest = np.max(self._sizes, axis=0)
        peak = np.abs(np.nan_to_num(residuals)).max(axis=0)
        is_stationary = (largest <= MAX_SIZE_RATIO * smallest) & (peak <= MAX_CREST * size)
        equivalent_V = np.maximum(_compute_equivalent_noise(residuals), size)
        is_small = equivalent_V < self._max_noise_V
        return equivalent_V if (is_stationary & is_small).all() else None

    def _drop_older_half(self, times_s: Array, voltages: Array, noise_V: Array) -> None:
        """Note that the film is touched, and go on with the newer half of the samples.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Times of the samples.
        voltages : ndarray, shape (n, electrodes)
            Voltages in V.
        noise_V : ndarray, shape (electrodes,)
            Standard deviations of a voltage.
        """
        self._expects_residual = True
        if math.isnan(self.touched_from_s):
            self.touched_from_s = _find_onset(times_s, voltages, noise_V)
        self._samples.drop_older_half()
        self._next_attempt_s = float(self._samples.times_s[0]) + self._duration_s


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


def _compute_equivalent_noise(residuals: Array) -> Array:
    """Compute the white noise whose means over parts deviate as much as those of residuals.

    Parameters
    ----------
    residuals : ndarray, shape (n, electrodes)
        Voltages above the lines in V; NaN where they are missing.

    Returns
    -------
    ndarray, shape (electrodes,)
        Standard deviations in V.
    """
    squares = []
    for part in np.array_split(residuals, PART_COUNT):
        count = np.maximum((~np.isnan(part)).sum(axis=0), 1)
        total = np.nansum(part, axis=0)
        squares.append(np.square(total) / count)
    # A line takes two degrees of freedom from the means of the parts.
    return np.sqrt(np.sum(squares, axis=0) / (PART_COUNT - 2))


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
    start = compute_medians(voltages[:first_count])
    deviations = np.abs(voltages - start) / noise_V
    is_changed = (deviations > ONSET_DEVIATIONS).any(axis=1)
    return float(times_s[int(np.argmax(is_changed))])
