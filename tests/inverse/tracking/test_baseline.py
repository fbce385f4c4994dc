"""The baseline of the voltages, its noise and its error."""

import numpy as np
import pytest

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.inverse.tracking.baseline import Baseline
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.options import TrackOptions

NOISE_V = 2e-3
CHANNELS = 400  #: So many channels make statistics.


def make_baseline(count, *, memory=2000, time_constant_s=np.inf):
    """Make a baseline of noisy samples with a drift, and what draws more noise."""
    rng = np.random.default_rng(0)
    channel = Channel("A", 1e-9, time_constant_s / 1e-9)
    circuit = ReadoutCircuit.from_channels([channel] * CHANNELS)
    baseline = Baseline(circuit, TrackOptions(memory_samples=memory))
    for k in range(count):
        noise = NOISE_V * rng.standard_normal(CHANNELS)
        baseline.add(1e-3 * k, 0.1 + 0.02e-3 * k + noise)
    return baseline, rng


@pytest.mark.parametrize(("count", "memory"), [(40, 2000), (300, 2000), (600, 50)])
def test_noise_and_error_of_the_baseline_are_estimated(count, memory):
    baseline, _ = make_baseline(count, memory=memory)
    assert np.sqrt(np.mean(baseline.noise_variance)) == pytest.approx(NOISE_V, rel=0.06)
    time = 1e-3 * (count - 1)
    errors = (baseline.predict(time) - 0.1 - 0.02 * time) / NOISE_V
    assert errors.std() == pytest.approx(baseline.compute_relative_error(time)[0], rel=0.25)


@pytest.mark.parametrize("time_constant_s", [np.inf, 0.02])
@pytest.mark.parametrize("further", [0, 30])
def test_voltages_that_a_contact_leaves_are_estimated_from_few_samples(time_constant_s, further):
    baseline, rng = make_baseline(300, time_constant_s=time_constant_s)
    t = 0.4 + 1e-3 * np.arange(1, 7 + further)
    level = 0.1 + 0.02 * t + 0.5 * np.exp(-(t - 0.4) / time_constant_s)
    voltages = level[:, None] + NOISE_V * rng.standard_normal((len(t), CHANNELS))
    line = np.array([baseline.predict(time) for time in t[:6]])
    baseline.replace_residual(0.4, t[5], voltages[:6] - line)
    for time, sample in zip(t[6:], voltages[6:], strict=True):
        baseline.add(time, sample)
    errors = (baseline.predict(t[-1]) - level[-1]) / NOISE_V
    assert abs(errors.mean()) < 0.1
    assert errors.std() == pytest.approx(baseline.compute_relative_error(t[-1])[0], rel=0.3)
