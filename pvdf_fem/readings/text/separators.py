"""Separators between the cells of a line."""

from __future__ import annotations

import csv
import re

#: Separators, the preferred ones first. A blank stands for any number of blanks and tabs.
SEPARATORS = (";", "\t", "|", ",", " ")
#: Separators that do not occur in the names of columns, where commas and blanks do.
NEVER_IN_NAMES = (";", "\t", "|")
SEPARATOR_NAMES = {
    ";": "semicolons",
    "\t": "tabs",
    "|": "bars",
    ",": "commas",
    " ": "blanks",
}
COMMENT_MARKERS = ("#", "%", "//")  #: Texts at the beginning of lines of comments.

_SPREADSHEET_ERROR = re.compile(r"#(?:[A-Z]+(?:/0)?[!?]|N/?[AV]\b|NAN\b)", re.IGNORECASE)
_BLANKS = re.compile(r"[ \t]+")
_SEPARATOR_LINE = re.compile(r'"?sep=(\\t|tab|.)"?[\s,;]*', re.IGNORECASE)


def split_cells(line: str, separator: str) -> list[str]:
    """Split a line into cells.

    Parameters
    ----------
    line : str
        A line of a table without its end. Cells may be in double quotes.
    separator : str
        One of `SEPARATORS`.

    Returns
    -------
    list of str
        The cells with the blanks around them. The list is empty if a quote is not closed.
    """
    if separator == " ":
        line = line.strip(" \t")
    if '"' not in line:
        return _BLANKS.split(line) if separator == " " else line.split(separator)
    if separator == " ":
        line = line.replace("\t", " ")
    without_blanks = re.sub(rf'"[ \t]+(?={re.escape(separator)}|$)', '"', line)
    for text in (line, without_blanks):
        reader = csv.reader([text], delimiter=separator, skipinitialspace=True, strict=True)
        try:
            return next(reader, [])
        except csv.Error:  # a blank between a quote and the separator, or an open quote
            continue
    return []


def drop_empty_end(cells: list[str], count: int = 0) -> list[str]:
    """Return cells without empty ones at the end, but at least the first `count` of them."""
    length = len(cells)
    while length > count and not cells[length - 1].strip():
        length -= 1
    return cells[:length]


def find_comment_text(line: str) -> str | None:
    """Return the text of a comment line without its marker, and None for any other line.

    A row that begins with an error of a spreadsheet, such as ``#DIV/0!``, is not a comment.
    """
    stripped = line.lstrip()
    if _SPREADSHEET_ERROR.match(stripped):
        return None
    for marker in COMMENT_MARKERS:
        if stripped.startswith(marker):
            return stripped.lstrip("#%/ \t")
    return None


def parse_separator_line(line: str) -> str | None:
    """Return the separator that a first line such as ``sep=;`` of Excel names, or None."""
    match = _SEPARATOR_LINE.fullmatch(line)
    if match is None:
        return None
    name = match[1].lower()
    return "\t" if name in ("\\t", "tab") else name
