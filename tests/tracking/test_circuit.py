"""Charges from sampled voltages, and what sampling misses."""

import numpy as np
import pytest

from pvdf_fem.readout.channel import Channel
from pvdf_fem.tracking.circuit import ChargeSum, Circuit

CIRCUIT = Circuit.of([Channel("A", 1e-10, 1e6, gain=2.0, offset=0.1, noise=1e-3)])
NOISE = np.array([1e-3])


def summed(t, v):
    total = ChargeSum(CIRCUIT, t[0], np.array([v[0]]))
    return [
        total.add(time, np.array([voltage]), NOISE)[0]
        for time, voltage in zip(t[1:], v[1:], strict=True)
    ]


def test_readings_become_voltages():
    assert CIRCUIT.voltages(np.array([0.5]), False) == pytest.approx([0.2])
    assert CIRCUIT.voltages(np.array([50.0]), True) == pytest.approx([0.2])  # 100 pF
    assert CIRCUIT.noise == pytest.approx([5e-4])


def test_the_sum_is_of_third_order_at_its_end():
    errors = []
    for count in (50, 100):
        t = np.linspace(0.0, 0.03, count + 1)
        polynomial = np.polynomial.Polynomial([0.0, 0.0, 1.0, -20.0])
        true = 1e-10 * polynomial(t[-1]) + 1e-6 * polynomial.integ()(t[-1])
        errors.append(abs(summed(t, polynomial(t))[-1] - 1e12 * true))
    assert errors[1] < errors[0] / 6.0


def test_what_comes_at_any_time_is_missed_within_its_deviation():
    """A charge that jumps, 500 times at random in a sampling interval of ten time constants."""
    draw, q, t = np.random.default_rng(0), 100.0, np.arange(8) * 1e-3
    sums, variances = [], []
    for late in draw.random(500):
        begun = t - 2e-3 - 1e-3 * late
        v = np.where(begun >= 0.0, 1e-12 * q / 1e-10 * np.exp(-np.maximum(begun, 0.0) / 1e-4), 0.0)
        total = ChargeSum(CIRCUIT, t[0], np.zeros(1))
        sums += [total.add(at, v[[k]], np.zeros(1))[0] for k, at in enumerate(t) if k][-1:]
        variances.append(total.missed)
    errors = np.array(sums) - q
    assert abs(errors.mean()) < 3.0 * errors.std() / 500**0.5
    assert np.mean(variances) == pytest.approx(np.mean(np.square(errors)), rel=0.5)


def test_a_gap_is_bridged_and_adds_to_the_variance():
    t = np.linspace(0.0, 0.05, 51)
    v = np.sin(np.pi * t / 0.05)
    whole = summed(t, v)[-1]
    v[20:25] = np.nan
    assert summed(t, v)[-1] == pytest.approx(whole, rel=0.01)
