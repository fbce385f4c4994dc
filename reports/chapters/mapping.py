"""Chapters of the thesis report: charge against distance on lines from an electrode.

Figs 3.5 and 3.7 show the biaxial film, Figs 3.17 and 3.18 the uniaxial film. Both come from the
same scenes, since one solve serves every pair of piezoelectric coefficients. A further chapter
shows what the thesis does not picture: the rectangle, and the sensor with four electrodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

from pvdf_fem import Scene
from pvdf_fem.output.figures import GREY
from reports.chapters.mapping_curves import FARTHEST_MM, REACH_MM, Family, LineCurve, plain
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Series, charge_against_distance, colours
from reports.common.figures import LEVEL_DASHES, drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import SHAPES, ContourPoint, Thesis

#: Angles in degrees of the lines whose curves section 3.1.1 calls uppermost and lowermost.
EXTREMES_DEG = {"A": (35.0, 90.0), "B": (140.0, 240.0)}
CASES = {
    "A": "Electrode A lies at (0, −10) mm.",
    "B": "Electrode B lies on the 10 mm circle at 30°. The caption of Fig. 3.7 says rectangular "
    "probe; its section, and the contours that it prints, are about the triangular one.",
}


FIGURES = (
    Family("3.5", "3", "tri7", "A", "biaxial"),
    Family("3.7", "3", "tri7", "B", "biaxial"),
    Family("3.17", "3", "tri7", "A", "uniaxial"),
    Family("3.18", "3", "tri7", "B", "uniaxial"),
)
OTHERS = tuple(
    Family("", layout, probe, electrode, film)
    for (layout, probe), electrode, film in product(
        (("3", "rect14x7"), ("4", "tri7"), ("4", "rect14x7")), "AB", ("biaxial", "uniaxial")
    )
)


# ------------------------------------------------------------------------------- the thesis's


def _scenes(family: Family) -> Callable[[Thesis], list[Scene]]:
    return lambda thesis: list(family.scenes(thesis))


def _compose(family: Family) -> Callable[[Thesis, Results, Path], Content]:
    def compose(thesis: Thesis, results: Results, out: Path) -> Content:
        field, cuts = family.field(thesis, results), family.cuts(thesis)
        line_curves = family.curves(thesis, results, THESIS_EDGE, field)
        _picture(family, line_curves, cuts, out / f"{family.file}.svg")
        order = _order_table(family, line_curves)
        blocks: list[Table | Picture] = [Picture(f"{family.file}.svg", _caption(family, cuts))]
        blocks += [_cut_table(family, cuts, line_curves)] if family.film == "biaxial" else []
        blocks += [order, _point_table(family, thesis, results)]
        texts = [_scene_text(family, thesis), _order_text(family, thesis, order)]
        if family.film == "biaxial":
            texts += [*_cut_texts(cuts), _step_text(line_curves, thesis.step_mm)]
        return Content([text for text in texts if text], blocks)

    return compose


def _caption(family: Family, cuts: Sequence[ContourPoint]) -> str:
    charges = sorted({(cut.contour[-1], cut.charge_pC) for cut in cuts})
    rings = " and ".join(f"{charge} pC (contour of {name})" for name, charge in charges)
    text = f"Fig. {family.figure}: charge of {family.electrode} against distance, {family.film} "
    text += "film, triangular probe, 1 N; dots: solved places."
    below = " Below: the same less the mean of all lines at that distance, with their angles."
    return text + (f" Rings: the thesis's points at {rings}." if rings else "") + below


def _scene_text(family: Family, thesis: Thesis) -> str:
    d31, d32 = family.d_pC_N(thesis)
    same = {"3.17": "3.5", "3.18": "3.7"}.get(family.figure)
    if same:
        return (
            f"The solutions are those of Fig. {same}, read with d31 = {d31:g} and "
            f"d32 = {d32:g} pC/N."
        )
    return (
        f"{CASES[family.electrode]} The triangular probe (1 N, one corner to +y) moves in steps of "
        f"{thesis.step_mm:g} mm from there, as far as its centre stays within {REACH_MM:g} mm of "
        "the film's centre. Between the solved places we interpolate the charge divided by its "
        "leading part (the stress of the centred probe, carried along). This ratio is far smoother "
        "than the charge itself."
    )


def _order_text(family: Family, thesis: Thesis, order: Table) -> str:
    """A text: at which distances the extreme curves are those that the thesis names."""
    angles = family.angles_deg(thesis)
    rows = [row for row in order.rows if row[1] in angles]
    upper, lower = EXTREMES_DEG[family.electrode]
    if not rows or not {upper, lower} <= set(angles):
        return ""
    highest, lowest, wrong = (
        _listed([float(str(row[0])) for row in rows if row[column] == angle])
        for column, angle in ((1, upper), (3, lower), (3, upper))
    )
    film = "" if family.film == "biaxial" else " of the biaxial film"
    return (
        f"The thesis calls the curve of {upper:g}°{film} the uppermost and that of {lower:g}° the "
        f"lowermost. Here, of {len(rows)} distances compared, that of {upper:g}° is the highest "
        f"at {highest} and the lowest at {wrong}; that of {lower:g}° is the lowest at {lowest}."
    )


def _cut_texts(cuts: Sequence[ContourPoint]) -> list[str]:
    """Texts: what the thesis's own points say of the order of the falling curves."""
    texts = []
    for contour in sorted({point.contour for point in cuts}):
        points = sorted(
            (point for point in cuts if point.contour == contour), key=lambda point: point.radius_mm
        )
        nearest, farthest = points[0], points[-1]
        if nearest is farthest:
            continue
        texts.append(
            f"Of the thesis's own points at {nearest.charge_pC} pC the nearest is that of "
            f"{nearest.angle_deg:g}° ({nearest.radius_mm:g} mm), the farthest that of "
            f"{farthest.angle_deg:g}° ({farthest.radius_mm:g} mm). As charges fall with the "
            "distance, the latter curve is the higher one there."
        )
    return texts


def _step_text(line_curves: Sequence[LineCurve], step_mm: float) -> str:
    """A text: how far a spline through the charges themselves misses the curves."""
    misses = [
        (abs(wrong / right - 1.0), distance)
        for curve in line_curves
        for distance, right, wrong in zip(
            curve.series.x, curve.series.y, plain(curve.line).series.y, strict=True
        )
        if np.isfinite(right)
    ]
    if not misses:
        return ""
    worst, worst_mm = max(misses)
    beyond = max(size for size, distance in misses if distance >= 6.0)
    return (
        "A spline through the charges at the steps themselves misses these curves by up to "
        f"{100 * worst:.1f} % (at {worst_mm:.1f} mm), and by up to {100 * beyond:.1f} % from 6 mm "
        f"on: near the electrode, steps of {step_mm:g} mm are too long for it."
    )


def _listed(distances: Sequence[float]) -> str:
    """Distances in words; equally spaced ones are given by the first and the last."""
    if not distances:
        return "none of them"
    if len(distances) > 2 and len(set(np.diff(distances))) == 1:
        return f"{distances[0]:g} to {distances[-1]:g} mm"
    return f"{', '.join(f'{distance:g}' for distance in distances)} mm"


def _picture(
    family: Family, line_curves: Sequence[LineCurve], cuts: Sequence[ContourPoint], path: Path
) -> None:
    points, smooth = (
        [curve.points for curve in line_curves],
        [curve.series for curve in line_curves],
    )
    rings = [
        Series(f"{cut.angle_deg:g}°", np.array([cut.radius_mm]), np.array([cut.charge_pC]))
        for cut in cuts
    ]
    with drawing(path, 160, 165) as figure:
        above, below = figure.subplots(2)
        reference = f"electrode {family.electrode}"
        charge_against_distance(above, points, rings, reference, labelled=False, between=smooth)
        above_mean = [
            [_above_mean(curve, line_curves) for curve in group]
            for group in (points, rings, smooth)
        ]
        charge_against_distance(
            below, above_mean[0], above_mean[1], reference, between=above_mean[2]
        )
        below.set_ylabel("charge − mean of the lines (pC)")


def _above_mean(curve: Series, line_curves: Sequence[LineCurve]) -> Series:
    """A series minus the mean of all curves, up to the distance that all of them reach."""
    inside = curve.x <= _common_mm(line_curves)
    distances = curve.x[inside]
    mean = np.mean([line_curve(distances) for line_curve in line_curves], axis=0)
    return Series(curve.label, distances, curve.y[inside] - mean)


def _common_mm(line_curves: Sequence[LineCurve]) -> float:
    return float(min(curve.line.distances_mm[-1] for curve in line_curves))


def _cut_table(
    family: Family, cuts: Sequence[ContourPoint], line_curves: Sequence[LineCurve]
) -> Table:
    columns = [
        Column("case", "contour", on_page=False),
        Column("contour_of", "contour of"),
        Column("angle_deg", "line (°)", 0),
        Column("charge_pC", "charge (pC)", 4),
        Column("thesis_mm", "thesis (mm)", 3, "distance of that charge"),
        Column("ours_mm", "ours (mm)", 3, "distance of that charge"),
        Column("difference_mm", "diff. (mm)", 3, "distance of that charge", signed=True),
        Column("ours_plain_mm", "spline through the 4 mm steps (mm)", 3, "distance of that charge"),
        Column("ours_pC", "ours (pC)", 1, "charge at the thesis's distance"),
        Column("difference_percent", "diff. (%)", 2, "charge at the thesis's distance", True),
    ]
    by_angle = {curve.line.angle_deg: curve for curve in line_curves}
    rows: list[list[Cell]] = []
    for cut in cuts:
        curve = by_angle[cut.angle_deg]
        ours, simple = (
            candidate.distance(cut.charge_pC, cut.radius_mm)
            for candidate in (curve, plain(curve.line))
        )
        charge_there = float(curve(np.array(cut.radius_mm)))
        row: list[Cell] = [
            cut.contour,
            cut.contour[-1],
            cut.angle_deg,
            cut.charge_pC,
            cut.radius_mm,
        ]
        row += [ours, ours - cut.radius_mm, simple]
        rows.append([*row, charge_there, 100.0 * (charge_there / cut.charge_pC - 1.0)])
    return Table(
        f"{family.file}_cuts",
        f"The thesis's contour points on the lines from {family.electrode} (Fig. 3.9), and the "
        "distances at which our curves have their charges. Those of the contour of C are read "
        "from the curves of B.",
        columns,
        rows,
    )


def _order_table(family: Family, line_curves: Sequence[LineCurve]) -> Table:
    """The highest and the lowest curve at distances of 2, 4, 6 mm, ..."""
    columns = [
        Column("distance_mm", "distance (mm)", 0),
        Column("highest_deg", "highest curve (°)", 0),
        Column("highest_pC", "its charge (pC)"),
        Column("lowest_deg", "lowest curve (°)", 0),
        Column("lowest_pC", "its charge (pC)"),
        Column("between_percent", "between them (%)"),
    ]
    rows: list[list[Cell]] = []
    angles = [curve.line.angle_deg for curve in line_curves]
    for distance in np.arange(2.0, _common_mm(line_curves) + 1e-9, 2.0).tolist():
        charges = np.array([float(curve(np.array(distance))) for curve in line_curves])
        if not np.isfinite(charges).all():
            rows.append([distance, *[np.nan] * 5])
            continue
        high, low = int(charges.argmax()), int(charges.argmin())
        row: list[Cell] = [distance, angles[high], charges[high], angles[low], charges[low]]
        rows.append([*row, 100.0 * (charges[high] / charges[low] - 1.0)])
    return Table(
        f"{family.file}_order",
        f"Order of the curves of {family.electrode}, as far as all lines reach.",
        columns,
        rows,
    )


_POINT_COLUMNS = (
    Column("layout", "electrodes"),
    Column("probe", "probe"),
    Column("electrode", "electrode"),
    Column("film", "film"),
    Column("angle_deg", "line (°)", 0),
    Column("distance_mm", "distance (mm)", None),
    Column("x_mm", "x (mm)", 3),
    Column("y_mm", "y (mm)", 3),
    Column("thesis_edge_pC", "thesis-edge (pC)"),
    Column("material_pC", "material (pC)"),
    Column("status", "status"),
)


def _point_rows(family: Family, thesis: Thesis, results: Results) -> list[list[Cell]]:
    scheme, d = family.scheme(thesis), family.d_pC_N(thesis)
    records = iter(family.records(thesis, results))
    rows: list[list[Cell]] = []
    for angle, places in zip(scheme.angles_deg, scheme.positions_mm, strict=True):
        for distance, place in zip(scheme.distances_mm, places.tolist(), strict=False):
            record = next(records)
            charges = [
                record.charge_pC(family.electrode, observable, *d)
                for observable in (THESIS_EDGE, MATERIAL)
            ]
            cells: list[Cell] = [family.layout, SHAPES[family.probe], family.electrode, family.film]
            rows.append([*cells, angle, distance, *place, *charges, record.status])
    return rows


def _point_table(family: Family, thesis: Thesis, results: Results) -> Table:
    caption = f"Fig. {family.figure}: charge of {family.electrode} at the solved places, 1 N."
    rows = [row[4:] for row in _point_rows(family, thesis, results)]
    return Table(family.file, caption, _POINT_COLUMNS[4:], rows)


# ---------------------------------------------------------------------------------- the others


def _other_scenes(thesis: Thesis) -> list[Scene]:
    return [scene for family in OTHERS for scene in family.scenes(thesis)]


def _compose_others(thesis: Thesis, results: Results, out: Path) -> Content:
    _other_picture(thesis, results, out / "mapping_others.svg")
    rows = [row for family in OTHERS for row in _point_rows(family, thesis, results)]
    scenes = _other_scenes(thesis)
    return Content(
        [
            "The thesis shows no curves of the rectangle, nor of the sensor with four electrodes. "
            "Here each electrode has three of its lines; with four electrodes they are those of A "
            "of three electrodes, turned with the electrode. Charges are the material's; "
            f"{len(set(scenes))} scenes, each read for both films.",
        ],
        [
            Picture(
                "mapping_others.svg",
                "Charge against distance for probes and layouts without a figure in the thesis, "
                "1 N. Full: biaxial film, dashed: uniaxial film; dots: solved places.",
            ),
            Table("mapping_others", "Charges at the solved places, 1 N.", _POINT_COLUMNS, rows),
        ],
    )


def _other_picture(thesis: Thesis, results: Results, path: Path) -> None:
    fields = {family.probe: family.field(thesis, results) for family in OTHERS[::4]}
    with drawing(path, 170, 200) as figure:
        axes = figure.subplots(3, 2)
        for ax, biaxial, uniaxial in zip(axes.flat, OTHERS[::2], OTHERS[1::2], strict=True):
            probe = SHAPES[biaxial.probe]
            ax.set_title(f"{biaxial.layout} electrodes, {probe}, electrode {biaxial.electrode}")
            for family, dashes in ((biaxial, "-"), (uniaxial, LEVEL_DASHES)):
                line_curves = family.curves(thesis, results, MATERIAL, fields[family.probe])
                for curve, ink in zip(line_curves, colours(len(line_curves)), strict=True):
                    smooth, points = curve.series, curve.points
                    label = smooth.label if family is biaxial else None
                    ax.plot(smooth.x, smooth.y, ls=dashes, color=ink, lw=1.1, label=label)
                    ax.plot(points.x, points.y, ".", color=ink, markersize=3)
            ax.set(xlabel="distance (mm)", ylabel="charge (pC)", xlim=(0.0, FARTHEST_MM))
            ax.set_ylim(bottom=0.0)
            ax.legend()  # at the upper right, where the charges have fallen
        films = (("biaxial film", "-"), ("uniaxial film", LEVEL_DASHES))
        keys = [Line2D([], [], color=GREY, lw=1.1, ls=ls, label=label) for label, ls in films]
        keys.append(Line2D([], [], color=GREY, ls="none", marker=".", ms=3, label="solved places"))
        figure.legend(handles=keys, loc="outside lower center", ncols=3)


def _chapter(family: Family) -> Chapter:
    return Chapter(
        family.file.replace("_", "-"),
        f"Fig. {family.figure}: charge of {family.electrode} against distance, {family.film} film",
        (f"Fig. {family.figure}",),
        _scenes(family),
        _compose(family),
    )


FIGURE_3_5_CHAPTER, FIGURE_3_7_CHAPTER, FIGURE_3_17_CHAPTER, FIGURE_3_18_CHAPTER = map(
    _chapter, FIGURES
)
OTHER_MAPPINGS_CHAPTER = Chapter(
    "other-mappings",
    "Charge against distance: rectangle, and four electrodes",
    (),
    _other_scenes,
    _compose_others,
)
