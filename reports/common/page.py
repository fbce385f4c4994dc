"""The HTML page of a report: sections of text, tables and figures, in one directory.

A page refers to its figures and CSV files by relative links, so that the directory can be moved,
zipped and opened from disk. A section that failed stays on the page with its error.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined

from pvdf_fem.files import replacing

# Texts longer than this are broken into lines.
PROSE = 60

Cell: TypeAlias = str | float | int | None


@dataclass(frozen=True)
class Column:
    """A column: `key` heads it in the CSV, `label` on the page, under `group` if it has one.

    `digits` are the decimals of numbers on the page, None for as many as a number needs; the CSV
    keeps all. A column with `on_page` false is in the CSV only.
    """

    key: str
    label: str
    digits: int | None = 1
    group: str = ""
    signed: bool = False
    on_page: bool = True

    def show(self, cell: Cell) -> str:
        """A cell as the page shows it: an en dash for what there is not."""
        if cell is None or (isinstance(cell, float) and math.isnan(cell)):
            return "–"
        if isinstance(cell, str):
            return cell
        form = "g" if self.digits is None else f".{self.digits}f"
        return format(cell, f"+{form}" if self.signed else form).replace("-", "−")


@dataclass(frozen=True)
class Table:
    """A table with its CSV file, `name`.csv."""

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
        """Heads that span several columns, with the number of columns; none if all are empty."""
        spans = [(name, len(list(run))) for name, run in groupby(c.group for c in self.shown)]
        return spans if any(name for name, _ in spans) else []

    @property
    def shown_rows(self) -> list[list[tuple[str, str]]]:
        """The cells on the page, each with its class: ``number``, ``text`` or ``prose``."""
        pairs = [list(zip(self.columns, row, strict=True)) for row in self.rows]
        return [[(c.show(cell), _kind(cell)) for c, cell in row if c.on_page] for row in pairs]

    def write_csv(self, directory: Path) -> None:
        """Write all columns, numbers in full; empty cells for what there is not."""
        with (
            replacing(directory / self.file) as part,
            part.open("w", encoding="utf-8", newline="") as stream,
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

    `error` is the message of a section that could not be made, `note` what keeps it incomplete.
    """

    name: str
    title: str
    paragraphs: Sequence[str] = ()
    blocks: Sequence[Table | Picture] = ()
    error: str = ""
    note: str = ""

    @property
    def state(self) -> str:
        """What the contents list says behind the title: nothing if all is well."""
        return "failed" if self.error else self.note

    def write_tables(self, directory: Path) -> None:
        """Write the CSV files of its tables."""
        for block in self.blocks:
            if isinstance(block, Table):
                block.write_csv(directory)


@dataclass(frozen=True)
class Page:
    """A report: title, introduction, sections, and how it was made."""

    title: str
    introduction: Sequence[str]
    sections: Sequence[Section]
    provenance: dict[str, str] = field(default_factory=dict)

    def html(self) -> str:
        """The page as HTML text."""
        environment = Environment(
            loader=PackageLoader("reports.common", "."),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        environment.tests["table"] = lambda block: isinstance(block, Table)
        return environment.get_template("page.html.j2").render(page=self)

    def write(self, directory: Path) -> Path:
        """Write ``index.html`` and return its path; a reader never meets a half-written page."""
        path = directory / "index.html"
        with replacing(path) as part:
            part.write_text(self.html(), encoding="utf-8")
        return path


def _plain(cell: Cell) -> Cell:
    return None if isinstance(cell, float) and math.isnan(cell) else cell


def _kind(cell: Cell) -> str:
    if not isinstance(cell, str):
        return "number"
    return "prose" if len(cell) > PROSE else "text"
