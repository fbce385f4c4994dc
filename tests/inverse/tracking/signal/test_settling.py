"""The baseline that is learned from the first samples."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample
from pvdf_fem.inverse.tracking.signal.settling import Settling
from tests.helpers.tracking.baselines import make_circuit

NOISE_V = 1e-3
MIN_NOISE_V = 1e-6
DURATION_S = 0.4
CHANNELS = 4


def make_settling(
    *,
    time_constant_s=math.inf,
    expects_residual=False,
    channel_count=CHANNELS,
    max_noise_V=0.0,
):
    """Make an empty collection of samples."""
    return Settling(
        make_circuit(channel_count, time_constant_s=time_constant_s),
        None,
        duration_s=DURATION_S,
        min_noise_V=MIN_NOISE_V,
        max_noise_V=np.full(channel_count, max_noise_V),
        expects_residual=expects_residual,
    )


def make_noise(count, seed=0, channel_count=CHANNELS):
    """Make noise of all channels."""
    return NOISE_V * np.random.default_rng(seed).standard_normal((count, channel_count))


def settle(settling, voltages, *, rate_Hz=1000.0, is_clipped=None):
    """Return the learned baseline and the number of samples that it took, or None."""
    for number, row in enumerate(voltages):
        flags = [False] * len(row) if is_clipped is None else is_clipped[number].tolist()
        settled = settling.add(FilteredSample(number / rate_Hz, row.tolist(), flags))
        if settled:
            return settled, number + 1
    return None, len(voltages)


@pytest.mark.parametrize("rate_Hz", [50.0, 1000.0, 5000.0])
def test_it_takes_the_same_time_at_any_rate(rate_Hz):
    """The last eighth is pending: a contact may begin in it."""
    settling = make_settling()
    settled, count = settle(settling, make_noise(round(rate_Hz)), rate_Hz=rate_Hz)
    expected = round(DURATION_S * rate_Hz) + 1
    assert count == expected
    assert settling.ends_s == pytest.approx(DURATION_S)
    assert len(settled.pending) == count // 8
    assert settled.sample_count == count - count // 8
    assert settled.baseline.time_s == (settled.sample_count - 1) / rate_Hz
    assert settled.pending[0].time_s == settled.sample_count / rate_Hz


@settings(max_examples=20)
@given(level_V=st.floats(-3.0, 3.0), slope_V_s=st.floats(-0.5, 0.5), seed=st.integers(0, 1000))
def test_level_slope_and_noise_are_found_within_their_errors(level_V, slope_V_s, seed):
    """Six standard errors of a least-squares line, at its end: 2/√n, and √12/(√n T)."""
    times = 1e-3 * np.arange(600)
    line = level_V + slope_V_s * times
    settled, _ = settle(make_settling(), line[:, None] + make_noise(600, seed))
    baseline = settled.baseline
    count = settled.sample_count
    error_V = NOISE_V / math.sqrt(count)
    expected_V = level_V + slope_V_s * baseline.time_s
    np.testing.assert_allclose(baseline.level, expected_V, atol=6.0 * 2.0 * error_V)
    np.testing.assert_allclose(
        baseline.slope, slope_V_s, atol=6.0 * math.sqrt(12.0) * error_V / baseline.time_s
    )
    np.testing.assert_allclose(baseline.noise_V, NOISE_V, rtol=6.0 / math.sqrt(2.0 * count))
    assert baseline.count.tolist() == [count] * CHANNELS
    assert not baseline.residual.any()


def test_the_noise_of_few_samples_is_unbiased():
    """A line through 19 samples takes two degrees of freedom, which is 11 % of the variance."""
    noise = make_noise(22, channel_count=400)
    settled, count = settle(make_settling(channel_count=400), noise, rate_Hz=50.0)
    assert count == 21
    assert np.square(settled.baseline.noise_V).mean() == pytest.approx(NOISE_V**2, rel=0.06)


@pytest.mark.parametrize(("deviations", "fraction"), [(8.0, 0.1), (12.0, 0.9)])
def test_spikes_are_found_by_the_noise_of_the_samples(deviations, fraction):
    """The limit is ten deviations: of 400 channels, hardly any or almost all find their spike."""
    noise = make_noise(401, channel_count=400)
    noise[200] += deviations * NOISE_V
    settled, _ = settle(make_settling(channel_count=400), noise)
    assert np.mean(settled.spike_counts) == pytest.approx(fraction, abs=0.1)


@pytest.mark.parametrize("time_constant_s", [0.1, 0.5])
def test_a_residual_that_decays_is_told_from_the_level(time_constant_s):
    """Within the stated errors of least squares, over 200 channels."""
    times = 1e-3 * np.arange(600)
    decay = np.exp(-times / time_constant_s)
    voltages = (0.1 + 0.2 * decay)[:, None] + make_noise(600, channel_count=200)
    settling = make_settling(
        time_constant_s=time_constant_s, expects_residual=True, channel_count=200
    )
    settled, count = settle(settling, voltages)
    assert count == 401
    baseline = settled.baseline
    used = slice(settled.sample_count)
    end = decay[settled.sample_count - 1]
    basis = np.column_stack([np.ones(settled.sample_count), decay[used] / end])
    covariance = NOISE_V**2 * np.linalg.inv(basis.T @ basis)
    for values, expected, variance in (
        (baseline.level, 0.1, covariance[0, 0]),
        (baseline.residual, 0.2 * end, covariance[1, 1]),
    ):
        assert values.mean() == pytest.approx(expected, abs=4.0 * math.sqrt(variance / 200))
        assert values.std() == pytest.approx(math.sqrt(variance), rel=0.2)
    assert not baseline.slope.any()


def test_a_touch_is_noticed_and_the_baseline_is_learned_after_it():
    """It begins at 0.2 s and ends at 0.5 s; then 0.4 s without a touch are needed."""
    times = 1e-3 * np.arange(3000)
    is_pressed = (times > 0.1995) & (times < 0.4995)
    voltages = make_noise(3000) + 0.05 * is_pressed[:, None] * np.arange(1, 5)
    settling = make_settling()
    settled, count = settle(settling, voltages)
    assert settling.touched_from_s == pytest.approx(0.2, abs=1.5e-3)
    assert settling.touched_to_s == pytest.approx(0.5, abs=0.15)
    assert 0.9 <= 1e-3 * count < 1.4
    np.testing.assert_allclose(settled.baseline.level, 0.0, atol=6.0 * 2.0 * NOISE_V / 15.0)


def test_noise_is_hardly_ever_taken_for_a_touch():
    """Not once in 300 streams, with white noise and with the steps of a coarse converter."""
    for seed in range(300):
        noise = make_noise(65, seed)
        if seed % 2:
            noise = 5e-4 * np.round(noise / 5e-4)
        settling = make_settling()
        settled, _ = settle(settling, noise, rate_Hz=160.0)
        assert settled
        assert math.isnan(settling.touched_from_s)


@settings(max_examples=40)
@given(
    length=st.integers(1, 4),
    start=st.integers(0, 346),
    size_V=st.one_of(st.floats(0.05, 1e5), st.floats(-1e5, -0.05)),
)
def test_spikes_change_nothing_wherever_they_are(length, start, size_V):
    clean = make_noise(401)
    voltages = clean.copy()
    voltages[start : start + length, 1] += size_V
    voltages[start : start + length, 2] -= size_V
    settling = make_settling()
    settled, _ = settle(settling, voltages)
    assert settled
    assert math.isnan(settling.touched_from_s)
    assert settled.spike_counts == [0, length, length, 0]
    np.testing.assert_allclose(settled.baseline.level, 0.0, atol=5.0 * 2.0 * NOISE_V / 18.0)
    np.testing.assert_allclose(settled.baseline.noise_V, NOISE_V, rtol=0.25)


@pytest.mark.parametrize("kind", ["missing", "constant", "clipped"])
def test_a_channel_without_a_signal_does_not_settle_and_does_not_hinder(kind):
    voltages = make_noise(401)
    is_clipped = np.zeros(voltages.shape, dtype=bool)
    if kind == "missing":
        voltages[:, 2] = math.nan
    elif kind == "constant":
        voltages[:, 2] = 0.3
    else:
        voltages[:, 2] = 5.0
        is_clipped[:, 2] = True
    settled, count = settle(make_settling(), voltages, is_clipped=is_clipped)
    assert count == 401
    used = settled.sample_count
    assert settled.baseline.count.tolist() == [used, used, 0, used]


def test_readings_without_any_noise_settle():
    """All channels are constant, as in a simulated stream: their noise is the lower bound."""
    settled, count = settle(make_settling(), np.full((401, CHANNELS), 0.2))
    assert count == 401
    assert (settled.baseline.count > 0).all()
    np.testing.assert_allclose(settled.baseline.level, 0.2, rtol=1e-12)
    np.testing.assert_allclose(settled.baseline.noise_V, MIN_NOISE_V)


def test_a_touch_that_does_not_end_never_settles():
    times = 1e-3 * np.arange(3000)
    swing = 0.05 * np.sin(2.0 * np.pi * times / 0.7)
    settling = make_settling()
    settled, _ = settle(settling, make_noise(3000) + swing[:, None])
    assert settled is None
    assert settling.touched_from_s < 0.1
    assert math.isnan(settling.touched_to_s)
    # Older samples are dropped.
    assert settling.sample_count <= 402


@pytest.mark.parametrize(("max_noise_V", "settles"), [(0.05, True), (1e-3, False)])
def test_stationary_noise_that_is_not_white_settles_with_a_larger_noise(max_noise_V, settles):
    """Means of an eighth of the samples deviate as those of the stated white noise."""
    settling = make_settling(max_noise_V=max_noise_V)
    t = 1e-3 * np.arange(3000)
    white = np.random.default_rng(3).standard_normal((len(t), CHANNELS))
    smooth = np.apply_along_axis(np.convolve, 0, white, np.ones(40) / 40.0, "same")
    voltages = NOISE_V * smooth / smooth.std()
    settled = None
    for time_s, row in zip(t, voltages.tolist(), strict=True):
        settled = settling.add(FilteredSample(time_s, row, [False] * CHANNELS))
        if settled:
            break
    assert (settled is not None) == settles
    if settled:
        means = voltages[: 50 * (len(t) // 50)].reshape(-1, 50, CHANNELS).mean(axis=1)
        stated = settled.baseline.noise_V / np.sqrt(50.0)
        assert settled.baseline.is_coloured
        assert ((stated / means.std(axis=0) > 0.4) & (stated / means.std(axis=0) < 2.5)).all()


def test_a_channel_whose_unloaded_reading_is_the_end_of_the_range_is_marked():
    settling = make_settling()
    voltages = make_noise(500)
    voltages[:, 2] = np.maximum(voltages[:, 2], 0.0)
    for k, row in enumerate(voltages.tolist()):
        settled = settling.add(FilteredSample(1e-3 * k, row, [False] * CHANNELS))
        if settled:
            break
    assert settled.is_at_limit == [False, False, True, False]
