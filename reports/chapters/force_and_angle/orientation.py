"""Chapter of the thesis report: charge against rotation (section 4.1)."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from pvdf_fem import Scene
from reports.chapters.force_and_angle.rectangle import Rectangle, asymmetry_pC, table_scenes
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Dashed, Series, charge_against_rotation
from reports.common.comparison import Comparison, group_by, select, series, swings_pC
from reports.common.figures import draw_differences, drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.polynomial import PrintedPolynomial
from reports.common.results import THESIS_EDGE, Results
from reports.common.tables import CASE, FORCE, ROTATION, wide_table
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene

#: Force in N of each of Figs. 4.2 to 4.4.
FIGURES = {"4.2": 0.5, "4.3": 1.0, "4.4": 2.0}
#: Force in N and electrode of each of the thesis's polynomials in the angle.
EQUATIONS = {
    "4.1": (1.0, "A"),
    "4.1 refit": (1.0, "A"),
    "4.2": (1.0, "B"),
    "4.2 refit": (1.0, "B"),
    "4.3": (0.5, "A"),
    "4.7": (2.0, "A"),
}


# ---------------------------------------------------------------------------- Figs. 4.2 to 4.4


def _rows(rectangle: Rectangle, force_N: float, electrode: str) -> list[Comparison]:
    """Charges over the rotation at one force, from Table 4.1 for 1 N and from 4.5 or 4.6 else."""
    source = {"A": "Table 4.5", "B": "Table 4.6"}[electrode] if force_N != 1 else "Table 4.1"
    return rectangle.table(source, force_N=force_N, electrode=electrode)


def _rotation(thesis: Thesis, results: Results, out: Path) -> Content:
    rectangle = Rectangle.of(thesis, results)
    blocks: list[Picture | Table] = []
    for number, force_N in FIGURES.items():
        file = f"figure_{number.replace('.', '_')}.svg"
        _rotation_picture(thesis, rectangle, force_N, results, out / file)
        equations = [name for name, (F, _) in EQUATIONS.items() if force_N == F and " " not in name]
        blocks.append(
            Picture(
                file,
                f"Fig. {number}: charge of A and B against rotation, {force_N:g} N. Dashed: "
                f"Eq. {' and '.join(equations)} as printed, cut off where they leave the picture."
                + (" Below, the differences for all four electrodes." if force_N == 1 else ""),
            )
        )
    comparisons = rectangle.table("Table 4.1")
    blocks.append(
        wide_table(
            "table_4_1", "Table 4.1: charge against rotation, 1 N.", [CASE, ROTATION], comparisons
        )
    )
    blocks.append(_equation_table(thesis, rectangle))
    return Content(_rotation_text(thesis, comparisons), blocks)


def _every_degree(thesis: Thesis, force_N: float) -> list[Scene]:
    """The rectangle at the centre, turned by 0, 1, ... 90°, which symmetry makes one solve.

    None without charges between 0 and 90°, as in a quick report.
    """
    if all(charge.rotation_deg % 90.0 == 0.0 for charge in thesis.from_("Table 4.1")):
        return []
    return [
        thesis_scene("4", "rect14x7", rotation_deg=float(angle), force_N=force_N)
        for angle in range(91)
    ]


def _scenes(thesis: Thesis) -> list[Scene]:
    turned = [_every_degree(thesis, force_N) for force_N in FIGURES.values()]
    return [*table_scenes(thesis), *itertools.chain.from_iterable(turned)]


def _curves(thesis: Thesis, force_N: float, results: Results) -> list[Series]:
    """Our charges of A and B at every degree up to 180°; none in a quick report."""
    records = [results[scene] for scene in _every_degree(thesis, force_N)]
    charges = {e: np.array([record.charge_pC(e, THESIS_EDGE) for record in records]) for e in "AB"}
    return [_mirrored(Series(e, np.arange(91.0), Q)) for e, Q in charges.items() if Q.size]


def _rotation_picture(
    thesis: Thesis, rectangle: Rectangle, force_N: float, results: Results, path: Path
) -> None:
    rows = {electrode: _rows(rectangle, force_N, electrode) for electrode in "AB"}
    ours = [
        _mirrored(series(comparisons, electrode, "rotation_deg"))
        for electrode, comparisons in rows.items()
    ]
    curves = _curves(thesis, force_N, results)
    printed = [
        series(comparisons, electrode, "rotation_deg", "thesis_pC")
        for electrode, comparisons in rows.items()
    ]
    with drawing(path, 160, 125 if force_N == 1 else 75) as figure:
        above, below = (
            figure.subplots(2, height_ratios=(3, 2)) if force_N == 1 else (figure.subplots(), None)
        )
        _limit(above, ours + printed)
        charge_against_rotation(
            above, ours, printed, dashed=_equations(thesis, force_N), between=curves
        )
        if below is not None:
            by_electrode = group_by(rectangle.table("Table 4.1"), "electrode")
            draw_differences(below, by_electrode, "rotation_deg")


def _equations(thesis: Thesis, force_N: float) -> Dashed:
    """The thesis's equations of A and B at a force; NaN for an electrode without one."""
    angles = np.linspace(0.0, 180.0, 361)
    names = {e: n for n, (F, e) in EQUATIONS.items() if force_N == F and " " not in n}
    curves = [
        Series(
            e,
            angles,
            thesis.polynomials[names[e]](np.radians(angles))
            if e in names
            else np.full(angles.size, np.nan),
        )
        for e in "AB"
    ]
    return Dashed(f"Eq. {' and '.join(names.values())}", curves)


def _mirrored(curve: Series) -> Series:
    """Charges over 0 to 180°, which mirror symmetry gives from those over 0 to 90°."""
    charges = dict(zip(curve.x.tolist(), curve.y.tolist(), strict=True))
    charges = {180.0 - angle: charge for angle, charge in charges.items()} | charges
    angles = np.array(sorted(charges))
    return Series(curve.label, angles, np.array([charges[angle] for angle in angles.tolist()]))


def _limit(ax: Axes, curves: list[Series]) -> None:
    values = np.concatenate([curve.y for curve in curves])
    values = values[np.isfinite(values)]
    if values.size:
        margin = 0.1 * float(np.ptp(values)) + 1.0
        ax.set_ylim(values.min() - margin, values.max() + margin)


def _equation_table(thesis: Thesis, rectangle: Rectangle) -> Table:
    columns = [
        Column("equation", "equation"),
        Column("electrode", "electrode"),
        FORCE,
        Column("data", "charges", 0),
        Column("worst_90_pC", "to 90°", 2, "largest miss (pC)"),
        Column("worst_180_pC", "to 180°", 2, "largest miss (pC)"),
        Column("at_180_over_0_pC", "at 180° − at 0° (pC)", 1, signed=True),
        Column("several_angles_from_pC", "from", 2, "charges with several angles in 0 to 90° (pC)"),
        Column("several_angles_to_pC", "to", 2, "charges with several angles in 0 to 90° (pC)"),
        Column("angles", "angles", 0, "charges with several angles in 0 to 90° (pC)"),
    ]
    cells = [
        _equation_row(thesis.polynomials[name], force_N, _rows(rectangle, force_N, electrode))
        for name, (force_N, electrode) in EQUATIONS.items()
    ]
    return Table(
        "angle_equations",
        "Eq. 4.1 to 4.3 and 4.7: polynomials of degree 10 in the angle against the charges of "
        "their tables, as printed and (refit) fitted again in full precision, and where they "
        "have more than one angle for a charge.",
        columns,
        cells,
    )


def _equation_row(
    equation: PrintedPolynomial, force_N: float, comparisons: list[Comparison]
) -> list[Cell]:
    printed = series(comparisons, "", "rotation_deg", "thesis_pC")
    misses = np.abs(equation(np.radians(printed.x)) - printed.y)
    several = [values for values in equation.multiplicity(0.0, math.pi / 2) if values[2] > 1]
    worst = [
        float(misses[printed.x <= limit].max()) if (printed.x > limit - 90).any() else None
        for limit in (90.0, 180.0)
    ]
    ends = equation(np.array([math.pi, 0.0]))
    row: list[Cell] = [equation.name, equation.electrode, force_N, len(comparisons), *worst]
    row.append(float(ends[0] - ends[1]))
    if not several:
        return [*row, None, None, None]
    return [*row, several[0][0], several[-1][1], max(count for *_, count in several)]


def _rotation_text(thesis: Thesis, comparisons: list[Comparison]) -> list[str]:
    opening = (
        "The rectangular probe of 14 mm × 7 mm presses the centre of the four-electrode sensor and "
        "is turned about its centre. To the film this is one scene: one solve gives all angles."
    )
    of_a, of_b = (
        {
            comparison.charge.rotation_deg: comparison
            for comparison in select(comparisons, electrode=e)
        }
        for e in "AB"
    )
    if len(of_a) < 10:
        return [opening]
    span, our_span = swings_pC(comparisons)
    theirs, edge, material = (
        100.0 * (getattr(of_a[0.0], key) / getattr(of_b[0.0], key) - 1.0)
        for key in ("thesis_pC", "ours_pC", "material_pC")
    )
    small = {angle: of_a[angle] for angle in (0.0, 10.0, 20.0, 30.0) if angle in of_a}
    printed, computed = (
        ", ".join(f"{getattr(row, key):.1f}" for row in small.values())
        for key in ("thesis_pC", "material_pC")
    )
    return [
        opening,
        "Section 4.1.1 finds that nothing tells which charge of B goes with one of A. The "
        "symmetry does: turned by a quarter and mirrored, B at an angle is A at 90° minus that "
        f"angle. Charges of Table 4.1 that symmetry makes equal differ by up to "
        f"{asymmetry_pC(thesis):.2f} pC, of {span:.1f} pC by which the rotation changes A "
        f"({our_span:.1f} pC here).",
        "Section 4.1 explains the curves by sharp corners that come near an electrode. A corner "
        f"points at A at {math.degrees(math.atan(0.5)):.1f}°, yet the charge of A falls from 0° "
        f"on: {printed} pC at {', '.join(f'{angle:g}' for angle in small)}° in Table 4.1, "
        f"{computed} pC here (material). It is largest where a short side faces A.",
        f"At 0°, A has {theirs:.2f} % more charge than B in the thesis, "
        f"{edge:.2f} % here with averages along the edges, {material:.2f} % by the "
        "area. An orientation can be recovered from nothing but this contrast.",
    ]


ROTATION_CHAPTER = Chapter(
    "rotation",
    "Section 4.1: charge against rotation, rectangle at the centre",
    ("Fig. 4.2", "Fig. 4.3", "Fig. 4.4", "Table 4.1"),
    _scenes,
    _rotation,
)
