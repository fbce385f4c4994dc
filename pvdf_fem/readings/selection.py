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
    ClockTimes,
    UnixTimes,
    find_unix_unit,
    is_clock_time,
)
from pvdf_fem.readings.units import UNITS, convert_factor

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


class TimesOfUnknownKind:
    """A reader of times without a unit, which decides by the first cell how they are written.

    Parameters
    ----------
    table : Table
        The table.
    column : Column
        Its column of times.
    """

    def __init__(self, table: Table, column: Column) -> None:
        self.table = table
        self.column = column
        self.reader: ClockTimes | UnixTimes | None = None
        self.origin = ""  #: The cell from which times are counted; empty while there is none.

    def read(self, cell: str) -> float:
        """Return the time in a cell in s since the first one; NaN if it is missing.

        A `FileError` is raised if the first time is a number whose unit is unknown.
        """
        if self.reader is None:
            if is_clock_time(cell):
                self.reader = ClockTimes()
            else:
                value = self.table.numbers.read(cell)
                if math.isnan(value):
                    return value
                if find_unix_unit(value) is None:
                    raise FileError(
                        f"{self.table.name}: column {self.column.heading}: has no unit; name it "
                        f'by its unit, as by --channels "t_s={self.column.heading}"'
                    )
                self.reader = UnixTimes(self.table.numbers)
        time_s = self.reader.read(cell)
        if not self.origin and not math.isnan(time_s):
            self.origin = cell.strip()
        return time_s


@dataclass(frozen=True)
class ChosenColumn:
    """A column of a table that is read as numbers."""

    index: int  #: Of the column in the table.
    heading: str  #: For messages.
    factor: float  #: From the unit of the column to the unit that is needed.
    #: Reader of cells with times of an unknown kind, such as dates; None for cells with numbers.
    times: TimesOfUnknownKind | None = None


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
        If several columns may be meant, or the column has a unit of another quantity.
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
    """Return a column whose unit does not matter, by its name; None if the table has none.

    A `FileError` is raised if several columns may be meant.
    """
    index = _find_column(table, name, [])
    return None if index is None else ChosenColumn(index, table.columns[index].heading, factor=1.0)


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
        Columns by electrode, of those that have one. If they have different units, readings are
        converted to pC or V.
    unit : str or None
        Symbol of the unit of the readings if the file has it, and otherwise the unit that the user
        has named.

    Raises
    ------
    FileError
        If several columns may be meant for an electrode, if units are neither charges nor voltages,
        are of both kinds, or are missing for some electrodes only, or if they are not `unit`.
    """
    indices = {}
    for electrode in electrodes:
        index = _find_column(table, electrode, READING_UNITS)
        if index is not None:
            indices[electrode] = index
    used = [table.columns[index] for index in indices.values()]
    _require_matching_units(table.name, used, unit)
    units = {column.unit for column in used if column.unit is not None}
    if not units:
        target = None
    elif len(units) == 1:
        [target] = units
    else:
        target = UNITS[READING_UNITS[next(iter(units)).quantity]]
    chosen = {}
    for electrode, index in indices.items():
        column = table.columns[index]
        factor = convert_factor(column.unit, target) if column.unit and target else 1.0
        chosen[electrode] = ChosenColumn(index, column.heading, factor)
    return chosen, target.symbol if target else unit


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

    Columns ``t_s``, ``t_ms``, ``t_us`` are preferred, then ``time`` and the like with a unit, then
    those without, whose cells must be dates, times of day, or numbers of seconds since 1970. Times
    without a unit are counted from the first one. A column with another name has the times if it
    is the only one with a unit of time.

    Raises
    ------
    FileError
        If the column has no unit and its first cells are other numbers.
    """
    index = _find_time_column(table.columns)
    if index is None:
        return None
    column = table.columns[index]
    symbol = TIME_HEADINGS.get(column.heading.casefold())
    unit = UNITS[symbol] if symbol and column.unit is None else column.unit
    if unit is not None:
        return ChosenColumn(index, column.heading, convert_factor(unit, UNITS["s"]))
    return ChosenColumn(index, column.heading, 1.0, TimesOfUnknownKind(table, column))


def is_time_column(column: Column) -> bool:
    """Return whether a column has the name of one of times, and no unit of another quantity."""
    if column.heading.casefold() in TIME_HEADINGS:
        return True
    is_named = column.name.casefold() in TIME_NAMES
    return is_named and (column.unit is None or column.unit.quantity == "time")


def _find_time_column(columns: Sequence[Column]) -> int | None:
    """Return the index of the best column of times, or None if there is none."""
    headings = [column.heading.casefold() for column in columns]
    for heading in TIME_HEADINGS:
        if heading in headings:
            return headings.index(heading)
    for has_unit in (True, False):
        by_name: dict[str, int] = {}
        for index, column in enumerate(columns):
            if is_time_column(column) and (column.unit is not None) == has_unit:
                by_name.setdefault(column.name.casefold(), index)
        for name in TIME_NAMES:
            if name in by_name:
                return by_name[name]
    measured = [i for i, column in enumerate(columns) if _is_in_unit_of_time(column)]
    return measured[0] if len(measured) == 1 else None


def _is_in_unit_of_time(column: Column) -> bool:
    """Return whether a column has a unit of time."""
    return column.unit is not None and column.unit.quantity == "time"


def _find_column(table: Table, name: str, quantities: Iterable[str]) -> int | None:
    """Find a column by its name, and add the name of the table to the message of an error."""
    try:
        return find_column(table.columns, name, [*quantities])
    except FileError as error:
        raise FileError(f"{table.name}: {error}") from None


@dataclass
class NumberColumns:
    """A reader of the numbers in chosen columns of a table.

    Before the first row, it learns from the rows of a file whether numbers have a decimal point or
    comma. In a stream, it learns from each row before its numbers are read.

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
        #: How often each word stood in place of a missing number, by heading and word.
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
        """Describe the words that a row has instead of numbers: ``A is OVER, B is #DIV/0!``.

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
        """Return the number in one of the columns of a row that is malformed; NaN if it has none.

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
        """Learn the decimal sign from the chosen columns of a file, or else from the others."""
        others = NumberReader()
        for batch in batches:
            for row in batch:
                self.numbers.learn(self._list_chosen_texts(row))
                if self.numbers.decimal:
                    return
                others.learn(_list_texts(row.cells))
        self.numbers.adopt(others)

    def _learn_from_row(self, row: Row) -> None:
        """Learn the decimal sign from the chosen cells of a row, or else from the others."""
        self.numbers.learn(self._list_chosen_texts(row))
        self.numbers.learn(_list_texts(row.cells))

    def _list_chosen_texts(self, row: Row) -> list[str]:
        """Return the texts in the chosen columns of a row."""
        if row.defect:
            return []
        return _list_texts([row.cells[column.index] for column in self.columns])

    def _count_word(self, index: int, cell: Any, value: float) -> None:
        """Count a word that stood in place of a number, by its value, NaN or infinite.

        Empty cells are not counted. Files of loggers mark numbers without words.
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
