"""Parts of the thesis report: charge against force (sections 3.4, 4.2 and 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.maps.force_law import MembraneLaw
from pvdf_fem.maps.polynomial import Polynomial
from pvdf_fem.output.figures import (
    COLOURS,
    GREY,
    Series,
    charge_against_force,
    colours,
    differences,
    label_curves,
    new_figure,
    save,
    style,
)
from reports.chapters.force_and_angle.force_law import finite, law_through, swing
from reports.common.comparison import Comparison, compare, series, wide_table
from reports.common.page import Picture, Table
from reports.common.part import Content, Part, comparing
from reports.common.results import THESIS_EDGE, Results
from reports.common.tables import CASE, FORCE, ROTATION, by, curves, of, signed, sound_differences
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene

Array = NDArray[np.float64]

#: A force between the last two of Tables 4.5 and 4.6, where Eq. 4.10 and 4.11 leave the curve.
BETWEEN_N = 6.5


@dataclass(frozen=True)
class Place:
    """Where the thesis treats an electrode under the rectangle."""

    row: str
    rotations: str
    table: str
    equation: str

    @property
    def row_file(self) -> str:
        """Picture of the row of 0°."""
        return f"figure_{self.row.replace('.', '_')}.svg"

    @property
    def rotations_file(self) -> str:
        """Picture of all rotations."""
        return f"figure_{self.rotations.replace('.', '_')}.svg"


#: By electrode.
RECTANGLE = {
    "A": Place("4.5", "4.11", "4.5", "4.10"),
    "B": Place("4.6", "4.12", "4.6", "4.11"),
}


# ------------------------------------------------------------------------ triangle, section 3.4.1


def _triangle(found: list[Comparison], out: Path) -> Content:
    electrodes = by(found, "electrode")
    with style():
        figure = new_figure(160, 130)
        above, below = figure.subplots(2, height_ratios=(3, 2))
        charge_against_force(
            above, curves(electrodes, "force_N"), curves(electrodes, "force_N", "thesis_pC")
        )
        differences(below, sound_differences(electrodes, "force_N"), "force (N)")
        save(figure, out / "figure_3_20.svg")
    return Content(
        [
            "The triangular probe, turned by 90° clockwise, at the centre of the three-electrode "
            "sensor. A third of a turn maps the probe and the ring of electrodes onto themselves, "
            "so that A, B and C must have equal charges; the thesis says “virtually”. The largest "
            f"of the three is above the smallest by {_spread(found, 'thesis_pC')} in the thesis, "
            f"by {_spread(found, 'ours_pC')} for averages along the electrodes' edges as it takes "
            f"them, and by {_spread(found, 'material_pC')} for the charge of their area: the "
            "difference is made by edges that all lie along x and y, whatever the electrode's "
            "place on the ring.",
        ],
        [
            Picture(
                "figure_3_20.svg",
                "Fig. 3.20 and Table 3.4: charge against force; below, the differences. Dashed: "
                "±2 %.",
            ),
            wide_table("table_3_4", "Table 3.4: charge against force.", [CASE, FORCE], found),
        ],
    )


def _spread(found: list[Comparison], y: str) -> str:
    """Range over the electrodes at each force in percent of their mean."""
    rows = [
        [one.charge.charge_pC if y == "thesis_pC" else getattr(one, y) for one in some]
        for some in by(found, "force_N").values()
    ]
    spreads = [100.0 * np.ptp(row) / np.mean(row) for row in rows]
    return f"{min(spreads):.2f} to {max(spreads):.2f} %" if spreads else "–"


# -------------------------------------------------- rectangle, Figs. 4.5, 4.6, 4.11 and 4.12


def _rectangle_charges(thesis: Thesis) -> list[Charge]:
    return thesis.from_("Table 4.5", "Table 4.6")


def _between(thesis: Thesis) -> list[Scene]:
    """A scene between the last two forces of the rows of 0°."""
    forces = {c.force_N for c in _rectangle_charges(thesis) if c.rotation_deg == 0}
    inside = min(forces, default=BETWEEN_N) < BETWEEN_N < max(forces, default=BETWEEN_N)
    return [thesis_scene("4", "rect14x7", force_N=BETWEEN_N)] if inside else []


def _rectangle_scenes(thesis: Thesis) -> list[Scene]:
    return [scene_of(charge) for charge in _rectangle_charges(thesis)] + _between(thesis)


def _rectangle(thesis: Thesis, results: Results, out: Path) -> Content:
    found = compare(_rectangle_charges(thesis), results)
    extra = {
        e: [(BETWEEN_N, results[s].charge_pC(e, THESIS_EDGE)) for s in _between(thesis)]
        for e in "AB"
    }
    ours = {
        e: _with(series(of(found, electrode=e, rotation_deg=0.0), e, "force_N"), extra[e])
        for e in "AB"
    }
    printed = {
        e: series(of(found, electrode=e, rotation_deg=0.0), e, "force_N", "thesis_pC") for e in "AB"
    }
    blocks: list[Picture | Table] = []
    for e, place in RECTANGLE.items():
        rows = of(found, electrode=e)
        _degree_six_picture(thesis, place.equation, ours[e], printed[e], out / place.row_file)
        _rotations_picture(rows, out / place.rotations_file)
        blocks += _rectangle_blocks(e, place, rows)
    return Content(
        [
            "The rectangular probe of 14 mm × 7 mm at the centre of the four-electrode sensor. "
            "Rows of 90° are copies of the other table's 0° in the thesis, digit for digit; they "
            "are shown but not counted.",
            *_degree_six_text(thesis, ours, printed),
        ],
        blocks,
    )


def _rectangle_blocks(e: str, place: Place, rows: list[Comparison]) -> list[Picture | Table]:
    return [
        Picture(
            place.row_file,
            f"Fig. {place.row}: charge of {e} against force, 0°, with the thesis's polynomial of "
            "degree 6 as printed (dashed) and interpolated again in full precision (dotted). "
            "Right, everything over the membrane law through the thesis's charges.",
        ),
        Picture(
            place.rotations_file,
            f"Fig. {place.rotations}: charge of {e} against force at the rotations of Table "
            f"{place.table}; right, relative to the mean of the rotations, thesis and ours each "
            "over its own (the thesis's outliers at 75°, 5 N included), and the differences "
            "(charges with a defect left out). Dashed: ±2 %.",
        ),
        wide_table(
            f"table_{place.table.replace('.', '_')}",
            f"Table {place.table}: charge of {e} against rotation and force.",
            [CASE, ROTATION, FORCE],
            rows,
        ),
    ]


def _with(one: Series, points: list[tuple[float, float]]) -> Series:
    """A series with further points."""
    every = np.array(sorted([*zip(one.x, one.y, strict=True), *points])).reshape(-1, 2)
    return Series(one.label, every[:, 0], every[:, 1])


def _degree_six_picture(
    thesis: Thesis, number: str, ours: Series, printed: Series, path: Path
) -> None:
    law = law_through(*finite(printed))
    with style():
        figure = new_figure(180, 75)
        left, right = figure.subplots(1, 2)
        right.axhline(0.0, color=GREY, linewidth=0.8)
        F = np.linspace(printed.x[0], printed.x[-1], 300) if law else np.zeros(0)
        for name, dashes, label in (
            (number, (5, 2), f"Eq. {number} as printed"),
            (f"{number} refit", (1, 1.5), "in full precision"),
        ):
            equation = Series(label, F, thesis.polynomials[name](F))
            look: dict[str, Any] = {"color": COLOURS[1], "linestyle": (0, dashes)}
            left.plot(equation.x, equation.y, **look)
            _over_law(right, equation, law, label=label, **look)
        charge_against_force(left, [ours], [printed])
        ring = {"marker": "o", "linestyle": "none", "markerfacecolor": "none"}
        _over_law(right, ours, law, color=COLOURS[0], marker=".")
        _over_law(right, printed, law, color=COLOURS[0], **ring)
        right.set(xlabel="force (N)", ylabel="above the law (%)", xlim=left.get_xlim())
        if law is not None:
            right.legend(loc="upper left")
        save(figure, path)


def _over_law(ax: Axes, one: Series, law: MembraneLaw | None, **look: Any) -> None:
    if law is not None:
        ax.plot(one.x, 100.0 * (one.y / law.charge_pC(one.x) - 1.0), **look)


def _degree_six_text(
    thesis: Thesis, ours: dict[str, Series], printed: dict[str, Series]
) -> list[str]:
    texts = []
    for e, place in RECTANGLE.items():
        number = place.equation
        law = law_through(*finite(printed[e]))
        if law is None or len(printed[e].x) < 7:
            continue
        F, Q = printed[e].x, printed[e].y
        rounding = thesis.polynomials[number](F) - Q
        refit = thesis.polynomials[f"{number} refit"]
        at, percent = swing(refit, law, *F[[0, -1]])
        turns = refit.turning_points(*F[[0, -1]])
        there = ours[e].y[np.isclose(ours[e].x, BETWEEN_N)]
        texts.append(
            f"Eq. {number} passes through its seven data with seven coefficients. As printed it "
            f"is {signed(rounding[-2])} pC off at {F[-2]:g} N and {signed(rounding[-1])} pC at "
            f"{F[-1]:g} N, from rounding. With full precision it still swings between the last "
            f"two: it is {signed(percent)} % off the membrane law through the same charges at "
            f"{at:.2f} N"
            + (f", and falls from {turns[-1]:.2f} N on" if turns else "")
            + ". "
            + _at_between(refit, there)
        )
    return texts


def _at_between(refit: Polynomial, ours: Array) -> str:
    if not np.isfinite(ours).any():
        return ""
    theirs = float(refit(BETWEEN_N))
    return (
        f"At {BETWEEN_N:g} N it gives {theirs:.0f} pC, the model {ours[0]:.0f} pC "
        f"({signed(100.0 * (ours[0] / theirs - 1.0))} %)."
    )


def _rotations_picture(found: list[Comparison], path: Path) -> None:
    some = by(found, "rotation_deg")
    ours, printed = (curves(some, "force_N", y) for y in ("ours_pC", "thesis_pC"))
    with style():
        figure = new_figure(180, 120)
        axes = figure.subplot_mosaic([["all", "mean"], ["all", "difference"]])
        charge_against_force(axes["all"], ours, printed)
        _relative(axes["mean"], _over_mean(ours), _over_mean(printed))
        differences(axes["difference"], sound_differences(some, "force_N"), "force (N)")
        save(figure, path)


def _over_mean(rotations: list[Series]) -> list[Series]:
    """Percent above the mean of all rotations, at the forces that all of them have."""
    if not rotations or len({len(one.x) for one in rotations}) > 1:
        return []
    mean = np.mean([one.y for one in rotations], axis=0)
    return [Series(one.label, one.x, 100.0 * (one.y / mean - 1.0)) for one in rotations]


def _relative(ax: Axes, ours: list[Series], printed: list[Series]) -> None:
    inks = colours(len(ours))
    for one, theirs, ink in zip(ours, printed, inks, strict=True):
        ax.plot(one.x, one.y, ".-", color=ink, markersize=3)
        ax.plot(theirs.x, theirs.y, "o", color=ink, markerfacecolor="none")
    ax.set(xlabel="force (N)", ylabel="above the mean (%)")
    ax.set_xlim(left=0.0)
    label_curves(ax, ours, inks)


TRIANGLE_FORCE_PART = comparing(
    "force-triangle",
    "Section 3.4.1: charge against force, triangle at the centre",
    ("Fig. 3.20", "Table 3.4"),
    lambda thesis: thesis.from_("Table 3.4"),
    _triangle,
)
RECTANGLE_FORCE_PART = Part(
    "force-rectangle",
    "Sections 4.2 and 4.3: charge against force, rectangle at the centre",
    ("Fig. 4.5", "Fig. 4.6", "Fig. 4.11", "Fig. 4.12", "Table 4.5", "Table 4.6"),
    _rectangle_scenes,
    _rectangle,
)
