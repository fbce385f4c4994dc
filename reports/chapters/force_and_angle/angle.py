"""Part of the thesis report: the angle from one charge (section 4.1, Tables 4.2 and 4.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.maps.cosine_series import CosineSeries
from pvdf_fem.maps.orientation import orientations, polynomial_angles
from pvdf_fem.output.figures import COLOURS, new_figure, save, style
from reports.chapters.force_and_angle.rectangle import Rectangle, table_scenes
from reports.common.comparison import Comparison, compare, wide_table
from reports.common.page import Cell, Column, Picture, Table
from reports.common.part import Content, Part
from reports.common.results import Results
from reports.common.tables import CASE, FORCE, ROTATION
from reports.common.thesis_data import AngleEstimate, Charge, Thesis
from reports.common.thesis_scene import scene_of

#: Error of a charge for which the angle's error is shown: scatter of the thesis's charges.
SCATTER = 0.002


def check_charges(thesis: Thesis) -> list[Charge]:
    """The check runs of Tables 4.2 and 4.3, and of the angle in the text."""
    return thesis.from_("Table 4.2", "Table 4.3", "Section 4.1.1")


def check_scenes(thesis: Thesis) -> list[Scene]:
    """Their scenes."""
    return [scene_of(charge) for charge in check_charges(thesis)]


@dataclass(frozen=True)
class Recovered:
    """An angle recovered from a charge of A, in several ways; NaN where there is none.

    Attributes
    ----------
    estimate : AngleEstimate
        The thesis's, whose angle is that of its text if there is one.
    roots, refit_roots : tuple of float
        Angles in degrees of its equation, as printed and in full precision.
    from_table, from_ours : float
        Angle of the series through the thesis's charges and through ours.
    from_range : float
        Angle at which ours is at the same place in the range from 90° to 0°.
    slope : float
        dQ/dθ in pC per degree, of the thesis's charges.
    ours_there_pC : float
        Our charge at the thesis's angle.
    """

    estimate: AngleEstimate
    roots: tuple[float, ...]
    refit_roots: tuple[float, ...]
    from_table: float
    from_ours: float
    from_range: float
    slope: float
    ours_there_pC: float

    @property
    def angle_deg(self) -> float:
        """The thesis's angle: that of the text, where it and the table disagree."""
        text = self.estimate.angle_text_deg
        return self.estimate.angle_table_deg if math.isnan(text) else text

    @property
    def angle_error_deg(self) -> float:
        """What the error of the check run's charge is worth in degrees."""
        return abs((self.estimate.check_charge_pC - self.estimate.charge_pC) / self.slope)


def recovered(
    estimate: AngleEstimate, thesis: Thesis, rectangle: Rectangle, checks: list[Comparison]
) -> Recovered:
    """All angles for the charge of an estimate."""
    F, Q = estimate.force_N, estimate.charge_pC
    refit = thesis.polynomials.get(f"{estimate.equation} refit")
    theirs, ours = rectangle.theirs, rectangle.ours
    one = Recovered(
        estimate,
        polynomial_angles(thesis.polynomials[estimate.equation], Q),
        polynomial_angles(refit, Q) if refit is not None else (),
        angle_of(theirs, Q, F),
        angle_of(ours, Q, F),
        angle_of(ours, same_place(Q, F, theirs, ours), F),
        math.nan,
        math.nan,
    )
    here = [o for o in checks if abs(o.charge.rotation_deg - one.angle_deg) < 0.01]
    return replace(
        one,
        slope=_slope(theirs, one.angle_deg, F),
        ours_there_pC=here[0].ours_pC if here else math.nan,
    )


def same_place(
    charge_pC: float, force_N: float, theirs: CosineSeries | None, ours: CosineSeries | None
) -> float:
    """Our charge as far between those of 90° and 0° as a charge is between the thesis's."""
    if theirs is None or ours is None:
        return math.nan
    (high, low), (our_high, our_low) = (
        of.charge_pC(np.array([0.0, 90.0]), force_N).tolist() for of in (theirs, ours)
    )
    return float(our_low + (our_high - our_low) * (charge_pC - low) / (high - low))


def angle_of(of: CosineSeries | None, charge_pC: float, force_N: float) -> float:
    """Angle at which a series of A has a charge at a known force; NaN if it never has."""
    if of is None or not math.isfinite(charge_pC):
        return math.nan
    found = orientations(of, {"A": charge_pC}, force_N)
    return found[0].angle_deg if found else math.nan


def _slope(of: CosineSeries | None, angle_deg: float, force_N: float) -> float:
    if of is None:
        return math.nan
    twice = 2.0 * math.radians(angle_deg)
    along_c, _ = of.slopes(math.cos(twice), force_N)
    return -along_c * 2.0 * math.sin(twice) * math.pi / 180.0


def _angles(thesis: Thesis, results: Results, out: Path) -> Content:
    rectangle = Rectangle.of(thesis, results)
    checks = compare(check_charges(thesis), results)
    found = [recovered(one, thesis, rectangle, checks) for one in thesis.angle_estimates]
    _error_picture(found, rectangle, out / "angle_errors.svg")
    keys = [CASE, Column("source", "place in the thesis"), FORCE, ROTATION]
    return Content(
        _angle_text(found, rectangle),
        [
            _angle_table(found),
            Picture(
                "angle_errors.svg",
                "Tables 4.2 and 4.3: half of the range of angles that a standard error of "
                f"{100 * SCATTER:g} % of the charges allows, which is the scatter of the thesis's, "
                "at 1 N: from A alone with the force known, and from A and B with the force "
                "unknown. Rings: the thesis's check runs, the error of their charge over the "
                "slope of its charges.",
            ),
            wide_table("tables_4_2_and_4_3", "Check runs of Tables 4.2 and 4.3.", keys, checks),
        ],
    )


def _angle_table(found: list[Recovered]) -> Table:
    columns = [
        Column("case", "case"),
        FORCE,
        Column("charge_pC", "charge of A (pC)"),
        Column("thesis_table_deg", "table", 3, "thesis (°)"),
        Column("thesis_text_deg", "text", 3, "thesis (°)"),
        Column("equation_deg", "as printed", 3, "its equation (°)"),
        Column("equation_refit_deg", "full precision", 3, "its equation (°)"),
        Column("table_series_deg", "thesis's charges (°)", 2),
        Column("ours_deg", "this charge", 2, "ours (°)"),
        Column("ours_range_deg", "same place in range", 2, "ours (°)"),
        Column("ours_minus_thesis_deg", "range − thesis (°)", 2, signed=True),
        Column("ours_there_pC", "ours at its angle (pC)"),
        Column("stated_percent", "stated error (%)", 3),
        Column("angle_error_deg", "worth in angle (°)", 1),
    ]
    return Table(
        "tables_4_2_and_4_3_angles",
        "Tables 4.2 and 4.3: angle from a charge of A at a known force. Its equation: all "
        "solutions in 0 to 90°. Thesis's charges: cosine series through Tables 4.1, 4.5 and 4.6. "
        "Ours: the angle at which our curve has this charge (–: it never has), and at which it is "
        "at the same place between its values at 90° and 0°. The stated error is that of the "
        "charge in the check run; the last column is what it is worth in angle.",
        columns,
        [_angle_row(one) for one in found],
    )


def _angle_row(one: Recovered) -> list[Cell]:
    estimate = one.estimate
    return [
        estimate.case,
        estimate.force_N,
        estimate.charge_pC,
        estimate.angle_table_deg,
        estimate.angle_text_deg,
        _listed(one.roots),
        _listed(one.refit_roots),
        one.from_table,
        one.from_ours,
        one.from_range,
        one.from_range - one.angle_deg,
        one.ours_there_pC,
        estimate.error_stated_percent,
        one.angle_error_deg,
    ]


def _listed(angles: tuple[float, ...]) -> Cell:
    """One number as a number, several as text."""
    if len(angles) < 2:
        return angles[0] if angles else None
    return ", ".join(f"{angle:.3f}" for angle in angles)


def _error_picture(found: list[Recovered], rectangle: Rectangle, path: Path) -> None:
    angles = np.linspace(0.0, 90.0, 19)
    with style():
        figure = new_figure(160, 85)
        ax = figure.subplots()
        if rectangle.ours is not None:
            for electrodes, label, ink in (
                ("A", "A alone, force known", COLOURS[1]),
                ("AB", "A and B, force unknown", COLOURS[0]),
            ):
                errors = [_half_range(rectangle.ours, angle, electrodes) for angle in angles]
                ax.plot(angles, errors, ".-", color=ink, label=label)
            ax.plot(
                [one.angle_deg for one in found],
                [one.angle_error_deg for one in found],
                "o",
                color="black",
                markerfacecolor="none",
                label="check runs of the thesis",
            )
            ax.legend(loc="upper center")
        ax.set(xlabel="rotation of the probe (°)", ylabel="error of the angle (°)")
        ax.set(xlim=(0.0, 90.0), ylim=(0.0, None), xticks=range(0, 91, 15))
        save(figure, path)


def _half_range(of: CosineSeries, angle_deg: float, electrodes: str) -> float:
    charges = {e: float(of.charge_pC(angle_deg, 1.0, e)) for e in electrodes}
    error = SCATTER * float(np.mean(list(charges.values())))
    force = 1.0 if len(electrodes) == 1 else None
    found = orientations(of, charges, force, charge_error_pC=error)
    nearest = min(found, key=lambda one: abs(one.angle_deg - angle_deg))
    low, high = nearest.angle_range_deg
    return 0.5 * (high - low)


def _angle_text(found: list[Recovered], rectangle: Rectangle) -> list[str]:
    theirs, ours = rectangle.theirs, rectangle.ours
    if theirs is None or ours is None:
        return ["Too few charges for curves from which angles could be read."]
    stated = [one.estimate.error_stated_percent for one in found]
    errors = [one.angle_error_deg for one in found]
    ends = {
        who: [float(of.charge_pC(a, 1.0)) for a in (0.0, 50.0, 90.0)]
        for who, of in (("theirs", theirs), ("ours", ours))
    }
    low, middle, high = ends["theirs"][2], ends["theirs"][1], ends["theirs"][0]
    lost = [f"{one.estimate.charge_pC:g}" for one in found if math.isnan(one.from_ours)]
    apart = [one for one in found if one.refit_roots and one.roots]
    worst = max(apart, key=lambda one: abs(one.refit_roots[-1] - one.roots[-1]))
    return [
        f"The last rows of Tables 4.2 and 4.3, {min(stated):g} to {max(stated):g} %, are called "
        "errors of the angle. They are errors of the charge. Over the slope of the thesis's own "
        f"charges they are {min(errors):.1f} to {max(errors):.1f}°: rotation changes A by "
        f"{100 * (high / low - 1):.1f} % in all, by {100 * (middle / low - 1):.2f} % between 50 "
        "and 90°. For 810 pC table and text give two angles; the text's solves its equation.",
        "The answer also depends on the digits of the equation: for "
        f"{worst.estimate.charge_pC:g} pC Eq. {worst.estimate.equation} gives "
        f"{worst.roots[-1]:.1f}° as printed, {worst.refit_roots[-1]:.1f}° in full precision.",
        f"Our charge of A at 0° and 1 N is {ends['ours'][0]:.1f} pC, {high:.1f} pC in the "
        f"thesis, a difference of {100 * (1 - ends['ours'][0] / high):.1f} %."
        + (f" It is enough that {_and(lost)} pC are reached at no angle." if lost else "")
        + " One degree is worth "
        + _and([f"{_percent_per_degree(theirs, a):.3f} % at {a:g}°" for a in (20.0, 45.0, 75.0)])
        + " of the charge, and so true must a calibration be from which one charge gives an "
        "angle. Taken relative to its own range, our curve has angles within "
        f"{max(abs(one.from_range - one.angle_deg) for one in found):.1f}° of the thesis's.",
    ]


def _percent_per_degree(of: CosineSeries, angle_deg: float) -> float:
    return abs(100.0 * _slope(of, angle_deg, 1.0) / float(of.charge_pC(angle_deg, 1.0)))


def _and(words: list[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


ANGLE_PART = Part(
    "angle",
    "Section 4.1: the angle from one charge",
    ("Table 4.2", "Table 4.3"),
    lambda thesis: table_scenes(thesis) + check_scenes(thesis),
    _angles,
)
