"""Proofs of films that are not round: deflections under pressure, and frequencies.

Published and recomputed values are those of membranes under a small pressure p, whose centre
deflects by h. With half the shorter side a, the tension N0, Young's modulus E and the thickness t
they follow p = C1 N0 h/a² while the tension is that of the unloaded film, and p = C2 E t h³/a⁴
without a tension at rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pvdf_fem import Scene, modes, solve
from tests.validation.proof import Number, proof

Table = Mapping[str, Any]

#: Films of half the shorter side a = 20 mm with C1, the sum of Poisson's series.
RECTANGLES: Mapping[str, tuple[float, float]] = {
    "square": (1.0, 3.393449),
    "sides 1.25 : 1": (1.25, 2.792993),
    "sides 3 : 1": (3.0, 2.037782),
    "sides 4 : 1": (4.0, 2.007739),
}
HALF_SIDE_MM = 20.0


def make_film(table: Table, **numerics: Any) -> Scene:
    """Make a scene of a film with a single electrode of 3 mm at its centre and no probe."""
    electrodes = [{"name": "A", "x_mm": 0.0, "y_mm": 0.0}]
    return Scene(film=dict(table), electrodes=electrodes, numerics=numerics)


def deflect_slightly(table: Table, constant: float) -> float:
    """Return C1 of a film, from its deflection under a pressure that is as small as 1e-5 a."""
    film = make_film(table).film
    tension = film.prestress[0] * film.thickness
    half_side = HALF_SIDE_MM / 1e3
    deflection = 1e-5 * half_side
    pressure = constant * tension * deflection / half_side**2
    scene = make_film({**table, "pressure_Pa": pressure}, tolerance=1e-5)
    found = 1e-3 * float(solve(scene).at(0.0, 0.0).deflection_mm)
    return float(pressure * half_side**2 / (tension * found))


@proof(
    "Rectangles and ellipses under a small pressure",
    source="Poisson's equation: the series for rectangles, w = p/(2 N (1/a² + 1/b²)) for ellipses",
    why="the tolerance of the solve is for the charge; deflections of 1e-5 a change the tension"
    " by 1e-6",
)
def small_pressure() -> Iterator[Number]:
    for name, (ratio, constant) in RECTANGLES.items():
        sides_mm = {"width_mm": 2.0 * ratio * HALF_SIDE_MM, "height_mm": 2.0 * HALF_SIDE_MM}
        ours = deflect_slightly({"shape": "rectangle", **sides_mm}, constant)
        yield Number(f"C1, {name}", ours, constant, 1e-5)
    for ratio in (1.5, 3.0):
        semi_axes_mm = [ratio * HALF_SIDE_MM, HALF_SIDE_MM]
        constant = 2.0 * (1.0 + ratio**-2)
        ours = deflect_slightly({"shape": "ellipse", "semi_axes_mm": semi_axes_mm}, constant)
        yield Number(f"C1, ellipse {ratio:g} : 1", ours, constant, 1e-5)


@proof(
    "A square under pressure, without tension at rest",
    source="recomputed by an independent finite-element code, to 2e-4",
    why="the digits of the other code; slopes of 0.01, whose squares the small-slope theory omits",
)
def slack_square() -> Iterator[Number]:
    half_side = HALF_SIDE_MM / 1e3
    for nu, constant in {0.0: 2.0408, 0.2: 2.3977, 0.4: 3.0033}.items():
        table: dict[str, Any] = {"shape": "square", "side_mm": 2.0 * HALF_SIDE_MM}
        table |= {"temperature_change_K": 0.0, "poisson_ratio": nu, "compression": "tension-field"}
        film = make_film(table).film
        stiffness = 1e9 * film.youngs_modulus_GPa * film.thickness
        pressure = constant * stiffness * (1e-2) ** 3 / half_side
        scene = make_film({**table, "pressure_Pa": pressure}, tolerance=1e-4)
        deflection = 1e-3 * float(solve(scene).at(0.0, 0.0).deflection_mm)
        ours = pressure * half_side**4 / (stiffness * deflection**3)
        yield Number(f"C2, ν = {nu}", float(ours), constant, 4e-4)


def make_sector(radius_mm: float, angle_deg: float) -> Table:
    """Return the table of a film that is a sector of a disc, about the direction -x -y."""
    ends = np.radians(225.0 + 0.5 * angle_deg * np.array([-1.0, 1.0]))
    arc_mm = radius_mm * np.stack([np.cos(ends), np.sin(ends)], axis=-1)
    bulge = float(np.tan(np.radians(angle_deg) / 4.0))
    vertices_mm = [[0.0, 0.0], *arc_mm.tolist()]
    return {"shape": "polyline", "vertices_mm": vertices_mm, "bulges": [0.0, bulge, 0.0]}


@proof(
    "Vibrations of polygons and sectors",
    source="rectangle and equilateral triangle (Lamé) in closed form; the L of three squares and"
    " the regular hexagon as computed to 15 digits by R. S. Jones (2015); half a disc and three"
    " quarters of one by the first zeros of the Bessel functions J1 and J2/3",
    why="the tolerance of the solve",
)
def polygons() -> Iterator[Number]:
    size = 80.0
    hexagon = size / 2.0 * np.exp(1j * np.pi / 3.0 * np.arange(6))
    ell = [[-1, -1], [1, -1], [1, 0], [0, 0], [0, 1], [-1, 1]]
    # λ of -Δu = λ u for a side of 1, the side in mm, the number of the mode, and the tolerance
    known: dict[str, tuple[Table, float, float, int]] = {
        "rectangle 2 : 1, (1, 1)": (
            {"shape": "rectangle", "width_mm": size, "height_mm": size / 2.0},
            5.0 * np.pi**2,
            size,
            0,
        ),
        "rectangle 2 : 1, (2, 1)": (
            {"shape": "rectangle", "width_mm": size, "height_mm": size / 2.0},
            8.0 * np.pi**2,
            size,
            1,
        ),
        "triangle": ({"shape": "triangle", "side_mm": size}, 52.6378901391432, size, 0),
        "hexagon": (
            {
                "shape": "polygon",
                "vertices_mm": np.stack([hexagon.real, hexagon.imag], -1).tolist(),
            },
            7.155339133926,
            size / 2.0,
            0,
        ),
        "L": (
            {"shape": "polygon", "vertices_mm": (size / 2.0 * np.array(ell)).tolist()},
            9.63972384402194,
            size / 2.0,
            0,
        ),
        "half a disc": (make_sector(size / 2.0, 180.0), 14.6819706421, size / 2.0, 0),
        "three quarters of a disc": (make_sector(size / 2.0, 270.0), 11.3947472786, size / 2.0, 0),
    }
    for name, (table, eigenvalue, side_mm, number) in known.items():
        electrodes = [{"name": "A", "x_mm": -5.0, "y_mm": -5.0}]
        scene = Scene(film=dict(table), electrodes=electrodes, numerics={"tolerance": 1e-4})
        film = scene.film
        speed = np.sqrt(film.prestress[0] / film.density)
        theirs = float(speed * np.sqrt(eigenvalue) / (2e-3 * np.pi * side_mm))
        ours = float(modes(scene, number + 1).frequencies_Hz[number])
        yield Number(f"frequency, {name} (Hz)", ours, theirs, 1e-4)
