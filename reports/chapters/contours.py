"""Chapters of the thesis report: isocharge contours of Figs 3.9 and 3.16, and of the probes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS, GREY
from pvdf_fem.sweeps.lines import direction
from reports.chapters.calibration import (
    Setting,
    TurnedMap,
    calibration_scenes,
    charge_functions,
)
from reports.chapters.mapping import FIGURES
from reports.chapters.mapping_curves import REACH_MM
from reports.chapters.positions.figures import scene_outlines
from reports.common.chapter import Chapter, Content
from reports.common.figures import drawing, frame
from reports.common.page import Cell, Column, Picture, Table, signed
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import ContourPoint, Thesis
from reports.common.thesis_scene import thesis_scene
from reports.maps.charge_map import ChargeMap
from reports.maps.isocharge import contour

Array = NDArray[np.float64]

#: Electrode at the place of another one after a reflection at the y axis.
_MIRRORED = {"A": "A", "B": "C", "C": "B"}
#: Half the width of a drawn map in mm.
MAP_MM = 15.0
#: Distances in mm from an electrode's centre towards the film's centre. A map has contours of the
#: charges there, rounded.
LEVELS_MM = (2.5, 3.2, 4.0, 5.0, 6.5, 8.0, 10.0, 12.0, 15.0, 18.0, 22.0)


# ------------------------------------------------------------------------------------ Fig. 3.9


def _first_scenes(thesis: Thesis) -> list[Scene]:
    """The scenes of Figs 3.5 and 3.7, on whose lines the contours of Fig. 3.9 lie."""
    return [scene for family in FIGURES[:2] for scene in family.scenes(thesis)]


_NOT_DRAWN = "Not drawn, since most of its solves failed."


def _enough(results: Results, scenes: Sequence[Scene]) -> bool:
    """Whether enough scenes are solved for maps: more than half."""
    return 2 * sum(results[scene].converged for scene in scenes) > len(scenes)


def first_maps(thesis: Thesis, results: Results, observable: str) -> dict[str, ChargeMap]:
    """Charge maps of the three electrodes through all solved places of the mappings.

    The mirror image at the y axis of each solved place counts as solved, too.
    """
    scenes = [scene for scene in dict.fromkeys(_first_scenes(thesis)) if results[scene].converged]
    charges: dict[str, dict[tuple[float, float], float]] = {name: {} for name in _MIRRORED}
    for scene in scenes:
        assert scene.single_probe is not None
        x, y = scene.single_probe.x_mm, scene.single_probe.y_mm
        for name, charge in results[scene].charges_pC(8.0, 8.0, observable).items():
            charges[name][x, y] = charge
            charges[_MIRRORED[name]].setdefault((-x + 0.0, y), charge)
    field = results.field(scenes[0])
    maps = {}
    for electrode in scenes[0].electrode_list:
        at_places = charges[electrode.name]
        leading = field.charge(electrode.outline, 8.0, 8.0, observable).value_and_gradient
        places, values = np.array(list(at_places)), np.array(list(at_places.values()))
        maps[electrode.name] = ChargeMap(places, values, REACH_MM, leading)
    return maps


def radius(
    charge_map: ChargeMap, start_mm: Array, angle_deg: float, charge_pC: float, near_mm: float
) -> float:
    """Distance in mm from `start_mm`, along a line, at which a map has a charge.

    Newton's method starts at the distance `near_mm`. The result is NaN if the method does not
    converge within 5 mm of it.
    """
    radius_mm = near_mm
    for _ in range(20):
        value, slope = charge_map.value_and_gradient(
            (start_mm + radius_mm * direction(angle_deg))[None]
        )
        step = (charge_pC - value[0]) / float(slope[0] @ direction(angle_deg))
        radius_mm += step
        if not abs(radius_mm - near_mm) < 5.0:
            return np.nan
        if abs(step) < 1e-7:
            return float(radius_mm)
    return np.nan


@dataclass(frozen=True)
class ComparedPoint:
    """A point of the thesis's contours beside our contour on the same line.

    Attributes
    ----------
    point : ContourPoint
    charge_pC : float
        Our charge at the point.
    radius_mm, material_mm : float
        Distances from the electrode at which our charge is that of the point: the charge from the
        electrode's edges, and that of its material.
    """

    point: ContourPoint
    charge_pC: float
    radius_mm: float
    material_mm: float

    @property
    def difference_mm(self) -> float:
        """Our radius minus the thesis's."""
        return self.radius_mm - self.point.radius_mm


def cuts(thesis: Thesis, results: Results) -> list[ComparedPoint]:
    """The points of the thesis's contours beside our contours."""
    edge, material = (
        first_maps(thesis, results, observable) for observable in (THESIS_EDGE, MATERIAL)
    )
    centres = {e.name: 1e3 * e.outline.centroid for e in _first_scenes(thesis)[0].electrode_list}
    compared = []
    for point in thesis.contours:
        name, place = point.electrode, np.array([point.x_mm, point.y_mm])
        offset = place - centres[name]
        angle = float(np.degrees(np.arctan2(offset[1], offset[0])))
        charge_pC = float(edge[name](place[None])[0])
        radii = (
            radius(charge_map[name], centres[name], angle, point.charge_pC, point.radius_mm)
            for charge_map in (edge, material)
        )
        compared.append(ComparedPoint(point, charge_pC, *radii))
    return compared


def _compose_first(thesis: Thesis, results: Results, out: Path) -> Content:
    if not thesis.contours:
        return Content(["None of its points is among the chosen ones."], [])
    if not _enough(results, _first_scenes(thesis)):
        return Content([_NOT_DRAWN], [])
    points = cuts(thesis, results)
    maps = first_maps(thesis, results, THESIS_EDGE)
    _first_picture(thesis, points, maps, out / "figure_3_9.svg")
    return Content(
        [_first_text(points, maps)],
        [
            Picture(
                "figure_3_9.svg",
                "Fig. 3.9: contours of the first scene's charges (triangle, 8 mm, 85° from A). "
                "Rings: the thesis's points; curves: ours at the same charges. Right: our radius "
                "less the thesis's; dots: with the charges of the material.",
            ),
            _cut_table(points),
        ],
    )


def _first_text(points: Sequence[ComparedPoint], maps: dict[str, ChargeMap]) -> str:
    differences = np.array([point.difference_mm for point in points])
    percent = np.array(
        [100.0 * (point.charge_pC / point.point.charge_pC - 1.0) for point in points]
    )
    errors = ", ".join(f"{name} {charge_map.error_pC:.1f}" for name, charge_map in maps.items())
    return (
        f"Our charges (thesis-edge) at the thesis's {len(points)} points differ from those that it "
        f"names by {_range(percent, 2)} %, our radii from its own by {_range(differences, 3)} mm, "
        f"{np.sqrt(np.nanmean(differences**2)):.3f} mm rms. Our contours are those of maps through "
        "the solved places of Figs 3.5 and 3.7 and their mirror images. Such a place left out is "
        f"missed by the map through the others with an rms error in pC of {errors}, more than the "
        "error between places. The thesis's contour of C is that of B for the charge of C, "
        "mirrored; here each is the electrode's own."
    )


def _range(values: Array, digits: int) -> str:
    return f"{signed(np.nanmin(values), digits)} to {signed(np.nanmax(values), digits)}"


def _first_picture(
    thesis: Thesis, points: Sequence[ComparedPoint], maps: dict[str, ChargeMap], path: Path
) -> None:
    levels = {point.point.electrode: point.point.charge_pC for point in points}
    case = points[0].point.case
    places = [(charge.x_mm, charge.y_mm) for charge in thesis.charges if charge.case == case]
    scene = thesis_scene("3", "tri7", x_mm=places[0][0], y_mm=places[0][1])
    with drawing(path, 170, 100) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        scene_outlines(left, scene)
        for name, level in levels.items():
            ink = COLOURS["ABC".index(name)]
            for curve in contour(name, maps[name], level).curves:
                left.plot(*curve.polyline_mm.T, color=ink, lw=1.2)
            of_electrode = [point for point in points if point.point.electrode == name]
            x, y = (
                [getattr(point.point, key) for point in of_electrode] for key in ("x_mm", "y_mm")
            )
            left.plot(x, y, "o", mfc="none", mec=ink, mew=1.0, ms=5.0)
            angles = [point.point.angle_deg for point in of_electrode]
            label = f"{name}, {level:g} pC"
            right.plot(
                angles, [point.difference_mm for point in of_electrode], "-", color=ink, label=label
            )
            material = [point.material_mm - point.point.radius_mm for point in of_electrode]
            right.plot(angles, material, ".", color=ink)
        frame(left, "", 14.0)
        right.axhline(0.0, color=GREY, lw=0.8)
        right.set(xlabel="angle of the line (°)", ylabel="our radius − thesis's (mm)")
        right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        keys = [
            Line2D([], [], color=GREY, label="ours, averages along edges"),
            Line2D([], [], color=GREY, ls="none", marker=".", label="ours, area of the electrode"),
            Line2D([], [], color=GREY, ls="none", marker="o", mfc="none", label="thesis"),
        ]
        figure.legend(handles=keys, loc="outside lower center", ncols=3)


def _cut_table(points: Sequence[ComparedPoint]) -> Table:
    columns = [
        Column("contour", "contour", on_page=False),
        Column("contour_of", "contour of"),
        Column("angle_deg", "line (°)", 0),
        Column("case", "case", on_page=False),
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
    for compared in points:
        point = compared.point
        row: list[Cell] = [
            point.contour,
            point.contour[-1],
            point.angle_deg,
            point.case,
            point.electrode,
        ]
        row += [point.charge_pC, point.x_mm, point.y_mm, compared.charge_pC]
        row += [
            100.0 * (compared.charge_pC / point.charge_pC - 1.0),
            point.radius_mm,
            compared.radius_mm,
        ]
        rows.append([*row, compared.difference_mm, compared.material_mm])
    return Table("figure_3_9", "Fig. 3.9: the thesis's contour points.", columns, rows)


# -------------------------------------------------------------------------------- isocharge maps


@dataclass(frozen=True)
class IsochargeMap:
    """A chapter with the isocharge contours of four electrodes; `what` begins its caption."""

    file: str
    title: str
    shows: tuple[str, ...]
    setting: Setting
    what: str


MAPS = (
    IsochargeMap(
        "figure_3_16",
        "Fig. 3.16: isocharge contours of a small disc",
        ("Fig. 3.16",),
        Setting("circle1", 0.0, 1.0),
        "Fig. 3.16: isocharge contours of all electrodes under a disc of 1 mm radius, 1 N",
    ),
    IsochargeMap(
        "isocharge_triangle",
        "Isocharge contours of the triangle",
        (),
        Setting("tri7", 0.0, 1.0),
        "Isocharge contours of all electrodes under the triangle, one corner to +y, 1 N",
    ),
    IsochargeMap(
        "isocharge_rectangle",
        "Isocharge contours of the rectangle",
        (),
        Setting("rect14x7", 0.0, 1.0),
        "Isocharge contours of all electrodes under the rectangle, long side along x, 1 N",
    ),
)


def _chosen(isocharge_map: IsochargeMap, thesis: Thesis) -> bool:
    """Whether the thesis has a figure of the map, or the chosen positions one of its probe."""
    return bool(isocharge_map.shows) or any(
        row.probe == isocharge_map.setting.probe for row in thesis.positions
    )


def _map_scenes(isocharge_map: IsochargeMap) -> Callable[[Thesis], list[Scene]]:
    return lambda thesis: calibration_scenes(
        thesis, [isocharge_map.setting] if _chosen(isocharge_map, thesis) else []
    )


def _compose_map(isocharge_map: IsochargeMap) -> Callable[[Thesis, Results, Path], Content]:
    def compose(thesis: Thesis, results: Results, out: Path) -> Content:
        if not _chosen(isocharge_map, thesis):
            return Content(["None of its positions is among the chosen ones."], [])
        if not _enough(results, calibration_scenes(thesis, [isocharge_map.setting])):
            return Content([_NOT_DRAWN], [])
        maps = charge_functions(thesis, results, isocharge_map.setting, "4")
        _map_picture(isocharge_map, maps, out / f"{isocharge_map.file}.svg")
        caption = (
            f"{isocharge_map.what}; labels in pC. Below: what a map without a solved place would "
            "miss there, for electrodes A and B, area of the dots in proportion."
        )
        return Content(
            [_map_text(isocharge_map, maps)], [Picture(f"{isocharge_map.file}.svg", caption)]
        )

    return compose


def _map_text(isocharge_map: IsochargeMap, maps: dict[str, TurnedMap]) -> str:
    charge_map = maps["A"].function
    errors = ", ".join(f"{name} {maps[name].error_pC:.2f}" for name in maps)
    largest = float(charge_map.charges_pC.max())
    return (
        f"Charges of the material, {len(charge_map.charges_pC)} places on a square lattice "
        f"(symmetry leaves fewer to solve). They reach {largest:.0f} pC with the probe on an "
        "electrode. A place left out is missed by the map through the others with an rms error in "
        f"pC of {errors}, more than the error between places, since the hole is twice as wide."
    )


def _map_picture(isocharge_map: IsochargeMap, maps: dict[str, TurnedMap], path: Path) -> None:
    with drawing(path, 165, 230) as figure:
        grid = figure.add_gridspec(2, 2, height_ratios=(5, 2))
        _draw_map(figure.add_subplot(grid[0, :]), isocharge_map, maps)
        for column, name in enumerate("AB"):
            _draw_errors(figure.add_subplot(grid[1, column]), name, maps[name].function)


def _draw_map(
    ax: Axes, isocharge_map: IsochargeMap, maps: dict[str, TurnedMap], pitch_mm: float = 0.25
) -> None:
    """Contours of all electrodes up to the edge of the map, from charges on a polar raster."""
    reach = maps["A"].reach_mm
    radii = np.linspace(0.0, reach, round(reach / pitch_mm) + 1)
    angles = np.linspace(0.0, 2.0 * np.pi, round(2.0 * np.pi * MAP_MM / pitch_mm) + 1)
    x, y = radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    scene = thesis_scene("4", isocharge_map.setting.probe)
    scene_outlines(ax, scene)
    ax.grid(False)
    ax.add_patch(Circle((0.0, 0.0), reach, fill=False, ec=GREY, lw=0.8))
    for electrode, ink in zip(scene.electrode_list, COLOURS, strict=False):
        charge_map, centre = maps[electrode.name], 1e3 * electrode.outline.centroid
        charges = charge_map.value_and_gradient(places)[0].reshape(x.shape)
        levels = _levels(charge_map, centre)
        lines = ax.contour(x, y, charges, levels, colors=[ink], linewidths=0.8)
        for label in ax.clabel(lines, levels[:-1:2], fmt="%g", fontsize=7):
            label.set(zorder=5, bbox={"fc": "white", "ec": "none", "pad": 0.4})
    frame(ax, "", reach + 0.5)


def _levels(charge_map: TurnedMap, centre_mm: Array) -> list[float]:
    """Charges in pC at `LEVELS_MM` from an electrode, rounded, each once."""
    inwards = -centre_mm / np.linalg.norm(centre_mm)
    charges = charge_map.value_and_gradient(centre_mm + np.outer(LEVELS_MM, inwards))[0]
    steps = np.where(charges > 1500.0, 100.0, np.where(charges > 500.0, 20.0, 10.0))
    return sorted(set((steps * np.round(charges / steps)).tolist()))


def _draw_errors(ax: Axes, name: str, charge_map: ChargeMap) -> None:
    sizes, places = np.abs(charge_map.left_out_pC), charge_map.positions_mm
    inside = np.linalg.norm(places, axis=1) <= charge_map.reach_mm
    places, sizes = places[inside], sizes[inside]
    largest = float(sizes.max())
    area = 1.0 + 60.0 * sizes / largest
    ax.scatter(places[:, 0], places[:, 1], area, color=COLOURS["ABCD".index(name)])
    frame(ax, f"left out: {name}, largest {largest:.1f} pC", MAP_MM + 2.0)


FIGURE_3_9_CHAPTER = Chapter(
    "figure-3-9",
    "Fig. 3.9: contours of the first scene",
    ("Fig. 3.9",),
    _first_scenes,
    _compose_first,
)
FIGURE_3_16_CHAPTER, TRIANGLE_MAP_CHAPTER, RECTANGLE_MAP_CHAPTER = (
    Chapter(of.file.replace("_", "-"), of.title, of.shows, _map_scenes(of), _compose_map(of))
    for of in MAPS
)
