"""A part of a report: the scenes it needs, and the content made of their records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pvdf_fem import Scene
from reports.common.comparison import Comparison, compare
from reports.common.page import Picture, Table
from reports.common.results import Results
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of


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
    shows : tuple of str
        Numbers of the thesis's figures and tables that it shows: ``Fig. 3.5``, ``Table 4.1``.
    scenes : callable
        From the thesis's numbers to the scenes that the section needs.
    compose : callable
        From the thesis's numbers, the records of those scenes and the output directory to the
        content. It writes its pictures; its tables are written by who calls it.
    """

    name: str
    title: str
    shows: tuple[str, ...]
    scenes: Callable[[Thesis], list[Scene]]
    compose: Callable[[Thesis, Results, Path], Content]


def comparing(
    name: str,
    title: str,
    shows: tuple[str, ...],
    choose: Callable[[Thesis], list[Charge]],
    compose: Callable[[list[Comparison], Path], Content],
) -> Part:
    """A part that compares some of the thesis's charges with ours."""
    return Part(
        name,
        title,
        shows,
        lambda thesis: [scene_of(charge) for charge in choose(thesis)],
        lambda thesis, results, out: compose(compare(choose(thesis), results), out),
    )
