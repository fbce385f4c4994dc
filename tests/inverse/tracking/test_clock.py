"""The clock of a stream: intervals, pauses, and times that go back."""

import math

import pytest

from pvdf_fem.inverse.tracking.clock import ClockEvent, SampleClock


def make_clock(times):
    """Make a clock that has ticked at some times."""
    clock = SampleClock()
    clock.restart(times[0])
    for time in times[1:]:
        clock.tick(time)
    return clock


def test_the_first_sample_needs_a_finite_time():
    clock = SampleClock()
    assert clock.classify(0.5, 50) is ClockEvent.FIRST
    assert clock.classify(math.nan, 50) is ClockEvent.BACKWARD


@pytest.mark.parametrize(
    ("time", "event"),
    [
        (0.3, ClockEvent.TICK),
        (5.2, ClockEvent.TICK),
        (5.3, ClockEvent.PAUSE),
        (0.2, ClockEvent.BACKWARD),
        (0.1, ClockEvent.BACKWARD),
        (math.inf, ClockEvent.PAUSE),
        (math.nan, ClockEvent.BACKWARD),
    ],
)
def test_times_are_compared_with_the_last_one_in_sampling_intervals(time, event):
    clock = make_clock([0.0, 0.1, 0.2])
    assert clock.interval_s == pytest.approx(0.1)
    assert clock.classify(time, 50.5) is event


def test_any_step_follows_the_first_sample():
    clock = make_clock([0.0])
    assert math.isinf(clock.interval_s)
    assert clock.classify(1e6, 50) is ClockEvent.TICK


def test_a_long_interval_counts_as_two():
    clock = make_clock([0.0, 0.1, 1.0])
    assert clock.interval_s == pytest.approx(0.1 + 0.1 / 16.0)
