"""Charges from sampled voltages, and what sampling misses."""

import numpy as np
import pytest

from pvdf_fem.readout.channel import Channel
from pvdf_fem.tracking.circuit import ChargeSum, Circuit

CIRCUIT = Circuit.of([Channel("A", 1e-10, 1e6)])
NOISE = np.array([1e-3])


def summed(t, v):
    total = ChargeSum(CIRCUIT, t[0], np.array([v[0]]))
    return [
        total.add(time, np.array([voltage]), NOISE)[0]
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
    circuit = Circuit.of([Channel("A", 1e-10, resistance)])
    draw, q, t, sums, variances = np.random.default_rng(0), 100.0, np.arange(8) * 1e-3, [], []
    for late in draw.random(500):
        begun = t - 2e-3 - 1e-3 * late
        decayed = np.exp(-np.maximum(begun, 0.0) / (1e-10 * resistance))
        total = ChargeSum(circuit, t[0], np.zeros(1))
        for at, v in zip(t[1:], (begun > 0.0)[1:] * decayed[1:], strict=True):
            charges = total.add(at, np.array([0.01 * q * v]), np.zeros(1))
        sums.append(charges[0])
        variances.append(total.missed)
    errors = np.array(sums) - q
    assert abs(errors.mean()) <= 3.0 * errors.std() / 500**0.5
    assert np.mean(variances) == pytest.approx(np.mean(np.square(errors)), rel=0.1, abs=1e-6)
