"""``pvdf-fem locate --csv``: locating the rows of a table of readings one after the other."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.cli.inverse.locate_request import Request, require_locatable
from pvdf_fem.cli.inverse.reading_table import (
    EXTENSIONS,
    Row,
    choose_format,
    open_writer,
    parse_cell,
    read_rows,
    to_plain,
)
from pvdf_fem.cli.inverse.unit_option import choose_unit
from pvdf_fem.cli.output import find_output_errors
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.cli.response_choice import load_or_build_response
from pvdf_fem.progress import show_progress

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
    if errors:
        raise InputError(*errors)
    electrodes = [electrode.name for electrode in scene.electrode_list]
    counts = Counter[str]()
    mistakes = Counter[str]()
    with ExitStack() as stack:
        input_format = choose_format(source, options.json)
        columns, batches = read_rows(stack, source, input_format, electrodes)
        locator = _RowLocator(scene, request, options, columns)
        write = open_writer(
            stack, target, choose_format(target, options.json), locator.output_columns
        )
        line_count = _count_lines(source)
        # no progress between rows on a terminal, nor for a pipe, whose length is unknown
        progress = options.progress if target and line_count else False
        show = stack.enter_context(show_progress("rows", progress))
        for batch in batches:
            locator.settle_unit(batch)
            step = len(batch) if options.quick else CALIBRATED_ROWS
            for start in range(0, len(batch), step):
                rows = locator.locate(batch[start : start + step])
                for row in rows:
                    counts[row["status"]] += 1
                    mistakes.update(_list_mistakes(row["remark"]))
                write(rows)
                show(counts.total(), max(line_count, counts.total()))
    return _print_summary(counts, mistakes)


class _RowLocator:
    """A locator of the rows of a table, which loads or builds the response when it is made.

    Before that, it raises `ValueError` or `InputError` if the request or the columns of the table
    are invalid.
    """

    def __init__(
        self, scene: Scene, request: Request, options: argparse.Namespace, columns: list[str]
    ) -> None:
        from pvdf_fem.inverse.touch.locate import get_scene_quantities
        from pvdf_fem.inverse.touch.touches import Touches

        self.scene = scene
        self.request = request
        self.is_quick = options.quick
        electrodes = [electrode.name for electrode in scene.electrode_list]
        self.electrodes = [name for name in electrodes if name in columns]
        #: Columns that are copied to the output.
        self.copied = [name for name in columns if name not in electrodes and name not in KNOWN]
        #: Columns with known quantities.
        self.known_columns = [name for name in KNOWN if name in columns]
        no_touches = Touches.make_empty(np.array([], dtype=object), (), "total")
        added = list(no_touches.to_table())
        self.output_columns = [*self.copied, *added]
        clashes = [name for name in added if name in self.copied]
        if clashes:
            raise InputError(*(_describe_clash(options.csv, name) for name in clashes))
        #: Known quantities that are the same in all rows.
        self.known = {
            name: value
            for name, value in get_scene_quantities(scene).items()
            if name not in request.unknown and name not in columns
        }
        any_charge_pC = np.pi  # only a placeholder, since each row is checked later
        readings_pC = dict.fromkeys(self.electrodes, any_charge_pC)
        require_locatable({options.scene: scene}, request, readings_pC, self.known)
        self.response = load_or_build_response(scene, options.scene, request.response)
        self._name = str(options.csv)
        self._is_unit_settled = False

    def settle_unit(self, rows: Sequence[Row]) -> None:
        """Choose the unit of the readings, until a touch explains some of them.

        Raises
        ------
        InputError
            If the readings are not in the unit that was given.
        """
        if self._is_unit_settled:
            return
        readings = {name: _read_column(rows, name) for name in self.electrodes}
        unit = choose_unit(
            self.response,
            readings,
            self.request.unit,
            self._name,
            sigma=self.request.sigma,
            noise=self.request.noise,
            reading=self.request.reading,
            known=self._collect_known(rows),
        )
        self.request = replace(self.request, unit=unit)

    def _collect_known(self, rows: Sequence[Row]) -> dict[str, Array]:
        """Collect the known quantities of some rows, by the arguments of `locate_many`."""
        known = {}
        for name, value in self.known.items():
            if name in KNOWN:
                known[KNOWN[name]] = np.full(len(rows), value)
        for name in self.known_columns:
            known[KNOWN[name]] = _read_column(rows, name)
        return known

    def locate(self, rows: Sequence[Row]) -> list[dict[str, Any]]:
        """Locate rows, and return for each row the cells of the output by column.

        The output cells of an incomplete row have the status malformed instead of a touch.
        """
        from pvdf_fem.inverse.touch.locate_many import locate_many

        touches = locate_many(
            self.response,
            {name: _read_column(rows, name) for name in self.electrodes},
            self.request.sigma,
            noise_pC=self.request.noise_pC(self.scene),
            reading=self.request.reading,
            unit=self.request.unit,
            calibrated=not self.is_quick,
            **self._collect_known(rows),
        )
        self._is_unit_settled |= bool(touches.explained.any())
        table = touches.to_table()
        columns = {name: column.tolist() for name, column in table.items()}
        located = []
        for i, row in enumerate(rows):
            cells = {name: row.cells.get(name) for name in self.copied}
            if row.is_complete:
                cells |= {name: to_plain(column[i]) for name, column in columns.items()}
            else:
                cells |= _make_malformed_row_cells(columns)
            located.append(cells)
        return located


def _make_malformed_row_cells(columns: dict[str, Any]) -> dict[str, Any]:
    """Return the cells for a malformed row: a status, an empty remark, and None otherwise."""
    from pvdf_fem.inverse.touch.touch import TouchStatus

    return {**dict.fromkeys(columns), "status": str(TouchStatus.MALFORMED), "remark": ""}


def _describe_clash(file: str, column: str) -> str:
    """Return the error message about an input column with the name of an output column."""
    return (
        f"{file}: column {column}: has the name of a column of the output; rename it, such as to "
        f"given_{column}"
    )


def _read_column(rows: Sequence[Row], column: str) -> Array:
    """Return the numbers in a column of several rows, NaN for cells that are not finite numbers."""
    return np.array([parse_cell(row.cells.get(column)) for row in rows])


def _list_mistakes(remark: str) -> list[str]:
    """Return the parts of a remark that describe a mistake in the readings."""
    return [part for part in remark.split("; ") if part.startswith(MISTAKE_PREFIX)]


def _count_lines(source: Path | None) -> int:
    """Count the lines of a file; 0 for standard input, whose length is unknown."""
    if source is None:
        return 0
    with source.open("rb") as file:
        return sum(1 for _ in file)


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
    print(f"{counts.total()} rows: {by_status or 'none'}", file=sys.stderr)
    fitting = sum(counts[status] for status in EXPLAINED_STATUSES)
    is_mistaken = False
    for mistake, count in mistakes.most_common(1):  # none or one
        is_mistaken = count > fitting
        if is_mistaken:
            print(f"only {fitting} rows fit as they are, {count} are {mistake}", file=sys.stderr)
    is_located = counts.total() == 0 or (fitting > 0 and not is_mistaken)
    return ExitCode.CONVERGED if is_located else ExitCode.NOT_CONVERGED
