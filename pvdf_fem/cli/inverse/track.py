"""The command ``pvdf-fem track``: touches in a stream of readings."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli import program, response_choice
from pvdf_fem.cli.inverse.locate_request import SOUGHT, parse_unknowns
from pvdf_fem.cli.inverse.reading_table import open_writer, parse_cell, read_rows, to_plain
from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_scene_command,
    add_text_options,
    read_scene,
)
from pvdf_fem.cli.response_choice import ResponseChoice, load_or_build_response
from pvdf_fem.files import escape_unprintable

if TYPE_CHECKING:
    from pvdf_fem.inverse.tracking.results import TrackRow

TIMES = {"t_s": 1.0, "t_ms": 1e-3}  #: Columns of times, and their units in s.
CALM = ("", "quiet", "settling")  #: Statuses of rows without a touch.
#: Of touches with these the unit is in doubt.
DOUBTED = ("too_strong", "unexplained")
DESCRIPTION = """\
Follow touches in sampled readings of the scene's channels ([readout]): when they
begin and end, where they are (on the [stage]) and their force, with standard
deviations. The charge lost through resistances is integrated and added again; offsets
and slow drifts are followed while nothing touches.

The signals are a CSV file with a column t_s, or t_ms, and one for each electrode, or -
for standard input, which may be a live pipe: each row is answered at once by a
row of CSV, and each touch that has ended by a line on standard error. An empty
cell or nan is a missing reading; other columns are left out.

A model of the charges is needed, as for locate: the first call builds the model, says
how long the build takes, and keeps the model beside the scene file."""

EPILOG = """\
status of a row, and of a touch that has ended:
  settling     the first readings, of which the baseline is learned: do not touch
  quiet, touch
  starting     a touch that is too faint yet to be located; if it has ended, no
               place was found
  too_light, too_strong   the force is beyond the model's (--force-range); the
               place comes from the samples before
  unexplained  no touch of this probe gives such charges
  lost         a touch cannot be told from the drift any longer, or the readings
               paused
  clock        the time did not grow, and all begins anew
  malformed    not a number in each cell, or no time; the row is left out

examples:
  pvdf-fem track sensor.toml signals.csv > rows.csv
  my-logger | pvdf-fem track sensor.toml - --json

exit codes: 0 done, 2 bad input, or no row that can be used"""


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    as_json = "print a JSON object for each row and touch"
    about = "track", run, "touches in a stream of readings", DESCRIPTION, EPILOG
    parser = add_scene_command(commands, *about, as_json=as_json)
    parser.add_argument("signals", metavar="SIGNALS.csv", help="readings, or - for standard input")
    parser.add_argument(
        "--unit", choices=["V", "pC"], default="V", help="of the readings (default: V)"
    )
    add_text_options(parser, ("--unknown", "NAMES", "x,y,force", SOUGHT))
    response_choice.add_options(parser)


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    scene = read_scene(options)
    from pvdf_fem.inverse.touch.touch import TouchStatus
    from pvdf_fem.inverse.tracking.results import TrackRow
    from pvdf_fem.inverse.tracking.tracker import Tracker
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.solver.adaptive import compute_unloaded_integrals

    mistakes: list[str] = []
    unknown, choice = (
        parse_unknowns(options.unknown, mistakes),
        ResponseChoice.of(options, mistakes),
    )
    if "force_N" not in unknown:
        mistakes.append("--unknown: the force of a touch is always sought; name it")
    if scene.single_probe is None:
        mistakes.append(f"{options.scene}: has no [probe]; add one")
    if options.unit == "V" and scene.readout is None:
        mistakes.append(f"--unit V: {options.scene} has no [readout]; add one, or give pC")
    if mistakes:
        raise InputError(*mistakes)
    # a scene whose unloaded film has no charges is refused before a response is built
    compute_unloaded_integrals(Problem.from_scene(scene))
    electrodes = [electrode.name for electrode in scene.electrode_list]
    source = None if options.signals == "-" else Path(options.signals)
    name = source or "standard input"
    with ExitStack() as stack:
        columns, batches = read_rows(stack, source, ".csv", electrodes)
        time = next((column for column in TIMES if column in columns), "")
        if not time:
            reason = "has a column t; name it t_s or t_ms" if "t" in columns else ""
            reason = reason or "has no column t_s or t_ms; give the times in s or ms there"
            raise InputError(f"{name}: {reason}")
        if mistakes := choice.mistakes(scene, options.scene):
            raise InputError(*mistakes)
        model = load_or_build_response(scene, options.scene, choice)
        with program.convert_value_errors():
            tracker = Tracker(model, unknown=unknown, unit=options.unit)
        kind = ".jsonl" if options.json else ".csv"
        write = open_writer(stack, None, kind, [f.name for f in fields(TrackRow)])
        rows, malformed, count, told = (row for batch in batches for row in batch), 0, 0, 0
        said = last = ""
        unit = f"; are the readings in {options.unit}, as --unit says?"
        wanted = f"give {len(columns)} numbers, or nan for what is missing"
        for count, (cells, sound) in enumerate(rows, 1):
            values, wrong = _sample(cells, sound, [time, *electrodes])
            t_s = TIMES[time] * values.pop(time)
            if wrong and not malformed:
                print(f"{name}: row {count} has {wrong}; {wanted}", file=sys.stderr, flush=True)
            malformed += bool(wrong)
            row = TrackRow(t_s, TouchStatus.MALFORMED) if wrong else tracker.update(t_s, values)
            write([_plain(row)])
            last = last if wrong else row.status
            if row.status == "settling" and math.isfinite(tracker.settling_ends_s) and not said:
                said = f"settling until t_s = {tracker.settling_ends_s:.4g}: do not touch"
                print(said, file=sys.stderr, flush=True)
            for summary in tracker.touches[told:]:
                if options.json:
                    write([{"summary": _plain(summary)}])
                else:
                    doubt = unit if summary.status in DOUBTED else ""
                    print(f"{summary}{doubt}", file=sys.stderr, flush=True)
            told = len(tracker.touches)
    if malformed:
        print(f"{name}: {malformed} of {count} rows are malformed, left out", file=sys.stderr)
        if malformed == count:
            return ExitCode.BAD_INPUT
    if last not in CALM:
        print(f"{name}: a touch has not ended at the last row ({last})", file=sys.stderr)
    elif not told:
        print(f"{name}: nothing touches{unit}", file=sys.stderr)
    return ExitCode.CONVERGED


def _sample(
    cells: dict[str, Any], sound: bool, columns: Sequence[str]
) -> tuple[dict[str, float], str]:
    """The numbers of a row by column, the time first, NaN where missing, and what keeps the row
    from being used."""
    texts = {key: cells.get(key, "").strip() for key in columns}
    values = {key: parse_cell(text) for key, text in texts.items()}
    wrong = {texts[n] for n, v in values.items() if math.isnan(v)} - {"", "nan", "NaN"}
    if wrong or not sound:
        return values, escape_unprintable(", ".join(sorted(wrong)))[:40] or f"{len(cells)} cells"
    return values, "" if math.isfinite(values[columns[0]]) else f"no time {columns[0]}"


def _plain(row: TrackRow) -> dict[str, Any]:
    """A row as JSON and CSV have it; times keep all their digits."""
    values = asdict(row)
    return {k: v if k == "t_s" and v == v else to_plain(v) for k, v in values.items()}
