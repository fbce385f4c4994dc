"""What the kinds that draw curves share: points of curves, and data that are on them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.reporting import drawing
from pvdf_fem.reporting.kind import Content, Inputs, OfElectrodes, place_mm
from pvdf_fem.reporting.solved import NothingToShow, Solved
from pvdf_fem.scene.scene import Scene


@dataclass(frozen=True)
class Series:
    """Scenes along a curve, for some electrodes.

    Each electrode has a panel of its own where `panel` names none, and is a curve of its own where
    `curve` names none. Titles of panels end in `panel`.
    """

    scene: Scene  #: The first one: the others differ from it along the curve only.
    names: tuple[str, ...]
    x: tuple[float, ...]
    scenes: list[Scene]
    panel: str | None = None
    curve: str | None = None


class Along(OfElectrodes):
    """A kind that draws charges along curves."""

    lack: ClassVar[str] = "that is on a curve"  #: What data lack that are not drawn.
    key: ClassVar[str] = "x"  #: Column of the places along a curve.

    @abstractmethod
    def series(self, inputs: Inputs) -> list[Series]:
        """The curves, panel by panel."""

    @abstractmethod
    def where_on(self, series: Series, scene: Scene) -> float | None:
        """The place along a curve of a scene, or None if it is not on the curve."""

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The scenes of all curves, and of the data on them."""
        series = self.series(inputs)
        rows = [scene for _, _, _, scene in self._rows(inputs, series)]
        self.require_rows(rows, self.lack)
        return [scene for one in series for scene in one.scenes] + rows

    def _rows(
        self, inputs: Inputs, series: list[Series]
    ) -> Iterator[tuple[int, Series, float, Scene]]:
        """Rows of the data with the curves that they are on, their places on them, and scenes; of
        the curves of one panel the first."""
        readings, taken = self.readings(inputs), set[Any]()
        for one in series if readings else ():
            scenes = readings.scenes(one.scene) if readings else []
            for row, scene in enumerate(scenes):
                known = (row, one.names, one.panel)
                if known not in taken and (x := self.where_on(one, scene)) is not None:
                    taken.add(known)
                    yield row, one, x, scene

    def frame(self, inputs: Inputs, solved: Solved) -> pd.DataFrame:
        """The charges of all curves, then those of the data on them."""
        series, reading, readings = self.series(inputs), self.read_as(inputs), self.readings(inputs)
        tables = [self._table(solved, one, one.scenes, one.x, reading) for one in series]
        for row, one, x, scene in self._rows(inputs, series):
            assert readings is not None
            part = readings.taken([row])
            theirs = part.charges([scene], one.names, reading)
            if np.isfinite(theirs).any():
                table = self._table(solved, one, [scene], (x,), reading, theirs)
                tables.append(table[table.charge_pC.notna()])
        return pd.concat(tables, ignore_index=True)

    def _table(
        self,
        solved: Solved,
        one: Series,
        scenes: list[Scene],
        x: tuple[float, ...],
        reading: str,
        theirs: Array | None = None,
    ) -> pd.DataFrame:
        frame = solved.table(scenes, one.names, reading, theirs)
        title = "electrode " + frame.electrode + f", {one.panel}" * bool(one.panel)
        frame.insert(0, "panel", title if one.curve is not None else "")
        frame.insert(1, "curve", frame.electrode if one.curve is None else one.curve)
        frame.insert(2, "x", np.repeat(x, len(one.names)))
        if all(scene.single_probe for scene in scenes):
            places = np.repeat([place_mm(scene) for scene in scenes], len(one.names), axis=0)
            frame[["x_mm", "y_mm"]] = places
        return frame

    def drawn(
        self,
        inputs: Inputs,
        solved: Solved,
        columns: int,
        label: str,
        caption: str,
        log: bool = False,
    ) -> Content:
        """The figure of the curves, with some panels beside each other."""
        frame = self.frame(inputs, solved)
        if not frame.computed_pC.notna().any():
            raise NothingToShow("none of the scenes has charges")
        panels = [(str(title), rows) for title, rows in frame.groupby("panel", sort=False)]
        rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
        charge = drawing.READING_LABELS[self.read_as(inputs)]
        figure = drawing.curves_figure(rows, label, charge, log)
        kept = frame.rename(columns={"x": self.key})
        return Content(caption + self.rings(inputs), kept, figure)
