"""A solution as tables, in text and in HTML: charges, meshes, why it ended, what was tried."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any


@dataclass(frozen=True)
class Grid:
    """A table: its heading and its rows, all of them text."""

    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

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


def solution_text(result: dict[str, Any]) -> str:
    """The text of a solution, from its JSON."""
    return told(*_head(result), _tables(result), _remarks(result))


def solution_html(result: dict[str, Any]) -> str:
    """The HTML of a solution, from its JSON."""
    return told_html(*_head(result), _tables(result), _remarks(result))


def told(status: str, reasons: Sequence[str], tables: Sequence[Grid], notes: Sequence[str]) -> str:
    """A result as text: what matters first, tables that have rows, and notes."""
    blocks = [table.lines() for table in tables if table.rows]
    head = [f"{status}: {reasons[0]}", *reasons[1:]]
    return "\n\n".join("\n".join(block) for block in (head, *blocks, notes) if block)


def told_html(
    status: str, reasons: Sequence[str], tables: Sequence[Grid], notes: Sequence[str]
) -> str:
    """The same as HTML."""
    texts = ["".join(f"<p>{escape(line)}</p>" for line in some) for some in (reasons[1:], notes)]
    head = f"<p><b>{status}</b>: {escape(reasons[0])}</p>{texts[0]}"
    return head + "".join(table.html() for table in tables if table.rows) + texts[1]


class Told(ABC):
    """A result that is printed as text, and shown in notebooks as HTML."""

    def __str__(self) -> str:
        return told(*self._parts())

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return told_html(*self._parts())

    @abstractmethod
    def _parts(self) -> tuple[str, list[str], list[Grid], list[str]]:
        """Status, reasons, tables, and notes, as `told` takes them."""


def _head(result: dict[str, Any]) -> tuple[str, list[str]]:
    warnings = [f"warning: {text}" for text in result["warnings"]]
    return result["status"], [result.get("reason", result["stop"]), *warnings]


def _tables(result: dict[str, Any]) -> list[Grid]:
    tables: list[Grid] = []
    if charges := result.get("charges_pC"):
        columns = ["pC", "± pC"]
        if result["rest_charges_pC"]:  # not of a film that has no result without a touch
            columns += ["at rest, pC", "± pC", "change by touch, pC", "± pC"]
        rows = tuple((name, *_charge(result, name)) for name in charges)
        tables.append(Grid((f"charges ({result['observable']})", *columns), rows))
    for patch, contact in result.get("contacts", {}).items():
        titles = (f"contact of {patch}", "depth, mm", "force, N", "area, mm2", "pressure, MPa")
        shown = ("depth_mm", "force_N", "area_mm2", "mean_pressure_MPa")
        tables.append(Grid(titles, (("", *(f"{contact[key]:.6g}" for key in shown)),)))
    if readings := result.get("readings_V"):
        constants = result["time_constants_s"]
        decays = {name: "none" if s is None else f"{s:.4g}" for name, s in constants.items()}
        channels = tuple((name, f"{V:.6g}", decays[name]) for name, V in readings.items())
        tables.append(Grid(("readings at once", "V", "decay in s"), channels))
    if history := result["history"]:
        heading = ("mesh", "elements", "unknowns", "iterations", "worst error", "seconds", "ended")
        meshes = tuple(
            (
                str(number),
                str(mesh["elements"]),
                str(mesh["unknowns"]),
                str(mesh["iterations"]),
                "" if mesh["worst_error"] is None else f"{mesh['worst_error']:.1e}",
                f"{mesh['seconds']:.3f}",
                mesh["status"],
            )
            for number, mesh in enumerate(history, 1)
        )
        tables.append(Grid(heading, meshes))
    return tables


def _charge(result: dict[str, Any], name: str) -> list[str]:
    """The charge of an electrode, at rest, and since, to the same digit, each with its error."""
    cells = [*rounded(result["charges_pC"][name], result["charge_errors_pC"][name])]
    places = len(cells[0].partition(".")[2])
    for kind in ("rest_charge", "charge_change") if result["rest_charges_pC"] else ():
        value, error = (result[f"{kind}{end}"][name] for end in ("s_pC", "_errors_pC"))
        cells += [f"{value + 0.0:.{places}f}", f"{error:.2g}"]
    return cells


def _remarks(result: dict[str, Any]) -> list[str]:
    remarks = [
        f"tried on mesh {number}: {solver['solver']}, {solver['status']} after"
        f" {solver['iterations']} iterations"
        for number, mesh in enumerate(result["history"], 1)
        for solver in mesh["tried"]
    ]
    if deflection := result.get("deflection_max_mm"):
        remarks.append(f"deflection: {deflection:.4g} mm at most")
    for key, word in (("included", "included"), ("left_out", "left out")):
        remarks += [f"{word}: {text}" for text in result[key]]
    return remarks


def rounded(value: float, error: float) -> tuple[str, str]:
    """A value to the second digit of its error, or to ten digits, and the error."""
    places = [9 - math.floor(math.log10(abs(x))) for x in (value,) if x]
    places += [1 - math.floor(math.log10(x)) for x in (error,) if x]
    return f"{value:.{max(0, min(places, default=0))}f}", f"{error:.2g}"
