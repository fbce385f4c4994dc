"""Lines as programs print them on serial monitors: labelled numbers, and times before an arrow."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pvdf_fem.readings.text.numbers import has_number

#: Number of first lines of which one must be such a line, for the text to be rewritten.
MAX_LINES = 50

#: A line with a time of day in front of it, as serial monitors add it.
_ARROW = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}[.,]\d+)\s+->\s+(.*)")
_FIRST_CELL = re.compile(r"[;,|\s]")
#: A number with a label, such as ``A:0.5``, as serial plotters read it.
_LABELLED = re.compile(r"([^\W\d][\w.]*)\s*[:=]\s*([-+.\dA-Za-z]+)")
#: Such numbers with separators between them.
_LABELLED_LINE = re.compile(
    rf"\s*{_LABELLED.pattern}(?:(?:\s*[,;]\s*|\s+){_LABELLED.pattern})*[\s,;]*"
)


def rewrite_serial_lines(lines: Iterator[list[str]]) -> Iterator[list[str]]:
    """Yield the lines of a table; those of a serial monitor become rows below a header.

    Lines of numbers with labels, such as ``A:0.5,B:0.7`` or ``A=0.5 B=0.7``, become rows with
    commas between the cells. The first such line decides the columns; the cell of a missing label
    is empty. A time of day before an arrow, as in ``10:00:00.125 -> 0.5,0.7``, becomes the first
    cell. Other texts are unchanged.

    Parameters
    ----------
    lines : iterator of list of str
        Lines as they arrive.
    """
    rewriter = _LineRewriter()
    count = 0
    for batch in lines:
        if rewriter.is_table or (count >= MAX_LINES and not rewriter.is_needed):
            yield batch
            continue
        count += len(batch)
        rewritten: list[str] = []
        for line in batch:
            rewritten += [line] if rewriter.is_table else rewriter.rewrite(line)
        yield rewritten


class _LineRewriter:
    """Rewrites lines one by one; the first labelled line decides the columns."""

    def __init__(self) -> None:
        self.is_table = False  #: Whether numbers have come first, so that no line is rewritten.
        self.has_arrows = False
        self.labels: list[str] = []

    @property
    def is_needed(self) -> bool:
        """Whether a line of a serial monitor has been found."""
        return self.has_arrows or bool(self.labels)

    def rewrite(self, line: str) -> list[str]:
        """Return the line or the row that it becomes, after the header if it is the first row."""
        arrow = _ARROW.fullmatch(line)
        time = ""
        if arrow is not None:
            self.has_arrows = True
            time = arrow[1].replace(",", ".")
            line = arrow[2]
        labelled = self._rewrite_labelled(line, time)
        if labelled:
            return labelled
        if arrow is None:
            self.is_table = not self.is_needed and has_number(_FIRST_CELL.split(line.strip())[0])
            return [line]
        separator = _guess_separator(line)
        is_header = not any(map(has_number, line.split(separator)))
        first_cell = "time" if is_header else time
        return [f"{first_cell}{separator}{line}"]

    def _rewrite_labelled(self, line: str, time: str) -> list[str]:
        """Return the row of a line with labels, after the header if it is the first row.

        The list is empty for a line without labels.

        Parameters
        ----------
        line : str
            The line without its time.
        time : str
            Time of day of the line, or an empty text.
        """
        if (":" not in line and "=" not in line) or not _LABELLED_LINE.fullmatch(line):
            return []
        cells = dict(_LABELLED.findall(line))
        is_single = len(cells) < 2 and not self.labels  # as in a preamble: "Rate: 1000"
        if is_single or not all(map(has_number, cells.values())):
            return []
        header_time = "time," if time else ""
        row_time = f"{time}," if time else ""
        rows = []
        if not self.labels:
            self.labels = list(cells)
            rows.append(f"{header_time}{','.join(self.labels)}")
        values = [cells.get(label, "") for label in self.labels]
        rows.append(f"{row_time}{','.join(values)}")
        return rows


def _guess_separator(line: str) -> str:
    """Return the separator of a line after an arrow: a semicolon, tab, comma or blank."""
    for separator in ";\t,":
        if separator in line:
            return separator
    return " " if " " in line.strip() else ","
