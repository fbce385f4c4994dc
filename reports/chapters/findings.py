"""Part of the thesis report: what the thesis states that its own numbers or the model contradict.

Each finding computes its numbers from the printed data or from the records of scenes that other
sections show. One whose rows are not at hand, as with ``--quick``, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.maps.force_law import local_exponents
from pvdf_fem.scene.outline import turn
from reports.chapters.contact import CONTACT_PART, CONTACTS, pressed
from reports.chapters.experiments import CIRCUIT_PART, MEASURED_POSITIONS_PART, thesis_circuit
from reports.chapters.force_and_angle.force_law import rest_charge_pC
from reports.chapters.thickness import PLACE_MM, THICKNESS_PART
from reports.common.page import Cell, Column, Table
from reports.common.part import Content, Part
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene


@dataclass(frozen=True)
class Evidence:
    """The printed numbers and our records, by short names."""

    thesis: Thesis
    results: Results

    def printed(self, source: str, electrode: str, rotation_deg: float, force_N: float) -> float:
        """A printed charge in pC; raises `KeyError` if the data at hand lack it."""
        key = (electrode, rotation_deg, force_N)
        rows = {(c.electrode, c.rotation_deg, c.force_N): c for c in self.thesis.from_(source)}
        return rows[key].charge_pC

    def polynomial(self, name: str, x: float) -> float:
        """A printed equation at radians or newtons."""
        return float(self.thesis.polynomials[name](x))

    def ours(self, scene: Scene, electrode: str, observable: str = THESIS_EDGE) -> float:
        """Our charge in pC; NaN if the solve failed."""
        return self.results[scene].charge_pC(electrode, observable)


@dataclass(frozen=True)
class Finding:
    """What the thesis states, where, what is so, and the section that shows it."""

    place: str
    states: str
    gives: str
    shown: str


# --------------------------------------------------------------------- chapter 3, positions


def _layout(e: Evidence) -> Finding:
    radii = {f: max(p.radius_mm for p in e.thesis.contours if p.electrode == f) for f in "AB"}
    A, B = np.array([0.0, -10.0]), turn([10.0, 0.0], 60.0)
    apart = float(np.linalg.norm(A - B))
    if len(e.thesis.contours) < 20:
        raise KeyError("contours")
    return Finding(
        "3.1.1",
        "Electrodes B and C lie at 60° and 120°, and the three form an equilateral triangle.",
        f"Both cannot be. With 60° the centres of A and B are {apart:.2f} mm apart, more than the "
        f"largest radii of their contours in Fig. 3.9 together ({radii['A']:.2f} and "
        f"{radii['B']:.2f} mm): these could not meet. 30° and 150° give the triangle and the data.",
        "Figs. 3.9 and 3.10",
    )


def _curve_order(e: Evidence) -> Finding:
    radius = {p.angle_deg: p.radius_mm for p in e.thesis.contours if p.electrode == "A"}
    return Finding(
        "3.1.1",
        "In Fig. 3.5 the curve of 35° is uppermost and that of 90° lowermost.",
        f"The thesis's own contour reaches 905 pC at {radius[35.0]:.3f} mm on 35° and at "
        f"{radius[90.0]:.3f} mm on 90°: there the curve of 90° is above. Ours agree.",
        "Fig. 3.5",
    )


def _equal_by_symmetry(e: Evidence) -> Finding:
    printed = [e.printed("Table 3.4", name, -90.0, 1.0) for name in "ABC"]
    scene = thesis_scene("3", "tri7", rotation_deg=-90.0)
    ours, edges = (
        [e.ours(scene, name, observable) for name in "ABC"]
        for observable in (MATERIAL, THESIS_EDGE)
    )
    return Finding(
        "3.4.1, Table 3.4",
        "A, B and C differ although they are virtually at the same distance.",
        f"They are equivalent by symmetry. Integrated over the electrodes the charges agree to "
        f"{_spread(ours):.2f} %; averages over edges along x and y, whose directions do not turn "
        f"with the layout, spread by {_spread(edges):.1f} % (printed {_spread(printed):.1f} %).",
        "Table 3.4",
    )


def _not_intersecting(e: Evidence) -> Finding:
    simulated = [p for p in e.thesis.positions if p.kind == "simulated"]
    lost = [p for p in simulated if np.isnan(p.error_mm)]
    if not lost:
        raise KeyError("positions")
    return Finding(
        "3.1 to 3.4",
        f"{len(lost)} of {len(simulated)} simulated scenes have no intersecting contours.",
        "Contours of a calibration with the probe's own shape and orientation meet in all of "
        "them; what fails is the calibration with the unrotated probe, and the rule that asks for "
        "crossings where least squares has an answer.",
        "Tables 3.1 to 3.5",
    )


def _two_newtons(e: Evidence) -> Finding:
    failed = [p.item for p in e.thesis.triangulation if p.case == "s342_2" and "no_" in p.status]
    if not failed:
        raise KeyError("s342_2")
    return Finding(
        "6.2, item 2",
        "Triangulation always works up to 2 N.",
        f"Section 3.4.2 itself reports no intersections of {' and '.join(failed)} for the probe at "
        "the centre, at 2 N.",
        "Tables 3.1 to 3.5",
    )


# ------------------------------------------------------------------------- chapter 3, force


def _linear(e: Evidence) -> Finding:
    ratios = [
        e.printed("Table 3.4", name, -90.0, 0.5) / e.printed("Table 3.4", name, -90.0, 0.25)
        for name in "ABC"
    ]
    forces = np.array([0.25, 0.5, 1.0, 2.0])
    charges = np.array([e.printed("Table 3.4", "A", -90.0, F) for F in forces])
    _, exponents = local_exponents(forces, charges)
    return Finding(
        "3.4.3, 3.5, 6.2",
        "The charge is linear in the force up to 0.5 N.",
        f"From 0.25 to 0.5 N the printed charges grow {np.mean(ratios):.2f} "
        f"times, not twice; the local exponents of A are {min(exponents):.2f} to "
        f"{max(exponents):.2f}, near a membrane's 2/3. The claim rests on two points, which any "
        "line joins.",
        "Force laws",
    )


def _cubics(e: Evidence) -> Finding:
    rest = rest_charge_pC(thesis_scene("3", "tri7"))
    constant = e.polynomial("3.4.1_A", 0.0)
    return Finding(
        "3.4.1, 3.5",
        "Cubic polynomials give the charge between 0.5 and 2 N.",
        f"Each has four coefficients for four points, so that nothing is left to test it. That of "
        f"A gives {constant:.1f} pC without force, where the pretension alone makes {rest:.1f} pC, "
        f"and {e.polynomial('3.4.1_A', 5.0):.0f} pC at 5 N.",
        "Force laws",
    )


def _millimetre(e: Evidence) -> Finding:
    x, y = PLACE_MM
    scene = thesis_scene("3", "tri7", x_mm=x, y_mm=y)
    thin, thick = (scene.with_(**{"film.thickness_um": h}) for h in (25.0, 1000.0))
    printed = [e.polynomial(f"3.4.3_{name}", 1.0) for name in "ABC"]
    ours = [[e.ours(film, name) for name in "ABC"] for film in (thin, thick)]
    return Finding(
        "3.4.3",
        "The printed equations are those of the 1 mm film (Fig. 3.25).",
        f"At 1 N they give {_listed(printed)} pC for A, B, C. Our 25 µm film has "
        f"{_listed(ours[0])} pC, the 1 mm film {_listed(ours[1])} pC. They are equations of "
        "Fig. 3.23; with them the statement falls that thickness makes the charge more linear.",
        THICKNESS_PART.title,
    )


# ---------------------------------------------------------------------- chapter 4, orientation


def _corner(e: Evidence) -> Finding:
    charges = {r: e.printed("Table 4.1", "A", r, 1.0) for r in (0.0, 10.0, 20.0, 30.0)}
    return Finding(
        "4.1",
        "The charge grows as a sharp corner gets closer to the electrode.",
        "A corner points at A at 26.6°. Table 4.1 falls from 0° on: "
        + ", ".join(f"{q:.1f} pC at {r:g}°" for r, q in charges.items())
        + ". Only a rigid probe that sticks has its largest charge near the corner.",
        CONTACT_PART.title,
    )


def _pairs(e: Evidence) -> Finding:
    angles = [10.0 * i for i in range(10)]
    gap = max(
        abs(e.printed("Table 4.1", "B", t, 1.0) - e.printed("Table 4.1", "A", 90.0 - t, 1.0))
        for t in angles
    )
    return Finding(
        "4.1.1",
        "There is no clue which charge of B goes with one of A; to find out is virtually "
        "impossible.",
        f"By symmetry B at an angle is A at 90° less that angle: Table 4.1 obeys it within "
        f"{gap:.2f} pC. So A and B together give the angle and the force.",
        "Tables 4.2 and 4.3",
    )


def _angle_errors(e: Evidence) -> Finding:
    curve = e.thesis.polynomials["4.1"]
    estimates = [a for a in e.thesis.angle_estimates if a.source == "Table 4.2"]
    degrees = []
    for one in estimates:
        angle = np.radians(one.angle_text_deg)
        slope = float(curve(angle + 1e-4) - curve(angle - 1e-4)) / np.degrees(2e-4)
        degrees.append(abs((one.check_charge_pC - one.charge_pC) / slope))
    stated = [one.error_stated_percent for one in estimates]
    return Finding(
        "Tables 4.2, 4.3",
        f"The error of the angle is {min(stated):g} to {max(stated):g} %.",
        "These are errors of the charge. Divided by the slope of Eq. 4.1 they are "
        f"{min(degrees):.1f} to {max(degrees):.1f}° in Table 4.2.",
        "Tables 4.2 and 4.3",
    )


def _misprinted_angle(e: Evidence) -> Finding:
    one = next(a for a in e.thesis.angle_estimates if a.charge_pC == 810.0)
    at_table = e.polynomial("4.1", np.radians(one.angle_table_deg))
    return Finding(
        "Table 4.2",
        f"810 pC belong to {one.angle_table_deg:g}°.",
        f"Eq. 4.1 gives {at_table:.2f} pC there; the text's {one.angle_text_deg:g}° solves it.",
        "Tables 4.2 and 4.3",
    )


def _rounded(e: Evidence) -> Finding:
    printed, refit = e.thesis.polynomials["4.1"], e.thesis.polynomials["4.1 refit"]
    angles = [np.degrees(p.solutions(775.0, 0.0, np.pi / 2)[0]) for p in (printed, refit)]
    at_180 = e.polynomial("4.1", np.pi)
    return Finding(
        "4.1, Eq. 4.1",
        "The equation gives the angle to five digits.",
        f"Its rounded coefficients move the angle of 775 pC from {angles[1]:.2f}° to "
        f"{angles[0]:.2f}°, and give {at_180:.0f} pC at 180°, where the table has "
        f"{e.printed('Table 4.1', 'A', 180.0, 1.0):.1f} pC.",
        "Table 4.1",
    )


def _high_degree(e: Evidence) -> Finding:
    B = e.printed("Table 4.6", "B", 0.0, 7.5)
    return Finding(
        "4.2, Eq. 4.10, 4.11",
        "Polynomials of degree six hold up to 7.5 N.",
        f"They pass through their seven points and swing between them; as printed, Eq. 4.11 is "
        f"{e.polynomial('4.11', 7.5) - B:+.1f} pC off at 7.5 N, and Eq. 4.10 gives "
        f"{e.polynomial('4.10', 10.0):.0f} pC at 10 N.",
        "Figs. 4.5 and 4.6",
    )


def _products(e: Evidence) -> Finding:
    worst: list[float] = []
    for name, source, electrode in (("4.12", "Table 4.5", "A"), ("4.13", "Table 4.6", "B")):
        for c in e.thesis.from_(source):
            if c.rotation_deg <= 75.0 and not c.defect and c.electrode == electrode:
                value = e.thesis.products[name].charge_pC(c.rotation_deg, c.force_N)
                worst.append(100.0 * (float(value) / c.charge_pC - 1.0))
    if len(worst) < 50:
        raise KeyError("Tables 4.5, 4.6")
    swing = _spread([e.printed("Table 4.1", "A", angle, 1.0) for angle in (0.0, 90.0)])
    return Finding(
        "4.2, Eq. 4.12, 4.13",
        "The products of an angle's and a force's polynomial agree excellently.",
        f"Against Tables 4.5 and 4.6 they are off by {min(worst):+.1f} to {max(worst):+.1f} %, "
        f"where the whole effect of the rotation is {swing:.1f} %.",
        "Figs. 4.7 to 4.10",
    )


def _normalised(e: Evidence) -> Finding:
    ratios = [
        e.printed("Table 4.6", "B", 0.0, F) / e.printed("Table 4.5", "A", 0.0, F)
        for F in (0.25, 1.0, 5.0)
    ]
    return Finding(
        "4.2, Eq. 4.9",
        "The normalised curve is the same for all forces.",
        "B over A at 0°, which by symmetry is A at 90° over A at 0°, falls with the force: "
        + ", ".join(f"{ratio:.4f}" for ratio in ratios)
        + " at 0.25, 1 and 5 N. The contrast changes by a tenth. Eq. 4.9's first coefficient is "
        "also not the mean of the three that it is called.",
        "Figs. 4.7 to 4.10",
    )


def _copied(e: Evidence) -> Finding:
    copies = [c for c in e.thesis.charges if "copied" in c.defect]
    if not copies:
        raise KeyError("copies")
    return Finding(
        "Tables 4.5, 4.6",
        "Charges at 90° for seven forces.",
        f"{len(copies)} values are the other table's 0° row digit for digit; Table 4.1 has its own "
        f"({e.printed('Table 4.1', 'A', 90.0, 1.0):.4f} pC against "
        f"{e.printed('Table 4.5', 'A', 90.0, 1.0):.4f}).",
        "Figs. 4.11 and 4.12",
    )


def _outliers(e: Evidence) -> Finding:
    A = {r: e.printed("Table 4.5", "A", r, 5.0) for r in (60.0, 75.0)}
    return Finding(
        "Table 4.5",
        "A at 75° and 5 N.",
        f"{A[75.0]:.2f} pC lie above the {A[60.0]:.2f} pC of 60°, against the trend of every other "
        "force.",
        "Figs. 4.11 and 4.12",
    )


# -------------------------------------------------------------------- experiments and the rest


def _reactance(e: Evidence) -> Finding:
    printed = e.thesis.parameters["circuit"]
    X = 1e-6 * thesis_circuit(e.thesis).reactance(20.0)
    return Finding(
        "App. 5",
        f"The reactance at 20 Hz is {printed['reactance_printed']['value']:g} MΩ.",
        f"It is {X:.2f} MΩ. The divider is that of a load in series; a load in parallel fits what "
        "was observed.",
        CIRCUIT_PART.title,
    )


def _theory(e: Evidence) -> Finding:
    large = [p for p in e.thesis.positions if p.kind == "simulated" and p.error_mm > 1.0]
    if not large:
        raise KeyError("positions")
    return Finding(
        "5.3.1, 5.3.2",
        "All theoretical errors are smaller than 1 mm.",
        f"Table 3.3 has {' and '.join(f'{p.error_mm:g}' for p in large)} mm (uniaxial film).",
        MEASURED_POSITIONS_PART.title,
    )


def _rigid(e: Evidence) -> Finding:
    contrasts = []
    for contact in CONTACTS:
        scene = pressed(thesis_scene("4", "rect14x7"), contact)
        contrasts.append(100.0 * (e.ours(scene, "A", MATERIAL) / e.ours(scene, "B", MATERIAL) - 1))
    return Finding(
        "2.1.4, 5",
        "The aluminium probe is simulated as a uniform pressure.",
        f"The contrast A/B of the centred rectangle is {contrasts[0]:.1f} % under a pressure, "
        f"{contrasts[1]:.0f} % under a rigid probe that slides and {contrasts[2]:.0f} % under one "
        "that sticks. A calibration for one is none for the other.",
        CONTACT_PART.title,
    )


def _labels(e: Evidence) -> Finding:
    return Finding(
        "captions",
        "Fig. 3.7 and Table 3.3 name the rectangle; Tables 3.5, 5.1, 5.2 three electrodes; 3.2.2 "
        "closes with ABC and ABD.",
        "The sections about them describe the triangle and four electrodes; ABD has coordinates, "
        "so ACD is meant. Table 3.2 has four rows for the five cases that its text announces.",
        "Tables 3.1 to 3.5",
    )


FINDINGS: tuple[Callable[[Evidence], Finding], ...] = (
    _layout,
    _curve_order,
    _equal_by_symmetry,
    _not_intersecting,
    _two_newtons,
    _linear,
    _cubics,
    _millimetre,
    _corner,
    _pairs,
    _angle_errors,
    _misprinted_angle,
    _rounded,
    _high_degree,
    _products,
    _normalised,
    _copied,
    _outliers,
    _reactance,
    _theory,
    _rigid,
    _labels,
)


def findings(thesis: Thesis, results: Results) -> Iterator[Finding]:
    """Those whose numbers are at hand."""
    evidence = Evidence(thesis, results)
    for finding in FINDINGS:
        with suppress(LookupError, StopIteration):
            yield finding(evidence)


def _scenes(thesis: Thesis) -> list[Scene]:
    x, y = PLACE_MM
    place = thesis_scene("3", "tri7", x_mm=x, y_mm=y)
    rectangle = thesis_scene("4", "rect14x7")
    return [
        thesis_scene("3", "tri7", rotation_deg=-90.0),
        *(place.with_(**{"film.thickness_um": h}) for h in (25.0, 1000.0)),
        *(pressed(rectangle, contact) for contact in CONTACTS),
    ]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    columns = [
        Column("place", "place"),
        Column("states", "the thesis states"),
        Column("gives", "its numbers or the model give"),
        Column("shown", "shown in"),
    ]
    rows: list[list[Cell]] = [
        [one.place, one.states, one.gives, one.shown] for one in findings(thesis, results)
    ]
    return Content(
        [
            "What the thesis states and its own numbers, or the model, contradict. None of it "
            "changes what its sensor can do; much of it changes how far its numbers may be "
            "trusted. Every number here is computed from the printed data or from the scenes of "
            "the section named.",
        ],
        [Table("findings", "Findings.", columns, rows)],
    )


def _spread(values: list[float]) -> float:
    """Largest over smallest, less one, in percent."""
    return 100.0 * (max(values) / min(values) - 1.0)


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in values)


FINDINGS_PART = Part("findings", "Findings", (), _scenes, _compose)
