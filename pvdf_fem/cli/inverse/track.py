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

from pvdf_fem.cli.inverse.locate_request import UNKNOWN_HELP, parse_unknowns
from pvdf_fem.cli.inverse.reading_table import Row, open_writer, parse_cell, read_rows, to_plain
from pvdf_fem.cli.inverse.unit_option import add_unit_option, parse_unit_option
from pvdf_fem.cli.options import add_scene_command, add_text_option, read_scene
from pvdf_fem.cli.program import ExitCode, InputError, convert_value_errors
from pvdf_fem.cli.response_choice import (
    ResponseChoice,
    add_response_options,
    load_or_build_response,
)
from pvdf_fem.files import escape_unprintable

if TYPE_CHECKING:
    from pvdf_fem.inverse.tracking.results import TrackRow
    from pvdf_fem.inverse.tracking.tracker import Tracker

TIME_UNITS_S = {"t_s": 1.0, "t_ms": 1e-3}  #: Units in s by the possible columns of times.
STATUSES_WITHOUT_TOUCH = ("", "quiet", "settling")
#: Statuses of touches that may be due to a wrong unit of the readings.
DOUBTFUL_STATUSES = ("too_strong", "unexplained")
#: Texts of cells that mean a missing reading.
MISSING = {"", "nan", "NaN"}

_DESCRIPTION = """\
Follow touches in sampled readings of the scene's channels, in V if the scene has a
[readout], and in pC if not, unless readout.unit or --unit says otherwise: when they
begin and end, where they are (on the [stage]) and their force, with standard
deviations. Charge that is lost through resistances is integrated and added again;
offsets and slow drifts are followed while nothing touches.

The signals are a CSV file with a column t_s, or t_ms, and one for each electrode, or -
for standard input, which may be a live pipe: each row is answered at once by a
row of CSV, and each touch that has ended by a line on standard error. An empty
cell or nan is a missing reading; other columns are ignored.

A response is needed, as for `locate`: the first call builds it, says how long that
takes, and stores it beside the scene file."""

_EPILOG = """\
status of a row, and of a touch that has ended:
  settling     the first readings, from which the baseline is learned: do not touch
  quiet, touch
  starting     a touch that is still too faint to be located; if it has ended, no
               place was found
  too_light, too_strong   the force is outside --force-range; the place is that of
               earlier samples
  unexplained  no touch of this probe gives such charges
  lost         a touch can no longer be distinguished from the drift, or the readings
               paused
  clock        the time did not increase, and the tracker restarts
  malformed    a cell is not a number, or there is no time; the row is skipped

examples:
  pvdf-fem track sensor.toml signals.csv > rows.csv
  my-logger | pvdf-fem track sensor.toml - --json

exit codes: 0 done, 2 bad input, or no row that can be used"""


def add_parser(commands: Any) -> None:
    """Add the `track` subcommand with its options to the parser of commands."""
    parser = add_scene_command(
        commands,
        "track",
        run,
        summary="touches in a stream of readings",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        json_help="print a JSON object for each row and touch",
    )
    parser.add_argument("signals", metavar="SIGNALS.csv", help="readings, or - for standard input")
    add_unit_option(parser, is_tested=False)
    add_text_option(parser, "--unknown", "NAMES", about=UNKNOWN_HELP, default="x,y,force")
    add_response_options(parser)


def run(options: argparse.Namespace) -> int:
    """Track touches in a stream of readings until it ends, and return the exit code.

    Raises
    ------
    InputError
        If options, the scene or the columns of the stream are invalid. The exception lists the
        errors.
    """
    scene = read_scene(options)
    from pvdf_fem.electrodes.channel import find_unit_errors
    from pvdf_fem.inverse.tracking.tracker import Tracker
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.solver.adaptive import compute_unloaded_integrals

    errors: list[str] = []
    unknown = parse_unknowns(options.unknown, errors)
    choice = ResponseChoice.from_options(options, errors)
    if "force_N" not in unknown:
        errors.append("--unknown: the force of a touch is always unknown; name it")
    if scene.single_probe is None:
        errors.append(f"{options.scene}: has no [probe]; add one")
    unit = parse_unit_option(options.unit)
    errors += find_unit_errors(scene, unit, "--unit")
    if errors:
        raise InputError(*errors)
    # This raises an error if the film has no unloaded equilibrium, before a response is built.
    compute_unloaded_integrals(Problem.from_scene(scene))
    electrodes = [electrode.name for electrode in scene.electrode_list]
    source = None if options.signals == "-" else Path(options.signals)
    name = str(source or "standard input")
    with ExitStack() as stack:
        columns, batches = read_rows(stack, source, ".csv", electrodes)
        time_column = _find_time_column(columns, name)
        errors = choice.find_errors(scene, options.scene)
        if errors:
            raise InputError(*errors)
        response = load_or_build_response(scene, options.scene, choice)
        with convert_value_errors():
            tracker = Tracker(response, unknown=unknown, unit=unit)
        session = _Session(tracker, name, options, stack)
        for batch in batches:
            for row in batch:
                session.process(row, time_column, electrodes)
    return session.finish()


def _find_time_column(columns: Sequence[str], name: str) -> str:
    """Return the name of the column with times; raise `InputError` if there is none."""
    for column in TIME_UNITS_S:
        if column in columns:
            return column
    if "t" in columns:
        raise InputError(f"{name}: has a column t; name it t_s or t_ms")
    raise InputError(f"{name}: has no column t_s or t_ms; give the times in s or ms there")


class _Session:
    """A tracker with its output: rows on standard output, and messages on standard error."""

    def __init__(
        self, tracker: Tracker, name: str, options: argparse.Namespace, stack: ExitStack
    ) -> None:
        from pvdf_fem.electrodes.channel import get_reading_unit
        from pvdf_fem.inverse.tracking.results import TrackRow

        self.tracker = tracker
        self.name = name  #: Of the table, for messages.
        self.as_json = options.json
        unit = parse_unit_option(options.unit) or get_reading_unit(tracker.response.scene)
        self.unit_doubt = f"; are the readings in {unit}? If not, give --unit"
        columns = [field.name for field in fields(TrackRow)]
        self.write = open_writer(stack, None, ".jsonl" if options.json else ".csv", columns)
        self.rows = 0
        self.malformed_rows = 0
        self.reported_touches = 0
        self.last_status = ""
        self.has_announced_settling = False

    def process(self, row: Row, time_column: str, electrodes: Sequence[str]) -> None:
        """Update the tracker by a row of readings, and report the result and ended touches.

        A row of results is written for each row. A malformed row does not change the tracker.

        Parameters
        ----------
        row : Row
            Row of the input with texts as cells.
        time_column : str
            Name of the column with times, one of `TIME_UNITS_S`.
        electrodes : sequence of str
            Names of the columns with readings.
        """
        from pvdf_fem.inverse.touch.touch import TouchStatus
        from pvdf_fem.inverse.tracking.results import TrackRow

        self.rows += 1
        columns = (time_column, *electrodes)
        sample = {column: row.cells.get(column, "").strip() for column in columns}
        values = {column: parse_cell(text) for column, text in sample.items()}
        t_s = TIME_UNITS_S[time_column] * values.pop(time_column)
        defect = _find_defect(row, sample, time_column)
        if defect:
            self._report_malformed_row(defect, len(row.cells))
            self.write([_to_plain_row(TrackRow(t_s, TouchStatus.MALFORMED))])
        else:
            tracked = self.tracker.update(t_s, values)
            self.write([_to_plain_row(tracked)])
            self.last_status = tracked.status
            self._announce_settling(tracked)
        self._report_touches()

    def finish(self) -> int:
        """Print messages about the whole stream on standard error, and return the exit code.

        They are about malformed rows, and about a touch that has not ended or the lack of any
        touch. If all rows are malformed, the exit code is `ExitCode.BAD_INPUT`.
        """
        if self.malformed_rows:
            count = f"{self.malformed_rows} of {self.rows} rows are malformed"
            self._print_message(f"{self.name}: {count} and were skipped")
            if self.malformed_rows == self.rows:
                return ExitCode.BAD_INPUT
        if self.last_status not in STATUSES_WITHOUT_TOUCH:
            self._print_message(
                f"{self.name}: a touch has not ended at the last row ({self.last_status})"
            )
        elif not self.reported_touches:
            self._print_message(f"{self.name}: nothing touches{self.unit_doubt}")
        return ExitCode.CONVERGED

    def _report_malformed_row(self, defect: str, columns: int) -> None:
        """Count a malformed row, and print a message if it is the first one."""
        self.malformed_rows += 1
        if self.malformed_rows == 1:
            advice = f"give {columns} numbers, or nan for missing readings"
            self._print_message(f"{self.name}: row {self.rows} has {defect}; {advice}")

    def _announce_settling(self, tracked: TrackRow) -> None:
        """Print until which time the baseline is learned, once and when this time is known."""
        end_s = self.tracker.settling_ends_s
        is_due = tracked.status == "settling" and not self.has_announced_settling
        if is_due and math.isfinite(end_s):
            self.has_announced_settling = True
            self._print_message(f"settling until t_s = {end_s:.4g}: do not touch")

    def _report_touches(self) -> None:
        """Report the touches that have ended since the previous row.

        They are written as JSON among the rows, or printed on standard error.
        """
        for summary in self.tracker.touches[self.reported_touches :]:
            if self.as_json:
                self.write([{"summary": _to_plain_row(summary)}])
            else:
                doubt = self.unit_doubt if summary.status in DOUBTFUL_STATUSES else ""
                self._print_message(f"{summary}{doubt}")
        self.reported_touches = len(self.tracker.touches)

    def _print_message(self, message: str) -> None:
        """Print a message on standard error, and flush it."""
        print(message, file=sys.stderr, flush=True)


def _find_defect(row: Row, sample: dict[str, str], time_column: str) -> str:
    """Return the reason why a row cannot be used, or an empty text.

    Parameters
    ----------
    row : Row
        Row of the input.
    sample : dict
        Cells of the time and the readings of the row as texts, by column.
    time_column : str
        Name of the column with times.

    Returns
    -------
    str
        The cells that are not numbers, or the number of cells if it is wrong, or that the time is
        missing; the first that applies. Empty if the row can be used; readings may be missing.
    """
    wrong = {
        text for text in sample.values() if math.isnan(parse_cell(text)) and text not in MISSING
    }
    if wrong:
        return escape_unprintable(", ".join(sorted(wrong)))[:40]
    if not row.is_complete:
        return f"{len(row.cells)} cells"
    if sample[time_column] in MISSING:
        return f"no time {time_column}"
    return ""


def _to_plain_row(row: TrackRow) -> dict[str, Any]:
    """Convert a row to plain values for JSON and CSV, rounded to nine digits except ``t_s``."""
    values = asdict(row)
    plain = {name: to_plain(value) for name, value in values.items()}
    if not math.isnan(values["t_s"]):
        plain["t_s"] = values["t_s"]
    return plain
