"""The figure `sensor`: the film with its electrodes, and the probe."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.patches import Polygon

from pvdf_fem.report.kind import Content, Inputs, Kind
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.curves import WIDTH_MM
from pvdf_fem.view.figures import COLOURS, draw_film, make_figure


class Sensor(Kind):
    """The film with its electrodes and the probe, to scale."""

    kind: Literal["sensor"]

    stem: ClassVar[str] = "sensor"
    rank: ClassVar[int] = 8

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """None, but the scene is checked."""
        self.scene(inputs)
        return []

    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """A map to scale."""
        scene, frame = self.scene(inputs), []
        figure = make_figure(WIDTH_MM, WIDTH_MM - 6.0)
        ax = figure.subplots()
        for touch in scene.loaded_probes:
            edge = 1e3 * np.array(touch.outline.shape.exterior.coords)
            ax.add_patch(Polygon(edge, facecolor=COLOURS[1], alpha=0.45, edgecolor="none"))
        draw_film(ax, scene.film.radius_mm, scene.electrode_list)
        for electrode in scene.electrode_list:
            x, y = 1e3 * electrode.outline.centroid
            frame.append((electrode.name, x, y, 1e6 * electrode.outline.area))
        film, probe = scene.film, ", probe filled" * bool(scene.loaded_probes)
        text = f"Film of {2.0 * film.radius_mm:g} mm and {film.thickness_um:g} µm{probe}."
        columns = ["electrode", "x_mm", "y_mm", "area_mm2"]
        return Content(text, pd.DataFrame(frame, columns=columns), figure)
