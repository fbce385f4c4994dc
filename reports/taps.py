"""Taps in a stream of readings through a resistance: tracked beside located from the charges.

    python -m reports.taps [--taps N] [--draws N] [--minutes N] [--model FILE] [--out DIR]

Seeded taps of 50 to 500 ms press a disc on the thesis's film. Their charges come from full solves,
and go through a resistance of 1 MOhm with 100 pF of cable to readings at 1 kHz, with an offset, a
drift, and a noise by which the charge summed up from the onset to the peak is off by 1 % of the
mean charge there. `Tracker` follows them. The same errors of the charges at the peak are given to
`locate`, which nothing hampers then. The page has both errors, the delay of the detection, false
alarms in quiet minutes, and the time a sample takes. It takes some five minutes of one core, two of
them for the model of the charges.
"""

from __future__ import annotations

import argparse
import sys
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.arrays import Array, Mask
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.files import make_directory
from pvdf_fem.readout.channel import channels
from pvdf_fem.response.model import FORCE, Model
from pvdf_fem.response.response import Response
from pvdf_fem.touch.locate import locate
from pvdf_fem.tracking.rows import Row, TouchSummary
from pvdf_fem.tracking.tracker import Tracker
from reports.common.figures import drawing
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Cell, Column, Page, Picture, Section, Table
from reports.locating.models import response_of
from reports.locating.streams import Tap, TapCharges, random_taps, readings, spread

READOUT = {"kind": "voltage", "input_resistance_MOhm": 1.0, "cable_capacitance_pF": 100.0}
SEED = 18
REACH_MM = 8.0
FORCES_N = (0.2, 2.0)
RATE_HZ = 1000.0
#: Relative error of the solved charges.
TOLERANCE = 1e-5
#: Deviation of a charge that is summed up to the peak, over the mean charge there.
NOISE = 0.01
#: Of the readings in V, and in V/s.
OFFSET = 0.02
DRIFT = 5e-4
#: Largest error of tracked taps over that of the charges.
MOST = 1.5


@dataclass(frozen=True, eq=False)
class Trial:
    """A tap, tracked with several draws of the noise."""

    tap: Tap
    #: Errors (draws, 2) of place in mm and relative force, tracked and from the charges.
    tracked: Array
    located: Array
    #: Detection after the beginning in ms, (draws,); infinite where a tap was missed.
    delay_ms: Array
    #: Whether x, y and force are within their stated deviations, (draws, 3).
    within: Mask


@dataclass(frozen=True, eq=False)
class Stream:
    """What a tracker made of readings."""

    rows: list[Row]
    touches: list[TouchSummary]
    #: Time of each update, (n,).
    seconds: Array


def main(arguments: Sequence[str] | None = None) -> int:
    """Track the taps and write the page; returns 1 if tracking is worse than it should be."""
    options = _options(arguments)
    return run_program("reports.taps", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    make_directory(options.out, "index.html")
    scene = Scene().with_(probe={"shape": "circle", "radius_mm": 4.0}, readout=READOUT)
    model = _model(scene, options)
    taps = random_taps(options.taps, SEED, REACH_MM, FORCES_N)
    charges = [TapCharges(scene, tap, TOLERANCE) for tap in taps]
    seconds: list[Array] = []
    trials = [_trial(model, *pair, options, seconds) for pair in zip(taps, charges, strict=True)]
    alarms, quiet = _quiet(model, options.minutes)
    text = [*_sentences(trials, seconds), alarms]
    _draw_tap(model, taps[0], charges[0], options.out / "tap.png")
    picture = Picture("tap.png", "A tap: readings, charges (summed up, and true), force and place.")
    section = Section("taps", "Taps", text, [_table(trials), picture])
    section.write_tables(options.out)
    print(*text, sep="\n")
    print(Page("Taps through 1 MOhm and 100 pF", [], [section]).write(options.out))
    return int(any(ratio > MOST for ratio in _ratios(trials)) or quiet > 0)


def _model(scene: Scene, options: argparse.Namespace) -> Response:
    if options.model:
        return replace(Response.load(options.model), scene=scene)
    bare = scene.with_(readout=None)
    reach, forces = REACH_MM + 4.0, (FORCES_N[0] / 4.0, 2.0 * FORCES_N[1])
    model = response_of(bare, options.out, options.processes, reach, forces)
    return replace(model, scene=scene)


def _noise_V(model: Model, tap: Tap, charges: TapCharges) -> float:
    """Deviation of readings whose sum over the rise is `NOISE` of the mean charge at the peak."""
    channel, samples = channels(model.scene)[0], tap.rise_s * RATE_HZ
    charge = NOISE * float(np.abs(charges.peak_pC).mean()) * 1e-12
    return charge * channel.resistance * RATE_HZ / float(np.sqrt(samples))


def _stream(model: Model, time: Array, values: Array) -> Stream:
    tracker, rows, seconds = Tracker(model), [], []
    for t, row in zip(time.tolist(), values, strict=True):
        begun = clock.perf_counter()
        rows.append(tracker.update(t, row))
        seconds.append(clock.perf_counter() - begun)
    return Stream(rows, tracker.touches, np.array(seconds))


def _tapped(model: Model, tap: Tap, charges: TapCharges, seed: int) -> tuple[Array, Array]:
    """Times and noisy readings of a tap."""
    time, values = readings(model.scene, tap, charges, 0.9 + tap.duration_s, RATE_HZ)
    draw = np.random.default_rng([SEED, seed]).standard_normal(values.shape)
    return time, values + OFFSET + DRIFT * time[:, None] + _noise_V(model, tap, charges) * draw


def _trial(
    model: Model, tap: Tap, charges: TapCharges, options: argparse.Namespace, seconds: list[Array]
) -> Trial:
    noise_pC = NOISE * float(np.abs(charges.peak_pC).mean())
    tracked, located, delays, within = [], [], [], []
    for seed in range(options.draws):
        stream = _stream(model, *_tapped(model, tap, charges, seed))
        placed = [touch for touch in stream.touches if touch.alternatives]
        touch = max(placed, key=lambda touch: touch.impulse_N_s, default=None)
        if touch is None:
            tracked.append((np.inf, np.inf))
            delays.append(np.inf)
        else:
            errors = (touch.x_mm - tap.x_mm, touch.y_mm - tap.y_mm, touch.force_N - tap.peak_N)
            stated = (touch.x_deviation_mm, touch.y_deviation_mm, touch.force_deviation_N)
            within.append(np.abs(errors) < stated)
            tracked.append((np.hypot(*errors[:2]), errors[2] / tap.peak_N))
            first = next(row.t_s for row in stream.rows if row.touch == touch.touch)
            delays.append(1e3 * (first - tap.begin_s))
        seconds.append(stream.seconds[[row.touch > 0 for row in stream.rows]])
        draw = np.random.default_rng([SEED, seed, 1]).standard_normal(len(model.names))
        noisy = charges.peak_pC + noise_pC * draw
        given = dict(zip(model.names, noisy.tolist(), strict=True))
        best = locate(model, given, 0.0, noise_pC=noise_pC).best.values
        place = np.hypot(best[0] - tap.x_mm, best[1] - tap.y_mm)
        located.append((place, best[FORCE] / tap.peak_N - 1.0))
    return Trial(
        tap, np.array(tracked), np.array(located), np.array(delays), np.array(within).reshape(-1, 3)
    )


def _ratios(trials: Sequence[Trial]) -> list[float]:
    """Root mean squares of tracked errors of place and force, over those from the charges.

    Each tap counts the same: its errors are over the root mean square of those from its charges.
    """
    return [
        float(np.median([spread(t.tracked[:, k]) / spread(t.located[:, k]) for t in trials]))
        for k in (0, 1)
    ] + [
        spread(np.concatenate([t.tracked[:, k] for t in trials]).tolist())
        / spread(np.concatenate([t.located[:, k] for t in trials]).tolist())
        for k in (0, 1)
    ]


def _sentences(trials: Sequence[Trial], seconds: Sequence[Array]) -> list[str]:
    place, force, place_all, force_all = _ratios(trials)
    within = 100.0 * np.concatenate([trial.within for trial in trials]).mean(axis=0)
    delays = np.concatenate([trial.delay_ms for trial in trials])
    times = 1e3 * np.concatenate(seconds)
    return [
        f"Errors of tracked taps over those of the charges at the peak: place {place:.2f} and "
        f"force {force:.2f} in the median tap; {place_all:.2f} and {force_all:.2f} of the root "
        "mean squares over all taps.",
        f"Within the stated deviation: x {within[0]:.0f}, y {within[1]:.0f}, force "
        f"{within[2]:.0f} %.",
        f"A touch is seen {np.median(delays):.1f} ms after it begins in the median, at most "
        f"{delays.max():.1f} ms.",
        f"A sample of a touch takes {np.median(times):.2f} ms in the median, at most "
        f"{times.max():.0f} ms.",
    ]


def _quiet(model: Model, minutes: int) -> tuple[str, int]:
    """What happens in quiet minutes."""
    draw = np.random.default_rng(SEED)
    tracker, alarms, times = Tracker(model), 0, []
    count = int(60 * minutes * RATE_HZ)
    noise = 5e-4 * draw.standard_normal((count, len(model.names)))
    for k in range(count):
        begun = clock.perf_counter()
        tracker.update(k / RATE_HZ, OFFSET + DRIFT * k / RATE_HZ + noise[k])
        times.append(clock.perf_counter() - begun)
    alarms = len(tracker.touches)
    median = 1e3 * float(np.median(times))
    return (
        f"In {minutes} quiet minutes ({count} samples): {alarms} false alarms; a sample takes "
        f"{median:.3f} ms in the median.",
        alarms,
    )


def _table(trials: Sequence[Trial]) -> Table:
    columns = [
        Column("kind", "force"),
        Column("duration_ms", "duration (ms)", 0),
        Column("x_mm", "x (mm)", 2),
        Column("y_mm", "y (mm)", 2),
        Column("peak_N", "peak (N)", 2),
        Column("place_mm", "place (mm)", 3, "tracked, rms"),
        Column("force_percent", "force (%)", 2, "tracked, rms"),
        Column("charges_place_mm", "place (mm)", 3, "from the charges, rms"),
        Column("charges_force_percent", "force (%)", 2, "from the charges, rms"),
        Column("delay_ms", "seen after (ms)", 1),
    ]
    rows: list[list[Cell]] = []
    for trial in trials:
        tap, errors = trial.tap, []
        for values in (trial.tracked, trial.located):
            errors += [spread(values[:, 0]), 100.0 * spread(values[:, 1])]
        place = [1e3 * tap.duration_s, tap.x_mm, tap.y_mm, tap.peak_N]
        rows.append([tap.kind, *place, *errors, float(np.median(trial.delay_ms))])
    caption = "Errors of the summary of each tap, and of `locate` from its charges at the peak."
    return Table("taps", caption, columns, rows)


def _draw_tap(model: Model, tap: Tap, charges: TapCharges, path: Path) -> None:
    time, values = _tapped(model, tap, charges, 0)
    rows = _stream(model, time, values).rows
    shown = (time > tap.begin_s - 0.03) & (time < tap.begin_s + tap.duration_s + 0.05)
    t = 1e3 * (time[shown] - tap.begin_s)
    channel = channels(model.scene)[0]
    voltage = (values - values[: int(0.5 * RATE_HZ)].mean(axis=0))[shown, 0]
    summed = 1e12 * np.cumsum(voltage) / RATE_HZ / channel.resistance
    force = tap.force_N(time[shown])
    columns = {
        name: np.array([getattr(row, name) for row in rows], dtype=float)[shown]
        for name in ("x_mm", "y_mm", "force_N", "x_deviation_mm", "y_deviation_mm")
    }
    with drawing(path, 150, 150) as figure:
        reading, charge, pressed, place = figure.subplots(4, sharex=True)
        reading.plot(t, 1e3 * values[shown])
        reading.set_ylabel("readings (mV)")
        charge.plot(t, charges.changes_pC(force)[:, 0], color="0.6", label="true")
        charge.plot(t, summed, label="plain sum")
        charge.set_ylabel(f"charge {model.names[0]} (pC)")
        pressed.plot(t, force, color="0.6", label="true")
        pressed.plot(t, columns["force_N"], label="tracked")
        pressed.set(ylabel="force (N)", ylim=(0.0, 1.3 * tap.peak_N))
        for name, true in (("x_mm", tap.x_mm), ("y_mm", tap.y_mm)):
            value, width = columns[name], columns[name.replace("_mm", "_deviation_mm")]
            (line,) = place.plot(t, value, label=name[0])
            place.fill_between(t, value - width, value + width, color=line.get_color(), alpha=0.2)
            place.axhline(true, color="0.6", linewidth=0.8)
        place.set(xlabel="time since the tap begins (ms)", ylabel="place (mm)", ylim=(-12.0, 12.0))
        for ax in (charge, pressed, place):
            ax.legend()


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.taps", description="Tracked taps beside those located from their charges."
    )
    parser.add_argument("--taps", type=number_of("taps"), default=20, metavar="N")
    parser.add_argument(
        "--draws", type=number_of("draws"), default=10, metavar="N", help="of noise for each tap"
    )
    parser.add_argument("--minutes", type=number_of("minutes"), default=10, metavar="N")
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="a response of the disc (default: built, kept)"
    )
    add_out(parser, "taps")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
