"""Part of the thesis report: charge against distance on lines from an electrode (Fig. 3.5)."""

from __future__ import annotations

from itertools import count, takewhile
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from pvdf_fem import Scene
from pvdf_fem.figures import Series, charge_against_distance, new_figure, save, style
from pvdf_fem.page import Cell, Column, Picture, Table
from reports.part import Content, Part
from reports.results import MATERIAL, THESIS_EDGE, Results
from reports.thesis_data import ContourPoint, Thesis
from reports.thesis_scene import thesis_scene

#: The probe's centre stays within this distance of the film's: twice that of the electrodes. The
#: thesis maps "the central area", without a number.
USEFUL_RADIUS_MM = 20.0
#: Up to here, where the probe leaves the electrode and curves bend, the thesis's steps are halved.
BEND_MM = 12.0
ELECTRODE = "A"
CENTRE_MM = (0.0, -10.0)


def place(angle_deg: float, distance_mm: float) -> tuple[float, float]:
    """Position (x, y) in mm of the probe on a line from electrode A."""
    angle = np.radians(angle_deg)
    x, y = CENTRE_MM[0] + distance_mm * np.cos(angle), CENTRE_MM[1] + distance_mm * np.sin(angle)
    return round(float(x), 9), round(float(y), 9)


def distances(angle_deg: float, step_mm: float) -> list[float]:
    """Distances in mm from electrode A at which the probe is placed on a line."""
    steps = (step_mm * i for i in count())
    return list(
        takewhile(lambda r: np.hypot(*place(angle_deg, r)) <= USEFUL_RADIUS_MM + 1e-9, steps)
    )


def _scene(angle_deg: float, distance_mm: float) -> Scene:
    x, y = place(angle_deg, distance_mm)
    return thesis_scene("3", "tri7", x_mm=x, y_mm=y)


def cuts(thesis: Thesis) -> list[ContourPoint]:
    """Where the thesis's contour of A cuts the lines from A."""
    angles = thesis.angles_deg[ELECTRODE]
    return [c for c in thesis.contours if c.frame == ELECTRODE and c.angle_deg in angles]


def fine_distances(thesis: Thesis, angle_deg: float) -> list[float]:
    """All distances in mm that we compute on a line: more than the thesis's steps."""
    step = thesis.step_mm
    halves = [r for r in distances(angle_deg, 0.5 * step) if r < BEND_MM]
    radii = [cut.radius_mm for cut in cuts(thesis) if cut.angle_deg == angle_deg]
    return sorted({*distances(angle_deg, step), *halves, *radii})


def _scenes(thesis: Thesis) -> list[Scene]:
    return [
        _scene(angle, distance)
        for angle in thesis.angles_deg[ELECTRODE]
        for distance in fine_distances(thesis, angle)
    ]


def line(angle_deg: float, at_mm: list[float], results: Results) -> Series:
    """Charge of A in pC at some distances in mm on one line."""
    charges = [results[_scene(angle_deg, r)].charge_pC(ELECTRODE, THESIS_EDGE) for r in at_mm]
    return Series(f"{angle_deg:g}°", np.array(at_mm), np.array(charges))


def crossing(curve: Series, charge_pC: float, near_mm: float) -> float:
    """Distance in mm at which a spline through a curve's points has a charge.

    NaN where it has not, or where a solve failed.
    """
    if not np.isfinite(curve.y).all() or len(curve.x) < 2:
        return np.nan
    roots = CubicSpline(curve.x, curve.y).solve(charge_pC, extrapolate=False)
    return float(min(roots, key=lambda r: abs(r - near_mm), default=np.nan))


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    step, angles = thesis.step_mm, thesis.angles_deg[ELECTRODE]
    coarse = {angle: line(angle, distances(angle, step), results) for angle in angles}
    fine = {angle: line(angle, fine_distances(thesis, angle), results) for angle in angles}
    _picture(fine, cuts(thesis), out / "figure_3_5.svg")
    return Content(
        [
            "The triangular probe (1 N, one corner to +y) moves in steps of 4 mm from the centre "
            "of electrode A of the three-electrode sensor, as far as its centre stays within "
            f"{USEFUL_RADIUS_MM:g} mm of the film's centre. Of the thesis's curves only one cut is "
            "printed: the distances at which they reach the charge of its first scene. We compute "
            f"each line there too, and every 2 mm up to {BEND_MM:g} mm.",
            "The curves of all angles nearly coincide; the lower picture shows what tells them "
            "apart. The thesis calls the curve of 35° the uppermost and that of 90° the lowermost. "
            "That order holds around 3 mm only; from 5 mm on it is the other way round.",
            "The thesis interpolates between steps of 4 mm. What this alone does is the difference "
            "between the last two columns of the first table.",
        ],
        [
            Picture(
                "figure_3_5.svg",
                "Fig. 3.5: charge of A against distance; rings: the thesis's contour of "
                "905.1037 pC. Below: the same less the mean of all lines at that distance.",
            ),
            _cut_table(cuts(thesis), fine, coarse, results),
            _curve_table(thesis, results),
        ],
    )


def _picture(fine: dict[float, Series], rings: list[ContourPoint], path: Path) -> None:
    printed = [
        Series(fine[cut.angle_deg].label, np.array([cut.radius_mm]), np.array([cut.charge_pC]))
        for cut in rings
    ]
    mean = _mean(list(fine.values()))
    with style():
        figure = new_figure(160, 160)
        above, below = figure.subplots(2)
        lines = list(fine.values())
        charge_against_distance(above, lines, printed, "electrode A", labelled=False)
        apart, rings_apart = (
            [_less(one, mean) for one in some if np.isfinite(mean.y).all()]
            for some in (lines, printed)
        )
        charge_against_distance(below, apart, rings_apart, "electrode A")
        below.set_ylabel("charge − mean of the lines (pC)")
        save(figure, path)


def _mean(lines: list[Series]) -> Series:
    """Mean charge of the lines at the distances that all of them have."""
    common = np.array(sorted(set.intersection(*(set(one.x.tolist()) for one in lines))))
    charges = [one.y[np.isin(one.x, common)] for one in lines]
    return Series("mean", common, np.mean(charges, axis=0))


def _less(one: Series, mean: Series) -> Series:
    inside = one.x <= mean.x[-1]
    values = one.y[inside] - CubicSpline(mean.x, mean.y)(one.x[inside])
    return Series(one.label, one.x[inside], values)


def _cut_table(
    found: list[ContourPoint],
    fine: dict[float, Series],
    coarse: dict[float, Series],
    results: Results,
) -> Table:
    columns = [
        Column("contour_case", "case"),
        Column("angle_deg", "angle (°)", 0),
        Column("thesis_mm", "thesis (mm)", 3),
        Column("thesis_pC", "thesis (pC)", 4),
        Column("ours_pC", "ours there (pC)"),
        Column("difference_percent", "diff. (%)", 2, signed=True),
        Column("ours_mm", "ours: distance (mm)", 3),
        Column("ours_from_steps_mm", "from the 4 mm steps alone (mm)", 3),
    ]
    rows: list[list[Cell]] = []
    for cut in found:
        ours = results[_scene(cut.angle_deg, cut.radius_mm)].charge_pC(ELECTRODE, THESIS_EDGE)
        places = [
            crossing(curves[cut.angle_deg], cut.charge_pC, cut.radius_mm)
            for curves in (fine, coarse)
        ]
        difference = 100.0 * (ours / cut.charge_pC - 1.0)
        row: list[Cell] = [cut.case, cut.angle_deg, cut.radius_mm, cut.charge_pC, ours, difference]
        rows.append([*row, *places])
    return Table(
        "figure_3_5_cuts",
        "The thesis's contour of A at 905.1037 pC (Fig. 3.9): our charge at its points, and the "
        "distances at which ours has that charge.",
        columns,
        rows,
    )


def _curve_table(thesis: Thesis, results: Results) -> Table:
    columns = [
        Column("angle_deg", "angle (°)", 0),
        Column("distance_mm", "distance (mm)", None),
        Column("x_mm", "x (mm)", 3),
        Column("y_mm", "y (mm)", 3),
        Column("charge_A_pC", "thesis-edge (pC)"),
        Column("estimated_error_pC", "estimated error (pC)", 2),
        Column("material_A_pC", "material (pC)"),
        Column("status", "status"),
    ]
    rows: list[list[Cell]] = []
    for angle in thesis.angles_deg[ELECTRODE]:
        for distance in fine_distances(thesis, angle):
            record = results[_scene(angle, distance)]
            row: list[Cell] = [
                angle,
                distance,
                *place(angle, distance),
                record.charge_pC(ELECTRODE, THESIS_EDGE),
            ]
            material = record.charge_pC(ELECTRODE, MATERIAL)
            rows.append(
                [*row, record.charge_error_pC(ELECTRODE, THESIS_EDGE), material, record.status]
            )
    return Table("figure_3_5", "Fig. 3.5: charge of A at the computed points.", columns, rows)


MAPPING_PART = Part(
    "figure-3-5", "Fig. 3.5: charge against distance", ("Fig. 3.5",), _scenes, _compose
)
