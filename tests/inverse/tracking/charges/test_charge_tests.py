"""Tests whether charges are zero, or those of a step of one channel."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.touch.touch import SIGNIFICANCE
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.charge_tests import find_only_charge, is_within_noise
from pvdf_fem.inverse.tracking.options import DEFAULTS

LARGEST_PC = 100.0
OPTIONS = replace(DEFAULTS, min_step_deviations=20.0, min_step_fraction=0.05)


@pytest.mark.parametrize("channel_count", [1, 4, 16])
def test_noise_exceeds_its_limit_with_the_stated_probability(channel_count):
    rng = np.random.default_rng(0)
    variance = rng.uniform(0.5, 8.0, channel_count)
    count = 40_000
    exceeded = 0
    for noise in rng.standard_normal((count, channel_count)):
        exceeded += not is_within_noise(np.sqrt(variance) * noise, variance)
    expected = SIGNIFICANCE * count
    assert abs(exceeded - expected) < 5.0 * expected**0.5


def find(charges_pC, variance=1.0):
    """Find the only charge of channels with equal variances, or given ones."""
    charges_pC = np.array(charges_pC, dtype=float)
    variances = np.broadcast_to(variance, charges_pC.shape)
    return find_only_charge(charges_pC, variances, LARGEST_PC, OPTIONS)


@pytest.mark.parametrize("number", [0, 2, 3])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_channel_that_alone_has_a_charge_is_found(number, sign):
    charges_pC = np.array([0.5, -2.5, 2.9, 0.0])
    charges_pC[number] = 40.0 * sign
    assert find(charges_pC) == number


@pytest.mark.parametrize(
    ("charges_pC", "variance"),
    [
        ([40.0, 3.2, 0.0, 0.0], 1.0),  # A second channel has a small charge.
        ([40.0, 40.0, 0.0, 0.0], 1.0),
        ([0.0, 0.0, 0.0, 0.0], 1.0),
        ([19.0, 0.0, 0.0, 0.0], 1.0),  # Fewer than 20 deviations.
        ([4.9, 0.0, 0.0, 0.0], 1e-2),  # Less than 5 % of the largest charges.
        ([40.0, 0.0], 1.0),  # Two channels do not show which one has stepped.
        ([40.0, 0.0, 0.0], [1.0, 1.0, ChargeSample.MISSING]),
    ],
)
def test_other_charges_are_no_step(charges_pC, variance):
    assert find(charges_pC, variance) is None


def test_missing_channels_do_not_count():
    """Their charges are unknown, however large the last value is."""
    variance = [ChargeSample.MISSING, 1.0, 1.0, 1.0]
    assert find([1e3, 0.0, 50.0, 0.0], variance) == 2


def test_a_charge_below_one_percent_of_the_largest_is_negligible():
    assert find([40.0, 0.9, 0.0, 0.0], 1e-4) == 0
    assert find([40.0, 1.1, 0.0, 0.0], 1e-4) is None
