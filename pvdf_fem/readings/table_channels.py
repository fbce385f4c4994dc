"""Columns of tables for electrodes and times, as the user names them or gives their rate."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from pvdf_fem.files import FileError
from pvdf_fem.readings.columns import Column, parse_heading
from pvdf_fem.readings.selection import choose_times
from pvdf_fem.readings.table import Batches, Row, Table
from pvdf_fem.readings.units import UNITS

_WORDS = re.compile(r"\w+")
#: Added to the headings of columns whose names another column has been given.
OTHER_SUFFIX = " of the file"


def make_channel_test(choice: Mapping[str, str]) -> Callable[[Column], bool]:
    """Return a function that tells whether a column is one of a choice of channels.

    Parameters
    ----------
    choice : mapping of str to str
        Names of channels by electrodes, or by headings of times such as ``t_s``.
    """
    wanted = set[str]()
    for address in choice.values():
        wanted |= _list_names(address)

    def is_wanted(column: Column) -> bool:
        return _has_one_of_names(column, wanted)

    return is_wanted


def name_channels(table: Table, choice: Mapping[str, str], electrodes: Collection[str]) -> Table:
    """Return a table in which the columns of a choice have the names of their electrodes.

    If the table has none of the columns of the choice, but some with the names of the electrodes,
    these are read; a note says so.

    Parameters
    ----------
    table : Table
        The table.
    choice : mapping of str to str
        Headings by electrodes, or by headings of times such as ``t_s``. Of the address of a
        channel in the file of a logger, such as ``Group/ai0``, the last part is enough.
    electrodes : collection of str
        Names of the electrodes.

    Raises
    ------
    FileError
        If the table has no column with a name, or several.
    """
    if not choice:
        return table
    indices = {key: _find_indices(table.columns, address) for key, address in choice.items()}
    if not any(indices.values()):
        named = [column.heading for column in table.columns if column.name in electrodes]
        if named:
            missing = ", ".join(choice.values())
            note = f"has no columns {missing}; those named {', '.join(named)} are read"
            return replace(table, notes=[*table.notes, note])
    columns = list(table.columns)
    for index, column in enumerate(table.columns):
        if column.name in choice:
            columns[index] = Column(f"{column.heading}{OTHER_SUFFIX}", "", column.unit)
    for key, found in indices.items():
        index = _require_one(table, key, choice[key], found)
        column = table.columns[index]
        columns[index] = (
            parse_heading(key) if key not in electrodes else replace(column, heading=key, name=key)
        )
    return replace(table, columns=tuple(columns))


def suggest_channels(columns: Sequence[Column], electrodes: Sequence[str]) -> str:
    """Return an example of a choice to type, with the columns that have the names of electrodes.

    Such as ``A=Channel A,B=Channel B``; without such columns it has the word NAME.
    """
    pairs = []
    for electrode in electrodes:
        for column in columns:
            if electrode in _WORDS.findall(column.name):
                pairs.append(f"{electrode}={column.name}")
                break
    return ",".join(pairs) or f"{electrodes[0]}=NAME"


def _list_names(address: str) -> set[str]:
    """Return the address of a channel, and its last part, in lower case."""
    text = " ".join(address.split()).casefold()
    return {text, text.rpartition("/")[2]}


def _has_one_of_names(column: Column, names: Collection[str]) -> bool:
    """Return whether the heading of a column, with or without its unit, is one of some names."""
    return column.heading.casefold() in names or column.name.casefold() in names


def _find_indices(columns: Sequence[Column], address: str) -> list[int]:
    """Return the indices of the columns with a name."""
    names = _list_names(address)
    return [index for index, column in enumerate(columns) if _has_one_of_names(column, names)]


def _require_one(table: Table, key: str, address: str, found: Sequence[int]) -> int:
    """Return the only index of those that were found.

    Parameters
    ----------
    table : Table
        The table.
    key : str
        Name of the electrode, or heading of times.
    address : str
        The name of the column.
    found : sequence of int
        Indices of the columns with this name.

    Raises
    ------
    FileError
        If there is no column with this name, or several.
    """
    if len(found) == 1:
        return found[0]
    if found:
        headings = " and ".join(table.columns[index].heading for index in found)
        raise FileError(f"{table.name}: columns {headings}: both may be {address}; rename one")
    headings = ", ".join(column.heading for column in table.columns)
    raise FileError(
        f"{table.name}: has no column {address}; its columns are {headings}; name one by "
        f'--channels "{key}=NAME"'
    )


def add_times(table: Table, rate_Hz: float) -> Table:
    """Return a table without times with a column ``t_s`` at a constant rate.

    The first row has the time 0. Rows that are malformed count.

    Raises
    ------
    FileError
        If the table has times.
    """
    if choose_times(table) is not None:
        raise FileError(f"{table.name}: has times of its own; omit --rate")
    count = len(table.columns)

    def add_cells(batches: Batches) -> Batches:
        for batch in batches:
            rows = []
            for row in batch:
                padding = [""] * (count - len(row.cells))
                cells = [*row.cells[:count], *padding, (row.number - 1) / rate_Hz]
                rows.append(Row(row.number, cells, row.defect))
            yield rows

    reopen = table.reopen
    return replace(
        table,
        columns=(*table.columns, Column("t_s", "t", UNITS["s"])),
        batches=add_cells(table.batches),
        reopen=None if reopen is None else lambda: add_cells(reopen()),
    )
