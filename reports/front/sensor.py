"""Chapter of the thesis report: the sensor, and its film as one touch deforms it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from scipy.interpolate import LinearNDInterpolator

from pvdf_fem import Scene, solve
from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS, LABEL_SIZE
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.solution.solution import Solution
from reports.common.chapter import Chapter, Content
from reports.common.figures import draw_outline, drawing
from reports.common.page import Picture
from reports.common.results import Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene

#: How often the film in space is deeper than it is wide.
EXAGGERATION = 4.0
#: Half the side of the square plate that holds the film, in mm.
PLATE_MM = 60.0
PLATE_LOOK: dict[str, Any] = {"facecolor": "0.9", "edgecolor": "black", "linewidth": 0.8}
ELECTRODE_LOOK: dict[str, Any] = {"facecolor": COLOURS[5], "edgecolor": "black", "linewidth": 0.6}


def _scenes(thesis: Thesis) -> list[Scene]:
    """The touch of section 3.1.2: 1 N on a triangle between the electrodes."""
    return [thesis_scene("4", "tri7", x_mm=5.0714, y_mm=0.8757)]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    [scene] = _scenes(thesis)
    solution = solve(scene)
    film = DeflectedFilm(solution)
    with drawing(out / "sensor.svg", 110, 130) as figure:
        _draw_sensor(figure, scene, film)
    with drawing(out / "sensor_film.png", 130, 75) as figure:
        _draw_film(figure, film)
    charges = ", ".join(f"{name} {pC:.0f}" for name, pC in solution.charges_pC.items())
    force = f"{scene.load.force_N:g} N on a triangle"
    return Content(
        [
            f"A film of {scene.film.thickness_um:g} µm and {2 * scene.film.radius_mm:g} mm is "
            "stretched over the hole of a plate. What presses on it stretches it further, and four "
            "electrodes collect the charge of the stress beneath them. From the four charges "
            "place, force and rotation of the touch are sought.",
        ],
        [
            Picture(
                "sensor.svg",
                f"The sensor from above, and cut along x through the probe under {force}: the "
                f"film sinks by {solution.deflection_max_mm:.1f} mm.",
            ),
            Picture(
                "sensor_film.png",
                f"The film under {force}, drawn {EXAGGERATION:g} times deeper than it is. Charges "
                f"in pC: {charges}.",
            ),
        ],
    )


class DeflectedFilm:
    """Deflections of a solution at any places, in mm."""

    def __init__(self, solution: Solution) -> None:
        grid, deflection = solution.basis.refinterp(solution.displacement[:, 2], nrefs=2)
        self.scene, self.radius_mm = solution.scene, solution.scene.film.radius_mm
        places, first = np.unique(np.round(1e3 * grid.p.T, 6), axis=0, return_index=True)
        self._interpolate = LinearNDInterpolator(places, 1e3 * deflection[first], fill_value=0.0)

    def at(self, x_mm: Array, y_mm: Array) -> Array:
        """Deflections upwards; 0 beyond the film's rim."""
        deflections: Array = -self._interpolate(x_mm, y_mm)
        return deflections

    def lifted(self, outline: Outline) -> Array:
        """Corners of an outline on the film, (n, 3)."""
        x, y = 1e3 * np.array(outline.shape.exterior.segmentize(5e-4).coords)[:, :2].T
        return np.stack([x, y, self.at(x, y)], axis=-1)


def _draw_sensor(figure: Figure, scene: Scene, film: DeflectedFilm) -> None:
    plan, cut = figure.subplots(2, height_ratios=[120, 26], sharex=True)
    plan.add_patch(
        Rectangle((-PLATE_MM, -PLATE_MM), *2 * [2 * PLATE_MM], fc="0.9", ec="black", lw=0.8)
    )
    plan.add_patch(Circle((0.0, 0.0), film.radius_mm, fc="white", ec="black", lw=1.0))
    for electrode in scene.electrode_list:
        draw_outline(plan, electrode.outline, **ELECTRODE_LOOK)
        x, y = 1e3 * electrode.outline.centroid * 1.5
        plan.text(x, y, electrode.name, ha="center", va="center", fontsize=LABEL_SIZE)
    draw_outline(plan, scene.loaded_probes[0].outline, fc="none", ec=COLOURS[1], lw=1.4)
    plan.text(12.0, 5.0, "probe", color=COLOURS[1], va="center", fontsize=LABEL_SIZE)
    plan.text(0.0, -30.0, "PVDF film", ha="center", fontsize=LABEL_SIZE)
    plan.text(0.0, -54.5, "plate", ha="center", fontsize=LABEL_SIZE)
    plan.grid(False)
    plan.set(ylabel="y (mm)", aspect="equal", xlim=(-62, 62), ylim=(-62, 62))
    _draw_cut(cut, scene, film)


def _draw_cut(ax: Axes, scene: Scene, film: DeflectedFilm) -> None:
    """The section along x through the probe."""
    x_mm, y_mm = 1e3 * scene.loaded_probes[0].outline.centroid
    for left in (-PLATE_MM, film.radius_mm):
        width = PLATE_MM - film.radius_mm
        ax.add_patch(Rectangle((left, -5.0), width, 5.0, **PLATE_LOOK))
    x = np.linspace(-film.radius_mm, film.radius_mm, 721)
    ax.plot(x, film.at(x, np.full_like(x, y_mm)), color=COLOURS[0])
    ax.annotate(
        f"{scene.load.force_N:g} N",
        (x_mm, -2.5),
        (x_mm, 7.0),
        color=COLOURS[1],
        ha="center",
        fontsize=LABEL_SIZE,
        arrowprops={"arrowstyle": "->", "color": COLOURS[1], "lw": 1.4},
    )
    ax.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal", ylim=(-9, 13))
    ax.grid(False)


def _draw_film(figure: Figure, film: DeflectedFilm) -> None:
    figure.set_layout_engine("none")  # the frame about axes in space is far too large
    ax: Any = figure.add_axes((0.0, -0.32, 0.85, 1.5), projection="3d", computed_zorder=False)
    radius, angle = np.linspace(0.0, film.radius_mm, 121), np.linspace(0.0, 2.0 * np.pi, 241)
    x, y = np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))
    z = film.at(x, y)
    film_look: dict[str, Any] = {"cmap": "Blues_r", "rcount": 121, "ccount": 241, "linewidth": 0.0}
    surface = ax.plot_surface(x, y, z, antialiased=False, **film_look)
    for line in range(20, 120, 20):
        ax.plot(x[line], y[line], z[line], color="white", lw=0.5, alpha=0.7, zorder=2)
    for line in range(0, 240, 20):
        ax.plot(x[:, line], y[:, line], z[:, line], color="white", lw=0.5, alpha=0.7, zorder=2)
    ax.plot(x[-1], y[-1], z[-1], color="black", lw=1.0, zorder=3)
    for electrode in film.scene.electrode_list:
        corners = film.lifted(electrode.outline)
        ax.add_collection3d(Poly3DCollection([corners], zorder=4, **ELECTRODE_LOOK))
        ax.text(*(corners.mean(axis=0) * [1.6, 1.6, 1.0]), electrode.name, zorder=5)
    ax.plot(*film.lifted(film.scene.loaded_probes[0].outline).T, color=COLOURS[1], lw=1.6, zorder=5)
    depth = float(-z.min())
    ax.set_box_aspect((2 * film.radius_mm, 2 * film.radius_mm, EXAGGERATION * depth), zoom=1.45)
    ax.view_init(elev=38.0, azim=-60.0)
    ax.set_axis_off()
    scale = figure.add_axes((0.86, 0.15, 0.025, 0.7))
    figure.colorbar(surface, cax=scale, label="z of the film (mm)")
    scale.grid(False)


SENSOR_CHAPTER = Chapter("sensor", "The sensor under a touch", (), _scenes, _compose)
