"""Kinds of figures and tables: the scenes to solve, and the content made from their charges.

A kind is a class in a file of `kinds/` and a line of `registry.py`. Its fields are its keys in
report scripts. `scenes` and `tasks` are asked before solves, `compose` after every scene and task
is done.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pydantic import Field

from pvdf_fem.arrays import Array
from pvdf_fem.report.data import Changes, Name, Readings
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import Task
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error, suggest

QUICK_TOLERANCE = 1e-2  #: Least tolerance of the scenes of a preview.
PLACE = ("probe.x_mm", "probe.y_mm")  #: Keys of the place of the probe.


@contextmanager
def prefix_errors(key: str) -> Iterator[None]:
    """Report scenes' mistakes within the context as mistakes at a report script's key."""
    try:
        yield
    except SceneError as error:
        raise SceneError([f"{key}: {told}" for told in error.problems]) from None
    except ValueError as error:
        raise SceneError([f"{key}: {error}"]) from None


@dataclass(frozen=True)
class Inputs:
    """Inputs common to the figures and tables of a report."""

    scene: Scene
    data: Mapping[str, Readings]
    quick: bool = False  #: Whether the report is a preview, of few scenes to a coarse tolerance.

    def scene_of(self, *changes: Mapping[str, Any]) -> Scene:
        """The scene with changes, in a preview no finer than `QUICK_TOLERANCE`."""
        scene = self.scene
        with prefix_errors("set"):
            for table in changes:
                scene = scene.with_(**table) if table else scene
        if self.quick and scene.numerics.tolerance < QUICK_TOLERANCE:
            scene = scene.with_(**{"numerics.tolerance": QUICK_TOLERANCE})
        return scene


@dataclass(frozen=True)
class Content:
    """What a kind draws and writes."""

    caption: str
    frame: pd.DataFrame  #: What is drawn, with all digits: a CSV file.
    figure: Figure | None = None
    shown: pd.DataFrame | None = None  #: A table for the page, of texts.
    claim: str = ""  #: What is found, with its number: a clause of the verdict.


class Kind(Section):
    """Keys of every figure and table.

    `title` is the heading, `name` the name of the files. `set` changes the report's scene here: ``{
    "film.d31_pC_N" = 18.0 }``. `data` names a table ``[data.NAME]``. `reading` says whether charges
    are drawn in ``total``, or the ``change`` by the touch; by default as in the data. `summary`
    shows the picture on the first screen. `full` has values of keys for reports made with
    ``--full``: ``{ touches = 2000 }``.
    """

    title: str = ""
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$")] | None = None
    set: Changes = Field(default_factory=dict)
    data: Name | None = None
    reading: Literal["total", "change"] | None = None
    summary: bool = False
    full: dict[str, Any] = Field(default_factory=dict)

    stem: ClassVar[str] = "figure"  #: Name of its files where none is given.
    rank: ClassVar[int] = 9  #: Its place among the candidates for the first screen.

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The scenes whose charges it draws. Raises `SceneError` with mistakes by its keys."""
        return []

    def tasks(self, inputs: Inputs) -> Sequence[Task]:
        """Further computations. Raises `SceneError` with mistakes by its keys."""
        return ()

    @abstractmethod
    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """What it draws of ``solved.charges(...)`` and ``solved.rows(task)``; raises
        `NothingToShow` where too many of its scenes have no charges, or a task has no rows."""

    def scene(self, inputs: Inputs) -> Scene:
        """The report's scene with the changes of `set`."""
        return inputs.scene_of(self.set)

    def readings(self, inputs: Inputs) -> Readings | None:
        """The data that it names."""
        if self.data is None:
            return None
        if self.data not in inputs.data:
            known = list(inputs.data)
            advice = suggest(self.data, known) if known else "add a table [data.NAME]"
            raise SceneError(
                [format_error("data", self.data, f"is no data of the report; {advice}")]
            )
        readings = inputs.data[self.data]
        return readings.thinned() if inputs.quick else readings

    def read_as(self, inputs: Inputs) -> str:
        """What is drawn, of `total` and `change`."""
        readings = self.readings(inputs)
        return self.reading or (readings.reading if readings else "total")

    def rings(self, inputs: Inputs) -> str:
        """What the caption says of the data."""
        readings = self.readings(inputs)
        return f" Rings: {readings.source.what} charges." if readings else ""

    def require_rows(self, rows: Any, lack: str) -> None:
        """SceneError for data without a drawn row."""
        if self.data is not None and not rows:
            reason = f"has no row {lack}; change the data or `set`"
            raise SceneError([format_error("data", self.data, reason)])


class ElectrodeKind(Kind):
    """A kind about some electrodes, by default all."""

    electrodes: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the electrodes; SceneError for others, or one twice."""
        known, given = [electrode.name for electrode in scene.electrode_list], self.electrodes
        if given is None:
            return tuple(known)
        problems = [
            format_error(
                "electrodes", name, f"is no electrode of the scene; {suggest(name, known)}"
            )
            for name in given
            if name not in known
        ]
        if len({*given}) < len(given):
            problems.append(format_error("electrodes", list(given), "has a name twice; remove one"))
        if problems:
            raise SceneError(problems)
        return given


def differ_only_in(keys: Sequence[str], scene: Scene, other: Scene) -> bool:
    """Whether two scenes are equal but for numbers by some keys."""
    try:
        return other.with_(**{key: get_number(scene, key) for key in keys}) == scene
    except (SceneError, AttributeError, LookupError, TypeError):  # one has no such key
        return False


def place_probe(scene: Scene, places_mm: Array) -> list[Scene]:
    """The scene with its probe at places (n, 2); SceneError without a probe, or room for it."""
    with prefix_errors("set"):
        if scene.single_probe is None:
            reason = "has no probe to place; add [probe] to it, or probe.shape here"
            raise SceneError([format_error("scene", "(no probe)", reason)])
    with prefix_errors("reach_mm"):
        return [scene.with_(**dict(zip(PLACE, at, strict=True))) for at in places_mm.tolist()]


def get_place_mm(scene: Scene) -> Array:
    """Place (2,) of the probe."""
    return np.array([get_number(scene, key) for key in PLACE])
