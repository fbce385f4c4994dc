"""Pictures of located cases: contours of all electrodes, the probe, and the located places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE
from reports.chapters.positions.location import Crossing, LocatedCase
from reports.common.figures import draw_outline, drawing, frame
from reports.common.thesis_data import TriangulationPoint
from reports.thesis_methods.triangulation import Triangulation

Array = NDArray[np.float64]

#: Half the width of a panel in mm.
REACH_MM = 15.0
#: Dashes of contours by the thesis's method.
DASHES = (0, (3, 1.5))
# Looks of the markers; the annotation is there because matplotlib's stubs ask for literal keys.
_POINT: dict[str, Any] = {"ls": "none", "mew": 1.0}
_RING = {**_POINT, "marker": "o", "mfc": "none", "mec": "black", "ms": 6.0}
_LINES_PLACE = {**_POINT, "marker": "x", "color": "black", "ms": 5.0}
_FIT = {**_POINT, "marker": "D", "mfc": COLOURS[5], "mec": "black", "ms": 4.0, "mew": 0.6}
_TARGET = {**_POINT, "marker": "+", "color": GREY, "ms": 13.0}


@dataclass(frozen=True)
class Panel:
    """One picture of a case.

    Attributes
    ----------
    title : str
    answer : Answer
    printed : sequence of TriangulationPoint
        The places that the thesis prints for this case.
    close : bool
        Whether the picture shows only the surroundings of the target.
    """

    title: str
    answer: LocatedCase
    printed: Sequence[TriangulationPoint] = ()
    close: bool = False


def picture(panels: Sequence[Panel], path: Path) -> None:
    """Panels in two columns, with one legend below."""
    rows = (len(panels) + 1) // 2
    with drawing(path, 170, 84 * rows + 16) as figure:
        axes = list(figure.subplots(rows, 2, squeeze=False).flat)
        for ax, panel in zip(axes, panels, strict=False):
            _draw(ax, panel)
        for ax in axes[len(panels) :]:
            ax.set_visible(False)
        figure.legend(handles=_legend(panels), loc="outside lower center", ncols=3)


def scene_outlines(ax: Axes, scene: Scene, *, probe: bool = True) -> None:
    """Outlines of the electrodes, with their names on the outer side, and of the probe."""
    for electrode, ink in zip(scene.electrode_list, COLOURS, strict=False):
        draw_outline(ax, electrode.outline, fc="0.93", ec=ink, lw=1.0)
        centre = 1e3 * electrode.outline.centroid
        x, y = centre * (1.0 + 2.9 / np.linalg.norm(centre))
        box = {"fc": "white", "ec": "none", "pad": 1.0}
        look: dict[str, Any] = {"ha": "center", "va": "center", "bbox": box, "zorder": 5}
        ax.text(x, y, electrode.name, color=ink, clip_on=True, **look)
    if probe and scene.single_probe is not None:
        draw_outline(ax, scene.single_probe.outline, fc="none", ec=GREY, lw=1.0)


def draw_contours(ax: Axes, crossing: Crossing, dashed: bool = False) -> None:
    """Contours of a crossing in the colours of their electrodes."""
    for contour, ink in zip(crossing.contours, COLOURS, strict=False):
        look: dict[str, Any] = {"ls": DASHES, "lw": 0.9} if dashed else {"ls": "-", "lw": 1.3}
        for curve in contour.curves:
            ax.plot(*curve.polyline_mm.T, color=ink, **look)


def _draw(ax: Axes, panel: Panel) -> None:
    located, target = panel.answer, panel.answer.case.target_mm
    scene_outlines(ax, located.case.scene, probe=not panel.close)
    draw_contours(ax, located.true)
    draw_contours(ax, located.lines, dashed=True)
    ax.plot(*target, **_TARGET)
    ax.plot(*located.fit.position_mm, **_FIT)
    triangulation = located.lines.triangulation
    if panel.close:
        _close(ax, panel, triangulation)
        return
    for point in panel.printed:
        if point.item == "average":
            ax.plot(point.x_mm, point.y_mm, **_RING)
    ax.plot(*triangulation.position_mm, **_LINES_PLACE)
    frame(ax, panel.title, REACH_MM)


def _close(ax: Axes, panel: Panel, triangulation: Triangulation) -> None:
    """The places of all triples with their names; a line joins our place with the thesis's."""
    places = [panel.answer.case.target_mm]
    printed = {}
    for point in panel.printed:
        if np.isfinite(point.x_mm) and point.item != "target":
            places.append(np.array([point.x_mm, point.y_mm]))
            printed[point.item] = places[-1]
            ax.plot(*places[-1], **_RING)
            mean = point.item == "average"
            _name(ax, places[-1], "mean" if mean else point.item, (0, 8 if mean else -9))
    for triangle in triangulation.located:
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
    """Write a name beside a place, `offset` points away."""
    across = offset[0]
    ax.annotate(
        name,
        place.tolist(),
        offset,
        textcoords="offset points",
        ha="left" if across > 0 else "right" if across < 0 else "center",
        va="center",
        fontsize=LABEL_SIZE - 1.0,
        zorder=2.5,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.9, "pad": 0.5},
    )


def _legend(panels: Sequence[Panel]) -> list[Line2D]:
    entries = [
        Line2D([], [], color=GREY, lw=1.3, label="contours, true orientation"),
        Line2D([], [], color=GREY, lw=0.9, ls=DASHES, label="contours by the thesis's method"),
        Line2D([], [], **_TARGET, label="probe's centre"),
        Line2D([], [], **_FIT, label="ours, least squares"),
        Line2D([], [], **_LINES_PLACE, label="ours, thesis's method"),
    ]
    if any(
        np.isfinite(point.x_mm) and point.item != "target"
        for panel in panels
        for point in panel.printed
    ):
        entries.append(Line2D([], [], **_RING, label="thesis"))
    return entries
