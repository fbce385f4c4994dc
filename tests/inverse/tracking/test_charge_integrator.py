"""Charges from sampled voltages, and the charge that sampling misses."""

import numpy as np
import pytest

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.inverse.tracking.charges.charge_integrator import ChargeIntegrator
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit

NOISE_V = 2e-3
NOT_CLIPPED = np.array([False])


def integrate(circuit, t, voltages, noise_V=NOISE_V):
    """Return the last charge in pC, and the integrator, after samples of one channel."""
    integrator = ChargeIntegrator(circuit, t[0], voltages[:1])
    noise = np.array([noise_V])
    for time, voltage in zip(t[1:], voltages[1:], strict=True):
        charges_pC = integrator.add(time, np.array([voltage]), NOT_CLIPPED, noise)
    return charges_pC[0], integrator


def test_the_integral_is_of_third_order_at_its_end():
    circuit = ReadoutCircuit.from_channels([Channel("A", 1e-10, 1e6)])
    polynomial = np.polynomial.Polynomial([0.0, 0.0, 1.0, -20.0])
    integral = polynomial.integ()
    errors = []
    for count in (50, 100):
        t = np.linspace(0.0, 0.03, count + 1)
        expected = 1e-10 * polynomial(t[-1]) + 1e-6 * integral(t[-1])
        charge_pC, _ = integrate(circuit, t, polynomial(t))
        errors.append(abs(charge_pC - 1e12 * expected))
    assert errors[1] < errors[0] / 6.0


@pytest.mark.parametrize("resistance", [1e6, np.inf])
def test_the_sampling_variance_is_that_of_jumps_at_random_times(resistance):
    """A charge jumps 500 times at random times within an interval of ten time constants.

    Without leakage nothing is missed.
    """
    circuit = ReadoutCircuit.from_channels([Channel("A", 1e-10, resistance)])
    rng = np.random.default_rng(0)
    jump_pC = 100.0
    t = np.arange(8) * 1e-3
    errors = []
    variances = []
    for delay in rng.random(500):
        since_jump = t - 2e-3 - 1e-3 * delay
        decay = np.exp(-np.maximum(since_jump, 0.0) / (1e-10 * resistance))
        voltages = 0.01 * jump_pC * (since_jump > 0.0) * decay
        charge_pC, integrator = integrate(circuit, t, voltages, noise_V=0.0)
        errors.append(charge_pC - jump_pC)
        variances.append(integrator.sampling_variance)
    assert abs(np.mean(errors)) <= 3.0 * np.std(errors) / 500**0.5
    assert np.mean(variances) == pytest.approx(np.mean(np.square(errors)), rel=0.1, abs=1e-6)


def test_a_missing_sample_is_bridged_by_one_trapezium():
    circuit = ReadoutCircuit.from_channels([Channel("A", 1e-10, 1e6)])
    t = np.linspace(0.0, 0.03, 31)
    voltages = 3.0 * t
    expected, _ = integrate(circuit, t, voltages)
    voltages[10:14] = np.nan
    charge_pC, integrator = integrate(circuit, t, voltages)
    assert charge_pC == pytest.approx(expected, rel=1e-12)
    # The charge that sampling misses is unknown in an interval without a voltage.
    assert integrator.sampling_variance == 0.0


def test_a_clipped_voltage_counts_with_the_parabola_above_its_limit():
    """The excess is known to its own size, and all of it is in the stated deviation."""
    circuit = ReadoutCircuit.from_channels([Channel("A", 1e-9, 1e9)])
    t = np.linspace(0.0, 1.0, 1001)
    voltages = 4.0 * t * (1.0 - t)
    expected, _ = integrate(circuit, t, voltages)
    limit = 0.8
    integrator = ChargeIntegrator(circuit, t[0], np.zeros(1))
    for time, voltage in zip(t[1:], np.minimum(voltages, limit)[1:], strict=True):
        is_clipped = np.array([voltage >= limit])
        charges_pC = integrator.add(time, np.array([voltage]), is_clipped, np.array([1e-6]))
    deviation_pC = float(np.sqrt(integrator.walk_variance[0]))
    assert charges_pC[0] == pytest.approx(expected, rel=0.02)
    assert abs(charges_pC[0] - expected) < deviation_pC < 0.1 * expected
