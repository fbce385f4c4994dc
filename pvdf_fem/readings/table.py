"""Tables: rows of cells below named columns, as they arrive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, BinaryIO, NamedTuple

from pvdf_fem.readings.columns import Column, parse_heading
from pvdf_fem.readings.text.numbers import NumberReader


class Row(NamedTuple):
    """A row of a table."""

    number: int  #: Number of the row below the header, from 1.
    #: Cells in the order of the columns: texts, numbers, or values of JSON. A row with a defect may
    #: have fewer.
    cells: Sequence[Any]
    defect: str = ""  #: Why the row cannot be used, such as ``has 3 cells, not 5``; else empty.


Batches = Iterator[list[Row]]  #: Lists of the rows that have arrived since the previous list.
OpenAgain = Callable[[], AbstractContextManager[BinaryIO]]  #: Opens a file once more.


@dataclass(frozen=True, eq=False)
class Table:
    """A table that is read row by row.

    Parameters
    ----------
    name : str
        Name of the file or stream, for messages.
    columns : tuple of Column
        Its columns.
    batches : iterator of list of Row
        Each list has the rows that have arrived since the previous list. It can be read once.
    numbers : NumberReader
        Reads the numbers in cells of text.
    reopen : callable, optional
        Returns the rows from the first one on in another iterator, to look at before the rows of
        `batches` are read. None for a stream, whose rows cannot be seen before they are used.
    notes : sequence of str
        Sentences about anything in the file that its user should know. Reading the rows may append
        to it.
    """

    name: str
    columns: tuple[Column, ...]
    batches: Batches
    numbers: NumberReader
    reopen: Callable[[], Batches] | None = field(default=None, repr=False)
    notes: Sequence[str] = ()


def make_table(name: str, columns: Mapping[str, Sequence[Any]]) -> Table:
    """Make a table of columns that are in memory.

    Parameters
    ----------
    name : str
        Name of the table, for messages.
    columns : mapping of str to sequence
        Numbers, texts or None by heading, all columns of the same length. Numbers in texts have a
        decimal point unless one of them has a comma.
    """
    rows = []
    for number, cells in enumerate(zip(*columns.values(), strict=True), start=1):
        rows.append(Row(number, cells))

    def reopen() -> Batches:
        yield rows

    return Table(
        name,
        tuple(parse_heading(heading) for heading in columns),
        batches=reopen(),
        numbers=NumberReader("."),
        reopen=reopen,
    )
