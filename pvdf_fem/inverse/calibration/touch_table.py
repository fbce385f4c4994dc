"""Touches of a calibration: read from a file or from columns, and checked before any solve."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import read_csv_rows, read_text
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.solver.sensitivity.parameters import PLACE

TOUCH_KEYS = (*PLACE, "load.force_N")
PLACE_COLUMNS = ("x_mm", "y_mm", "rotation_deg", "force_N")


class TouchesError(ValueError):
    """Touches that nothing can be calibrated with; each argument is a line about a mistake."""

    def __str__(self) -> str:
        return "\n".join(self.args)


@dataclass(frozen=True, eq=False)
class TouchTable:
    """Touches on the stage with what the channels read."""

    rows: Indices  #: Numbers of the rows, the first of a file's data being 1.
    touches: Array  #: x, y in mm, rotation in degrees and force in N, (touches, 4).
    readings: Array  #: In V or nominal pC, NaN where missing, (touches, electrodes).
    remarks: tuple[str, ...] = ()  #: What was left out, in sentences.

    def __len__(self) -> int:
        return len(self.rows)

    def some(self, which: Sequence[int]) -> TouchTable:
        """Some of them, by index."""
        return TouchTable(self.rows[which], self.touches[which], self.readings[which])


def read_touches(source: Any, scene: Scene) -> TouchTable:
    """Touches of a CSV file, a mapping of columns or a table with `columns`. Raises `TouchesError`
    for columns that are missing, unknown, constant or no numbers, and for places off the film."""
    columns = _columns(source)
    names = [electrode.name for electrode in scene.electrode_list]
    assert scene.single_probe is not None
    if not scene.single_probe.period_deg and columns:  # a disc has no rotation
        columns.setdefault("rotation_deg", ["0"] * len(next(iter(columns.values()))))
    mistakes = list(_heading_mistakes(list(columns), [*PLACE_COLUMNS, *names]))
    if mistakes:
        raise TouchesError(*mistakes)
    if len({len(column) for column in columns.values()}) > 1:
        raise TouchesError("touches: columns differ in length; give a value for every touch")
    table = [list(_numbers(n, columns[n], mistakes)) for n in [*PLACE_COLUMNS, *names]]
    if mistakes:
        raise TouchesError(*mistakes)
    values = np.array(table).T
    whole = np.isfinite(values[:, :4]).all(axis=1) & np.isfinite(values[:, 4:]).any(axis=1)
    touches = TouchTable(np.arange(1, len(values) + 1)[whole], values[whole, :4], values[whole, 4:])
    if mistakes := list(_mistakes(touches, names, scene)):
        raise TouchesError(*mistakes)
    left_out = [(row, "place, force or reading") for row in np.flatnonzero(~whole) + 1]
    empty = np.argwhere(np.isnan(touches.readings))
    left_out += [(touches.rows[i], f"reading of {names[j]}") for i, j in empty]
    remarks = tuple(f"row {row}: has no {what}; left out" for row, what in left_out)
    return replace(touches, remarks=remarks)


def _columns(source: Any) -> dict[str, Sequence[Any]]:
    if not isinstance(source, str | Path):
        names = source if isinstance(source, Mapping) else getattr(source, "columns", None)
        if names is None:
            reason = "is no table; give the path of a CSV file, or a dict of columns"
            raise TouchesError(format_error("touches", source, reason))
        return {str(name): list(source[name]) for name in names}
    text = read_text(Path(source), 10_000_000, "a CSV file of touches")
    try:
        cells = read_csv_rows(io.StringIO(text), text.partition("\n")[0])
        rows = [row for row in cells if any(map(str.strip, row))]
    except csv.Error as error:
        raise TouchesError(f"{source}: is no CSV file ({error}); save it as one") from None
    heading, *lines = [[cell.strip() for cell in row] for row in rows] or [[]]
    if len(set(heading)) < len(heading):
        raise TouchesError(f"{source}: two columns have one name; rename or remove one")
    for number, line in enumerate(lines, 1):
        if len(line) != len(heading):
            reason = f"{len(line)} cells below {len(heading)} names; correct the row"
            raise TouchesError(f"{source}: row {number} has {reason}")
    return {name: [line[i] for line in lines] for i, name in enumerate(heading)}


def _heading_mistakes(given: Sequence[str], wanted: Sequence[str]) -> Iterator[str]:
    missing = [name for name in wanted if name not in given]
    yield from (f"column {name}: missing; give {', '.join(wanted)}" for name in missing)
    for name in (name for name in given if name not in wanted):
        yield f"column {name[:40]}: unknown; remove it, or {suggest(name, missing or wanted)}"


def _numbers(name: str, cells: Sequence[Any], mistakes: list[str]) -> Iterator[float]:
    for row, cell in enumerate(cells, 1):
        try:
            value = float(cell) if str(cell).strip() else np.nan
        except (TypeError, ValueError):
            value = np.nan
            mistakes.append(f"row {row}: {name} = {str(cell)[:40]!r} is no number; correct it")
        yield value if np.isfinite(value) else np.nan


def _mistakes(touches: TouchTable, names: Sequence[str], scene: Scene) -> Iterator[str]:
    if len(touches) < 2:
        yield f"touches: {len(touches)} with numbers; give more of them than unknowns"
        return
    for name, column in zip(names, touches.readings.T, strict=True):
        known = column[np.isfinite(column)]
        if not len(known) or np.ptp(known) <= 1e-6 * np.abs(known).max():
            what = f"{known[0]:g} in every row" if len(known) else "empty"
            yield f"column {name}: is {what}; the channel is dead or not connected"
    x_y, force = touches.touches[:, :2], touches.touches[:, 3]
    if (np.ptp(x_y, axis=0) == 0.0).all():
        yield "columns x_mm, y_mm: the same in every row; touch at places all over the film"
    for row in touches.rows[force <= 0.0]:
        yield f"row {row}: force_N is not positive; a touch presses with more than 0 N"
    radius, reach = scene.film.radius_mm, np.hypot(*x_y.T)
    outside = [i for i, touch in enumerate(touches.touches) if place_probe(scene, touch) is None]
    if 2 * len(outside) > len(touches) and np.median(reach) > 2.0 * radius:
        far = f"{np.median(reach):.3g} mm from the centre of a film of {radius:g} mm"
        yield f"columns x_mm, y_mm: places are {far}; they look like µm, give mm"
    elif not outside and 0.0 < reach.max() < 1e-3 * radius:
        near = f"within {reach.max():.2g} mm of the centre"
        yield f"columns x_mm, y_mm: all places are {near}; they look like m, give mm"
    else:
        for i in outside:
            x, y = x_y[i]
            yield f"row {touches.rows[i]}: x_mm, y_mm = {x:g}, {y:g} is over the film's rim"


def place_probe(scene: Scene, touch: Array) -> Scene | None:
    """The scene with its probe at a touch x, y, rotation, force on the film; None over the rim."""
    changes = dict(zip(TOUCH_KEYS, map(float, touch), strict=True))
    try:
        return scene.with_(**changes)
    except SceneError:
        return None
