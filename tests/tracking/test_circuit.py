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


def test_the_sum_is_exact_for_parabolas_on_uneven_samples():
    t = np.cumsum(np.random.default_rng(0).uniform(0.5e-3, 2e-3, 40))
    polynomial = np.polynomial.Polynomial([0.0, 1.0, -30.0])
    v = polynomial(t) - polynomial(t[0])
    integral = (polynomial - polynomial(t[0])).integ()
    charge = 1e-10 * (v - v[0]) + 1e-6 * (integral(t) - integral(t[0]))
    np.testing.assert_allclose(summed(t, v)[1:], 1e12 * charge[2:], rtol=1e-9)


def test_the_sum_is_of_fourth_order_inside():
    errors = []
    for count in (50, 100):
        t = np.linspace(0.0, 0.05, count + 1)
        v = np.sin(2.0 * np.pi * t / 0.05) ** 2 * np.exp(20.0 * t)
        fine = np.linspace(0.0, 0.05, 200 * count + 1)
        true = np.trapezoid(np.sin(2.0 * np.pi * fine / 0.05) ** 2 * np.exp(20.0 * fine), fine)
        errors.append(abs(summed(t, v)[-1] - 1e12 * (1e-10 * v[-1] + 1e-6 * true)))
    assert errors[1] < errors[0] / 8.0


def test_a_gap_is_bridged_and_adds_to_the_variance():
    t = np.linspace(0.0, 0.05, 51)
    v = np.sin(np.pi * t / 0.05)
    whole = summed(t, v)[-1]
    v[20:25] = np.nan
    assert summed(t, v)[-1] == pytest.approx(whole, rel=0.01)


def test_the_response_of_the_circuit_is_exact():
    t = np.linspace(0.0, 1e-3, 2001)
    tau = 1e-4
    charges = np.where(t > 0.0, 100.0 * t / t[-1], 0.0)[:, None]
    exact = 100.0 / 1e-3 * tau * (1.0 - np.exp(-t / tau)) / 100.0  # V = R dQ/dt (1 - e^(-t/RC))
    rows = np.array([100, 1000, 2000])
    np.testing.assert_allclose(CIRCUIT.response(t, charges, rows)[:, 0], exact[rows], rtol=1e-9)
