"""Chapter of the thesis report: which results of the thesis's flat probes hold under a sphere?

A rigid sphere of 5 mm touches the film where it must: a disc that grows with the force. Its charges
are mapped as those of the flat probes; places at one distance from the centre share a solve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.sweeps.lines import direction, placed
from reports.chapters.calibration import (
    DIRECTIONS_DEG,
    Setting,
    calibration,
    calibration_scenes,
    charge_functions,
    lines_deg,
)
from reports.chapters.positions.figures import draw_contours, scene_outlines
from reports.chapters.positions.location import TOUCHING_MM, Crossing
from reports.chapters.thickness import PLACE_MM
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Series, charge_against_force
from reports.common.figures import RING, drawing, frame
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene
from reports.maps.charge_map import Calibration, ChargeFunction, ChargeMap
from reports.maps.isocharge import contour

Place = tuple[float, float]
Functions = Mapping[str, ChargeFunction]

#: Radius of the sphere in mm.
RADIUS_MM = 5.0
#: Distance in mm from the film's centre up to which the sphere's maps hold, and of their places.
REACH_MM = 12.0
PITCH_MM = 4.0
#: Forces in N that a sphere presses with for Fig. 3.20.
FORCES_N = (0.25, 0.5, 1.0, 2.0)
#: Thicknesses in µm of the films of Figs. 3.23 and 3.24.
THIN_UM, THICK_UM = 25.0, 110.0
#: The probe of section 3.1.
TRIANGLE = Setting("tri7", 0.0, 1.0)
#: Relative standard deviation of a charge.
NOISE = 0.01
#: Error in mm up to which the thesis calls a place found.
FOUND_MM = 1.0
CENTRE_MM = (0.0, 0.0)
#: Place in mm beside the centre, where a sphere has a contrast of A over B.
BESIDE_MM = (1.0, 0.0)


def sphere_places(force_N: float) -> Calibration:
    """Places of the sphere for its maps, with the ring of electrodes that all maps have."""
    disc = calibration(Setting("circle1", 0.0, force_N), PITCH_MM)
    probe = {"shape": "sphere", "radius_mm": RADIUS_MM}
    scene = disc.scene.with_(probe=Replaced(probe), load={"kind": "contact", "force_N": force_N})
    return replace(disc, scene=scene, reach_mm=REACH_MM)


def sphere(place_mm: Place, force_N: float, thickness_um: float = THIN_UM) -> Scene:
    """A sphere on the film, with that ring of electrodes."""
    scene = sphere_places(force_N).scene.with_(**{"film.thickness_um": thickness_um})
    return placed(scene, np.array([place_mm]))[0]


def contrast(charges_pC: Mapping[str, float]) -> float:
    """Charge of A over that of B, less one."""
    return charges_pC["A"] / charges_pC["B"] - 1.0


def faked_mm(rectangle: float, beside: float) -> float:
    """Distance of a sphere from the centre at which it has the rectangle's contrast of A over B,
    from its contrast at `BESIDE_MM`."""
    return abs(BESIDE_MM[0] * rectangle / beside)


@cache
def _maps(
    results: Results, force_N: float, d31_pC_N: float, d32_pC_N: float
) -> dict[str, ChargeMap]:
    """Maps by direction; their leading part is of a disc of 1 mm, about as large as the contact."""
    places, disc = sphere_places(force_N), calibration(Setting("circle1", 0.0, 1.0), PITCH_MM)
    records = [results[scene] for scene in places.scenes]
    return places.maps(records, d31_pC_N, d32_pC_N, MATERIAL, results.field(disc.scene))


@dataclass(frozen=True, eq=False)
class Evidence:
    """The printed numbers and our records, with short ways to read them."""

    thesis: Thesis
    results: Results

    def charges(
        self, place_mm: Place, force_N: float, layout: str, thickness_um: float = THIN_UM
    ) -> dict[str, float]:
        """Charges in pC of the electrodes of a layout under the sphere."""
        record = self.results[sphere(place_mm, force_N, thickness_um)]
        directions = DIRECTIONS_DEG[layout].items()
        return {name: record.charge_pC(f"{angle}", MATERIAL) for name, angle in directions}

    def growth(self, place_mm: Place, thickness_um: float = THIN_UM) -> float:
        """Charge of A of three electrodes at 0.5 N over that at 0.25 N."""
        low, high = (self.charges(place_mm, F, "3", thickness_um)["A"] for F in FORCES_N[:2])
        return high / low

    def maps(self, force_N: float, layout: str, film: str = "biaxial") -> Functions:
        """Charge of each electrode of a layout over the sphere's place."""
        d31, d32 = (self.thesis.parameters["film"][film][name]["value"] for name in ("d31", "d32"))
        maps = _maps(self.results, force_N, d31, d32)
        return {name: maps[f"{angle}"] for name, angle in DIRECTIONS_DEG[layout].items()}

    def flat(self, layout: str, film: str = "biaxial") -> Functions:
        """The same of the triangle under 1 N."""
        return charge_functions(self.thesis, self.results, TRIANGLE, layout, film)

    def misses_mm(self, force_N: float, layout: str, functions: Functions) -> list[float]:
        """Distances of the sphere from where the contours of `functions` meet; NaN if nowhere."""
        return [
            meeting(functions, self.charges(place, force_N, layout), place).error_mm
            for place in places_of(self.thesis, force_N)
        ]


def places_of(thesis: Thesis, force_N: float) -> list[Place]:
    """Places in mm of Table 3.1, under 1 N, or of Table 3.5, under 2 N."""
    source = "Table 3.1" if force_N == 1.0 else "Table 3.5"
    return sorted({(row.x_mm, row.y_mm) for row in thesis.positions if row.source == source})


def meeting(functions: Functions, charges_pC: Mapping[str, float], place_mm: Place) -> Crossing:
    """The contours of some charges, and where they meet."""
    contours = (contour(name, functions[name], Q, 1.0) for name, Q in charges_pC.items())
    return Crossing(tuple(contours), np.array(place_mm), TOUCHING_MM)


def falls_percent_mm(
    charge: ChargeFunction, centre_mm: Array, angles_deg: tuple[float, ...]
) -> float:
    """Least fall of a charge in percent per mm on lines from the centre of its electrode.

    It counts from the thesis's first place, 4 mm, to the reach of the sphere's maps.
    """
    falls = []
    for angle in angles_deg:
        along = direction(angle)
        places = centre_mm + np.arange(4.0, 2.0 * REACH_MM, 0.5)[:, None] * along
        value, slope = charge.value_and_gradient(places[np.linalg.norm(places, axis=1) <= REACH_MM])
        falls.append(-100.0 * slope @ along / value)
    return float(np.concatenate(falls).min())


def deviation_mm(functions: Functions, places_mm: Array) -> float:
    """Standard deviation of a place by charges with `NOISE`, root mean square over places (n, 2).

    The force is known, as in the thesis.
    """
    pairs = [function.value_and_gradient(places_mm) for function in functions.values()]
    slopes = np.stack([gradient / value[:, None] for value, gradient in pairs], axis=1)
    covariances = np.linalg.inv(np.swapaxes(slopes, 1, 2) @ slopes)
    return float(NOISE * np.sqrt(np.mean(np.trace(covariances, axis1=1, axis2=2))))


# -------------------------------------------------------------------------------------- claims


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis, its numbers under a flat probe and under the sphere."""

    place: str
    states: str
    flat: str
    sphere: str
    verdict: str


def _verdict(holds: bool, within: str = "") -> str:
    return f"holds{f' within {within}' if within else ''}" if holds else "does not hold"


def _trend(evidence: Evidence) -> Claim:
    angles, centre = lines_deg(evidence.thesis, "4")["D"], np.array([0.0, -10.0])
    flat, sphere_falls = (
        falls_percent_mm(functions["D"], centre, angles)
        for functions in (evidence.flat("4"), evidence.maps(1.0, "4"))
    )
    return Claim(
        "3.1.1, 6.1",
        "The charge falls with the distance from its electrode on every line.",
        f"least fall {flat:.1f} % per mm (triangle)",
        f"least fall {sphere_falls:.1f} % per mm",
        _verdict(sphere_falls > 0.0),
    )


def _same_charges(evidence: Evidence) -> Claim:
    printed = evidence.thesis.from_("Section 3.1")
    places = [(charge.x_mm, charge.y_mm) for charge in printed]
    ratios = [
        evidence.charges(place, 1.0, charge.layout)[charge.electrode] / charge.charge_pC
        for place, charge in zip(places, printed, strict=True)
    ]
    percent = 100.0 * np.subtract(ratios, 1.0)
    worst = float(np.abs(percent).max())
    return Claim(
        "3.1.1, 3.1.2",
        "Charges of the triangle's three scenes.",
        f"{len(printed)} printed charges",
        f"{percent.min():+.1f} to {percent.max():+.1f} % from these",
        _verdict(worst < 10.0, f"{worst:.1f} %"),
    )


def _meet(evidence: Evidence) -> Claim:
    tables = ("Table 3.1", "Table 3.5")
    printed = [row.error_mm for row in evidence.thesis.positions if row.source in tables]
    misses = [
        *evidence.misses_mm(1.0, "3", evidence.maps(1.0, "3")),
        *evidence.misses_mm(2.0, "4", evidence.maps(2.0, "4")),
    ]
    worst = float(np.max(misses))
    return Claim(
        "Tables 3.1, 3.5; 6.2",
        "Isocharge contours meet at the probe, at 1 N and at 2 N.",
        f"up to {np.nanmax(printed):.2f} mm away, {np.isnan(printed).sum()} of {len(printed)} do "
        "not meet (triangle)",
        f"up to {worst:.3f} mm away, with the sphere's own calibration",
        _verdict(worst < FOUND_MM, f"{worst:.2g} mm"),
    )


def _other_probe(evidence: Evidence) -> Claim:
    rows = [row for row in evidence.thesis.positions if row.source == "Table 3.1"]
    turned = np.nanmax([row.error_mm for row in rows if row.rotation_deg])
    three, four = (np.max(evidence.misses_mm(1.0, n, evidence.flat(n))) for n in "34")
    return Claim(
        "3.1.1, 4",
        "What touches, and how it is turned, has a minimal impact on the place that is found.",
        f"triangle turned: up to {turned:.2f} mm away",
        f"read with the triangle's calibration: up to {three:.2f} mm away with three electrodes, "
        f"{four:.2f} mm with four",
        _verdict(max(three, four) < FOUND_MM, f"{max(three, four):.2f} mm"),
    )


def _linear(evidence: Evidence) -> Claim:
    printed = {
        charge.force_N: charge.charge_pC
        for charge in evidence.thesis.from_("Table 3.4")
        if charge.electrode == "A"
    }
    centred, beside = (evidence.growth(place) for place in (CENTRE_MM, PLACE_MM))
    return Claim(
        "3.4.3, 6.2",
        "The charge is linear in the force up to 0.5 N: it doubles from 0.25 to 0.5 N.",
        f"grows {printed[0.5] / printed[0.25]:.2f} times (Table 3.4, A)",
        f"grows {centred:.2f} times at the centre, as F^{math.log2(centred):.2f}, and {beside:.2f} "
        f"times 4 mm from A, as F^{math.log2(beside):.2f}",
        _verdict(min(centred, beside) > 1.9),
    )


def _thickness(evidence: Evidence) -> Claim:
    def flat(um: float) -> float:
        low, high = (evidence.results[flat_film(um, F)] for F in FORCES_N[:2])
        return high.charge_pC("A", MATERIAL) / low.charge_pC("A", MATERIAL)

    thin, thick = (evidence.growth(PLACE_MM, um) for um in (THIN_UM, THICK_UM))
    return Claim(
        "3.4.3",
        "A thicker film is more linear, 110 µm more than 25 µm.",
        f"A grows {flat(THIN_UM):.2f} and {flat(THICK_UM):.2f} times from 0.25 to 0.5 N (triangle)",
        f"{thin:.2f} and {thick:.2f} times",
        _verdict(thick > thin),
    )


def _orientation(evidence: Evidence) -> Claim:
    record = evidence.results[rectangle()]
    flat = contrast({name: record.charge_pC(name, MATERIAL) for name in "AB"})
    centred, beside = (
        contrast(evidence.charges(place, 1.0, "4")) for place in (CENTRE_MM, BESIDE_MM)
    )
    return Claim(
        "4.1",
        "A and B tell how what touches is turned.",
        f"A has {100 * flat:.1f} % more than B, or less, as the rectangle turns by 90°",
        f"A and B agree to {100 * abs(centred):.1g} %; {faked_mm(flat, beside):.2f} mm off the "
        "centre A has as much more",
        _verdict(abs(centred) > 0.1 * flat),
    )


def _uniaxial(evidence: Evidence) -> Claim:
    places = np.array(places_of(evidence.thesis, 1.0))

    def ratio(biaxial: Functions, uniaxial: Functions) -> float:
        return deviation_mm(uniaxial, places) / deviation_mm(biaxial, places)

    flat = [ratio(evidence.flat(n), evidence.flat(n, "uniaxial")) for n in "34"]
    ours = [ratio(evidence.maps(1.0, n), evidence.maps(1.0, n, "uniaxial")) for n in "34"]
    return Claim(
        "3.5, 6.2",
        "A biaxial film finds places better than a uniaxial one.",
        f"noise moves the place {flat[0]:.1f} times less with three electrodes, {flat[1]:.2f} "
        "times with four (triangle)",
        f"{ours[0]:.1f} and {ours[1]:.2f} times less",
        _verdict(min(ours) > 1.0),
    )


CLAIMS: tuple[Callable[[Evidence], Claim], ...] = (
    _trend,
    _same_charges,
    _meet,
    _other_probe,
    _linear,
    _thickness,
    _orientation,
    _uniaxial,
)


# ------------------------------------------------------------------------------------- section


def rectangle() -> Scene:
    """The rectangle of section 4.1 at the centre, not turned."""
    return thesis_scene("4", "rect14x7")


def flat_centre(force_N: float) -> Scene:
    """The triangle of Table 3.4."""
    return thesis_scene("3", "tri7", rotation_deg=-90.0, force_N=force_N)


def flat_film(thickness_um: float, force_N: float) -> Scene:
    """The triangle of section 3.4.3 on a film."""
    x, y = PLACE_MM
    scene = thesis_scene("3", "tri7", x_mm=x, y_mm=y, force_N=force_N)
    return scene.with_(**{"film.thickness_um": thickness_um})


def _quick(thesis: Thesis) -> bool:
    return len(thesis.angles_deg["A"]) == 1


def _scenes(thesis: Thesis) -> list[Scene]:
    few = [sphere(CENTRE_MM, 1.0), sphere(BESIDE_MM, 1.0), rectangle()]
    if _quick(thesis):
        return few
    mapped = (1.0, 2.0)
    films = [(um, F) for um in (THIN_UM, THICK_UM) for F in FORCES_N[:2]]
    return [
        *few,
        *(scene for F in mapped for scene in sphere_places(F).scenes),
        *(sphere(place, F) for F in mapped for place in places_of(thesis, F)),
        *(sphere(CENTRE_MM, F) for F in FORCES_N),
        *(sphere(PLACE_MM, F, um) for um, F in films),
        *(flat_centre(F) for F in FORCES_N),
        *(flat_film(um, F) for um, F in films),
        *calibration_scenes(thesis, [TRIANGLE]),
    ]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    evidence, quick = Evidence(thesis, results), _quick(thesis)
    table = _table([claim(evidence) for claim in ((_orientation,) if quick else CLAIMS)])
    text = (
        "The thesis pressed flat plates. Here a rigid sphere of 5 mm presses, on which the film "
        "slides; where they touch follows from the force. Charges are the material's, over the "
        "electrode's area."
    )
    if quick:
        return Content([text], [table])
    _picture(evidence, out / "spheres.svg")
    caption = (
        "Left: contours of the charges of A, B and C under the sphere at the place of section "
        "3.1.1 (cross); rings: the thesis's contours of the triangle's charges (Fig. 3.9). "
        "Right: charge of A against force at the centre; rings: Table 3.4, the triangle."
    )
    return Content([text, _contours_text(evidence)], [Picture("spheres.svg", caption), table])


def _table(rows: list[Claim]) -> Table:
    columns = [
        Column("place", "place"),
        Column("states", "the thesis states"),
        Column("flat", "under a flat probe"),
        Column("sphere", "under a sphere of 5 mm"),
        Column("verdict", "verdict"),
    ]
    cells: list[list[Cell]] = [
        [row.place, row.states, row.flat, row.sphere, row.verdict] for row in rows
    ]
    return Table("spheres", "Statements of the thesis under a sphere of 5 mm.", columns, cells)


def _first_scene(evidence: Evidence) -> Crossing:
    """Contours of the sphere's charges at the place of section 3.1.1."""
    case = next(charge for charge in evidence.thesis.charges if charge.case == "s311_1")
    place = (case.x_mm, case.y_mm)
    return meeting(evidence.maps(1.0, "3"), evidence.charges(place, 1.0, "3"), place)


def _contours_text(evidence: Evidence) -> str:
    lines = {of.electrode: of.curves for of in _first_scene(evidence).contours}
    points = [p for p in evidence.thesis.contours if math.hypot(p.x_mm, p.y_mm) < REACH_MM]
    apart = [
        min(shapely.Point(p.x_mm, p.y_mm).distance(curve.line) for curve in lines[p.electrode])
        for p in points
    ]
    return (
        f"The sphere's contours are at most {max(apart):.2f} mm from {len(apart)} points of "
        f"Fig. 3.9, and within {np.median(apart):.2f} mm of half of them."
    )


def _picture(evidence: Evidence, path: Path) -> None:
    with drawing(path, 180, 85) as figure:
        left, right = figure.subplots(1, 2)
        crossing = _first_scene(evidence)
        scene_outlines(left, thesis_scene("3", "tri7"), probe=False)
        draw_contours(left, crossing)
        for name, ink in zip("ABC", COLOURS, strict=False):
            points = [point for point in evidence.thesis.contours if point.electrode == name]
            x, y = np.array([(point.x_mm, point.y_mm) for point in points]).T
            left.plot(x, y, **RING, markersize=4.0, markeredgecolor=ink)
        left.plot(*crossing.target_mm, "+", color="black", markersize=12.0)
        frame(left, "contours of A, B and C at 1 N", 14.0)
        _draw_forces(right, evidence)


def _draw_forces(ax: Axes, evidence: Evidence) -> None:
    """Charge of A at the centre over the force, under the sphere and under the triangle."""
    curves = {
        "sphere": [evidence.charges(CENTRE_MM, F, "3")["A"] for F in FORCES_N],
        "triangle": [evidence.results[flat_centre(F)].charge_pC("A", MATERIAL) for F in FORCES_N],
    }
    series = [Series(name, np.array(FORCES_N), np.array(Q)) for name, Q in curves.items()]
    rows = [row for row in evidence.thesis.from_("Table 3.4") if row.electrode == "A"]
    x, y = (np.array([getattr(row, key) for row in rows]) for key in ("force_N", "charge_pC"))
    charge_against_force(ax, series, [Series("triangle", x, y)])
    ax.set_ylabel("charge of A, probe at the centre (pC)")


SPHERES_CHAPTER = Chapter(
    "spheres", "Chapters 3 and 4 under a sphere of 5 mm", (), _scenes, _compose
)
