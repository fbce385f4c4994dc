"""Statistical tests of the charges of a contact."""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.touch.touch import compute_chi_square_limit
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.options import TrackOptions

#: Charges below this number of standard deviations are zero within their errors.
MAX_ZERO_DEVIATIONS = 3.0
#: Smallest number of channels of which one is recognised to have stepped alone.
MIN_CHANNELS = 3


def is_within_noise(difference: Array, variance: Array) -> bool:
    """Test by chi-square whether a difference of charges is explained by its variance.

    Parameters
    ----------
    difference : ndarray, shape (electrodes,)
        Difference of charges in pC.
    variance : ndarray, shape (electrodes,)
        Its variance in pC².
    """
    statistic = np.square(difference) @ (1.0 / variance)
    return bool(statistic < compute_chi_square_limit(len(difference)))


def find_only_charge(
    charges_pC: Array, variance: Array, largest_pC: float, options: TrackOptions
) -> int | None:
    """Find the electrode that alone has a charge, while those of all others are zero.

    A touch gives charges to all electrodes, so that the offset of this channel has stepped.

    Parameters
    ----------
    charges_pC : ndarray, shape (electrodes,)
        Charges.
    variance : ndarray, shape (electrodes,)
        Variances of the charges in pC².
    largest_pC : float
        Largest norm of the charges of the contact.
    options : TrackOptions
        Limits of charges, see `TrackOptions.min_step_deviations`.

    Returns
    -------
    int or None
        Number of the electrode; None if there is none, or if fewer than three are measured.
    """
    is_measured = variance < ChargeSample.MAX_VARIANCE
    if is_measured.sum() < MIN_CHANNELS:
        return None
    deviations = np.abs(charges_pC) / np.sqrt(variance)
    fractions = np.abs(charges_pC) / max(largest_pC, math.ulp(0.0))
    is_left = is_measured & (deviations > options.min_step_deviations)
    is_left &= fractions > options.min_step_fraction
    is_zero = (deviations < MAX_ZERO_DEVIATIONS) | (
        fractions < options.negligible_residual_fraction
    )
    if is_left.sum() != 1 or not is_zero[is_measured & ~is_left].all():
        return None
    return int(np.argmax(is_left))
