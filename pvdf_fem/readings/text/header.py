"""The header of a table in text: found below a preamble, by the names that it should have."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from pvdf_fem.readings.columns import Column, add_units, parse_heading, parse_unit_row
from pvdf_fem.readings.text.numbers import MAX_QUOTED, has_number
from pvdf_fem.readings.text.separators import (
    NEVER_IN_NAMES,
    SEPARATORS,
    drop_empty_end,
    find_comment_text,
    parse_separator_line,
    split_cells,
)
from pvdf_fem.readings.times import is_clock_time
from pvdf_fem.readings.units import Unit

#: Maximum number of lines in which the header is searched, and of lines between it and the first
#: row of numbers.
MAX_PREAMBLE = 1000
#: Number of lines of numbers without a header above them after which there is none.
ROWS_WITHOUT_HEADER = 3

#: A line that separates the header from the rows in tables for people to read.
_RULE = re.compile(r"[-+=|: \t]*(?:--|==)[-+=|: \t]*")

#: A comma that is not the end of a word, and separates cells rather than a name from its unit.
_COMMA_IN_WORD = re.compile(r"\S,\S")

IsWanted = Callable[[Column], bool]  #: Whether a column has one of the names that are wanted.


def make_name_test(names: Collection[str]) -> IsWanted:
    """Return a predicate of columns: whether one has one of some names, with any unit.

    Parameters
    ----------
    names : collection of str
        Names of electrodes, and of quantities with a unit such as ``x_mm``. Upper and lower case
        are the same.
    """
    wanted = set()
    for name in names:
        wanted |= {name.casefold(), parse_heading(name).name.casefold()}

    def is_wanted(column: Column) -> bool:
        return column.heading.casefold() in wanted or column.name.casefold() in wanted

    return is_wanted


@dataclass(frozen=True)
class Header:
    """The header of a table in text.

    Parameters
    ----------
    columns : tuple of Column
        The columns, with the units in the headings or in a row below them.
    separator : str
        Separator of the rows, one of `SEPARATORS`.
    needed : int
        Minimum number of cells of a row. It is less than the number of columns if the first row
        lacks the last columns, such as one for comments.
    """

    columns: tuple[Column, ...]
    separator: str
    needed: int


@dataclass(frozen=True)
class _Candidate:
    """A line that may be the header.

    Parameters
    ----------
    columns : tuple of Column
        Columns, if it is the header.
    separator : str
        The separator that yields the most of the wanted names.
    wanted : tuple of int
        Indices of the columns with wanted names.
    lines_before : int
        Number of lines before it.
    """

    columns: tuple[Column, ...]
    separator: str
    wanted: tuple[int, ...]
    lines_before: int

    def find_row_separator(self, line: str) -> str | None:
        """Return the separator of a line that is a row below this header; None for other lines.

        A row has as many cells as the header. Either all cells that are not empty are numbers, or
        half of those in the columns with wanted names are. A line with the separator of the header
        and such numbers is a row even if it has another number of cells, but a malformed one.
        """
        others = [separator for separator in SEPARATORS if separator != self.separator]
        for separator in (self.separator, *others):
            cells = split_cells(line, separator)
            has_all = len(cells) >= len(self.columns) >= len(drop_empty_end(cells))
            if has_all and (_has_only_numbers(cells) or self.has_numbers(cells)):
                return separator
        if self.has_numbers(split_cells(line, self.separator)):
            return self.separator
        return None

    def count_needed_cells(self, line: str, separator: str) -> int:
        """Return the minimum number of cells of a row.

        This is the number of columns, or that of the first row if it lacks only columns without a
        wanted name.

        Parameters
        ----------
        line : str
            The first row.
        separator : str
            Its separator.
        """
        count = len(split_cells(line, separator))
        if any(index >= count for index in self.wanted):
            return len(self.columns)
        return min(count, len(self.columns))

    def has_numbers(self, cells: Sequence[str]) -> bool:
        """Return whether at least half of the columns with wanted names have numbers in a row."""
        present = [cells[index] for index in self.wanted if index < len(cells)]
        count = sum(_is_number_or_time(cell) for cell in present)
        return 0 < len(self.wanted) <= 2 * count


class HeaderSearch:
    """A search for the header of a table in its first lines.

    The header is the line that has most of the wanted names, and no numbers. Lines before it are a
    preamble: comments, or descriptions by an instrument or a program. A row of units may follow it.
    The search ends at the first row of numbers, so that no row of a live stream has to wait.

    Parameters
    ----------
    name : str
        Name of the table, for messages.
    is_wanted : callable
        Whether a column has a wanted name.
    """

    def __init__(self, name: str, is_wanted: IsWanted) -> None:
        self.name = name
        self.is_wanted = is_wanted
        self.separators: tuple[str, ...] = SEPARATORS
        self.lines: list[str] = []
        self.candidates: list[_Candidate] = []
        self.rows_without_header = 0
        self.found: _Candidate | None = None
        self.notes: list[str] = []  #: Sentences about units that are not known.

    def add(self, line: str) -> Header | None:
        """Add the next line, and return the header as soon as it is known."""
        named = parse_separator_line(line) if not self.lines else None
        if named in SEPARATORS:
            self.separators = (named,)
            return None
        self.lines.append(line)
        is_comment = find_comment_text(line) is not None
        if not is_comment:
            for candidate in self._rank_candidates():
                separator = candidate.find_row_separator(line)
                if separator is not None:
                    needed = candidate.count_needed_cells(line, separator)
                    return self._make_header(candidate, separator, needed)
            if self._is_row_of_numbers(line):
                self.rows_without_header += 1
        possible_header = self._make_candidate(line)
        if possible_header is not None:
            self.candidates.append(possible_header)
        waits = self.candidates or self.rows_without_header < ROWS_WITHOUT_HEADER
        return None if waits and len(self.lines) < MAX_PREAMBLE else self.finish()

    def skip_labelled_rows(self, header: Header, rows: Sequence[str]) -> tuple[Header, int]:
        """Find the rows below the header that describe the channels, such as their units.

        Their first cells are labels, as in ``"VUnit","V","V"``. At least one of them has no
        numbers, and a row of numbers without a label follows them. A note names these rows.

        Parameters
        ----------
        header : Header
            The header that was found.
        rows : sequence of str
            Lines of a file below it, in which the first rows of numbers are sought.

        Returns
        -------
        header : Header
            The header, with the units of such a row.
        count : int
            Number of lines to skip.
        """
        if self.found is None or 0 in self.found.wanted:
            return header, 0
        labelled = _list_labelled_rows(self.found, header.separator, rows)
        has_numbers = [
            len(cells) >= header.needed and self.found.has_numbers(cells) for cells in labelled
        ]
        if all(has_numbers):  # also if there are none
            return header, 0
        labels = ", ".join(cells[0].strip()[:MAX_QUOTED] for cells in labelled)
        self.notes.append(f"rows below the header that describe it are not read: {labels}")
        columns = header.columns
        for cells in labelled:
            units = [None, *(parse_unit_row(cells[1:]) or [])]
            if all(index < len(units) and units[index] for index in self.found.wanted):
                columns = add_units(columns, units, self.name)
        return replace(header, columns=columns), len(labelled)

    def is_surpassed_by(self, line: str) -> bool:
        """Return whether a line below the header has more of the wanted names than the header."""
        candidate = self._make_candidate(line)
        if candidate is None or self.found is None:
            return False
        return len(candidate.wanted) > len(self.found.wanted)

    def finish(self) -> Header:
        """Return the most likely header, if no row of numbers was found below a candidate.

        If no line has a wanted name, it is the last line before the first row of numbers that is
        not a row of units.
        """
        ranked = self._rank_candidates()
        if ranked:
            best = ranked[0]
            return self._make_header(best, best.separator, len(best.columns))
        header_line = self._find_line_before_numbers()
        if header_line is None:
            return Header((), ",", needed=0)
        separators = self._list_separators_of(header_line)
        separator = max(separators, key=lambda each: len(split_cells(header_line, each)))
        index = self.lines.index(header_line)
        columns = _parse_columns(split_cells(header_line, separator))
        candidate = _Candidate(columns, separator, wanted=(), lines_before=index)
        return self._make_header(candidate, separator, len(columns))

    def _rank_candidates(self) -> list[_Candidate]:
        """Return the candidates, those with the most wanted names first; of equals, the last."""
        return sorted(reversed(self.candidates), key=lambda each: -len(each.wanted))

    def _make_candidate(self, line: str) -> _Candidate | None:
        """Make a candidate for the header from a line; return None if it cannot be one."""
        text = find_comment_text(line)
        text = line if text is None else text
        best: _Candidate | None = None
        for separator in self._list_separators_of(text):
            columns = _parse_columns(split_cells(text, separator))
            wanted = [i for i, column in enumerate(columns) if self.is_wanted(column)]
            others = [column for column in columns if not self.is_wanted(column)]
            if any(has_number(column.heading) for column in others):
                continue  # a row of numbers
            if len(columns) == 1 and "," in self.separators:
                separator = ","
            if wanted and (best is None or len(wanted) > len(best.wanted)):
                best = _Candidate(columns, separator, tuple(wanted), len(self.lines) - 1)
        return best

    def _list_separators_of(self, line: str) -> tuple[str, ...]:
        """Return the possible separators of a header.

        A blank is none of them if the line has other separators: in ``Channel A;Channel B`` and
        ``A (raw),B (raw)`` blanks are part of the names.
        """
        has_others = any(separator in line for separator in NEVER_IN_NAMES)
        if not has_others and not _COMMA_IN_WORD.search(line):
            return self.separators
        others = tuple(separator for separator in self.separators if separator != " ")
        return others or self.separators

    def _make_header(self, candidate: _Candidate, separator: str, needed: int) -> Header:
        """Make the header from a candidate, with the units in a row below it.

        Afterwards `lines` has only the rows below the header and its units.

        Parameters
        ----------
        candidate : _Candidate
            The header without units.
        separator : str
            Separator of the rows.
        needed : int
            Number of cells that a row must have.
        """
        columns = candidate.columns
        self.found = candidate
        below = self.lines[candidate.lines_before + 1 :]
        rows = [line for line in below if not _RULE.fullmatch(line)]
        for index, line in enumerate(rows):
            cells = split_cells(line, separator)
            units = None if any(map(has_number, cells)) else parse_unit_row(cells)
            if units is not None and len(units) >= len(columns) // 2:
                self.notes += _describe_unknown_units(columns, cells, units)
                columns = add_units(columns, units, self.name)
                del rows[index]
                break
        self.lines = rows
        return Header(columns, separator, needed)

    def _is_row_of_numbers(self, line: str) -> bool:
        """Return whether a line has only numbers, for any of the separators."""
        splits = [split_cells(line, separator) for separator in self.separators]
        return any(_has_only_numbers(cells) for cells in splits)

    def _is_row_of_units(self, line: str) -> bool:
        """Return whether a line is a row of units, for any of the separators."""
        splits = [split_cells(line, separator) for separator in self.separators]
        return any(len(cells) > 1 and parse_unit_row(cells) is not None for cells in splits)

    def _find_line_before_numbers(self) -> str | None:
        """Return the last line before the first row of numbers, or the first line of all."""
        previous = None
        for line in self._list_uncommented_lines():
            if previous is not None and self._is_row_of_numbers(line):
                return previous
            if previous is None or not self._is_row_of_units(line):
                previous = line
        return next(self._list_uncommented_lines(), None)

    def _list_uncommented_lines(self) -> Iterator[str]:
        """Yield the lines that are not comments."""
        for line in self.lines:
            if find_comment_text(line) is None:
                yield line


def _list_labelled_rows(
    candidate: _Candidate, separator: str, lines: Sequence[str]
) -> list[list[str]]:
    """Return the cells of the rows that begin with labels, if a row of numbers follows them.

    Parameters
    ----------
    candidate : _Candidate
        The header above the rows.
    separator : str
        Separator of the rows.
    lines : sequence of str
        Rows below the header.
    """
    labelled: list[list[str]] = []
    for line in lines:
        cells = split_cells(line, separator)
        has_label = bool(cells and cells[0].strip()) and not _is_number_or_time(cells[0])
        if not has_label:
            return labelled if candidate.has_numbers(cells) else []
        labelled.append(cells)
    return []


def _describe_unknown_units(
    columns: Sequence[Column], cells: Sequence[str], units: Sequence[Unit | None]
) -> Iterator[str]:
    """Yield a note for each cell of a row of units that is not a known unit.

    Parameters
    ----------
    columns : sequence of Column
        Columns of the header.
    cells : sequence of str
        Cells of the row.
    units : sequence of Unit or None
        The units in the cells.
    """
    has_label = units[0] is None and None not in units[1:]
    for index, (column, cell, unit) in enumerate(zip(columns, cells, units, strict=False)):
        if has_label and index == 0:
            continue  # a label such as VUnit, in front of the units of all other columns
        if cell.strip() and unit is None:
            yield f"column {column.heading}: the unit {cell.strip()[:MAX_QUOTED]!r} is not known"


def _has_only_numbers(cells: Sequence[str]) -> bool:
    """Return whether a row has at least one number or time, and otherwise only empty cells."""
    given = [cell for cell in cells if cell.strip()]
    return bool(given) and all(_is_number_or_time(cell) for cell in given)


def _is_number_or_time(cell: str) -> bool:
    """Return whether a cell has a number, a word in place of a number, a date or a time."""
    return has_number(cell) or is_clock_time(cell)


def _parse_columns(cells: list[str]) -> tuple[Column, ...]:
    """Make the columns of a header from its cells.

    Empty headings at its end are left out. A cell that is only a unit in brackets is joined to the
    heading before it, since a blank may be the separator.
    """
    headings: list[str] = []
    for cell in drop_empty_end(cells):
        heading = cell.strip(" \t\0\ufeff")  # a device that starts may send a null byte
        if headings and heading.startswith(("(", "[")) and parse_heading(f"x {heading}").unit:
            headings[-1] = f"{headings[-1]} {heading}"
        else:
            headings.append(heading)
    return tuple(parse_heading(heading) for heading in headings)
