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
#: Added to the heading of a column whose name is given to another column.
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

    If the table has none of these columns, but some with the names of the electrodes, it is
    returned as it is, with a note.

    Parameters
    ----------
    table : Table
        The table.
    choice : mapping of str to str
        Headings by electrodes, or by headings of times such as ``t_s``. An address such as
        ``Group/ai0`` is that of a channel in the file of a logger; its last part is compared, too.
    electrodes : collection of str
        Names of the electrodes.

    Raises
    ------
    FileError
        If the table has no column with a chosen name, or several.
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
        if key in electrodes:
            columns[index] = replace(table.columns[index], heading=key, name=key)
        else:
            columns[index] = parse_heading(key)  # such as t_s
    return replace(table, columns=tuple(columns))


def suggest_channels(columns: Sequence[Column], electrodes: Sequence[str]) -> str:
    """Return an example of a choice of columns to type, such as ``A=Channel A,B=Channel B``.

    Parameters
    ----------
    columns : sequence of Column
        Columns of the table. Those are suggested whose name has that of an electrode as a word.
    electrodes : sequence of str
        Names of the electrodes.

    Returns
    -------
    str
        The example. If no column can be suggested, it has the word NAME.
    """
    pairs = []
    for electrode in electrodes:
        for column in columns:
            if electrode in _WORDS.findall(column.name):
                pairs.append(f"{electrode}={column.name}")
                break
    return ",".join(pairs) or f"{electrodes[0]}=NAME"


def _list_names(address: str) -> set[str]:
    """Return the names of a channel in lower case: its address, and the last part of it."""
    text = " ".join(address.split()).casefold()
    return {text, text.rpartition("/")[2]}


def _has_one_of_names(column: Column, names: Collection[str]) -> bool:
    """Return whether a column has one of some names, with or without its unit."""
    return column.heading.casefold() in names or column.name.casefold() in names


def _find_indices(columns: Sequence[Column], address: str) -> list[int]:
    """Return the indices of the columns that an address may mean."""
    names = _list_names(address)
    return [index for index, column in enumerate(columns) if _has_one_of_names(column, names)]


def _require_one(table: Table, key: str, address: str, found: Sequence[int]) -> int:
    """Return the index of the only column that was found; refuse none and several.

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
        f"{table.name}: has no column {address}; its columns are {headings}; choose one by "
        f'--channels "{key}=NAME"'
    )


def add_times(table: Table, rate_Hz: float) -> Table:
    """Return a copy of a table with a column ``t_s`` of times at a constant rate.

    The first row has the time 0. Malformed rows count.

    Parameters
    ----------
    table : Table
        A table without times.
    rate_Hz : float
        Number of rows per second.

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
