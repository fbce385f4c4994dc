"""Reading the table of a data source: readings and positions as numbers, other columns as given."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.files import read_bytes
from pvdf_fem.readings.columns import Column
from pvdf_fem.readings.formats import parse_csv
from pvdf_fem.readings.selection import (
    READING_UNITS,
    ChosenColumn,
    NumberColumns,
    choose_quantity,
    choose_readings,
)
from pvdf_fem.readings.table import Row, Table
from pvdf_fem.readings.text.header import make_name_test
from pvdf_fem.readings.text.numbers import CellError, has_number
from pvdf_fem.readings.units import UNITS, convert_factor

_INTEGER = re.compile(r"\s*[+-]?[0-9]+\s*").fullmatch
_BOOLEANS = {"true": True, "false": False}
MAX_DEFECTS = 20  #: Maximum number of rows and cells that cannot be read before reading stops.


class DataTableError(ValueError):
    """Cells or rows of a table that cannot be read; each argument is the message of one."""


def read_data_table(
    source: Path | str,
    max_bytes: int,
    electrodes: Sequence[str],
    quantities: Sequence[str],
    others: Sequence[str],
    unit: str | None,
) -> tuple[pd.DataFrame, str | None]:
    """Read the columns of a table in a file or a text.

    Parameters
    ----------
    source : Path or str
        Path of the file, or the text of a table.
    max_bytes : int
        Maximum size of the file.
    electrodes : sequence of str
        Names of electrodes. Their columns may have units.
    quantities : sequence of str
        Names of columns with lengths, forces and the like, such as ``x_mm``, which may have other
        units in the file.
    others : sequence of str
        Names of other columns, by which the header is found, too.
    unit : str or None
        Unit of the readings, if the user has named it.

    Returns
    -------
    frame : DataFrame
        Columns of electrodes and quantities as floats, under their names. Other columns are
        integers, floats or truth values if all of their cells are, and otherwise texts; they have
        the headings of the file. Empty cells are NaN.
    unit : {"pC", "V"} or None
        Unit of the readings, if the file or the user says it.

    Raises
    ------
    FileError
        If the file cannot be read, or its columns are ambiguous.
    DataTableError
        If cells are not numbers or ambiguous, or rows have too few or too many cells.
    """
    if isinstance(source, str):
        name = "the table"
        content = source.encode()
    else:
        name = str(source)
        content = read_bytes(source, max_bytes, "a table")
    has_name = make_name_test([*electrodes, *quantities, *others])
    table = parse_csv(content, name, lambda column: has_name(column) or _is_key(column))
    chosen, unit = _choose_readings(table, electrodes, unit)
    for quantity in quantities:
        quantity_column = choose_quantity(table, quantity)
        if quantity_column is not None:
            chosen[quantity] = quantity_column
    return _make_frame(table, chosen), unit


def _choose_readings(
    table: Table, electrodes: Sequence[str], unit: str | None
) -> tuple[dict[str, ChosenColumn], str | None]:
    """Return the columns of electrodes and their unit, see `choose_readings`, in pC or V."""
    chosen, symbol = choose_readings(table, electrodes, unit)
    if symbol is None:
        return chosen, None
    target = UNITS[READING_UNITS[UNITS[symbol].quantity]]
    factor = convert_factor(UNITS[symbol], target)
    scaled = {name: replace(each, factor=factor * each.factor) for name, each in chosen.items()}
    return scaled, target.symbol


def _make_frame(table: Table, chosen: Mapping[str, ChosenColumn]) -> pd.DataFrame:
    """Read all rows of a table.

    Parameters
    ----------
    table : Table
        The table.
    chosen : mapping of str to ChosenColumn
        Columns of numbers, by their names in the result. Other columns keep their headings.
    """
    numbers = NumberColumns(table, list(chosen.values()))
    rows: list[Row] = []
    for batch in table.batches:
        rows += batch
    values = _read_numbers(numbers, rows)
    names = {column.index: name for name, column in chosen.items()}
    columns: dict[str, Any] = dict(zip(chosen, values.T, strict=True))
    frame: dict[str, Any] = {}
    for index, column in enumerate(table.columns):
        if index in names:
            frame[names[index]] = columns[names[index]]
        elif column.heading:
            frame[column.heading] = _convert_cells(table, index, rows)
    return pd.DataFrame(frame)


def _is_key(column: Column) -> bool:
    """Return whether a column is headed by a dotted key of a scene."""
    return re.fullmatch(r"[a-z_]+(\[\d+\])?(\.\w+)+", column.heading) is not None


def _read_numbers(numbers: NumberColumns, rows: Sequence[Row]) -> Array:
    """Read the numbers of the chosen columns in rows.

    Returns
    -------
    ndarray, shape (rows, columns)
        NaN for empty cells, and for words such as OVER.

    Raises
    ------
    DataTableError
        If rows or cells cannot be read.
    """
    values = np.full((len(rows), len(numbers.columns)), np.nan)
    defects = []
    for i, row in enumerate(rows):
        try:
            values[i] = numbers.read(row)
        except CellError as error:
            defects.append(str(error))
    if defects:
        raise DataTableError(*defects[:MAX_DEFECTS])
    values[np.isinf(values)] = np.nan
    return values


def _convert_cells(table: Table, index: int, rows: Sequence[Row]) -> list[Any]:
    """Convert the texts of a column to the type that all of its cells have.

    Parameters
    ----------
    table : Table
        The table, which reads numbers.
    index : int
        Index of the column.
    rows : sequence of Row
        All rows of the table.

    Returns
    -------
    list
        Integers, floats, truth values or texts; NaN for empty cells.
    """
    texts = [row.cells[index].strip() for row in rows]
    given = [text for text in texts if text]
    if texts and all(_INTEGER(text) for text in texts):
        return [int(text) for text in texts]
    if given and all(has_number(text) for text in given):
        column = ChosenColumn(index, table.columns[index].heading, factor=1.0)
        return _read_numbers(NumberColumns(table, [column]), rows)[:, 0].tolist()
    if given and all(text.lower() in _BOOLEANS for text in given):
        return [_BOOLEANS.get(text.lower(), np.nan) for text in texts]
    return [text or np.nan for text in texts]
