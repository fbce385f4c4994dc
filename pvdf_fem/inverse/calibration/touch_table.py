"""The touches of a calibration: read from a file or from columns, and checked before any solve."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import read_csv_rows, read_text
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, TouchColumn

MAX_FILE_SIZE = 10_000_000  #: Largest file that is read, in bytes.
#: A column of readings whose relative range is below this is constant.
CONSTANT_RANGE = 1e-6
#: Places farther than this from the centre, over the film's radius, look like µm; places that are
#: all nearer than the second value look like m.
FAR_SHARE = 2.0
NEAR_SHARE = 1e-3


class TouchesError(ValueError):
    """Touches that nothing can be calibrated with; each argument is a line about an error."""

    def __str__(self) -> str:
        return "\n".join(self.args)


@dataclass(frozen=True, eq=False)
class TouchTable:
    """Touches with known place, rotation and force, and the readings of the channels."""

    rows: Indices  #: Numbers of the rows in the file, from 1, (touches,).
    #: Probe loads on the stage, (touches, 4): x and y in mm, rotation in degrees, force in N.
    probe_loads: Array
    readings: Array  #: In V or nominal pC, NaN where missing, (touches, electrodes).
    notes: tuple[str, ...] = ()  #: Sentences about rows and readings that were left out.

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def places_mm(self) -> Array:
        """Places of the touches on the stage, (touches, 2)."""
        return self.probe_loads[:, : TouchColumn.ROTATION]

    @property
    def forces_N(self) -> Array:
        """Forces of the touches, (touches,)."""
        return self.probe_loads[:, TouchColumn.FORCE]

    def select(self, indices: Sequence[int]) -> TouchTable:
        """Return some of the touches, by index."""
        return TouchTable(self.rows[indices], self.probe_loads[indices], self.readings[indices])


def read_touches(source: Any, scene: Scene) -> TouchTable:
    """Read the touches of a CSV file, a mapping of columns or a table with `columns`.

    Parameters
    ----------
    source : path, mapping of str to sequence, or table with `columns`
        Columns ``x_mm``, ``y_mm``, ``rotation_deg`` (not for a round probe), ``force_N``, and the
        readings of each electrode by its name.
    scene : Scene
        The sensor with its probe.

    Raises
    ------
    TouchesError
        If columns are missing, unknown or constant, cells are no numbers, or places are off the
        film; with a line for each error.
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
        values[:, index] = _parse_numbers(name, columns[name], errors)
    if errors:
        raise TouchesError(*errors)

    probe_loads = values[:, : len(TOUCH_QUANTITIES)]
    readings = values[:, len(TOUCH_QUANTITIES) :]
    has_load = np.isfinite(probe_loads).all(axis=1)
    has_reading = np.isfinite(readings).any(axis=1)
    is_used = has_load & has_reading
    rows = np.arange(1, len(values) + 1)
    notes = [f"row {row}: has no place, force or reading; left out" for row in rows[~is_used]]
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
    """Return the columns of a file or a table by their names."""
    if isinstance(source, str | Path):
        return _read_csv_columns(Path(source))
    names = source if isinstance(source, Mapping) else getattr(source, "columns", None)
    if names is None:
        reason = "is no table; give the path of a CSV file, or a dict of columns"
        raise TouchesError(format_error("touches", source, reason))
    return {str(name): list(source[name]) for name in names}


def _read_csv_columns(path: Path) -> dict[str, Sequence[Any]]:
    """Return the columns of a CSV file by their names, as texts."""
    text = read_text(path, MAX_FILE_SIZE, "a CSV file of touches")
    lines = []
    try:
        for cells in read_csv_rows(io.StringIO(text), text.partition("\n")[0]):
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                lines.append(stripped)
    except csv.Error as error:
        raise TouchesError(f"{path}: is no CSV file ({error}); save it as one") from None
    heading = lines[0] if lines else []
    rows = lines[1:]
    if len(set(heading)) < len(heading):
        raise TouchesError(f"{path}: two columns have the same name; rename or remove one")
    for number, row in enumerate(rows, 1):
        if len(row) != len(heading):
            reason = f"{len(row)} cells below {len(heading)} names; correct the row"
            raise TouchesError(f"{path}: row {number} has {reason}")
    columns: dict[str, Sequence[Any]] = {}
    for index, name in enumerate(heading):
        columns[name] = [row[index] for row in rows]
    return columns


def _find_heading_errors(columns: Sequence[str], needed: Sequence[str]) -> Iterator[str]:
    """Find columns that are missing or unknown."""
    missing = [name for name in needed if name not in columns]
    candidates = missing if missing else needed
    for name in missing:
        yield f"column {name}: missing; give {', '.join(needed)}"
    for name in columns:
        if name not in needed:
            advice = f"remove or rename it: {suggest(name, candidates)}"
            yield f"column {name[:40]}: is not expected; {advice}"


def _parse_numbers(name: str, cells: Sequence[Any], errors: list[str]) -> list[float]:
    """Return the numbers of a column, NaN for empty cells.

    Parameters
    ----------
    name : str
        Name of the column.
    cells : sequence
        Texts or numbers.
    errors : list of str
        Errors are appended.
    """
    values = []
    for row, cell in enumerate(cells, 1):
        value = np.nan
        try:
            if str(cell).strip():
                value = float(cell)
        except (TypeError, ValueError):
            errors.append(f"row {row}: {name} = {str(cell)[:40]!r} is no number; correct it")
        values.append(value if np.isfinite(value) else np.nan)
    return values


def _find_value_errors(table: TouchTable, electrodes: Sequence[str]) -> Iterator[str]:
    """Find too few touches, and channels that are dead."""
    if len(table) < 2:
        yield f"touches: {len(table)} with numbers; give more of them than unknowns"
        return
    for name, column in zip(electrodes, table.readings.T, strict=True):
        measured = column[np.isfinite(column)]
        if not len(measured):
            yield f"column {name}: is empty; the channel is dead or not connected"
        elif np.ptp(measured) <= CONSTANT_RANGE * np.abs(measured).max():
            value = f"{measured[0]:g} in every row"
            yield f"column {name}: is {value}; the channel is dead or not connected"


def _find_load_errors(table: TouchTable, scene: Scene) -> Iterator[str]:
    """Find forces that are not positive, and places that are constant or off the film."""
    if len(table) < 2:
        return
    places_mm = table.places_mm
    if (np.ptp(places_mm, axis=0) == 0.0).all():
        yield "columns x_mm, y_mm: the same in every row; touch at places all over the film"
    for row in table.rows[table.forces_N <= 0.0]:
        yield f"row {row}: force_N is not positive; a touch presses with more than 0 N"

    radius_mm = scene.film.radius_mm
    distances_mm = np.hypot(places_mm[:, 0], places_mm[:, 1])
    outside = []
    for index, probe_load in enumerate(table.probe_loads):
        if place_probe(scene, probe_load) is None:
            outside.append(index)
    if 2 * len(outside) > len(table) and np.median(distances_mm) > FAR_SHARE * radius_mm:
        distance = f"{np.median(distances_mm):.3g} mm from the centre"
        reason = f"places are {distance} of a film of {radius_mm:g} mm; they look like µm, give mm"
        yield f"columns x_mm, y_mm: {reason}"
    elif not outside and 0.0 < distances_mm.max() < NEAR_SHARE * radius_mm:
        distance = f"within {distances_mm.max():.2g} mm of the centre"
        yield f"columns x_mm, y_mm: all places are {distance}; they look like m, give mm"
    else:
        for index in outside:
            x_mm, y_mm = places_mm[index]
            yield f"row {table.rows[index]}: x_mm, y_mm = {x_mm:g}, {y_mm:g} is over the film's rim"


def place_probe(scene: Scene, probe_load: Array) -> Scene | None:
    """Return the scene with its probe at a place on the film, or None over the film's rim.

    Parameters
    ----------
    scene : Scene
        The sensor with its probe.
    probe_load : array, (4,)
        Place x, y in mm, rotation in degrees and force in N.
    """
    changes = dict(zip(TOUCH_SCENE_KEYS, map(float, probe_load), strict=True))
    try:
        return scene.with_(**changes)
    except SceneError:
        return None
