"""Channels: the circuit's equation in time and by frequency, and the thesis's circuit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pvdf_fem import Scene
from pvdf_fem.electrodes.channel import Channel, make_channels

TAP = Channel("A", capacitance=135e-12, resistance=1e6, gain=-2.0, offset=0.01)


def test_the_thesis_circuit_is_a_voltage_readout():
    """Its electrode, 11 times as permittive as the vacuum, loaded by 500 MΩ (App. 5)."""
    readout = {"kind": "voltage", "input_resistance_MOhm": 500.0}
    (channel, *_) = make_channels(Scene().with_(readout=readout))
    assert channel.capacitance == pytest.approx(35.062e-12, rel=1e-4)
    assert channel.time_constant == pytest.approx(17.531e-3, rel=1e-4)
    # App. 5 with the load in parallel at 15 and 20 Hz
    shares = abs(channel.harmonic([15.0, 20.0])) * channel.capacitance
    assert shares == pytest.approx([0.856, 0.911], abs=5e-4)


def test_charge_amplifiers_know_neither_electrode_nor_cable_and_without_a_readout_are_ideal():
    readout = {"feedback_capacitance_pF": 500.0, "feedback_resistance_MOhm": 1e3}
    for thickness in (9.0, 110.0):
        scene = Scene().with_(**{"readout": readout, "film.thickness_um": thickness})
        assert {(c.capacitance, c.time_constant) for c in make_channels(scene)} == {(5e-10, 0.5)}
    ideal = make_channels(Scene())
    assert [c.name for c in ideal] == ["A", "B", "C", "D"]
    assert {(c.gain, c.offset, c.resistance) for c in ideal} == {(1.0, 0.0, math.inf)}
    assert list(ideal[0].harmonic([0.0, 20.0])) == [0.0, 1.0 / ideal[0].capacitance]


def test_channels_have_the_range_of_their_readings():
    """A number stands for both signs, and electrodes without an entry have no limit."""
    for value in (2.5, [-2.5, 2.5]):
        channels = make_channels(Scene(readout={"range_V": value, "gain": 10.0, "offset_V": 1.0}))
        assert {(channel.low_V, channel.high_V) for channel in channels} == {(-2.5, 2.5)}
    by_electrode = make_channels(Scene(readout={"range_V": {"B": 5.0, "D": [-0.1, 3.3]}}))
    limits = [(channel.low_V, channel.high_V) for channel in by_electrode]
    assert limits == [(-math.inf, math.inf), (-5.0, 5.0), (-math.inf, math.inf), (-0.1, 3.3)]


def test_the_step_solves_the_circuits_equation():
    """A charge that comes within 1 µs, against C dV/dt = dQ/dt - V/R; after it V decays."""
    ramp, charge = 1e-6, 1e-9
    times = ramp + np.linspace(0.0, 3.0, 7) * TAP.time_constant

    def rate(t, V):
        return (charge / ramp * (t < ramp) - V / TAP.resistance) / TAP.capacitance

    V = solve_ivp(rate, (0.0, times[-1]), [0.0], t_eval=times, rtol=1e-9, atol=1e-9, max_step=1e-7)
    assert TAP.step(charge, times - ramp / 2) == pytest.approx(0.01 - 2.0 * V.y[0], rel=1e-4)
    assert TAP.step(charge, -1.0) == 0.01
    assert TAP.step(charge, 0.0) == TAP.reading(charge) == pytest.approx(0.01 - 2e-9 / 135e-12)


def test_the_harmonic_response_is_the_transform_of_the_step():
    """The Fourier integral of the impulse response, which is the step's derivative."""
    frequency = 0.7 / TAP.time_constant
    t = np.linspace(0.0, 40.0 * TAP.time_constant, 400_001)
    step = (TAP.step(1.0, t) - TAP.offset) * np.exp(-2j * np.pi * frequency * t)
    transform = 2j * np.pi * frequency * np.trapezoid(step, t)
    assert complex(TAP.harmonic(frequency)) == pytest.approx(transform, rel=1e-6)
