"""Phasors of mains harmonics in short windows of a stream, apart from a slow signal.

A stream is cut into windows of a few mains periods. In each window, a polynomial stands for the
touch and the drift, and a cosine and a sine for each harmonic. Several successive windows are then
combined. Windows in which the sum of both does not fit (the edge of an impact), or which disagree
with the others (a touch that is shorter than a window), count little, and what disagreement is left
enlarges the variance of the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array, Indices

Phasors = NDArray[np.complex128]

#: Degree of the polynomial, and mains periods in a window. A pulse of 0.6 V, sin² in 0.2 s, then
#: adds 5 µV to the 50 Hz phasor of a window inside the pulse, and the residual of the fit is four
#: times this error, so that it can be noticed. With 2 periods and degree 3 it is 130 µV, and the
#: residual is half of that.
POLYNOMIAL_DEGREE = 4
PERIODS_PER_WINDOW = 3.0

#: Limits of the frequency at which a harmonic appears in the samples: as a fraction of the sampling
#: rate, and in Hz. Slower harmonics cannot be distinguished from touches.
MAX_RELATIVE_FREQUENCY = 0.45
MIN_FREQUENCY_HZ = 8.0

#: Faster streams are decimated to this rate, so that the fits of a block take a millisecond.
DECIMATED_RATE_HZ = 4000.0

#: Smallest number of samples in a window for each coefficient of its fit. Three windows of 13
#: samples then fit into half a second at 80 Hz.
SAMPLES_PER_COEFFICIENT = 1.8

#: Regularisation relative to the mean square of a column. It only matters where samples share their
#: times, so that the coefficients are not determined.
RELATIVE_RIDGE = 1e-9

#: Longest window that counts, relative to its planned duration. A longer one contains a pause.
MAX_RELATIVE_DURATION = 1.5

#: Largest fraction of missing voltages in a window that counts.
MAX_MISSING_FRACTION = 0.25

#: Ratio of the variance of a fit's residual to that of the noise at which a window counts half, for
#: many degrees of freedom, and what is added in standard deviations of this ratio for fewer.
HALF_WEIGHT_RATIO = 2.0
HALF_WEIGHT_DEVIATIONS = 4.0
#: Limit of this ratio, and of the squared distance below, against overflow.
MAX_RATIO = 1e9
#: Squared distance from the median of the windows, relative to its expectation, at which a window
#: counts half. Noise exceeds it with a probability of exp(-9).
HALF_WEIGHT_DISTANCE = 9.0
#: Spread of the phasors of a block, relative to their median, that hum itself may have: the phase
#: of hum whose frequency is wrong by 30 mHz changes by so many rad within a tenth of a second.
RELATIVE_SPREAD = 0.02
#: Scatter of the windows, relative to that expected from the noise, which chance alone explains.
MAX_CHANCE_SCATTER = 2.0


def fold_frequency(frequency_Hz: float, rate_Hz: float) -> float:
    """Compute the frequency at which a sine appears in samples taken at a given rate."""
    return abs(frequency_Hz - rate_Hz * round(frequency_Hz / rate_Hz))


@dataclass(frozen=True, eq=False)
class WindowPlan:
    """Harmonics and windows for one mains frequency and sampling rate."""

    nominal_Hz: float
    rate_Hz: float
    harmonics: Indices  #: Multiples of the mains frequency, shape (harmonics,).
    window_samples: int  #: After decimation.
    window_count: int  #: Windows that are combined at a time.
    #: Number of successive samples that are replaced by their mean before the fit.
    decimation: int = 1

    @classmethod
    def from_rate(
        cls, nominal_Hz: float, rate_Hz: float, *, harmonic_count: int, block_s: float
    ) -> WindowPlan:
        """Choose the harmonics that can be distinguished, and the windows.

        Parameters
        ----------
        nominal_Hz : float
            Nominal frequency of the mains.
        rate_Hz : float
            Sampling rate.
        harmonic_count : int
            Largest multiple of the mains frequency.
        block_s : float
            Duration of the windows that are combined at a time. It is extended to three windows.

        Notes
        -----
        Harmonics above the limit of the sampling rate are left out. If this applies to the mains
        frequency itself, the alias of the mains frequency is used. There are almost twice as many
        samples in a window as coefficients, at least.
        """
        multiples = []
        slowest_Hz = math.inf
        for multiple in range(1, harmonic_count + 1):
            frequency_Hz = multiple * nominal_Hz
            if multiple == 1:
                frequency_Hz = fold_frequency(frequency_Hz, rate_Hz)
            is_fast = frequency_Hz >= MIN_FREQUENCY_HZ
            if is_fast and frequency_Hz <= MAX_RELATIVE_FREQUENCY * rate_Hz:
                multiples.append(multiple)
                slowest_Hz = min(slowest_Hz, frequency_Hz)
        decimation = max(int(rate_Hz / DECIMATED_RATE_HZ), 1)
        coefficient_count = POLYNOMIAL_DEGREE + 1 + 2 * len(multiples)
        samples = PERIODS_PER_WINDOW * rate_Hz / (slowest_Hz * decimation)
        window_samples = max(
            math.ceil(samples), math.ceil(SAMPLES_PER_COEFFICIENT * coefficient_count)
        )
        window_s = window_samples * decimation / rate_Hz
        window_count = max(round(block_s / window_s), 3)
        harmonics = np.array(multiples, dtype=np.int64)
        return cls(
            nominal_Hz,
            rate_Hz,
            harmonics=harmonics,
            window_samples=window_samples,
            window_count=window_count,
            decimation=decimation,
        )

    @property
    def block_samples(self) -> int:
        """Number of samples in the windows that are combined at a time, before decimation."""
        return self.window_samples * self.window_count * self.decimation

    @property
    def window_s(self) -> float:
        """Duration of a window in s."""
        return self.window_samples * self.decimation / self.rate_Hz

    @property
    def gains(self) -> Array:
        """Factors by which the decimation reduces the harmonics, shape (harmonics,).

        The mean of q samples of a sine is reduced by sin(q x)/(q sin x), where 2 x is the phase
        between two samples.
        """
        half_phase = np.pi * self.nominal_Hz * self.harmonics / self.rate_Hz
        return np.sin(self.decimation * half_phase) / (self.decimation * np.sin(half_phase))

    def decimate(self, values: Array) -> Array:
        """Replace successive samples by their means.

        Parameters
        ----------
        values : ndarray, shape (n, ...)
            A value for each sample. What is left at the end is ignored.

        Returns
        -------
        ndarray, shape (n // decimation, ...)
            The means; NaN where a value is NaN.
        """
        if self.decimation == 1:
            return values
        count = len(values) // self.decimation
        used = values[: count * self.decimation]
        return used.reshape(count, self.decimation, *values.shape[1:]).mean(axis=1)


class WindowFits(NamedTuple):
    """Least-squares fits of successive windows.

    The voltage of a harmonic h is Re(phasor exp(i h φ)), with the phase φ of the mains that was
    assumed for the fit.
    """

    times_s: Array  #: Middle of each window, shape (windows,).
    phasors: Phasors  #: In V, shape (windows, harmonics, electrodes).
    #: Variance of the residual in V², infinite where too many voltages are missing, shape
    #: (windows, electrodes).
    residual_variance: Array
    #: Variance of the real and the imaginary part of a phasor for a noise of 1 V², shape
    #: (harmonics,).
    unit_variance: Array
    degrees_of_freedom: int  #: Of each residual variance.


class CombinedPhasors(NamedTuple):
    """Phasors of several windows, combined by a robust mean."""

    time_s: float  #: Weighted mean of the times of the windows.
    phasors: Phasors  #: In V, shape (harmonics, electrodes).
    #: Variance of the real and the imaginary part in V², shape (harmonics, electrodes).
    variance: Array
    #: Weight of each window between 0 and 1, shape (windows, harmonics, electrodes).
    weights: Array


def fit_windows(times_s: Array, voltages: Array, phase_rad: Array, plan: WindowPlan) -> WindowFits:
    """Fit a polynomial and the harmonics to the voltages of each window.

    Parameters
    ----------
    times_s : ndarray, shape (n,)
        Times of the samples, after decimation. Samples after the last full window are ignored.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V without NaN, see `fill_missing`.
    phase_rad : ndarray, shape (n,)
        Assumed phase of the mains at each sample.
    plan : WindowPlan
        Harmonics and number of samples in a window.

    Returns
    -------
    WindowFits
        Without regard to missing voltages, see `discount_incomplete`.
    """
    samples = plan.window_samples
    count = len(times_s) // samples
    used = count * samples
    time = times_s[:used].reshape(count, samples)
    values = voltages[:used].reshape(count, samples, -1)
    values = values - values[:, :1]
    design = _make_design(time, phase_rad[:used], plan)
    transposed = design.transpose(0, 2, 1)
    ridge = RELATIVE_RIDGE * samples * np.eye(design.shape[2])
    inverse = np.linalg.inv(transposed @ design + ridge)
    coefficients = inverse @ (transposed @ values)
    residuals = values - design @ coefficients
    degrees_of_freedom = samples - design.shape[2]
    residual_variance = np.einsum("wse,wse->we", residuals, residuals) / degrees_of_freedom

    first = POLYNOMIAL_DEGREE + 1
    middle = first + len(plan.harmonics)
    phasors = coefficients[:, first:middle] - 1j * coefficients[:, middle:]
    mean_variance = np.diagonal(inverse, axis1=1, axis2=2).mean(axis=0)
    unit_variance = 0.5 * (mean_variance[first:middle] + mean_variance[middle:])
    return WindowFits(
        0.5 * (time[:, 0] + time[:, -1]),
        phasors,
        residual_variance=residual_variance,
        unit_variance=unit_variance,
        degrees_of_freedom=degrees_of_freedom,
    )


def _make_design(time_s: Array, phase_rad: Array, plan: WindowPlan) -> Array:
    """Make the design matrices: Legendre polynomials, cosines and sines.

    Parameters
    ----------
    time_s : ndarray, shape (windows, samples)
        Times of the samples.
    phase_rad : ndarray, shape (windows * samples,)
        Phase of the mains at each sample.
    plan : WindowPlan
        Harmonics, and the factors by which the decimation reduces them.

    Returns
    -------
    ndarray, shape (windows, samples, coefficients)
        The columns of the polynomials, of the cosines and of the sines.
    """
    harmonics = plan.harmonics
    first = POLYNOMIAL_DEGREE + 1
    middle = first + len(harmonics)
    design = np.empty((*time_s.shape, middle + len(harmonics)))
    start = time_s[:, :1]
    x = 2.0 * (time_s - start) / np.maximum(time_s[:, -1:] - start, 1e-12) - 1.0
    design[..., 0] = 1.0
    design[..., 1] = x
    for degree in range(1, POLYNOMIAL_DEGREE):
        # Bonnet's recursion of the Legendre polynomials.
        product = (2 * degree + 1) * x * design[..., degree]
        design[..., degree + 1] = (product - degree * design[..., degree - 1]) / (degree + 1)
    # Successive powers of exp(i φ) cost a tenth of the cosines and sines of all multiples.
    powers = np.empty((len(phase_rad), harmonics[-1]), dtype=complex)
    powers[:] = np.exp(1j * phase_rad)[:, None]
    columns: Phasors = np.multiply.accumulate(powers, axis=1)[:, harmonics - 1]
    if plan.decimation > 1:
        columns = columns * plan.gains
    rotations = columns.reshape(*time_s.shape, -1)
    design[..., first:middle] = rotations.real
    design[..., middle:] = rotations.imag
    return design


def fill_missing(voltages: Array, hum: Array) -> Array:
    """Replace missing voltages by their neighbours on the line without hum, plus the hum.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V, NaN where they are missing.
    hum : ndarray, shape (n, electrodes)
        Predicted hum in V.

    Returns
    -------
    ndarray, shape (n, electrodes)
        Voltages in V; a channel without any voltage becomes zero.
    """
    filled = voltages.copy()
    index = np.arange(len(voltages))
    for electrode, is_missing in enumerate(np.isnan(voltages).T):
        if not is_missing.any():
            continue
        known = index[~is_missing]
        if not len(known):
            filled[:, electrode] = 0.0
            continue
        smooth = voltages[known, electrode] - hum[known, electrode]
        interpolated = np.interp(index[is_missing], known, smooth)
        filled[is_missing, electrode] = interpolated + hum[is_missing, electrode]
    return filled


def discount_incomplete(
    fits: WindowFits, times_s: Array, voltages: Array, plan: WindowPlan
) -> WindowFits:
    """Give an infinite residual to windows with a pause or too many missing voltages.

    Parameters
    ----------
    fits : WindowFits
        Fits of voltages whose missing values were filled.
    times_s : ndarray, shape (n,)
        Times of the samples.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V, NaN where they are missing.
    plan : WindowPlan
        Number of samples in a window.
    """
    count = len(fits.times_s)
    used = count * plan.window_samples
    time = times_s[:used].reshape(count, -1)
    has_pause = time[:, -1] - time[:, 0] > MAX_RELATIVE_DURATION * plan.window_s
    is_missing = np.isnan(voltages[:used]).reshape(count, plan.window_samples, -1)
    is_incomplete = is_missing.mean(axis=1) > MAX_MISSING_FRACTION
    is_incomplete |= has_pause[:, None]
    variance = np.where(is_incomplete, np.inf, fits.residual_variance)
    return fits._replace(residual_variance=variance)


def combine_windows(
    fits: WindowFits,
    expected: Phasors,
    noise_variance: Array,
    *,
    relative_spread: float = RELATIVE_SPREAD,
) -> CombinedPhasors:
    """Combine the phasors of several windows by a robust mean.

    Parameters
    ----------
    fits : WindowFits
        Fits of the windows.
    expected : ndarray, shape (harmonics, electrodes)
        Expected phasors in V. They replace those of windows whose fit is poor in the median about
        which outliers are sought.
    noise_variance : ndarray, shape (electrodes,)
        Variance of a voltage in V².
    relative_spread : float
        Spread of the phasors relative to their median that hum itself may have.

    Returns
    -------
    CombinedPhasors
        Weighted mean over the windows.

    Notes
    -----
    The variance is that of the noise, which the scatter of the windows raises. The median of the
    scatter over the electrodes shows whether the noise is stronger at this frequency than on
    average (coloured noise). The scatter of one electrode counts if chance does not explain it.
    """
    ratio = np.minimum(fits.residual_variance / noise_variance, MAX_RATIO)
    deviation = math.sqrt(2.0 / fits.degrees_of_freedom)
    half_weight_ratio = HALF_WEIGHT_RATIO + HALF_WEIGHT_DEVIATIONS * deviation
    fit_weight = 1.0 / (1.0 + np.square(np.square(ratio / half_weight_ratio)))
    is_fit = (fit_weight > 0.5)[:, None]
    sorted_parts = np.sort(np.where(is_fit, fits.phasors, expected).view(float), axis=0)
    middle = (len(sorted_parts) - 1) // 2
    median = 0.5 * (sorted_parts[middle] + sorted_parts[-1 - middle]).view(complex)

    window_variance = fits.unit_variance[:, None] * noise_variance
    spread = window_variance + np.square(relative_spread) * square_abs(median)
    distance = square_abs(fits.phasors - median) / (2.0 * spread)
    distance = np.minimum(distance, MAX_RATIO)
    outlier_weight = 1.0 / (1.0 + np.square(distance / HALF_WEIGHT_DISTANCE))
    weights = fit_weight[:, None] * outlier_weight
    total = np.maximum(weights.sum(axis=0), 1e-30)
    mean = np.einsum("whe,whe->he", weights, fits.phasors) / total

    scatter = np.einsum("whe,whe->he", weights, square_abs(fits.phasors - mean))
    scatter_ratio = scatter / (2.0 * np.maximum(total - 1.0, 0.1) * window_variance)
    pooled_ratio = np.maximum(np.median(scatter_ratio, axis=1, keepdims=True), 1.0)
    is_excessive = scatter_ratio > MAX_CHANCE_SCATTER * pooled_ratio
    inflation = np.where(is_excessive, scatter_ratio, pooled_ratio)
    weight_of_time = weights.sum(axis=(1, 2))
    time_s = float(weight_of_time @ fits.times_s / max(weight_of_time.sum(), 1e-30))
    return CombinedPhasors(
        time_s,
        mean,
        variance=inflation * window_variance / total,
        weights=weights,
    )


def square_abs(values: Phasors) -> Array:
    """Compute the squared absolute values of complex numbers."""
    return np.square(values.real) + np.square(values.imag)
