"""Tables in text as instruments and spreadsheets write them, and reading them."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import NamedTuple

from pvdf_fem.readings.formats import TABLE_FORMATS, parse_csv
from pvdf_fem.readings.selection import (
    NumberColumns,
    choose_readings,
    choose_times,
    is_time_column,
)
from pvdf_fem.readings.text.header import make_name_test
from pvdf_fem.readings.text.numbers import CellError

ELECTRODES = ("A", "B", "C", "D")


class ReadTable(NamedTuple):
    """The numbers of a table: for each row a list, or the reason why it is refused."""

    rows: list[list[float] | str]
    unit: str | None
    words: dict[tuple[str, str], int]
    range_words: dict[tuple[str, str], int]


def read_table(text: str | bytes, *, electrodes=ELECTRODES, unit=None, is_live=False) -> ReadTable:
    """Read the times, if there are any, and the readings of electrodes."""
    content = text.encode() if isinstance(text, str) else text
    has_name = make_name_test(electrodes)

    def is_wanted(column):
        return has_name(column) or is_time_column(column)

    if is_live:
        table = TABLE_FORMATS[".csv"](io.BytesIO(content), "a stream", is_wanted, None)
    else:
        table = parse_csv(content, "a file", is_wanted)
    chosen, unit = choose_readings(table, electrodes, unit)
    times = choose_times(table)
    columns = [*([times] if times else []), *chosen.values()]
    numbers = NumberColumns(table, columns)
    rows: list[list[float] | str] = []
    for batch in table.batches:
        for row in batch:
            try:
                rows.append(numbers.read(row))
            except CellError as error:
                rows.append(str(error))
    return ReadTable(rows, unit, dict(numbers.words), dict(numbers.range_words))


@dataclass(frozen=True)
class Dialect:
    """How a program writes a table."""

    separator: str = ","
    decimal: str = "."
    grouping: str = ""  #: Between groups of three digits.
    minus: str = "-"
    is_quoted: bool = False
    unit_style: str = ""  #: A heading with a unit, such as ``{} ({})``; empty for none.
    has_unit_row: bool = False
    preamble: tuple[str, ...] = ()
    comments: tuple[str, ...] = ()  #: After the header.
    row_end: str = ""  #: Further separators at the end of each row.
    header_end: str = ""
    line_end: str = "\n"
    encoding: str = "utf-8"
    missing: str = ""
    padding: str = ""  #: Blanks around cells.
    order: tuple[int, ...] = field(default=(0, 1, 2, 3, 4))

    def format_number(self, digits: int, places: int) -> str:
        """Format the number digits / 10^places."""
        text = f"{abs(digits):0{places + 1}d}"
        whole = text[: len(text) - places]
        groups = []
        while whole:
            groups.insert(0, whole[-3:])
            whole = whole[:-3]
        fraction = self.decimal + text[len(text) - places :] if places else ""
        return (self.minus if digits < 0 else "") + self.grouping.join(groups) + fraction

    def write(self, rows: list[list[tuple[int, int] | None]], unit: str = "mV") -> bytes:
        """Write rows of numbers (digits, places), or None where one is missing."""
        names = ["t", *ELECTRODES]
        units = ["ms", *[unit] * 4]
        has_units = bool(self.unit_style) or self.has_unit_row
        headings = names if has_units else ["t_ms", *ELECTRODES]
        if self.unit_style:
            headings = [self.unit_style.format(*pair) for pair in zip(names, units, strict=True)]
        lines = [*self.preamble, self.join(headings) + self.header_end]
        if self.has_unit_row:
            lines.append(self.join(units) + self.row_end)
        lines += self.comments
        for row in rows:
            cells = [self.missing if cell is None else self.format_number(*cell) for cell in row]
            lines.append(self.join(cells) + self.row_end)
        return "".join(line + self.line_end for line in lines).encode(self.encoding)

    def join(self, cells: list[str]) -> str:
        """Join cells in the order of the columns, in quotes where they need them."""
        texts = []
        for index in self.order:
            cell = cells[index]
            needs_quotes = self.separator in cell
            quote = '"' if self.is_quoted or needs_quotes else ""
            texts.append(f"{self.padding}{quote}{cell}{quote}{self.padding}")
        return self.separator.join(texts)
