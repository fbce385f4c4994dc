"""Chapter of the thesis report: statements that its own numbers or the model contradict.

Each finding computes its numbers from the printed data or from the records of scenes that other
sections show. A finding whose rows are missing, as in a quick report, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.scene.outlines.outline import turn
from reports.chapters import contours, mapping
from reports.chapters.calibration import DIRECTIONS_DEG
from reports.chapters.contact import CONTACT_CHAPTER, CONTACTS, pressed
from reports.chapters.experiments import CIRCUIT_CHAPTER, MEASURED_POSITIONS_CHAPTER, thesis_circuit
from reports.chapters.force_and_angle.angle import ANGLE_CHAPTER, angle_errors_deg
from reports.chapters.force_and_angle.force import RECTANGLE_FORCE_CHAPTER, TRIANGLE_FORCE_CHAPTER
from reports.chapters.force_and_angle.force_law import FORCE_LAW_CHAPTER, rest_charge_pC
from reports.chapters.force_and_angle.orientation import ROTATION_CHAPTER
from reports.chapters.force_and_angle.recovery import RECOVERY_CHAPTER
from reports.chapters.force_and_angle.rectangle import Rectangle, asymmetry_pC, table_scenes
from reports.chapters.force_and_angle.surface import SURFACE_CHAPTER
from reports.chapters.positions.positions import (
    TRIANGLE_POSITIONS_CHAPTER,
    TWO_NEWTON_POSITIONS_CHAPTER,
)
from reports.chapters.spheres import BESIDE_MM, SPHERES_CHAPTER, contrast, faked_mm, sphere
from reports.chapters.thickness import PLACE_MM, THICKNESS_CHAPTER, as_plate
from reports.chapters.transducer import effects, moving
from reports.chapters.transducer.chapter import TRANSDUCER_CHAPTER
from reports.chapters.transducer.texts import pressure_pC, span
from reports.common.chapter import Chapter, Content
from reports.common.page import Cell, Column, Link, Table, joined, signed
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene
from reports.thesis_methods.force_law import local_exponents


@dataclass(frozen=True)
class Evidence:
    """The printed numbers and our records, with short ways to read them."""

    thesis: Thesis
    results: Results

    def printed(self, source: str, electrode: str, rotation_deg: float, force_N: float) -> float:
        """A printed charge in pC; raises `KeyError` if the data at hand lack it."""
        key = (electrode, rotation_deg, force_N)
        rows = {
            (charge.electrode, charge.rotation_deg, charge.force_N): charge
            for charge in self.thesis.from_(source)
        }
        return rows[key].charge_pC

    def polynomial(self, name: str, x: float) -> float:
        """Value of a printed equation at `x` radians or newtons."""
        return float(self.thesis.polynomials[name](x))

    def ours(self, scene: Scene, electrode: str, observable: str = THESIS_EDGE) -> float:
        """Our charge in pC; NaN if the solve failed."""
        return self.results[scene].charge_pC(electrode, observable)


@dataclass(frozen=True)
class Finding:
    """A statement of the thesis and its place, what is true instead, and where that is shown."""

    place: str
    states: str
    gives: str
    shown: Chapter


# --------------------------------------------------------------------- chapter 3, positions


def _layout(evidence: Evidence) -> Finding:
    radii = {
        name: max(point.radius_mm for point in evidence.thesis.contours if point.electrode == name)
        for name in "AB"
    }
    A, B = np.array([0.0, -10.0]), turn([10.0, 0.0], 60.0)
    distance = float(np.linalg.norm(A - B))
    if len(evidence.thesis.contours) < 20:
        raise KeyError("contours")
    return Finding(
        "3.1.1",
        "Electrodes B and C lie at 60° and 120°, and the three form an equilateral triangle.",
        f"Both cannot be. With 60° the centres of A and B are {distance:.2f} mm apart, more than "
        f"the largest radii of their contours in Fig. 3.9 together ({radii['A']:.2f} and "
        f"{radii['B']:.2f} mm): these could not meet. 30° and 150° give the triangle and the data.",
        contours.FIGURE_3_9_CHAPTER,
    )


def _curve_order(evidence: Evidence) -> Finding:
    radius = {
        point.angle_deg: point.radius_mm
        for point in evidence.thesis.contours
        if point.electrode == "A"
    }
    return Finding(
        "3.1.1",
        "In Fig. 3.5 the curve of 35° is uppermost and that of 90° lowermost.",
        f"The thesis's own contour reaches 905 pC at {radius[35.0]:.3f} mm on 35° and at "
        f"{radius[90.0]:.3f} mm on 90°: there the curve of 90° is above. Ours agree.",
        mapping.FIGURE_3_5_CHAPTER,
    )


def _equal_by_symmetry(evidence: Evidence) -> Finding:
    printed = [evidence.printed("Table 3.4", name, -90.0, 1.0) for name in "ABC"]
    scene = thesis_scene("3", "tri7", rotation_deg=-90.0)
    ours, edges = (
        [evidence.ours(scene, name, observable) for name in "ABC"]
        for observable in (MATERIAL, THESIS_EDGE)
    )
    return Finding(
        "3.4.1, Table 3.4",
        "A, B and C differ although they are virtually at the same distance.",
        f"They are equivalent by symmetry. Integrated over the electrodes the charges agree to "
        f"{_spread(ours):.2f} %; averages over edges along x and y, whose directions do not turn "
        f"with the layout, spread by {_spread(edges):.1f} % (printed {_spread(printed):.1f} %).",
        TRIANGLE_FORCE_CHAPTER,
    )


def _not_intersecting(evidence: Evidence) -> Finding:
    simulated = [position for position in evidence.thesis.positions if position.kind == "simulated"]
    failed = [position for position in simulated if np.isnan(position.error_mm)]
    if not failed:
        raise KeyError("positions")
    return Finding(
        "3.1 to 3.4",
        f"{len(failed)} of {len(simulated)} simulated scenes have no intersecting contours.",
        "Contours of a calibration with the probe's own shape and orientation meet in all of "
        "them; what fails is the calibration with the unrotated probe, and the rule that asks for "
        "crossings where least squares has an answer.",
        TRIANGLE_POSITIONS_CHAPTER,
    )


def _two_newtons(evidence: Evidence) -> Finding:
    failed = [
        point.item
        for point in evidence.thesis.triangulation
        if point.case == "s342_2" and "no_" in point.status
    ]
    if not failed:
        raise KeyError("s342_2")
    return Finding(
        "6.2, item 2",
        "Triangulation always works up to 2 N.",
        f"Section 3.4.2 itself reports no intersections of {' and '.join(failed)} for the probe at "
        "the centre, at 2 N.",
        TWO_NEWTON_POSITIONS_CHAPTER,
    )


# ------------------------------------------------------------------------- chapter 3, force


def _linear(evidence: Evidence) -> Finding:
    ratios = [
        evidence.printed("Table 3.4", name, -90.0, 0.5)
        / evidence.printed("Table 3.4", name, -90.0, 0.25)
        for name in "ABC"
    ]
    forces = np.array([0.25, 0.5, 1.0, 2.0])
    charges = np.array([evidence.printed("Table 3.4", "A", -90.0, F) for F in forces])
    _, exponents = local_exponents(forces, charges)
    return Finding(
        "3.4.3, 3.5, 6.2",
        "The charge is linear in the force up to 0.5 N.",
        f"From 0.25 to 0.5 N the printed charges grow {np.mean(ratios):.2f} times, not twice; the "
        f"local exponents of A are {min(exponents):.2f} to {max(exponents):.2f}, near a membrane's "
        "2/3. The claim rests on two points, and a line goes through any two points.",
        FORCE_LAW_CHAPTER,
    )


def _cubics(evidence: Evidence) -> Finding:
    at_rest = rest_charge_pC(thesis_scene("3", "tri7"))
    constant = evidence.polynomial("3.4.1_A", 0.0)
    return Finding(
        "3.4.1, 3.5",
        "Cubic polynomials give the charge between 0.5 and 2 N.",
        "Each has four coefficients for four points, so that nothing is left to test it. That of A "
        f"gives {constant:.1f} pC without force, where the pretension alone makes {at_rest:.1f} "
        f"pC, and {evidence.polynomial('3.4.1_A', 5.0):.0f} pC at 5 N.",
        FORCE_LAW_CHAPTER,
    )


def _thick_and_thin() -> tuple[Scene, Scene, Scene]:
    """The 1 mm film as the plate that it is and as a membrane, and the 25 µm film, at 1 N."""
    x, y = PLACE_MM
    thin = thesis_scene("3", "tri7", x_mm=x, y_mm=y)
    thick = thin.with_(**{"film.thickness_um": 1000.0})
    return as_plate(thick), thick, thin


def _millimetre(evidence: Evidence) -> Finding:
    printed = [evidence.polynomial(f"3.4.3_{name}", 1.0) for name in "ABC"]
    plate, membrane, thin = (
        [evidence.ours(film, name) for name in "ABC"] for film in _thick_and_thin()
    )
    return Finding(
        "3.4.3",
        "The printed equations are those of the 1 mm film (Fig. 3.25).",
        f"At 1 N they give {_listed(printed)} pC for A, B, C. A 1 mm film is a plate, and has "
        f"{_listed(plate)} pC ({_listed(membrane)} pC if it were a membrane); a 25 µm film has "
        f"{_listed(thin)} pC. They are equations of the 25 µm film (Fig. 3.23); with them the "
        "statement falls that thickness makes the charge more linear.",
        THICKNESS_CHAPTER,
    )


# ---------------------------------------------------------------------- chapter 4, orientation


def _corner(evidence: Evidence) -> Finding:
    charges = {
        rotation: evidence.printed("Table 4.1", "A", rotation, 1.0)
        for rotation in (0.0, 10.0, 20.0, 30.0)
    }
    return Finding(
        "4.1",
        "The charge grows as a sharp corner gets closer to the electrode.",
        "A corner points at A at 26.6°. Table 4.1 falls from 0° on: "
        + ", ".join(f"{charge:.1f} pC at {rotation:g}°" for rotation, charge in charges.items())
        + ". Only a rigid probe that sticks has its largest charge near the corner.",
        CONTACT_CHAPTER,
    )


def _pairs(evidence: Evidence) -> Finding:
    asymmetry = asymmetry_pC(evidence.thesis)
    mean = float(np.mean([charge.charge_pC for charge in evidence.thesis.from_("Table 4.1")]))
    return Finding(
        "4.1.1",
        "There is no clue which charge of electrode B goes with one of A; to find out is virtually "
        "impossible.",
        "By symmetry B at an angle is A at 90° less that angle. Charges of Table 4.1 that symmetry "
        f"makes equal differ by {asymmetry:.2f} pC at most, {100.0 * asymmetry / mean:.1f} %. So "
        "A and B together give the angle and the force.",
        RECOVERY_CHAPTER,
    )


def _angle_errors(evidence: Evidence) -> Finding:
    rectangle = Rectangle.of(evidence.thesis, evidence.results)
    if rectangle.theirs is None:
        raise KeyError("Tables 4.1, 4.5, 4.6")
    degrees = angle_errors_deg(evidence.thesis, rectangle)
    stated = [estimate.error_stated_percent for estimate in evidence.thesis.angle_estimates]
    return Finding(
        "Tables 4.2, 4.3",
        f"The error of the angle is {min(stated):g} to {max(stated):g} %.",
        "These are errors of the charge. Over the slope of the thesis's own charges they are "
        f"{min(degrees):.1f} to {max(degrees):.1f}°.",
        ANGLE_CHAPTER,
    )


def _misprinted_angle(evidence: Evidence) -> Finding:
    estimate = next(
        candidate for candidate in evidence.thesis.angle_estimates if candidate.charge_pC == 810.0
    )
    at_table = evidence.polynomial("4.1", np.radians(estimate.angle_table_deg))
    return Finding(
        "Table 4.2",
        f"810 pC belong to {estimate.angle_table_deg:g}°.",
        f"Eq. 4.1 gives {at_table:.2f} pC there; the text's {estimate.angle_text_deg:g}° solves "
        "it.",
        ANGLE_CHAPTER,
    )


def _rounded(evidence: Evidence) -> Finding:
    printed, refit = evidence.thesis.polynomials["4.1"], evidence.thesis.polynomials["4.1 refit"]
    angles = [
        np.degrees(polynomial.solutions(775.0, 0.0, np.pi / 2)[0])
        for polynomial in (printed, refit)
    ]
    at_180 = evidence.polynomial("4.1", np.pi)
    return Finding(
        "4.1, Eq. 4.1",
        "The equation gives the angle to five digits.",
        f"Its rounded coefficients move the angle of 775 pC from {angles[1]:.2f}° to "
        f"{angles[0]:.2f}°, and give {at_180:.0f} pC at 180°, where the table has "
        f"{evidence.printed('Table 4.1', 'A', 180.0, 1.0):.1f} pC.",
        ROTATION_CHAPTER,
    )


def _high_degree(evidence: Evidence) -> Finding:
    B = evidence.printed("Table 4.6", "B", 0.0, 7.5)
    return Finding(
        "4.2, Eq. 4.10, 4.11",
        "Polynomials of degree six hold up to 7.5 N.",
        f"They pass through their seven points and swing between them; as printed, Eq. 4.11 is "
        f"{signed(evidence.polynomial('4.11', 7.5) - B)} pC off at 7.5 N, and Eq. 4.10 gives "
        f"{evidence.polynomial('4.10', 10.0):.0f} pC at 10 N.",
        RECTANGLE_FORCE_CHAPTER,
    )


def _products(evidence: Evidence) -> Finding:
    worst: list[float] = []
    for name, source, electrode in (("4.12", "Table 4.5", "A"), ("4.13", "Table 4.6", "B")):
        for charge in evidence.thesis.from_(source):
            if charge.rotation_deg <= 75.0 and not charge.defect and charge.electrode == electrode:
                value = evidence.thesis.products[name].charge_pC(
                    charge.rotation_deg, charge.force_N
                )
                worst.append(100.0 * (float(value) / charge.charge_pC - 1.0))
    if len(worst) < 50:
        raise KeyError("Tables 4.5, 4.6")
    swing = _spread([evidence.printed("Table 4.1", "A", angle, 1.0) for angle in (0.0, 90.0)])
    return Finding(
        "4.2, Eq. 4.12, 4.13",
        "The products of an angle's and a force's polynomial agree excellently.",
        f"Against Tables 4.5 and 4.6 they are off by {signed(min(worst))} to "
        f"{signed(max(worst))} %, "
        f"where the whole effect of the rotation is {swing:.1f} %.",
        SURFACE_CHAPTER,
    )


def _normalised(evidence: Evidence) -> Finding:
    ratios = [
        evidence.printed("Table 4.6", "B", 0.0, F) / evidence.printed("Table 4.5", "A", 0.0, F)
        for F in (0.25, 1.0, 5.0)
    ]
    return Finding(
        "4.2, Eq. 4.9",
        "The normalised curve is the same for all forces.",
        "B at 0° is by symmetry A at 90°. It is below A at 0° by "
        + joined([f"{100.0 * (1.0 - ratio):.2f} %" for ratio in ratios])
        + " at 0.25, 1 and 5 N. Eq. 4.9's first coefficient is also not the mean of the three that "
        "it is called.",
        SURFACE_CHAPTER,
    )


def _copied(evidence: Evidence) -> Finding:
    copies = [charge for charge in evidence.thesis.charges if "copied" in charge.defect]
    if not copies:
        raise KeyError("copies")
    return Finding(
        "Tables 4.5, 4.6",
        "They list charges at 90° for seven forces.",
        f"{len(copies)} of them are the other table's 0° row digit for digit; Table 4.1 has its "
        f"own ({evidence.printed('Table 4.1', 'A', 90.0, 1.0):.4f} pC against "
        f"{evidence.printed('Table 4.5', 'A', 90.0, 1.0):.4f}).",
        RECTANGLE_FORCE_CHAPTER,
    )


def _outliers(evidence: Evidence) -> Finding:
    A = {rotation: evidence.printed("Table 4.5", "A", rotation, 5.0) for rotation in (60.0, 75.0)}
    return Finding(
        "Table 4.5",
        f"At 75° and 5 N, A has {A[75.0]:.2f} pC.",
        f"That is above the {A[60.0]:.2f} pC of 60°; at every other force the charge falls between "
        "these angles.",
        RECTANGLE_FORCE_CHAPTER,
    )


# -------------------------------------------------------------------- experiments and the rest


def _reactance(evidence: Evidence) -> Finding:
    printed = evidence.thesis.parameters["circuit"]
    X = 1e-6 * thesis_circuit(evidence.thesis).reactance(20.0)
    return Finding(
        "App. 5",
        f"The reactance at 20 Hz is {printed['reactance_printed']['value']:g} MΩ.",
        f"It is {X:.2f} MΩ. The divider is that of a load in series; a load in parallel fits what "
        "was observed.",
        CIRCUIT_CHAPTER,
    )


def _theory(evidence: Evidence) -> Finding:
    large = [
        position
        for position in evidence.thesis.positions
        if position.kind == "simulated" and position.error_mm > 1.0
    ]
    if not large:
        raise KeyError("positions")
    return Finding(
        "5.3.1, 5.3.2",
        "All theoretical errors are smaller than 1 mm.",
        f"Table 3.3 has {' and '.join(f'{position.error_mm:g}' for position in large)} mm "
        "(uniaxial film).",
        MEASURED_POSITIONS_CHAPTER,
    )


def _rigid(evidence: Evidence) -> Finding:
    contrasts = []
    for contact in CONTACTS:
        scene = pressed(thesis_scene("4", "rect14x7"), contact)
        contrasts.append(
            100.0 * (evidence.ours(scene, "A", MATERIAL) / evidence.ours(scene, "B", MATERIAL) - 1)
        )
    return Finding(
        "2.1.4, 5",
        "The aluminium probe is simulated as a uniform pressure.",
        f"The contrast A/B of the centred rectangle is {contrasts[0]:.1f} % under a pressure, "
        f"{contrasts[1]:.0f} % under a rigid probe that slides and {contrasts[2]:.0f} % under one "
        "that sticks. A calibration for one is not valid for the other.",
        CONTACT_CHAPTER,
    )


def _round(evidence: Evidence) -> Finding:
    flat = contrast({n: evidence.ours(thesis_scene("4", "rect14x7"), n, MATERIAL) for n in "AB"})
    touched = sphere(BESIDE_MM, 1.0)
    beside = contrast(
        {n: evidence.ours(touched, f"{DIRECTIONS_DEG['4'][n]}", MATERIAL) for n in "AB"}
    )
    return Finding(
        "4.1",
        "The charges of A and B tell the orientation of what touches.",
        f"Only of what is known to be flat and at the centre: a sphere of 5 mm that is "
        f"{faked_mm(flat, beside):.2f} mm off has the contrast A/B of the rectangle, "
        f"{100 * flat:.1f} %.",
        SPHERES_CHAPTER,
    )


# ------------------------------------------------------------------------------- the transducer


def _pressure(evidence: Evidence) -> Finding:
    _require_whole(evidence)
    part, whole = pressure_pC(effects.ON_PART_MM), pressure_pC(effects.ON_WHOLE_MM)
    return Finding(
        "3.1.1, remark 1",
        "There is no stress in the thickness direction of a thin film, so d33 makes no charge.",
        "The pressure of the probe runs through the film, half of it in the mean, however thin "
        f"the film is. With d33 of App. 1, 1 N on the whole of A makes {whole[0]:.1f} pC, "
        f"{whole[1]:.2f} % of its charge, and {part[0]:.2f} pC on a part of it. It may be left out "
        "since it is small.",
        TRANSDUCER_CHAPTER,
    )


def _quasi_static(evidence: Evidence) -> Finding:
    _require_whole(evidence)
    free, baffled = list(moving.AIR)[1:]
    experiment = evidence.thesis.parameters["experiment"]
    frequency_Hz = experiment["excitation_frequency"]["value"]
    rest, loaded = (moving.motion(F, frequency_Hz) for F in (0.0, 1.0))
    return Finding(
        "6.1, items 2 to 6",
        "The film's mass and its damping by air are negligible; its first mode is at 117 Hz, so "
        f"that {frequency_Hz:g} Hz is quasi-static.",
        f"It is at {rest.first_Hz['in vacuum']:.1f} Hz in a vacuum only. The air that moves with "
        f"the film puts it at {rest.first_Hz[free]:.1f} Hz, or at {rest.first_Hz[baffled]:.1f} Hz "
        f"in a baffle. But 1 N stretches the film, to {loaded.first_Hz[baffled]:.0f} Hz in air "
        f"with a baffle, so that charges are {loaded.excess_percent[baffled]:.2f} % off the "
        "static ones.",
        TRANSDUCER_CHAPTER,
    )


def _tapes(evidence: Evidence) -> Finding:
    _require_whole(evidence)
    over, beyond = (effects.BY_NAME[f"tape {where} each electrode"] for where in ("over", "beyond"))
    place = effects.BESIDE_MM
    return Finding(
        "6.1, item 9",
        "The stiffness of the tapes could well account for the differences.",
        f"A tape of 50 µm over an electrode takes {span(over.percent(place))} % of its charge, one "
        f"that begins beyond it adds {span(beyond.percent(place))} %. In size that is enough for "
        "the measured errors; whether it makes the right touches err is tested in the section.",
        TRANSDUCER_CHAPTER,
    )


def _dominates(evidence: Evidence) -> Finding:
    _require_whole(evidence)
    late = effects.FINGERS[-1]
    whole, part = (late.percent(place)[0] for place in (effects.ON_WHOLE_MM, effects.ON_PART_MM))
    early = effects.finger(0.01).percent(effects.BESIDE_MM)[0]
    return Finding(
        "3.1.1, remark 2; 6.1, item 15",
        "Heat of what touches may dominate other sources.",
        f"On an electrode only. A finger 10 K warmer changes A's charge by {whole:+.0f} % in 1 s "
        f"if it covers A, by {part:+.0f} % if it covers a part of A, and beside A by {early:+.1f} "
        f"% in 10 ms and {late.percent(effects.BESIDE_MM)[0]:+.0f} % in 1 s.".replace("-", "−"),
        TRANSDUCER_CHAPTER,
    )


def _require_whole(evidence: Evidence) -> None:
    """A quick report has no solves of effects that the thesis left out."""
    if len(evidence.thesis.contours) < 20:
        raise KeyError("contours")


def _labels(evidence: Evidence) -> Finding:
    return Finding(
        "captions",
        "Fig. 3.7 and Table 3.3 are captioned as the rectangle's; Tables 3.5, 5.1 and 5.2 as three "
        "electrodes'; section 3.2.2 ends with ABC and ABD as the triples without a crossing.",
        "The sections about them describe the triangle and four electrodes; ABD has printed "
        "coordinates, so ACD is meant. Table 3.2 has four rows for the five cases that its text "
        "announces.",
        MEASURED_POSITIONS_CHAPTER,
    )


#: Findings by what they concern, those with more weight first.
FINDINGS: dict[str, tuple[Callable[[Evidence], Finding], ...]] = {
    "the sensor": (
        _rigid,
        _round,
        _linear,
        _millimetre,
        _pairs,
        _dominates,
        _quasi_static,
        _tapes,
        _corner,
        _pressure,
    ),
    "the methods": (
        _not_intersecting,
        _products,
        _angle_errors,
        _two_newtons,
        _high_degree,
        _cubics,
        _reactance,
        _rounded,
        _normalised,
        _equal_by_symmetry,
    ),
    "the print": (
        _theory,
        _layout,
        _copied,
        _curve_order,
        _misprinted_angle,
        _outliers,
        _labels,
    ),
}


def findings(thesis: Thesis, results: Results) -> Iterator[tuple[str, Finding]]:
    """What they concern, and the findings whose numbers are in the data."""
    evidence = Evidence(thesis, results)
    for concern, of_concern in FINDINGS.items():
        for finding in of_concern:
            with suppress(LookupError, StopIteration):
                yield concern, finding(evidence)


def _scenes(thesis: Thesis) -> list[Scene]:
    rectangle = thesis_scene("4", "rect14x7")
    return [
        thesis_scene("3", "tri7", rotation_deg=-90.0),
        *_thick_and_thin(),
        *table_scenes(thesis),
        *(pressed(rectangle, contact) for contact in CONTACTS),
        sphere(BESIDE_MM, 1.0),
    ]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    columns = [
        Column("rank", "rank", 0),
        Column("concerns", "concerns"),
        Column("place", "place"),
        Column("states", "the thesis states"),
        Column("gives", "its numbers or the model give"),
        Column("shown", "shown in"),
    ]
    rows: list[list[Cell]] = []
    for concern, found in findings(thesis, results):
        link = Link(found.shown.name, found.shown.title)
        rows.append([len(rows) + 1, concern, found.place, found.states, found.gives, link])
    return Content(
        [
            "What the thesis states and its own numbers, or the model, contradict. First stands "
            "what changes how its sensor may be used, then what changes how far its methods may "
            "be trusted, last what is only printed wrong; within each, what weighs more comes "
            "first. Every number here is computed from the printed data or from the scenes of "
            "the section named.",
        ],
        [Table("findings", "Findings.", columns, rows)],
    )


def _spread(values: list[float]) -> float:
    """Excess of the largest value over the smallest, in percent."""
    return 100.0 * (max(values) / min(values) - 1.0)


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in values)


FINDINGS_CHAPTER = Chapter("findings", "Findings", (), _scenes, _compose)
