"""Channels of electrodes, and the thesis's circuit."""

from __future__ import annotations

import math

import pytest

from pvdf_fem import Scene
from pvdf_fem.readout.channel import Channel, channels

TAP = Channel("A", capacitance=135e-12, resistance=1e6, gain=-2.0, offset=0.01)
#: The thesis's electrode, 11 times as permittive as the vacuum, loaded by 500 MΩ (App. 5).
THESIS = {"readout": {"kind": "voltage", "input_resistance_MOhm": 500.0}}


def test_the_thesis_circuit_is_a_voltage_readout() -> None:
    (channel, *_) = channels(Scene().with_(**THESIS))
    assert channel.capacitance == pytest.approx(35.062e-12, rel=1e-4)
    assert channel.time_constant == pytest.approx(17.531e-3, rel=1e-4)


def test_charge_amplifiers_know_neither_electrode_nor_cable() -> None:
    readout = {"feedback_capacitance_pF": 500.0, "feedback_resistance_MOhm": 1e3}
    for thickness in (9.0, 110.0):
        scene = Scene().with_(**{"readout": readout, "film.thickness_um": thickness})
        assert {(c.capacitance, c.time_constant) for c in channels(scene)} == {(5e-10, 0.5)}


def test_without_a_readout_channels_are_ideal() -> None:
    assert [c.name for c in channels(Scene())] == ["A", "B", "C", "D"]
    assert all(
        c.gain == 1.0 and not c.offset and math.isinf(c.resistance) for c in channels(Scene())
    )


def test_a_charge_is_read_through_gain_and_offset() -> None:
    assert TAP.reading(135e-12) == pytest.approx(0.01 - 2.0)


def test_values_by_channel() -> None:
    readout = {"kind": {"B": "voltage"}, "gain": {"A": 1.1, "D": -0.5}, "noise_V": 1e-3}
    a, b, c, d = channels(Scene().with_(readout=readout))
    assert [x.gain for x in (a, b, c, d)] == [1.1, 1.0, 1.0, -0.5]
    assert b.capacitance == pytest.approx(35.062e-12, rel=1e-4)
    assert a.capacitance == c.capacitance == 1e-9
    assert {x.noise for x in (a, b, c, d)} == {1e-3}
