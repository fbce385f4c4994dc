"""Common parts of kinds with curves: points of curves, and data on them."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.report.kind import Content, ElectrodeKind, Inputs, get_place_mm
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view import curves as drawing


@dataclass(frozen=True)
class Series:
    """Scenes along a curve, for some electrodes.

    Electrodes have their own panels unless `panel` names a key, and their own curves unless `curve`
    names a key. Titles of panels end in `panel`.
    """

    scene: Scene  #: The first one: the others differ from it along the curve only.
    names: tuple[str, ...]
    x: tuple[float, ...]
    scenes: list[Scene]
    panel: str | None = None
    curve: str | None = None
    theirs: Array | None = None  #: Charges (scenes, names) in pC of others.


class Along(ElectrodeKind):
    """A kind that draws charges along curves."""

    lack: ClassVar[str] = "that is on a curve"  #: What data lack that are not drawn.
    key: ClassVar[str] = "x"  #: Column of the places along a curve.

    @abstractmethod
    def series(self, inputs: Inputs) -> list[Series]:
        """The curves, panel by panel."""

    @abstractmethod
    def where_on(self, series: Series, scene: Scene) -> float | None:
        """The place of a scene along a curve, or None for scenes off the curve."""

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """Scenes for curves, then scenes for data rows on a curve."""
        series = self.series(inputs)
        data = self._data(inputs, series)
        self.require_rows(data, self.lack)
        return [scene for one in [*series, *data] for scene in one.scenes]

    def _data(self, inputs: Inputs, series: list[Series]) -> list[Series]:
        """The data rows on curves, in single-row tables; in a panel, a row is on the first matching
        curve."""
        readings, taken = self.readings(inputs), dict[Any, Series]()
        for one in series if readings else ():
            assert readings is not None
            scenes = readings.scenes(one.scene)
            theirs = readings.charges(scenes, one.names, self.read_as(inputs))
            for row, scene in enumerate(scenes):
                if (x := self.where_on(one, scene)) is not None:
                    found = replace(one, x=(x,), scenes=[scene], theirs=theirs[[row]])
                    taken.setdefault((row, one.names, one.panel), found)
        return list(taken.values())

    def frame(self, inputs: Inputs, solved: ReportResults) -> pd.DataFrame:
        """Charges of the curves, then charges for the data rows on a curve."""
        series, reading = self.series(inputs), self.read_as(inputs)
        tables = [self._table(solved, one, reading) for one in series]
        on_curves = [self._table(solved, one, reading) for one in self._data(inputs, series)]
        tables += [table[table.charge_pC.notna()] for table in on_curves]
        return pd.concat([table for table in tables if len(table)], ignore_index=True)

    def _table(self, solved: ReportResults, one: Series, reading: str) -> pd.DataFrame:
        frame = solved.table(one.scenes, one.names, reading, one.theirs)
        title = "electrode " + frame.electrode + f", {one.panel}" * bool(one.panel)
        frame.insert(0, "panel", title if one.curve is not None else "")
        frame.insert(1, "curve", frame.electrode if one.curve is None else one.curve)
        frame.insert(2, "x", np.repeat(one.x, len(one.names)))
        if all(scene.single_probe for scene in one.scenes):
            places = np.repeat(
                [get_place_mm(scene) for scene in one.scenes], len(one.names), axis=0
            )
            frame[["x_mm", "y_mm"]] = places
        return frame

    def drawn(
        self,
        inputs: Inputs,
        solved: ReportResults,
        label: str,
        caption: str,
        log: bool = False,
    ) -> Content:
        """The figure with the curves, two or three electrodes in a row."""
        frame = self.frame(inputs, solved)
        if not frame.computed_pC.notna().any():
            raise NothingToShowError("none of the scenes has charges")
        panels = [(str(title), rows) for title, rows in frame.groupby("panel", sort=False)]
        alike = math.gcd(len(panels), frame.electrode.nunique())
        columns = next(count for count in (2, 3, 1) if alike % count == 0)
        rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
        charge = drawing.READING_LABELS[self.read_as(inputs)]
        figure = drawing.draw_curves(rows, label, charge, log)
        kept = frame.rename(columns={"x": self.key})
        if rings := self.rings(inputs):
            caption += f"{rings} Below: computed less these, in percent."
        return Content(caption, kept, figure)
