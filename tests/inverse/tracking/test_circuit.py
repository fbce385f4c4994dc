"""Charges from sampled voltages, what sampling misses, and the baseline and its error."""

import numpy as np
import pytest

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.inverse.tracking.baseline import Baseline
from pvdf_fem.inverse.tracking.charge_integrator import ChargeIntegrator
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.options import TrackOptions

CIRCUIT = ReadoutCircuit.from_channels([Channel("A", 1e-10, 1e6)])
NOISE = 2e-3


def summed(t, v):
    total = ChargeIntegrator(CIRCUIT, t[0], np.array([v[0]]))
    return [
        total.add(time, np.array([voltage]), np.array([NOISE]))[0]
        for time, voltage in zip(t[1:], v[1:], strict=True)
    ]


def test_the_sum_is_of_third_order_at_its_end():
    errors = []
    for count in (50, 100):
        t = np.linspace(0.0, 0.03, count + 1)
        polynomial = np.polynomial.Polynomial([0.0, 0.0, 1.0, -20.0])
        true = 1e-10 * polynomial(t[-1]) + 1e-6 * polynomial.integ()(t[-1])
        errors.append(abs(summed(t, polynomial(t))[-1] - 1e12 * true))
    assert errors[1] < errors[0] / 6.0


@pytest.mark.parametrize("resistance", [1e6, np.inf])
def test_what_comes_at_any_time_is_missed_within_its_deviation(resistance):
    """A charge that jumps, 500 times at random in a sampling interval of ten time constants, or of
    none: what does not leak is not missed."""
    circuit = ReadoutCircuit.from_channels([Channel("A", 1e-10, resistance)])
    draw, q, t, sums, variances = np.random.default_rng(0), 100.0, np.arange(8) * 1e-3, [], []
    for late in draw.random(500):
        begun = t - 2e-3 - 1e-3 * late
        decayed = np.exp(-np.maximum(begun, 0.0) / (1e-10 * resistance))
        total = ChargeIntegrator(circuit, t[0], np.zeros(1))
        for at, v in zip(t[1:], (begun > 0.0)[1:] * decayed[1:], strict=True):
            charges = total.add(at, np.array([0.01 * q * v]), np.zeros(1))
        sums.append(charges[0])
        variances.append(total.sampling_variance)
    errors = np.array(sums) - q
    assert abs(errors.mean()) <= 3.0 * errors.std() / 500**0.5
    assert np.mean(variances) == pytest.approx(np.mean(np.square(errors)), rel=0.1, abs=1e-6)


def quiet(count, *, memory=2000, time_constant_s=np.inf, seed=0):
    """A baseline of 400 channels after noisy samples of a drift, and what draws more noise."""
    draw = np.random.default_rng(seed)
    channel = Channel("A", 1e-9, time_constant_s / 1e-9)
    baseline = Baseline(
        ReadoutCircuit.from_channels([channel] * 400), TrackOptions(memory_samples=memory)
    )
    for k in range(count):
        baseline.add(1e-3 * k, 0.1 + 0.02e-3 * k + NOISE * draw.standard_normal(400))
    return baseline, draw


@pytest.mark.parametrize(("count", "memory"), [(40, 2000), (300, 2000), (600, 50)])
def test_noise_and_error_of_the_baseline_are_stated(count, memory):
    baseline, _ = quiet(count, memory=memory)
    assert np.sqrt(np.mean(baseline.noise_variance)) == pytest.approx(NOISE, rel=0.06)
    time = 1e-3 * (count - 1)
    errors = (baseline.predict(time) - 0.1 - 0.02 * time) / NOISE
    assert errors.std() == pytest.approx(baseline.compute_relative_error(time)[0], rel=0.25)


@pytest.mark.parametrize("time_constant_s", [np.inf, 0.02])
@pytest.mark.parametrize("more", [0, 30])
def test_what_a_touch_leaves_is_known_from_few_samples(time_constant_s, more):
    baseline, draw = quiet(300, time_constant_s=time_constant_s)

    def level(t):
        return 0.1 + 0.02 * t + 0.5 * np.exp(-(t - 0.4) / time_constant_s)

    t = 0.4 + 1e-3 * np.arange(1, 7 + more)
    read = level(t)[:, None] + NOISE * draw.standard_normal((len(t), 400))
    baseline.add_residual(
        0.4, t[5], read[:6] - np.array([baseline.predict(time) for time in t[:6]])
    )
    for time, voltages in zip(t[6:], read[6:], strict=True):
        baseline.add(time, voltages)
    errors = (baseline.predict(t[-1]) - level(t[-1])) / NOISE
    assert abs(errors.mean()) < 0.1
    assert errors.std() == pytest.approx(baseline.compute_relative_error(t[-1])[0], rel=0.3)
