"""A part of a report: the simulations it needs, and the content made of their outcomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pvdf_fem.page import Picture, Table
from reports.comparison import Comparison, compare, simulations_of
from reports.simulation import Outcomes, Simulation
from reports.thesis_data import Charge, Thesis


@dataclass(frozen=True)
class Content:
    """What a section shows."""

    paragraphs: list[str]
    blocks: list[Table | Picture]


@dataclass(frozen=True)
class Part:
    """A section of the report and how to make it.

    Attributes
    ----------
    name, title : str
        Of the section; the name is also its anchor.
    simulations : callable
        From the thesis's numbers to the simulations that the section needs.
    compose : callable
        From the thesis's numbers, the outcomes of those simulations and the output directory to
        the content. It writes its pictures; its tables are written by who calls it.
    """

    name: str
    title: str
    simulations: Callable[[Thesis], list[Simulation]]
    compose: Callable[[Thesis, Outcomes, Path], Content]


def comparing(
    name: str,
    title: str,
    choose: Callable[[Thesis], list[Charge]],
    compose: Callable[[list[Comparison], Path], Content],
) -> Part:
    """A part that compares some of the thesis's charges with ours."""
    return Part(
        name,
        title,
        lambda thesis: simulations_of(choose(thesis)),
        lambda thesis, outcomes, out: compose(compare(choose(thesis), outcomes), out),
    )
