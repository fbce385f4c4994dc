"""Touches in made-up streams of readings."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pvdf_fem.tracking.tracker import Tracker
from tests.helpers.streams import RESISTIVE, Hold, Tap, charges_of, sensor, stream

TAP = Tap(0.6004, 0.12, (3.0, -2.0), 0.8)


def followed(model, t, readings, **options):
    tracker = Tracker(model, **options)
    return tracker, [tracker.update(*sample) for sample in zip(t, readings, strict=True)]


def assert_found(touch, tap, mm=0.3, force=0.02):
    assert touch.onset_s == pytest.approx(tap.begin_s, abs=4e-3)
    assert touch.end_s == pytest.approx(tap.begin_s + tap.duration_s, abs=0.01)
    assert np.hypot(touch.x_mm - tap.place_mm[0], touch.y_mm - tap.place_mm[1]) < mm
    assert touch.force_N == pytest.approx(tap.force_N, rel=force)


def test_a_tap_through_a_resistance_is_found_located_and_weighed():
    model = sensor()
    tracker, rows = followed(model, *stream(model, [TAP], 1.0, noise_V=5e-4, offset_V=0.1))
    (touch,) = tracker.touches
    assert_found(touch, TAP)
    assert touch.impulse_N_s == pytest.approx(0.8 * 0.12 * 2.0 / np.pi, rel=0.05)
    assert {row.status for row in rows[:200]} == {"settling"}
    assert rows[100].settling_s == pytest.approx(0.22, abs=2e-3)
    assert rows[400].settling_s == 0.0
    assert {row.status for row in rows if row.t_s < 0.59} == {"settling", "quiet"}
    pressed = [row for row in rows if row.status == "touch"]
    assert {row.touch for row in pressed} == {1}
    forces = np.array([row.force_N for row in pressed])
    truth = TAP.force(np.array([row.t_s for row in pressed]))
    assert np.abs(forces - truth).max() < 0.06


def pulls_of(touch, tap):
    """Errors of x, y and force over their stated deviations."""
    errors = touch.x_mm - tap.place_mm[0], touch.y_mm - tap.place_mm[1], touch.force_N - tap.force_N
    stated = touch.x_deviation_mm, touch.y_deviation_mm, touch.force_deviation_N
    return np.divide(errors, stated)


@dataclass(frozen=True)
class Smooth(Tap):
    """A touch with a force like the square of half a sine."""

    def force(self, t):
        return self.force_N * (super().force(t) / self.force_N) ** 2


def test_forces_are_unbiased_and_deviations_true():
    """Means of 32 pulls have a deviation of 0.14: a bias by 0.3 deviations is hardly missed."""
    model, pulls = sensor(), []
    for seed in range(32):
        draw = np.random.default_rng([5, seed])
        place = tuple(draw.uniform(-4.0, 4.0, 2).tolist())
        tap = Smooth(0.4 + 1e-3 * draw.random(), draw.uniform(0.05, 0.15), place, 0.8)
        t, readings = stream(model, [tap], 0.62, noise_V=4e-4, seed=seed)
        (touch,) = followed(model, t, readings)[0].touches
        pulls.append(pulls_of(touch, tap))
    assert np.abs(np.mean(pulls, axis=0)).max() < 0.3
    spread = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (spread > 0.5).all()
    assert (spread < 1.4).all()


def test_a_charge_that_is_left_at_the_end_was_an_error():
    """Errors of voltages during a touch sum up to 6 % of its charge, of which half by its peak."""
    model, tap, forces = sensor(), Smooth(0.4, 0.1, (3.0, -2.0), 0.8), []
    t, readings = stream(model, [tap], 0.7, noise_V=6e-4)
    (charges,) = charges_of(model, tap, np.array([tap.force_N]))
    current_A = 0.06 * 1e-12 * charges / tap.duration_s
    during = (t >= 0.4) & (t < 0.5)
    for sign in (1.0, -1.0):
        wrong = readings + 1e6 * sign * during[:, None] * current_A
        (touch,) = followed(model, t, wrong)[0].touches
        forces.append(touch.force_N)
    assert forces[0] == pytest.approx(forces[1], rel=0.04)  # 0.084 without what the end tells


def test_deviations_are_turned_to_the_stage():
    model, taps = sensor(), [Tap(0.4, 0.1, (6.0, 0.0), 0.8)]
    t, readings = stream(model, taps, 0.6, noise_V=3e-4)
    (touch,) = followed(model, t, readings)[0].touches
    scene = model.scene.with_(stage={"rotation_deg": 90.0})
    (turned,) = followed(replace(model, scene=scene), t, readings)[0].touches
    assert turned.x_deviation_mm == pytest.approx(touch.y_deviation_mm, rel=1e-6)
    assert turned.y_deviation_mm == pytest.approx(touch.x_deviation_mm, rel=1e-6)
    assert abs(touch.x_deviation_mm / touch.y_deviation_mm - 1.0) > 0.1


@pytest.mark.parametrize("wrong", [[1, 0, 2, 3], [0, 2, 1, 3]])
def test_exchanged_channels_are_unexplained(wrong):
    model, taps = sensor(), [Tap(0.4, 0.1, (4.0, -1.0), 0.8)]
    t, readings = stream(model, taps, 0.6, noise_V=1e-4)
    tracker, rows = followed(model, t, readings[:, wrong])
    (touch,) = tracker.touches
    assert touch.status == "unexplained"
    assert "unexplained" in {row.status for row in rows}


@pytest.mark.parametrize(("bound", "status"), [(1e-4, "unexplained"), (0.05, "touch")])
def test_a_fit_within_the_models_error_is_no_unexplained_touch(bound, status):
    """Charges that are off by 3 %, which is far more than the noise, in no touch's way."""
    model, taps = sensor(), [Smooth(0.4, 0.1, (2.0, -1.0), 0.8)]
    t, readings = stream(model, taps, 0.6, noise_V=1e-4)
    off = readings * (1.0 + 0.03 * np.array([1.0, -1.0, 1.0, -1.0]))
    tracker, rows = followed(replace(model, error_bound=bound), t, off)
    (touch,) = tracker.touches
    assert touch.status == status
    rising = [row for row in rows if 0.43 < row.t_s < 0.45 and row.alternatives]
    assert rising
    assert {row.status for row in rising} == {status}


def test_a_sharp_onset_is_stated_by_the_deviations():
    """What comes right after a sample leaves no trace in the next one."""
    model = sensor()
    for shift in (0.0, 0.3, 0.6):
        tap = Tap(0.6 + 1e-3 * shift, 0.1, (-2.0, 4.0), 1.5)
        tracker, _ = followed(model, *stream(model, [tap], 0.9, noise_V=3e-4))
        (touch,) = tracker.touches
        assert np.abs(pulls_of(touch, tap)).max() < 4.0
        assert touch.force_deviation_N < 0.1


def test_what_sampling_misses_is_told_by_what_is_left_at_the_end():
    """Jumps between two samples are summed up wrongly by up to a quarter of the charge, here both
    by a part with one sign."""
    model, forces = sensor(**{**RESISTIVE, "cable_capacitance_pF": 2000.0}), []
    for late in (1e-4, 9e-4):
        tap = Hold(0.4 + late, 0.101 - 2.0 * late, (3.0, -2.0), 0.8)
        (touch,) = followed(model, *stream(model, [tap], 0.65, noise_V=1e-4))[0].touches
        assert np.abs(pulls_of(touch, tap)).max() < 3.0
        forces.append(touch.force_N)
    assert np.mean(forces) == pytest.approx(0.8, rel=0.05)
    assert np.ptp(forces) < 0.25  # 0.4 without what the end tells


def test_a_charge_amplifier_whose_baseline_drifts():
    model = sensor(kind="charge", feedback_capacitance_pF=1000.0)
    taps = [TAP, Tap(1.0, 0.3, (-4.0, 1.0), 1.2)]
    circuit = {"noise_V": 2e-3, "offset_V": -0.3, "drift_V_s": 0.02}
    tracker, _ = followed(model, *stream(model, taps, 1.6, **circuit))
    assert len(tracker.touches) == 2
    for touch, tap in zip(tracker.touches, taps, strict=True):
        assert_found(touch, tap)


def test_a_charge_amplifier_that_decays_during_the_touch():
    readout = {"kind": "charge", "feedback_capacitance_pF": 1000.0}
    model = sensor(**readout, feedback_resistance_MOhm=100.0)  # 0.1 s
    tap = Tap(0.6, 0.4, (4.0, 3.0), 1.0)
    tracker, _ = followed(model, *stream(model, [tap], 1.5, noise_V=1e-3))
    (touch,) = tracker.touches
    assert_found(touch, tap, mm=0.2)


def test_a_held_touch_is_told_within_its_deviations_and_leaves_nothing_behind():
    """A jump is seen at the next sample only, and half of its charge is left after the touch."""
    readout = {"kind": "charge", "feedback_capacitance_pF": 1000.0}
    model = sensor(**readout, feedback_resistance_MOhm=1000.0)  # 1 s
    pulls = []
    for seed, shift in enumerate(np.linspace(0.0, 0.9, 8)):
        tap = Hold(2.0 + 5e-3 * shift, 0.7023, (3.0, 1.0), 0.5)
        circuit = {"noise_V": 2e-3, "seed": seed, "rate_Hz": 200.0}
        tracker, _ = followed(model, *stream(model, [tap], 5.0, **circuit))
        (touch,) = tracker.touches
        pulls.append(pulls_of(touch, tap))
        assert touch.force_deviation_N < 0.01
    assert np.abs(pulls).max() < 4.0
    assert np.sqrt(np.square(pulls).mean(axis=0)).max() < 1.8


def test_gains_offsets_the_stage_and_readings_in_pC_count():
    readout = {**RESISTIVE, "gain": {"A": 2.0, "C": -0.5}, "offset_V": {"B": 0.2}}
    model = sensor("rectangle", **readout)
    scene = model.scene.with_(stage={"x_mm": 10.0, "y_mm": -1.0, "rotation_deg": 90.0})
    object.__setattr__(model, "scene", scene)
    t, readings = stream(model, [TAP], 1.0, noise_V=2e-4)
    tracker, _ = followed(model, t, readings)
    (touch,) = tracker.touches
    assert (touch.x_mm, touch.y_mm) == pytest.approx((12.0, 2.0), abs=0.2)
    assert touch.force_N == pytest.approx(0.8, rel=0.02)
    assert touch.rotation_deg == pytest.approx(90.0)
    nominal, _ = followed(model, t, 1e12 * readings * capacitances(model), unit="pC")
    assert nominal.touches[0].x_mm == pytest.approx(touch.x_mm, abs=1e-3)


def capacitances(model):
    from pvdf_fem.readout.channel import channels

    return np.array([channel.capacitance for channel in channels(model.scene)])


def test_the_rotation_is_sought_when_asked_for():
    model = sensor("rectangle")
    tap = Tap(0.6, 0.2, (5.0, 2.0), 2.0, 30.0)
    unknown = ("x_mm", "y_mm", "force_N", "rotation_deg")
    t, readings = stream(model, [tap], 1.0, noise_V=2e-5)
    tracker, _ = followed(model, t, readings, unknown=unknown)
    (touch,) = tracker.touches
    apart = abs(touch.x_mm - 5.0), abs(touch.y_mm - 2.0), abs(touch.rotation_deg - 30.0)
    stated = touch.x_deviation_mm, touch.y_deviation_mm, touch.rotation_deviation_deg
    assert all(a < max(4.0 * s, 0.1) for a, s in zip(apart, stated, strict=True))


def test_quiet_readings_give_no_touch_and_their_noise_is_estimated():
    model = sensor()
    draw = np.random.default_rng(3)
    tracker = Tracker(model)
    for k in range(12_000):
        drift = 0.01 * np.sin(k / 2e4)
        row = tracker.update(k / 1e3, 0.1 + drift + 1e-3 * draw.standard_normal(4))
    assert tracker.touches == []
    assert row.status == "quiet"


def test_a_light_touch_says_so():
    model = sensor()
    tap = Tap(0.6, 0.1, (3.0, -2.0), 0.01)
    tracker, rows = followed(model, *stream(model, [tap], 1.0, noise_V=5e-5))
    assert "touch" not in {row.status for row in rows}
    assert {touch.status for touch in tracker.touches} == {"starting"}
    assert str(tracker.touches[0]).endswith("; not located")


@pytest.mark.parametrize("seed", range(4, 8))
def test_a_touch_that_is_faint_at_first_is_one_touch(seed):
    """Its first charges are lost in their errors, as those of another touch may be."""
    model, tap = sensor(), Tap(0.6, 0.22, (3.0, -2.0), 0.3)
    tracker, _ = followed(model, *stream(model, [tap], 1.1, noise_V=7e-4, seed=seed))
    (touch,) = tracker.touches
    assert touch.force_N == pytest.approx(0.3, abs=5.0 * touch.force_deviation_N)


def test_the_end_of_a_touch_is_light_at_the_place_of_before():
    model = sensor()
    _, rows = followed(model, *stream(model, [TAP], 1.0, noise_V=1e-4))
    light = [row for row in rows if row.status == "too_light" and row.t_s > 0.7]
    assert light
    assert all(np.hypot(row.x_mm - 3.0, row.y_mm + 2.0) < 0.5 for row in light)


def test_a_lost_channel_is_named_and_the_others_go_on():
    model = sensor()
    t, readings = stream(model, [TAP], 1.0, noise_V=2e-4)
    readings[(t > 0.64) & (t < 0.66), 1] = np.nan
    tracker, rows = followed(model, t, readings)
    (touch,) = tracker.touches
    assert {row.missing for row in rows if 0.641 < row.t_s < 0.659} == {"B"}
    assert touch.missing == "B"
    assert str(touch).endswith("; without B for a while")
    assert_found(touch, TAP, mm=0.6, force=0.06)


def test_the_clock_may_go_back():
    model = sensor()
    t, readings = stream(model, [TAP], 0.66, noise_V=2e-4)
    tracker, _ = followed(model, t, readings)
    assert tracker.update(0.0, readings[0]).status == "clock"
    assert tracker.touches[-1].status == "clock"
    rows = [tracker.update(*s) for s in zip(t[1:], readings[1:], strict=True)]
    assert rows[0].status == "settling"
    assert rows[-1].status == "touch"
    assert tracker.update(np.nan, readings[0]).status == "clock"


def test_a_pause_loses_the_touch():
    model = sensor()
    t, readings = stream(model, [TAP], 0.66, noise_V=2e-4)
    tracker, _ = followed(model, t, readings)
    assert tracker.update(5.0, readings[-1]).status == "lost"
    assert tracker.touches[-1].status == "lost"


def test_missed_samples_and_uneven_sampling():
    model = sensor()
    tap = Tap(0.6, 0.3, (3.0, -2.0), 0.8)
    t, readings = stream(model, [tap], 1.2, noise_V=2e-4)
    kept = np.random.default_rng(1).random(len(t)) > 0.1
    tracker, _ = followed(model, t[kept], readings[kept])
    (touch,) = tracker.touches
    assert_found(touch, tap, mm=0.3, force=0.03)


def test_wrong_options_and_readings_are_refused():
    model = sensor()
    with pytest.raises(ValueError, match="unit = mV"):
        Tracker(model, unit="mV")
    with pytest.raises(ValueError, match="force of a touch is always sought"):
        Tracker(model, unknown=("x_mm",))
    with pytest.raises(ValueError, match="3 given; give one for each of A, B, C, D"):
        Tracker(model).update(0.0, [1.0, 2.0, 3.0])
