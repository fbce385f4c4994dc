"""The touches of a calibration: reading them from a file or columns, and validation."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import read_csv_rows, read_text
from pvdf_fem.inverse.clipping import CLIPPED_ADVICE, ReadingLimits
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
    #: Readings in V or nominal pC, NaN where missing, shape (touches, electrodes).
    readings: Array
    notes: tuple[str, ...] = ()  #: Sentences about rows and readings that are left out.
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
        return TouchTable(self.rows[indices], self.probe_loads[indices], self.readings[indices])

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
        return TouchTable(
            self.rows[is_used],
            self.probe_loads[is_used],
            np.where(is_measured, self.readings, np.nan)[is_used],
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


def read_touches(source: Any, scene: Scene) -> TouchTable:
    """Read and validate touches from a CSV file, a mapping of columns or a dataframe.

    Parameters
    ----------
    source : path, mapping of str to sequence, or table with `columns`
        Columns ``x_mm``, ``y_mm``, ``rotation_deg`` (optional for a round probe), ``force_N``, and
        the readings of each electrode under its name.
    scene : Scene
        Scene with the electrodes and a single probe.

    Returns
    -------
    TouchTable
        Touches that have a position, a force and at least one reading; `notes` names the rows and
        readings that are left out.

    Raises
    ------
    TouchesError
        If columns are missing, unknown or differ in length, cells are not numbers, fewer than two
        touches are complete, readings of an electrode are constant or missing in all touches,
        forces are not positive, or positions are all equal or not on the film; with a line for each
        error.
    """
    columns = _read_columns(source)
    electrodes = [electrode.name for electrode in scene.electrode_list]
    assert scene.single_probe is not None
    if not scene.single_probe.period_deg and columns:  # A disc has no rotation.
        first = next(iter(columns.values()))
        columns.setdefault("rotation_deg", ["0"] * len(first))
    names = [*TOUCH_QUANTITIES, *electrodes]
    errors = list(_find_heading_errors(list(columns), names))
    if errors:
        raise TouchesError(*errors)
    if len({len(column) for column in columns.values()}) > 1:
        raise TouchesError("touches: columns differ in length; give a value for every touch")
    values = np.empty((len(columns["x_mm"]), len(names)))
    for index, name in enumerate(names):
        values[:, index], column_errors = _parse_column(name, columns[name])
        errors += column_errors
    if errors:
        raise TouchesError(*errors)

    probe_loads = values[:, : len(TOUCH_QUANTITIES)]
    readings = values[:, len(TOUCH_QUANTITIES) :]
    has_load = np.isfinite(probe_loads).all(axis=1)
    has_reading = np.isfinite(readings).any(axis=1)
    is_used = has_load & has_reading
    rows = np.arange(1, len(values) + 1)
    notes = [f"row {row}: has no position, force or reading; left out" for row in rows[~is_used]]
    is_missing = np.isnan(readings)
    is_missing[~is_used] = False
    for row, column in np.argwhere(is_missing):
        notes.append(f"row {rows[row]}: has no reading of {electrodes[column]}; left out")
    table = TouchTable(rows[is_used], probe_loads[is_used], readings[is_used], tuple(notes))
    errors = [*_find_value_errors(table, electrodes), *_find_load_errors(table, scene)]
    if errors:
        raise TouchesError(*errors)
    return table


def _read_columns(source: Any) -> dict[str, Sequence[Any]]:
    """Return the columns of a CSV file, a mapping or a dataframe by their names.

    A source of another type raises TouchesError.
    """
    if isinstance(source, str | Path):
        return _read_csv_columns(Path(source))
    names = source if isinstance(source, Mapping) else getattr(source, "columns", None)
    if names is None:
        reason = "is not a table; give the path of a CSV file, or a dict of columns"
        raise TouchesError(format_error("touches", source, reason))
    return {str(name): list(source[name]) for name in names}


def _read_csv_columns(path: Path) -> dict[str, Sequence[Any]]:
    """Read the columns of a CSV file by their names, as text without surrounding spaces.

    Empty rows are skipped. TouchesError is raised if the file is not a CSV file, two columns have
    the same name, or a row has another number of cells than the heading.
    """
    text = read_text(path, MAX_FILE_SIZE, "a CSV file of touches")
    lines = []
    try:
        for cells in read_csv_rows(io.StringIO(text), text.partition("\n")[0]):
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                lines.append(stripped)
    except csv.Error as error:
        raise TouchesError(f"{path}: is not a CSV file ({error}); save it as CSV") from None
    heading = lines[0] if lines else []
    rows = lines[1:]
    if len(set(heading)) < len(heading):
        raise TouchesError(f"{path}: two columns have the same name; rename or remove one")
    for number, row in enumerate(rows, 1):
        if len(row) != len(heading):
            reason = f"{len(row)} cells, but the heading has {len(heading)}; correct the row"
            raise TouchesError(f"{path}: row {number} has {reason}")
    columns: dict[str, Sequence[Any]] = {}
    for index, name in enumerate(heading):
        columns[name] = [row[index] for row in rows]
    return columns


def _find_heading_errors(columns: Sequence[str], needed: Sequence[str]) -> Iterator[str]:
    """Yield a message for each column that is missing or not expected."""
    missing = [name for name in needed if name not in columns]
    candidates = missing if missing else needed
    for name in missing:
        yield f"column {name}: missing; give {', '.join(needed)}"
    for name in columns:
        if name not in needed:
            advice = f"remove or rename it: {suggest(name, candidates)}"
            yield f"column {name[:40]}: is not expected; {advice}"


def _parse_column(name: str, cells: Sequence[Any]) -> tuple[list[float], list[str]]:
    """Convert the cells of a column to numbers.

    Parameters
    ----------
    name : str
        Name of the column, for the messages.
    cells : sequence
        Texts or numbers.

    Returns
    -------
    values : list of float
        Numbers; NaN for cells that are empty, infinite or not numbers.
    errors : list of str
        Line for each cell that is neither empty nor a number.
    """
    values = []
    errors = []
    for row, cell in enumerate(cells, 1):
        value = np.nan
        try:
            if str(cell).strip():
                value = float(cell)
        except (TypeError, ValueError):
            errors.append(f"row {row}: {name} = {str(cell)[:40]!r} is not a number; correct it")
        values.append(value if np.isfinite(value) else np.nan)
    return values, errors


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
