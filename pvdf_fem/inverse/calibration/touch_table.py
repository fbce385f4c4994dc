"""The touches of a calibration: reading them from a file or columns, and validation."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import read_bytes
from pvdf_fem.inverse.clipping import CLIPPED_ADVICE, ReadingLimits
from pvdf_fem.readings.formats import parse_csv
from pvdf_fem.readings.selection import (
    ChosenColumn,
    NumberColumns,
    choose_quantity,
    choose_readings,
)
from pvdf_fem.readings.table import Table, make_table
from pvdf_fem.readings.text.header import make_name_test
from pvdf_fem.readings.text.numbers import CellError
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, TouchColumn

MAX_FILE_SIZE = 10_000_000  #: Maximum size of a file in bytes.
#: A column of readings is constant if its range, relative to its largest value, is not above this.
CONSTANT_RANGE = 1e-6
#: Distances from the centre, in radii of the film, that suggest a wrong unit: positions in µm if
#: the median is above the first, positions in m if the maximum is below the second.
MICROMETRE_RADII = 2.0
METRE_RADII = 1e-3


class TouchesError(ValueError):
    """Error in the touches of a calibration; each argument is the line of one error."""

    def __str__(self) -> str:
        return "\n".join(self.args)


class ClippedReading(NamedTuple):
    """A reading at the end of the range of its channel, which is a limit of the true reading."""

    row: int  #: Row number in the file below its heading, starting at 1.
    electrode: str
    limit: float  #: End of the range, in the unit of the readings.
    side: int  #: 1 if the true reading is above the limit, -1 if it is below.


@dataclass(frozen=True, eq=False)
class TouchTable:
    """Touches at known positions, rotations and forces, with the readings of the channels."""

    #: Row numbers in the file below its heading, starting at 1, shape (touches,).
    rows: Indices
    #: Probe loads on the stage: x and y in mm, rotation in degrees, force in N; shape (touches, 4).
    probe_loads: Array
    #: Readings in their unit, NaN where missing, shape (touches, electrodes).
    readings: Array
    #: Sentences about rows, readings and columns that are left out.
    notes: tuple[str, ...] = ()
    #: Unit of the readings, ``pC`` or ``V``, if the file or the user says it.
    unit: str | None = None
    #: Readings that are missing in `readings`, since they are clipped.
    clipped: tuple[ClippedReading, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def places_mm(self) -> Array:
        """Positions x, y of the touches on the stage.

        Returns
        -------
        ndarray, shape (touches, 2)
        """
        return self.probe_loads[:, : TouchColumn.ROTATION]

    @property
    def forces_N(self) -> Array:
        """Forces of the touches.

        Returns
        -------
        ndarray, shape (touches,)
        """
        return self.probe_loads[:, TouchColumn.FORCE]

    def select(self, indices: Sequence[int]) -> TouchTable:
        """Return a table of the touches with the given indices (not rows), without notes."""
        return replace(
            self,
            rows=self.rows[indices],
            probe_loads=self.probe_loads[indices],
            readings=self.readings[indices],
            notes=(),
        )

    def leave_out_clipped(
        self, limits: ReadingLimits, electrodes: Sequence[str], unit: str
    ) -> TouchTable:
        """Return a table without clipped readings, and without touches that have no others.

        Parameters
        ----------
        limits : ReadingLimits
            Readings in `unit` at which the channels clip.
        electrodes : sequence of str
            Names of the electrodes in the order of the readings.
        unit : str
            Unit of the readings, for the notes.

        Raises
        ------
        TouchesError
            If all readings of an electrode are clipped, or less than two touches remain.
        """
        sides = limits.find_sides(self.readings)
        if not sides.any():
            return self
        is_measured = np.isfinite(self.readings) & (sides == 0)
        errors = []
        for name, column in zip(electrodes, is_measured.T, strict=True):
            if not column.any():
                errors.append(f"column {name}: is clipped in every row; {CLIPPED_ADVICE}")
        is_used = is_measured.any(axis=1)
        if is_used.sum() < 2:
            errors.append(f"touches: almost all readings are clipped; {CLIPPED_ADVICE}")
        if errors:
            raise TouchesError(*errors)
        clipped = []
        limited = limits.replace_clipped(self.readings, sides)
        for index, column in np.argwhere(sides).tolist():
            reading = ClippedReading(
                row=int(self.rows[index]),
                electrode=electrodes[column],
                limit=float(limited[index, column]),
                side=int(sides[index, column]),
            )
            clipped.append(reading)
        readings = np.where(is_measured, self.readings, np.nan)
        return replace(
            self,
            rows=self.rows[is_used],
            probe_loads=self.probe_loads[is_used],
            readings=readings[is_used],
            notes=(*self.notes, *_describe_clipped(clipped, unit)),
            clipped=tuple(clipped),
        )


def _describe_clipped(clipped: Sequence[ClippedReading], unit: str) -> Iterator[str]:
    """Yield a note for each electrode with clipped readings, with their rows and limits."""
    rows: dict[tuple[str, float], list[str]] = {}
    for reading in clipped:
        rows.setdefault((reading.electrode, reading.limit), []).append(str(reading.row))
    for (electrode, limit), numbers in sorted(rows.items()):
        place = f"row{'' if len(numbers) == 1 else 's'} {', '.join(numbers)}"
        reason = f"{electrode} is clipped at {limit:.6g} {unit}"
        yield f"{place}: {reason}; the reading is left out; {CLIPPED_ADVICE}"


def read_touches(source: Any, scene: Scene, unit: str | None = None) -> TouchTable:
    """Read and validate touches from a file, a mapping of columns or a dataframe.

    Parameters
    ----------
    source : path, mapping of str to sequence, or table with `columns`
        Columns ``x_mm``, ``y_mm``, ``rotation_deg`` (optional for a round probe), ``force_N``, and
        the readings of each electrode under its name. Headings may have other units, such as
        ``x (m)`` or ``A (mV)``. Other columns are not used.
    scene : Scene
        Scene with the electrodes and a single probe.
    unit : str, optional
        Unit of the readings, which those in the headings must not contradict.

    Returns
    -------
    TouchTable
        Touches that have a position, a force and at least one reading; `notes` names the rows,
        readings and columns that are left out.

    Raises
    ------
    FileError
        If the file cannot be read, columns occur twice, or units do not fit.
    TouchesError
        If columns are missing or differ in length, cells are not numbers or ambiguous, fewer than
        two touches are complete, readings of an electrode are constant or missing in all touches,
        forces are not positive, or positions are all equal or not on the film; with a line for each
        error.
    """
    electrodes = [electrode.name for electrode in scene.electrode_list]
    assert scene.single_probe is not None
    needs_rotation = bool(scene.single_probe.period_deg)  # A disc has no rotation.
    needed = [name for name in TOUCH_QUANTITIES if needs_rotation or name != "rotation_deg"]
    table = _open_table(source, [*TOUCH_QUANTITIES, *electrodes])
    columns: dict[str, ChosenColumn] = {}
    for name in TOUCH_QUANTITIES:
        column = choose_quantity(table, name)
        if column is not None:
            columns[name] = column
    reading_columns, unit = choose_readings(table, electrodes, unit)
    columns |= reading_columns
    unused = _list_unused_headings(table, columns)
    errors = list(_find_missing_column_errors(columns, [*needed, *electrodes], unused))
    if errors:
        raise TouchesError(*errors)
    notes = [f"column {heading}: is not used" for heading in unused]
    values, errors = _read_rows(table, columns, [*TOUCH_QUANTITIES, *electrodes], notes)
    if errors:
        raise TouchesError(*errors)
    if "rotation_deg" not in columns:
        values[:, TouchColumn.ROTATION] = 0.0
    touches = _select_complete_touches(values, electrodes, notes, unit)
    errors = [*_find_value_errors(touches, electrodes), *_find_load_errors(touches, scene)]
    if errors:
        raise TouchesError(*errors)
    return touches


def _open_table(source: Any, names: Sequence[str]) -> Table:
    """Return the table of a file, a mapping or a dataframe.

    Parameters
    ----------
    source : path, mapping of str to sequence, or table with `columns`
        The touches.
    names : sequence of str
        Names by which the header of a file is found.

    Raises
    ------
    TouchesError
        If columns of a mapping differ in length, or the source has another type.
    """
    if isinstance(source, str | Path):
        content = read_bytes(Path(source), MAX_FILE_SIZE, "a table of touches")
        return parse_csv(content, str(source), make_name_test(names))
    headings = source if isinstance(source, Mapping) else getattr(source, "columns", None)
    if headings is None:
        reason = "is not a table; give the path of a CSV file, or a dict of columns"
        raise TouchesError(format_error("touches", source, reason))
    columns = {str(heading): list(source[heading]) for heading in headings}
    if len({len(column) for column in columns.values()}) > 1:
        raise TouchesError("touches: columns differ in length; give a value for every touch")
    return make_table("touches", columns)


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
    """Yield a message for each column that is missing, and for each that may have its place.

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
        yield f"column {name}: missing; give {', '.join(needed)}"
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
        Numbers; NaN for missing columns, and for cells that are empty or have a word such as OVER.
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
            notes.append(f"column {heading}: {count} cells have {word}, no number")
    array = np.array(values).reshape(len(values), len(names))
    array[np.isinf(array)] = np.nan
    return array, errors


def _select_complete_touches(
    values: Array, electrodes: Sequence[str], notes: Sequence[str], unit: str | None
) -> TouchTable:
    """Return the touches that have a position, a force and at least one reading.

    Parameters
    ----------
    values : ndarray, shape (rows, 4 + electrodes)
        Probe loads and readings; NaN where missing.
    electrodes : sequence of str
        Names of the electrodes.
    notes : sequence of str
        Notes of the table; those about rows and readings that are left out are added.
    unit : str or None
        Unit of the readings, if it is known.
    """
    probe_loads = values[:, : len(TOUCH_QUANTITIES)]
    readings = values[:, len(TOUCH_QUANTITIES) :]
    has_load = np.isfinite(probe_loads).all(axis=1)
    has_reading = np.isfinite(readings).any(axis=1)
    is_used = has_load & has_reading
    rows = np.arange(1, len(values) + 1)
    left_out = [f"row {row}: has no position, force or reading; left out" for row in rows[~is_used]]
    is_missing = np.isnan(readings)
    is_missing[~is_used] = False
    for row, column in np.argwhere(is_missing):
        left_out.append(f"row {rows[row]}: has no reading of {electrodes[column]}; left out")
    all_notes = (*left_out, *notes)
    return TouchTable(rows[is_used], probe_loads[is_used], readings[is_used], all_notes, unit)


def _find_value_errors(table: TouchTable, electrodes: Sequence[str]) -> Iterator[str]:
    """Yield a message for each electrode whose readings are all missing or constant.

    With fewer than two touches, yield only a message that says so.
    """
    if len(table) < 2:
        yield f"touches: {len(table)} complete rows; give more touches than unknown parameters"
        return
    for name, column in zip(electrodes, table.readings.T, strict=True):
        measured = column[np.isfinite(column)]
        if not len(measured):
            yield f"column {name}: is empty; the channel is dead or not connected"
        elif np.ptp(measured) <= CONSTANT_RANGE * np.abs(measured).max():
            value = f"is {measured[0]:g} in every row"
            others = np.nan_to_num(table.readings[:, [other != name for other in electrodes]])
            extremes = [*others.max(axis=0, initial=0.0), *others.min(axis=0, initial=0.0)]
            if measured[0] and measured[0] in extremes:
                reason = "which is also the extreme of another channel, and clipped there"
                yield f"column {name}: {value}, {reason}; {CLIPPED_ADVICE}"
            else:
                yield f"column {name}: {value}; the channel is dead or not connected"


def _find_load_errors(table: TouchTable, scene: Scene) -> Iterator[str]:
    """Yield messages on forces that are not positive, and on positions that must be wrong.

    Positions are wrong if they are equal in every row, if they look like µm or m, or if the probe
    extends over the rim of the film. Fewer than two touches are not checked.

    Parameters
    ----------
    table : TouchTable
        Touches to check.
    scene : Scene
        Scene with the film and the probe.
    """
    if len(table) < 2:
        return
    places_mm = table.places_mm
    if (np.ptp(places_mm, axis=0) == 0.0).all():
        yield "columns x_mm, y_mm: the same in every row; touch the film at different positions"
    for row in table.rows[table.forces_N <= 0.0]:
        yield f"row {row}: force_N is not positive; give a force above 0 N"

    radius_mm = scene.film.radius_mm
    distances_mm = np.hypot(places_mm[:, 0], places_mm[:, 1])
    outside = []
    for index, probe_load in enumerate(table.probe_loads):
        if place_probe(scene, probe_load) is None:
            outside.append(index)
    if 2 * len(outside) > len(table) and np.median(distances_mm) > MICROMETRE_RADII * radius_mm:
        distance = f"{np.median(distances_mm):.3g} mm from the centre"
        film = f"of a film with the radius {radius_mm:g} mm"
        yield f"columns x_mm, y_mm: positions {distance} {film} look like µm, give mm"
    elif not outside and 0.0 < distances_mm.max() < METRE_RADII * radius_mm:
        distance = f"within {distances_mm.max():.2g} mm of the centre"
        yield f"columns x_mm, y_mm: positions {distance} look like m, give mm"
    else:
        for index in outside:
            x_mm, y_mm = places_mm[index]
            position = f"x_mm, y_mm = {x_mm:g}, {y_mm:g}"
            yield f"row {table.rows[index]}: {position}: the probe extends over the film's rim"


def place_probe(scene: Scene, probe_load: Array) -> Scene | None:
    """Return a copy of the scene with another probe load, or None if the copy is not valid.

    It is not valid if, for example, the probe extends over the film's rim.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    probe_load : ndarray, shape (4,)
        Position x, y on the film in mm, rotation in degrees and force in N.
    """
    changes = dict(zip(TOUCH_SCENE_KEYS, map(float, probe_load), strict=True))
    try:
        return scene.with_(**changes)
    except SceneError:
        return None
