"""Tables of electrode readings from measurements, publications or other computations.

Each row of a table describes a scene. Columns named after scene keys change the report's scene;
columns named after electrodes hold their readings. An empty cell keeps the scene's value, or means
that there is no reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pandas as pd
from pydantic import BeforeValidator, Field

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.files import FileError
from pvdf_fem.problem.problem import Problem
from pvdf_fem.report.data_table import DataTableError, read_data_table
from pvdf_fem.scene.changes import normalize_key, to_plain_value
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, flatten, format_error, suggest
from pvdf_fem.scene.validation.errors import MAX_ERRORS
from pvdf_fem.solver.adaptive import compute_unloaded_integrals
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS

MAX_BYTES = 5_000_000  #: Size of the largest table.
PREVIEW_ROWS = 8  #: Approximate number of rows in a preview.
ERROR_MM = "error_mm"  #: Column with the position errors that the authors of the data report.
#: Keys of a scene by the short names of a touch's quantities.
SHORT_KEYS = dict(zip(TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, strict=True))


#: Changes of a scene by dotted key.
Changes = Annotated[dict[str, Any], BeforeValidator(flatten)]
Name = Annotated[str, Field(min_length=1, max_length=60)]


class DataSource(Section):
    """The keys of a table ``[data.NAME]``: the source and the meaning of its readings.

    `file` is the path of a CSV file, relative to the script. Alternatively, `table` is the text of
    the CSV file. Columns are keys of a scene (``x_mm``, ``force_N``, ``film.thickness_um``, ...),
    electrodes, or labels listed in `labels`. The column ``error_mm`` has position errors that the
    authors of the data report. `where` selects rows by the values in columns; `set` changes the
    scene of every row. Readings are in `unit`, by default that in the file, or pC. `reading` is
    ``"total"`` or ``"change"``; by default it is that of the scene's `[readout]`, or ``"total"``
    without one. `what` is the word for the readings on the page.
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
        Keys of the table in the script.
    frame : DataFrame
        The selected rows of the CSV text, with readings as floats.
    names : tuple of str
        Electrodes that have readings.
    reading : {"total", "change"}
        Whether the readings include the charges of the unloaded film.
    """

    name: str
    source: DataSource
    frame: pd.DataFrame
    names: tuple[str, ...]
    reading: str = "total"

    def make_scenes(self, base: Scene) -> list[Scene]:
        """Return the scene of each row: the base scene changed by `set` and the row's cells.

        Raises
        ------
        SceneError
            If scenes are invalid. It lists errors with their rows, at most `MAX_ERRORS`.
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
        """Return the readings as charges on the film.

        Parameters
        ----------
        scenes : sequence of Scene, length n
            The scenes of the rows, as `make_scenes` returns them.
        names : sequence of str, length m
            Names of the electrodes.
        reading : {"total", "change"}
            Whether the returned charges include those of the unloaded film. These are computed
            and added or subtracted if the readings are of the other kind.

        Returns
        -------
        ndarray, shape (n, m)
            In pC; NaN where there is no reading.
        """
        charges = self.frame.reindex(columns=list(names)).to_numpy(float, copy=True)
        if self.source.unit == "V":
            for i, scene in enumerate(scenes):
                charges[i] = _convert_volts_to_pC(charges[i], scene, names)
        if reading == self.reading:
            return charges
        unloaded = _compute_charges_without_load(scenes, names)
        return charges + unloaded if reading == "total" else charges - unloaded

    @property
    def key_frame(self) -> pd.DataFrame:
        """The columns with labels and scene keys, without readings and position errors."""
        return self.frame.drop(columns=[*self.names, ERROR_MM], errors="ignore")

    def make_row_names(self) -> list[str]:
        """Return a name for each row: its labels, or its cells in `key_frame` without labels."""
        cells = self.frame[list(self.source.labels)] if self.source.labels else self.key_frame
        names = []
        for row in cells.itertuples(index=False):
            texts = [format_cell(cell) for cell in row]
            names.append(", ".join(text for text in texts if text))
        return names

    def select_preview_rows(self) -> Self:
        """Return a copy with only about `PREVIEW_ROWS` of the rows, at equal intervals."""
        step = max(1, round(len(self.frame) / PREVIEW_ROWS))
        return replace(self, frame=self.frame.iloc[::step].reset_index(drop=True))


def expand_key(key: str) -> str:
    """Return the full scene key of a short name such as ``x_mm``, or the normalized key itself."""
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
        Keys of the table in the script.
    scene : Scene
        The report's scene.
    folder : Path
        Folder of the script, to which `source.file` is relative.

    Returns
    -------
    Readings

    Raises
    ------
    SceneError
        If the table is invalid. The exception lists all errors of the first failing check.
    """
    where = f"data.{name}"
    frame, source = _read_dataframe(where, source, scene, folder)
    frame = _select_rows(where, source, frame)
    # the scene of a row may have other electrodes than the report's scene
    scenes = Readings(name, source, frame, names=()).make_scenes(scene)
    electrodes: dict[str, None] = {}
    for row_scene in (scene, *scenes):
        electrodes |= dict.fromkeys(electrode.name for electrode in row_scene.electrode_list)
    columns = [*electrodes, *SHORT_KEYS, *source.labels, *source.where, ERROR_MM]
    problems = []
    for column in frame.columns:
        if column in electrodes or column == ERROR_MM:
            problems += _describe_invalid_cells(where, frame[column])
            frame = frame.assign(**{column: _parse_numbers(frame[column])})
        elif column not in columns and "." not in column:
            reason = f"is neither a scene key nor an electrode; {suggest(column, columns)}"
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
    # converted to text first, because an integer may be too large for a float
    numbers = pd.to_numeric(column.astype(str), errors="coerce")
    return numbers.astype(float)


def _describe_invalid_cells(where: str, column: pd.Series) -> list[str]:
    """Return an error message for each cell of a column that is neither empty nor finite."""
    problems = []
    is_bad = column.notna() & ~np.isfinite(_parse_numbers(column))
    for row in column.index[is_bad]:
        reason = f"is not a finite number, in row {row + 1}; correct the cell"
        problems.append(format_error(f"{where}.{column.name}", column[row], reason))
    return problems


def _select_rows(where: str, source: DataSource, frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that `source.where` selects, without empty columns.

    Parameters
    ----------
    where : str
        Key of the table in the script, for messages.
    source : DataSource
        Keys of the table in the script, with the selection and the names of labels.
    frame : DataFrame
        All rows.

    Raises
    ------
    SceneError
        If a column of `where` or `labels` does not exist, or if no row is left.
    """
    problems = []
    for key, columns in (("where", source.where), ("labels", source.labels)):
        for column in columns:
            if column not in frame.columns:
                reason = f"is not a column; {suggest(column, list(frame.columns))}"
                problems.append(format_error(f"{where}.{key}", column, reason))
    if problems:
        raise SceneError(problems[:MAX_ERRORS])
    frame = frame.assign(**{label: frame[label].fillna("") for label in source.labels})
    for column, values in source.where.items():
        frame = frame[frame[column].isin(values if isinstance(values, list) else [values])]
    if frame.empty:
        raise SceneError(
            [f"{where}: has no rows, or none that match `where`; add rows or change `where`"]
        )
    return frame.dropna(axis="columns", how="all")


def _read_dataframe(
    where: str, source: DataSource, scene: Scene, folder: Path
) -> tuple[pd.DataFrame, DataSource]:
    """Read the rows of a table from its CSV file or from its text in the script.

    Parameters
    ----------
    where : str
        Key of the table in the script, for messages.
    source : DataSource
        Keys of the table in the script, with either `file` or `table`.
    scene : Scene
        The report's scene, with the electrodes whose columns may have units.
    folder : Path
        Folder of the script.

    Returns
    -------
    frame : DataFrame
        The rows.
    source : DataSource
        The same keys, with the unit of the readings in the file if it has one.

    Raises
    ------
    SceneError
        If the file cannot be read, or if the text is not a CSV table.
    """
    if (source.file is None) == (source.table is None):
        raise SceneError([f"{where}.file: give either `file`, a path, or `table`, the text"])
    try:
        frame, unit = read_data_table(
            source.table or "" if source.file is None else folder / source.file,
            MAX_BYTES,
            electrodes=[electrode.name for electrode in scene.electrode_list],
            quantities=[*SHORT_KEYS, ERROR_MM],
            others=[*source.labels, *source.where],
            unit=source.unit if "unit" in source.model_fields_set else None,
        )
    except DataTableError as error:
        raise SceneError([f"{where}: {line}" for line in error.args[:MAX_ERRORS]]) from None
    except FileError as error:
        reason = f"is not a table ({error}); give a CSV file with a header"
        problem = format_error(f"{where}.file", source.file or "(table)", reason)
        raise SceneError([problem]) from None
    return frame, source if unit is None else source.model_copy(update={"unit": unit})


def _convert_volts_to_pC(readings_V: Array, scene: Scene, names: Sequence[str]) -> Array:
    """Convert the readings of a scene's amplifiers from V to pC.

    Parameters
    ----------
    readings_V : ndarray, shape (m,)
        Output voltages in V.
    scene : Scene
        The scene whose `[readout]` describes the amplifiers.
    names : sequence of str, length m
        Names of the electrodes. A value without an amplifier is returned unchanged.

    Returns
    -------
    ndarray, shape (m,)
        Charges in pC.
    """
    charges_pC = readings_V.copy()
    columns = {name: j for j, name in enumerate(names)}
    for channel in make_channels(scene):
        if channel.name in columns:
            j = columns[channel.name]
            volts = (readings_V[j] - channel.offset) / channel.gain
            charges_pC[j] = 1e12 * channel.capacitance * volts
    return charges_pC


def _compute_charges_without_load(scenes: Sequence[Scene], names: Sequence[str]) -> Array:
    """Compute the charges of the unloaded films in pC.

    Returns
    -------
    ndarray, shape (scenes, names)
        NaN for an electrode that a scene does not have.
    """
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
