"""``pvdf-fem locate --csv``: locating the rows of a table of readings one after the other."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.cli.inverse.locate_request import Request, require_locatable
from pvdf_fem.cli.inverse.reading_table import (
    EXTENSIONS,
    MAX_MALFORMED,
    choose_electrode_columns,
    count_lines,
    describe_words,
    open_readings,
    open_writer,
    to_plain,
)
from pvdf_fem.cli.inverse.recording_options import make_recording_options
from pvdf_fem.cli.inverse.unit_choice import choose_unit
from pvdf_fem.cli.inverse.unit_option import require_valid_unit
from pvdf_fem.cli.output import find_output_errors
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.cli.response_choice import load_or_build_response
from pvdf_fem.files import escape_unprintable
from pvdf_fem.progress import show_progress
from pvdf_fem.readings.formats import choose_format
from pvdf_fem.readings.selection import NumberColumns, choose_quantity
from pvdf_fem.readings.table import Row, Table
from pvdf_fem.readings.text.numbers import CellError

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene

#: Number of rows that are located and written together without ``--quick``. A row then takes
#: milliseconds, since its standard deviations are calibrated by a search of all likely touches.
CALIBRATED_ROWS = 32
#: Arguments of `locate_many` by the columns with known quantities of a touch.
KNOWN = {"rotation_deg": "rotations_deg", "force_N": "forces_N"}
MISTAKE_PREFIX = "explained if"  #: Prefix of a remark about a mistake in the readings of a row.
MAX_MISTAKES = 3  #: Maximum number of mistakes in the summary of a table.


def locate_table(scene: Scene, request: Request, options: argparse.Namespace) -> int:
    """Locate the rows of a table as they arrive, write the touches, and print a summary.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor with a single probe.
    request : Request
        Validated options: unknown quantities, noise, and response.
    options : argparse.Namespace
        Options of ``pvdf-fem locate``, with the paths of the tables of readings and of touches.

    Returns
    -------
    int
        Exit code of the command, see `_print_summary`.

    Raises
    ------
    InputError, ValueError
        If options or the header of the table are invalid. The exception lists the errors.
    """
    source = None if options.csv == "-" else Path(options.csv)
    target = None if options.output == "-" else Path(options.output)
    errors = find_output_errors(target, EXTENSIONS, Path(options.scene), source, options.model)
    if not {"x_mm", "y_mm"} <= set(request.unknown):
        errors.append("--unknown: x and y are always unknown in a table; name them")
    given_options = make_recording_options(options, scene, errors)
    if errors:
        raise InputError(*errors)
    recording_options = replace(given_options, needs_times=False, quantities=list(KNOWN))
    electrodes = [electrode.name for electrode in scene.electrode_list]
    counts = Counter[str]()
    mistakes = Counter[str]()
    clipped = Counter[str]()
    with ExitStack() as stack:
        input_format = choose_format(source, options.json)
        table = open_readings(stack, source, input_format, electrodes, recording_options)
        locator = _RowLocator(scene, request, options, table)
        write = open_writer(
            stack, target, choose_format(target, options.json), locator.output_columns
        )
        line_count = count_lines(source if table.reopen else None)
        # no progress between rows on a terminal, nor for a pipe, whose length is unknown
        progress = options.progress if target and line_count else False
        show = stack.enter_context(show_progress("rows", progress))
        for batch in table.batches:
            for rows in locator.locate(batch):
                for row in rows:
                    counts[row["status"]] += 1
                    mistakes.update(_list_mistakes(row["remark"]))
                    clipped.update((row["clipped"] or "").split())
                write(rows)
                show(counts.total(), max(line_count, counts.total()))
    locator.report_cells()
    if clipped:
        _print_clipped(clipped, locator.limits, locator.unit)
    return _print_summary(counts, mistakes)


class _RowNote(NamedTuple):
    """A note about the cells of a row: why it is refused, or the words in place of numbers."""

    text: str  #: Empty if there is nothing to say.
    is_refused: bool

    def add_to(self, remark: str) -> str:
        """Return a remark about a touch with this note, which replaces it for a refused row."""
        if self.is_refused or not remark:
            return self.text or remark
        return f"{remark}; {self.text}" if self.text else remark


class _RowLocator:
    """A locator of the rows of a table, which loads or builds the response when it is made.

    Before that, it raises `ValueError` or `InputError` if the request or the columns of the table
    are invalid.
    """

    def __init__(
        self, scene: Scene, request: Request, options: argparse.Namespace, table: Table
    ) -> None:
        from pvdf_fem.electrodes.channel import get_reading_unit, make_channels
        from pvdf_fem.inverse.clipping import TableLimits
        from pvdf_fem.inverse.touch.locate import get_scene_quantities

        self.scene = scene
        self.is_quick = options.quick
        electrodes = [electrode.name for electrode in scene.electrode_list]
        readings, unit = choose_electrode_columns(table, electrodes, request.unit)
        require_valid_unit(scene, unit, table.name)
        self.given_unit = unit or request.unit
        self.unit = self.given_unit or get_reading_unit(scene)
        self.request = replace(request, unit=self.given_unit)
        self.electrodes = list(readings)
        chosen = dict(readings)
        for name in KNOWN:
            column = choose_quantity(table, name)
            if column is not None:
                chosen[name] = column
        #: Columns with known quantities.
        self.known_columns = [name for name in KNOWN if name in chosen]
        self.numbers = NumberColumns(table, list(chosen.values()))
        self.names = list(chosen)
        #: Indices of the columns that are copied to the output, by their names there.
        self.copied = _name_copied_columns(table, [column.index for column in chosen.values()])
        self.output_columns = [*self.copied, *_list_touch_columns()]
        self.malformed: list[str] = []
        #: Known quantities that are the same in all rows.
        self.known = {
            name: value
            for name, value in get_scene_quantities(scene).items()
            if name not in request.unknown and name not in chosen
        }
        any_charge_pC = np.pi  # only a placeholder, since each row is checked later
        readings_pC = dict.fromkeys(self.electrodes, any_charge_pC)
        require_locatable({options.scene: scene}, self.request, readings_pC, self.known)
        self.response = load_or_build_response(
            scene,
            options.scene,
            request.response,
            with_sensitivities=request.include_calibration,
        )
        #: Lowest and highest readings at which channels have turned out to clip.
        self.limits: dict[str, tuple[float, float]] = {}
        channels = [each for each in make_channels(scene) if each.name in self.electrodes]
        self._table_limits = TableLimits(channels)
        self._is_unit_settled = False

    def _settle_unit(self, numbers: Mapping[str, Array]) -> None:
        """Choose the unit of the readings, until a touch explains some of them.

        Parameters
        ----------
        numbers : mapping of str to ndarray, shape (rows,)
            Readings by electrode, and known quantities.

        Raises
        ------
        InputError
            If the readings are not in the unit that was given.
        """
        if self._is_unit_settled:
            return
        self.unit = choose_unit(
            self.response,
            {name: numbers[name] for name in self.electrodes},
            self.given_unit,
            self.numbers.table.name,
            request=self.request,
            known=self._collect_known(numbers),
        )
        self.request = replace(self.request, unit=self.unit)

    def _collect_known(self, numbers: Mapping[str, Array]) -> dict[str, Any]:
        """Collect the known quantities of some rows, by the arguments of `locate_many`."""
        known = {}
        row_count = len(numbers[self.electrodes[0]])
        for name, value in self.known.items():
            known[KNOWN[name]] = np.full(row_count, value)
        for name in self.known_columns:
            known[KNOWN[name]] = numbers[name]
        return known

    def locate(self, rows: Sequence[Row]) -> Iterator[list[dict[str, Any]]]:
        """Locate rows, and yield for some rows at a time the cells of the output by column.

        If a row cannot be read, the output has the reason as remark instead of a touch; its status
        is ``malformed`` if the row is, and ``not_finite`` if one of its cells is not a number.
        """
        numbers, notes = self._read_numbers(rows)
        self._settle_unit(numbers)
        self._find_limits(numbers)
        step = len(rows) if self.is_quick else CALIBRATED_ROWS
        for start in range(0, len(rows), step):
            part = slice(start, start + step)
            located = self._locate_numbers({name: numbers[name][part] for name in numbers})
            yield self._make_cells(rows[part], notes[part], located)

    def _find_limits(self, numbers: Mapping[str, Array]) -> None:
        """Find the readings at which channels clip, though the scene has no ``readout.range_V``.

        Parameters
        ----------
        numbers : mapping of str to ndarray, shape (rows,)
            Readings by electrode; other quantities are ignored.
        """
        names = [channel.name for channel in self._table_limits.channels]
        readings = np.stack([numbers[name] for name in names], axis=1)
        found = self._table_limits.learn(readings, self.unit)
        limits = zip(found.low.tolist(), found.high.tolist(), strict=True)
        self.limits = dict(zip(names, limits, strict=True))

    def _locate_numbers(self, numbers: Mapping[str, Array]) -> dict[str, list[Any]]:
        """Locate touches, and return the columns of the output that describe them.

        Parameters
        ----------
        numbers : mapping of str to ndarray, shape (rows,)
            Readings by electrode, and known quantities.
        """
        from pvdf_fem.inverse.touch.locate_many import locate_many

        touches = locate_many(
            self.response,
            {name: numbers[name] for name in self.electrodes},
            self.request.sigma,
            noise_pC=self.request.convert_noise_to_pC(self.scene),
            reading=self.request.reading,
            unit=self.unit,
            limits=self.limits,
            include_calibration=self.request.include_calibration,
            calibrated=not self.is_quick,
            **self._collect_known(numbers),
        )
        self._is_unit_settled |= bool(touches.explained.any())
        return {name: column.tolist() for name, column in touches.to_table().items()}

    def _make_cells(
        self, rows: Sequence[Row], notes: Sequence[_RowNote], columns: Mapping[str, list[Any]]
    ) -> list[dict[str, Any]]:
        """Make the cells of the output by column, for each of some rows.

        Parameters
        ----------
        rows : sequence of Row
            Rows of the table, from which columns are copied.
        notes : sequence of _RowNote
            Notes about the cells of each row.
        columns : mapping of str to list
            Columns of the output that describe the touches.
        """
        located = []
        for i, row in enumerate(rows):
            cells = dict.fromkeys(self.copied)
            for name, index in self.copied.items():
                if index < len(row.cells):
                    cells[name] = row.cells[index]
            if row.defect:
                cells |= _make_malformed_row_cells(columns, notes[i].text)
            else:
                cells |= {name: to_plain(column[i]) for name, column in columns.items()}
                cells["remark"] = notes[i].add_to(str(cells["remark"]))
            located.append(cells)
        return located

    def report_cells(self) -> None:
        """Print the first malformed rows, and words in place of numbers, on standard error."""
        name = self.numbers.table.name
        for reason in self.malformed:
            print(f"{name}: {reason}", file=sys.stderr)
        for words in describe_words(self.numbers):
            print(f"{name}: {words}", file=sys.stderr)

    def _read_numbers(self, rows: Sequence[Row]) -> tuple[dict[str, Array], list[_RowNote]]:
        """Read the numbers of rows.

        Returns
        -------
        numbers : dict of str to ndarray, shape (rows,)
            Readings by electrode, and known quantities; NaN where missing or malformed. Readings
            that are marked as beyond the range of an instrument are infinite.
        notes : list of _RowNote
            Notes about the cells of each row.
        """
        values = np.full((len(rows), len(self.names)), np.nan)
        notes = []
        for i, row in enumerate(rows):
            try:
                values[i] = self.numbers.read(row)
                words = self.numbers.describe_words(row, values[i])
                notes.append(_RowNote(escape_unprintable(words), is_refused=False))
            except CellError as error:
                reason = escape_unprintable(str(error))
                notes.append(_RowNote(reason, is_refused=True))
                if len(self.malformed) < MAX_MALFORMED:
                    self.malformed.append(reason)
        return dict(zip(self.names, values.T, strict=True)), notes


def _list_touch_columns() -> list[str]:
    """Return the names of the columns of the output that describe touches."""
    from pvdf_fem.inverse.touch.touches import Touches

    no_touches = Touches.make_empty(np.array([], dtype=object), (), "total")
    return list(no_touches.to_table())


def _name_copied_columns(table: Table, used: Sequence[int]) -> dict[str, int]:
    """Return the indices of the columns that are copied to the output, by their names there.

    A column with the name of a column of touches, such as the true ``x_mm`` of a dataset, is copied
    as ``given_x_mm``.

    Parameters
    ----------
    table : Table
        The table of readings.
    used : sequence of int
        Indices of the columns with readings and known quantities, which are not copied.

    Raises
    ------
    InputError
        If two columns would have the same name.
    """
    added = _list_touch_columns()
    copied: dict[str, int] = {}
    for index, column in enumerate(table.columns):
        if index in used:
            continue
        name = f"given_{column.heading}" if column.heading in added else column.heading
        if name in copied:
            raise InputError(f"{table.name}: column {name}: occurs twice in the output; rename one")
        copied[name] = index
    return copied


def _make_malformed_row_cells(columns: Iterable[str], reason: str) -> dict[str, Any]:
    """Return the cells for a malformed row: a status, the reason as remark, and None otherwise."""
    from pvdf_fem.inverse.touch.touch import TouchStatus

    return {**dict.fromkeys(columns), "status": str(TouchStatus.MALFORMED), "remark": reason}


def _list_mistakes(remark: str) -> list[str]:
    """Return the parts of a remark that describe a mistake in the readings."""
    return [part for part in remark.split("; ") if part.startswith(MISTAKE_PREFIX)]


def _print_clipped(
    clipped: Counter[str], limits: Mapping[str, tuple[float, float]], unit: str
) -> None:
    """Print on standard error which channels are clipped, where, and what to do.

    Parameters
    ----------
    clipped : Counter of str
        Number of clipped readings by electrode.
    limits : mapping of str to tuple of float
        Lowest and highest readings at which channels have turned out to clip; infinite for none.
    unit : str
        Unit of the limits.
    """
    from pvdf_fem.inverse.clipping import CLIPPED_ADVICE

    parts = []
    for name, count in sorted(clipped.items()):
        ends = [f"{end:.6g} {unit}" for end in limits.get(name, ()) if np.isfinite(end)]
        place = f" at {' and '.join(ends)}" if ends else ""
        parts.append(f"{name}{place} in {count} {'row' if count == 1 else 'rows'}")
    print(f"clipped: {', '.join(parts)}; {CLIPPED_ADVICE}", file=sys.stderr)


def _print_summary(counts: Counter[str], mistakes: Counter[str]) -> int:
    """Print a summary of all rows on standard error, and return the exit code.

    If all readings contain a mistake, such as exchanged channels, some rows may still fit a touch
    by chance. The table therefore counts as located only if the rows that fit without a correction
    are at least as many as the rows that the most frequent mistake explains.

    Parameters
    ----------
    counts : Counter of str
        Number of rows by status.
    mistakes : Counter of str
        Number of rows by the mistake that would explain their readings.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if the table counts as located or has no rows, otherwise
        `ExitCode.NOT_CONVERGED`.
    """
    from pvdf_fem.inverse.touch.touch import EXPLAINED_STATUSES

    unexplained = counts["unexplained"]
    for mistake, count in mistakes.most_common(MAX_MISTAKES):
        print(f"{count} of {unexplained} unexplained rows: {mistake}", file=sys.stderr)
    if unexplained and not mistakes:
        print(
            "unexplained rows: no touch fits them; check --unit, signs and the order of channels",
            file=sys.stderr,
        )
    by_status = ", ".join(f"{count} {status}" for status, count in counts.items() if count)
    rows = "1 row" if counts.total() == 1 else f"{counts.total()} rows"
    print(f"{rows}: {by_status or 'none'}", file=sys.stderr)
    fitting = sum(counts[status] for status in EXPLAINED_STATUSES)
    is_mistaken = False
    for mistake, count in mistakes.most_common(1):  # none or one
        is_mistaken = count > fitting
        if is_mistaken:
            print(f"rows that fit as they are: {fitting}; {mistake}: {count}", file=sys.stderr)
    is_located = counts.total() == 0 or (fitting > 0 and not is_mistaken)
    return ExitCode.CONVERGED if is_located else ExitCode.NOT_CONVERGED
