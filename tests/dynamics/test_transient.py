"""Transients against direct integration, the frequency response, and limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter, lsim

from pvdf_fem import Scene, SceneError, gradients, modes, respond, transient
from pvdf_fem.dynamics.force_history import half_sine, step
from pvdf_fem.dynamics.motion_equations import linearise_about
from tests.helpers.discs import TRIANGLE, on_mesh

DURATION, FORCE = 4e-3, 0.01
TAP = half_sine(FORCE, DURATION)


def test_a_tap_agrees_with_direct_integration():
    """Integrate M x'' + K x = f F(t) of the reduced equations with air, in small steps of force."""
    solution, times = on_mesh(TRIANGLE.with_(air={"baffle": False})), np.linspace(0.0, 12e-3, 4001)
    found = transient(solution, TAP, times, highest_Hz=800.0)
    system = linearise_about(solution).equations.reduce(np.linspace(0.0, 800.0, 24))
    none, one = np.zeros_like(system.stiffness), np.eye(len(system.force))
    rate = np.block([[none, one], [-system.stiffness, none]])
    force = FORCE * np.sin(np.pi * times / DURATION) * (times < DURATION)
    pushed = np.append(0.0 * system.force, system.force)[:, None]
    read = np.hstack([1e12 * system.rates.T, 0.0 * system.rates.T])
    _, expected, _ = lsim((rate, pushed, read, np.zeros((len(read), 1))), force, times)
    for values, charge in zip(expected.T, found.charges_pC.values(), strict=True):
        np.testing.assert_allclose(charge, values, atol=1e-3 * np.abs(values).max())


def test_a_steady_sine_agrees_with_the_frequency_response():
    """The transient damps modes by sound one by one, the frequency response damps them exactly.

    Modes that displace no volume would ring for ever, so the probe is at the centre.
    """
    probe = '[probe]\nshape = "circle"\nradius_mm = 4.0\n[load]\nforce_N = 0.05\n[air]\n'
    solution, times = on_mesh(Scene.parse(probe)), 60.0 + np.linspace(0.0, 0.02, 20)
    first = modes(solution.scene, 1, loaded=True).frequencies_in_air_Hz[0]
    for frequency in (20.0, first):
        sine = ((0.0, 2j * np.pi * frequency, 0.01),)
        found = transient(solution, sine, times, highest_Hz=200.0)
        for name, charge in respond(solution, [frequency, 200.0]).charges_pC_N.items():
            expected = 0.01 * charge[0] * np.exp(2j * np.pi * frequency * times)
            difference = np.abs(found.charges_pC[name] - expected.real).max()
            assert difference < 0.02 * np.abs(expected).max()


def test_a_step_ends_at_the_static_charges():
    scene = TRIANGLE.with_(air={"baffle": True}, **{"film.loss_tangent": 0.05})
    solution = on_mesh(scene)
    rates = gradients(solution)["load.force_N"]
    found = transient(solution, step(0.02, duration_s=40.0), [-1.0, 20.0, 60.0])
    for name, charge in found.charges_pC.items():
        static = 0.02 * rates[name]
        np.testing.assert_allclose(charge, [0.0, static, 0.0], atol=1e-6 * abs(static))
        assert np.all(found.charge_errors_pC[name] < 0.05 * abs(static))


def test_readings_discharge_through_the_feedback_resistance():
    """Integrate C dV/dt + V/R = dQ/dt by the trapezium rule on fine times."""
    readout = {"feedback_resistance_MOhm": 5.0, "gain": 3.0}
    times, tap = np.linspace(0.0, 0.02, 2001), half_sine(0.01, 8e-3)
    found = transient(on_mesh(TRIANGLE.with_(readout=readout)), tap, times, highest_Hz=200.0)
    half = 0.5 * times[1] / 5e-3
    for name, charge in found.charges_pC.items():
        steps = np.append(0.0, np.diff(charge)) / 1000.0
        voltage = lfilter([1.0 / (1.0 + half)], [1.0, -(1.0 - half) / (1.0 + half)], steps)
        limit = 3e-4 * np.abs(voltage).max()
        np.testing.assert_allclose(found.readings_V[name], 3.0 * voltage, atol=limit)


def test_a_follower_pressure_is_rejected():
    with pytest.raises(SceneError, match=r"load\.kind"):
        transient(on_mesh(TRIANGLE.with_(**{"load.kind": "follower"})), TAP, [0.0])
