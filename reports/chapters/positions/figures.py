"""Pictures of located cases: contours of all electrodes, the probe, and the places found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.maps.triangulation import Triangulation
from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE, new_figure, save, style
from pvdf_fem.scene.outline import Circle, Outline
from reports.chapters.positions.location import Answer, Way
from reports.common.thesis_data import TriangulationPoint

Array = NDArray[np.float64]

#: Half the width of a panel.
REACH_MM = 15.0
DASHES = (0, (3, 1.5))
# matplotlib's stubs ask for literal keys
_RING: dict[str, Any] = {
    "marker": "o",
    "ls": "none",
    "mfc": "none",
    "mec": "black",
    "ms": 6.0,
    "mew": 1.0,
}
_LINES_PLACE: dict[str, Any] = {
    "marker": "x",
    "ls": "none",
    "color": "black",
    "ms": 5.0,
    "mew": 1.0,
}
_FIT: dict[str, Any] = {
    "marker": "D",
    "ls": "none",
    "mfc": COLOURS[5],
    "mec": "black",
    "ms": 4.0,
    "mew": 0.6,
}
_TARGET: dict[str, Any] = {"marker": "+", "ls": "none", "color": GREY, "ms": 13.0, "mew": 1.0}


@dataclass(frozen=True)
class Panel:
    """One picture of a case.

    Attributes
    ----------
    title : str
    answer : Answer
    printed : sequence of TriangulationPoint
        The thesis's places of this case.
    close : bool
        Whether it shows the surroundings of the target only.
    """

    title: str
    answer: Answer
    printed: Sequence[TriangulationPoint] = ()
    close: bool = False


def picture(panels: Sequence[Panel], path: Path) -> None:
    """Panels in two columns, with one legend below."""
    rows = (len(panels) + 1) // 2
    with style():
        figure = new_figure(170, 84 * rows + 16)
        axes = list(figure.subplots(rows, 2, squeeze=False).flat)
        for ax, panel in zip(axes, panels, strict=False):
            _draw(ax, panel)
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        figure.legend(handles=_legend(panels), loc="outside lower center", ncols=3)
        save(figure, path)


def scene_outlines(ax: Axes, scene: Scene, *, probe: bool = True) -> None:
    """Electrodes with their names on the outer side, and the probe."""
    for electrode, ink in zip(scene.electrode_list, COLOURS, strict=False):
        _outline(ax, electrode.outline, fc="0.93", ec=ink, lw=1.0)
        centre = 1e3 * electrode.outline.centroid
        x, y = centre * (1.0 + 2.9 / np.linalg.norm(centre))
        ax.text(x, y, electrode.name, color=ink, ha="center", va="center", clip_on=True)
    if probe and scene.probe is not None:
        _outline(ax, scene.probe.outline, fc="none", ec=GREY, lw=1.0)


def frame(ax: Axes, title: str, reach_mm: float, centre_mm: Sequence[float] = (0.0, 0.0)) -> None:
    """Limits, labels and title of a map."""
    x, y = centre_mm
    ax.set(xlim=(x - reach_mm, x + reach_mm), ylim=(y - reach_mm, y + reach_mm))
    ax.set(xlabel="x (mm)", ylabel="y (mm)", title=title, aspect="equal")


def draw_contours(ax: Axes, way: Way, dashed: bool = False) -> None:
    """Contours in the colours of their electrodes."""
    for one, ink in zip(way.contours, COLOURS, strict=False):
        look: dict[str, Any] = {"ls": DASHES, "lw": 0.9} if dashed else {"ls": "-", "lw": 1.3}
        for curve in one.curves:
            ax.plot(*curve.polyline_mm.T, color=ink, **look)


def _draw(ax: Axes, panel: Panel) -> None:
    answer, target = panel.answer, panel.answer.case.target_mm
    scene_outlines(ax, answer.case.scene, probe=not panel.close)
    draw_contours(ax, answer.true)
    draw_contours(ax, answer.lines, dashed=True)
    ax.plot(*target, **_TARGET)
    ax.plot(*answer.fit.position_mm, **_FIT)
    found = answer.lines.found
    if panel.close:
        _close(ax, panel, found)
        return
    for point in panel.printed:
        if point.item == "average":
            ax.plot(point.x_mm, point.y_mm, **_RING)
    ax.plot(*found.position_mm, **_LINES_PLACE)
    frame(ax, panel.title, REACH_MM)


def _close(ax: Axes, panel: Panel, found: Triangulation) -> None:
    """The places of all triples, ours joined with the thesis's, with their names."""
    places = [panel.answer.case.target_mm]
    printed = {}
    for point in panel.printed:
        if np.isfinite(point.x_mm) and point.item != "target":
            places.append(np.array([point.x_mm, point.y_mm]))
            printed[point.item] = places[-1]
            ax.plot(*places[-1], **_RING)
            mean = point.item == "average"
            _name(ax, places[-1], "mean" if mean else point.item, (0, 8 if mean else -9))
    for triangle in found.located:
        name, place = "".join(triangle.electrodes), triangle.position_mm
        places.append(place)
        ax.plot(*place, **_LINES_PLACE)
        if name in printed:
            ax.plot(*np.stack([place, printed[name]], axis=-1), color=GREY, lw=0.6)
        else:
            _name(ax, place, name, (-5, 5))
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    reach = max(0.65 * float((high - low).max()), 0.25)
    frame(ax, panel.title, reach, (0.5 * (low + high)).tolist())


def _name(ax: Axes, place: Array, name: str, offset: tuple[float, float]) -> None:
    """A name beside a place."""
    across = offset[0]
    ax.annotate(
        name,
        place.tolist(),
        offset,
        textcoords="offset points",
        ha="left" if across > 0 else "right" if across < 0 else "center",
        va="center",
        fontsize=LABEL_SIZE - 1.0,
        zorder=1.9,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
    )


def _legend(panels: Sequence[Panel]) -> list[Line2D]:
    entries = [
        Line2D([], [], color=GREY, lw=1.3, label="contours, true orientation"),
        Line2D([], [], color=GREY, lw=0.9, ls=DASHES, label="contours by the thesis's method"),
        Line2D([], [], **_TARGET, label="probe's centre"),
        Line2D([], [], **_FIT, label="ours, least squares"),
        Line2D([], [], **_LINES_PLACE, label="ours, thesis's method"),
    ]
    if any(np.isfinite(p.x_mm) and p.item != "target" for one in panels for p in one.printed):
        entries.append(Line2D([], [], **_RING, label="thesis"))
    return entries


def _outline(ax: Axes, outline: Outline, **look: Any) -> None:
    if isinstance(outline, Circle):
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        corners = outline.centre + outline.radius * unit
    else:
        corners = outline.vertices
    ax.add_patch(Polygon(1e3 * corners, **look))
