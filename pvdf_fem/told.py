"""How results are told: a line as `repr`, text with tables as `print`, HTML in notebooks, JSON."""

from __future__ import annotations

import inspect
import math
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from html import escape
from types import FunctionType
from typing import TYPE_CHECKING, Any, ParamSpec, Self, TypeVar

import numpy as np

if TYPE_CHECKING:
    from pandas import DataFrame

Given = ParamSpec("Given")
Found = TypeVar("Found")


def with_named_arguments(function: Callable[Given, Found]) -> Callable[Given, Found]:
    """A function that tells the values and the names of arguments that it does not take."""

    @wraps(function)
    def call(*given: Given.args, **named: Given.kwargs) -> Found:
        try:
            return function(*given, **named)
        except TypeError:
            takes = inspect.signature(function)
            try:
                takes.bind(*given, **named)
            except TypeError as mistake:
                known = [*takes.parameters]
                own = known[:1] in (["self"], ["cls"])  # the object or class of a method
                values = [*map(repr, given), *(f"{name}={named[name]!r}" for name in named)]
                name = function.__qualname__.removesuffix(".__init__").rpartition(".")[2]
                told = f"{name}: {mistake} in ({', '.join(values[own:]):.200})"
                raise TypeError(f"{told}; give {', '.join(known[own:])}") from None
            raise

    return call


@dataclass(frozen=True)
class Grid:
    """A table: heading and rows of text."""

    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, columns: Mapping[str, Any], most_rows: int = 12) -> Self:
        """The first and the last rows of columns (n,) by name."""
        values = (c.ravel().tolist() if isinstance(c, np.ndarray) else c for c in columns.values())
        cells = [[_cell(value) for value in column] for column in values]
        rows, ends = tuple(zip(*cells, strict=True)), most_rows // 2
        if len(rows) > most_rows:
            rows = (*rows[:ends], ("...",) * len(columns), *rows[-ends:])
        return cls(tuple(columns), rows)

    def lines(self) -> list[str]:
        """The table in columns, the first to the left and the others to the right."""
        widths = [max(map(len, column)) for column in zip(self.heading, *self.rows, strict=True)]
        return [
            "  ".join(
                cell.ljust(width) if i == 0 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in (self.heading, *self.rows)
        ]

    def html(self) -> str:
        """The table as HTML."""

        def row(cells: Sequence[str], tag: str) -> str:
            return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

        body = "".join(row(cells, "td") for cells in self.rows)
        return f"<table><thead>{row(self.heading, 'th')}</thead><tbody>{body}</tbody></table>"


#: Parts of a told result: status, sentences (first the result's kind), tables, notes.
Parts = tuple[str, Sequence[str], Sequence[Grid], Sequence[str]]


def told(status: str, reasons: Sequence[str], tables: Sequence[Grid], notes: Sequence[str]) -> str:
    """A result as text: first the outcome, then nonempty tables, and notes."""
    blocks = [table.lines() for table in tables if table.rows]
    head = [f"{status}: {reasons[0]}", *reasons[1:]]
    return "\n\n".join("\n".join(block) for block in (head, *blocks, notes) if block)


def told_html(
    status: str, reasons: Sequence[str], tables: Sequence[Grid], notes: Sequence[str]
) -> str:
    """A result as HTML, ordered like `told`."""
    texts = ["".join(f"<p>{escape(line)}</p>" for line in some) for some in (reasons[1:], notes)]
    head = f"<p><b>{status}</b>: {escape(reasons[0])}</p>{texts[0]}"
    return head + "".join(table.html() for table in tables if table.rows) + texts[1]


class Told(ABC):
    """A result: short as `repr`, whole as `print`, HTML in notebooks, and JSON.

    Unknown attributes, and arguments of methods, are told by name.
    """

    def __init_subclass__(cls, **how: Any) -> None:
        super().__init_subclass__(**how)
        for name, found in [*vars(cls).items()]:
            if isinstance(found, FunctionType) and name[0] != "_":
                setattr(cls, name, with_named_arguments(found))
            elif isinstance(found, classmethod) and name[0] != "_":
                setattr(cls, name, classmethod(with_named_arguments(found.__func__)))

    if not TYPE_CHECKING:  # type checkers know the attributes

        def __getattr__(self, name: str) -> Any:
            known = ", ".join(known for known in dir(self) if known[0] != "_")
            raise AttributeError(f"{type(self).__name__} has no {name}; choose from {known}")

    def __str__(self) -> str:
        return told(*self.parts())

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {textwrap.shorten(self._brief(), 150)}>"

    def _repr_html_(self) -> str:
        return told_html(*self.parts())

    def _brief(self) -> str:
        """The result in a few words."""
        status, reasons, *_ = self.parts()
        return f"{status}: {reasons[0]}"

    @abstractmethod
    def parts(self) -> Parts:
        """What is told, as `told` takes it."""

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """The result as plain values for JSON."""


class Columns(Told):
    """A result that is a table."""

    @abstractmethod
    def columns(self) -> dict[str, Any]:
        """Columns (n,) by name, with units in their names."""

    def to_dataframe(self) -> DataFrame:
        """The table as a pandas DataFrame."""
        from pandas import DataFrame  # slow to import

        return DataFrame({name: np.ravel(column) for name, column in self.columns().items()})

    def to_json(self) -> dict[str, Any]:
        """Lists by the names of columns."""
        return {name: np.ravel(column).tolist() for name, column in self.columns().items()}


def charges_told(charges: Mapping[str, float], unit: str = "pC") -> str:
    """Charges by electrode in a few words."""
    few = [f"{name} {charge:.5g}" for name, charge in charges.items()][:4]
    return f"{', '.join(few)}{', ...' * (len(charges) > len(few))} {unit}"


def rounded(value: float, error: float) -> tuple[str, str]:
    """A value to the second digit of its error, or to ten digits, and the error."""
    places = [9 - math.floor(math.log10(abs(x))) for x in (value,) if x]
    places += [1 - math.floor(math.log10(x)) for x in (error,) if x]
    return f"{value:.{max(0, min(places, default=0))}f}", f"{error:.2g}"


def _cell(value: Any) -> str:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{value:.6g}" if number else "" if value is None else str(value)
