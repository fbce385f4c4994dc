"""Chapter of the thesis report: angle and force together, from one charge and from two."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.optimize import brentq

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS, GREY
from reports.chapters.force_and_angle.angle import SCATTER, check_charges
from reports.chapters.force_and_angle.rectangle import (
    COSINE_TERMS,
    FORCE_TERMS,
    Rectangle,
    fitted,
    readings,
    table_scenes,
)
from reports.common.chapter import Chapter, Content
from reports.common.comparison import Comparison, sound
from reports.common.figures import drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import THESIS_EDGE, Results
from reports.common.thesis_data import ChargeRange, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene
from reports.thesis_methods.cosine_series import CosineSeries, Reading
from reports.thesis_methods.orientation import orientations

Array = NDArray[np.float64]

#: Rotations in degrees and forces in N of scenes to which no series is fitted.
HELD_OUT = ((7.0, 0.3), (20.0, 0.75), (33.0, 1.5), (52.0, 2.7), (68.0, 4.2), (83.0, 6.2))
#: Ticks in pC on the axis of the mean charge.
MEANS_PC = (300.0, 500.0, 1000.0, 2000.0, 3000.0)
#: Smallest number of forces in Table 4.5 for which a series in the force makes sense.
LEAST_FORCES = 4


@dataclass(frozen=True)
class ChargePair:
    """Charges of A and B of a scene, with the angle and force of a series; NaN for none."""

    case: str
    angle_deg: float
    force_N: float
    A_pC: float
    B_pC: float
    found_deg: float
    found_N: float
    answers: int

    @property
    def angle_error_deg(self) -> float:
        """The recovered angle minus the true one, in degrees."""
        return self.found_deg - self.angle_deg

    @property
    def force_error_percent(self) -> float:
        """Excess of the recovered force over the true one, in percent."""
        return 100.0 * (self.found_N / self.force_N - 1.0)


def pair(
    charge_series: CosineSeries, case: str, angle: float, force: float, A: float, B: float
) -> ChargePair:
    """Angle and force that a series gives for charges of A and B."""
    complete = np.isfinite([A, B]).all()
    answers = (
        orientations(charge_series, {"A": A, "B": B}, charge_error_pC=SCATTER * (A + B) / 2)
        if complete
        else ()
    )
    best = (answers[0].angle_deg, answers[0].force_N) if answers else (np.nan, np.nan)
    return ChargePair(case, angle, force, A, B, *best, len(answers))


def printed_pairs(rectangle: Rectangle, charge_series: CosineSeries) -> list[ChargePair]:
    """Pairs of charges of A and B of Tables 4.5 and 4.6 without a defect."""
    of_b = {
        (comparison.charge.rotation_deg, comparison.charge.force_N): comparison.charge
        for comparison in sound(rectangle.table("Table 4.6"))
    }
    return [
        pair(
            charge_series,
            f"{of_electrode_a.case}, {of_electrode_b.case}",
            of_electrode_a.rotation_deg,
            of_electrode_a.force_N,
            of_electrode_a.charge_pC,
            of_electrode_b.charge_pC,
        )
        for of_electrode_a in (
            comparison.charge for comparison in sound(rectangle.table("Table 4.5"))
        )
        if (of_electrode_b := of_b.get((of_electrode_a.rotation_deg, of_electrode_a.force_N)))
        is not None
    ]


def _held_out(thesis: Thesis) -> list[Scene]:
    if len({charge.force_N for charge in thesis.from_("Table 4.5")}) < LEAST_FORCES:
        return []
    return [
        thesis_scene("4", "rect14x7", rotation_deg=rotation, force_N=force_N)
        for rotation, force_N in HELD_OUT
    ]


def _unseen(thesis: Thesis) -> dict[Scene, str]:
    """Names of the scenes to which no series is fitted."""
    checks = {scene_of(charge): f"check run, {charge.case}" for charge in check_charges(thesis)}
    return dict.fromkeys(_held_out(thesis), "held out") | checks


def _unseen_pairs(
    thesis: Thesis, results: Results, charge_series: CosineSeries
) -> list[ChargePair]:
    pairs = []
    for scene, name in _unseen(thesis).items():
        charges = [results[scene].charge_pC(e, THESIS_EDGE) for e in "AB"]
        assert scene.single_probe is not None
        place = scene.single_probe.rotation_deg, scene.load.force_N
        pairs.append(pair(charge_series, name, *place, charges[0], charges[1]))
    return pairs


# ---------------------------------------------------------------------------------------- tables


def _pair_table(name: str, caption: str, pairs: list[ChargePair]) -> Table:
    columns = [
        Column("case", "case"),
        Column("A_pC", "A (pC)"),
        Column("B_pC", "B (pC)"),
        Column("rotation_deg", "true", 3, "rotation (°)"),
        Column("found_deg", "found", 3, "rotation (°)"),
        Column("angle_error_deg", "error", 3, "rotation (°)", signed=True),
        Column("force_N", "true", None, "force (N)"),
        Column("found_N", "found", 4, "force (N)"),
        Column("force_error_percent", "error (%)", 3, "force (N)", signed=True),
        Column("answers", "answers", 0),
    ]
    rows: list[list[Cell]] = [
        [
            *(
                charge_pair.case,
                charge_pair.A_pC,
                charge_pair.B_pC,
                charge_pair.angle_deg,
                charge_pair.found_deg,
                charge_pair.angle_error_deg,
            ),
            *(
                charge_pair.force_N,
                charge_pair.found_N,
                charge_pair.force_error_percent,
                charge_pair.answers,
            ),
        ]
        for charge_pair in pairs
    ]
    return Table(name, caption, columns, rows)


def _series_table(rectangle: Rectangle) -> Table:
    columns = [
        Column("data", "charges"),
        Column("count", "number", 0),
        Column("cosine_terms", "cosines", 0, "terms"),
        Column("force_terms", "in the force", 0, "terms"),
        Column("rms_percent", "root mean square", 3, "miss (%)"),
        Column("worst_percent", "largest", 3, "miss (%)"),
        Column("left_out_percent", "left out in turn", 3, "miss (%)"),
    ]
    rows: list[list[Cell]] = []
    for name, (charges, fit) in _series_fits(rectangle).items():
        if fit is not None:
            errors = (100.0 * error for error in (fit.rms, fit.worst, fit.left_out))
            rows.append([name, len(charges), *reversed(fit.coefficients.shape), *errors])
    return Table(
        "cosine_series",
        "Cosine series of the charge, Q = L(F) Σ a_jk T_j(ln F) cos 2kθ with L the membrane law: "
        "charges, terms, and what it misses. Ours are those of the same places and forces, "
        "equivalent ones once.",
        columns,
        rows,
    )


def _series_fits(rectangle: Rectangle) -> dict[str, tuple[list[Reading], CosineSeries | None]]:
    """Readings and the series through them, by the name of their tables."""
    tables = {
        "thesis, Table 4.1": (("Table 4.1",), 1),
        "thesis, Tables 4.5 and 4.6": (("Table 4.5", "Table 4.6"), FORCE_TERMS),
    }
    fits = {
        name: (
            charges := readings(_of(rectangle, sources), "thesis_pC"),
            fitted(charges, COSINE_TERMS, terms, rectangle.law),
        )
        for name, (sources, terms) in tables.items()
    }
    fits["thesis, all three"] = readings(rectangle.comparisons, "thesis_pC"), rectangle.theirs
    fits["ours"] = readings(rectangle.comparisons, "ours_pC"), rectangle.ours
    return fits


def _of(rectangle: Rectangle, sources: Iterable[str]) -> list[Comparison]:
    return [comparison for source in sources for comparison in rectangle.table(source)]


def force_at(charge_series: CosineSeries, charge_pC: float, angle_deg: float) -> float:
    """Force at which A has a charge at an angle; NaN outside the forces of the series."""
    low, high = charge_series.forces_N

    def gap(F: float) -> float:
        return float(charge_series.charge_pC(angle_deg, F)) - charge_pC

    return float(brentq(gap, low, high)) if gap(low) * gap(high) <= 0 else np.nan


def _lookup_table(ranges: Iterable[ChargeRange], charge_series: CosineSeries | None) -> Table:
    columns = [
        Column("least_pC", "from", 3, "charge of A (pC)"),
        Column("largest_pC", "to", 3, "charge of A (pC)"),
        Column("thesis_force_N", "thesis: force (N)", None),
        Column("series_least_pC", "from", 1, "its charges at this force (pC)"),
        Column("series_largest_pC", "to", 1, "its charges at this force (pC)"),
        Column("least_force_N", "from", 3, "forces that make such charges (N)"),
        Column("largest_force_N", "to", 3, "forces that make such charges (N)"),
        Column("middle_percent", "width for one charge (%)", 1),
    ]
    rows: list[list[Cell]] = []
    for charge_range in ranges if charge_series is not None else ():
        assert charge_series is not None
        middle = (charge_range.least_pC + charge_range.largest_pC) / 2
        low, high = (force_at(charge_series, middle, angle) for angle in (0.0, 90.0))
        rows.append(
            [
                *(charge_range.least_pC, charge_range.largest_pC, charge_range.force_N),
                *(
                    float(charge_series.charge_pC(angle, charge_range.force_N))
                    for angle in (90.0, 0.0)
                ),
                *(
                    force_at(charge_series, charge_range.least_pC, 0.0),
                    force_at(charge_series, charge_range.largest_pC, 90.0),
                ),
                100.0 * (high / low - 1.0),
            ]
        )
    return Table(
        "table_4_4",
        "Table 4.4: charge of A as a measure of the force. The forces at which A has a charge of "
        "the range at some angle, and by how much the force for the charge in its middle depends "
        "on the angle; by the cosine series through the thesis's charges.",
        columns,
        rows,
    )


# --------------------------------------------------------------------------------------- picture


def _plane(
    charge_series: CosineSeries | None,
    printed: list[ChargePair],
    unseen: list[ChargePair],
    path: Path,
) -> None:
    """Lines of equal angle and of equal force, over the mean of A and B and their contrast."""
    with drawing(path, 160, 105) as figure:
        ax = figure.subplots()
        if charge_series is not None:
            _draw_lines(ax, charge_series)
            ax.set_ylim(-5.3, 6.0)
            _draw_pairs(ax, printed, "o", "thesis")
            _draw_pairs(ax, unseen, "x", "ours, not fitted to")
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
        ax.set_xscale("log")
        ax.set_xticks(MEANS_PC, [f"{Q:g}" for Q in MEANS_PC])
        ax.minorticks_off()
        ax.set(xlabel="mean of A and B (pC)", ylabel="(A − B) / mean (%)")


def _draw_lines(ax: Axes, charge_series: CosineSeries) -> None:
    angles, forces = np.arange(0.0, 91.0, 15.0), [0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 7.5]
    fine = np.linspace(0.0, 90.0, 91)
    for F in forces:
        x, y = _place(charge_series.charge_pC(fine, F, "A"), charge_series.charge_pC(fine, F, "B"))
        ax.plot(x, y, color=GREY, linewidth=0.8)
        ax.annotate(
            f"{F:g} N",
            (x[-1], y[-1]),
            (0, -12),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=GREY,
        )
    all_forces = np.geomspace(*charge_series.forces_N, 60)
    for angle in angles:
        x, y = _place(
            charge_series.charge_pC(angle, all_forces, "A"),
            charge_series.charge_pC(angle, all_forces, "B"),
        )
        ax.plot(x, y, color=COLOURS[0], linewidth=0.8)
        ax.annotate(
            f"{angle:g}°",
            (x[-1], y[-1]),
            (8, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=COLOURS[0],
        )


def _draw_pairs(ax: Axes, pairs: list[ChargePair], marker: str, label: str) -> None:
    A, B = (
        np.array([getattr(charge_pair, key) for charge_pair in pairs]) for key in ("A_pC", "B_pC")
    )
    ax.plot(*_place(A, B), marker, color=COLOURS[1], markerfacecolor="none", label=label)


def _place(A: Array, B: Array) -> tuple[Array, Array]:
    mean = (A + B) / 2
    return mean, 100.0 * (A - B) / mean


# ------------------------------------------------------------------------------------------ part


def _largest(pairs: list[ChargePair]) -> str:
    angle = max(abs(charge_pair.angle_error_deg) for charge_pair in pairs)
    force = max(abs(charge_pair.force_error_percent) for charge_pair in pairs)
    return f"{angle:.2f}° and {force:.2f} %"


def _text(
    thesis: Thesis, rectangle: Rectangle, printed: list[ChargePair], unseen: list[ChargePair]
) -> list[str]:
    if rectangle.theirs is None or not printed or not unseen:
        return ["Too few charges to tell angle and force from them."]
    ranges = sorted(thesis.charge_ranges, key=lambda entry: entry.force_N)
    gaps = [
        f"{lower.largest_pC:.0f} to {upper.least_pC:.0f} pC" for lower, upper in pairwise(ranges)
    ]
    several = [entry for entry in printed + unseen if entry.answers != 1]
    return [
        "Table 4.4 gives a force for each of three ranges of the charge of A. Between them, from "
        f"{' and from '.join(gaps)}, where most charges fall, it gives none; within a range, "
        "charge and angle together would be needed. One charge cannot tell both.",
        "Two can. The mean of A and B depends on the force almost alone, their difference over it "
        "on the angle almost alone, and each pair belongs to one angle from 0 to 90° and one "
        f"force. From the {len(printed)} pairs of Tables 4.5 and 4.6 that stand, the cosine series "
        f"through the thesis's charges returns angle and force within {_largest(printed)}; these "
        f"pairs are among those that it is fitted to. Our {len(unseen)} pairs at other angles and "
        f"forces, which our series has not seen, come back within {_largest(unseen)}. "
        + (
            f"{len(several)} of all pairs have another number of answers than one."
            if several
            else "Every pair has exactly one answer."
        ),
        "This is the simulated contrast between electrodes under uniform pressure, about 4 %. What "
        "a charge error does to the angle is shown with Tables 4.2 and 4.3; a rigid probe has "
        "other curves, and needs its own series.",
    ]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    rectangle = Rectangle.of(thesis, results)
    theirs, ours = rectangle.theirs, rectangle.ours
    printed = printed_pairs(rectangle, theirs) if theirs is not None else []
    unseen = _unseen_pairs(thesis, results, ours) if ours is not None else []
    _plane(ours, printed, unseen, out / "angle_and_force.svg")
    return Content(
        _text(thesis, rectangle, printed, unseen),
        [
            _lookup_table(thesis.charge_ranges, theirs),
            Picture(
                "angle_and_force.svg",
                "Table 4.4: angle and force from two charges. Lines of equal force (grey) and of "
                "equal angle (blue) of our cosine series; pairs of Tables 4.5 and 4.6, and ours "
                "at angles and forces to which the series is not fitted.",
            ),
            _series_table(rectangle),
            _pair_table(
                "recovered_unseen",
                "Angle and force recovered from our charges of A and B, at angles and forces to "
                "which our series is not fitted.",
                unseen,
            ),
            _pair_table(
                "recovered_printed",
                "Angle and force recovered from the thesis's charges of A and B of Tables 4.5 and "
                "4.6, by the series through the thesis's charges.",
                printed,
            ),
        ],
    )


RECOVERY_CHAPTER = Chapter(
    "angle-and-force",
    "Section 4.2: angle and force from two charges",
    ("Table 4.4",),
    lambda thesis: table_scenes(thesis) + list(_unseen(thesis)),
    _compose,
)
