"""The charges at the peak of a contact, smoothed over the samples around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples

#: A channel has a peak if its readings carry this fraction of the weight of the window: loggers
#: that read four channels in turn leave a quarter.
MIN_MEASURED_WEIGHT = 0.15


def compute_parabola_weights(half: int) -> Array:
    """Compute the weights of samples in the value at their centre of a fitted parabola.

    Parameters
    ----------
    half : int
        Number of samples on each side of the centre.

    Returns
    -------
    ndarray, shape (2 half + 1,)
        Weights with the sum 1.

    Notes
    -----
    Central weights of a quadratic smoothing polynomial, (3 (3 m² + 3 m - 1) - 15 i²)/((2 m - 1)
    (2 m + 1) (2 m + 3)) for the offset i in samples: A. Savitzky and M. J. E. Golay, Analytical
    Chemistry 36 (1964), 1627. Up to three samples are only averaged by the middle one, which the
    parabola passes through.
    """
    if half < 2:
        weights = np.zeros(2 * half + 1)
        weights[half] = 1.0
        return weights
    offsets = np.arange(-half, half + 1)
    numerator = 3.0 * (3.0 * half**2 + 3.0 * half - 1.0) - 15.0 * np.square(offsets)
    return numerator / ((2.0 * half - 1.0) * (2.0 * half + 1.0) * (2.0 * half + 3.0))


def smooth_charges(window: BufferedSamples, weights: Array) -> ChargeSample:
    """Average the charges of a window, and return them as the sample at its centre.

    Parameters
    ----------
    window : BufferedSamples
        An odd number of samples.
    weights : ndarray, shape (samples,)
        Weights of the samples, with the sum 1.
    """
    is_measured = window.noise_variance < ChargeSample.MAX_VARIANCE
    weights_by_channel = weights[:, None] * is_measured
    total = weights_by_channel.sum(axis=0)
    noise = (np.square(weights_by_channel) * window.noise_variance).sum(axis=0)
    is_clipped = np.asarray(window.is_clipped.any(axis=0))
    has_peak = (total > MIN_MEASURED_WEIGHT) & ~is_clipped
    divisor = np.where(has_peak, total, 1.0)
    centre = window.get_sample(len(weights) // 2)
    charges_pC = (weights_by_channel * window.charges_pC).sum(axis=0) / divisor
    return replace(
        centre,
        charges_pC=np.where(has_peak, charges_pC, centre.charges_pC),
        noise_variance=np.where(has_peak, noise / np.square(divisor), ChargeSample.MISSING),
        is_clipped=is_clipped,
    )
