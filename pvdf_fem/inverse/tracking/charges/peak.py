"""The charges at the peak of a contact, smoothed over the samples around it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples

#: A channel has a peak if its readings carry this fraction of the weight of the window: loggers
#: that read four channels in turn leave a quarter.
MIN_MEASURED_WEIGHT = 0.15
#: Charges below the maximum by more standard deviations are not at the peak. On a plateau, the
#: largest of a thousand charges is three deviations above the mean, and one of a thousand is
#: further below the mean than three.
PLATEAU_DEVIATIONS = 6.0
#: Number of such charges in a row that ends a peak. One may be an outlier.
MIN_FALL_ROWS = 2


def compute_peak(rows: BufferedSamples) -> ChargeSample:
    """Compute the charges at the peak of a contact by smoothing.

    Parameters
    ----------
    rows : BufferedSamples
        Charges of the contact; at least one sample.

    Returns
    -------
    ChargeSample
        Smoothed charges at the time of the window's centre, with the reduced variance of their
        noise. Channels whose readings carry little of the weight of the window count as missing,
        those that were clipped in any of it as clipped.

    Notes
    -----
    The maximum of many noisy charges is biased upwards. Therefore a parabola is fitted to the
    charges in a window and evaluated at its centre. The length of the window is the number of
    charges around the maximum that are within three standard deviations of it; the window is placed
    where its mean charge is largest. Only charges of the same peak count: a force that oscillates
    has many.
    """
    comparable = find_comparable_channels(rows)
    sizes = np.sqrt(np.square(rows.charges_pC[:, comparable]).sum(axis=1))
    highest = int(np.argmax(sizes))
    top = rows.get_sample(highest)
    measured = top.is_measured & comparable
    along = np.square(top.direction[measured])
    deviation = math.sqrt(along @ top.noise_variance[measured])
    around = _find_rows_of_peak(sizes, highest, PLATEAU_DEVIATIONS * deviation)
    sizes = sizes[around]
    half = (int((sizes >= sizes.max() - 3.0 * deviation).sum()) - 1) // 2
    weights = compute_parabola_weights(half)
    sums = np.cumsum(np.concatenate([[0.0], sizes]))
    first = around.start + int(np.argmax(sums[len(weights) :] - sums[: -len(weights)]))
    return smooth_charges(rows.select(slice(first, first + len(weights))), weights)


def choose_larger_peak(
    peak: ChargeSample, kept: ChargeSample | None, rows: BufferedSamples
) -> ChargeSample:
    """Return the larger one of two peaks by the channels that may be compared.

    Parameters
    ----------
    peak : ChargeSample
        Peak of the rows.
    kept : ChargeSample, optional
        Peak from a time when the rows were finer.
    rows : BufferedSamples
        Charges of the contact.
    """
    if kept is None:
        return peak
    comparable = find_comparable_channels(rows)
    kept_size = np.linalg.norm(kept.charges_pC[comparable])
    return kept if kept_size > np.linalg.norm(peak.charges_pC[comparable]) else peak


def find_comparable_channels(rows: BufferedSamples) -> Mask:
    """Return the channels whose charges may be compared at different times.

    These are the channels that were never clipped: the charge of a clipped channel is a limit that
    jumps when its voltage is known again. If all were clipped, all are compared.
    """
    was_clipped: Mask = np.asarray(rows.is_clipped.any(axis=0))
    return np.ones_like(was_clipped) if was_clipped.all() else ~was_clipped


def _find_rows_of_peak(sizes: Array, highest: int, depth: float) -> slice:
    """Find the rows around the highest until the sizes fall, on each side.

    Parameters
    ----------
    sizes : ndarray, shape (n,)
        Sizes of the charges.
    highest : int
        Row of the largest size.
    depth : float
        The peak ends where `MIN_FALL_ROWS` sizes in a row are lower than the largest by more.
    """
    is_low = sizes < sizes[highest] - depth
    is_fall = is_low.copy()
    for shift in range(1, MIN_FALL_ROWS):
        is_fall[shift:] &= is_low[:-shift]
    # A fall is marked at its last row.
    falls = np.flatnonzero(is_fall)
    before = falls[falls < highest]
    after = falls[falls > highest]
    first = int(before[-1]) + 1 if len(before) else 0
    end = int(after[0]) - MIN_FALL_ROWS + 1 if len(after) else len(sizes)
    return slice(first, end)


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
