"""The report on tracking: its presses, its faults, its judge, and its figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.results import TouchSummary, TrackStatus
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import compute_key
from pvdf_fem.surrogate.touch_domain import Domain
from reports.__main__ import load_report
from reports.tracking import stream as streams
from reports.tracking import tasks
from reports.tracking.clock_faults import MICROSECOND_WRAP_S
from reports.tracking.fault import Fault, Stage
from reports.tracking.faults import FAULTS, NO_FAULT, draw_faulty_stream, draw_mixture
from reports.tracking.presses import Press, PressedSensor
from reports.tracking.stream import Interval, make_stream
from reports.tracking.verdict import Outcome, Report, judge
from tests.helpers.damage import drawn
from tests.helpers.streams import Tap, compute_changes, make_sensor
from tests.helpers.streams import make_stream as make_tap_stream

AMPLIFIER = {
    "kind": "charge",
    "feedback_capacitance_pF": 1000.0,
    "feedback_resistance_MOhm": 1000.0,
    "reading": "change",
}
RESPONSE = make_sensor(**AMPLIFIER)
SENSOR = PressedSensor(RESPONSE, (0.02, 2.2))
PRESSED = Domain(6.0, (0.3, 1.6))
PRESS = Press(1.5, 0.4, 3.0, -2.0, 0.8)
BY_NAME = {fault.name: fault for fault in FAULTS}


def make_clean(presses=(PRESS,), noise_V=0.0):
    random = np.random.default_rng(1)
    return make_stream(SENSOR, presses, random, seconds=4.0, rate_Hz=500.0, noise_V=noise_V)


def summarise(press, **changes):
    """Return the summary of a press that is located without an error."""
    values = {
        "x_mm": press.x_mm,
        "y_mm": press.y_mm,
        "force_N": press.force_N,
        "x_deviation_mm": 0.02,
        "y_deviation_mm": 0.02,
        "force_deviation_N": 1e-3,
        "onset_s": press.begin_s,
        "end_s": press.end_s,
    }
    return TouchSummary(press.begin_s, TrackStatus.TOUCH, 1, **values | changes)


def judge_summaries(stream, *summaries, message="", fault=NO_FAULT):
    reports = tuple(Report(summary, np.inf) for summary in summaries)
    return judge(stream, Outcome(reports, (message,), 0.0, 0.0), (fault,))


def test_readings_of_presses_are_those_of_an_exact_circuit():
    """Half of a cosine wave squared is the tap's sine squared."""
    tap = Tap(PRESS.begin_s, PRESS.duration_s, (PRESS.x_mm, PRESS.y_mm), PRESS.force_N, power=2)
    _, expected_V = make_tap_stream(RESPONSE, [tap], 4.0, rate_Hz=500.0)
    sensor = PressedSensor(RESPONSE, (1e-3, 2.2))
    readings_V = sensor.compute_readings((PRESS,), 2e-3 * np.arange(2000))
    assert np.abs(expected_V).max() > 0.3
    np.testing.assert_allclose(readings_V, expected_V, atol=2e-5)


def test_charges_between_and_below_the_forces_of_the_spline_are_right():
    forces_N = np.geomspace(1e-4, 0.8, 200)
    tap = Tap(0.0, 1.0, (PRESS.x_mm, PRESS.y_mm), 1.0)
    expected_pC = compute_changes(RESPONSE, tap, forces_N)
    changes_pC = SENSOR.compute_changes(PRESS, forces_N)
    error_pC = np.abs(changes_pC - expected_pC).max(axis=1)
    assert error_pC[forces_N >= 0.02].max() < 1e-4 * expected_pC.max()
    assert error_pC.max() < 2e-3 * expected_pC.max()


def test_a_hold_rises_stays_and_falls():
    press = replace(PRESS, duration_s=1.0, ramp_fraction=0.4)
    times_s = press.begin_s + np.array([-0.1, 0.0, 0.1, 0.2, 0.5, 0.8, 0.9, 1.0, 1.1])
    shares = [0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.5, 0.0, 0.0]
    assert press.compute_force(times_s) == pytest.approx(
        press.force_N * np.array(shares), abs=1e-12
    )


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "right"),
        ({"x_mm": 3.08}, "right"),
        ({"x_mm": 3.11}, "wrong"),
        ({"x_mm": 3.11, "x_deviation_mm": 0.03}, "right"),
        ({"force_N": 0.83}, "wrong"),
        ({"force_N": 0.77, "force_deviation_N": 0.01}, "right"),
        ({"status": TrackStatus.UNEXPLAINED}, "flagged"),
        ({"x_mm": np.nan}, "flagged"),
        ({"onset_s": 1.15}, "lost"),
        ({"onset_s": np.nan}, "lost"),
    ],
)
def test_a_touch_is_judged_by_its_onset_and_its_deviations(changes, verdict):
    counts = judge_summaries(make_clean(), replace(summarise(PRESS), **changes))
    assert getattr(counts, verdict) == 1
    assert counts.right + counts.wrong + counts.flagged + counts.lost == 1
    assert counts.phantom == (verdict == "lost")
    assert counts.is_good == (verdict in ("right", "flagged"))


def test_a_second_touch_for_a_press_is_a_phantom():
    counts = judge_summaries(make_clean(), summarise(PRESS), summarise(PRESS))
    assert (counts.right, counts.phantom, counts.is_good) == (1, 1, False)


def test_a_lost_press_is_excused_only_in_an_excused_interval():
    stream = make_clean()
    assert judge_summaries(stream).lost == 1
    assert judge_summaries(stream.excuse(1.85, 2.2)).excused == 1
    assert judge_summaries(stream.excuse(1.95, 2.2)).lost == 1


def test_a_fault_without_a_message_is_reported():
    fault = Fault("hum", NO_FAULT.apply, Stage.SIGNAL, "hum")
    summary = summarise(PRESS)
    assert judge_summaries(make_clean(), summary, fault=fault).unreported == ["hum"]
    said = judge_summaries(make_clean(), summary, message="Hum of 50 Hz", fault=fault)
    assert said.is_good


def test_a_force_below_the_peak_is_right_only_where_the_peak_is_not_seen():
    stream = make_clean()
    low = replace(summarise(PRESS), force_N=0.7)
    assert judge_summaries(stream, low).wrong == 1
    is_seen = stream.is_seen.copy()
    is_seen[(stream.true_s > 1.62) & (stream.true_s < 1.78)] = False
    assert judge_summaries(replace(stream, is_seen=is_seen), low).right == 1


@drawn(0.5)
@given(st.sampled_from(FAULTS), st.integers(0, 2**32 - 1))
def test_faults_change_only_their_stage_of_the_chain(fault, seed):
    stream = make_clean((PRESS, replace(PRESS, begin_s=2.6)), noise_V=1e-3)
    faulty = fault.apply(stream, np.random.default_rng(seed))
    rows = np.searchsorted(stream.true_s, faulty.true_s)
    np.testing.assert_array_equal(stream.true_s[rows], faulty.true_s)
    if fault.stage < Stage.ROW:
        np.testing.assert_array_equal(faulty.stamps_s, stream.stamps_s)
    else:
        np.testing.assert_array_equal(faulty.readings_V, stream.readings_V[rows])
    if fault.stage == Stage.SAMPLE:
        difference_V = (faulty.readings_V - stream.readings_V)[faulty.is_seen]
        # Only a channel that returns has another offset.
        assert len(np.unique(difference_V.round(9))) <= 2
        assert not np.array_equal(faulty.readings_V, stream.readings_V)


@pytest.mark.parametrize("name", ["32-bit µs wrap", "signed 32-bit µs wrap"])
def test_wrapped_stamps_differ_from_the_times_by_whole_wraps(name):
    stream = make_clean()
    faulty = BY_NAME[name].apply(stream, np.random.default_rng(3))
    wraps = (faulty.stamps_s - stream.stamps_s) / MICROSECOND_WRAP_S
    (first, second) = np.unique((wraps - wraps[0]).round(9))
    assert (first, second) == (-1.0, 0.0)


def test_mixtures_have_two_faults_that_agree_on_the_rate():
    random = np.random.default_rng(5)
    for _ in range(200):
        first, second = draw_mixture(random)
        assert first != second
        assert (first.mixes, second.mixes) == (True, True)
        stream = draw_faulty_stream(SENSOR, PRESSED, (first, second), random, seconds=6.0)
        for fault in (first, second):
            assert fault.rate_Hz in (None, stream.rate_Hz)
            assert stream.rate_Hz >= fault.least_rate_Hz


def test_a_long_stream_has_a_fault_in_each_minute():
    random = np.random.default_rng(6)
    stream = make_stream(SENSOR, (PRESS,), random, seconds=240.0, rate_Hz=100.0, noise_V=1e-3)
    faulty, faults = tasks.add_fault_each_minute(stream, 4, random)
    assert len(faults) == len(faulty.story) == 4
    assert all(fault.is_event for fault in faults)
    assert faulty.window == Interval(182.0, 237.0)


def test_figures_show_what_the_tasks_found(monkeypatch):
    """A preview with made-up charges in place of solves."""
    monkeypatch.setattr(tasks, "build_response", lambda scene, *_, **__: RESPONSE.for_scene(scene))
    monkeypatch.setattr(tasks, "PRESSED", PRESSED)
    monkeypatch.setattr(tasks, "RATE_HZ", 100.0)
    monkeypatch.setattr(tasks, "BLOCK_ROWS", 50)
    monkeypatch.setattr(streams, "RATES_HZ", [250.0] * len(streams.RATES_HZ))
    monkeypatch.setattr(streams, "SECONDS", (6.0, 6.0))
    plan = load_report("tracking").plan
    inputs, needed = plan.collect_requirements(quick=True)
    for need in needed:
        (task,) = need.tasks
        rows = pd.DataFrame(task.run()).to_dict("records")
        results = ReportResults({compute_key(task): rows})
        content = need.item.kind.compose(inputs, results)
        assert len(content.frame) == len(rows)
        assert content.caption
        assert content.claim
        if need.item.kind.kind == "fault-outcomes":
            assert content.table.fault.tolist() == [fault.name for fault in FAULTS[::12]]
            assert content.table.presses.astype(int).min() > 0
        if need.item.kind.kind == "cost":
            assert content.frame.cpu_s.between(1e-6, 1e-2).all()
