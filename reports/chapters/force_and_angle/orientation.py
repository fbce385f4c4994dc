"""Part of the thesis report: charge against rotation (section 4.1)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from pvdf_fem.maps.polynomial import Polynomial
from pvdf_fem.output.figures import (
    COLOURS,
    Series,
    charge_against_rotation,
    differences,
    new_figure,
    save,
    style,
)
from reports.chapters.force_and_angle.rectangle import Rectangle, table_scenes
from reports.common.comparison import Comparison, series, wide_table
from reports.common.page import Cell, Column, Picture, Table
from reports.common.part import Content, Part
from reports.common.results import Results
from reports.common.tables import CASE, FORCE, ROTATION, by, sound_differences
from reports.common.thesis_data import Thesis

#: Forces of Figs. 4.2 to 4.4 in N.
FIGURES = {"4.2": 0.5, "4.3": 1.0, "4.4": 2.0}
#: The thesis's polynomials in the angle with their force and electrode.
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
    """Charges over the rotation at one force: Table 4.1 at 1 N, a column of 4.5 or 4.6 else."""
    source = {"A": "Table 4.5", "B": "Table 4.6"}[electrode] if force_N != 1 else "Table 4.1"
    return rectangle.table(source, force_N=force_N, electrode=electrode)


def _rotation(thesis: Thesis, results: Results, out: Path) -> Content:
    rectangle = Rectangle.of(thesis, results)
    blocks: list[Picture | Table] = []
    for number, force_N in FIGURES.items():
        file = f"figure_{number.replace('.', '_')}.svg"
        _rotation_picture(thesis, rectangle, force_N, out / file)
        equations = [name for name, (F, _) in EQUATIONS.items() if force_N == F and " " not in name]
        blocks.append(
            Picture(
                file,
                f"Fig. {number}: charge of A and B against rotation, {force_N:g} N. Dashed: "
                f"Eq. {' and '.join(equations)} as printed, cut off where they leave the picture."
                + (" Below, the differences for all four electrodes." if force_N == 1 else ""),
            )
        )
    found = rectangle.table("Table 4.1")
    blocks.append(
        wide_table("table_4_1", "Table 4.1: charge against rotation, 1 N.", [CASE, ROTATION], found)
    )
    blocks.append(_equation_table(thesis, rectangle))
    return Content(_rotation_text(found), blocks)


def _rotation_picture(thesis: Thesis, rectangle: Rectangle, force_N: float, path: Path) -> None:
    rows = {e: _rows(rectangle, force_N, e) for e in "AB"}
    ours = [_mirrored(series(some, e, "rotation_deg")) for e, some in rows.items()]
    printed = [series(some, e, "rotation_deg", "thesis_pC") for e, some in rows.items()]
    with style():
        figure = new_figure(160, 125 if force_N == 1 else 75)
        above, below = (
            figure.subplots(2, height_ratios=(3, 2)) if force_N == 1 else (figure.subplots(), None)
        )
        _limit(above, ours + printed)
        for name, (F, e) in EQUATIONS.items():
            if force_N == F and " " not in name:
                angles = np.linspace(0.0, 180.0, 361)
                charges = thesis.polynomials[name](np.radians(angles))
                above.plot(angles, charges, color=COLOURS["AB".index(e)], linestyle=(0, (5, 2)))
        charge_against_rotation(above, ours, printed)
        if below is not None:
            each = by(rectangle.table("Table 4.1"), "electrode")
            differences(below, sound_differences(each, "rotation_deg"), "rotation of the probe (°)")
        save(figure, path)


def _mirrored(one: Series) -> Series:
    """Charges over 0 to 180° from those over 0 to 90°, which mirror symmetry gives."""
    charges = dict(zip(one.x.tolist(), one.y.tolist(), strict=True))
    charges = {180.0 - angle: charge for angle, charge in charges.items()} | charges
    angles = np.array(sorted(charges))
    return Series(one.label, angles, np.array([charges[angle] for angle in angles.tolist()]))


def _limit(ax: Axes, every: list[Series]) -> None:
    values = np.concatenate([one.y for one in every])
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


def _equation_row(equation: Polynomial, force_N: float, found: list[Comparison]) -> list[Cell]:
    printed = series(found, "", "rotation_deg", "thesis_pC")
    misses = np.abs(equation(np.radians(printed.x)) - printed.y)
    several = [part for part in equation.multiplicity(0.0, math.pi / 2) if part[2] > 1]
    worst = [
        float(misses[printed.x <= limit].max()) if (printed.x > limit - 90).any() else None
        for limit in (90.0, 180.0)
    ]
    ends = equation(np.array([math.pi, 0.0]))
    row: list[Cell] = [equation.name, equation.electrode, force_N, len(found), *worst]
    row.append(float(ends[0] - ends[1]))
    if not several:
        return [*row, None, None, None]
    return [*row, several[0][0], several[-1][1], max(count for *_, count in several)]


def _rotation_text(found: list[Comparison]) -> list[str]:
    charges = {(o.charge.electrode, o.charge.rotation_deg): o for o in found}
    opening = (
        "The rectangular probe of 14 mm × 7 mm presses the centre of the four-electrode sensor and "
        "is turned about its centre. To the film this is one scene: one solve gives all angles."
    )
    mirror = [
        abs(one.charge.charge_pC - charges["A", 90.0 - angle].charge.charge_pC)
        for (e, angle), one in charges.items()
        if e == "B" and ("A", 90.0 - angle) in charges
    ]
    if len(mirror) < 4:
        return [opening]
    of_a = {angle: one for (e, angle), one in charges.items() if e == "A"}
    span = float(np.ptp([one.charge.charge_pC for one in of_a.values()]))
    contrast = [
        (getattr(charges["A", 0.0], y) / getattr(charges["B", 0.0], y) - 1.0) * 100.0
        for y in ("ours_pC", "material_pC")
    ]
    theirs = charges["A", 0.0].charge.charge_pC / charges["B", 0.0].charge.charge_pC
    near = {angle: of_a[angle] for angle in (0.0, 10.0, 20.0, 30.0) if angle in of_a}
    printed = ", ".join(f"{one.charge.charge_pC:.1f}" for one in near.values())
    material = ", ".join(f"{one.material_pC:.1f}" for one in near.values())
    return [
        opening,
        "Section 4.1.1 finds that nothing tells which charge of B goes with one of A. The "
        "symmetry does: turned by a quarter and mirrored, B at an angle is A at 90° minus that "
        f"angle. Table 4.1 obeys this within {max(mirror):.2f} pC, of {span:.1f} pC by which the "
        "rotation changes A.",
        "Section 4.1 explains the curves by sharp corners that come near an electrode. A corner "
        f"points at A at {math.degrees(math.atan(0.5)):.1f}°, yet the charge of A falls from 0° "
        f"on: {printed} pC at {', '.join(f'{angle:g}' for angle in near)}° in Table 4.1, "
        f"{material} pC here (material). It is largest where a short side faces A.",
        f"At 0°, A has {100 * (theirs - 1):.2f} % more charge than B in the thesis, "
        f"{contrast[0]:.2f} % here with averages along the edges, {contrast[1]:.2f} % by the "
        "area. This contrast is all that an orientation can be told from.",
    ]


ROTATION_PART = Part(
    "rotation",
    "Section 4.1: charge against rotation, rectangle at the centre",
    ("Fig. 4.2", "Fig. 4.3", "Fig. 4.4", "Table 4.1"),
    table_scenes,
    _rotation,
)
