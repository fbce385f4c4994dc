"""The touches of a calibration: reading them from a file or columns, and validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.calibration.touch_columns import (
    TouchColumns,
    TouchesError,
    read_touch_columns,
)
from pvdf_fem.inverse.clipping import CLIPPED_ADVICE, ReadingLimits
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, TouchColumn

#: A column of readings is constant if its range, relative to its largest value, is not above this.
CONSTANT_RANGE = 1e-6
#: Distances from the centre, in radii of the film, that suggest a wrong unit: positions in µm if
#: the median is above the first, positions in m if the maximum is below the second.
MICROMETRE_RADII = 2.0
METRE_RADII = 1e-3


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
    #: Missing readings that are marked as beyond the range of the instrument: 1 above, -1 below,
    #: 0 for all other readings; shape (touches, electrodes).
    marks: Indices
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

    @property
    def readings_with_marks(self) -> Array:
        """Readings, infinite where they are marked as beyond the range of the instrument.

        Returns
        -------
        ndarray, shape (touches, electrodes)
        """
        return np.where(self.marks == 0, self.readings, np.copysign(np.inf, self.marks))

    def select(self, indices: Sequence[int]) -> TouchTable:
        """Return a table of the touches with the given indices (not rows), without notes."""
        return replace(
            self,
            rows=self.rows[indices],
            probe_loads=self.probe_loads[indices],
            readings=self.readings[indices],
            marks=self.marks[indices],
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
        sides = limits.find_sides(self.readings_with_marks)
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
            marks=np.zeros_like(self.marks[is_used]),
            notes=(*self.notes, *_describe_clipped(clipped, unit)),
            clipped=tuple(clipped),
        )


def _describe_clipped(clipped: Sequence[ClippedReading], unit: str) -> Iterator[str]:
    """Yield a note for each electrode with clipped readings, with their rows and limits."""
    rows: dict[tuple[str, float, int], list[str]] = {}
    for reading in clipped:
        end = (reading.electrode, reading.limit, reading.side)
        rows.setdefault(end, []).append(str(reading.row))
    for (electrode, limit, side), numbers in sorted(rows.items()):
        place = f"row{'' if len(numbers) == 1 else 's'} {', '.join(numbers)}"
        beyond = "or more" if side > 0 else "or less"
        reason = f"{electrode} is clipped ({limit:.6g} {unit} {beyond})"
        yield f"{place}: {reason}, and left out; {CLIPPED_ADVICE}"


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
    columns = read_touch_columns(source, scene, unit)
    electrodes = [electrode.name for electrode in scene.electrode_list]
    touches = _select_complete_touches(columns, electrodes)
    errors = [*_find_value_errors(touches, electrodes), *_find_load_errors(touches, scene)]
    if errors:
        raise TouchesError(*errors)
    return touches


def _select_complete_touches(columns: TouchColumns, electrodes: Sequence[str]) -> TouchTable:
    """Return the touches that have a position, a force and at least one reading.

    Parameters
    ----------
    columns : TouchColumns
        The numbers of all rows. Notes about rows and readings that are left out are added to its
        notes.
    electrodes : sequence of str
        Names of the electrodes.
    """
    probe_loads = columns.values[:, : len(TOUCH_QUANTITIES)]
    given = columns.values[:, len(TOUCH_QUANTITIES) :]
    marks = np.isposinf(given).astype(int) - np.isneginf(given).astype(int)
    readings = np.where(marks == 0, given, np.nan)
    has_load = np.isfinite(probe_loads).all(axis=1)
    has_reading = np.isfinite(readings).any(axis=1)
    is_used = has_load & has_reading
    rows = np.arange(1, len(readings) + 1)
    left_out = [f"row {row}: has no position, force or reading; left out" for row in rows[~is_used]]
    is_missing = np.isnan(given)
    is_missing[~is_used] = False
    for row, column in np.argwhere(is_missing):
        left_out.append(f"row {rows[row]}: has no reading of {electrodes[column]}; left out")
    return TouchTable(
        rows[is_used],
        probe_loads[is_used],
        readings=readings[is_used],
        marks=marks[is_used],
        notes=(*left_out, *columns.notes),
        unit=columns.unit,
    )


def _find_value_errors(table: TouchTable, electrodes: Sequence[str]) -> Iterator[str]:
    """Yield a message for each electrode whose readings are all missing or constant.

    With fewer than two touches, yield only a message that says so.
    """
    if len(table) < 2:
        rows = "1 complete row" if len(table) else "no complete row"
        yield f"touches: {rows}; give more touches than unknown parameters"
        return
    for index, (name, column) in enumerate(zip(electrodes, table.readings.T, strict=True)):
        measured = column[np.isfinite(column)]
        if table.marks[:, index].any() and not len(measured):
            yield f"column {name}: is beyond the range in every row; {CLIPPED_ADVICE}"
        elif not len(measured):
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

    reach_mm = 1e3 * scene.film.reach
    distances_mm = np.hypot(places_mm[:, 0], places_mm[:, 1])
    outside = []
    for index, probe_load in enumerate(table.probe_loads):
        if place_probe(scene, probe_load) is None:
            outside.append(index)
    if 2 * len(outside) > len(table) and np.median(distances_mm) > MICROMETRE_RADII * reach_mm:
        distance = f"{np.median(distances_mm):.3g} mm from the centre"
        film = f"of the film ({scene.film.describe_outline()})"
        yield f"columns x_mm, y_mm: positions {distance} {film} look like µm; give mm"
    elif not outside and 0.0 < distances_mm.max() < METRE_RADII * reach_mm:
        distance = f"within {distances_mm.max():.2g} mm of the centre"
        yield f"columns x_mm, y_mm: positions {distance} look like m; give mm"
    else:
        for index in outside:
            x_mm, y_mm = places_mm[index]
            position = f"x_mm, y_mm = {x_mm:g}, {y_mm:g}"
            reason = "the probe extends over the film's rim"
            yield f"row {table.rows[index]}: {position}: {reason}; correct the position"


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
