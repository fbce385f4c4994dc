"""Readings of electrodes in tables: measured, printed in a publication, or made up.

Each row of a table belongs to a scene. Columns named by keys change the report's scene; columns
named by electrodes hold their readings. An empty cell keeps the scene's value, or has no reading.
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
from pvdf_fem.scene.validation.errors import MAX_ERRORS
from pvdf_fem.solver.adaptive import compute_unloaded_integrals
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS

MAX_BYTES = 5_000_000  #: Size of the largest table.
PREVIEW_ROWS = 8  #: Approximate number of rows in a preview.
ERROR_MM = "error_mm"  #: Column with the errors of places that the data's authors located.
#: Keys of a scene by the short names of a touch's quantities.
SHORT_KEYS = dict(zip(TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, strict=True))


#: Changes of a scene by dotted key.
Changes = Annotated[dict[str, Any], BeforeValidator(flatten)]
Name = Annotated[str, Field(min_length=1, max_length=60)]


class DataSource(Section):
    """A table ``[data.NAME]``: where its rows come from, and what its readings are.

    `file` is the path of a CSV file, relative to the script; or `table` has the text of the CSV
    file. Columns are keys of a scene (``x_mm``, ``force_N``, ``film.thickness_um``, ...),
    electrodes, or labels named in `labels`. The column ``error_mm`` has the error of a place that
    was located elsewhere. `where` keeps the rows with these values in these columns; `set` changes
    the scene of every row. Readings are in `unit`, by default pC. `reading` is ``"total"`` or
    ``"change"``, by default as the scene's `[readout]` reads, or else total. `what` is the word
    for the readings on the page.
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
    """The rows of a table with the readings of electrodes.

    Parameters
    ----------
    name : str
        Name of the table ``[data.NAME]``.
    source : DataSource
        The keys of the table.
    frame : DataFrame
        The rows.
    names : tuple of str
        Electrodes that have readings.
    reading : {"total", "change"}
        Whether readings include the charge of the unloaded film.
    """

    name: str
    source: DataSource
    frame: pd.DataFrame
    names: tuple[str, ...]
    reading: str = "total"

    def make_scenes(self, base: Scene) -> list[Scene]:
        """Return the scene of each row: a base scene changed by `set` and the row's cells.

        Raises
        ------
        SceneError
            With the distinct mistakes of all rows.
        """
        columns = [column for column in self.key_frame if column in SHORT_KEYS or "." in column]
        scenes = []
        problems: dict[str, None] = {}
        for number, row in enumerate(self.frame.to_dict("records"), start=1):
            changes = dict(self.source.set)
            for column in columns:
                if not pd.isna(row[column]):
                    key = expand_key(column)
                    changes |= to_plain_value({key: row[column]})
            try:
                scenes.append(base.with_(**changes))
            except SceneError as error:
                where = f"data.{self.name}, row {number}"
                problems |= dict.fromkeys(f"{where}: {problem}" for problem in error.problems)
        if problems:
            raise SceneError(list(problems)[:MAX_ERRORS])
        return scenes

    def get_charges(self, scenes: Sequence[Scene], names: Sequence[str], reading: str) -> Array:
        """Return the readings as charges.

        Parameters
        ----------
        scenes : sequence of n Scenes
            The scenes of the n rows.
        names : sequence of m str
            Names of the electrodes.
        reading : {"total", "change"}
            Whether the charges include those of the unloaded film.

        Returns
        -------
        array (n, m)
            In pC; NaN where there is no reading.
        """
        charges = self.frame.reindex(columns=list(names)).to_numpy(float, copy=True)
        if self.source.unit == "V":
            for row, scene in zip(charges, scenes, strict=True):
                _convert_volts(row, scene, names)
        if reading == self.reading:
            return charges
        unloaded = _compute_unloaded_charges(scenes, names)
        return charges + unloaded if reading == "total" else charges - unloaded

    @property
    def key_frame(self) -> pd.DataFrame:
        """Labels and keys of the rows, without readings and errors."""
        return self.frame.drop(columns=[*self.names, ERROR_MM], errors="ignore")

    def make_row_names(self) -> list[str]:
        """Return names of the rows: their labels, or without labels their keys."""
        cells = self.frame[list(self.source.labels)] if self.source.labels else self.key_frame
        names = []
        for row in cells.itertuples(index=False):
            texts = [format_cell(cell) for cell in row]
            names.append(", ".join(text for text in texts if text))
        return names

    def thin(self) -> Self:
        """Return about `PREVIEW_ROWS` of the rows, at equal intervals."""
        step = max(1, round(len(self.frame) / PREVIEW_ROWS))
        return replace(self, frame=self.frame.iloc[::step].reset_index(drop=True))


def expand_key(key: str) -> str:
    """Return the full key of a scene for a short name of a touch's quantity, or for a key."""
    return SHORT_KEYS[key] if key in SHORT_KEYS else normalize_key(key)


def format_cell(cell: Any) -> str:
    """Format a cell for a table on the page."""
    return f"{cell:g}" if isinstance(cell, float) else str(cell)


def read_data(name: str, source: DataSource, scene: Scene, folder: Path) -> Readings:
    """Read and check the rows of a table.

    Parameters
    ----------
    name : str
        Name of the table ``[data.NAME]``.
    source : DataSource
        The keys of the table.
    scene : Scene
        The report's scene.
    folder : Path
        Folder of the script.

    Returns
    -------
    Readings

    Raises
    ------
    SceneError
        With all mistakes of the table.
    """
    where = f"data.{name}"
    frame = _select_rows(where, source, _read_frame(where, source, folder))
    # rows may have electrodes of their own
    scenes = Readings(name, source, frame, names=()).make_scenes(scene)
    electrodes: dict[str, None] = {}
    for row_scene in (scene, *scenes):
        electrodes |= dict.fromkeys(electrode.name for electrode in row_scene.electrode_list)
    columns = [*electrodes, *SHORT_KEYS, *source.labels, *source.where, ERROR_MM]
    problems = []
    for column in frame.columns:
        if column in electrodes or column == ERROR_MM:
            problems += _find_bad_numbers(where, frame[column])
            frame = frame.assign(**{column: _parse_numbers(frame[column])})
        elif column not in columns and "." not in column:
            reason = f"is no key of a scene and no electrode; {suggest(column, columns)}"
            reason += ", or name it in `labels`"
            problems.append(format_error(f"{where}.columns", column, reason))
    if source.unit == "V" and any(row_scene.readout is None for row_scene in scenes):
        reason = 'needs amplifiers, and the scene has no [readout]; add one, or give "pC"'
        problems.append(format_error(f"{where}.unit", source.unit, reason))
    if problems:
        raise SceneError(problems[:MAX_ERRORS])
    reading = source.reading
    if reading is None:
        reading = scene.readout.reading if scene.readout else "total"
    names = tuple(electrode for electrode in electrodes if electrode in frame.columns)
    return Readings(name, source, frame.reset_index(drop=True), names=names, reading=reading)


def _parse_numbers(column: pd.Series) -> pd.Series:
    """Return the numbers of a column, NaN for empty and invalid cells."""
    # by way of text, because an integer may be too large for a float
    numbers = pd.to_numeric(column.astype(str), errors="coerce")
    return numbers.astype(float)


def _find_bad_numbers(where: str, column: pd.Series) -> list[str]:
    """Return a problem for each cell of a column that is not empty and no finite number."""
    problems = []
    is_bad = column.notna() & ~np.isfinite(_parse_numbers(column))
    for row in column.index[is_bad]:
        reason = f"is no finite number, in row {row + 1}; correct the cell"
        problems.append(format_error(f"{where}.{column.name}", column[row], reason))
    return problems


def _select_rows(where: str, source: DataSource, frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that `where` keeps, without empty columns.

    Parameters
    ----------
    where : str
        Key of the table in the script, for messages.
    source : DataSource
        The keys of the table.
    frame : DataFrame
        All rows.

    Raises
    ------
    SceneError
        For unknown columns, or where no row is left.
    """
    problems = []
    for key, columns in (("where", source.where), ("labels", source.labels)):
        for column in columns:
            if column not in frame.columns:
                reason = f"is no column; {suggest(column, list(frame.columns))}"
                problems.append(format_error(f"{where}.{key}", column, reason))
    if problems:
        raise SceneError(problems[:MAX_ERRORS])
    frame = frame.assign(**{label: frame[label].fillna("") for label in source.labels})
    for column, values in source.where.items():
        frame = frame[frame[column].isin(values if isinstance(values, list) else [values])]
    if frame.empty:
        raise SceneError([f"{where}: has no row, or `where` keeps none; give others"])
    return frame.dropna(axis="columns", how="all")


def _read_frame(where: str, source: DataSource, folder: Path) -> pd.DataFrame:
    """Read the CSV text of a table.

    Parameters
    ----------
    where : str
        Key of the table in the script, for messages.
    source : DataSource
        The keys of the table.
    folder : Path
        Folder of the script.

    Raises
    ------
    SceneError
        For a file or text that is no table.
    """
    if (source.file is None) == (source.table is None):
        raise SceneError([f"{where}.file: give either `file`, a path, or `table`, the text"])
    try:
        text = source.table or ""
        if source.file is not None:
            text = read_text(folder / source.file, MAX_BYTES, "a table")
        return _parse_csv(text.strip())
    except (FileError, ValueError) as error:
        first_line = str(error).partition("\n")[0]
        reason = f"is no table ({first_line}); give a CSV file with a header"
        problem = format_error(f"{where}.file", source.file or "(table)", reason)
        raise SceneError([problem]) from None


def _parse_csv(text: str) -> pd.DataFrame:
    """Return the rows of a CSV text; ValueError for a column that occurs twice."""
    header = text.partition("\n")[0]
    # spreadsheets in countries with decimal commas separate cells by semicolons
    separator = ";" if ";" in header and "," not in header else ","
    decimal = "," if separator == ";" and "," in text else "."
    columns = [column.strip() for column in header.split(separator)]
    repeated = {column for column in columns if columns.count(column) > 1}
    if repeated:
        raise ValueError(f"the column {min(repeated)!r} is there twice")
    return pd.read_csv(
        io.StringIO(text),
        sep=separator,
        decimal=decimal,
        skipinitialspace=True,
        keep_default_na=False,  # a cell with the text nan is a mistake, not an empty cell
        na_values=[""],
    )


def _convert_volts(readings: Array, scene: Scene, names: Sequence[str]) -> None:
    """Convert readings (names,) of a scene's amplifiers in place, from V to pC."""
    columns = {name: j for j, name in enumerate(names)}
    for channel in make_channels(scene):
        if channel.name in columns:
            j = columns[channel.name]
            volts = (readings[j] - channel.offset) / channel.gain
            readings[j] = 1e12 * channel.capacitance * volts


def _compute_unloaded_charges(scenes: Sequence[Scene], names: Sequence[str]) -> Array:
    """Return the charges (scenes, names) of the unloaded films in pC."""
    charges = np.full((len(scenes), len(names)), np.nan)
    for i, scene in enumerate(scenes):
        integrals = compute_unloaded_integrals(Problem.from_scene(scene), required=False)
        values = integrals.charges((scene.film.d31_pC_N, scene.film.d32_pC_N))
        by_name = {}
        for electrode, value in zip(scene.electrode_list, values.tolist(), strict=True):
            by_name[electrode.name] = value
        for j, name in enumerate(names):
            charges[i, j] = by_name.get(name, np.nan)
    return charges
