"""Tables of lines with cells between separators."""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from pvdf_fem.files import FileError
from pvdf_fem.readings.columns import Column
from pvdf_fem.readings.table import Batches, OpenAgain, Row, Table
from pvdf_fem.readings.text.header import Header, HeaderSearch, IsWanted
from pvdf_fem.readings.text.lines import read_lines
from pvdf_fem.readings.text.numbers import MAX_QUOTED, NumberReader, has_number
from pvdf_fem.readings.text.separators import (
    SEPARATOR_NAMES,
    drop_empty_end,
    find_comment_text,
    split_cells,
)
from pvdf_fem.readings.text.serial_monitor import rewrite_serial_lines

#: Characters with which a line of comment may begin.
_FIRST_OF_COMMENT = ("#", "%", "/", " ", "\t")
#: Number of lines of a file that are searched for a better header.
LINES_AHEAD = 50


def open_csv_table(
    stream: BinaryIO, name: str, is_wanted: IsWanted, open_again: OpenAgain | None = None
) -> Table:
    """Find the header of a table in text, and return the table.

    Parameters
    ----------
    stream : binary file
        A file or a live pipe, which is read up to the first row of numbers.
    name : str
        Its name, for messages.
    is_wanted : callable
        Whether a column has one of the names by which the header is found.
    open_again : callable, optional
        Opens the file once more, to look at rows in advance. None for a pipe.

    Returns
    -------
    Table
        Rows without comments and blank lines.

    Raises
    ------
    FileError
        If a column occurs twice.
    """
    lines = rewrite_serial_lines(read_lines(stream, name))
    header, first_lines, notes = _find_header(lines, name, is_wanted, open_again is not None)
    _require_distinct_headings(header.columns, name)
    parser = _RowParser(header)

    def reopen() -> Batches:
        assert open_again is not None
        with open_again() as copy:
            yield from open_csv_table(copy, name, is_wanted, open_again).batches

    return Table(
        name,
        header.columns,
        batches=_parse_batches(parser, first_lines, lines),
        numbers=NumberReader("." if header.separator == "," else ""),
        reopen=reopen if open_again else None,
        notes=notes,
    )


class _FoundHeader(NamedTuple):
    """The header of a table, with the lines that were read together with it."""

    header: Header
    lines: list[str]  #: Lines of the first rows.
    notes: list[str]  #: Sentences about lines that are not read, and unknown units.


def _find_header(
    lines: Iterator[list[str]], name: str, is_wanted: IsWanted, is_file: bool
) -> _FoundHeader:
    """Find the header of a table.

    A header may be preceded by another table, of the ranges or gains of the channels. In a file,
    `LINES_AHEAD` more lines are therefore searched for one with more of the wanted names.

    Parameters
    ----------
    lines : iterator of list of str
        Lines of the table.
    name : str
        Name of the table, for messages.
    is_wanted : callable
        Whether a column has a wanted name.
    is_file : bool
        Whether lines can be read in advance.
    """
    search = HeaderSearch(name, is_wanted)
    for batch in lines:
        for index, line in enumerate(batch):
            header = search.add(line)
            if header is None:
                continue
            rest = batch[index + 1 :]
            if not is_file:
                return _FoundHeader(header, search.lines + rest, search.notes)
            for ahead, later in enumerate(rest[:LINES_AHEAD]):
                if search.is_surpassed_by(later):
                    found = _find_header(iter([rest[ahead:]]), name, is_wanted, is_file)
                    note = f"lines above the header {later.strip()[:MAX_QUOTED]} are not read"
                    return found._replace(notes=[note, *found.notes])
            rows = search.lines + rest
            header, count = search.skip_labelled_rows(header, rows[:LINES_AHEAD])
            return _FoundHeader(header, rows[count:], search.notes)
    header = search.finish()
    return _FoundHeader(header, search.lines, search.notes)


def _require_distinct_headings(columns: tuple[Column, ...], name: str) -> None:
    """Raise `FileError` if two columns have the same heading, unless it is empty or a number."""
    headings = []
    for column in columns:
        if column.heading and not has_number(column.heading):
            headings.append(column.heading)
    for heading in sorted(headings):
        if headings.count(heading) > 1:
            raise FileError(f"{name}: column {heading} occurs twice; rename one")


def _parse_batches(
    parser: _RowParser, first_lines: list[str], lines: Iterator[list[str]]
) -> Batches:
    """Yield the rows of lines as they arrive.

    Parameters
    ----------
    parser : _RowParser
        The parser of the lines.
    first_lines : list of str
        Lines that were read together with the header.
    lines : iterator of list of str
        The following lines.
    """
    if first_lines:
        yield parser.parse(first_lines)
    for batch in lines:
        yield parser.parse(batch)


class _RowParser:
    """A parser of the lines below a header, which counts the rows."""

    def __init__(self, header: Header) -> None:
        self.separator = header.separator
        self.count = len(header.columns)
        self.needed = header.needed
        self.number = 0

    def parse(self, lines: list[str]) -> list[Row]:
        """Return the rows in lines; comments are left out."""
        rows = []
        separator = self.separator
        is_plain = separator != " "
        for line in lines:
            if line[:1] in _FIRST_OF_COMMENT and find_comment_text(line) is not None:
                continue
            self.number += 1
            if is_plain and '"' not in line:
                cells = line.split(separator)
            else:
                cells = split_cells(line, separator)
            if len(cells) == self.count:
                rows.append(Row(self.number, cells))
            elif self.needed <= len(cells) < self.count:
                rows.append(Row(self.number, cells + [""] * (self.count - len(cells))))
            else:
                cells = drop_empty_end(cells, self.count)
                rows.append(Row(self.number, cells, self._describe_defect(cells)))
        return rows

    def _describe_defect(self, cells: list[str]) -> str:
        """Say whether a row has too few or too many cells; return an empty text if neither.

        The cells are those without empty ones at the end.
        """
        if len(cells) == self.count:
            return ""
        if not cells:
            return "has a quote that is not closed"
        count = "1 cell" if len(cells) == 1 else f"{len(cells)} cells"
        reason = f"has {count} between {SEPARATOR_NAMES[self.separator]}, not {self.count}"
        if self.separator == "," and len(cells) > self.count:
            reason += " (numbers with decimal commas need quotes, or semicolons between them)"
        return reason
