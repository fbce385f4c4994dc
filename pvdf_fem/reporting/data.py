"""Charges that somebody measured, printed or made up: tables whose columns are keys of a scene.

A row is a scene with the values of its cells, and readings of electrodes: a column for each, named
as the electrode, or the columns ``electrode`` and ``charge_pC`` with one reading in each row.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pandas as pd
from pydantic import BeforeValidator, Field

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError, read_text
from pvdf_fem.readout.channel import channels
from pvdf_fem.reporting.solved import rests
from pvdf_fem.response.model import QUANTITIES, SCENE_KEYS
from pvdf_fem.scene.change import plain, spelled
from pvdf_fem.scene.mistakes import MOST_MISTAKES
from pvdf_fem.scene.quantity import Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, choose, problem

MOST_BYTES = 5_000_000  #: Largest table in bytes.
PREVIEW_ROWS = 8  #: About the number of rows in a preview.
LONG = ("electrode", "charge_pC")  #: Columns of a table with one reading in a row.
ERROR_MM = "error_mm"  #: Column with errors of places that others found.
#: Short names of the keys of a touch.
SHORT = dict(zip(QUANTITIES, SCENE_KEYS, strict=True))


def flattened(table: Any, prefix: str = "") -> Any:
    """Values by dotted key of nested tables, as TOML makes them of keys without quotes."""
    if not isinstance(table, Mapping):
        return table
    flat: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, Mapping) and not {"start", "stop"} & value.keys()
        flat |= flattened(value, f"{prefix}{key}.") if nested else {f"{prefix}{key}": value}
    return flat


#: Changes of a scene by dotted key.
Changes = Annotated[dict[str, Any], BeforeValidator(flattened)]
Name = Annotated[str, Field(min_length=1, max_length=60)]


class DataSource(Section):
    """Where the rows of a table ``[data.NAME]`` come from, and what its readings are.

    `file` is the path of a CSV file, seen from the script; or `table` has its text. Columns are keys
    of a scene (``x_mm``, ``force_N``, ``film.thickness_um``, ...), electrodes, or named in `labels`.
    ``error_mm`` is the error of a place that others found. `where` keeps the rows with these values
    of some columns, and `set` has changes of the scene for all rows. `unit` and `reading` say what
    the readings are, `what` how the page calls them.
    """

    file: str | None = None
    table: str | None = None
    unit: Literal["pC", "V"] = "pC"
    reading: Literal["total", "change"] = "total"
    what: Annotated[str, Field(min_length=1, max_length=40)] = "measured"
    labels: tuple[str, ...] = ()
    where: dict[str, Any] = {}
    set: Changes = {}


@dataclass(frozen=True, eq=False)
class Readings:
    """The rows of a table."""

    name: str
    source: DataSource
    frame: pd.DataFrame
    names: tuple[str, ...]  #: Electrodes that have readings.
    values: Array  #: Readings (rows, names) in the table's unit; NaN where there is none.

    def scenes(self, base: Scene) -> list[Scene]:
        """The scene of each row; SceneError with the mistakes of the first rows that have any."""
        scenes, problems = [], dict[str, None]()
        columns = {self._key(c): c for c in self.frame.columns if self._key(c)}
        for number, row in enumerate(self.frame.to_dict("records"), start=1):
            given = {key: row[c] for key, c in columns.items() if not _is_empty(row[c])}
            try:
                scenes.append(base.with_(**{**self.source.set, **plain(given)}))
            except SceneError as error:
                where = f"data.{self.name}, row {number}"
                problems |= dict.fromkeys(f"{where}: {told}" for told in error.problems)
            if len(problems) > MOST_MISTAKES:
                break
        if problems:
            raise SceneError(list(problems)[:MOST_MISTAKES])
        return scenes

    def _key(self, column: str) -> str:
        """The key of a scene that a column has; empty for readings and labels."""
        if column in SHORT:
            return SHORT[column]
        other = {*self.names, *self.source.labels, *LONG, ERROR_MM}
        return "" if column in other or "." not in column else spelled(column)

    def charges(self, scenes: Sequence[Scene], names: Sequence[str], reading: str) -> Array:
        """Charges (rows, names) in pC, in total or as changes; `scenes` are those of the rows."""
        charges = np.full((len(scenes), len(names)), np.nan)
        known = [name for name in names if name in self.names]
        charges[:, [names.index(n) for n in known]] = self._charges(scenes)[
            :, [self.names.index(n) for n in known]
        ]
        sign = {"total": 1.0, "change": -1.0}[reading] * (reading != self.source.reading)
        return charges + sign * rests(scenes, names) if sign else charges

    def _charges(self, scenes: Sequence[Scene]) -> Array:
        """What the amplifiers read, undone: charges (rows, names) in pC."""
        if self.source.unit == "pC":
            return self.values
        charges = np.full(self.values.shape, np.nan)
        for row, scene in enumerate(scenes):
            by_name = {channel.name: channel for channel in channels(scene)}
            for column, name in enumerate(self.names):
                if (c := by_name.get(name)) is not None:
                    voltage = (self.values[row, column] - c.offset) / c.gain
                    charges[row, column] = 1e12 * c.capacitance * voltage
        return charges

    @cached_property
    def errors_mm(self) -> Array:
        """Errors (rows,) of places that others found; NaN where there is none."""
        if ERROR_MM not in self.frame:
            return np.full(len(self.frame), np.nan)
        return pd.to_numeric(self.frame[ERROR_MM], errors="coerce").to_numpy(float)

    @property
    def shown(self) -> pd.DataFrame:
        """Labels and keys of the rows."""
        return self.frame.drop(columns=[*self.names, *LONG, ERROR_MM], errors="ignore")

    def thinned(self) -> Self:
        """Every so many rows, about `PREVIEW_ROWS` of them."""
        return self.taken(range(0, len(self.frame), max(1, round(len(self.frame) / PREVIEW_ROWS))))

    def taken(self, rows: Sequence[int]) -> Self:
        """The readings of some rows."""
        frame = self.frame.iloc[list(rows)].reset_index(drop=True)
        return replace(self, frame=frame, values=self.values[list(rows)])


def read_data(name: str, source: DataSource, scene: Scene, folder: Path) -> Readings:
    """The rows of a table; SceneError with all mistakes of the table."""
    where = f"data.{name}"
    frame = _frame(where, source, folder)
    problems = list(_kept_mistakes(where, source, frame))
    for column, wanted in source.where.items() if not problems else ():
        frame = frame[frame[column].isin(wanted if isinstance(wanted, list) else [wanted])]
    if not problems and frame.empty:
        problems.append(f"{where}: has no row, or `where` keeps none; give others")
    known = [electrode.name for electrode in scene.electrode_list]
    problems += _column_mistakes(where, source, list(frame.columns), known)
    for other in sorted({*map(str, frame.get(LONG[0], ()))} - {*known}):
        problems.append(problem(f"{where}.{LONG[0]}", other, f"is none; {choose(other, known)}"))
    if problems:
        raise SceneError(problems)
    names = tuple(n for n in known if n in frame.columns or n in set(frame.get(LONG[0], ())))
    values = np.full((len(frame), len(names)), np.nan)
    for column, electrode in enumerate(names):
        given = frame.get(electrode)
        if given is None:
            given = frame[LONG[1]].where(frame[LONG[0]] == electrode)
        numbers = pd.to_numeric(given, errors="coerce")
        for row in given.index[given.notna() & ~np.isfinite(numbers)]:
            reason = f"is no finite number, in row {row + 1}; correct the cell"
            problems.append(problem(f"{where}.{electrode}", given[row], reason))
        values[:, column] = numbers
    if problems:
        raise SceneError(problems[:MOST_MISTAKES])
    return Readings(name, source, frame.reset_index(drop=True), names, values)


def _frame(where: str, source: DataSource, folder: Path) -> pd.DataFrame:
    if (source.file is None) == (source.table is None):
        raise SceneError([f"{where}.file: give either `file`, a path, or `table`, the text"])
    try:
        text = source.table or ""
        if source.file is not None:
            text = read_text(folder / source.file, MOST_BYTES, "a table")
        header = text.lstrip().partition("\n")[0]
        semicolons = ";" in header and "," not in header
        how: dict[str, Any] = {"sep": ";", "decimal": ","} if semicolons else {}
        frame = pd.read_csv(io.StringIO(text.strip()), skipinitialspace=True, **how)
    except (FileError, ValueError) as error:
        first = str(error).partition("\n")[0]
        reason = f"is no table ({first}); give a CSV file with a header"
        raise SceneError([problem(f"{where}.file", source.file or "(table)", reason)]) from None
    frame.columns = [str(column).strip() for column in frame.columns]
    return frame


def _kept_mistakes(where: str, source: DataSource, frame: pd.DataFrame) -> Iterator[str]:
    columns = list(frame.columns)
    for key, names in (("where", list(source.where)), ("labels", list(source.labels))):
        for name in names:
            if name not in columns:
                reason = f"is no column; {choose(name, columns)}"
                yield problem(f"{where}.{key}", name, reason)


def _column_mistakes(
    where: str, source: DataSource, columns: Sequence[str], electrodes: Sequence[str]
) -> Iterator[str]:
    known = {*electrodes, *source.labels, *source.where, *SHORT, ERROR_MM}
    if LONG[0] in columns:
        known |= set(LONG)
        if LONG[1] not in columns:
            yield f"{where}.{LONG[1]}: is missing beside the column `electrode`; add it"
    for column in columns:
        if column not in known and "." not in column:
            reason = f"is no key of a scene and no electrode; {choose(column, sorted(known))}"
            yield problem(f"{where}.columns", column, f"{reason}, or name it in `labels`")


def _is_empty(cell: Any) -> bool:
    return cell is None or (isinstance(cell, float) and np.isnan(cell))
