"""What the reports find, in a sentence each; the numbers are read from the reports' tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from reports.common.page import Cell, Link, Page, Section, Table, signed


@dataclass(frozen=True)
class Verdict:
    """A finding of a report.

    Attributes
    ----------
    topic, sentence : str
    report : str
        Name of the report in the catalogue.
    section : str
        Name of the section that shows it.
    pictured : str
        Name of the section whose picture stands for it; empty for the same one.
    """

    topic: str
    sentence: str
    report: str
    section: str
    pictured: str = ""


#: Pages of the reports that are made, by the names of the catalogue.
Pages = Mapping[str, Page]


@dataclass(frozen=True)
class FoundTable:
    """A table of a report and the section that it stands in."""

    section: Section
    table: Table

    def cells(self, key: str) -> list[Cell]:
        """The cells of a column; raises `KeyError` if there is none of that name."""
        keys = [column.key for column in self.table.columns]
        if key not in keys:
            raise KeyError(key)
        return [row[keys.index(key)] for row in self.table.rows]

    def numbers(self, key: str) -> Array:
        """A column of numbers; NaN where one is missing."""
        return np.array(self.cells(key), dtype=float)


def tables_named(page: Page, name: str) -> list[FoundTable]:
    """The tables `name` of a page that have rows: one, or none if its section is not made."""
    return [
        FoundTable(section, block)
        for section in page.sections
        for block in section.blocks
        if isinstance(block, Table) and block.name == name and block.rows
    ]


def table(page: Page, name: str) -> FoundTable:
    """The table `name` of a page; raises `KeyError` if it is not there or empty."""
    tables = tables_named(page, name)
    if not tables:
        raise KeyError(name)
    return tables[0]


def finite(values: Array, reduce: Callable[[Array], float]) -> float:
    """A number of those values that are finite; raises `KeyError` if none is."""
    values = values[np.isfinite(values)]
    if not values.size:
        raise KeyError("no finite value")
    return float(reduce(values))


def charges(pages: Pages) -> Verdict:
    """How far our charges are from the printed ones."""
    printed = table(pages["thesis"], "charges")
    sound = [not defect for defect in printed.cells("defect_of_the_thesis")]
    differences = printed.numbers("difference_percent")[sound]
    differences = differences[np.isfinite(differences)]
    below = int((differences < 0.0).sum())
    typical, largest = (finite(np.abs(differences), size) for size in (np.median, np.max))
    sentence = (
        f"{differences.size} printed charges count. Ours differ from them by {typical:.2f} % in "
        f"the median and by {largest:.2f} % at most, with no parameter fitted. {below} of ours are "
        f"smaller: the median of ours − thesis is {signed(float(np.median(differences)), 2)} %."
    )
    return Verdict("Charges", sentence, "thesis", "summary")


def positions(pages: Pages) -> Verdict:
    """What the thesis's triangulation and least squares make of the simulated scenes."""
    names = ("positions_triangle", "positions_rectangle", "positions_uniaxial", "positions_2N")
    tables = [found for name in names for found in tables_named(pages["thesis"], name)]
    if not tables:
        raise KeyError(names)
    thesis_mm = np.concatenate([found.numbers("thesis_mm") for found in tables])
    located_mm = np.concatenate([found.numbers("least_squares_mm") for found in tables])
    lost = int(np.isnan(thesis_mm).sum())
    sentence = (
        f"Of {thesis_mm.size} simulated touches the thesis's triangulation loses {lost} and errs "
        f"by {finite(thesis_mm, np.median):.2f} mm in the median of the others. Least squares with "
        "the probe's own shape and rotation errs by at most "
        f"{finite(located_mm, np.max):.2g} mm."
    )
    return Verdict("Positions", sentence, "thesis", tables[0].section.name)


def orientation(pages: Pages) -> Verdict:
    """How much a charge tells of the rotation, and how well two charges give it back."""
    rotation = table(pages["thesis"], "table_4_1")
    thesis, ours = (finite(rotation.numbers(key), np.ptp) for key in ("A_thesis_pC", "A_ours_pC"))
    recovered = table(pages["thesis"], "recovered_unseen")
    angle, force = (
        finite(np.abs(recovered.numbers(key)), np.max)
        for key in ("angle_error_deg", "force_error_percent")
    )
    sentence = (
        f"As the rectangle turns at the centre, the charge of A changes by {ours:.1f} pC, against "
        f"{thesis:.1f} pC in the thesis. Charges A and B together give angle and force of scenes "
        f"that the fit has not seen within {angle:.1f}° and {force:.1f} %."
    )
    return Verdict("Orientation", sentence, "thesis", recovered.section.name)


def thesis_errors(pages: Pages) -> Verdict:
    """How many statements of the thesis do not hold."""
    findings = table(pages["thesis"], "findings")
    sentence = (
        f"{len(findings.table.rows)} statements of the thesis are contradicted by its own numbers "
        "or by the model. They are listed below."
    )
    links = [link.section for link in findings.cells("shown") if isinstance(link, Link)]
    return Verdict(
        "What the thesis got wrong", sentence, "thesis", findings.section.name, *links[:1]
    )


def resolution(pages: Pages) -> Verdict:
    """What the thesis's sensor and the recommended one resolve."""
    compared = table(pages["design"], "recommended")
    position, force = (compared.numbers(f"{key}_firm") for key in ("position_mm", "force_percent"))
    sentence = (
        "Over most of its area the thesis's sensor resolves the place of a touch of 1 N to "
        f"{position[-1]:.2f} mm and its force to {force[-1]:.1f} %, with charges as noisy as the "
        f"report says; the recommended design resolves {position[0]:.2f} mm and {force[0]:.1f} %."
    )
    return Verdict("What the sensor can resolve", sentence, "design", compared.section.name)


#: Each gives a verdict, or raises `KeyError` if a report that it reads is not made.
VERDICTS: tuple[Callable[[Pages], Verdict], ...] = (
    charges,
    positions,
    orientation,
    thesis_errors,
    resolution,
)
