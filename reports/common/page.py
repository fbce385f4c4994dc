"""The HTML page of a report: sections of text, tables and figures, in one directory.

A page refers to its figures and CSV files by relative links, so that the directory can be moved,
zipped and opened from disk. A section that failed stays on the page with its error.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from pydantic import TypeAdapter

from pvdf_fem.files import replacing

#: Cells with more characters than this are broken into lines.
PROSE_CHARACTERS = 60
#: Tables with more columns than this are printed in a smaller type.
WIDE_COLUMNS = 10
#: Tables with more rows than this scroll in a box of their own, except in print.
LONG_ROWS = 30


@dataclass(frozen=True)
class Link:
    """A cell that leads to a section of the same page."""

    section: str
    text: str

    def __html__(self) -> str:
        """The link for a page, which does not escape it again."""
        return f'<a href="#{escape(self.section)}">{escape(self.text)}</a>'


Cell: TypeAlias = str | int | float | Link | None


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    key, label : str
        Head of the column in the CSV file, and on the page.
    digits : int or None
        Decimals of numbers on the page, None for as many as a number needs; the CSV file has all.
    group : str
        Head on the page that neighbouring columns of the same group share.
    signed : bool
        Whether positive numbers have a sign on the page.
    on_page : bool
        Whether the column is on the page; it is always in the CSV file.
    """

    key: str
    label: str
    digits: int | None = 1
    group: str = ""
    signed: bool = False
    on_page: bool = True

    def show(self, cell: Cell) -> str | Link:
        """The text of a cell on the page; a missing value is an en dash."""
        if isinstance(cell, Link):
            return cell
        if cell is None or (isinstance(cell, float) and math.isnan(cell)):
            return "–"
        if isinstance(cell, str):
            return cell
        form = "g" if self.digits is None else f".{self.digits}f"
        return with_minus(format(cell, f"+{form}" if self.signed else form))


@dataclass(frozen=True)
class Table:
    """A table on the page, with a CSV file `name`.csv."""

    name: str
    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]

    @property
    def file(self) -> str:
        """Name of the CSV file."""
        return f"{self.name}.csv"

    @property
    def shown(self) -> list[Column]:
        """The columns on the page."""
        return [column for column in self.columns if column.on_page]

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Heads above several columns, each with the number of columns; none if all are empty."""
        heads = (column.group for column in self.shown)
        spans = [(name, len(list(run))) for name, run in groupby(heads)]
        return spans if any(name for name, _ in spans) else []

    @property
    def size(self) -> str:
        """Classes for the style sheet: some of ``wide``, ``wordy`` and ``long``."""
        is_wide = len(self.shown) > WIDE_COLUMNS
        has_prose = any(kind == "prose" for row in self.shown_rows for _, kind in row)
        is_wordy = has_prose and not is_wide
        classes = {"wide": is_wide, "wordy": is_wordy, "long": len(self.rows) > LONG_ROWS}
        return " ".join(name for name, is_so in classes.items() if is_so)

    @property
    def heads(self) -> list[tuple[str, str]]:
        """Label of each column on the page, with the class of its first cell."""
        first = self.shown_rows[0] if self.rows else [("", "text") for _ in self.shown]
        return [(head.label, kind) for head, (_, kind) in zip(self.shown, first, strict=True)]

    @property
    def shown_rows(self) -> list[list[tuple[str | Link, str]]]:
        """The cells on the page, each with its class: ``number``, ``text`` or ``prose``."""
        return [
            [
                (column.show(cell), _kind(cell))
                for column, cell in zip(self.columns, row, strict=True)
                if column.on_page
            ]
            for row in self.rows
        ]

    def write_csv(self, directory: Path) -> None:
        """Write all columns with all digits; cells of missing values are empty."""
        with (
            replacing(directory / self.file) as unfinished,
            unfinished.open("w", encoding="utf-8", newline="") as stream,
        ):
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([column.key for column in self.columns])
            writer.writerows([[_plain(cell) for cell in row] for row in self.rows])


@dataclass(frozen=True)
class Picture:
    """A figure: a file in the page's directory."""

    file: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A section of a page: paragraphs, then pictures and tables in their order.

    `error` is the message of a section that could not be made; `note` says why a section is not
    complete.
    """

    name: str
    title: str
    paragraphs: Sequence[str] = ()
    blocks: Sequence[Table | Picture] = ()
    error: str = ""
    note: str = ""

    @property
    def state(self) -> str:
        """What the list of contents says behind the title; empty for a complete section."""
        return "failed" if self.error else self.note

    def write_tables(self, directory: Path) -> None:
        """Write the CSV files of the section's tables."""
        for block in self.blocks:
            if isinstance(block, Table):
                block.write_csv(directory)


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes
    ----------
    title, introduction, sections
    provenance : dict
        How the page was made: name and value of each line of the footer.
    is_preview : bool
        Whether the report was made with ``--quick``, so that its numbers are no results.
    home : str
        Relative link to the page that leads to all reports; empty without one.
    """

    title: str
    introduction: Sequence[str]
    sections: Sequence[Section]
    provenance: dict[str, str] = field(default_factory=dict)
    is_preview: bool = False
    home: str = ""

    @property
    def pictures(self) -> list[Picture]:
        """The pictures of all sections."""
        blocks = [block for section in self.sections for block in section.blocks]
        return [block for block in blocks if isinstance(block, Picture)]

    def shown(self, cell: str | Link) -> str | Link:
        """A cell of a table; a link to a section that this page does not have is its text."""
        names = {section.name for section in self.sections}
        return cell.text if isinstance(cell, Link) and cell.section not in names else cell

    def html(self) -> str:
        """The page as HTML text."""
        return rendered("page.html.j2", page=self)

    def write(self, directory: Path, file: str = "index.html") -> Path:
        """Write the page and, for the landing page, its content as JSON; return the page's path.

        A reader never meets a half-written page.
        """
        path = directory / file
        write_text(path, self.html())
        write_text(path.with_suffix(".json"), _PAGE.dump_json(self).decode())
        return path

    @staticmethod
    def read(path: Path) -> Page:
        """The content of a page that `write` wrote; a number that was NaN is None.

        Raises `OSError` without the file beside the page and `ValueError` if that is damaged.
        """
        return _PAGE.validate_json(path.with_suffix(".json").read_bytes())


_PAGE = TypeAdapter(Page)


def rendered(template: str, **context: Any) -> str:
    """HTML text of a template of this folder."""
    environment = Environment(
        loader=PackageLoader("reports.common", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests["table"] = lambda block: isinstance(block, Table)
    return environment.get_template(template).render(**context)


def write_text(path: Path, text: str) -> None:
    """Write a text file, of which a reader never meets a half."""
    with replacing(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def with_minus(number: str) -> str:
    """A formatted number with minus signs instead of hyphens."""
    return number.replace("-", "−")


def signed(value: float, digits: int = 1) -> str:
    """A number with its sign, for text."""
    return with_minus(f"{value:+.{digits}f}")


def joined(words: Sequence[str]) -> str:
    """Words as a list in a sentence: ``a, b and c``."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _plain(cell: Cell) -> Cell:
    if isinstance(cell, Link):
        return cell.text
    return None if isinstance(cell, float) and math.isnan(cell) else cell


def _kind(cell: Cell) -> str:
    if not isinstance(cell, str | Link):
        return "number"
    if isinstance(cell, Link):
        return "prose"
    return "prose" if len(cell) > PROSE_CHARACTERS else "text"
