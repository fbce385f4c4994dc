"""The figure `sensor`: the film with its electrodes and probes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from pvdf_fem.report.kind import FigureKind, Inputs
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import COLOURS, WIDTH_MM, draw_film


@dataclass(frozen=True, eq=False)
class SensorData:
    """A scene, and a table with the centres and areas of its electrodes."""

    scene: Scene
    frame: pd.DataFrame


class Sensor(FigureKind):
    """The film with its electrodes and the probe, to scale."""

    kind: Literal["sensor"]

    stem: ClassVar[str] = "sensor"
    rank: ClassVar[int] = 8
    size_mm: ClassVar[tuple[float, float]] = (WIDTH_MM, WIDTH_MM - 6.0)

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Validate the scene, and return no scenes because nothing has to be solved."""
        self.resolve_scene(inputs)
        return []

    def collect_data(self, inputs: Inputs, results: ReportResults) -> SensorData:
        """Return the scene with the centres and areas of its electrodes."""
        scene = self.resolve_scene(inputs)
        rows = []
        for electrode in scene.electrode_list:
            x, y = 1e3 * electrode.outline.centroid
            area_mm2 = 1e6 * electrode.outline.area
            rows.append({"electrode": electrode.name, "x_mm": x, "y_mm": y, "area_mm2": area_mm2})
        return SensorData(scene, pd.DataFrame(rows))

    def draw(self, data: SensorData, axes: Axes) -> None:
        """Draw the rim, the electrodes and the filled probes."""
        for probe_load in data.scene.loaded_probes:
            corners_mm = 1e3 * np.array(probe_load.outline.inscribed_polygon.exterior.coords)
            patch = Polygon(corners_mm, facecolor=COLOURS[1], alpha=0.45, edgecolor="none")
            axes.add_patch(patch)
        draw_film(axes, data.scene.film.outline, data.scene.electrode_list)

    def make_caption(self, data: SensorData) -> str:
        """Return a caption with the diameter and thickness of the film."""
        film = data.scene.film
        probe = ", probe filled" if data.scene.loaded_probes else ""
        return f"Film: {film.describe_outline()}, {film.thickness_um:g} µm{probe}."
