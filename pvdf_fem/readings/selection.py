"""Chosen columns of a table, whose cells are read as numbers in the units that are needed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from pvdf_fem.files import FileError
from pvdf_fem.readings.columns import Column, find_column, parse_heading
from pvdf_fem.readings.table import Batches, Row, Table
from pvdf_fem.readings.text.numbers import CellError, NumberReader
from pvdf_fem.readings.times import (
    TIME_NAMES,
    TimesWithoutUnit,
)
from pvdf_fem.readings.units import UNITS, Unit, convert_factor

#: Units to which readings in different units are converted, by the quantity that they measure.
READING_UNITS = {"charge": "pC", "voltage": "V"}
#: Units of times by the headings that say them, in lower case; those in front are preferred.
TIME_HEADINGS = {
    "t_s": "s",
    "t_ms": "ms",
    "t_us": "µs",
    "t_µs": "µs",
    "t_ns": "ns",
    "millis": "ms",  # Functions of Arduino.
    "micros": "µs",
}


@dataclass(frozen=True)
class ChosenColumn:
    """A column of a table that is read as numbers."""

    index: int  #: Of the column in the table.
    heading: str  #: For messages.
    factor: float  #: From the unit of the column to the unit that is needed.
    #: Reader of cells with times without a unit, such as dates; None for cells with numbers.
    times: TimesWithoutUnit | None = None


def choose_quantity(table: Table, name: str) -> ChosenColumn | None:
    """Return the column of a quantity, or None if the table has none.

    Parameters
    ----------
    table : Table
        The table.
    name : str
        Name with the needed unit, such as ``x_mm``. The column may have another unit of the same
        quantity, such as ``x (m)``.

    Raises
    ------
    FileError
        If several columns match the name, or if the column has a unit of another quantity.
    """
    unit = parse_heading(name).unit
    assert unit is not None
    index = _find_column(table, name, [unit.quantity])
    if index is None:
        return None
    column = table.columns[index]
    given = column.unit or unit
    if given.quantity != unit.quantity:
        raise FileError(
            f"{table.name}: column {column.heading}: is in {given.symbol}; give {unit.symbol}"
        )
    return ChosenColumn(index, column.heading, convert_factor(given, unit))


def choose_column(table: Table, name: str) -> ChosenColumn | None:
    """Return the column with a name, whose numbers are read without conversion.

    Parameters
    ----------
    table : Table
        The table.
    name : str
        Name of the column.

    Returns
    -------
    ChosenColumn or None
        None if the table has no such column.

    Raises
    ------
    FileError
        If several columns match the name.
    """
    index = _find_column(table, name, [])
    if index is None:
        return None
    return ChosenColumn(index, table.columns[index].heading, factor=1.0)


def choose_readings(
    table: Table, electrodes: Sequence[str], unit: str | None
) -> tuple[dict[str, ChosenColumn], str | None]:
    """Return the columns of the readings of electrodes, and their unit.

    Parameters
    ----------
    table : Table
        The table.
    electrodes : sequence of str
        Names of the electrodes.
    unit : str or None
        Symbol of the unit that the user has named.

    Returns
    -------
    columns : dict of str to ChosenColumn
        Columns by electrode. Electrodes without a column are left out. If the columns have
        different units, their readings are converted to pC or V.
    unit : str or None
        Symbol of the unit of the readings. It is that of the file, or else `unit`.

    Raises
    ------
    FileError
        If several columns match the name of an electrode, or if the units do not match: all columns
        need a unit of charge, or all a unit of voltage, or none a unit. A unit of the file must be
        `unit` if that is given.
    """
    indices = {}
    for electrode in electrodes:
        index = _find_column(table, electrode, READING_UNITS)
        if index is not None:
            indices[electrode] = index
    used = [table.columns[index] for index in indices.values()]
    _require_matching_units(table.name, used, unit)
    target = _find_common_unit(used)
    chosen = {}
    for electrode, index in indices.items():
        column = table.columns[index]
        factor = 1.0
        if column.unit is not None and target is not None:
            factor = convert_factor(column.unit, target)
        chosen[electrode] = ChosenColumn(index, column.heading, factor)
    return chosen, unit if target is None else target.symbol


def _find_common_unit(columns: Sequence[Column]) -> Unit | None:
    """Return the unit to which readings are converted, or None if their columns have no units.

    It is the unit of all columns, or pC or V if they have several units of one quantity.
    """
    units = {column.unit for column in columns if column.unit is not None}
    if not units:
        return None
    first = next(iter(units))
    return first if len(units) == 1 else UNITS[READING_UNITS[first.quantity]]


def _require_matching_units(name: str, columns: Sequence[Column], unit: str | None) -> None:
    """Raise `FileError` unless columns have no units, or units of one quantity of readings.

    Parameters
    ----------
    name : str
        Name of the table, for messages.
    columns : sequence of Column
        Columns of readings.
    unit : str or None
        Symbol of the unit that the user has named, which units of columns must not contradict.
    """
    with_unit = [column for column in columns if column.unit is not None]
    if not with_unit:
        return
    first = with_unit[0]
    for column in columns:
        where = f"{name}: column {column.heading}:"
        if column.unit is None:
            raise FileError(f"{where} has no unit, but {first.heading} has; give it one as well")
        symbol = column.unit.symbol
        if column.unit.quantity not in READING_UNITS:
            raise FileError(f"{where} is in {symbol}; give pC, V or the like")
        if first.unit is not None and column.unit.quantity != first.unit.quantity:
            raise FileError(
                f"{where} is in {symbol}, but {first.heading} in {first.unit.symbol}; give all "
                "readings as charges, or all as voltages"
            )
        if unit not in (None, symbol):
            raise FileError(
                f"{where} is in {symbol}, but --unit says {unit}; remove --unit, or correct the "
                "file"
            )


def choose_times(table: Table) -> ChosenColumn | None:
    """Return the column of times, or None if the table has none.

    The first of these columns that the table has is chosen:

    - one of `TIME_HEADINGS`, such as ``t_s`` or ``t_ms``;
    - one of `TIME_NAMES` with a unit, such as ``time (ms)``;
    - one of `TIME_NAMES` without a unit, whose cells must be dates, times of day, or counts from
      1970 (see `TimesWithoutUnit`); these times are counted from the first one;
    - a column with any other name, if it is the only one with a unit of time.
    """
    index = _find_time_column(table.columns)
    if index is None:
        return None
    column = table.columns[index]
    unit = column.unit
    symbol = TIME_HEADINGS.get(column.heading.casefold())
    if unit is None and symbol is not None:
        unit = UNITS[symbol]
    if unit is not None:
        return ChosenColumn(index, column.heading, convert_factor(unit, UNITS["s"]))
    times = TimesWithoutUnit(table.name, column.heading, table.numbers)
    return ChosenColumn(index, column.heading, factor=1.0, times=times)


def is_time_column(column: Column) -> bool:
    """Return whether a column is named like one of times, and has no unit of another quantity."""
    if column.heading.casefold() in TIME_HEADINGS:
        return True
    is_named = column.name.casefold() in TIME_NAMES
    return is_named and (column.unit is None or column.unit.quantity == "time")


def _find_time_column(columns: Sequence[Column]) -> int | None:
    """Return the index of the column of times, or None if there is none; see `choose_times`."""
    headings = [column.heading.casefold() for column in columns]
    for heading in TIME_HEADINGS:
        if heading in headings:
            return headings.index(heading)
    named = [i for i, column in enumerate(columns) if is_time_column(column)]
    with_unit = [i for i in named if columns[i].unit is not None]
    if named:
        return min(with_unit or named, key=lambda i: TIME_NAMES.index(columns[i].name.casefold()))
    measured = [i for i, column in enumerate(columns) if _is_in_unit_of_time(column)]
    return measured[0] if len(measured) == 1 else None


def _is_in_unit_of_time(column: Column) -> bool:
    """Return whether a column has a unit of time."""
    return column.unit is not None and column.unit.quantity == "time"


def _find_column(table: Table, name: str, quantities: Iterable[str]) -> int | None:
    """Find a column by its name; return its index, or None if there is none.

    Parameters
    ----------
    table : Table
        The table. Its name is added to the messages of `find_column`.
    name : str
        Name of the column, see `find_column`.
    quantities : iterable of str
        Quantities that the column should have if it has a unit.

    Raises
    ------
    FileError
        If several columns match the name.
    """
    try:
        return find_column(table.columns, name, [*quantities])
    except FileError as error:
        raise FileError(f"{table.name}: {error}") from None


@dataclass
class NumberColumns:
    """A reader of the numbers in chosen columns of a table.

    It learns whether numbers have a decimal point or comma. In a file, it looks at all rows before
    the first one is read. In a stream, it looks at each row before its numbers are read.

    Parameters
    ----------
    table : Table
        The table.
    columns : sequence of ChosenColumn
        The columns that are read.
    """

    table: Table
    columns: Sequence[ChosenColumn]

    def __post_init__(self) -> None:
        self.numbers = self.table.numbers
        #: How often each word replaced a missing number, by heading and word.
        self.words = Counter[tuple[str, str]]()
        #: How often each word marked a number as beyond the range, by heading and word.
        self.range_words = Counter[tuple[str, str]]()
        self._readers = [_make_cell_reader(self.table, column) for column in self.columns]
        if self.table.reopen is not None and not self.numbers.decimal:
            self._learn_from_file(self.table.reopen())

    def read(self, row: Row) -> list[float]:
        """Return the numbers of a row in the order of the columns.

        Parameters
        ----------
        row : Row
            A row of the table.

        Returns
        -------
        list of float
            NaN for missing numbers, and ±∞ for those that are marked as beyond the range of an
            instrument. Such words are counted in `words` and `range_words`.

        Raises
        ------
        CellError
            If the row has a defect, or a cell is not a number or ambiguous. The message begins with
            the row and the column.
        """
        if row.defect:
            raise CellError(f"row {row.number} {row.defect}")
        if not self.numbers.decimal:
            self._learn_from_row(row)
        values = []
        cells = row.cells
        for index, read_cell in self._readers:
            try:
                value = read_cell(cells[index])
            except CellError as error:
                heading = self.table.columns[index].heading
                raise CellError(f"row {row.number}, column {heading}: {error}") from None
            if value - value != 0.0:  # NaN or infinite
                self._count_word(index, cells[index], value)
            values.append(value)
        return values

    def describe_words(self, row: Row, values: Iterable[float]) -> str:
        """Describe the words that replace numbers in a row, such as ``A is OVER, B is #DIV/0!``.

        Parameters
        ----------
        row : Row
            A row of the table.
        values : iterable of float
            Its numbers, as `read` returns them.
        """
        parts = []
        for column, value in zip(self.columns, values, strict=True):
            text = "" if math.isfinite(value) else _get_text(row.cells[column.index])
            if text:
                parts.append(f"{column.heading} is {text}")
        return ", ".join(parts)

    def read_cell_or_nan(self, row: Row, position: int) -> float:
        """Return the number in one column of a malformed row; NaN if it has none there.

        Parameters
        ----------
        row : Row
            A row of the table.
        position : int
            Position of the column among the chosen columns.
        """
        index, read_cell = self._readers[position]
        try:
            return read_cell(row.cells[index])
        except (CellError, IndexError):
            return math.nan

    def _learn_from_file(self, batches: Batches) -> None:
        """Learn the decimal sign from the chosen columns of a file, or else from all columns."""
        others = NumberReader()
        for batch in batches:
            for row in batch:
                self.numbers.learn(self._list_chosen_texts(row))
                if self.numbers.decimal:
                    return
                others.learn(_list_texts(row.cells))
        self.numbers.adopt(others)

    def _learn_from_row(self, row: Row) -> None:
        """Learn the decimal sign from the chosen cells of a row, or else from all cells."""
        self.numbers.learn(self._list_chosen_texts(row))
        self.numbers.learn(_list_texts(row.cells))

    def _list_chosen_texts(self, row: Row) -> list[str]:
        """Return the texts in the chosen columns of a row."""
        if row.defect:
            return []
        return _list_texts([row.cells[column.index] for column in self.columns])

    def _count_word(self, index: int, cell: Any, value: float) -> None:
        """Count a word that replaces a number.

        Empty cells are not counted. A value beyond the range of which no word is known, as in the
        binary file of a logger, is counted as ``inf`` or ``-inf``.

        Parameters
        ----------
        index : int
            Index of the column in the table.
        cell : object
            The cell.
        value : float
            The value of the cell: NaN, ∞ or -∞.
        """
        text = _get_text(cell)
        heading = self.table.columns[index].heading
        if math.isinf(value):
            self.range_words[heading, text or f"{value:g}"] += 1
        elif text:
            self.words[heading, text] += 1


def _get_text(cell: Any) -> str:
    """Return the text of a cell; an empty one for None and for numbers."""
    return cell.strip() if isinstance(cell, str) else ""


def _list_texts(cells: Iterable[Any]) -> list[str]:
    """Return the cells that are texts."""
    return [cell for cell in cells if isinstance(cell, str)]


def _make_cell_reader(table: Table, column: ChosenColumn) -> tuple[int, Callable[[Any], float]]:
    """Return the index of a column with a function that reads its cells in the needed unit."""
    read_number = table.numbers.read
    factor = column.factor
    # Division by 1000 rounds correctly, multiplication by 0.001 does not.
    divisor = float(f"{1.0 / factor:.15g}")
    times = column.times

    def read_cell(cell: Any) -> float:
        if cell is None:
            return math.nan
        if times is not None:
            return times.read(str(cell))
        if type(cell) is str:
            value = read_number(cell)
        elif isinstance(cell, Real) and not isinstance(cell, bool):
            value = float(cell)
        else:
            value = read_number(str(cell))
        return value * factor if factor >= 1.0 else value / divisor

    return column.index, read_cell
