"""Chapters of the thesis report: charge against force (sections 3.4, 4.2 and 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS, GREY
from reports.chapters.force_and_angle.force_law import finite, law_through, swing
from reports.common.chapter import Chapter, Content, comparing
from reports.common.charge_figures import (
    EQUATION_DASHES,
    Series,
    charge_against_force,
    colours,
    label_curves,
)
from reports.common.comparison import Comparison, compare, curves, group_by, select, series
from reports.common.figures import RING, draw_compared, draw_differences, drawing
from reports.common.page import Picture, Table, signed
from reports.common.polynomial import PrintedPolynomial
from reports.common.results import THESIS_EDGE, Results
from reports.common.tables import CASE, FORCE, ROTATION, wide_table
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene
from reports.thesis_methods.force_law import MembraneLaw

Array = NDArray[np.float64]

#: Force in N between the last two of Tables 4.5 and 4.6, where Eq. 4.10 and 4.11 leave the curve.
BETWEEN_N = 6.5


@dataclass(frozen=True)
class RectangleFigures:
    """The thesis's figures, table and equation about an electrode under the rectangle."""

    row: str
    rotations: str
    table: str
    equation: str

    @property
    def row_file(self) -> str:
        """File of the picture of the rotation 0°."""
        return f"figure_{self.row.replace('.', '_')}.svg"

    @property
    def rotations_file(self) -> str:
        """File of the picture of all rotations."""
        return f"figure_{self.rotations.replace('.', '_')}.svg"


#: The thesis's figures, table and equation by electrode.
RECTANGLE = {
    "A": RectangleFigures("4.5", "4.11", "4.5", "4.10"),
    "B": RectangleFigures("4.6", "4.12", "4.6", "4.11"),
}


# ------------------------------------------------------------------------ triangle, section 3.4.1


def _triangle(comparisons: list[Comparison], out: Path) -> Content:
    electrodes = group_by(comparisons, "electrode")
    with drawing(out / "figure_3_20.svg", 160, 130) as figure:
        above, below = figure.subplots(2, height_ratios=(3, 2))
        draw_compared(above, electrodes, "force_N")
        draw_differences(below, electrodes, "force_N")
    return Content(
        [
            "The triangular probe, turned by 90° clockwise, at the centre of the three-electrode "
            "sensor. A third of a turn maps the probe and the ring of electrodes onto themselves, "
            "so that A, B and C must have equal charges; the thesis says “virtually”. The largest "
            f"of the three is above the smallest by {_spread(comparisons, 'thesis_pC')} in the "
            f"thesis, by {_spread(comparisons, 'ours_pC')} for averages along the electrodes' "
            f"edges as it takes them, and by {_spread(comparisons, 'material_pC')} for the charge "
            "of their area: the difference is made by edges that all lie along x and y, whatever "
            "the electrode's place on the ring.",
        ],
        [
            Picture(
                "figure_3_20.svg",
                "Fig. 3.20 and Table 3.4: charge against force; below, the differences. Dashed: "
                "±2 %.",
            ),
            wide_table("table_3_4", "Table 3.4: charge against force.", [CASE, FORCE], comparisons),
        ],
    )


def _spread(comparisons: list[Comparison], y: str) -> str:
    """Range over the electrodes at each force, in percent of their mean."""
    rows = [
        [getattr(comparison, y) for comparison in group]
        for group in group_by(comparisons, "force_N").values()
    ]
    spreads = [100.0 * np.ptp(row) / np.mean(row) for row in rows]
    return f"{min(spreads):.2f} to {max(spreads):.2f} %" if spreads else "–"


# -------------------------------------------------- rectangle, Figs. 4.5, 4.6, 4.11 and 4.12


def _rectangle_charges(thesis: Thesis) -> list[Charge]:
    return thesis.from_("Table 4.5", "Table 4.6")


def _between(thesis: Thesis) -> list[Scene]:
    """The scene of `BETWEEN_N` at 0°, if the forces of the table enclose it."""
    forces = {charge.force_N for charge in _rectangle_charges(thesis) if charge.rotation_deg == 0}
    inside = min(forces, default=BETWEEN_N) < BETWEEN_N < max(forces, default=BETWEEN_N)
    return [thesis_scene("4", "rect14x7", force_N=BETWEEN_N)] if inside else []


def _rectangle_scenes(thesis: Thesis) -> list[Scene]:
    return [scene_of(charge) for charge in _rectangle_charges(thesis)] + _between(thesis)


def _rectangle(thesis: Thesis, results: Results, out: Path) -> Content:
    comparisons = compare(_rectangle_charges(thesis), results)
    rows = {e: select(comparisons, electrode=e, rotation_deg=0.0) for e in "AB"}
    printed = {e: series(row, e, "force_N", "thesis_pC") for e, row in rows.items()}
    ours = {
        e: _with_points(
            series(row, e, "force_N"),
            [(BETWEEN_N, results[scene].charge_pC(e, THESIS_EDGE)) for scene in _between(thesis)],
        )
        for e, row in rows.items()
    }
    blocks: list[Picture | Table] = []
    for electrode, figures in RECTANGLE.items():
        of_electrode = select(comparisons, electrode=electrode)
        _degree_six_picture(
            thesis, figures.equation, ours[electrode], printed[electrode], out / figures.row_file
        )
        _rotations_picture(of_electrode, out / figures.rotations_file)
        blocks += _rectangle_blocks(electrode, figures, of_electrode)
    return Content(
        [
            "The rectangular probe of 14 mm × 7 mm at the centre of the four-electrode sensor. "
            "Rows of 90° are copies of the other table's 0° in the thesis, digit for digit; they "
            "are shown but not counted.",
            *_degree_six_text(thesis, ours, printed),
        ],
        blocks,
    )


def _rectangle_blocks(
    electrode: str, figures: RectangleFigures, comparisons: list[Comparison]
) -> list[Picture | Table]:
    return [
        Picture(
            figures.row_file,
            f"Fig. {figures.row}: charge of {electrode} against force, 0°, with the thesis's "
            "polynomial of degree 6 as printed (dashed) and interpolated again in full precision "
            "(dotted). Right, everything over the membrane law through the thesis's charges.",
        ),
        Picture(
            figures.rotations_file,
            f"Fig. {figures.rotations}: charge of {electrode} against force at the rotations of "
            f"Table {figures.table}; right, relative to the mean of the rotations, thesis and ours "
            "each over its own (the thesis's outliers at 75°, 5 N included), and the differences "
            "(charges with a defect left out). Dashed: ±2 %.",
        ),
        wide_table(
            f"table_{figures.table.replace('.', '_')}",
            f"Table {figures.table}: charge of {electrode} against rotation and force.",
            [CASE, ROTATION, FORCE],
            comparisons,
        ),
    ]


def _with_points(curve: Series, points: list[tuple[float, float]]) -> Series:
    """A series with additional points, in the order of x."""
    pairs = np.array(sorted([*zip(curve.x, curve.y, strict=True), *points])).reshape(-1, 2)
    return Series(curve.label, pairs[:, 0], pairs[:, 1])


def _degree_six_picture(
    thesis: Thesis, number: str, ours: Series, printed: Series, path: Path
) -> None:
    law = law_through(*finite(printed))
    with drawing(path, 180, 75) as figure:
        left, right = figure.subplots(1, 2)
        right.axhline(0.0, color=GREY, linewidth=0.8)
        F = np.linspace(printed.x[0], printed.x[-1], 300) if law else np.zeros(0)
        for name, dashes, label in (
            (number, EQUATION_DASHES, f"Eq. {number} as printed"),
            (f"{number} refit", (0, (1, 1.5)), "in full precision"),
        ):
            equation = Series(label, F, thesis.polynomials[name](F))
            look: dict[str, Any] = {"color": COLOURS[1], "linestyle": dashes}
            left.plot(equation.x, equation.y, **look)
            _over_law(right, equation, law, label=label, **look)
        charge_against_force(left, [ours], [printed])
        _over_law(right, ours, law, color=COLOURS[0], marker=".", label="this work")
        _over_law(right, printed, law, color=COLOURS[0], **RING, label="thesis")
        right.set(xlabel="force (N)", ylabel="above the law (%)", xlim=left.get_xlim())
        if law is not None:
            left.legend(*right.get_legend_handles_labels(), loc="upper left")


def _over_law(ax: Axes, curve: Series, law: MembraneLaw | None, **look: Any) -> None:
    if law is not None:
        ax.plot(curve.x, 100.0 * (curve.y / law.charge_pC(curve.x) - 1.0), **look)


def _degree_six_text(
    thesis: Thesis, ours: dict[str, Series], printed: dict[str, Series]
) -> list[str]:
    texts = []
    for electrode, figures in RECTANGLE.items():
        number = figures.equation
        law = law_through(*finite(printed[electrode]))
        if law is None or len(printed[electrode].x) < 7:
            continue
        F, Q = printed[electrode].x, printed[electrode].y
        rounding = thesis.polynomials[number](F) - Q
        refit = thesis.polynomials[f"{number} refit"]
        worst_N, percent = swing(refit, law, *F[[0, -1]])
        turns = refit.turning_points(*F[[0, -1]])
        at_between = ours[electrode].y[np.isclose(ours[electrode].x, BETWEEN_N)]
        texts.append(
            f"Eq. {number} passes through its seven data with seven coefficients. As printed it "
            f"is {signed(rounding[-2])} pC off at {F[-2]:g} N and {signed(rounding[-1])} pC at "
            f"{F[-1]:g} N, from rounding. With full precision it still swings between the last "
            f"two: it is {signed(percent)} % off the membrane law through the same charges at "
            f"{worst_N:.2f} N"
            + (f", and falls from {turns[-1]:.2f} N on" if turns else "")
            + ". "
            + _at_between(refit, at_between)
        )
    return texts


def _at_between(refit: PrintedPolynomial, ours: Array) -> str:
    if not np.isfinite(ours).any():
        return ""
    theirs = float(refit(BETWEEN_N))
    return (
        f"At {BETWEEN_N:g} N it gives {theirs:.0f} pC, the model {ours[0]:.0f} pC "
        f"({signed(100.0 * (ours[0] / theirs - 1.0))} %)."
    )


def _rotations_picture(comparisons: list[Comparison], path: Path) -> None:
    by_rotation = group_by(comparisons, "rotation_deg")
    ours, printed = (curves(by_rotation, "force_N", y) for y in ("ours_pC", "thesis_pC"))
    with drawing(path, 180, 120) as figure:
        axes = figure.subplot_mosaic([["all", "mean"], ["all", "difference"]])
        draw_compared(axes["all"], by_rotation, "force_N")
        _relative(axes["mean"], _over_mean(ours), _over_mean(printed))
        draw_differences(axes["difference"], by_rotation, "force_N")


def _over_mean(rotations: list[Series]) -> list[Series]:
    """Excess over the mean of all rotations in percent; none if their forces differ."""
    if not rotations or len({len(rotation.x) for rotation in rotations}) > 1:
        return []
    mean = np.mean([rotation.y for rotation in rotations], axis=0)
    return [
        Series(rotation.label, rotation.x, 100.0 * (rotation.y / mean - 1.0))
        for rotation in rotations
    ]


def _relative(ax: Axes, ours: list[Series], printed: list[Series]) -> None:
    inks = colours(len(ours))
    for curve, markers, ink in zip(ours, printed, inks, strict=True):
        ax.plot(curve.x, curve.y, ".-", color=ink, markersize=3)
        ax.plot(markers.x, markers.y, "o", color=ink, markerfacecolor="none")
    ax.set(xlabel="force (N)", ylabel="above the mean (%)")
    ax.set_xlim(left=0.0)
    label_curves(ax, ours, inks)


TRIANGLE_FORCE_CHAPTER = comparing(
    "force-triangle",
    "Section 3.4.1: charge against force, triangle at the centre",
    ("Fig. 3.20", "Table 3.4"),
    lambda thesis: thesis.from_("Table 3.4"),
    _triangle,
)
RECTANGLE_FORCE_CHAPTER = Chapter(
    "force-rectangle",
    "Sections 4.2 and 4.3: charge against force, rectangle at the centre",
    ("Fig. 4.5", "Fig. 4.6", "Fig. 4.11", "Fig. 4.12", "Table 4.5", "Table 4.6"),
    _rectangle_scenes,
    _rectangle,
)
