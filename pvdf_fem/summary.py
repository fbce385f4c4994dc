"""Presentation of results: one line in `repr`, text in `print`, HTML in notebooks, and JSON.

A result derives from `Result` and returns its content as a `Summary` from its method `summary`.
Tables are formatted here instead of by pandas or rich, because importing these would delay every
command that prints a result by 0.2 s or 0.05 s.
"""

from __future__ import annotations

import math
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Self

import numpy as np

if TYPE_CHECKING:
    from pandas import DataFrame

#: Maximum number of charges in a line.
MAX_CHARGES = 4
#: Maximum length of a `repr` without the name of the class.
MAX_LINE = 150


@dataclass(frozen=True)
class TextTable:
    """A table of text cells.

    Parameters
    ----------
    heading : tuple of str
        Titles of the columns.
    rows : tuple of tuple of str
        Cells of the rows, each as long as the heading.
    """

    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def from_columns(cls, columns: Mapping[str, Any], max_rows: int = 12) -> Self:
        """Format columns of values as text, and shorten long tables.

        Parameters
        ----------
        columns : mapping of str to sequence or ndarray, length n
            Columns by title. Arrays of several dimensions are flattened.
        max_rows : int
            Maximum number of rows. In a longer table, a row of dots replaces the middle.

        Returns
        -------
        TextTable
            The table as text, with six digits for numbers and an empty cell for None.
        """
        texts = []
        for column in columns.values():
            values = column.ravel().tolist() if isinstance(column, np.ndarray) else column
            texts.append([_format_cell(value) for value in values])
        rows = list(zip(*texts, strict=True))
        if len(rows) > max_rows:
            half = max_rows // 2
            gap = ("...",) * len(columns)
            rows = [*rows[:half], gap, *rows[-half:]]
        return cls(tuple(columns), tuple(rows))

    def to_lines(self) -> list[str]:
        """Return the lines of the table; the first column is left-aligned, others right-aligned."""
        every_row = (self.heading, *self.rows)
        widths = [max(map(len, column)) for column in zip(*every_row, strict=True)]
        lines = []
        for first, *others in every_row:
            cells = [first.ljust(widths[0])]
            cells += [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
            lines.append("  ".join(cells).rstrip())
        return lines

    def to_html(self) -> str:
        """Return the table as an HTML element."""
        head = _format_html_row(self.heading, "th")
        body = "".join(_format_html_row(row, "td") for row in self.rows)
        return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


@dataclass(frozen=True)
class Summary:
    """The human-readable content of a result: a status, sentences, tables and notes.

    Parameters
    ----------
    status : str
        Outcome in a word or two, such as ``converged``.
    sentences : sequence of str
        At least one sentence. The first one follows the status on the same line, each of the
        others is a line below.
    tables : sequence of TextTable
        Tables below the sentences. Tables without rows are not shown.
    notes : sequence of str
        Lines below the tables.
    """

    status: str
    sentences: Sequence[str]
    tables: Sequence[TextTable] = ()
    notes: Sequence[str] = ()

    @property
    def headline(self) -> str:
        """The status and the first sentence."""
        return f"{self.status}: {self.sentences[0]}"

    def to_text(self) -> str:
        """Return the content as text, with empty lines around tables."""
        blocks = [[self.headline, *self.sentences[1:]]]
        blocks += [table.to_lines() for table in self.tables if table.rows]
        if self.notes:
            blocks.append(list(self.notes))
        return "\n\n".join("\n".join(lines) for lines in blocks)

    def to_html(self) -> str:
        """Return the content as HTML, in the order of `to_text`."""
        elements = [f"<p><b>{self.status}</b>: {escape(self.sentences[0])}</p>"]
        elements += [f"<p>{escape(line)}</p>" for line in self.sentences[1:]]
        elements += [table.to_html() for table in self.tables if table.rows]
        elements += [f"<p>{escape(line)}</p>" for line in self.notes]
        return "".join(elements)


class Result(ABC):
    """Base class of results, which shows them as a line, text, HTML or JSON."""

    if not TYPE_CHECKING:  # type checkers would accept any attribute

        def __getattr__(self, name: str) -> Any:
            public = ", ".join(attribute for attribute in dir(self) if attribute[0] != "_")
            raise AttributeError(f"{type(self).__name__} has no {name}; choose from {public}")

    @abstractmethod
    def summary(self) -> Summary:
        """Return the content that `print` and notebooks show. Subclasses implement this method."""

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """Return the result as plain values for JSON. Subclasses implement this method."""

    def __str__(self) -> str:
        return self.summary().to_text()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {textwrap.shorten(self._headline(), MAX_LINE)}>"

    def _repr_html_(self) -> str:
        return self.summary().to_html()

    def _headline(self) -> str:
        """Return the text of `repr`; classes with an expensive summary override this method."""
        return self.summary().headline


class TabularResult(Result):
    """Base class of results that consist of one table."""

    @abstractmethod
    def columns(self) -> dict[str, Any]:
        """Return the columns by name, with units in the names. Subclasses implement this method."""

    def to_dataframe(self) -> DataFrame:
        """Return the table as a pandas DataFrame."""
        from pandas import DataFrame  # slow to import

        return DataFrame({name: np.ravel(column) for name, column in self.columns().items()})

    def to_json(self) -> dict[str, Any]:
        """Return the columns as lists of plain values by name."""
        return {name: np.ravel(column).tolist() for name, column in self.columns().items()}


def format_charges(charges: Mapping[str, float], unit: str = "pC") -> str:
    """Format the charges of the first `MAX_CHARGES` electrodes in a line, with five digits."""
    texts = [f"{name} {charge:.5g}" for name, charge in charges.items()]
    if len(texts) > MAX_CHARGES:
        texts = [*texts[:MAX_CHARGES], "..."]
    return f"{', '.join(texts)} {unit}"


def format_with_error(value: float, error: float) -> tuple[str, str]:
    """Format a value with the decimals that are significant in view of its error.

    Parameters
    ----------
    value : float
        The value, shown up to the second digit of the error, with at most ten digits.
    error : float
        Absolute error of the value, or zero if it is unknown.

    Returns
    -------
    tuple of str
        The value, and the error with two digits.
    """
    places = []
    if value:
        places.append(9 - math.floor(math.log10(abs(value))))
    if error:
        places.append(1 - math.floor(math.log10(error)))
    decimals = max(0, min(places, default=0))
    return f"{value:.{decimals}f}", f"{error:.2g}"


def _format_cell(value: Any) -> str:
    """Format a number with six digits, None as an empty text, and other values by `str`."""
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:.6g}"
    return str(value)


def _format_html_row(cells: Sequence[str], tag: str) -> str:
    """Format a row of an HTML table, with each cell in an element named `tag`."""
    elements = "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells)
    return f"<tr>{elements}</tr>"
