"""Measured, printed or made-up charges: tables with a scene's keys as columns.

A row is a scene with the cells' values and electrode readings in columns with the electrodes'
names. Empty cells leave the scene's value, or have no reading.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pandas as pd
from pydantic import BeforeValidator, Field

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.files import FileError, read_text
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.changes import normalize_key, to_plain_value
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, flatten, format_error, suggest
from pvdf_fem.scene.validation_errors import MAX_ERRORS
from pvdf_fem.solver.adaptive import compute_unloaded_integrals
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS

MOST_BYTES = 5_000_000  #: Largest table in bytes.
PREVIEW_ROWS = 8  #: About the number of rows in a preview.
ERROR_MM = "error_mm"  #: Column with errors of places that others found.
#: Short names for a touch's keys.
SHORT = dict(zip(TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, strict=True))


#: Changes of a scene by dotted key.
Changes = Annotated[dict[str, Any], BeforeValidator(flatten)]
Name = Annotated[str, Field(min_length=1, max_length=60)]


class DataSource(Section):
    """Source of the rows in a table ``[data.NAME]``, and the meaning of its readings.

    `file` is the path of a CSV file, seen from the script; or `table` has its text. Columns are
    keys of a scene (``x_mm``, ``force_N``, ``film.thickness_um``, ...), electrodes, or named in
    `labels`. ``error_mm`` is the error of a place found elsewhere. `where` keeps rows with these
    values in columns; `set` has changes of the scene for every row. `unit` and `reading` say what
    the readings are, by default in pC and as the scene's `[readout]` reads them, or in total.
    `what` is how the page calls them.
    """

    file: str | None = None
    table: str | None = None
    unit: Literal["pC", "V"] = "pC"
    reading: Literal["total", "change"] | None = None
    what: Annotated[str, Field(min_length=1, max_length=40)] = "measured"
    labels: tuple[str, ...] = ()
    where: dict[str, Any] = Field(default_factory=dict)
    set: Changes = Field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Readings:
    """The rows of a table."""

    name: str
    source: DataSource
    frame: pd.DataFrame
    names: tuple[str, ...]  #: Electrodes that have readings.
    reading: str = "total"  #: What the readings are, `total` or `change`.

    def scenes(self, base: Scene) -> list[Scene]:
        """The scene of each row; SceneError with the mistakes of the rows."""
        scenes, problems = [], dict[str, None]()
        keys = [c for c in self.shown.columns if c in SHORT or "." in c]
        for number, row in enumerate(self.frame.to_dict("records"), start=1):
            given = {SHORT.get(c, normalize_key(c)): row[c] for c in keys if not pd.isna(row[c])}
            try:
                scenes.append(base.with_(**{**self.source.set, **to_plain_value(given)}))
            except SceneError as error:
                where = f"data.{self.name}, row {number}"
                problems |= dict.fromkeys(f"{where}: {told}" for told in error.problems)
        if problems:
            raise SceneError(list(problems)[:MAX_ERRORS])
        return scenes

    def charges(self, scenes: Sequence[Scene], names: Sequence[str], reading: str) -> Array:
        """Charges (rows, names) in pC, in total or as changes, NaN where there is no reading;
        `scenes` are the scenes of the rows."""
        charges = self.frame.reindex(columns=list(names)).to_numpy(float, copy=True)
        if self.source.unit == "V":  # what the amplifiers do, undone
            for row, scene in zip(charges, scenes, strict=True):
                for c in make_channels(scene):
                    j = list(names).index(c.name) if c.name in names else slice(0)
                    row[j] = 1e12 * c.capacitance * (row[j] - c.offset) / c.gain
        if reading == self.reading:
            return charges
        sign = 1.0 if reading == "total" else -1.0
        return charges + sign * _rests(scenes, names)

    @property
    def shown(self) -> pd.DataFrame:
        """Labels and keys of the rows."""
        return self.frame.drop(columns=[*self.names, ERROR_MM], errors="ignore")

    def row_names(self) -> list[str]:
        """Names of rows: their labels, else their keys."""
        cells = self.frame[list(self.source.labels)] if self.source.labels else self.shown
        texts = (map(format_cell, row) for row in cells.itertuples(index=False))
        return [", ".join(text for text in row if text) for row in texts]

    def thinned(self) -> Self:
        """Rows at equal intervals, about `PREVIEW_ROWS` in total."""
        every = max(1, round(len(self.frame) / PREVIEW_ROWS))
        return replace(self, frame=self.frame.iloc[::every].reset_index(drop=True))


def format_cell(cell: Any) -> str:
    """A cell as a table shows it."""
    return f"{cell:g}" if isinstance(cell, float) else str(cell)


def read_data(name: str, source: DataSource, scene: Scene, folder: Path) -> Readings:
    """The rows of a table; SceneError with all mistakes of the table."""
    where = f"data.{name}"
    frame = _kept(where, source, _frame(where, source, folder))
    # rows may have electrodes of their own
    rows = [scene, *Readings(name, source, frame, ()).scenes(scene)]
    electrodes = list(dict.fromkeys(e.name for row in rows for e in row.electrode_list))
    known, problems = [*electrodes, *SHORT, *source.labels, *source.where, ERROR_MM], []
    for column in frame.columns:
        if column in (*electrodes, ERROR_MM):
            # as text, because an integer may be too large for a float
            numbers = pd.to_numeric(frame[column].astype(str), errors="coerce")
            for row in frame.index[frame[column].notna() & ~np.isfinite(numbers)]:
                reason = f"is no finite number, in row {row + 1}; correct the cell"
                problems.append(format_error(f"{where}.{column}", frame[column][row], reason))
            frame = frame.assign(**{column: numbers.astype(float)})
        elif column not in known and "." not in column:
            reason = f"is no key of a scene and no electrode; {suggest(column, known)}"
            reason += ", or name it in `labels`"
            problems.append(format_error(f"{where}.columns", column, reason))
    if source.unit == "V" and any(row.readout is None for row in rows[1:]):
        reason = 'is of readings, and the scene has no [readout]; add one, or give "pC"'
        problems.append(format_error(f"{where}.unit", source.unit, reason))
    if problems:
        raise SceneError(problems[:MAX_ERRORS])
    reading = source.reading or (scene.readout.reading if scene.readout else "total")
    names = tuple(electrode for electrode in electrodes if electrode in frame.columns)
    return Readings(name, source, frame.reset_index(drop=True), names, reading)


def _kept(where: str, source: DataSource, frame: pd.DataFrame) -> pd.DataFrame:
    """The rows kept by `where`, with their columns."""
    problems = [
        format_error(
            f"{where}.{key}", column, f"is no column; {suggest(column, list(frame.columns))}"
        )
        for key, columns in (("where", source.where), ("labels", source.labels))
        for column in columns
        if column not in frame.columns
    ]
    if problems:
        raise SceneError(problems[:MAX_ERRORS])
    frame = frame.assign(**{label: frame[label].fillna("") for label in source.labels})
    for column, wanted in source.where.items():
        frame = frame[frame[column].isin(wanted if isinstance(wanted, list) else [wanted])]
    if frame.empty:
        raise SceneError([f"{where}: has no row, or `where` keeps none; give others"])
    return frame.dropna(axis="columns", how="all")


def _frame(where: str, source: DataSource, folder: Path) -> pd.DataFrame:
    if (source.file is None) == (source.table is None):
        raise SceneError([f"{where}.file: give either `file`, a path, or `table`, the text"])
    try:
        text = source.table or ""
        if source.file is not None:
            text = read_text(folder / source.file, MOST_BYTES, "a table")
        text = text.strip()
        header = text.partition("\n")[0]
        # from spreadsheets in countries with decimal commas
        mark = ";" if ";" in header and "," not in header else ","
        columns = [column.strip() for column in header.split(mark)]
        if twice := {column for column in columns if columns.count(column) > 1}:
            raise ValueError(f"the column {min(twice)!r} is there twice")
        decimal = "," if mark == ";" and "," in text else "."
        # a cell with nan is a mistake, and not empty
        how: dict[str, Any] = {"sep": mark, "decimal": decimal, "keep_default_na": False}
        return pd.read_csv(io.StringIO(text), skipinitialspace=True, na_values=[""], **how)
    except (FileError, ValueError) as error:
        first = str(error).partition("\n")[0]
        reason = f"is no table ({first}); give a CSV file with a header"
        raise SceneError(
            [format_error(f"{where}.file", source.file or "(table)", reason)]
        ) from None


def _rests(scenes: Sequence[Scene], names: Sequence[str]) -> Array:
    """Charges (scenes, names) of the films without a touch, in pC."""
    values = np.full((len(scenes), len(names)), np.nan)
    for row, scene in zip(values, scenes, strict=True):
        film = scene.film
        charges = compute_unloaded_integrals(Problem.from_scene(scene), required=False).charges(
            (film.d31_pC_N, film.d32_pC_N)
        )
        known = dict(zip((e.name for e in scene.electrode_list), charges.tolist(), strict=True))
        row[:] = [known.get(name, np.nan) for name in names]
    return values
