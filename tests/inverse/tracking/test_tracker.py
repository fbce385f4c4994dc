"""Touches in streams of readings of made-up sensors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.inverse.tracking.tracker import Tracker
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.streams import RESISTIVE, Tap, compute_changes, make_sensor, make_stream

TAP = Tap(0.6004, 0.12, (3.0, -2.0), 0.8)
PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")
SENSOR = make_sensor()
AMPLIFIER = {"kind": "charge", "feedback_capacitance_pF": 1000.0}


def track(model, t, readings, **options):
    """Return a tracker after a stream, with its rows."""
    tracker = Tracker(model, **options)
    rows = [tracker.update(*sample) for sample in zip(t, readings, strict=True)]
    return tracker, rows


def track_one_touch(model, t, readings, **options):
    """Return the summary of the only touch in a stream."""
    tracker, _ = track(model, t, readings, **options)
    (touch,) = tracker.touches
    return touch


def track_one_tap(tap, seconds, model=SENSOR, **stream_options):
    """Return the summary of the only touch in a stream with one tap."""
    t, readings = make_stream(model, [tap], seconds, **stream_options)
    return track_one_touch(model, t, readings)


def assert_touch_is_tap(touch, tap, mm=0.3, force=0.02):
    assert touch.onset_s == pytest.approx(tap.begin_s, abs=4e-3)
    assert touch.end_s == pytest.approx(tap.begin_s + tap.duration_s, abs=0.01)
    assert np.hypot(touch.x_mm - tap.place_mm[0], touch.y_mm - tap.place_mm[1]) < mm
    assert touch.force_N == pytest.approx(tap.force_N, rel=force)


def compute_pulls(touch, tap):
    """Return the errors of x, y and force over their stated deviations."""
    x_mm, y_mm = tap.place_mm
    return np.array(
        [
            (touch.x_mm - x_mm) / touch.x_deviation_mm,
            (touch.y_mm - y_mm) / touch.y_deviation_mm,
            (touch.force_N - tap.force_N) / touch.force_deviation_N,
        ]
    )


def test_a_tap_through_a_resistance_is_located_with_its_force():
    t, readings = make_stream(SENSOR, [TAP], 1.0, noise_V=5e-4, offset_V=0.1)
    tracker, rows = track(SENSOR, t, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, TAP)
    assert touch.impulse_N_s == pytest.approx(0.8 * 0.12 * 2.0 / np.pi, rel=0.05)
    assert {row.status for row in rows[:200]} == {"settling"}
    assert rows[100].settling_s == pytest.approx(0.3, abs=2e-3)
    assert rows[400].settling_s == 0.0
    assert {row.status for row in rows if row.t_s < 0.59} == {"settling", "quiet"}
    located = [row for row in rows if row.status == "touch"]
    assert {row.touch for row in located} == {1}
    forces_N = np.array([row.force_N for row in located])
    expected_N = TAP.force(np.array([row.t_s for row in located]))
    assert np.abs(forces_N - expected_N).max() < 0.06
    # The end is light, at the place of the samples before.
    light = [row for row in rows if row.status == "too_light" and row.t_s > 0.7]
    assert light
    assert all(np.hypot(row.x_mm - 3.0, row.y_mm + 2.0) < 0.5 for row in light)


def test_taps_on_a_charge_amplifier_with_a_drift_are_located():
    model = make_sensor(**AMPLIFIER)
    taps = [TAP, Tap(1.0, 0.3, (-4.0, 1.0), 1.2)]
    t, readings = make_stream(model, taps, 1.6, noise_V=2e-3, offset_V=-0.3, drift_V_s=0.02)
    tracker, _ = track(model, t, readings)
    for touch, tap in zip(tracker.touches, taps, strict=True):
        assert_touch_is_tap(touch, tap)


def test_missed_samples_uneven_sampling_and_a_lost_channel_are_tolerated():
    tap = Tap(0.6, 0.3, (3.0, -2.0), 0.8)
    t, readings = make_stream(SENSOR, [tap], 1.2, noise_V=2e-4)
    readings[(t > 0.64) & (t < 0.66), 1] = np.nan
    is_sampled = np.random.default_rng(1).random(len(t)) > 0.1
    tracker, rows = track(SENSOR, t[is_sampled], readings[is_sampled])
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, tap, force=0.03)
    assert {row.missing for row in rows if 0.641 < row.t_s < 0.659} == {"B"}
    assert touch.missing == "B"


@pytest.mark.parametrize("unknown", [PLACE_AND_FORCE, TOUCH_QUANTITIES])
def test_gains_offsets_units_and_the_stage_count(unknown):
    """The rotation is unknown, or that of the scene, which is on the film."""
    readout = {**RESISTIVE, "gain": {"A": 2.0, "C": -0.5}, "offset_V": {"B": 0.2}}
    model = make_sensor("rectangle", **readout)
    tap = Tap(0.6, 0.2, (5.0, 2.0), 2.0, 30.0)
    t, readings = make_stream(model, [tap], 1.0, noise_V=2e-5)
    scene_rotation = 30.0 if unknown == PLACE_AND_FORCE else 0.0
    scene = model.scene.with_(**{"probe.rotation_deg": scene_rotation})
    touch = track_one_touch(replace(model, scene=scene), t, readings, unknown=unknown)
    assert_touch_is_tap(touch, tap, mm=0.1)
    assert touch.rotation_deg == pytest.approx(30.0, abs=4.0 * touch.rotation_deviation_deg)

    scene = scene.with_(stage={"x_mm": 10.0, "y_mm": -1.0, "rotation_deg": 90.0})
    readings_pC = readings * [1e12 * channel.capacitance for channel in make_channels(scene)]
    staged_model = replace(model, scene=scene)
    staged = track_one_touch(staged_model, t, readings_pC, unknown=unknown, unit="pC")
    result = (staged.x_mm, staged.y_mm, staged.rotation_deg, staged.force_N)
    expected = (10.0 - touch.y_mm, touch.x_mm - 1.0, touch.rotation_deg + 90.0, touch.force_N)
    assert result == pytest.approx(expected, abs=1e-3)
    assert staged.x_deviation_mm == pytest.approx(touch.y_deviation_mm, rel=1e-6)
    assert staged.y_deviation_mm == pytest.approx(touch.x_deviation_mm, rel=1e-6)
    ratio = touch.x_deviation_mm / touch.y_deviation_mm  # 1.4 by slopes alone
    if unknown == PLACE_AND_FORCE:
        assert ratio > 1.1
    else:
        assert abs(ratio - 1.0) > 0.1


def test_forces_are_unbiased_and_deviations_true():
    """Means of 32 pulls have a deviation of 0.14: a bias by 0.3 deviations is hardly missed."""
    pulls = []
    for seed in range(32):
        rng = np.random.default_rng([5, seed])
        place_mm = tuple(rng.uniform(-4.0, 4.0, 2).tolist())
        begin_s = 0.4 + 1e-3 * rng.random()
        tap = Tap(begin_s, rng.uniform(0.05, 0.15), place_mm, 0.8, power=2)
        touch = track_one_tap(tap, 0.62, noise_V=4e-4, seed=seed)
        pulls.append(compute_pulls(touch, tap))
    assert np.abs(np.mean(pulls, axis=0)).max() < 0.3
    spread = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (spread > 0.5).all()
    assert (spread < 1.4).all()


def test_charge_that_is_left_at_the_end_is_subtracted():
    """Errors of voltages sum up to 6 % of the charge, of which half by its peak."""
    tap = Tap(0.4, 0.1, (3.0, -2.0), 0.8, power=2)
    t, readings = make_stream(SENSOR, [tap], 0.7, noise_V=6e-4)
    (charges_pC,) = compute_changes(SENSOR, tap, np.array([tap.force_N]))
    current_A = 0.06 * 1e-12 * charges_pC / tap.duration_s
    is_pressed = (t >= 0.4) & (t < 0.5)
    error_V = 1e6 * is_pressed[:, None] * current_A
    higher = track_one_touch(SENSOR, t, readings + error_V)
    lower = track_one_touch(SENSOR, t, readings - error_V)
    # 0.084 without the correction by the end.
    assert higher.force_N == pytest.approx(lower.force_N, rel=0.04)


def test_charge_that_sampling_misses_is_corrected_by_the_end():
    """Jumps between two samples are summed wrongly by up to a quarter of the charge.

    Here both errors have the same sign.
    """
    model = make_sensor(**{**RESISTIVE, "cable_capacitance_pF": 2000.0})
    forces_N = []
    for delay_s in (1e-4, 9e-4):
        tap = Tap(0.4 + delay_s, 0.101 - 2.0 * delay_s, (3.0, -2.0), 0.8, power=0)
        touch = track_one_tap(tap, 0.65, model, noise_V=1e-4)
        assert np.abs(compute_pulls(touch, tap)).max() < 3.0
        forces_N.append(touch.force_N)
    assert np.mean(forces_N) == pytest.approx(0.8, rel=0.05)
    assert np.ptp(forces_N) < 0.25  # 0.4 without the correction by the end.


def test_a_held_touch_is_within_its_deviations_and_leaves_nothing_behind():
    """A jump is seen at the next sample only, and half of its charge is left after the touch."""
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)  # 1 s
    pulls = []
    for seed, delay in enumerate(np.linspace(0.0, 0.9, 8)):
        tap = Tap(2.0 + 5e-3 * delay, 0.7023, (3.0, 1.0), 0.5, power=0)
        touch = track_one_tap(tap, 5.0, model, noise_V=2e-3, seed=seed, rate_Hz=200.0)
        pulls.append(compute_pulls(touch, tap))
        assert touch.force_deviation_N < 0.01
    assert np.abs(pulls).max() < 4.0
    assert np.sqrt(np.square(pulls).mean(axis=0)).max() < 1.8


@pytest.mark.parametrize(("bound", "status"), [(1e-4, "unexplained"), (0.05, "touch")])
def test_a_touch_within_the_error_of_the_response_is_explained(bound, status):
    """Charges are off by 3 %, far more than the noise, as no touch's are."""
    tap = Tap(0.4, 0.1, (2.0, -1.0), 0.8, power=2)
    t, readings = make_stream(SENSOR, [tap], 0.6, noise_V=1e-4)
    changed = readings * (1.0 + 0.03 * np.array([1.0, -1.0, 1.0, -1.0]))
    tracker, rows = track(replace(SENSOR, error_bound=bound), t, changed)
    assert [touch.status for touch in tracker.touches] == [status]
    located = {row.status for row in rows if 0.43 < row.t_s < 0.45 and row.alternatives}
    assert located == {status}


@pytest.mark.parametrize("seed", range(4, 8))
def test_a_touch_that_is_faint_at_first_is_one_touch(seed):
    """Its first charges are within their errors, as after the end of another touch."""
    touch = track_one_tap(Tap(0.6, 0.22, (3.0, -2.0), 0.3), 1.1, noise_V=7e-4, seed=seed)
    assert touch.force_N == pytest.approx(0.3, abs=5.0 * touch.force_deviation_N)


def test_quiet_readings_give_no_touch():
    tracker = Tracker(SENSOR)
    rng = np.random.default_rng(3)
    for k in range(12_000):
        drift = 0.01 * np.sin(k / 2e4)
        row = tracker.update(k / 1e3, 0.1 + drift + 1e-3 * rng.standard_normal(4))
    assert tracker.touches == []
    assert row.status == "quiet"


def test_a_clock_that_goes_back_does_not_disturb_a_touch():
    t, readings = make_stream(SENSOR, [TAP], 1.0, noise_V=2e-4)
    stamps = np.where(t < 0.66, t, t - 0.6)
    tracker, rows = track(SENSOR, stamps, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, TAP)
    assert rows[-1].t_s == pytest.approx(t[-1], abs=2e-3)
    assert any("back" in note for note in tracker.notes)


def test_a_long_pause_in_a_touch_is_said_and_the_next_touch_is_located():
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)
    taps = [Tap(0.6, 0.5, (3.0, -2.0), 0.8), Tap(2.2, 0.2, (-4.0, 1.0), 1.2)]
    t, readings = make_stream(model, taps, 3.0, noise_V=5e-4)
    is_sent = (t < 0.8) | (t > 1.8)
    tracker, _ = track(model, t[is_sent], readings[is_sent])
    cut, second = tracker.touches
    assert cut.status == "lost"
    assert second.status == "touch"
    assert_touch_is_tap(second, taps[1])


def test_rows_without_readings_have_no_force_and_do_not_end_a_touch():
    model = make_sensor(**AMPLIFIER)
    tap = Tap(0.6, 0.3, (3.0, -2.0), 0.8)
    t, readings = make_stream(model, [tap], 1.2, noise_V=5e-4)
    is_empty = (t > 0.68) & (t < 0.71)
    readings[is_empty] = np.nan
    tracker, rows = track(model, t, np.ma.masked_invalid(readings))
    (touch,) = tracker.touches
    assert touch.status == "touch"
    assert_touch_is_tap(touch, tap)
    empty = [row for row, missing in zip(rows, is_empty, strict=True) if missing]
    assert {row.missing for row in empty} == {"A B C D"}
    assert all(np.isnan(row.force_N) for row in empty)


@pytest.mark.parametrize("is_marked", [True, False])
@pytest.mark.parametrize("is_known", [True, False])
def test_a_clipped_channel_is_named_and_left_out(is_known, is_marked):
    """Clipped readings are at the end of the range, or marked as beyond it."""
    limits = {"range_V": 0.3} if is_known else {}
    model = make_sensor(**AMPLIFIER, **limits)
    tap = Tap(0.6, 0.3, (3.0, -2.0), 0.8, power=2)
    t, readings = make_stream(model, [tap], 1.2, noise_V=5e-4)
    is_clipped = (readings > 0.3).any(axis=0)
    assert 0 < is_clipped.sum() < 3
    tracker, _ = track(model, t, np.where(readings > 0.3, np.inf if is_marked else 0.3, readings))
    (touch,) = tracker.touches
    assert touch.clipped == " ".join(np.array(model.names)[is_clipped])
    assert touch.status in ("touch", "clipped")
    if touch.status == "touch":
        assert np.abs(compute_pulls(touch, tap)).max() < 4.0
    assert any("clipped" in note for note in tracker.notes)


@pytest.mark.parametrize("low_V", [-0.05, -0.1])
def test_channels_that_clip_below_after_touches_are_survived(low_V):
    """After a touch, the resistance leaves a negative voltage, which a converter may not read."""
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=300.0)
    taps = [Tap(0.6, 0.5, (3.0, -2.0), 0.8), Tap(1.8, 0.3, (-4.0, 1.0), 1.2)]
    t, readings = make_stream(model, taps, 3.0, noise_V=5e-4)
    for clipped in (np.maximum(readings, low_V), np.where(readings < low_V, -np.inf, readings)):
        tracker, _ = track(model, t, clipped)
        first = tracker.touches[0]
        assert abs(first.onset_s - taps[0].begin_s) < 0.05
        assert any("clipped" in note for note in tracker.notes)


@pytest.mark.parametrize("value", [5.0, -1e300, 1e160, 1000.0, np.inf, -np.inf])
def test_spikes_change_neither_the_baseline_nor_a_touch(value):
    model = make_sensor(**AMPLIFIER)
    t, readings = make_stream(model, [TAP], 1.0, noise_V=5e-4)
    readings[[50, 300, 500, 640, 900], [0, 1, 2, 3, 0]] = value
    readings[700:703, 1] = value
    tracker, _ = track(model, t, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, TAP)


def test_a_touch_while_the_baseline_is_learned_is_said_and_the_next_is_located():
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)
    taps = [Tap(0.1, 0.2, (-4.0, 1.0), 1.2), Tap(1.4, 0.2, (3.0, -2.0), 0.8)]
    t, readings = make_stream(model, taps, 2.0, noise_V=5e-4)
    tracker, _ = track(model, t, readings)
    early, second = tracker.touches
    assert early.status == "settling"
    assert early.onset_s == pytest.approx(0.1, abs=0.02)
    assert np.isnan(early.x_mm)
    assert_touch_is_tap(second, taps[1])
    assert any("while the baseline was learned" in note for note in tracker.notes)


def test_a_stream_that_never_settles_says_so():
    tracker, rows = track(SENSOR, 1e-3 * np.arange(100), np.zeros((100, 4)))
    tracker.finish()
    assert {row.status for row in rows} == {"settling"}
    assert any("settling_s" in note for note in tracker.notes)


@pytest.mark.parametrize(
    ("factor", "words"), [(-1.0, "wrong sign"), (1e3, "mV, not in V"), (1e-3, "not in V")]
)
def test_mistakes_in_the_readings_are_named_at_the_end(factor, words):
    model = make_sensor(**AMPLIFIER)
    t, readings = make_stream(model, [TAP], 1.0, noise_V=2e-6)
    tracker, _ = track(model, t, factor * readings)
    tracker.finish()
    assert tracker.touches
    assert any(words in note for note in tracker.notes)


@pytest.mark.parametrize("corner_Hz", [20.0, 100.0])
def test_noise_that_is_not_white_does_not_keep_the_tracker_from_settling(corner_Hz):
    model = make_sensor(**AMPLIFIER)
    tap = Tap(2.0, 0.3, (3.0, -2.0), 0.8)
    t, readings = make_stream(model, [tap], 3.0)
    white = np.random.default_rng(7).standard_normal(readings.shape)
    decay = np.exp(-2.0 * np.pi * corner_Hz * 1e-3)
    noise = lfilter([1.0 - decay], [1.0, -decay], white, axis=0)
    tracker, _ = track(model, t, readings + 1e-3 * noise / noise.std())
    (touch,) = tracker.touches
    assert touch.status == "touch"
    assert np.abs(compute_pulls(touch, tap)).max() < 4.5


def test_a_touch_that_clips_all_channels_is_not_located_by_its_release():
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)
    tap = Tap(0.6, 0.5, (3.0, -2.0), 0.8, power=2)
    t, readings = make_stream(model, [tap], 1.8, noise_V=5e-4)
    tracker, _ = track(model, t, np.minimum(readings, 0.15 * readings.max()))
    touch = tracker.touches[0]
    assert touch.status == "clipped"
    assert np.isnan(touch.force_N)


def test_something_that_presses_when_a_pause_ends_is_noticed():
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)
    taps = [Tap(0.9, 1.0, (3.0, -2.0), 0.8), Tap(2.6, 0.2, (-4.0, 1.0), 1.2)]
    t, readings = make_stream(model, taps, 3.2, noise_V=5e-4)
    is_sent = (t < 0.8) | (t > 1.3)
    tracker, _ = track(model, t[is_sent], readings[is_sent])
    first, second = tracker.touches
    assert first.status == "lost"
    assert first.onset_s == pytest.approx(1.3, abs=0.01)
    assert_touch_is_tap(second, taps[1])


def test_a_step_of_one_channel_is_no_touch():
    model = make_sensor(**AMPLIFIER, feedback_resistance_MOhm=1000.0)
    tap = Tap(1.6, 0.3, (3.0, -2.0), 0.8)
    t, readings = make_stream(model, [tap], 2.6, noise_V=5e-4)
    readings[t > 0.8, 2] += 0.2
    tracker, _ = track(model, t, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, tap)
    assert any("offset of C" in note for note in tracker.notes)


def test_a_channel_that_is_dead_from_the_start_is_left_out_and_named():
    model = make_sensor(**AMPLIFIER)
    t, readings = make_stream(model, [TAP], 1.0, noise_V=5e-4)
    readings[:, 3] = 0.0
    tracker, _ = track(model, t, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, TAP)
    assert touch.missing == "D"
    assert any("of D" in note for note in tracker.notes)


def test_hum_is_subtracted():
    model = make_sensor(**AMPLIFIER)
    tap = Tap(1.0, 0.3, (3.0, -2.0), 0.8)
    t, readings = make_stream(model, [tap], 2.0, noise_V=1e-3)
    phases = np.array([0.0, 1.0, 2.0, 3.0])
    hum = 0.02 * np.sin(2.0 * np.pi * 50.03 * t[:, None] + phases)
    tracker, _ = track(model, t, readings + hum)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, tap)
    assert np.abs(compute_pulls(touch, tap)).max() < 4.5


def test_a_row_of_a_long_hold_needs_no_more_memory():
    model = make_sensor(**AMPLIFIER)
    tap = Tap(0.6, 30.0, (3.0, -2.0), 0.8, power=0)
    t, readings = make_stream(model, [tap], 20.0, noise_V=1e-3, rate_Hz=200.0)
    tracker, rows = track(model, t, readings)
    assert rows[-1].status == "touch"
    assert rows[-1].force_N == pytest.approx(0.8, rel=0.02)
    assert len(tracker._contact.record.rows.time_s) <= 512


def test_wrong_options_and_readings_are_rejected():
    with pytest.raises(ValueError, match=r"^unit = kV"):
        Tracker(SENSOR, unit="kV")
    with pytest.raises(ValueError, match=r"^unknown"):
        Tracker(SENSOR, unknown=("x_mm",))
    with pytest.raises(ValueError, match=r"^readings"):
        Tracker(SENSOR).update(0.0, [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"^readings\.E: no such channel"):
        Tracker(SENSOR).update(0.0, {"E": 1.0})


@pytest.mark.parametrize("length", [1, 3])
@pytest.mark.parametrize("before_end", [0, 1, 2, 3])
def test_a_spike_while_the_baseline_becomes_known_is_no_touch(before_end, length):
    """The baseline is known with the sample 400; the spike may go on after it."""
    t, readings = make_stream(SENSOR, [TAP], 1.0, noise_V=5e-4)
    start = 400 - before_end
    readings[start : start + length, 1:3] += [5.0, -2.0]
    tracker, _ = track(SENSOR, t, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, TAP)
    assert touch.missing == ""
    assert len(tracker.notes) == 1


def test_samples_that_wait_at_a_high_rate_are_all_processed():
    """At 20 kHz, 1000 samples are due when the baseline is learned, and more when a touch begins.

    They are spread over the next updates, whose rows have the times of their own samples.
    """
    tap = replace(TAP, begin_s=0.4404)
    t, readings = make_stream(SENSOR, [tap], 0.8, rate_Hz=20_000.0)
    tracker, rows = track(SENSOR, t, readings)
    (touch,) = tracker.touches
    assert_touch_is_tap(touch, tap)
    np.testing.assert_array_equal([row.t_s for row in rows], t)
