"""The common part of kinds that draw charges along curves, with data as rings."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.report.kind import ElectrodeKind, Inputs, get_place_mm
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.curves import Panel, PanelAxes, draw_curves, make_curve_axes
from pvdf_fem.view.labels import READING_LABELS


@dataclass(frozen=True, eq=False)
class SceneSeries:
    """The scenes along a curve.

    Parameters
    ----------
    base : Scene
        A scene that differs from the others only in the value along the curve.
    names : tuple of m str
        Electrodes whose charges are drawn.
    x : tuple of n float
        Values along the curve.
    scenes : list of n Scenes
        The scenes to solve.
    panel : str, optional
        End of the panel's title.
    curve : str, optional
        Name of the curve; each electrode then has a panel. By default the electrodes are curves in
        one panel.
    data_pC : array (n, m), optional
        Charges of data in pC.
    """

    base: Scene
    names: tuple[str, ...]
    x: tuple[float, ...]
    scenes: list[Scene]
    panel: str | None = None
    curve: str | None = None
    data_pC: Array | None = None


@dataclass(frozen=True, eq=False)
class CurveData:
    """The data of a figure with curves.

    Parameters
    ----------
    frame : DataFrame
        A row for each charge of the curves, then for each charge of the data.
    rows : list of lists of Panel
        The panels row by row.
    x_label, y_label : str
        Labels of the axes.
    caption : str
        Text below the figure.
    """

    frame: pd.DataFrame
    rows: list[list[Panel]]
    x_label: str
    y_label: str
    caption: str


class CurveKind(ElectrodeKind):
    """A kind that draws charges along curves."""

    missing_rows: ClassVar[str] = "that is on a curve"  #: Describes data that lack such a row.
    x_column: ClassVar[str] = "x"  #: Column of the CSV file with the values along a curve.

    @abstractmethod
    def list_series(self, inputs: Inputs) -> list[SceneSeries]:
        """Return the series of scenes, panel by panel."""

    @abstractmethod
    def find_on_curve(self, series: SceneSeries, scene: Scene) -> float | None:
        """Return the value of a scene along the curve of a series, None for one beside it."""

    @abstractmethod
    def format_x_label(self) -> str:
        """Return the label of the horizontal axis."""

    @abstractmethod
    def describe_curves(self) -> str:
        """Return the sentence of the caption about the curves."""

    @property
    def is_logarithmic(self) -> bool:
        """Whether both axes have logarithmic scales."""
        return False

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return the scenes of the curves, then those of the data on the curves."""
        series = self.list_series(inputs)
        data = self._list_data(inputs, series)
        self.require_rows(data, self.missing_rows)
        scenes = []
        for one in [*series, *data]:
            scenes += one.scenes
        return scenes

    def collect_data(self, inputs: Inputs, results: ReportResults) -> CurveData:
        """Return the charges of the curves, and of the data on the curves."""
        series = self.list_series(inputs)
        reading = self.resolve_reading(inputs)
        tables = [_make_table(results, one, reading) for one in series]
        for one in self._list_data(inputs, series):
            table = _make_table(results, one, reading)
            tables.append(table[table.charge_pC.notna()])
        frame = pd.concat([table for table in tables if len(table)], ignore_index=True)
        if not frame.computed_pC.notna().any():
            raise NothingToShowError("none of the scenes has charges")
        caption = self.describe_curves()
        rings = self.describe_rings(inputs)
        if rings:
            caption += f"{rings} Below: computed less these, in percent."
        return CurveData(
            frame=frame.rename(columns={"x": self.x_column}),
            rows=_arrange_panels(frame),
            x_label=self.format_x_label(),
            y_label=READING_LABELS[reading],
            caption=caption,
        )

    def make_axes(self, data: CurveData) -> list[list[PanelAxes]]:
        """Return the axes of the panels."""
        return make_curve_axes(data.rows)

    def draw(self, data: CurveData, axes: list[list[PanelAxes]]) -> None:
        """Draw the curves and the data."""
        draw_curves(
            data.rows,
            axes,
            x_label=data.x_label,
            y_label=data.y_label,
            is_logarithmic=self.is_logarithmic,
        )

    def make_caption(self, data: CurveData) -> str:
        """Return the sentences about curves and data."""
        return data.caption

    def _list_data(self, inputs: Inputs, series: list[SceneSeries]) -> list[SceneSeries]:
        """Return a series of one scene for each row of the data on a curve.

        A row belongs to the first such curve of each panel.
        """
        readings = self.find_readings(inputs)
        if readings is None:
            return []
        data: dict[Any, SceneSeries] = {}
        for one in series:
            scenes = readings.make_scenes(one.base)
            charges = readings.get_charges(scenes, one.names, self.resolve_reading(inputs))
            for row, scene in enumerate(scenes):
                x = self.find_on_curve(one, scene)
                panel = (row, one.names, one.panel)
                if x is not None and panel not in data:
                    data[panel] = replace(one, x=(x,), scenes=[scene], data_pC=charges[[row]])
        return list(data.values())


def _make_table(results: ReportResults, series: SceneSeries, reading: str) -> pd.DataFrame:
    """Return a row for each charge of a series, with its panel, curve and place.

    Parameters
    ----------
    results : ReportResults
        The charges.
    series : SceneSeries
        The scenes.
    reading : {"total", "change"}
        Which charges are shown.
    """
    count = len(series.names)
    frame = results.make_table(series.scenes, series.names, reading, series.data_pC)
    if series.curve is None:
        panels: Any = ""
        curves: Any = frame.electrode
    else:
        panels = "electrode " + frame.electrode
        if series.panel:
            panels = panels + f", {series.panel}"
        curves = series.curve
    frame.insert(0, "panel", panels)
    frame.insert(1, "curve", curves)
    frame.insert(2, "x", np.repeat(series.x, count))
    if all(scene.single_probe for scene in series.scenes):
        places = [get_place_mm(scene) for scene in series.scenes]
        frame[["x_mm", "y_mm"]] = np.repeat(places, count, axis=0)
    return frame


def _arrange_panels(frame: pd.DataFrame) -> list[list[Panel]]:
    """Return the panels of a table in rows of two, three or one, electrodes side by side."""
    panels = [Panel(str(title), rows) for title, rows in frame.groupby("panel", sort=False)]
    divisor = math.gcd(len(panels), frame.electrode.nunique())
    columns = next(count for count in (2, 3, 1) if divisor % count == 0)
    return [panels[i : i + columns] for i in range(0, len(panels), columns)]
