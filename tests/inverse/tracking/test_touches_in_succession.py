"""Touches in quick succession, and forces that oscillate, at low sampling rates."""

from dataclasses import dataclass

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.tracker import Tracker
from tests.helpers.streams import Tap, make_sensor, make_stream

SENSOR = make_sensor(kind="charge", feedback_capacitance_pF=1000.0, feedback_resistance_MOhm=1000.0)
PLACES_MM = [(3.0, -2.0), (-2.5, 1.0), (0.5, 3.5), (-1.0, -3.0)]
FORCES_N = [0.8, 1.2, 0.5, 1.0]


@dataclass(frozen=True)
class TremblingPress(Tap):
    """A press whose force swings by a tenth eight times a second."""

    def force(self, t):
        return super().force(t) * (1.0 + 0.1 * np.sin(16.0 * np.pi * (t - self.begin_s)))


def track(taps, seconds, **stream_options):
    """Return the touches of a stream."""
    tracker = Tracker(SENSOR)
    t, readings = make_stream(SENSOR, taps, seconds, **stream_options)
    for time_s, reading in zip(t, readings, strict=True):
        tracker.update(time_s, reading)
    tracker.finish()
    return tracker.touches


def assert_touch_is_tap(touch, tap, interval_s):
    """The onset is where the charges exceed two percent of their peak."""
    assert touch.status == "touch"
    rise_s = 0.06 * tap.duration_s
    assert -2.0 * interval_s < touch.onset_s - tap.begin_s < 2.0 * interval_s + rise_s
    assert abs(touch.end_s - tap.begin_s - tap.duration_s) < 3.0 * interval_s
    assert touch.x_mm == pytest.approx(tap.place_mm[0], abs=4.0 * touch.x_deviation_mm)
    assert touch.y_mm == pytest.approx(tap.place_mm[1], abs=4.0 * touch.y_deviation_mm)
    assert touch.force_N == pytest.approx(tap.force_N, rel=0.02)


@pytest.mark.parametrize(("rate_Hz", "pause_samples"), [(50.0, 4), (100.0, 6), (200.0, 10)])
def test_taps_are_told_apart_by_pauses_of_a_few_samples(rate_Hz, pause_samples):
    """A contact of several taps is split when it has ended, each at its place."""
    taps = []
    begin_s = 1.01
    for place_mm, force_N in zip(PLACES_MM, FORCES_N, strict=True):
        taps.append(Tap(begin_s, 0.3, place_mm, force_N, power=2))
        begin_s += 0.3 + pause_samples / rate_Hz
    touches = track(taps, begin_s + 1.0, noise_V=2e-4, rate_Hz=rate_Hz)
    assert [touch.touch for touch in touches] == [1, 2, 3, 4]
    for touch, tap in zip(touches, taps, strict=True):
        assert_touch_is_tap(touch, tap, 1.0 / rate_Hz)
        # The mean of a squared sine is one half.
        assert touch.impulse_N_s == pytest.approx(tap.force_N * 0.15, rel=0.1)


@pytest.mark.parametrize("rate_Hz", [50.0, 100.0, 500.0])
def test_a_trembling_force_is_located_at_one_of_its_peaks(rate_Hz):
    """The charges of many peaks are not averaged with those between them."""
    press = TremblingPress(1.0, 2.0, (3.0, -2.0), 0.9)
    (touch,) = track([press], 4.0, noise_V=5e-4, rate_Hz=rate_Hz)
    forces_N = press.force(np.arange(1.0, 3.0, 1.0 / rate_Hz))
    assert touch.force_N == pytest.approx(forces_N.max(), rel=0.01)
    assert touch.force_N == pytest.approx(press.force(np.array([touch.t_s]))[0], rel=0.01)
