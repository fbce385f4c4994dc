"""Streams with the faults of real hardware: nothing is located wrong, lost or invented."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.tracker import Tracker
from pvdf_fem.surrogate.touch_domain import Domain
from reports.tracking.fault import Fault
from reports.tracking.faults import FAULTS, draw_faulty_stream, draw_mixture
from reports.tracking.presses import PressedSensor
from reports.tracking.stream import Stream
from reports.tracking.verdict import Outcome, judge, track_stream
from tests.helpers.damage import drawn
from tests.helpers.streams import make_sensor

AMPLIFIER = {
    "kind": "charge",
    "feedback_capacitance_pF": 1000.0,
    "feedback_resistance_MOhm": 1000.0,
    "reading": "change",
    "noise_V": 1e-3,
}
RESPONSE = make_sensor(**AMPLIFIER)
SENSOR = PressedSensor(RESPONSE, (0.02, 2.2))
PRESSED = Domain(6.0, (0.3, 1.6))
RATE_HZ = 250.0
SECONDS = 8.0
#: Share of the examples of a property that are mixtures: 200 of the 2,000 of `./run test --all`.
MIXTURES = 0.1
LOST_SHARE = 0.02  #: Share of the touches that mixtures of two faults may lose.


def track(faults: tuple[Fault, ...], random: np.random.Generator) -> tuple[Stream, Outcome]:
    """Track a random stream with faults."""
    stream = draw_faulty_stream(SENSOR, PRESSED, faults, random, rate_Hz=RATE_HZ, seconds=SECONDS)
    scene = RESPONSE.scene.with_(**stream.scene_changes)
    return stream, track_stream(Tracker(RESPONSE.for_scene(scene)), stream)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_survived_and_named(fault):
    random = np.random.default_rng([45, FAULTS.index(fault)])
    stream, outcome = track((fault,), random)
    verdict = judge(stream, outcome, (fault,))
    assert verdict.is_good, (stream.story, verdict, outcome.messages)


@drawn(MIXTURES)
@given(st.integers(0, 2**32 - 1))
@example(7674)
def test_mixtures_of_two_faults_are_never_wrong_and_named(seed):
    random = np.random.default_rng(seed)
    faults = draw_mixture(random)
    stream, outcome = track(faults, random)
    verdict = judge(stream, outcome, faults)
    about = ([fault.name for fault in faults], stream.story, verdict, outcome.messages)
    assert (verdict.wrong, verdict.phantom, verdict.unreported) == (0, 0, []), about


@pytest.mark.parametrize("count", [10, pytest.param(200, marks=pytest.mark.slow)])
def test_hardly_any_touch_is_lost_in_mixtures_of_two_faults(count):
    presses = 0
    losses = []
    for seed in range(count):
        random = np.random.default_rng([46, seed])
        faults = draw_mixture(random)
        stream, outcome = track(faults, random)
        verdict = judge(stream, outcome, faults)
        presses += len(stream.presses)
        losses += verdict.lost * [(seed, *(fault.name for fault in faults))]
    assert len(losses) <= LOST_SHARE * presses, losses
