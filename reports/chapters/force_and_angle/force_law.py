"""Chapter of the thesis report: laws of charge against force, and how linear the sensor is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS, GREY
from pvdf_fem.solution.solve import rest_charges
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import EQUATION_DASHES, Series
from reports.common.comparison import Comparison, compare, group_by, series, sound
from reports.common.figures import LEVEL_DASHES, drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene
from reports.thesis_methods.force_law import Linearity, MembraneLaw, linearity, local_exponents

Array = NDArray[np.float64]

#: The two forces in N on which the thesis's claim of a linear range rests.
CLAIMED_N = (0.25, 0.5)
#: Forces in N at which that range is computed.
SMALL_N = tuple(round(0.05 * step, 2) for step in range(1, 11))
#: Table and electrode of the charges that the thesis fitted each of its polynomials to.
FITS = {
    "3.4.1_A": ("Table 3.4", "A"),
    "3.4.1_B": ("Table 3.4", "B"),
    "3.4.1_C": ("Table 3.4", "C"),
    "4.10": ("Table 4.5", "A"),
    "4.10 refit": ("Table 4.5", "A"),
    "4.11": ("Table 4.6", "B"),
    "4.11 refit": ("Table 4.6", "B"),
    "4.12": ("Table 4.5", "A"),
    "4.13": ("Table 4.6", "B"),
}


def finite(curve: Series) -> tuple[Array, Array]:
    """Forces and charges of the points of a series that have a value."""
    has_value = np.isfinite(curve.y)
    return curve.x[has_value], curve.y[has_value]


def law_through(F: Array, Q: Array, rest_charge_pC: float | None = None) -> MembraneLaw | None:
    """The membrane law through the charges that have a value; None if these are less than three."""
    has_value = np.isfinite(Q)
    if has_value.sum() < 3:
        return None
    return MembraneLaw.fit(F[has_value], Q[has_value], rest_charge_pC)


def swing(
    charge_pC: Callable[[Array], Array], law: MembraneLaw, low: float, high: float
) -> tuple[float, float]:
    """The force at which a curve is farthest from a law, and its deviation there in percent."""
    F = np.geomspace(low, high, 2000)
    percent = 100.0 * (charge_pC(F) / law.charge_pC(F) - 1.0)
    worst = int(np.abs(percent).argmax())
    return float(F[worst]), float(percent[worst])


def rest_charge_pC(scene: Scene) -> float:
    """Charge of the first electrode from the pretension alone."""
    return float(1e12 * rest_charges(scene)[0])


# ----------------------------------------------------------------------------- rows of the tables


@dataclass(frozen=True)
class ForceRow:
    """Charges of one electrode at one rotation against force, the thesis's and ours."""

    source: str
    label: str
    electrode: str
    rotation_deg: float
    comparisons: tuple[Comparison, ...]

    def data(self, y: str, *, with_defects: bool = False) -> tuple[Array, Array]:
        """Forces and charges, without or with those that have a defect."""
        chosen = self.comparisons if with_defects else sound(self.comparisons)
        return finite(series(chosen, self.label, "force_N", y))


def rows(comparisons: list[Comparison]) -> Iterator[ForceRow]:
    """The rows of Tables 3.4, 4.5 and 4.6, in the order of these tables."""
    for source, of_source in group_by(comparisons, "source").items():
        for electrode, of_electrode in group_by(of_source, "electrode").items():
            for rotation, row in group_by(of_electrode, "rotation_deg").items():
                label = electrode if source == "Table 3.4" else f"{electrode}, {rotation}"
                yield ForceRow(source, label, electrode, row[0].charge.rotation_deg, tuple(row))


def _charges(thesis: Thesis) -> list[Charge]:
    return thesis.from_("Table 3.4", "Table 4.5", "Table 4.6")


# -------------------------------------------------------------------------------------- exponents


def _exponents(F: Array, Q: Array) -> tuple[Array, Array]:
    return local_exponents(F, Q) if len(F) > 1 else (np.zeros(0), np.zeros(0))


def _exponent_table(force_rows: list[ForceRow]) -> Table:
    columns = [Column("source", "place in the thesis"), Column("row", "electrode, rotation")]
    for key_start, label in (("thesis", "thesis"), ("ours", "ours")):
        columns += [
            Column(f"{key_start}_{key}", key, 3, f"{label}: d ln Q / d ln F")
            for key in ("least", "median", "largest")
        ]
    lines: list[list[Cell]] = []
    for row in force_rows:
        line: list[Cell] = [row.source, row.label]
        for y in ("thesis_pC", "ours_pC"):
            _, values = _exponents(*row.data(y, with_defects=y == "ours_pC"))
            summary = (np.min, np.median, np.max)
            line += [float(statistic(values)) if values.size else None for statistic in summary]
        lines.append(line)
    return Table(
        "force_exponents",
        "Local exponents between neighbouring forces, of the thesis's charges that stand and of "
        "ours. A proportional sensor has 1, a membrane without pretension 2/3.",
        columns,
        lines,
    )


# ---------------------------------------------------------------------------------- laws and fits


@dataclass(frozen=True)
class FittedCurve:
    """A curve through a row of charges, with its number of free parameters."""

    name: str
    row: ForceRow
    parameters: int
    charge_pC: Callable[[Array], Array]

    def cells(self, rest_pC: float) -> list[Cell]:
        """The cells of the curve in the table of fits."""
        F, Q = self.row.data("thesis_pC", with_defects=True)
        misses = self.charge_pC(F) - Q
        line: list[Cell] = [self.name, self.row.source, self.row.label, len(F), self.parameters]
        line += [float(np.abs(misses).max()), float(100.0 * np.abs(misses / Q).max())]
        law = law_through(F, Q)
        worst_N, off = swing(self.charge_pC, law, F[0], F[-1]) if law is not None else (None, None)
        zero = float(self.charge_pC(np.zeros(1))[0])
        beyond = float(self.charge_pC(np.array([7.5]))[0])
        return [*line, off, worst_N, zero, zero - rest_pC, beyond]


def _fits(thesis: Thesis, force_rows: list[ForceRow], rest_pC: float) -> Iterator[FittedCurve]:
    """The thesis's polynomials in the force, and the membrane law through the same rows."""
    for row in force_rows:
        at_zero = row.source == "Table 3.4" or row.rotation_deg == 0
        if not at_zero or len(row.comparisons) < 4:
            continue
        key = (row.source, row.electrode)
        for name in (name for name, data in FITS.items() if data == key):
            if name in thesis.products:
                force = thesis.products[name].force
                yield FittedCurve(f"Eq. {name}, force factor", row, len(force.series), force)
            else:
                equation = thesis.polynomials[name]
                kind = f"cubic of {name.split('_')[0]}" if "_" in name else f"Eq. {name}"
                yield FittedCurve(kind, row, len(equation.series), equation)
        F, Q = row.data("thesis_pC", with_defects=True)
        for rest_charge, parameters in ((rest_pC, 1), (None, 2)):
            law = law_through(F, Q, rest_charge)
            if law is not None:
                kind = "known" if parameters == 1 else "fitted"
                yield FittedCurve(f"membrane law, Q0 {kind}", row, parameters, law.charge_pC)


def _fit_table(fits: list[FittedCurve], rest_pC: float) -> Table:
    columns = [
        Column("fit", "curve"),
        Column("source", "data"),
        Column("row", "row"),
        Column("data", "charges", 0),
        Column("parameters", "parameters", 0),
        Column("worst_pC", "pC", 2, "largest miss at the data"),
        Column("worst_percent", "%", 2, "largest miss at the data"),
        Column("swing_percent", "%", 1, "farthest from the law between them", signed=True),
        Column("swing_at_N", "at (N)", 2, "farthest from the law between them"),
        Column("at_0_N_pC", "at 0 N (pC)", 1),
        Column("at_0_N_over_rest_pC", "above rest (pC)", 1, signed=True),
        Column("at_7_5_N_pC", "at 7.5 N (pC)", 0),
    ]
    return Table(
        "force_fits",
        "The thesis's polynomials in the force against the charges they were fitted to, and the "
        "membrane law Q² (Q − Q0) = q³ F² through the same charges. Between the data, the law is "
        f"the one with Q0 and q fitted. The charge at rest is {rest_pC:.1f} pC.",
        columns,
        [fit.cells(rest_pC) for fit in fits],
    )


# -------------------------------------------------------------------------------------- linearity


def _small(thesis: Thesis) -> list[Scene]:
    """Scenes of the claimed linear range, if the data have the charges that it rests on."""
    forces = {charge.force_N for charge in thesis.from_("Table 3.4")}
    if not set(CLAIMED_N) <= forces:
        return []
    scenes = [thesis_scene("4", "rect14x7", force_N=F) for F in SMALL_N]
    return [scene.with_(**{"numerics.observable": MATERIAL}) for scene in scenes]


def _small_series(thesis: Thesis, results: Results) -> Series:
    scenes = _small(thesis)
    charges = [results[scene].charge_pC("A", MATERIAL) for scene in scenes]
    return Series("A", np.array([scene.load.force_N for scene in scenes]), np.array(charges))


def _linearity_text(force_rows: list[ForceRow], small: Series, rest_pC: float) -> list[str]:
    F, Q = finite(small)
    doubled = [
        float(np.interp(CLAIMED_N[1], F, Q) / np.interp(CLAIMED_N[0], F, Q))
        for F, Q in (row.data("thesis_pC") for row in force_rows)
        if set(CLAIMED_N) <= set(F.tolist())
    ]
    if len(F) < len(SMALL_N) or not doubled:
        return ["Too few charges to judge the claim of a linear range."]
    line, tail = linearity(F, Q, 0.5), linearity(F[F >= 0.249], Q[F >= 0.249], 0.5)
    whole = linearity(F, Q - rest_pC, 0.5)
    law = law_through(F, Q, rest_pC)
    return [
        "The thesis (3.4.3, 3.5, 6.2) calls the sensor linear up to 0.5 N. In its tables 0.5 N is "
        f"the second force: the charge there is {min(doubled):.2f} to {max(doubled):.2f} times "
        "that of 0.25 N, not twice, and through two points there always is a straight line. "
        f"Computed at ten forces up to 0.5 N, the charge misses the best line by "
        f"{100 * line.deviation:.1f} % of its span; that line meets the axis at "
        f"{line.offset_pC:.0f} pC instead of the {rest_pC:.1f} pC at rest, and the slope falls to "
        f"{line.slope_ratio:.2f} of its first value. The exponent of the charge above rest is "
        f"{whole.exponent:.2f}. From 0.25 N on the deviation is {100 * tail.deviation:.1f} %."
        + (
            f" The one inflection, where the curve is straight, is near {law.inflection_N:.3f} N."
            if law is not None
            else ""
        ),
    ]


def _fit_text(fits: list[FittedCurve], rest_pC: float) -> list[str]:
    cubics = [fit for fit in fits if fit.name.startswith("cubic")]
    laws = [fit for fit in fits if fit.name.startswith("membrane") and fit.row.rotation_deg == 0]
    if not cubics or not laws:
        return []
    zero = [float(fit.charge_pC(np.zeros(1))[0]) for fit in cubics]
    law = law_through(*cubics[0].row.data("thesis_pC"), rest_pC)
    far = np.array([3.5, 5.0, 7.5])
    beyond = ", ".join(f"{charge:.0f}" for charge in cubics[0].charge_pC(far))
    lawful = ", ".join(f"{charge:.0f}" for charge in law.charge_pC(far)) if law is not None else "–"
    worst = {count: max(_worst(fit) for fit in laws if fit.parameters == count) for count in (1, 2)}
    return [
        "Beyond 0.5 N the thesis proposes cubic polynomials. Those of section 3.4.1 have four "
        "coefficients for four charges, which leaves nothing to test them with. They give "
        f"{min(zero):.1f} to {max(zero):.1f} pC without a force, where the pretension makes "
        f"{rest_pC:.1f} pC, and that of A {beyond} pC at 3.5, 5 and 7.5 N, where the law below "
        f"through the same charges has {lawful} pC.",
        "The slopes of a membrane are proportional to force over tension, and raise the tension "
        "by their squares. With the charge in place of the tension, Q² (Q − Q0) = q³ F²: an "
        "exponent that grows from 0 at rest to 2/3. It holds the seven charges from 0.25 to "
        f"7.5 N of Tables 4.5 and 4.6, 0°, within {worst[1]:.2f} % with the charge at rest "
        f"known and q alone fitted, within {worst[2]:.2f} % with both fitted.",
    ]


def _worst(fit: FittedCurve) -> float:
    F, Q = fit.row.data("thesis_pC", with_defects=True)
    return float(100.0 * np.abs(fit.charge_pC(F) / Q - 1.0).max())


# -------------------------------------------------------------------------------- picture and part


def _exponents_picture(ax: Axes, force_rows: list[ForceRow], small: Series) -> None:
    for level, label in ((1.0, "proportional"), (2 / 3, "2/3")):
        ax.axhline(level, color=GREY, linewidth=0.8, linestyle=LEVEL_DASHES)
        ax.annotate(
            label,
            (0.02, level),
            (0, 2),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            color=GREY,
            fontsize=8,
        )
    kinds: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("ours_pC", "ours", {"marker": ".", "color": COLOURS[0]}),
        ("thesis_pC", "thesis", {"marker": "o", "color": COLOURS[1], "markerfacecolor": "none"}),
    )
    for y, label, look in kinds:
        none = np.zeros(0), np.zeros(0)
        points = [none] + [
            _exponents(*row.data(y, with_defects=y == "ours_pC")) for row in force_rows
        ]
        x, exponents = (np.concatenate(values) for values in zip(*points, strict=True))
        ax.plot(x, exponents, linestyle="none", label=f"{label}, all rows", **look)
    F, Q = finite(small)
    ax.plot(*_exponents(F, Q), ".-", color="black", linewidth=0.8, label="ours, A, 0°, material")
    ax.set(xscale="log", xlim=(0.05, 10.0), ylim=(0.55, 1.05))
    ax.set(xlabel="force (N)", ylabel="d ln Q / d ln F")
    ax.legend(loc="upper right", bbox_to_anchor=(1.0, 0.88))


def _linear_picture(ax: Axes, small: Series, rest_pC: float) -> None:
    F, Q = finite(small)
    ax.set(xlabel="force (N)", ylabel="charge of A (pC)")
    if len(F) < len(SMALL_N):
        return
    line: Linearity = linearity(F, Q, 0.5)
    law = MembraneLaw.fit(F, Q, rest_pC)
    x = np.linspace(0.0, 0.55, 200)
    ax.plot(F, Q, ".", color=COLOURS[0], markersize=6, label="ours, material")
    ax.plot([0.0], [rest_pC], "s", color=COLOURS[0], clip_on=False, label="pretension alone")
    ax.plot(x, law.charge_pC(x), color=COLOURS[0], linewidth=0.9, label="membrane law, Q0 known")
    ax.plot(
        x,
        line.offset_pC + line.slope_pC_N * x,
        color=COLOURS[1],
        linestyle=EQUATION_DASHES,
        label="best straight line",
    )
    ax.set(xlim=(0.0, 0.55), ylim=(0.0, None))
    ax.legend(loc="lower right")


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    force_rows = list(rows(compare(_charges(thesis), results)))
    small = _small_series(thesis, results)
    rest_pC = rest_charge_pC(thesis_scene("4", "rect14x7"))
    fits = list(_fits(thesis, force_rows, rest_pC))
    with drawing(out / "force_law.svg", 180, 85) as figure:
        left, right = figure.subplots(1, 2)
        _exponents_picture(left, force_rows, small)
        _linear_picture(right, small, rest_pC)
    return Content(
        [*_linearity_text(force_rows, small, rest_pC), *_fit_text(fits, rest_pC)],
        [
            Picture(
                "force_law.svg",
                "Sections 3.4.3 and 3.5: local exponents of all rows of Tables 3.4, 4.5 and 4.6 "
                "(rings: thesis, dots: ours) and of A below 0.5 N; charge of A under the "
                "rectangle at 0° up to 0.5 N, the range called linear.",
            ),
            _fit_table(fits, rest_pC),
            _exponent_table(force_rows),
        ],
    )


FORCE_LAW_CHAPTER = Chapter(
    "force-law",
    "Sections 3.4.3, 3.5 and 6.2: is the sensor linear, and which law does it follow",
    ("Section 3.4.3",),
    lambda thesis: [scene_of(charge) for charge in _charges(thesis)] + _small(thesis),
    _compose,
)
