"""The figure `sensor`: the film with its electrodes, the probe, and the first mesh of a solve."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon

from pvdf_fem.arrays import Array
from pvdf_fem.film.models import film_model
from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
from pvdf_fem.output.figures import COLOURS, GREY, draw_electrode, draw_rim, new_figure
from pvdf_fem.reporting.drawing import WIDTH_MM
from pvdf_fem.reporting.kind import Content, Inputs, Kind
from pvdf_fem.reporting.solved import NothingToShow, Solved
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.first_sizes import ORDER, first_sizes


class Sensor(Kind):
    """The film with its electrodes and the probe, to scale; `mesh` draws the first mesh, too."""

    kind: Literal["sensor"]
    mesh: bool = True

    stem: ClassVar[str] = "sensor"
    rank: ClassVar[int] = 8

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """None, but the scene is checked."""
        self.scene(inputs)
        return []

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A map to scale."""
        scene, note = self.scene(inputs), ""
        figure = new_figure(WIDTH_MM, WIDTH_MM - 6.0)
        ax = figure.subplots()
        draw_rim(ax, scene.film.radius_mm, scene.film.radius_mm)
        if self.mesh:
            triangles = _triangles(scene)
            ax.add_collection(LineCollection(list(triangles), color=GREY, linewidth=0.3))
            note = f" The mesh that a solve begins with has {len(triangles)} triangles."
        for touch in scene.loaded_probes:
            edge = 1e3 * np.array(touch.outline.shape.exterior.coords)
            ax.add_patch(Polygon(edge, facecolor=COLOURS[1], alpha=0.45, edgecolor="none"))
        frame = []
        for electrode in scene.electrode_list:
            draw_electrode(ax, electrode.outline, [electrode.name])
            x, y = 1e3 * electrode.outline.centroid
            frame.append((electrode.name, x, y, 1e6 * electrode.outline.area))
        film, probe = scene.film, ", probe filled" * bool(scene.loaded_probes)
        text = f"Film of {2.0 * film.radius_mm:g} mm and {film.thickness_um:g} µm{probe}."
        columns = ["electrode", "x_mm", "y_mm", "area_mm2"]
        return Content(text + note, pd.DataFrame(frame, columns=columns), figure)


def _triangles(scene: Scene) -> Array:
    """Corners (triangles, 4, 2) in mm of the first mesh, each triangle closed."""
    sizes, jacobian = first_sizes(scene, ORDER), film_model(scene).least_jacobian
    try:
        mesh = mesh_scene(scene, sizes, least_jacobian=jacobian)
    except MeshError as error:
        raise NothingToShow(f"gmsh made no mesh: {error}") from None
    corners = 1e3 * mesh.p[:, mesh.t[[0, 1, 2, 0]]]
    return np.moveaxis(corners, 0, -1).swapaxes(0, 1)
