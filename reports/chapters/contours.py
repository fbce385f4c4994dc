"""Parts of the thesis report: isocharge contours, Figs 3.9 and 3.16, and maps of the probes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.maps.charge_map import ChargeMap
from pvdf_fem.maps.isocharge import contour
from pvdf_fem.maps.mapping import direction
from pvdf_fem.output.figures import COLOURS, GREY, new_figure, save, style
from reports.chapters.calibration import (
    Setting,
    Turned,
    calibration_scenes,
    charge_functions,
)
from reports.chapters.mapping_curves import REACH_MM, Family
from reports.chapters.positions.figures import frame, scene_outlines
from reports.common.page import Cell, Column, Picture, Table
from reports.common.part import Content, Part
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import ContourPoint, Thesis
from reports.common.thesis_scene import thesis_scene

Array = NDArray[np.float64]

#: The scenes of Figs 3.5 and 3.7, on whose lines the thesis's contours of Fig. 3.9 lie.
FAMILIES = (
    Family("3.5", "3", "tri7", "A", "biaxial"),
    Family("3.7", "3", "tri7", "B", "biaxial"),
)
# Other electrode of the mirror image at the y axis.
_MIRRORED = {"A": "A", "B": "C", "C": "B"}
#: Half the width of a map, and distance of the places that its contours are drawn from.
MAP_MM, RASTER_MM = 15.0, 0.5
#: Distances in mm from the electrode's centre, towards the film's, whose charges are drawn.
LEVELS_MM = (2.5, 3.2, 4.0, 5.0, 6.5, 8.0, 10.0, 12.0, 15.0, 18.0, 22.0)


# ------------------------------------------------------------------------------------ Fig. 3.9


def _first_scenes(thesis: Thesis) -> list[Scene]:
    return [scene for family in FAMILIES for scene in family.scenes(thesis)]


_NOT_DRAWN = "Not drawn, since most of its solves failed."


def _enough(results: Results, scenes: Sequence[Scene]) -> bool:
    """Whether maps can be made: most scenes are solved."""
    return 2 * sum(results[scene].converged for scene in scenes) > len(scenes)


def first_maps(thesis: Thesis, results: Results, observable: str) -> dict[str, ChargeMap]:
    """Charges of the three electrodes through all solved places of the mappings.

    The mirror image at the y axis of each place counts as solved too.
    """
    scenes = [scene for scene in dict.fromkeys(_first_scenes(thesis)) if results[scene].converged]
    known: dict[str, dict[tuple[float, float], float]] = {name: {} for name in _MIRRORED}
    for scene in scenes:
        assert scene.probe is not None
        x, y = scene.probe.x_mm, scene.probe.y_mm
        for name, charge in results[scene].charges_pC(8.0, 8.0, observable).items():
            known[name][x, y] = charge
            known[_MIRRORED[name]].setdefault((-x + 0.0, y), charge)
    field = results.field(scenes[0])
    maps = {}
    for electrode in scenes[0].electrode_list:
        charges = known[electrode.name]
        leading = field.charge(electrode.outline, 8.0, 8.0, observable).value_and_gradient
        places, values = np.array(list(charges)), np.array(list(charges.values()))
        maps[electrode.name] = ChargeMap(places, values, REACH_MM, leading)
    return maps


def radius(
    one: ChargeMap, start_mm: Array, angle_deg: float, charge_pC: float, near: float
) -> float:
    """Distance in mm from `start_mm` along a line at which a map has a charge; NaN without."""
    r = near
    for _ in range(20):
        value, slope = one.value_and_gradient((start_mm + r * direction(angle_deg))[None])
        step = (charge_pC - value[0]) / float(slope[0] @ direction(angle_deg))
        r += step
        if not abs(r - near) < 5.0:
            return np.nan
        if abs(step) < 1e-7:
            return float(r)
    return np.nan


@dataclass(frozen=True)
class Cut:
    """A point of the thesis's contours with ours on the same line.

    Attributes
    ----------
    point : ContourPoint
    charge_pC : float
        Ours at the point.
    radius_mm, material_mm : float
        Where ours has the point's charge: by the electrode's edges, and by its material.
    """

    point: ContourPoint
    charge_pC: float
    radius_mm: float
    material_mm: float

    @property
    def difference_mm(self) -> float:
        """Our radius less the thesis's."""
        return self.radius_mm - self.point.radius_mm


def cuts(thesis: Thesis, results: Results) -> list[Cut]:
    """The thesis's points with ours."""
    edge, material = (first_maps(thesis, results, o) for o in (THESIS_EDGE, MATERIAL))
    centres = {e.name: 1e3 * e.outline.centroid for e in _first_scenes(thesis)[0].electrode_list}
    found = []
    for point in thesis.contours:
        name, place = point.electrode, np.array([point.x_mm, point.y_mm])
        apart = place - centres[name]
        angle = float(np.degrees(np.arctan2(apart[1], apart[0])))
        there = float(edge[name](place[None])[0])
        radii = (
            radius(one[name], centres[name], angle, point.charge_pC, point.radius_mm)
            for one in (edge, material)
        )
        found.append(Cut(point, there, *radii))
    return found


def _compose_first(thesis: Thesis, results: Results, out: Path) -> Content:
    if not thesis.contours:
        return Content(["None of its points is among the chosen ones."], [])
    if not _enough(results, _first_scenes(thesis)):
        return Content([_NOT_DRAWN], [])
    found = cuts(thesis, results)
    maps = first_maps(thesis, results, THESIS_EDGE)
    _first_picture(thesis, found, maps, out / "figure_3_9.svg")
    return Content(
        [_first_text(found, maps)],
        [
            Picture(
                "figure_3_9.svg",
                "Fig. 3.9: contours of the first scene's charges (triangle, 8 mm, 85° from A). "
                "Rings: the thesis's points; curves: ours at the same charges. Right: our radius "
                "less the thesis's; dots: with the charges of the material.",
            ),
            _cut_table(found),
        ],
    )


def _first_text(found: Sequence[Cut], maps: dict[str, ChargeMap]) -> str:
    apart = np.array([cut.difference_mm for cut in found])
    percent = np.array([100.0 * (cut.charge_pC / cut.point.charge_pC - 1.0) for cut in found])
    errors = ", ".join(f"{name} {one.error_pC:.1f}" for name, one in maps.items())
    return (
        f"Our charges (thesis-edge) at the thesis's {len(found)} points differ from those that it "
        f"names by {_range(percent, 2)} %, our radii from its own by {_range(apart, 3)} mm, "
        f"{np.sqrt(np.nanmean(apart**2)):.3f} mm rms. Our contours are those of maps through the "
        "solved places of Figs 3.5 and 3.7 and their mirror images. Such a place left out is "
        f"missed by the map through the others with an rms error in pC of {errors}, more than the "
        "error between places. The thesis's contour of C is that of B for the charge of C, "
        "mirrored; here each is the electrode's own."
    )


def _range(values: Array, digits: int) -> str:
    low, high = np.nanmin(values), np.nanmax(values)
    return f"{low:+.{digits}f} to {high:+.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _first_picture(
    thesis: Thesis, found: Sequence[Cut], maps: dict[str, ChargeMap], path: Path
) -> None:
    charges = {cut.point.electrode: cut.point.charge_pC for cut in found}
    case = found[0].point.case
    places = [(one.x_mm, one.y_mm) for one in thesis.charges if one.case == case]
    scene = thesis_scene("3", "tri7", x_mm=places[0][0], y_mm=places[0][1])
    with style():
        figure = new_figure(170, 100)
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        scene_outlines(left, scene)
        for name, charge in charges.items():
            ink = COLOURS["ABC".index(name)]
            for curve in contour(name, maps[name], charge).curves:
                left.plot(*curve.polyline_mm.T, color=ink, lw=1.2)
            mine = [cut for cut in found if cut.point.electrode == name]
            x, y = ([getattr(cut.point, of) for cut in mine] for of in ("x_mm", "y_mm"))
            left.plot(x, y, "o", mfc="none", mec=ink, mew=1.0, ms=5.0)
            angles = [cut.point.angle_deg for cut in mine]
            label = f"{name}, {charge:g} pC"
            right.plot(angles, [c.difference_mm for c in mine], "-", color=ink, label=label)
            material = [c.material_mm - c.point.radius_mm for c in mine]
            right.plot(angles, material, ".", color=ink)
        frame(left, "", 14.0)
        right.axhline(0.0, color=GREY, lw=0.8)
        right.set(xlabel="angle of the line (°)", ylabel="our radius − thesis's (mm)")
        right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        save(figure, path)


def _cut_table(found: Sequence[Cut]) -> Table:
    columns = [
        Column("contour", "contour"),
        Column("angle_deg", "line (°)", 0),
        Column("case", "case"),
        Column("electrode", "electrode"),
        Column("charge_pC", "charge (pC)", 4),
        Column("x_mm", "x (mm)", 4),
        Column("y_mm", "y (mm)", 4),
        Column("ours_pC", "ours there (pC)", 1),
        Column("difference_percent", "diff. (%)", 2, signed=True),
        Column("thesis_mm", "thesis (mm)", 3, "radius"),
        Column("ours_mm", "ours (mm)", 3, "radius"),
        Column("difference_mm", "diff. (mm)", 3, "radius", signed=True),
        Column("material_mm", "ours, material (mm)", 3, "radius"),
    ]
    rows: list[list[Cell]] = []
    for cut in found:
        point = cut.point
        row: list[Cell] = [point.contour, point.angle_deg, point.case, point.electrode]
        row += [point.charge_pC, point.x_mm, point.y_mm, cut.charge_pC]
        row += [100.0 * (cut.charge_pC / point.charge_pC - 1.0), point.radius_mm, cut.radius_mm]
        rows.append([*row, cut.difference_mm, cut.material_mm])
    return Table("figure_3_9", "Fig. 3.9: the thesis's contour points.", columns, rows)


# -------------------------------------------------------------------------------- isocharge maps


@dataclass(frozen=True)
class MapOf:
    """An isocharge map of four electrodes."""

    file: str
    title: str
    shows: tuple[str, ...]
    setting: Setting
    what: str


MAPS = (
    MapOf(
        "figure_3_16",
        "Fig. 3.16: isocharge contours of a small disc",
        ("Fig. 3.16",),
        Setting("circle1", 0.0, 1.0),
        "Fig. 3.16: isocharge contours of all electrodes under a disc of 1 mm radius, 1 N",
    ),
    MapOf(
        "isocharge_triangle",
        "Isocharge contours of the triangle",
        (),
        Setting("tri7", 0.0, 1.0),
        "Isocharge contours of all electrodes under the triangle, one corner to +y, 1 N",
    ),
    MapOf(
        "isocharge_rectangle",
        "Isocharge contours of the rectangle",
        (),
        Setting("rect14x7", 0.0, 1.0),
        "Isocharge contours of all electrodes under the rectangle, long side along x, 1 N",
    ),
)


def _chosen(of: MapOf, thesis: Thesis) -> bool:
    """Whether it has a figure in the thesis, or its probe is among the chosen positions."""
    return bool(of.shows) or any(row.probe == of.setting.probe for row in thesis.positions)


def _map_scenes(of: MapOf) -> Callable[[Thesis], list[Scene]]:
    return lambda thesis: calibration_scenes(thesis, [of.setting] if _chosen(of, thesis) else [])


def _compose_map(of: MapOf) -> Callable[[Thesis, Results, Path], Content]:
    def compose(thesis: Thesis, results: Results, out: Path) -> Content:
        if not _chosen(of, thesis):
            return Content(["None of its positions is among the chosen ones."], [])
        if not _enough(results, calibration_scenes(thesis, [of.setting])):
            return Content([_NOT_DRAWN], [])
        maps = charge_functions(thesis, results, of.setting, "4")
        _map_picture(of, maps, out / f"{of.file}.svg")
        caption = (
            f"{of.what}; labels in pC. Below: what a map without a solved place would miss there, "
            "for electrodes A and B, area of the dots in proportion."
        )
        return Content([_map_text(of, maps)], [Picture(f"{of.file}.svg", caption)])

    return compose


def _map_text(of: MapOf, maps: dict[str, Turned]) -> str:
    one = maps["A"].function
    errors = ", ".join(f"{name} {maps[name].error_pC:.2f}" for name in maps)
    largest = float(one.charges_pC.max())
    return (
        f"Charges of the material, {len(one.charges_pC)} places on a square lattice (symmetry "
        f"leaves fewer to solve). They reach {largest:.0f} pC with the probe on an electrode. A "
        "place left out is missed by the map through the others with an rms error in pC of "
        f"{errors}, more than the error between places, since the hole is twice as wide."
    )


def _map_picture(of: MapOf, maps: dict[str, Turned], path: Path) -> None:
    with style():
        figure = new_figure(165, 230)
        grid = figure.add_gridspec(2, 2, height_ratios=(5, 2))
        _draw_map(figure.add_subplot(grid[0, :]), of, maps)
        for column, name in enumerate("AB"):
            _draw_errors(figure.add_subplot(grid[1, column]), name, maps[name].function)
        save(figure, path)


def _draw_map(ax: Axes, of: MapOf, maps: dict[str, Turned]) -> None:
    at = np.arange(-MAP_MM, MAP_MM + 1e-9, RASTER_MM)
    places = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    outside = np.linalg.norm(places, axis=1) > maps["A"].reach_mm
    scene = thesis_scene("4", of.setting.probe)
    scene_outlines(ax, scene)
    ax.grid(False)
    for electrode, ink in zip(scene.electrode_list, COLOURS, strict=False):
        one = maps[electrode.name]
        charges = np.where(outside, np.nan, one.value_and_gradient(places)[0])
        levels = _levels(one, 1e3 * electrode.outline.centroid)
        drawn = ax.contour(
            at, at, charges.reshape(len(at), -1), levels, colors=[ink], linewidths=0.8
        )
        ax.clabel(drawn, fmt="%g", fontsize=6)
    frame(ax, "", MAP_MM)


def _levels(one: Turned, centre_mm: Array) -> list[float]:
    """Round charges met at some distances from an electrode towards the film's centre."""
    inwards = -centre_mm / np.linalg.norm(centre_mm)
    charges = one.value_and_gradient(centre_mm + np.outer(LEVELS_MM, inwards))[0]
    steps = np.where(charges > 1500.0, 100.0, np.where(charges > 500.0, 20.0, 10.0))
    return sorted(set((steps * np.round(charges / steps)).tolist()))


def _draw_errors(ax: Axes, name: str, one: ChargeMap) -> None:
    sizes, places = np.abs(one.left_out_pC), one.positions_mm
    inside = np.linalg.norm(places, axis=1) <= one.reach_mm
    places, sizes = places[inside], sizes[inside]
    largest = float(sizes.max())
    area = 1.0 + 60.0 * sizes / largest
    ax.scatter(places[:, 0], places[:, 1], area, color=COLOURS["ABCD".index(name)])
    frame(ax, f"left out: {name}, largest {largest:.1f} pC", MAP_MM + 2.0)


FIGURE_3_9_PART = Part(
    "figure-3-9",
    "Fig. 3.9: contours of the first scene",
    ("Fig. 3.9",),
    _first_scenes,
    _compose_first,
)
FIGURE_3_16_PART, TRIANGLE_MAP_PART, RECTANGLE_MAP_PART = (
    Part(of.file.replace("_", "-"), of.title, of.shows, _map_scenes(of), _compose_map(of))
    for of in MAPS
)
