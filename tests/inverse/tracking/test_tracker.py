"""Touches in made-up streams of readings."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.inverse.tracking.tracker import Tracker
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.streams import RESISTIVE, Tap, compute_changes, make_sensor, make_stream

TAP = Tap(0.6004, 0.12, (3.0, -2.0), 0.8)
USUAL = ("x_mm", "y_mm", "force_N")
SENSOR = make_sensor()
AMPLIFIER = {"kind": "charge", "feedback_capacitance_pF": 1000.0}


def followed(model, t, readings, **options):
    tracker = Tracker(model, **options)
    return tracker, [tracker.update(*sample) for sample in zip(t, readings, strict=True)]


def only_touch(model, t, readings, **options):
    (touch,) = followed(model, t, readings, **options)[0].touches
    return touch


def only_tap(tap, seconds, model=SENSOR, **circuit):
    return only_touch(model, *make_stream(model, [tap], seconds, **circuit))


def assert_found(touch, tap, mm=0.3, force=0.02):
    assert touch.onset_s == pytest.approx(tap.begin_s, abs=4e-3)
    assert touch.end_s == pytest.approx(tap.begin_s + tap.duration_s, abs=0.01)
    assert np.hypot(touch.x_mm - tap.place_mm[0], touch.y_mm - tap.place_mm[1]) < mm
    assert touch.force_N == pytest.approx(tap.force_N, rel=force)


def pulls_of(touch, tap):
    """Errors of x, y and force over their stated deviations."""
    errors = touch.x_mm - tap.place_mm[0], touch.y_mm - tap.place_mm[1], touch.force_N - tap.force_N
    stated = touch.x_deviation_mm, touch.y_deviation_mm, touch.force_deviation_N
    return np.divide(errors, stated)


def test_a_tap_through_a_resistance_is_found_located_and_weighed():
    tracker, rows = followed(SENSOR, *make_stream(SENSOR, [TAP], 1.0, noise_V=5e-4, offset_V=0.1))
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
    # the end is light, at the place of before
    light = [row for row in rows if row.status == "too_light" and row.t_s > 0.7]
    assert light
    assert all(np.hypot(row.x_mm - 3.0, row.y_mm + 2.0) < 0.5 for row in light)


def test_touches_of_a_charge_amplifier_with_a_drift():
    model, taps = make_sensor(**AMPLIFIER), [TAP, Tap(1.0, 0.3, (-4.0, 1.0), 1.2)]
    circuit = {"noise_V": 2e-3, "offset_V": -0.3, "drift_V_s": 0.02}
    touches = followed(model, *make_stream(model, taps, 1.6, **circuit))[0].touches
    for touch, tap in zip(touches, taps, strict=True):
        assert_found(touch, tap)


def test_missed_samples_uneven_sampling_and_a_lost_channel_are_borne():
    tap = Tap(0.6, 0.3, (3.0, -2.0), 0.8)
    t, readings = make_stream(SENSOR, [tap], 1.2, noise_V=2e-4)
    readings[(t > 0.64) & (t < 0.66), 1] = np.nan
    kept = np.random.default_rng(1).random(len(t)) > 0.1
    tracker, rows = followed(SENSOR, t[kept], readings[kept])
    (touch,) = tracker.touches
    assert_found(touch, tap, force=0.03)
    assert {row.missing for row in rows if 0.641 < row.t_s < 0.659} == {"B"}
    assert touch.missing == "B"


@pytest.mark.parametrize("unknown", [USUAL, TOUCH_QUANTITIES])
def test_gains_offsets_and_readings_in_pC_count_and_touches_are_told_on_the_stage(unknown):
    """The rotation is sought, or that of the scene, which is on the film."""
    readout = {**RESISTIVE, "gain": {"A": 2.0, "C": -0.5}, "offset_V": {"B": 0.2}}
    model, tap = make_sensor("rectangle", **readout), Tap(0.6, 0.2, (5.0, 2.0), 2.0, 30.0)
    t, readings = make_stream(model, [tap], 1.0, noise_V=2e-5)
    scene = model.scene.with_(**{"probe.rotation_deg": 30.0 if unknown == USUAL else 0.0})
    touch = only_touch(replace(model, scene=scene), t, readings, unknown=unknown)
    assert_found(touch, tap, mm=0.1)
    assert touch.rotation_deg == pytest.approx(30.0, abs=4.0 * touch.rotation_deviation_deg)
    scene = scene.with_(stage={"x_mm": 10.0, "y_mm": -1.0, "rotation_deg": 90.0})
    nominal = readings * [1e12 * channel.capacitance for channel in make_channels(scene)]
    staged = only_touch(replace(model, scene=scene), t, nominal, unknown=unknown, unit="pC")
    found = (staged.x_mm, staged.y_mm, staged.rotation_deg, staged.force_N)
    expected = (10.0 - touch.y_mm, touch.x_mm - 1.0, touch.rotation_deg + 90.0, touch.force_N)
    assert found == pytest.approx(expected, abs=1e-3)
    assert staged.x_deviation_mm == pytest.approx(touch.y_deviation_mm, rel=1e-6)
    assert staged.y_deviation_mm == pytest.approx(touch.x_deviation_mm, rel=1e-6)
    ratio = touch.x_deviation_mm / touch.y_deviation_mm
    assert ratio > 1.1 if unknown == USUAL else abs(ratio - 1.0) > 0.1  # 1.4 by slopes alone


def test_forces_are_unbiased_and_deviations_true():
    """Means of 32 pulls have a deviation of 0.14: a bias by 0.3 deviations is hardly missed."""
    pulls = []
    for seed in range(32):
        draw = np.random.default_rng([5, seed])
        place = tuple(draw.uniform(-4.0, 4.0, 2).tolist())
        tap = Tap(0.4 + 1e-3 * draw.random(), draw.uniform(0.05, 0.15), place, 0.8, power=2)
        pulls.append(pulls_of(only_tap(tap, 0.62, noise_V=4e-4, seed=seed), tap))
    assert np.abs(np.mean(pulls, axis=0)).max() < 0.3
    spread = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (spread > 0.5).all()
    assert (spread < 1.4).all()


def test_a_charge_that_is_left_at_the_end_was_an_error():
    """Errors of voltages during a touch sum up to 6 % of its charge, of which half by its peak."""
    tap, forces = Tap(0.4, 0.1, (3.0, -2.0), 0.8, power=2), []
    t, readings = make_stream(SENSOR, [tap], 0.7, noise_V=6e-4)
    (charges,) = compute_changes(SENSOR, tap, np.array([tap.force_N]))
    current_A = 0.06 * 1e-12 * charges / tap.duration_s
    during = (t >= 0.4) & (t < 0.5)
    for sign in (1.0, -1.0):
        wrong = readings + 1e6 * sign * during[:, None] * current_A
        forces.append(only_touch(SENSOR, t, wrong).force_N)
    assert forces[0] == pytest.approx(forces[1], rel=0.04)  # 0.084 without what the end tells


def test_what_sampling_misses_is_told_by_what_is_left_at_the_end():
    """Jumps between two samples are summed up wrongly by up to a quarter of the charge, here both
    by a part with one sign."""
    model, forces = make_sensor(**{**RESISTIVE, "cable_capacitance_pF": 2000.0}), []
    for late in (1e-4, 9e-4):
        tap = Tap(0.4 + late, 0.101 - 2.0 * late, (3.0, -2.0), 0.8, power=0)
        touch = only_tap(tap, 0.65, model, noise_V=1e-4)
        assert np.abs(pulls_of(touch, tap)).max() < 3.0
        forces.append(touch.force_N)
    assert np.mean(forces) == pytest.approx(0.8, rel=0.05)
    assert np.ptp(forces) < 0.25  # 0.4 without what the end tells


def test_a_held_touch_is_told_within_its_deviations_and_leaves_nothing_behind():
    """A jump is seen at the next sample only, and half of its charge is left after the touch."""
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)  # 1 s
    pulls = []
    for seed, shift in enumerate(np.linspace(0.0, 0.9, 8)):
        tap = Tap(2.0 + 5e-3 * shift, 0.7023, (3.0, 1.0), 0.5, power=0)
        touch = only_tap(tap, 5.0, model, noise_V=2e-3, seed=seed, rate_Hz=200.0)
        pulls.append(pulls_of(touch, tap))
        assert touch.force_deviation_N < 0.01
    assert np.abs(pulls).max() < 4.0
    assert np.sqrt(np.square(pulls).mean(axis=0)).max() < 1.8


@pytest.mark.parametrize(("bound", "status"), [(1e-4, "unexplained"), (0.05, "touch")])
def test_a_fit_within_the_models_error_is_no_unexplained_touch(bound, status):
    """Charges that are off by 3 %, which is far more than the noise, in no touch's way."""
    t, readings = make_stream(SENSOR, [Tap(0.4, 0.1, (2.0, -1.0), 0.8, power=2)], 0.6, noise_V=1e-4)
    off = readings * (1.0 + 0.03 * np.array([1.0, -1.0, 1.0, -1.0]))
    tracker, rows = followed(replace(SENSOR, error_bound=bound), t, off)
    assert [touch.status for touch in tracker.touches] == [status]
    rising = {row.status for row in rows if 0.43 < row.t_s < 0.45 and row.alternatives}
    assert rising == {status}


@pytest.mark.parametrize("seed", range(4, 8))
def test_a_touch_that_is_faint_at_first_is_one_touch(seed):
    """Its first charges are lost in their errors, as those of another touch may be."""
    touch = only_tap(Tap(0.6, 0.22, (3.0, -2.0), 0.3), 1.1, noise_V=7e-4, seed=seed)
    assert touch.force_N == pytest.approx(0.3, abs=5.0 * touch.force_deviation_N)


def test_quiet_readings_give_no_touch():
    tracker, draw = Tracker(SENSOR), np.random.default_rng(3)
    for k in range(12_000):
        drift = 0.01 * np.sin(k / 2e4)
        row = tracker.update(k / 1e3, 0.1 + drift + 1e-3 * draw.standard_normal(4))
    assert (tracker.touches, row.status) == ([], "quiet")


def test_a_clock_that_goes_back_and_a_pause_end_the_touch():
    t, readings = make_stream(SENSOR, [TAP], 0.66, noise_V=2e-4)
    tracker, _ = followed(SENSOR, t, readings)
    assert tracker.update(0.0, readings[0]).status == tracker.touches[-1].status == "clock"
    rows = [tracker.update(*sample) for sample in zip(t[1:], readings[1:], strict=True)]
    assert (rows[0].status, rows[-1].status) == ("settling", "touch")
    assert tracker.update(5.0, readings[-1]).status == tracker.touches[-1].status == "lost"
    assert tracker.update(np.nan, readings[0]).status == "clock"


def test_wrong_options_and_readings_are_refused():
    for options, key in (({"unit": "mV"}, "unit = mV"), ({"unknown": ("x_mm",)}, "unknown")):
        with pytest.raises(ValueError, match=f"^{key}"):
            Tracker(SENSOR, **options)
    with pytest.raises(ValueError, match=r"^readings"):
        Tracker(SENSOR).update(0.0, [1.0, 2.0, 3.0])
