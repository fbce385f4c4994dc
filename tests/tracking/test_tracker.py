"""Touches in made-up streams of readings."""

import numpy as np
import pytest

from pvdf_fem.tracking.tracker import Tracker
from tests.helpers.streams import Tap, sensor, stream


def followed(model, taps, seconds, **circuit):
    tracker = Tracker(model)
    rows = [
        tracker.update(t, values)
        for t, values in zip(*stream(model, taps, seconds, **circuit), strict=True)
    ]
    return tracker, rows


def test_a_tap_through_a_resistance_is_found_located_and_weighed():
    model = sensor()
    tracker, rows = followed(model, [Tap(0.6004, 0.12, (3.0, -2.0), 0.8)], 1.0, noise_V=5e-4)
    (touch,) = tracker.touches
    assert touch.onset_s == pytest.approx(0.6004, abs=4e-3)
    assert touch.end_s == pytest.approx(0.7204, abs=8e-3)
    assert np.hypot(touch.x_mm - 3.0, touch.y_mm + 2.0) < 0.25
    assert touch.force_N == pytest.approx(0.8, rel=0.02)
    assert touch.impulse_N_s == pytest.approx(0.8 * 0.12 * 2.0 / np.pi, rel=0.05)
    assert [row.status for row in rows[:200]] == ["settling"] * 200
    assert {row.status for row in rows if row.t_s < 0.59} == {"settling", "quiet"}
