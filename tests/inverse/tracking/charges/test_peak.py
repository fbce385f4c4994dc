"""Smoothed charges at the peak of a contact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_coeffs

from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.peak import compute_parabola_weights, smooth_charges
from pvdf_fem.inverse.tracking.charges.sample_buffer import SampleBuffer


@given(
    half=st.integers(0, 200),
    coefficients=st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4),
)
def test_the_weights_reproduce_cubic_polynomials(half, coefficients):
    """The odd terms cancel, so that a quadratic fit is exact for cubic charges."""
    x = np.linspace(-1.0, 1.0, 2 * half + 1) if half else np.zeros(1)
    values = np.polynomial.Polynomial(coefficients)(x)
    weights = compute_parabola_weights(half)
    assert len(weights) == 2 * half + 1
    assert weights @ values == pytest.approx(coefficients[0], abs=1e-10)


@pytest.mark.parametrize("half", [2, 3, 10])
def test_the_weights_are_those_of_savitzky_and_golay(half):
    """The fit of least noise: 9/(4 n) of the variance of a sample for many samples."""
    expected = savgol_coeffs(2 * half + 1, polyorder=2)
    np.testing.assert_allclose(compute_parabola_weights(half), expected, rtol=1e-9)


def make_window(charges_pC, noise_variance, is_clipped=None):
    """Make the rows of a window, one for each line of charges."""
    shape = np.shape(charges_pC)
    is_clipped = np.zeros(shape, dtype=bool) if is_clipped is None else is_clipped
    buffer = SampleBuffer(shape[1])
    for number in range(shape[0]):
        sample = ChargeSample(
            0.5 * number,
            charges_pC[number],
            noise_variance=noise_variance[number],
            walk_variance=np.full(shape[1], float(number)),
            drift_pC=np.zeros(shape[1]),
            sampling_variance=2.0 * number,
            is_clipped=is_clipped[number],
        )
        buffer.add(sample, charges_pC[number])
    return buffer.rows


def test_charges_and_their_noise_are_weighted():
    """The errors that accumulate are those of the sample at the centre."""
    rng = np.random.default_rng(0)
    charges_pC = rng.standard_normal((7, 2))
    noise_variance = rng.uniform(1.0, 2.0, (7, 2))
    weights = compute_parabola_weights(3)
    peak = smooth_charges(make_window(charges_pC, noise_variance), weights)
    np.testing.assert_allclose(peak.charges_pC, weights @ charges_pC)
    np.testing.assert_allclose(peak.noise_variance, weights**2 @ noise_variance)
    assert peak.time_s == 1.5
    assert peak.walk_variance.tolist() == [3.0, 3.0]
    assert peak.sampling_variance == 6.0


@pytest.mark.parametrize(("missing", "is_measured"), [([0, 6], True), ([2, 3, 4], False)])
def test_a_channel_is_measured_if_most_of_the_weight_is(missing, is_measured):
    charges_pC = np.full((7, 2), 5.0)
    noise_variance = np.ones((7, 2))
    noise_variance[missing, 1] = ChargeSample.MISSING
    charges_pC[missing, 1] = 1e3
    weights = compute_parabola_weights(3)
    peak = smooth_charges(make_window(charges_pC, noise_variance), weights)
    assert peak.is_measured.tolist() == [True, is_measured]
    assert peak.charges_pC[0] == pytest.approx(5.0)
    if is_measured:
        kept = np.delete(weights, missing)
        assert peak.charges_pC[1] == pytest.approx(5.0)
        expected = np.square(kept).sum() / kept.sum() ** 2
        assert peak.noise_variance[1] == pytest.approx(expected)


def test_a_channel_that_was_clipped_once_in_the_window_is_clipped():
    is_clipped = np.zeros((5, 2), dtype=bool)
    is_clipped[0, 1] = True
    window = make_window(np.ones((5, 2)), np.ones((5, 2)), is_clipped)
    peak = smooth_charges(window, compute_parabola_weights(2))
    assert peak.is_clipped.tolist() == [False, True]
    assert peak.is_measured.tolist() == [True, False]
