"""A chapter of the thesis report: the scenes that it needs, and what it makes of their records."""

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
    """The text, the pictures and the tables of a chapter."""

    paragraphs: list[str]
    blocks: list[Table | Picture]


@dataclass(frozen=True)
class Chapter:
    """A section of the thesis report and how it is made.

    Attributes
    ----------
    name, title : str
        Name and title of the section on the page; the name is also its anchor.
    shows : tuple of str
        Figures and tables of the thesis that the chapter shows: ``Fig. 3.5``, ``Table 4.1``.
    scenes : callable
        Gives the scenes that the chapter needs, from the thesis's numbers.
    compose : callable
        Makes the content from the thesis's numbers, the records of those scenes and the output
        directory. It writes the pictures; the caller writes the tables.
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
) -> Chapter:
    """A chapter that compares the printed charges which `choose` selects with computed ones."""
    return Chapter(
        name,
        title,
        shows,
        lambda thesis: [scene_of(charge) for charge in choose(thesis)],
        lambda thesis, results, out: compose(compare(choose(thesis), results), out),
    )
