"""The baseline and its error, in 400 channels at once."""

import numpy as np
import pytest

from pvdf_fem.readout.channel import Channel
from pvdf_fem.tracking.baseline import Baseline
from pvdf_fem.tracking.circuit import Circuit
from pvdf_fem.tracking.options import TrackOptions

NOISE = 2e-3


def quiet(count, *, memory=2000, time_constant_s=np.inf, seed=0):
    """A baseline after noisy samples of a drift, and a generator of further noise."""
    draw = np.random.default_rng(seed)
    channel = Channel("A", 1e-9, time_constant_s / 1e-9)
    baseline = Baseline(Circuit.of([channel] * 400), TrackOptions(memory=memory))
    for k in range(count):
        baseline.follow(1e-3 * k, 0.1 + 0.02e-3 * k + NOISE * draw.standard_normal(400))
    return baseline, draw


@pytest.mark.parametrize(("count", "memory"), [(40, 2000), (300, 2000), (600, 50)])
def test_noise_and_error_of_the_baseline_are_stated(count, memory):
    baseline, _ = quiet(count, memory=memory)
    assert np.sqrt(np.mean(baseline.square)) == pytest.approx(NOISE, rel=0.06)
    time = 1e-3 * (count - 1)
    errors = (baseline.at(time) - 0.1 - 0.02 * time) / NOISE
    assert errors.std() == pytest.approx(baseline.relative_error(time)[0], rel=0.25)


@pytest.mark.parametrize("time_constant_s", [np.inf, 0.02])
@pytest.mark.parametrize("more", [0, 30])
def test_what_a_touch_leaves_is_known_from_few_samples(time_constant_s, more):
    baseline, draw = quiet(300, time_constant_s=time_constant_s)

    def level(t):
        return 0.1 + 0.02 * t + 0.5 * np.exp(-(t - 0.4) / time_constant_s)

    t = 0.4 + 1e-3 * np.arange(1, 7 + more)
    read = level(t)[:, None] + NOISE * draw.standard_normal((len(t), 400))
    baseline.keep(0.4, t[5], read[:6] - np.array([baseline.at(time) for time in t[:6]]))
    for time, voltages in zip(t[6:], read[6:], strict=True):
        baseline.follow(time, voltages)
    errors = (baseline.at(t[-1]) - level(t[-1])) / NOISE
    assert abs(errors.mean()) < 0.1
    assert errors.std() == pytest.approx(baseline.relative_error(t[-1])[0], rel=0.3)
