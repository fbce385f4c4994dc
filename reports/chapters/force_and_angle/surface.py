"""Chapter of the thesis report: charge over rotation and force as a product (section 4.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.optimize import brentq

from pvdf_fem.output.figures import (
    COLOURS,
)
from reports.chapters.force_and_angle.rectangle import Rectangle, table_scenes
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import EQUATION_DASHES, Dashed, Series
from reports.common.comparison import Comparison, group_by, series, sound
from reports.common.figures import draw_compared, drawing
from reports.common.page import Cell, Column, Picture, Table, signed
from reports.common.polynomial import PrintedProduct
from reports.common.results import Results
from reports.common.thesis_data import Thesis
from reports.thesis_methods.cosine_series import CosineSeries

Array = NDArray[np.float64]

#: Equation of the product, table, figure of the surface and figure of its cut, by electrode.
PRODUCTS = {"A": ("4.12", "Table 4.5", "4.7", "4.9"), "B": ("4.13", "Table 4.6", "4.8", "4.10")}
#: Force in N to which each normalised polynomial of A is fitted; None for their mean.
NORMALISED = {"4.6": 0.5, "4.4": 1.0, "4.8": 2.0, "4.9": None}
#: Ticks in N on the force axes of the surfaces.
FORCES_N = (0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 7.5)
#: Last rotation in degrees of the charges that belong to the electrode of their table. Those of 90°
#: are copies from the table of the other electrode.
LAST_DEG = 75.0
_RINGS: dict[str, Any] = {"marker": "o", "markerfacecolor": "none", "markersize": 3}


# -------------------------------------------------------------------------------------- surfaces


def _surface_picture(
    rectangle: Rectangle, product: PrintedProduct, electrode: str, path: Path
) -> None:
    """Our charge and that of the product, and the product's error, over rotation and force."""
    angles, forces = np.linspace(0.0, 90.0, 46), np.geomspace(0.25, 7.5, 60)
    product_pC = product.charge_pC(angles[None, :], forces[:, None])
    with drawing(path, 180, 90) as figure:
        left, right = figure.subplots(1, 2)
        if rectangle.ours is not None and rectangle.theirs is not None:
            ours, theirs = (
                charge_series.charge_pC(angles[None, :], forces[:, None], electrode)
                for charge_series in (rectangle.ours, rectangle.theirs)
            )
            _draw_charge(left, angles, forces, ours, product_pC)
            _draw_error(right, angles, forces, 100.0 * (product_pC / theirs - 1.0))
            _draw_printed(right, rectangle.table(PRODUCTS[electrode][1]))
        for ax in (left, right):
            ax.set(xlabel="rotation of the probe (°)", ylabel="force (N)")
            ax.set(xlim=(0.0, 90.0), xticks=range(0, 91, 15), yscale="log", ylim=(0.25, 7.5))
            ax.set_yticks(FORCES_N, [f"{F:g}" for F in FORCES_N])
            ax.minorticks_off()
            ax.grid(False)
        left.set_title(f"charge of {electrode} (pC)")
        right.set_title(f"Eq. {product.name} − thesis's charges (%)")
        kinds: tuple[tuple[str, dict[str, Any]], ...] = (
            ("this work", {"color": COLOURS[0]}),
            (f"Eq. {product.name}", {"color": COLOURS[1], "ls": EQUATION_DASHES}),
            (PRODUCTS[electrode][1], {"color": "black", "ls": "none", **_RINGS}),
        )
        keys = [Line2D([], [], label=label, lw=0.9, **look) for label, look in kinds]
        figure.legend(handles=keys, loc="outside lower center", ncols=3)


def _draw_charge(ax: Axes, angles: Array, forces: Array, ours: Array, product: Array) -> None:
    levels = np.array([400.0, 500, 600, 800, 1000, 1250, 1500, 1750, 2000, 2500, 3000])
    # The scale of the shades ends far above the charges, so that lines and labels can be read.
    shades = ax.contourf(
        angles, forces, ours, levels=[200.0, *levels, 4000.0], cmap="Blues", vmin=0.0, vmax=9000.0
    )
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.colorbar(shades, ax=ax, ticks=levels[::2].tolist())
    lines = ax.contour(angles, forces, ours, levels=levels, colors=COLOURS[0], linewidths=0.9)
    ax.clabel(lines, levels[:-1:2].tolist(), fontsize=7, colors="black")
    ax.contour(
        angles,
        forces,
        product,
        levels=levels,
        colors=COLOURS[1],
        linewidths=0.9,
        linestyles=[EQUATION_DASHES],
    )


def _draw_error(ax: Axes, angles: Array, forces: Array, percent: Array) -> None:
    levels = np.arange(-7.0, 7.1, 1.0)
    shades = ax.contourf(angles, forces, percent, levels=levels, cmap="RdBu_r", extend="both")
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.colorbar(shades, ax=ax, ticks=levels[1::2].tolist())
    ax.contour(angles, forces, percent, levels=[0.0], colors="black", linewidths=0.8)


def _draw_printed(ax: Axes, comparisons: list[Comparison]) -> None:
    places = np.array(
        [(comparison.charge.rotation_deg, comparison.charge.force_N) for comparison in comparisons]
    )
    ax.plot(*places.T, color="black", ls="none", clip_on=False, **_RINGS)


def _cuts_picture(thesis: Thesis, rectangle: Rectangle, path: Path) -> None:
    """The products of A and B at 1 N over the rotation."""
    angles = np.linspace(0.0, 90.0, 181)
    with drawing(path, 160, 80) as figure:
        ax = figure.subplots()
        rows = {
            electrode: _to_90(rectangle.table("Table 4.1", electrode=electrode))
            for electrode in "AB"
        }
        products = [
            Series(e, angles, thesis.products[PRODUCTS[e][0]].charge_pC(angles, 1.0)) for e in "AB"
        ]
        equations = Dashed("Eq. 4.12 and 4.13", products)
        draw_compared(ax, rows, "rotation_deg", equations if all(rows.values()) else None)


def _to_90(comparisons: list[Comparison]) -> list[Comparison]:
    return [comparison for comparison in comparisons if comparison.charge.rotation_deg <= 90.0]


# ---------------------------------------------------------------------------------------- tables


def _normalised_table(thesis: Thesis, rectangle: Rectangle) -> Table:
    """Charges of equations, table and this work, each over its charge at 0°."""
    comparisons = _to_90(rectangle.table("Table 4.1", electrode="A"))
    columns = [Column("rotation_deg", "rotation (°)", None)]
    columns += [
        Column(
            f"equation_{name}",
            f"Eq. {name}" + (f", {force_N:g} N" if force_N else ", mean"),
            4,
            "thesis",
        )
        for name, force_N in NORMALISED.items()
    ]
    columns += [
        Column("table_4_1", "Table 4.1, 1 N", 4, "thesis"),
        Column("miss_of_4_9_percent", "Eq. 4.9 − table (%)", 2, "thesis", signed=True),
        Column("ours", "ours, 1 N", 4),
    ]
    zero = [comparison for comparison in comparisons if comparison.charge.rotation_deg == 0]
    rows: list[list[Cell]] = []
    for comparison in comparisons if zero else []:
        angle = comparison.charge.rotation_deg
        values = [float(thesis.polynomials[name](np.radians(angle))) for name in NORMALISED]
        table = comparison.thesis_pC / zero[0].charge.charge_pC
        miss = 100.0 * (values[-1] / table - 1.0)
        rows.append([angle, *values, table, miss, comparison.ours_pC / zero[0].ours_pC])
    return Table(
        "normalised_equations",
        "Eq. 4.4, 4.6, 4.8 and 4.9: charge of A over its charge at 0°, as printed.",
        columns,
        rows,
    )


def _product_table(thesis: Thesis, rectangle: Rectangle) -> Table:
    columns = [
        Column("force_N", "force (N)", None),
        Column("thesis_contrast_percent", "thesis", 2, "A: 0° over 75° (%)"),
        Column("ours_contrast_percent", "ours", 2, "A: 0° over 75° (%)"),
    ]
    for number, *_ in PRODUCTS.values():
        group = f"Eq. {number} − its table, 0 to {LAST_DEG:g}°"
        columns += [
            Column(f"equation_{number}_least_pC", "from (pC)", 1, group, signed=True),
            Column(f"equation_{number}_largest_pC", "to (pC)", 1, group, signed=True),
            Column(f"equation_{number}_least_percent", "from (%)", 2, group, signed=True),
            Column(f"equation_{number}_largest_percent", "to (%)", 2, group, signed=True),
        ]
    columns += [
        Column("force_error_percent", "force from A at 0° by Eq. 4.12 (%)", 1, signed=True),
        Column("series_worst_percent", "cosine series, largest (%)", 2),
    ]
    forces = sorted({comparison.charge.force_N for comparison in rectangle.table("Table 4.5")})
    return Table(
        "product_errors",
        "Eq. 4.12 and 4.13 against the charges of Tables 4.5 and 4.6 that stand, how far "
        "rotation changes the charge, the error of a force read from the charge of A at 0°, and "
        "the cosine series through the same charges.",
        columns,
        [_product_row(thesis, rectangle, force_N) for force_N in forces],
    )


def _product_row(thesis: Thesis, rectangle: Rectangle, force_N: float) -> list[Cell]:
    row: list[Cell] = [force_N]
    of_a = group_by(sound(rectangle.table("Table 4.5", force_N=force_N)), "rotation_deg")
    row += [_contrast(of_a, y) for y in ("thesis_pC", "ours_pC")]
    worst = 0.0
    for electrode, (number, table, *_) in PRODUCTS.items():
        counted = sound(rectangle.table(table, force_N=force_N))
        misses = product_misses(thesis.products[number], counted)
        ends = (np.min, np.max)
        row += [float(extreme(miss)) if miss.size else None for miss in misses for extreme in ends]
        if rectangle.theirs is not None:
            worst = max(worst, _series_worst(rectangle.theirs, electrode, counted))
    charge = next((comparison.thesis_pC for comparison in of_a.get("0°", [])), None)
    row.append(_force_error(thesis.products["4.12"], force_N, charge))
    return [*row, 100.0 * worst if worst else None]


def product_misses(product: PrintedProduct, comparisons: list[Comparison]) -> tuple[Array, Array]:
    """PrintedProduct minus printed charges, in pC and in percent of these."""
    charges = [comparison.charge for comparison in comparisons]
    printed = np.array([charge.charge_pC for charge in charges])
    angles, forces = (
        [getattr(charge, key) for charge in charges] for key in ("rotation_deg", "force_N")
    )
    misses = product.charge_pC(angles, forces) - printed
    return misses, 100.0 * misses / printed


def _series_worst(
    charge_series: CosineSeries, electrode: str, comparisons: list[Comparison]
) -> float:
    charges = [comparison.charge for comparison in comparisons]
    misses = [
        float(charge_series.charge_pC(charge.rotation_deg, charge.force_N, electrode))
        / charge.charge_pC
        - 1.0
        for charge in charges
    ]
    return float(np.abs(misses).max()) if misses else 0.0


def _contrast(rows: dict[str, list[Comparison]], y: str) -> Cell:
    last = f"{LAST_DEG:g}°"
    if not {"0°", last} <= set(rows):
        return None
    (high,), (low,) = (series(rows[angle], angle, "force_N", y).y for angle in ("0°", last))
    return float(100.0 * (high / low - 1.0))


def _force_error(product: PrintedProduct, force_N: float, charge_pC: float | None) -> Cell:
    """Error in percent of the force that a product gives for a charge at 0°."""
    if charge_pC is None:
        return None
    low, high = 0.01, 10.0
    at_0 = float(product.angle(0.0))

    def gap(F: float) -> float:
        return at_0 * float(product.force(F)) - charge_pC

    if gap(low) * gap(high) > 0:
        return None
    return float(100.0 * (brentq(gap, low, high) / force_N - 1.0))


# ------------------------------------------------------------------------------------------- part


def _text(thesis: Thesis, rectangle: Rectangle) -> list[str]:
    counted = {
        electrode: sound(rectangle.table(table)) for electrode, (_, table, *_) in PRODUCTS.items()
    }
    if rectangle.theirs is None or not all(counted.values()):
        return ["Too few charges to judge the products."]
    misses = np.concatenate(
        [
            product_misses(thesis.products[PRODUCTS[electrode][0]], comparisons)
            for electrode, comparisons in counted.items()
        ],
        axis=1,
    )
    forces = [
        comparison.charge.force_N for comparisons in counted.values() for comparison in comparisons
    ]
    pC, percent = misses[0, np.equal(forces, 1.0)], misses[1]
    table_4_1 = rectangle.table("Table 4.1", electrode="A")
    span = float(np.ptp([comparison.thesis_pC for comparison in table_4_1]))
    return [
        "Section 4.2 takes the charge as one function of the angle times one of the force, and "
        "calls the agreement of Eq. 4.12 and 4.13 with its charges excellent. Against the charges "
        f"of Tables 4.5 and 4.6 that stand they miss by {signed(percent.min())} to "
        f"{signed(percent.max())} %, {np.sqrt(np.mean(percent**2)):.1f} % root mean square. At "
        f"1 N they lie {signed(pC.min())} to {signed(pC.max())} pC off, while rotation changes A "
        f"by {span:.1f} pC in all. The cause is the cubic in the force: with "
        f"{thesis.products['4.12'].force(0.0):.0f} and {thesis.products['4.13'].force(0.0):.0f} pC "
        "without a force it cannot follow a power of two thirds.",
        "Coefficients with three decimals are also too coarse for ten terms of alternating sign: "
        f"at 90° the normalised polynomials give {_at_90(thesis)}, where Table 4.1 has "
        f"{_ratio_90(rectangle):.4f}.",
        _best_text(rectangle, rectangle.theirs),
    ]


def _best_text(rectangle: Rectangle, theirs: CosineSeries) -> str:
    """How well the best product and the cosine series hold the charges."""
    return (
        "A product of two other functions would be good enough: the best one misses Table 4.5 from "
        f"0 to {LAST_DEG - 15:g}° by up to {best_product(rectangle, 'thesis_pC'):.2f} %, which is "
        f"its scatter, and our charges by up to {best_product(rectangle, 'ours_pC'):.2f} %. A "
        "cosine series in the angle whose coefficients vary with the force over the membrane law "
        f"needs {theirs.coefficients.size} numbers for A and B together and misses the charges of "
        f"Tables 4.1, 4.5 and 4.6 by {100 * theirs.rms:.2f} % root mean square, "
        f"{100 * theirs.worst:.2f} % at most, {100 * theirs.left_out:.2f} % where each is left out "
        "of the fit in turn."
    )


def _at_90(thesis: Thesis) -> str:
    values = [float(thesis.polynomials[name](np.pi / 2)) for name in NORMALISED]
    shown = [f"{value:.4f} (Eq. {name})" for name, value in zip(NORMALISED, values, strict=True)]
    return ", ".join(shown)


def _ratio_90(rectangle: Rectangle) -> float:
    charges = {
        comparison.charge.rotation_deg: comparison.charge.charge_pC
        for comparison in rectangle.table("Table 4.1", electrode="A")
    }
    return charges.get(90.0, np.nan) / charges.get(0.0, np.nan)


def best_product(rectangle: Rectangle, y: str) -> float:
    """Largest error in percent of the best product of two functions for the charges of Table 4.5.

    The product is best by least squares of the logarithms, which gives means of rows and columns.
    Rotations from 75° on are left out, since they contain the thesis's outliers and copies.
    """
    rows = [
        series(comparisons, "", "force_N", y).y
        for comparisons in group_by(rectangle.table("Table 4.5"), "rotation_deg").values()
        if comparisons[0].charge.rotation_deg < LAST_DEG
    ]
    if not rows or len({len(row) for row in rows}) > 1:
        return np.nan
    logs = np.log(rows)
    product = logs.mean(axis=0) + logs.mean(axis=1)[:, None] - logs.mean()
    return float(100.0 * np.abs(np.expm1(product - logs)).max())


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    rectangle = Rectangle.of(thesis, results)
    blocks: list[Picture | Table] = []
    for electrode, (number, table, surface, _) in PRODUCTS.items():
        file = f"figure_{surface.replace('.', '_')}.svg"
        _surface_picture(rectangle, thesis.products[number], electrode, out / file)
        blocks.append(
            Picture(
                file,
                f"Fig. {surface}: charge of {electrode} over rotation and force; filled and lined, "
                f"this work, dashed, Eq. {number}. Right, Eq. {number} minus the thesis's own "
                "charges (cosine series through Tables 4.1, 4.5 and 4.6); rings are the printed "
                f"charges of {table}.",
            )
        )
    _cuts_picture(thesis, rectangle, out / "figure_4_9.svg")
    cuts = Picture(
        "figure_4_9.svg",
        "Figs. 4.9 and 4.10: the surfaces of A and B cut at 1 N. Dashed: Eq. 4.12 and 4.13; "
        "rings: Table 4.1.",
    )
    tables = [_product_table(thesis, rectangle), _normalised_table(thesis, rectangle)]
    return Content(_text(thesis, rectangle), [*blocks, cuts, *tables])


SURFACE_CHAPTER = Chapter(
    "surface",
    "Section 4.2: charge over rotation and force",
    ("Fig. 4.7", "Fig. 4.8", "Fig. 4.9", "Fig. 4.10"),
    table_scenes,
    _compose,
)
