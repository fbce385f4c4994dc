"""Search for mains hum of a nominal frequency in a block of samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.signal.hum.harmonic_windows import (
    CombinedPhasors,
    WindowFits,
    WindowPlan,
    combine_windows,
    discount_incomplete,
    fill_missing,
    fit_windows,
    square_abs,
)
from pvdf_fem.inverse.tracking.signal.hum.mains_oscillator import MainsOscillator, OscillatorDrift

#: Lower bound of the variance of a voltage in V², and relative to that of the noisiest channel, so
#: that a channel that was constant for a while recovers.
MIN_VARIANCE_V2 = 1e-18
MIN_RELATIVE_VARIANCE = 1e-2

#: Relative spread of the phasors that is allowed in the successive fits of a search. At a frequency
#: that is wrong by 0.2 Hz, the phase at both ends of half a second is wrong by 0.3 rad.
RELATIVE_SPREADS = (0.3, 0.05, 0.02)

#: Smallest number of windows in a search.
MIN_WINDOWS = 3
#: Fraction of the windows that has to agree.
MIN_AGREEING_FRACTION = 0.5


@dataclass(frozen=True, eq=False)
class HumSearch:
    """Result of a search for hum."""

    oscillator: MainsOscillator  #: Started from the block if there is hum.
    #: Squared amplitude relative to its expectation from noise, see `compute_significance`.
    significance: float
    agreeing_fraction: float  #: Fraction of the windows that fit and agree.
    noise_variance: Array  #: Variance of a voltage in V², shape (electrodes,).


def search_hum(
    plan: WindowPlan,
    times_s: Array,
    voltages: Array,
    *,
    drift: OscillatorDrift,
    min_significance: float,
) -> HumSearch:
    """Search for hum of the nominal frequency in a block of samples.

    Parameters
    ----------
    plan : WindowPlan
        Nominal frequency, harmonics and windows.
    times_s : ndarray, shape (n,)
        Times of the samples.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V, NaN where they are missing.
    drift : OscillatorDrift
        Limit of the frequency, and rates at which the hum changes.
    min_significance : float
        Significance from which the oscillator is started, see `compute_significance`.

    Returns
    -------
    HumSearch
        With the significance 0 and an infinite variance if there are less than three windows.

    Notes
    -----
    The first fit is that at the nominal frequency. Two further fits use the frequency that was
    estimated from the fit before. Missing voltages are interpolated without hum at first.
    """
    channel_count = voltages.shape[1]
    oscillator = MainsOscillator(
        plan.harmonics,
        plan.nominal_Hz,
        float(times_s[0]),
        channel_count=channel_count,
        drift=drift,
    )
    noise_variance = np.full(channel_count, math.inf)
    if len(times_s) < MIN_WINDOWS * plan.window_samples * plan.decimation:
        return HumSearch(oscillator, 0.0, agreeing_fraction=0.0, noise_variance=noise_variance)
    for relative_spread in RELATIVE_SPREADS:
        fits = fit_block(oscillator, times_s, voltages, plan=plan)
        noise_variance = bound_variance(estimate_noise_variance(fits))
        combined = combine_windows(
            fits, oscillator.phasors, noise_variance, relative_spread=relative_spread
        )
        significance = compute_significance(combined)
        if significance < min_significance:
            break
        oscillator.start(fits, combined)
    return HumSearch(
        oscillator,
        significance,
        agreeing_fraction=float(combined.weights.mean(axis=(0, 1)).min()),
        noise_variance=noise_variance,
    )


def fit_block(
    oscillator: MainsOscillator, times_s: Array, voltages: Array, *, plan: WindowPlan
) -> WindowFits:
    """Fit the windows of a block with the phase that an oscillator predicts.

    Parameters
    ----------
    oscillator : MainsOscillator
        Predicts the phase, and the hum of missing voltages.
    times_s : ndarray, shape (n,)
        Times of the samples.
    voltages : ndarray, shape (n, electrodes)
        Voltages in V, NaN where they are missing.
    plan : WindowPlan
        Harmonics and windows.
    """
    times = plan.decimate(times_s)
    values = plan.decimate(voltages)
    filled = values
    if np.isnan(values).any():
        filled = fill_missing(values, oscillator.predict_hum(times))
    fits = fit_windows(times, filled, oscillator.predict_phase(times), plan)
    return discount_incomplete(fits, times, values, plan)


def compute_significance(combined: CombinedPhasors) -> float:
    """Compute the largest squared amplitude relative to its expectation from noise.

    Parameters
    ----------
    combined : CombinedPhasors
        Phasors of a block.

    Returns
    -------
    float
        The largest value over the harmonics, of the mean over the electrodes or of half the value
        of a single electrode. It is about 1 for noise. Where too few windows agree, an electrode
        counts as 0.
    """
    ratio = square_abs(combined.phasors) / (2.0 * combined.variance)
    agreeing_fraction = combined.weights.mean(axis=0)
    ratio = np.where(agreeing_fraction < MIN_AGREEING_FRACTION, 0.0, ratio)
    return float(max(ratio.mean(axis=1).max(), 0.5 * ratio.max()))


def estimate_noise_variance(fits: WindowFits) -> Array:
    """Estimate the variance of the noise by a low quantile over the windows.

    Parameters
    ----------
    fits : WindowFits
        Fits of the windows of a block. Touches may disturb two thirds of them.

    Returns
    -------
    ndarray, shape (electrodes,)
        Variance of a voltage in V²; infinite if it is missing in most windows.
    """
    return np.sort(fits.residual_variance, axis=0)[(len(fits.times_s) - 1) // 3]


def bound_variance(variance: Array) -> Array:
    """Raise the variances of voltages in V², shape (electrodes,), to their lower bounds."""
    finite = np.where(np.isfinite(variance), variance, 0.0)
    return np.maximum(finite, max(MIN_RELATIVE_VARIANCE * finite.max(), MIN_VARIANCE_V2))
