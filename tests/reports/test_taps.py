"""The readings of the report of taps."""

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.readout.channel import channels
from reports.locating.streams import KINDS, Tap, random_taps, readings

READOUT = {"kind": "voltage", "input_resistance_MOhm": 1.0, "cable_capacitance_pF": 100.0}


class Squared:
    """Charges of 1000 pC times the square of the force."""

    def changes_pC(self, force_N):
        return 1e3 * np.square(force_N)[:, None] * np.ones(4)


@pytest.mark.parametrize("kind", KINDS)
def test_forces_rise_to_their_peak_and_fall_to_zero(kind):
    tap = Tap(kind, 0.1, 0.2, 0.0, 0.0, 1.5)
    assert tap.force_N(np.array([0.1, 0.1 + tap.rise_s, 0.3])) == pytest.approx([0.0, 1.5, 0.0])


def test_readings_are_those_of_the_circuit():
    scene = Scene().with_(readout=READOUT)
    tap = Tap(KINDS[1], 0.01, 0.05, 0.0, 0.0, 1.0)
    time, values = readings(scene, tap, Squared(), 0.08, 1000.0)
    channel, fine = channels(scene)[0], np.linspace(0.0, 0.08, 400_001)
    rate = np.gradient(1e-9 * np.square(tap.force_N(fine)), fine)
    for k in (20, 40):
        decay = np.exp(-np.maximum(time[k] - fine, 0.0) / channel.time_constant)
        past = fine <= time[k]
        voltage = np.trapezoid((rate * decay)[past], fine[past]) / channel.capacitance
        assert values[k, 0] == pytest.approx(voltage, rel=1e-3)


def test_taps_are_the_same_for_a_seed():
    assert random_taps(3, 1, 8.0, (0.2, 2.0)) == random_taps(3, 1, 8.0, (0.2, 2.0))
