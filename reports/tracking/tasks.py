"""Tasks of the report on tracking: streams with faults, long streams, and the cost of a row."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem import Response, Scene, Tracker, build_response
from pvdf_fem.arrays import Array
from pvdf_fem.progress import ignore_progress
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.surrogate.touch_domain import Domain
from reports.tracking.fault import Fault, apply_faults
from reports.tracking.faults import FAULTS, draw_faulty_stream, draw_mixture
from reports.tracking.presses import Press, PressedSensor, draw_presses
from reports.tracking.stream import Interval, Stream, make_stream
from reports.tracking.verdict import Outcome, Verdict, judge, track_stream

SEED = 20261128
TRACKED = Domain(8.0, (0.2, 2.0))  #: Touches of the response that tracks.
PRESSED = Domain(7.0, (0.25, 1.6))  #: Presses: not at the limits of the response.
TRUE_FORCES_N = (0.02, 2.2)  #: Forces of the response that gives the true charges.
RATE_HZ = 1000.0  #: Sampling rate of the hour and of the hold.
NOISE_V = 1e-3
HELD = Press(3.0, 1.0, 3.0, 1.0, 1.0)  #: Press of the hold, apart from its duration.
HOLD_RAMP_S = 0.2  #: Duration of rise and fall of the hold.
BLOCK_ROWS = 500  #: Rows whose mean CPU time is measured.


class Bench(NamedTuple):
    """A response that tracks, and the sensor that it tracks."""

    response: Response
    sensor: PressedSensor

    @classmethod
    def build(cls, scene: Scene, tolerance: float) -> Bench:
        """Build the response, and one that is three times finer for the true charges."""
        response = _build(scene, TRACKED.reach_mm, TRACKED.force_N, tolerance)
        finer = _build(scene, TRACKED.reach_mm, TRUE_FORCES_N, tolerance / 3.0)
        return cls(response, PressedSensor(finer, TRUE_FORCES_N))

    def track(self, stream: Stream) -> Outcome:
        """Track a stream by a new tracker, whose scene has the stream's changes."""
        scene = self.response.scene.with_(**stream.scene_changes)
        return track_stream(Tracker(self.response.for_scene(scene, check=False)), stream)


def _build(
    scene: Scene, reach_mm: float, forces_N: tuple[float, float], tolerance: float
) -> Response:
    """Build a response in this process, without a progress display.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor.
    reach_mm : float
        Maximum distance of touches from the centre.
    forces_N : tuple of float
        Smallest and largest force.
    tolerance : float
        Tolerance of the response.
    """
    return build_response(
        scene, reach_mm, forces_N, tolerance, processes=1, progress=ignore_progress
    )


def _make_row(verdict: Verdict, stream: Stream, outcome: Outcome) -> dict[str, Any]:
    """Make the row of a stream: the counts of its verdict, its cost and its faults in words.

    Parameters
    ----------
    verdict : Verdict
        The verdict on the stream.
    stream : Stream
        The stream.
    outcome : Outcome
        All that the tracker reported, and its CPU time.
    """
    return {
        "presses": len(stream.presses),
        **vars(verdict),
        "samples": len(stream.true_s),
        "cpu_s": outcome.cpu_s,
        "slowest_s": outcome.slowest_s,
        "story": "; ".join(stream.story),
    }


@dataclass(frozen=True)
class SingleFaults(Task):
    """Streams with one fault each: a row for each stream."""

    scene: Scene
    streams: int  #: Streams of each fault.
    step: int  #: Only each fault of this step in the list is used, from the first one on.
    tolerance: float  #: Tolerance of the response.

    def run(self) -> Rows:
        """Track the streams."""
        bench = Bench.build(self.scene, self.tolerance)
        rows = Rows()
        for number in range(0, len(FAULTS), self.step):
            fault = FAULTS[number]
            for stream_number in range(self.streams):
                random = np.random.default_rng([SEED, number, stream_number])
                row = _run_stream(bench, (fault,), random)
                rows.append({"fault": fault.name, "number": stream_number, **row})
        return rows


@dataclass(frozen=True)
class MixedFaults(Task):
    """Streams with two random faults: a row for each stream."""

    scene: Scene
    streams: int
    tolerance: float  #: Tolerance of the response.

    def run(self) -> Rows:
        """Track the streams."""
        bench = Bench.build(self.scene, self.tolerance)
        rows = Rows()
        for number in range(self.streams):
            random = np.random.default_rng([SEED, number])
            faults = draw_mixture(random)
            row = _run_stream(bench, faults, random)
            rows.append({"fault": " + ".join(fault.name for fault in faults), **row})
        return rows


def _run_stream(
    bench: Bench, faults: tuple[Fault, ...], random: np.random.Generator
) -> dict[str, Any]:
    """Draw a stream with faults, track it, and return its row.

    Parameters
    ----------
    bench : Bench
        The response that tracks, and the sensor.
    faults : tuple of Fault
        Faults of the stream.
    random : numpy.random.Generator
        Source of random numbers.
    """
    stream = draw_faulty_stream(bench.sensor, PRESSED, faults, random)
    outcome = bench.track(stream)
    return _make_row(judge(stream, outcome, faults), stream, outcome)


@dataclass(frozen=True)
class LongStream(Task):
    """A long stream of touches with a fault a minute: one row."""

    scene: Scene
    minutes: int
    tolerance: float  #: Tolerance of the response.

    def run(self) -> Rows:
        """Track the stream."""
        bench = Bench.build(self.scene, self.tolerance)
        random = np.random.default_rng([SEED, self.minutes])
        seconds = 60.0 * self.minutes
        stream = make_stream(
            bench.sensor,
            draw_presses(PRESSED, random, seconds=seconds),
            random,
            seconds=seconds,
            rate_Hz=RATE_HZ,
            noise_V=NOISE_V,
        )
        stream, faults = add_fault_each_minute(stream, self.minutes, random)
        outcome = bench.track(stream)
        return [_make_row(judge(stream, outcome, tuple(faults)), stream, outcome)]


def add_fault_each_minute(
    stream: Stream, minutes: int, random: np.random.Generator
) -> tuple[Stream, list[Fault]]:
    """Apply a random fault to each minute of a stream, of those that occur at one time.

    Parameters
    ----------
    stream : Stream
        The stream.
    minutes : int
        Duration of the stream in minutes.
    random : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    stream : Stream
        The stream with faults.
    faults : list of Fault
        The fault of each minute.
    """
    events = [fault for fault in FAULTS if fault.is_event]
    faults = []
    for minute in range(minutes):
        window = Interval(60.0 * minute + 2.0, 60.0 * minute + 57.0)
        fault = events[random.integers(len(events))]
        stream = apply_faults(replace(stream, window=window), (fault,), random)
        faults.append(fault)
    return stream, faults


@dataclass(frozen=True)
class CostOfRows(Task):
    """CPU time and memory of rows during a long hold: a row for each block of samples."""

    scene: Scene
    hold_s: float
    tolerance: float  #: Tolerance of the response.

    def run(self) -> Rows:
        """Measure the CPU time of all rows, then the memory in a second run."""
        bench = Bench.build(self.scene, self.tolerance)
        press = replace(
            HELD, duration_s=self.hold_s, ramp_fraction=min(HOLD_RAMP_S / self.hold_s, 1.0)
        )
        stream = make_stream(
            bench.sensor,
            (press,),
            np.random.default_rng(SEED),
            seconds=press.end_s + 1.0,
            rate_Hz=RATE_HZ,
            noise_V=NOISE_V,
        )
        times_s = _time_rows(Tracker(bench.response), stream)
        rows = Rows()
        for block, bytes_used in enumerate(_trace_memory(Tracker(bench.response), stream)):
            block_s = times_s[block * BLOCK_ROWS : (block + 1) * BLOCK_ROWS]
            rows.append(
                {
                    "held_s": block * BLOCK_ROWS / RATE_HZ - press.begin_s,
                    "cpu_s": float(block_s.mean()),
                    "slowest_s": float(block_s.max()),
                    "memory_bytes": bytes_used,
                }
            )
        return rows


def _time_rows(tracker: Tracker, stream: Stream) -> Array:
    """Measure the CPU time of each row in s, shape (n,)."""
    times_s = []
    for row in stream.iterate_rows():
        begin_ns = time.thread_time_ns()
        tracker.update(row.stamp_s, row.readings_V)
        times_s.append(1e-9 * (time.thread_time_ns() - begin_ns))
    return np.array(times_s)


def _trace_memory(tracker: Tracker, stream: Stream) -> Iterator[int]:
    """Yield the memory in bytes that the tracker has allocated at the end of each block of rows."""
    rows = list(stream.iterate_rows())  # before the measurement, so that they do not count
    tracemalloc.start()
    try:
        for number, row in enumerate(rows, start=1):
            tracker.update(row.stamp_s, row.readings_V)
            if number % BLOCK_ROWS == 0:
                yield tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
