"""The command ``pvdf-fem track``: touches in a stream of readings."""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from pvdf_fem.cli import response_model
from pvdf_fem.cli.locate import sought
from pvdf_fem.cli.program import InputError, output_mistakes
from pvdf_fem.cli.response_model import ModelChoice, model_of, number_of, positive
from pvdf_fem.files import FileError, printable

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.tracking.rows import Row, TouchSummary
    from pvdf_fem.tracking.tracker import Tracker, TrackOptions

DESCRIPTION = """\
Follow touches in sampled readings of the scene's channels ([readout]): when they
begin and end, where they are (on the [stage]) and their force, with standard
deviations. What the resistances discharge is integrated and added again; offsets
and slow drifts are followed while nothing touches.

The signals are a CSV file with a column t_s and one for each electrode, or -
for standard input, which may be a live pipe: each row is answered at once by a
row of CSV, and each touch that has ended by a line on standard error. An empty
cell or nan is a missing reading."""

EPILOG = """\
status of a row:
  settling     the first readings, of which the baseline is learned: do not touch
  quiet, touch
  starting     a touch that is too faint yet to be located
  too_light, too_strong   the force is beyond the model's; the place is that of
               the samples before
  unexplained  no touch of this probe gives such charges
  lost         a touch cannot be told from the drift any longer, or the readings
               paused
  clock        the time did not grow, and all begins anew

examples:
  pvdf-fem track sensor.toml signals.csv --output touches.csv
  my-logger | pvdf-fem track sensor.toml - --json

exit codes: 0 done, 2 bad input"""

#: Longest line of signals that is read, in characters.
LONGEST_LINE = 10_000


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("signals", metavar="SIGNALS.csv", help="readings, or - for standard input")
    parser.add_argument("--output", metavar="FILE.csv", type=Path, help="write the rows there")
    parser.add_argument(
        "--unit", choices=["V", "pC"], default="V", help="of the readings (default: V)"
    )
    parser.add_argument(
        "--limit", metavar="SIZE", default="inf", help="readings of this size are clipped: missing"
    )
    parser.add_argument(
        "--unknown",
        metavar="NAMES",
        default="x,y,force",
        help="what is sought, of x, y, force, rotation (default: x,y,force)",
    )
    response_model.add_options(parser)
    parser.add_argument(
        "--json", action="store_true", help="print a JSON object for each row and each touch"
    )


def track(scene: Scene, options: argparse.Namespace) -> None:
    """Run the command for its scene."""
    from pvdf_fem.tracking.rows import Row

    mistakes: list[str] = []
    chosen, choice = _options(options, mistakes), ModelChoice.of(options, mistakes)
    files = [Path(name) for name in (options.scene, options.signals)]
    mistakes += output_mistakes(options.output, [".csv"], *files)
    if options.output and options.json:
        mistakes.append("--json: prints all; leave out --output")
    if scene.probe is None:
        mistakes.append(f"{options.scene}: has no [probe]; add one")
    if mistakes:
        raise InputError(*mistakes)
    with _opened(options.signals) as lines, _written(options.output) as out:
        samples = _samples(lines, options.signals, [e.name for e in scene.electrode_list])
        next(samples)  # a wrong header is told before a model is built
        tracker = _tracker(scene, options.scene, choice, chosen)
        writer = csv.DictWriter(out, list(Row.__dataclass_fields__), lineterminator="\n")
        if not options.json:
            writer.writeheader()
        told = 0
        for time, readings in samples:
            row = tracker.update(time, readings)
            if options.json:
                print(json.dumps(row.to_json(), allow_nan=False), file=out)
            else:
                writer.writerow(_cells(row))
            for summary in tracker.touches[told:]:
                _tell(summary, out if options.json else sys.stderr, options.json)
            told = len(tracker.touches)
            out.flush()


def _options(options: argparse.Namespace, mistakes: list[str]) -> TrackOptions:
    from pvdf_fem.tracking.tracker import TrackOptions

    limit = math.inf
    if options.limit != "inf":
        limit = positive("--limit", options.limit, mistakes)
    return TrackOptions(unknown=sought(options.unknown, mistakes), unit=options.unit, limit=limit)


def _tracker(scene: Scene, file: str, choice: ModelChoice, chosen: TrackOptions) -> Tracker:
    from pvdf_fem.tracking.tracker import Tracker

    if mistakes := choice.mistakes(scene, file):
        raise InputError(*mistakes)
    try:
        return Tracker(model_of(scene, file, choice), options=chosen)
    except ValueError as error:
        raise InputError(*str(error).splitlines()) from error


@contextmanager
def _opened(name: str) -> Iterator[TextIO]:
    """The signals; a file may be a pipe."""
    if name == "-":
        yield sys.stdin
        return
    try:
        with open(name, encoding="utf-8-sig", errors="replace") as file:
            yield file
    except OSError as error:
        raise FileError(f"{name}: cannot be read ({error.strerror}); give a CSV file") from None


@contextmanager
def _written(path: Path | None) -> Iterator[TextIO]:
    if path is None:
        yield sys.stdout
        return
    with path.open("w", encoding="utf-8") as file:
        yield file


def _samples(
    lines: TextIO, name: str, electrodes: Sequence[str]
) -> Iterator[tuple[float, list[float]]]:
    """Nothing once the header is read; then the time and the readings of each line."""
    header = [cell.strip() for cell in lines.readline(LONGEST_LINE).split(",")]
    expected = f"give the columns t_s,{','.join(electrodes)}"
    if "t_s" not in header or not set(header) <= {"t_s", *electrodes}:
        shown = printable(",".join(header))[:80]
        raise InputError(f"{name}: line 1 is {shown!r}; {expected}")
    if len(set(header)) < len(header):
        raise InputError(f"{name}: line 1 has a column twice; {expected}")
    yield math.nan, []
    number = 1
    while line := lines.readline(LONGEST_LINE):
        number += 1
        if not line.strip():
            continue
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != len(header):
            shown = f"has {len(cells)} cells, and line 1 has {len(header)}"
            raise InputError(f"{name}: line {number} {shown}; give as many")
        values = dict.fromkeys(["t_s", *electrodes], math.nan)
        for column, cell in zip(header, cells, strict=True):
            value = number_of(cell)
            if value is None and cell.lower() not in ("", "nan"):
                shown = printable(cell)[:40]
                raise InputError(
                    f"{name}: line {number}, {column} = {shown!r}: give a number, or nan"
                )
            values[column] = math.nan if value is None else value
        yield values.pop("t_s"), list(values.values())


def _cells(row: Row) -> dict[str, str | int]:
    """A row as CSV has it, without what is not known."""
    return {
        key: ("" if math.isnan(value) else f"{value:.7g}" if key != "t_s" else repr(float(value)))
        if isinstance(value, float)
        else value
        for key, value in asdict(row).items()
    }


def _tell(summary: TouchSummary, stream: TextIO, as_json: bool) -> None:
    if as_json:
        print(json.dumps({"summary": summary.to_json()}, allow_nan=False), file=stream)
        return
    print(summary, file=stream, flush=True)
