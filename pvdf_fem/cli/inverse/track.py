"""The command ``pvdf-fem track``: touches in a stream of readings."""

from __future__ import annotations

import argparse
import gc
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import fields
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.inverse.calibration_option import add_calibration_option
from pvdf_fem.cli.inverse.locate_request import UNKNOWN_HELP, parse_unknowns
from pvdf_fem.cli.inverse.reading_table import (
    MAX_MALFORMED,
    choose_electrode_columns,
    describe_words,
    open_readings,
    open_writer,
    to_plain,
)
from pvdf_fem.cli.inverse.recording_options import add_recording_options, make_recording_options
from pvdf_fem.cli.inverse.unit_option import (
    add_unit_option,
    parse_unit_option,
    require_valid_unit,
)
from pvdf_fem.cli.options import add_scene_command, add_text_option, read_scene
from pvdf_fem.cli.program import ExitCode, InputError, convert_value_errors
from pvdf_fem.cli.response_choice import (
    ResponseChoice,
    add_response_options,
    load_or_build_response,
)
from pvdf_fem.files import escape_unprintable
from pvdf_fem.readings.formats import choose_format
from pvdf_fem.readings.selection import ChosenColumn, NumberColumns, choose_times
from pvdf_fem.readings.table import Row, Table
from pvdf_fem.readings.text.numbers import CellError

if TYPE_CHECKING:
    from pvdf_fem.inverse.tracking.results import TrackRow
    from pvdf_fem.inverse.tracking.tracker import Tracker

#: Statuses of touches without a position that can be relied on.
UNLOCATED_STATUSES = ("settling", "starting", "unexplained")
#: Statuses of touches that may be due to a wrong unit of the readings.
DOUBTFUL_STATUSES = ("too_strong", "unexplained")

_DESCRIPTION = """\
Follow touches in sampled readings of the scene's channels, in V if the scene has a
[readout], and in pC if not, unless readout.unit or --unit says otherwise: when they
begin and end, where they are (on the [stage]) and their force, with standard
deviations. Charge that is lost through resistances is integrated and added again;
offsets and slow drifts are followed while nothing touches.

The signals are a table with a column t_s, t_ms, t_us, or of times of day, and one for
each electrode, or - for standard input, which may be a live pipe: each row is
answered at once by a row of CSV, and each touch that has ended by a line on standard
error. Tables are read as instruments and spreadsheets write them, with any separator,
decimal commas, header blocks and units. An empty cell or nan is a missing reading, a
word such as OVER one beyond the range; other columns are ignored.

The files of loggers are read as well, with times, rate and units as they have them:
TDMS, LVM, XDF, MCAP, ROS 2 bags, HDF5, MATLAB, WAV and Parquet. Their packages come
by: pip install "pvdf-fem[loggers]".

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
  clipped      too many channels were at the end of their range at the peak
  lost         a touch can no longer be distinguished from the drift, or readings are
               missing where its force may have been largest
  malformed    a cell is not a number; the row is skipped

Repeated, exchanged, jittered and missing times, gaps, spikes, clipped and frozen
channels, and mains hum (readout.mains_Hz) are found and repaired; each kind is said
once on standard error.

examples:
  pvdf-fem track sensor.toml signals.csv > rows.csv
  my-logger | pvdf-fem track sensor.toml - --json
  pvdf-fem track sensor.toml recording.tdms --channels A=Group/ai0,B=Group/ai1 > rows.csv
  pvdf-fem track sensor.toml recording.wav --full-scale 2.5 --average 24 > rows.csv

exit codes: 0 done, 2 bad input, or no row that can be used, 3 a touch was not located,
or the baseline was never learned"""


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
    parser.add_argument("signals", metavar="SIGNALS", help="readings, or - for standard input")
    add_unit_option(parser, is_tested=False)
    add_text_option(parser, "--unknown", "NAMES", about=UNKNOWN_HELP, default="x,y,force")
    add_calibration_option(parser)
    add_recording_options(parser)
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
    recording_options = make_recording_options(options, scene, errors)
    if errors:
        raise InputError(*errors)
    # This raises an error if the film has no unloaded equilibrium, before a response is built.
    compute_unloaded_integrals(Problem.from_scene(scene))
    electrodes = [electrode.name for electrode in scene.electrode_list]
    source = None if options.signals == "-" else Path(options.signals)
    with ExitStack() as stack:
        table_format = choose_format(source, False)
        table = open_readings(stack, source, table_format, electrodes, recording_options)
        columns, unit = choose_electrode_columns(table, electrodes, unit)
        require_valid_unit(scene, unit, table.name)
        times = _choose_time_column(table)
        errors = choice.find_errors(scene, options.scene)
        if errors:
            raise InputError(*errors)
        includes_calibration = not options.without_calibration
        response = load_or_build_response(
            scene, options.scene, choice, with_sensitivities=includes_calibration
        )
        with convert_value_errors():
            tracker = Tracker(
                response, unknown=unknown, unit=unit, include_calibration=includes_calibration
            )
        numbers = NumberColumns(table, [times, *columns.values()])
        session = _Session(tracker, numbers, list(columns), options, stack, unit=unit)
        # Each full garbage collection would stop the stream for tens of milliseconds to visit what
        # exists already.
        gc.freeze()
        stack.callback(gc.unfreeze)
        for batch in table.batches:
            session.process(batch)
    return session.finish()


def _choose_time_column(table: Table) -> ChosenColumn:
    """Return the column of times; raise `InputError` if there is none."""
    column = choose_times(table)
    if column is None:
        raise InputError(
            f"{table.name}: has no column of times; name it t_s, t_ms or t_us, by its unit, give "
            '--channels "t_s=NAME", or the rate by --rate HZ'
        )
    return column


class _Session:
    """A tracker with its output: rows on standard output, and messages on standard error.

    Parameters
    ----------
    tracker : Tracker
        The tracker.
    numbers : NumberColumns
        Reader of the time and of the readings in each row.
    electrodes : sequence of str
        Names of the electrodes whose readings follow the time.
    options : argparse.Namespace
        Options of the command.
    stack : ExitStack
        Context in which rows are written.
    unit : str or None
        Unit of the readings; None for that of the readout.
    """

    def __init__(
        self,
        tracker: Tracker,
        numbers: NumberColumns,
        electrodes: Sequence[str],
        options: argparse.Namespace,
        stack: ExitStack,
        unit: str | None,
    ) -> None:
        from pvdf_fem.electrodes.channel import get_reading_unit
        from pvdf_fem.inverse.tracking.results import TrackRow

        self.tracker = tracker
        self.numbers = numbers
        self.electrodes = tuple(electrodes)
        self.name = numbers.table.name
        self.as_json = options.json
        unit = unit or get_reading_unit(tracker.response.scene)
        self.unit_doubt = f"; are the readings in {unit}? If not, give --unit"
        columns = [field.name for field in fields(TrackRow)]
        self.write = open_writer(stack, None, ".jsonl" if options.json else ".csv", columns)
        self.rows = 0
        self.malformed_rows = 0
        self.timed_rows = 0  #: Number of rows that have a time and are not malformed.
        self.reported_touches = 0
        self.has_announced_settling = False
        self.printed_kinds: set[str] = set()

    def process(self, rows: Sequence[Row]) -> None:
        """Update the tracker by rows of readings, and write the results and the ended touches.

        A row of results is written for each row. A malformed row does not change the tracker.

        Parameters
        ----------
        rows : sequence of Row
            The rows that have arrived.
        """
        self.write(self._track(rows))

    def _track(self, rows: Sequence[Row]) -> Iterator[dict[str, Any]]:
        """Yield the results of rows as plain values, and with ``--json`` the ended touches."""
        from pvdf_fem.inverse.touch.touch import TouchStatus
        from pvdf_fem.inverse.tracking.results import TrackRow

        for row in rows:
            self.rows += 1
            try:
                t_s, readings = self._read_sample(row)
            except CellError as error:
                self._report_malformed_row(str(error))
                t_s = self.numbers.read_cell_or_nan(row, 0)
                yield _to_plain_row(TrackRow(t_s, TouchStatus.MALFORMED))
                continue
            self.timed_rows += math.isfinite(t_s)
            tracked = self.tracker.update(t_s, readings)
            yield _to_plain_row(tracked)
            if tracked.status == "settling":
                self._announce_settling()
            if len(self.tracker.touches) > self.reported_touches:
                yield from self._report_touches()
                self._print_notes()

    def _read_sample(self, row: Row) -> tuple[float, dict[str, float]]:
        """Return the time in s and the readings by electrode of a row.

        Readings that are marked as beyond the range of an instrument are infinite, and the time may
        be missing. `CellError` is raised if the row is malformed.
        """
        t_s, *readings = self.numbers.read(row)
        return t_s, dict(zip(self.electrodes, readings, strict=True))

    def finish(self) -> int:
        """Finish the tracker, report the whole stream on standard error, and return the exit code.

        If no row can be used, the exit code is `ExitCode.BAD_INPUT`. If a touch was not located
        or the baseline was never learned, it is `ExitCode.NOT_CONVERGED`.
        """
        last = self.tracker.finish()
        self.write(self._report_touches())
        if self.malformed_rows:
            count = f"{self.malformed_rows} of {self.rows} rows are malformed"
            self._print_message(f"{self.name}: {count} and were skipped")
        for words in describe_words(self.numbers):
            self._print_message(f"{self.name}: {words}")
        if self.rows and not self.timed_rows:
            self._print_message(f"{self.name}: no row has a time and readings; nothing is tracked")
            return ExitCode.BAD_INPUT
        self._print_notes()
        touches = self.tracker.touches
        unlocated = [touch for touch in touches if touch.status in UNLOCATED_STATUSES]
        if unlocated:
            count = f"{len(unlocated)} of {len(touches)} touches were not located"
            self._print_message(f"{self.name}: {count}{self.unit_doubt}")
        elif not touches and last.status != "settling":
            self._print_message(f"{self.name}: nothing touches{self.unit_doubt}")
        is_lost = bool(touches) and all(touch.status == "lost" for touch in touches)
        is_incomplete = bool(unlocated) or is_lost or last.status == "settling"
        return ExitCode.NOT_CONVERGED if is_incomplete else ExitCode.CONVERGED

    def _print_notes(self) -> None:
        """Print the first note of each kind."""
        for note in self.tracker.list_notes():
            if note.kind not in self.printed_kinds:
                self.printed_kinds.add(note.kind)
                self._print_message(f"{self.name}: {note.text}")

    def _report_malformed_row(self, reason: str) -> None:
        """Count a malformed row, and print a message if it is one of the first."""
        self.malformed_rows += 1
        if self.malformed_rows <= MAX_MALFORMED:
            self._print_message(f"{self.name}: {escape_unprintable(reason)}")

    def _announce_settling(self) -> None:
        """Print until which time the baseline is learned, once and when this time is known."""
        end_s = self.tracker.settling_ends_s
        if not self.has_announced_settling and math.isfinite(end_s):
            self.has_announced_settling = True
            self._print_message(f"settling until t_s = {round(end_s, 3):.15g}: do not touch")

    def _report_touches(self) -> Iterator[dict[str, Any]]:
        """Report the touches that have ended since the previous row.

        They are yielded for JSON, or printed on standard error.
        """
        for summary in self.tracker.touches[self.reported_touches :]:
            if self.as_json:
                yield {"summary": _to_plain_row(summary)}
            else:
                doubt = self.unit_doubt if summary.status in DOUBTFUL_STATUSES else ""
                self._print_message(f"{summary}{doubt}")
        self.reported_touches = len(self.tracker.touches)

    def _print_message(self, message: str) -> None:
        """Print a message on standard error, and flush it."""
        print(message, file=sys.stderr, flush=True)


@cache
def _list_fields(row_class: type[TrackRow]) -> tuple[tuple[str, ...], Callable[[Any], Any]]:
    """Return the names of the fields of a class of rows, and a function that gets their values."""
    names = tuple(field.name for field in fields(row_class))
    return names, attrgetter(*names)


def _to_plain_row(row: TrackRow) -> dict[str, Any]:
    """Convert a row to plain values for JSON and CSV, rounded to nine digits, ``t_s`` to 1 ns."""
    names, get_values = _list_fields(type(row))
    plain = dict(zip(names, map(to_plain, get_values(row)), strict=True))
    if not math.isnan(row.t_s):
        plain["t_s"] = round(row.t_s, 9)
    return plain
