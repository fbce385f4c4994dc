"""The baseline of the voltages, its noise and its error."""

import numpy as np
import pytest

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit

NOISE_V = 2e-3
INTERVAL_S = 1e-3
CHANNELS = 400  #: So many channels make statistics.


def make_baseline(count, *, memory=2000.0, time_constant_s=np.inf):
    """Make a baseline of noisy samples with a drift, and the generator of more noise."""
    rng = np.random.default_rng(0)
    channel = Channel("A", 1e-9, time_constant_s / 1e-9)
    circuit = ReadoutCircuit.from_channels([channel] * CHANNELS)
    baseline = Baseline(circuit, DEFAULTS)
    for channel in baseline.channels:
        channel.set_memory(memory)
    for k in range(count):
        noise = NOISE_V * rng.standard_normal(CHANNELS)
        baseline.add(1e-3 * k, (0.1 + 0.02e-3 * k + noise).tolist(), INTERVAL_S)
    return baseline, rng


def predict(baseline, time):
    """Predict the voltages of all channels."""
    return np.array([channel.predict(time) for channel in baseline.channels])


@pytest.mark.parametrize(("count", "memory"), [(40, 2000.0), (300, 2000.0), (600, 50.0)])
def test_noise_and_error_of_the_baseline_are_estimated(count, memory):
    baseline, _ = make_baseline(count, memory=memory)
    variances = [channel.noise_variance for channel in baseline.channels]
    assert np.sqrt(np.mean(variances)) == pytest.approx(NOISE_V, rel=0.06)
    time = 1e-3 * (count - 1)
    errors = (predict(baseline, time) - 0.1 - 0.02 * time) / NOISE_V
    stated = baseline.channels[0].compute_relative_error(time, INTERVAL_S)
    assert errors.std() == pytest.approx(stated, rel=0.25)


@pytest.mark.parametrize("time_constant_s", [np.inf, 0.02])
@pytest.mark.parametrize("further", [0, 30])
def test_voltages_that_a_contact_leaves_are_estimated_from_few_samples(time_constant_s, further):
    baseline, rng = make_baseline(300, time_constant_s=time_constant_s)
    t = 0.4 + 1e-3 * np.arange(1, 7 + further)
    level = 0.1 + 0.02 * t + 0.5 * np.exp(-(t - 0.4) / time_constant_s)
    voltages = level[:, None] + NOISE_V * rng.standard_normal((len(t), CHANNELS))
    line = np.array([predict(baseline, time) for time in t[:6]])
    baseline.replace_residuals(t[:6], voltages[:6] - line)
    for time, sample in zip(t[6:], voltages[6:], strict=True):
        baseline.add(time, sample.tolist(), INTERVAL_S)
    errors = (predict(baseline, t[-1]) - level[-1]) / NOISE_V
    assert abs(errors.mean()) < 0.1
    stated = baseline.channels[0].compute_relative_error(t[5 + further], INTERVAL_S)
    assert errors.std() == pytest.approx(stated, rel=0.35)


def test_a_missing_channel_keeps_its_noise_and_its_line():
    baseline, rng = make_baseline(300)
    noise_V = baseline.channels[0].noise_V
    for k in range(300, 900):
        noise = NOISE_V * rng.standard_normal(CHANNELS)
        voltages = 0.1 + 0.02e-3 * k + noise
        voltages[0] = np.nan
        baseline.add(1e-3 * k, voltages.tolist(), INTERVAL_S)
    first = baseline.channels[0]
    assert first.noise_V == noise_V
    assert first.predict(0.9) == pytest.approx(0.118, abs=5.0 * NOISE_V)
    assert baseline.channels[1].line_count == 900


@pytest.mark.parametrize("time_constant_s", [1.0, np.inf])
def test_a_channel_that_returns_in_the_decay_of_a_touch_finds_its_level(time_constant_s):
    """A line through the decay would be off by many deviations half a second later."""
    baseline, rng = make_baseline(300, time_constant_s=time_constant_s)
    for channel in baseline.channels:
        channel.forget_line()
    t = 0.4 + 1e-3 * np.arange(1200)
    level = -0.3 - 0.4 * np.exp(-(t - 0.4) / time_constant_s)
    for time, value in zip(t, level, strict=True):
        noise = NOISE_V * rng.standard_normal(CHANNELS)
        baseline.add(time, (value + noise).tolist(), INTERVAL_S)
    assert baseline.is_settled.all()
    errors = (predict(baseline, t[-1]) - level[-1]) / NOISE_V
    stated = baseline.channels[0].compute_relative_error(t[-1], INTERVAL_S)
    assert errors.std() < 2.0 * stated
    assert abs(errors.mean()) < stated


def test_a_pause_makes_the_line_uncertain():
    baseline, _ = make_baseline(600)
    channel = baseline.channels[0]
    before = channel.compute_relative_error(0.599, INTERVAL_S)
    error = channel.compute_relative_error(10.0, INTERVAL_S)
    assert error > 5.0 * before
    channel.age(10.0, INTERVAL_S)
    assert 2.0 / np.sqrt(channel.line_count) == pytest.approx(error, rel=0.5)
