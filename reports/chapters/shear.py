"""Chapter of the thesis report: can the sensor feel shear?

The thesis's future work asks whether it tells 1 N straight down from 2 N at 30° to the film. The
answer is here in noise: deviations of the tangential force that charges with 1 % of noise leave,
and the noise at which the two touches differ by two deviations, whatever else may have changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem import Scene, solve
from pvdf_fem.arrays import Array
from pvdf_fem.derivatives.rates import force_rates
from pvdf_fem.touch.by_solves import SolveOptions, locate_by_solves
from reports.chapters.contact import rotations_deg
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Series, colours, label_curves
from reports.common.figures import drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import Results
from reports.common.thesis_data import Thesis

#: Relative standard deviation of a charge.
NOISE = 0.01
#: Places of the probe in mm: the centre, that of section 3.1.2, and one beyond.
PLACES = ((0.0, 0.0), (5.0714, 0.8757), (-3.0, 8.0))
PROBES: dict[str, dict[str, Any]] = {
    "triangle of 7 mm": {"shape": "triangle", "side_mm": 7.0},
    "disc of 2 mm radius": {"shape": "circle", "radius_mm": 2.0},
}
#: The oblique force: 2 N at 30° to the film is 1 N down and this along it, in N.
ALONG_N = 2.0 * math.cos(math.radians(30.0))
#: Directions of that in the film's plane, in degrees.
DIRECTIONS_DEG = (30.0, 120.0)
PLACE_KEYS = ("probe.x_mm", "probe.y_mm")
FORCE_KEYS = ("load.force_N", "load.tangential_N[0]", "load.tangential_N[1]")
#: Few starts: the touch straight down is near the oblique one, or wherever charges are alike.
QUICK = SolveOptions(pitch_mm=5.0, starts=6, rounds=0, tolerance=1e-3)


@dataclass(frozen=True)
class Sensor:
    """A ring of square electrodes on the biaxial film or on the uniaxial one."""

    count: int = 4
    ring_mm: float = 10.0
    side_mm: float = 3.0
    uniaxial: bool = False

    @property
    def scene(self) -> Scene:
        """Without a probe."""
        ring = {"layout": "ring", "shape": "square", "count": self.count}
        electrodes = {**ring, "ring_radius_mm": self.ring_mm, "side_mm": self.side_mm}
        d31, d32 = (18.0, 2.0) if self.uniaxial else (8.0, 8.0)
        return Scene().with_(
            **{"electrodes": electrodes, "film.d31_pC_N": d31, "film.d32_pC_N": d32}
        )

    def touched(self, probe: str, place: tuple[float, float], along_N: Any = (0.0, 0.0)) -> Scene:
        """Under 1 N down, and a force along the film."""
        x, y = place
        load = {"force_N": 1.0, "tangential_N": list(along_N)}
        return self.scene.with_(probe={**PROBES[probe], "x_mm": x, "y_mm": y}, load=load)

    def __str__(self) -> str:
        film = "uniaxial" if self.uniaxial else "biaxial"
        return f"{self.count} of {self.side_mm:g} mm at {self.ring_mm:g} mm, {film}"


SENSORS = (Sensor(), Sensor(8), Sensor(4, uniaxial=True), Sensor(8, uniaxial=True))
COUNTS = (5, 6, 8, 12)
RINGS_MM = (6.0, 8.0, 10.0, 12.0, 15.0)
DESIGNS = tuple(
    Sensor(count, ring, side, uniaxial)
    for uniaxial in (False, True)
    for count in COUNTS
    for ring in RINGS_MM
    for side in (2.0, 3.0, 4.0)
    if side == 3.0 or count == 8
    if count * side * math.sqrt(2.0) < 2.0 * math.pi * ring
)


@lru_cache(maxsize=1024)
def deviations_N(sensor: Sensor, probe: str, place: tuple[float, float]) -> tuple[Any, Any]:
    """Cramér-Rao deviations of Fx and Fy, (2,): at a known place, and with the place unknown."""
    scene = sensor.touched(probe, place)
    solution = solve(scene)
    d = 1e12 * np.array([scene.film.d31, scene.film.d32])
    charges = np.array(list(solution.charges_pC.values()))
    slopes = (force_rates(solution, (*FORCE_KEYS, *PLACE_KEYS)) @ d).T / (NOISE * charges[:, None])
    return _deviations(slopes[:, :3]), _deviations(slopes)


def _deviations(slopes: Array) -> Array:
    """Of the second and third unknown; infinite where there are fewer channels than unknowns."""
    if slopes.shape[0] < slopes.shape[1]:
        return np.full(2, np.inf)
    return np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))[1:3]


def merit_N(sensor: Sensor, known: bool) -> float:
    """Root mean square deviation of Fx and Fy off the centre, under the triangle, in N."""
    probe = next(iter(PROBES))
    values = [deviations_N(sensor, probe, place)[0 if known else 1] for place in PLACES[1:]]
    return float(np.sqrt(np.mean(np.square(values))))


def telling_noise(sensor: Sensor, place: tuple[float, float]) -> float:
    """Largest relative noise at which no touch straight down is within two deviations.

    The charges are those of 2 N at 30° to the film, the worse of the directions; place and force of
    the touch straight down are fitted.
    """
    probe, noises = next(iter(PROBES)), []
    straight = sensor.touched(probe, place).with_(**{"load.tangential_N": None})
    for angle in np.radians(DIRECTIONS_DEG).tolist():
        along = (ALONG_N * math.cos(angle), ALONG_N * math.sin(angle))
        charges = solve(sensor.touched(probe, place, along)).charges_pC
        found = locate_by_solves(straight, charges, NOISE, options=QUICK)
        noises.append(NOISE * math.sqrt(min(touch.chi_square for touch in found)) / 2.0)
    return min(noises)


def _scenes(thesis: Thesis) -> list[Scene]:
    return []


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    if len(rotations_deg(thesis)) <= 2:
        return Content(["A quick report leaves this section out."], [])
    best = min(DESIGNS, key=lambda design: merit_N(design, False))
    sensors = (*SENSORS, best)
    noises = {sensor: telling_noise(sensor, PLACES[1]) for sensor in sensors}
    _picture(out / "shear.svg")
    caption = (
        f"Deviation of the tangential force under the triangle at {100 * NOISE:g} % of noise, 1 N "
        "straight down, over the radius of the ring of 3 mm electrodes: root mean square of both "
        "components at the two places off the centre. Lines: place unknown; dotted: known."
    )
    return Content(
        [_question_text(noises), _deviations_text(), _design_text(best)],
        [Picture("shear.svg", caption), _table(sensors, noises)],
    )


def _picture(path: Path) -> None:
    with drawing(path, 180, 80) as figure:
        axes = figure.subplots(1, 2, sharey=True)
        for ax, uniaxial in zip(axes, (False, True), strict=True):
            ax.set_yscale("log")
            ax.set(ylim=(0.03, 1.5), xlim=(5.5, 15.5), xlabel="radius of the ring (mm)")
            ax.set_yticks([0.03, 0.1, 0.3, 1.0], ["0.03", "0.1", "0.3", "1"])
            ax.yaxis.set_minor_formatter("")
            ax.set_title("uniaxial film" if uniaxial else "biaxial film")
            for known, dashes in ((False, "-"), (True, ":")):
                lines = [_line(count, uniaxial, known) for count in COUNTS]
                inks = colours(len(lines))
                for line, ink in zip(lines, inks, strict=True):
                    ax.plot(line.x, line.y, dashes, color=ink, marker="o", ms=3.0)
                if uniaxial and not known:
                    label_curves(ax, lines, inks)
        for text, height in (("place unknown", 1.05), ("place known", 0.034)):
            axes[0].text(10.0, height, text, ha="center", va="bottom")
        axes[0].set_ylabel("deviation of Fx, Fy (N)")


def _line(count: int, uniaxial: bool, known: bool) -> Series:
    """Merit over the radius of the ring, of electrodes of 3 mm."""
    designs = [Sensor(count, ring, uniaxial=uniaxial) for ring in RINGS_MM]
    designs = [design for design in designs if design in DESIGNS]
    x, y = np.array([(design.ring_mm, merit_N(design, known)) for design in designs]).T
    return Series(f"{count} electrodes", x, y)


def _table(sensors: tuple[Sensor, ...], noises: dict[Sensor, float]) -> Table:
    columns = [
        Column("sensor", "electrodes, film"),
        Column("probe", "probe"),
        Column("place", "place (mm)"),
        *(
            Column(f"{component}_{case}_N", f"{component} (N)", 3, f"place {case}")
            for case in ("known", "unknown")
            for component in ("Fx", "Fy")
        ),
        Column("noise_percent", "noise that tells 30° (%)", 2),
    ]
    rows: list[list[Cell]] = []
    for sensor in sensors:
        for probe in PROBES:
            for place in PLACES:
                known, unknown = deviations_N(sensor, probe, place)
                told = probe == next(iter(PROBES)) and place == PLACES[1]
                noise = 100.0 * noises[sensor] if told else math.nan
                finite = [float(v) if np.isfinite(v) else math.nan for v in (*known, *unknown)]
                rows.append([str(sensor), probe, f"({place[0]:g}, {place[1]:g})", *finite, noise])
    caption = (
        f"Deviations of the tangential force at {100 * NOISE:g} % of noise, 1 N straight down, "
        "with the force down unknown too. Last column: the noise at which charges of 2 N at 30° to "
        "the film are two deviations from those of any touch straight down, the worse of two "
        "directions. Empty: fewer channels than unknown quantities, or not computed."
    )
    return Table("shear", caption, columns, rows)


def _question_text(noises: dict[Sensor, float]) -> str:
    told = [f"{100 * noise:.2g} % ({sensor})" for sensor, noise in noises.items()]
    return (
        "Chapter 6 asks whether the sensor tells 1 N straight down from 2 N at 30° to the film: "
        f"the force down is the same, {ALONG_N:.3f} N act along the film. With place and force of "
        "a touch straight down free, the two differ by two deviations up to a noise of "
        f"{', '.join(told)}. A touch elsewhere explains most of the shear."
    )


def _deviations_text() -> str:
    four, eight, uniaxial = SENSORS[0], SENSORS[1], SENSORS[3]
    probe, centre = next(iter(PROBES)), PLACES[0]
    at_centre = [deviations_N(sensor, probe, centre)[1] for sensor in (eight, uniaxial)]
    return (
        f"At {100 * NOISE:g} % of noise, off the centre and at a known place, four electrodes find "
        f"the tangential force to {merit_N(four, True):.2f} N, eight to {merit_N(eight, True):.2f} "
        "N (root mean square of both components). With the place unknown there are five unknown "
        "quantities: four electrodes cannot find them, eight do to "
        f"{merit_N(eight, False):.2f} N, on the uniaxial film to {merit_N(uniaxial, False):.2f} N. "
        "At the centre a small force along the film does nearly what a shift of the probe does: "
        f"eight electrodes leave {at_centre[0][0]:.2g} and {at_centre[0][1]:.2g} N of Fx and Fy "
        f"there, on the uniaxial film {at_centre[1][0]:.2g} and {at_centre[1][1]:.2g} N."
    )


def _design_text(best: Sensor) -> str:
    worst = max(DESIGNS, key=lambda design: merit_N(design, False))
    good = min((d for d in DESIGNS if d.count == 8), key=lambda design: merit_N(design, False))
    return (
        f"Of {len(DESIGNS)} designs with 5 to 12 electrodes the best has {best}: "
        f"{merit_N(best, False):.3f} N with the place unknown and {merit_N(best, True):.3f} N at a "
        f"known place. Of those with eight electrodes the best has {good}, which leaves "
        f"{merit_N(good, False):.3f} N; the worst, {worst}, {merit_N(worst, False):.2g} N."
    )


SHEAR_CHAPTER = Chapter("shear", "Chapter 6: can it feel shear?", (), _scenes, _compose)
