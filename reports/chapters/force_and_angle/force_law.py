"""Part of the thesis report: laws of charge against force, and how linear the sensor is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.maps.force_law import Linearity, MembraneLaw, linearity, local_exponents
from pvdf_fem.output.figures import COLOURS, GREY, Series, new_figure, save, style
from reports.common.comparison import Comparison, compare, series
from reports.common.page import Cell, Column, Picture, Table
from reports.common.part import Content, Part
from reports.common.results import MATERIAL, Results
from reports.common.tables import by, sound
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene

Array = NDArray[np.float64]

#: The two forces on which the thesis's linear range rests, and those at which we look into it.
CLAIMED_N = (0.25, 0.5)
SMALL_N = tuple(round(0.05 * step, 2) for step in range(1, 11))
#: Polynomials in the force with the rows of data they were fitted to, and how many they had free.
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


def finite(one: Series) -> tuple[Array, Array]:
    """Forces and charges of a series without those that have no value."""
    there = np.isfinite(one.y)
    return one.x[there], one.y[there]


def law_through(F: Array, Q: Array, rest_charge_pC: float | None = None) -> MembraneLaw | None:
    """The membrane law of charges, those without value left out; None for less than three."""
    there = np.isfinite(Q)
    if there.sum() < 3:
        return None
    return MembraneLaw.fit(F[there], Q[there], rest_charge_pC)


def swing(
    charge_pC: Callable[[Array], Array], law: MembraneLaw, low: float, high: float
) -> tuple[float, float]:
    """Where a curve is farthest from a law between two forces, and by how many percent."""
    F = np.geomspace(low, high, 2000)
    percent = 100.0 * (charge_pC(F) / law.charge_pC(F) - 1.0)
    worst = int(np.abs(percent).argmax())
    return float(F[worst]), float(percent[worst])


def rest_charge_pC(scene: Scene) -> float:
    """Charge of the first electrode that the pretension alone makes: (d31 S11 + d32 S22) A."""
    film = scene.film
    stress = -film.stiffness @ [film.thermal_strain, film.thermal_strain, 0.0]
    area = scene.electrode_list[0].outline.area
    return float(1e12 * area * (film.d31 * stress[0] + film.d32 * stress[1]))


# ----------------------------------------------------------------------------- rows of the tables


@dataclass(frozen=True)
class Row:
    """Charges of one electrode at one rotation against force: the thesis's, and ours."""

    source: str
    label: str
    electrode: str
    rotation_deg: float
    found: tuple[Comparison, ...]

    def data(self, y: str, *, every: bool = False) -> tuple[Array, Array]:
        """Forces and charges that stand, or all of them."""
        chosen = self.found if every else sound(self.found)
        return finite(series(chosen, self.label, "force_N", y))


def rows(found: list[Comparison]) -> Iterator[Row]:
    """Rows of the tables of forces, in the order of the tables."""
    for source, some in by(found, "source").items():
        for electrode, of_one in by(some, "electrode").items():
            for rotation, row in by(of_one, "rotation_deg").items():
                label = electrode if source == "Table 3.4" else f"{electrode}, {rotation}"
                yield Row(source, label, electrode, row[0].charge.rotation_deg, tuple(row))


def _charges(thesis: Thesis) -> list[Charge]:
    return thesis.from_("Table 3.4", "Table 4.5", "Table 4.6")


# -------------------------------------------------------------------------------------- exponents


def _exponents(F: Array, Q: Array) -> tuple[Array, Array]:
    return local_exponents(F, Q) if len(F) > 1 else (np.zeros(0), np.zeros(0))


def _exponent_table(found: list[Row]) -> Table:
    columns = [Column("source", "place in the thesis"), Column("row", "electrode, rotation")]
    for who, label in (("thesis", "thesis"), ("ours", "ours")):
        columns += [
            Column(f"{who}_{key}", key, 3, f"{label}: d ln Q / d ln F")
            for key in ("least", "median", "largest")
        ]
    cells: list[list[Cell]] = []
    for row in found:
        cell: list[Cell] = [row.source, row.label]
        for y in ("thesis_pC", "ours_pC"):
            _, values = _exponents(*row.data(y, every=y == "ours_pC"))
            summary = (np.min, np.median, np.max)
            cell += [float(of(values)) if values.size else None for of in summary]
        cells.append(cell)
    return Table(
        "force_exponents",
        "Local exponents between neighbouring forces, of the thesis's charges that stand and of "
        "ours. A proportional sensor has 1, a membrane without pretension 2/3.",
        columns,
        cells,
    )


# ---------------------------------------------------------------------------------- laws and fits


@dataclass(frozen=True)
class Fit:
    """A curve through a row of charges and how it does."""

    name: str
    row: Row
    parameters: int
    charge_pC: Callable[[Array], Array]

    def cells(self, rest_pC: float) -> list[Cell]:
        """A row of the table of fits."""
        F, Q = self.row.data("thesis_pC", every=True)
        misses = self.charge_pC(F) - Q
        cell: list[Cell] = [self.name, self.row.source, self.row.label, len(F), self.parameters]
        cell += [float(np.abs(misses).max()), float(100.0 * np.abs(misses / Q).max())]
        law = law_through(F, Q)
        at, off = swing(self.charge_pC, law, F[0], F[-1]) if law is not None else (None, None)
        zero = float(self.charge_pC(np.zeros(1))[0])
        beyond = float(self.charge_pC(np.array([7.5]))[0])
        return [*cell, off, at, zero, zero - rest_pC, beyond]


def _fits(thesis: Thesis, found: list[Row], rest_pC: float) -> Iterator[Fit]:
    """The thesis's polynomials in the force, and the law through the same rows."""
    for row in found:
        at_zero = row.source == "Table 3.4" or row.rotation_deg == 0
        if not at_zero or len(row.found) < 4:
            continue
        key = (row.source, row.electrode)
        for name in (name for name, of in FITS.items() if of == key):
            if name in thesis.products:
                force = thesis.products[name].force
                yield Fit(f"Eq. {name}, force factor", row, len(force.coefficients), force)
            else:
                equation = thesis.polynomials[name]
                kind = f"cubic of {name.split('_')[0]}" if "_" in name else f"Eq. {name}"
                yield Fit(kind, row, len(equation.coefficients), equation)
        F, Q = row.data("thesis_pC", every=True)
        for rest, parameters in ((rest_pC, 1), (None, 2)):
            law = law_through(F, Q, rest)
            if law is not None:
                kind = "known" if parameters == 1 else "fitted"
                yield Fit(f"membrane law, Q0 {kind}", row, parameters, law.charge_pC)


def _fit_table(fits: list[Fit], rest_pC: float) -> Table:
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
    """Scenes of the claimed linear range, if the charges that it rests on are there."""
    forces = {charge.force_N for charge in thesis.from_("Table 3.4")}
    if not set(CLAIMED_N) <= forces:
        return []
    scenes = [thesis_scene("4", "rect14x7", force_N=F) for F in SMALL_N]
    return [scene.with_(**{"numerics.observable": MATERIAL}) for scene in scenes]


def _small_series(thesis: Thesis, results: Results) -> Series:
    scenes = _small(thesis)
    charges = [results[scene].charge_pC("A", MATERIAL) for scene in scenes]
    return Series("A", np.array([scene.load.force_N for scene in scenes]), np.array(charges))


def _linearity_text(found: list[Row], small: Series, rest_pC: float) -> list[str]:
    F, Q = finite(small)
    doubled = [
        float(np.interp(CLAIMED_N[1], F, Q) / np.interp(CLAIMED_N[0], F, Q))
        for F, Q in (row.data("thesis_pC") for row in found)
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


def _fit_text(fits: list[Fit], rest_pC: float) -> list[str]:
    cubics = [fit for fit in fits if fit.name.startswith("cubic")]
    laws = [fit for fit in fits if fit.name.startswith("membrane") and fit.row.rotation_deg == 0]
    if not cubics or not laws:
        return []
    zero = [float(fit.charge_pC(np.zeros(1))[0]) for fit in cubics]
    law = law_through(*cubics[0].row.data("thesis_pC"), rest_pC)
    far = np.array([3.5, 5.0, 7.5])
    beyond = ", ".join(f"{q:.0f}" for q in cubics[0].charge_pC(far))
    lawful = ", ".join(f"{q:.0f}" for q in law.charge_pC(far)) if law is not None else "–"
    worst = {n: max(_worst(fit) for fit in laws if fit.parameters == n) for n in (1, 2)}
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


def _worst(fit: Fit) -> float:
    F, Q = fit.row.data("thesis_pC", every=True)
    return float(100.0 * np.abs(fit.charge_pC(F) / Q - 1.0).max())


# -------------------------------------------------------------------------------- picture and part


def _exponents_picture(ax: Axes, found: list[Row], small: Series) -> None:
    for level, label in ((1.0, "proportional"), (2 / 3, "2/3")):
        ax.axhline(level, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
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
        points = [none] + [_exponents(*row.data(y, every=y == "ours_pC")) for row in found]
        x, exponents = (np.concatenate(some) for some in zip(*points, strict=True))
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
        linestyle=(0, (5, 2)),
        label="best straight line",
    )
    ax.set(xlim=(0.0, 0.55), ylim=(0.0, None))
    ax.legend(loc="lower right")


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    found = list(rows(compare(_charges(thesis), results)))
    small = _small_series(thesis, results)
    rest_pC = rest_charge_pC(thesis_scene("4", "rect14x7"))
    fits = list(_fits(thesis, found, rest_pC))
    with style():
        figure = new_figure(180, 85)
        left, right = figure.subplots(1, 2)
        _exponents_picture(left, found, small)
        _linear_picture(right, small, rest_pC)
        save(figure, out / "force_law.svg")
    return Content(
        [*_linearity_text(found, small, rest_pC), *_fit_text(fits, rest_pC)],
        [
            Picture(
                "force_law.svg",
                "Sections 3.4.3 and 3.5: local exponents of all rows of Tables 3.4, 4.5 and 4.6 "
                "(rings: thesis, dots: ours) and of A below 0.5 N; charge of A under the "
                "rectangle at 0° up to 0.5 N, the range called linear.",
            ),
            _fit_table(fits, rest_pC),
            _exponent_table(found),
        ],
    )


FORCE_LAW_PART = Part(
    "force-law",
    "Sections 3.4.3, 3.5 and 6.2: is the sensor linear, and which law does it follow",
    ("Section 3.4.3",),
    lambda thesis: [scene_of(charge) for charge in _charges(thesis)] + _small(thesis),
    _compose,
)
