"""Chapter of the thesis report: the angle from one charge (section 4.1, Tables 4.2 and 4.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS
from reports.chapters.force_and_angle.rectangle import Rectangle, table_scenes
from reports.common.chapter import Chapter, Content
from reports.common.comparison import Comparison, compare
from reports.common.figures import drawing
from reports.common.page import Cell, Column, Picture, Table, joined
from reports.common.results import Results
from reports.common.tables import CASE, FORCE, ROTATION, wide_table
from reports.common.thesis_data import AngleEstimate, Charge, Thesis
from reports.common.thesis_scene import scene_of
from reports.thesis_methods.cosine_series import CosineSeries
from reports.thesis_methods.orientation import orientations

#: Relative error of a charge for which errors of angles are shown: the scatter of the thesis's.
SCATTER = 0.002


def check_charges(thesis: Thesis) -> list[Charge]:
    """The charges of the check runs of Tables 4.2 and 4.3, and of section 4.1.1."""
    return thesis.from_("Table 4.2", "Table 4.3", "Section 4.1.1")


def check_scenes(thesis: Thesis) -> list[Scene]:
    """The scenes of the check runs."""
    return [scene_of(charge) for charge in check_charges(thesis)]


@dataclass(frozen=True)
class RecoveredAngle:
    """Angles in degrees that several ways give for a charge of A; NaN where a way gives none.

    Attributes
    ----------
    estimate : AngleEstimate
        The thesis's estimate.
    roots, refit_roots : tuple of float
        Solutions of the thesis's equation, as printed and in full precision.
    from_table, from_ours : float
        Angles of the series through the thesis's charges and through ours.
    from_range : float
        Angle at which our charge is as far between its values at 90° and 0° as this charge is
        between the thesis's.
    slope : float
        Slope dQ/dθ of the thesis's charges in pC per degree.
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
        """The thesis's angle, from its text if that states one, else from its table."""
        text = self.estimate.angle_text_deg
        return self.estimate.angle_table_deg if math.isnan(text) else text

    @property
    def angle_error_deg(self) -> float:
        """The angle that corresponds to the error of the check run's charge."""
        return abs((self.estimate.check_charge_pC - self.estimate.charge_pC) / self.slope)


def recovered(
    estimate: AngleEstimate, thesis: Thesis, rectangle: Rectangle, checks: list[Comparison]
) -> RecoveredAngle:
    """The angles that all ways give for the charge of an estimate."""
    F, Q = estimate.force_N, estimate.charge_pC
    refit = thesis.polynomials.get(f"{estimate.equation} refit")
    theirs, ours = rectangle.theirs, rectangle.ours
    angles = RecoveredAngle(
        estimate,
        thesis.polynomials[estimate.equation].angles_deg(Q),
        refit.angles_deg(Q) if refit is not None else (),
        angle_of(theirs, Q, F),
        angle_of(ours, Q, F),
        angle_of(ours, same_place(Q, F, theirs, ours), F),
        math.nan,
        math.nan,
    )
    at_angle = [
        comparison
        for comparison in checks
        if abs(comparison.charge.rotation_deg - angles.angle_deg) < 0.01
    ]
    return replace(
        angles,
        slope=_slope(theirs, angles.angle_deg, F),
        ours_there_pC=at_angle[0].ours_pC if at_angle else math.nan,
    )


def angle_errors_deg(thesis: Thesis, rectangle: Rectangle) -> list[float]:
    """The angles that the errors of the check runs' charges correspond to, Tables 4.2 and 4.3."""
    return [
        recovered(estimate, thesis, rectangle, []).angle_error_deg
        for estimate in thesis.angle_estimates
    ]


def same_place(
    charge_pC: float, force_N: float, theirs: CosineSeries | None, ours: CosineSeries | None
) -> float:
    """Our charge with the place between 90° and 0° that a charge has among the thesis's."""
    if theirs is None or ours is None:
        return math.nan
    (high, low), (our_highest, our_lowest) = (
        charge_series.charge_pC(np.array([0.0, 90.0]), force_N).tolist()
        for charge_series in (theirs, ours)
    )
    return float(our_lowest + (our_highest - our_lowest) * (charge_pC - low) / (high - low))


def angle_of(charge_series: CosineSeries | None, charge_pC: float, force_N: float) -> float:
    """Angle at which a series gives a charge of A at a known force; NaN if there is none."""
    if charge_series is None or not math.isfinite(charge_pC):
        return math.nan
    orientations_found = orientations(charge_series, {"A": charge_pC}, force_N)
    return orientations_found[0].angle_deg if orientations_found else math.nan


def _slope(charge_series: CosineSeries | None, angle_deg: float, force_N: float) -> float:
    if charge_series is None:
        return math.nan
    twice = 2.0 * math.radians(angle_deg)
    along_c, _ = charge_series.slopes(math.cos(twice), force_N)
    return -along_c * 2.0 * math.sin(twice) * math.pi / 180.0


def _angles(thesis: Thesis, results: Results, out: Path) -> Content:
    rectangle = Rectangle.of(thesis, results)
    checks = compare(check_charges(thesis), results)
    angles = [recovered(estimate, thesis, rectangle, checks) for estimate in thesis.angle_estimates]
    _error_picture(angles, rectangle, out / "angle_errors.svg")
    keys = [CASE, Column("source", "place in the thesis"), FORCE, ROTATION]
    return Content(
        _angle_text(angles, rectangle),
        [
            _angle_table(angles),
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


def _angle_table(angles: list[RecoveredAngle]) -> Table:
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
        [_angle_row(angle) for angle in angles],
    )


def _angle_row(angle: RecoveredAngle) -> list[Cell]:
    estimate = angle.estimate
    return [
        estimate.case,
        estimate.force_N,
        estimate.charge_pC,
        estimate.angle_table_deg,
        estimate.angle_text_deg,
        _listed(angle.roots),
        _listed(angle.refit_roots),
        angle.from_table,
        angle.from_ours,
        angle.from_range,
        angle.from_range - angle.angle_deg,
        angle.ours_there_pC,
        estimate.error_stated_percent,
        angle.angle_error_deg,
    ]


def _listed(angles: tuple[float, ...]) -> Cell:
    """A cell with angles: a single one is a number, several are text."""
    if len(angles) < 2:
        return angles[0] if angles else None
    return ", ".join(f"{angle:.3f}" for angle in angles)


def _error_picture(
    recovered_angles: list[RecoveredAngle], rectangle: Rectangle, path: Path
) -> None:
    angles = np.linspace(0.0, 90.0, 91)
    with drawing(path, 160, 85) as figure:
        ax = figure.subplots()
        if rectangle.ours is not None:
            for electrodes, label, ink in (
                ("A", "A alone, force known", COLOURS[1]),
                ("AB", "A and B, force unknown", COLOURS[0]),
            ):
                errors = [_half_range(rectangle.ours, angle, electrodes) for angle in angles]
                ax.plot(angles, errors, color=ink, label=label)
            ax.plot(
                [recovered_angle.angle_deg for recovered_angle in recovered_angles],
                [recovered_angle.angle_error_deg for recovered_angle in recovered_angles],
                "o",
                color="black",
                markerfacecolor="none",
                label="check runs of the thesis",
            )
            ax.legend(loc="upper center")
        ax.set(xlabel="rotation of the probe (°)", ylabel="error of the angle (°)")
        ax.set(xlim=(0.0, 90.0), ylim=(0.0, None), xticks=range(0, 91, 15))


def _half_range(charge_series: CosineSeries, angle_deg: float, electrodes: str) -> float:
    charges = {e: float(charge_series.charge_pC(angle_deg, 1.0, e)) for e in electrodes}
    error = SCATTER * float(np.mean(list(charges.values())))
    force = 1.0 if len(electrodes) == 1 else None
    answers = orientations(charge_series, charges, force, charge_error_pC=error)
    nearest = min(answers, key=lambda answer: abs(answer.angle_deg - angle_deg))
    low, high = nearest.angle_range_deg
    return 0.5 * (high - low)


def _angle_text(angles: list[RecoveredAngle], rectangle: Rectangle) -> list[str]:
    theirs, ours = rectangle.theirs, rectangle.ours
    if theirs is None or ours is None:
        return ["Too few charges for curves from which angles could be read."]
    stated = [angle.estimate.error_stated_percent for angle in angles]
    errors = [angle.angle_error_deg for angle in angles]
    high, middle, low = (float(theirs.charge_pC(degrees, 1.0)) for degrees in (0.0, 50.0, 90.0))
    our_high = float(ours.charge_pC(0.0, 1.0))
    unreached = [f"{angle.estimate.charge_pC:g}" for angle in angles if math.isnan(angle.from_ours)]
    consequence = f" Because of it, {joined(unreached)} pC are reached at no angle."
    with_roots = [angle for angle in angles if angle.refit_roots and angle.roots]
    worst = max(with_roots, key=lambda angle: abs(angle.refit_roots[-1] - angle.roots[-1]))
    return [
        f"The last rows of Tables 4.2 and 4.3, {min(stated):g} to {max(stated):g} %, are called "
        "errors of the angle. They are errors of the charge. Over the slope of the thesis's own "
        f"charges they are {min(errors):.1f} to {max(errors):.1f}°: rotation changes A by "
        f"{100 * (high / low - 1):.1f} % in all, by {100 * (middle / low - 1):.2f} % between 50 "
        "and 90°. For 810 pC table and text give two angles; the text's solves its equation.",
        "The answer also depends on the digits of the equation: for "
        f"{worst.estimate.charge_pC:g} pC Eq. {worst.estimate.equation} gives "
        f"{worst.roots[-1]:.1f}° as printed, {worst.refit_roots[-1]:.1f}° in full precision.",
        f"Our charge of A at 0° and 1 N is {our_high:.1f} pC, {high:.1f} pC in the "
        f"thesis, a difference of {100 * (1 - our_high / high):.1f} %."
        + (consequence if unreached else "")
        + " One degree is worth "
        + joined(
            [
                f"{_percent_per_degree(theirs, degrees):.3f} % at {degrees:g}°"
                for degrees in (20.0, 45.0, 75.0)
            ]
        )
        + (
            " of the charge; a calibration needs this accuracy before one charge can give an "
            "angle. Taken relative to its own range, our curve has angles within "
            f"{max(abs(angle.from_range - angle.angle_deg) for angle in angles):.1f}° of the "
            "thesis's."
        ),
    ]


def _percent_per_degree(charge_series: CosineSeries, angle_deg: float) -> float:
    return abs(
        100.0
        * _slope(charge_series, angle_deg, 1.0)
        / float(charge_series.charge_pC(angle_deg, 1.0))
    )


ANGLE_CHAPTER = Chapter(
    "angle",
    "Section 4.1: the angle from one charge",
    ("Table 4.2", "Table 4.3"),
    lambda thesis: table_scenes(thesis) + check_scenes(thesis),
    _angles,
)
