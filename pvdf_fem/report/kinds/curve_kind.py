"""The base class of kinds that draw charges along curves, with data as rings."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.report.kind import ElectrodeKind, Inputs, get_probe_position_mm
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.curves import Panel, PanelAxes, draw_curves, make_curve_axes
from pvdf_fem.view.labels import READING_LABELS


@dataclass(frozen=True, eq=False)
class SceneSeries:
    """The scenes along a curve, or the scene of a row of data.

    Parameters
    ----------
    base : Scene
        A scene that differs from the others only in the value along the curve.
    names : tuple of str, length m
        Names of the electrodes whose charges are drawn.
    x : tuple of float, length n
        Values along the curve.
    scenes : list of Scene, length n
        The scenes to solve.
    panel : str, optional
        Text at the end of the panel's title.
    curve : str, optional
        Name of the curve; each electrode then has a panel of its own. By default the electrodes
        are the curves of one panel.
    data_pC : ndarray, shape (n, m), optional
        Readings in pC. None for the points of a curve.
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
        A row for each charge on the curves, then a row for each reading.
    rows : list of list of Panel
        The panels row by row.
    x_label, y_label : str
        Labels of the axes, with units.
    caption : str
        Text below the figure.
    """

    frame: pd.DataFrame
    rows: list[list[Panel]]
    x_label: str
    y_label: str
    caption: str


class CurveKind(ElectrodeKind):
    """Base class of kinds that draw charges along curves."""

    #: Text after "has no row" if no row of the data is on a curve.
    missing_rows: ClassVar[str] = "that is on a curve"
    x_column: ClassVar[str] = "x"  #: Column of the CSV file with the values along a curve.

    @abstractmethod
    def list_series(self, inputs: Inputs) -> list[SceneSeries]:
        """Return the series of scenes, panel by panel. Subclasses implement this method."""

    @abstractmethod
    def find_on_curve(self, series: SceneSeries, scene: Scene) -> float | None:
        """Return the x value of a scene on the curve of a series, or None if it is not on it.

        Subclasses implement this method.
        """

    @abstractmethod
    def format_x_label(self) -> str:
        """Return the label of the horizontal axis. Subclasses implement this method."""

    @abstractmethod
    def describe_curves(self) -> str:
        """Return the caption's sentence about the curves. Subclasses implement this method."""

    @property
    def is_logarithmic(self) -> bool:
        """Whether both axes have logarithmic scales. Default: False."""
        return False

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return the scenes of the curves, then the scenes of the data on the curves."""
        series = self.list_series(inputs)
        data = self._list_data_series(inputs, series)
        self.require_rows(data, self.missing_rows)
        scenes = []
        for one in [*series, *data]:
            scenes += one.scenes
        return scenes

    def collect_data(self, inputs: Inputs, results: ReportResults) -> CurveData:
        """Collect the computed curves, the measured charges beside them, labels and caption.

        Raises
        ------
        NothingToShowError
            If no scene has computed charges.
        """
        series = self.list_series(inputs)
        reading = self.resolve_reading(inputs)
        tables = [_make_table(results, curve, reading) for curve in series]
        for points in self._list_data_series(inputs, series):
            table = _make_table(results, points, reading)
            tables.append(table[table.charge_pC.notna()])
        frame = pd.concat([table for table in tables if len(table)], ignore_index=True)
        if not frame.computed_pC.notna().any():
            raise NothingToShowError("none of the scenes has charges")
        caption = self.describe_curves()
        rings = self.describe_rings(inputs)
        if rings:
            caption += f"{rings} Lower panels: computed minus measured charges, in percent."
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
        """Draw the curves, and the readings as rings."""
        draw_curves(
            data.rows,
            axes,
            x_label=data.x_label,
            y_label=data.y_label,
            is_logarithmic=self.is_logarithmic,
        )

    def make_caption(self, data: CurveData) -> str:
        """Return the caption with sentences about curves and readings."""
        return data.caption

    def _list_data_series(self, inputs: Inputs, series: list[SceneSeries]) -> list[SceneSeries]:
        """Return a series of one scene for each row of the data on a curve.

        In each panel a row is assigned to the first curve on which it lies.
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
    """Return a row for each charge of a series, with panel, curve, x and probe position.

    Parameters
    ----------
    results : ReportResults
        Charges by scene.
    series : SceneSeries
        Scenes and electrodes of a curve.
    reading : {"total", "change"}
        Whether total charges or their changes due to the touch are shown.
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
        positions = [get_probe_position_mm(scene) for scene in series.scenes]
        frame[["x_mm", "y_mm"]] = np.repeat(positions, count, axis=0)
    return frame


def _arrange_panels(frame: pd.DataFrame) -> list[list[Panel]]:
    """Arrange panels in rows of two, three or one, with the electrodes side by side.

    The number of panels in a row divides both the number of panels and of electrodes.
    """
    panels = [Panel(str(title), rows) for title, rows in frame.groupby("panel", sort=False)]
    divisor = math.gcd(len(panels), frame.electrode.nunique())
    columns = next(count for count in (2, 3, 1) if divisor % count == 0)
    return [panels[i : i + columns] for i in range(0, len(panels), columns)]
