"""The columns of touches in a file, a mapping or a dataframe, as numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError, read_bytes
from pvdf_fem.readings.formats import parse_csv
from pvdf_fem.readings.loggers.channel_choice import has_channel
from pvdf_fem.readings.loggers.open_recording import RecordingOptions, open_recording
from pvdf_fem.readings.loggers.recording_table import make_table as make_recording_table
from pvdf_fem.readings.loggers.registry import open_reader
from pvdf_fem.readings.selection import (
    ChosenColumn,
    NumberColumns,
    choose_quantity,
    choose_readings,
)
from pvdf_fem.readings.table import Table, make_table
from pvdf_fem.readings.table_channels import make_channel_test, name_channels
from pvdf_fem.readings.text.header import make_name_test
from pvdf_fem.readings.text.numbers import CellError
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

MAX_FILE_SIZE = 10_000_000  #: Maximum size of a file in bytes.


class TouchesError(ValueError):
    """Error in the touches of a calibration; each argument is the line of one error."""

    def __str__(self) -> str:
        return "\n".join(self.args)


class TouchColumns(NamedTuple):
    """The numbers of touches."""

    #: Position x and y in mm, rotation in degrees, force in N, and readings of the electrodes;
    #: shape (rows, 4 + electrodes), NaN where missing, and infinite where they are marked as beyond
    #: the range of the instrument.
    values: Array
    unit: str | None  #: Unit of the readings, if the file or the user says it.
    notes: tuple[str, ...]  #: Sentences about columns that are not used, and about words in cells.


def read_touch_columns(source: Any, scene: Scene, unit: str | None) -> TouchColumns:
    """Read the numbers of touches; see `read_touches` for arguments and exceptions."""
    with ExitStack() as stack:
        return _read_columns(_open_table(source, scene, stack), scene, unit)


def _read_columns(table: Table, scene: Scene, unit: str | None) -> TouchColumns:
    """Read the numbers of a table of touches, see `read_touch_columns`."""
    electrodes = [electrode.name for electrode in scene.electrode_list]
    names = [*TOUCH_QUANTITIES, *electrodes]
    columns: dict[str, ChosenColumn] = {}
    for name in TOUCH_QUANTITIES:
        column = choose_quantity(table, name)
        if column is not None:
            columns[name] = column
    reading_columns, unit = choose_readings(table, electrodes, unit)
    columns |= reading_columns
    unused = _list_unused_headings(table, columns)
    assert scene.single_probe is not None
    needs_rotation = bool(scene.single_probe.period_deg)  # A disc has no rotation.
    needed = [name for name in names if needs_rotation or name != "rotation_deg"]
    errors = list(_find_missing_column_errors(columns, needed, unused))
    if errors:
        raise TouchesError(*errors)
    notes = [f"column {heading}: is not used" for heading in unused]
    values, errors = _read_rows(table, columns, names, notes)
    if errors:
        raise TouchesError(*errors)
    if "rotation_deg" not in columns:
        values[:, TouchColumn.ROTATION] = 0.0
    return TouchColumns(values, unit, tuple(notes))


def find_reading_unit(source: Any, scene: Scene) -> str | None:
    """Return the unit of the readings in the headings of touches, or None if they have none.

    Parameters
    ----------
    source, scene
        As for `read_touches`.
    """
    electrodes = [electrode.name for electrode in scene.electrode_list]
    with ExitStack() as stack:
        table = _open_table(source, scene, stack)
        return choose_readings(table, electrodes, unit=None)[1]


def _open_table(source: Any, scene: Scene, stack: ExitStack) -> Table:
    """Return the table of a file, a mapping or a dataframe.

    Parameters
    ----------
    source : path, mapping of str to sequence, or table with `columns`
        The touches. The file may be one of a logger, with a sample for each touch.
    scene : Scene
        Scene with the names of electrodes, and of their channels.
    stack : ExitStack
        Context in which a file stays open.

    Raises
    ------
    TouchesError
        If columns of a mapping differ in length, or the source has another type.
    FileError
        If a file cannot be read, or is the recording of a stream.
    """
    if isinstance(source, str | Path):
        return _open_file(Path(source), scene, stack)
    headings = source if isinstance(source, Mapping) else getattr(source, "columns", None)
    if headings is None:
        reason = "is not a table; give the path of a CSV file, or a dict of columns"
        raise TouchesError(format_error("touches", source, reason))
    columns = {str(heading): list(source[heading]) for heading in headings}
    if len({len(column) for column in columns.values()}) > 1:
        raise TouchesError("touches: columns differ in length; give a value for every touch")
    return make_table("touches", columns)


def _open_file(path: Path, scene: Scene, stack: ExitStack) -> Table:
    """Return the table in a file, see `_open_table`."""
    electrodes = [electrode.name for electrode in scene.electrode_list]
    choice = dict(scene.readout.channels or {}) if scene.readout else {}
    reader = open_reader(path, stack)
    if reader is None:
        content = read_bytes(path, MAX_FILE_SIZE, "a table of touches")
        has_name = make_name_test([*TOUCH_QUANTITIES, *electrodes])
        is_channel = make_channel_test(choice)
        table = parse_csv(content, str(path), lambda each: has_name(each) or is_channel(each))
        return name_channels(table, choice, electrodes)
    needed = [name for name in TOUCH_QUANTITIES if name != "rotation_deg"]
    missing = [name for name in needed if not has_channel(reader, name)]
    if missing:
        raise FileError(
            f"{path}: is a recording in {reader.title}, without {', '.join(missing)} of touches; "
            "give a table with a row for each touch"
        )
    options = RecordingOptions(choice, needs_times=False, quantities=TOUCH_QUANTITIES)
    recording = open_recording(path, stack, electrodes, options)
    assert recording is not None
    return make_recording_table(recording)


def _list_unused_headings(table: Table, columns: Mapping[str, ChosenColumn]) -> list[str]:
    """Return the headings of a table that are not empty, and not those of chosen columns."""
    used = {column.index for column in columns.values()}
    unused = []
    for index, column in enumerate(table.columns):
        if index not in used and column.heading:
            unused.append(column.heading)
    return unused


def _find_missing_column_errors(
    columns: Collection[str], needed: Sequence[str], unused: Sequence[str]
) -> Iterator[str]:
    """Yield a message for each missing column, and for each other column that may be meant for it.

    Parameters
    ----------
    columns : collection of str
        Names of the columns that were found.
    needed : sequence of str
        Names of the columns that are needed.
    unused : sequence of str
        Headings of other columns.
    """
    missing = [name for name in needed if name not in columns]
    for name in missing:
        yield f"column {name}: is missing; add it (required are {', '.join(needed)})"
    if missing:
        for heading in unused:
            advice = f"remove or rename it: {suggest(heading, missing)}"
            yield f"column {heading[:40]}: is not expected; {advice}"


def _read_rows(
    table: Table, columns: Mapping[str, ChosenColumn], names: Sequence[str], notes: list[str]
) -> tuple[Array, list[str]]:
    """Read the numbers in the rows of a table.

    Parameters
    ----------
    table : Table
        The table.
    columns : mapping of str to ChosenColumn
        Columns by name.
    names : sequence of str
        Names of the columns of the result.
    notes : list of str
        Sentences, to which one is appended about the words in place of numbers.

    Returns
    -------
    values : ndarray, shape (rows, names)
        Numbers; NaN for missing columns and empty cells, infinite for words such as OVER.
    errors : list of str
        A message for each row that cannot be read.
    """
    numbers = NumberColumns(table, list(columns.values()))
    positions = [names.index(name) for name in columns]
    values = []
    errors = []
    for batch in table.batches:
        for row in batch:
            value = np.full(len(names), np.nan)
            try:
                value[positions] = numbers.read(row)
            except CellError as error:
                errors.append(str(error))
            values.append(value)
    for (heading, word), count in numbers.words.items():
        if word.lower() != "nan":
            cells = "1 cell has" if count == 1 else f"{count} cells have"
            notes.append(f"column {heading}: {cells} {word}, no number")
    return np.array(values).reshape(len(values), len(names)), errors
