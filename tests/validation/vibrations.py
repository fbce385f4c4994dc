"""Proofs of frequencies: drums, a plate, and a drum in air."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pvdf_fem import Scene, modes
from reports.reference.closed_form import disc_frequencies
from tests.validation.proof import Number, proof


def compared(
    scene: Scene, known: dict[int, tuple[str, float]], tolerance: float, allowed: float
) -> Iterator[Number]:
    """Frequencies in Hz of a film without load, by their places, beside those that are known."""
    scene = scene.with_(**{"numerics.tolerance": tolerance})
    found = modes(scene, max(known) + 1).frequencies_Hz
    for place, (mode, theirs) in known.items():
        yield Number(f"frequency {mode} (Hz)", float(found[place]), theirs, allowed)


#: The manuals' units, in m and N.
INCH, POUND = 25.4e-3, 4.4482216152605


@proof(
    "A stretched disc",
    source="Lord Rayleigh, Theory of Sound, chapter IX: zeros of Bessel functions",
    why="the tolerance of the solve",
)
def drum() -> Iterator[Number]:
    film = Scene().film
    per_area = {"tension": film.prestress[0], "areal_density": film.density}
    zeros = disc_frequencies(6, radius=film.radius, **per_area)
    modes = "(0, 1)", "(1, 1)", "(1, 1)", "(2, 1)", "(2, 1)", "(0, 2)"
    known = {i: pair for i, pair in enumerate(zip(modes, zeros.tolist(), strict=True))}
    yield from compared(Scene(), known, 1e-5, 1e-5)


@proof(
    "VM55: a stretched circular membrane",
    source="ANSYS Mechanical APDL Verification Manual, VM55: a = 15 in, h = 0.01 in,"
    " N = 100 lb/in, ρ = 0.00073 lb s²/in⁴",
    why="the manual's target numbers have zeros of Bessel functions to four digits",
)
def vm55() -> Iterator[Number]:
    film = {"radius_mm": 15e3 * INCH, "thickness_um": 0.01e6 * INCH}
    film |= {"pretension_N_m": 100.0 * POUND / INCH, "density_kg_m3": 0.00073 * POUND / INCH**4}
    known = {0: ("(0, 1)", 94.406), 5: ("(0, 2)", 216.77), 14: ("(0, 3)", 339.85)}
    yield from compared(Scene().with_(film=film), known, 1e-4, 8e-4)


@proof(
    "VM152 and VM153: a membrane that cooling stretches",
    source="ANSYS Mechanical APDL Verification Manual, input listings vm152.dat and vm153.dat:"
    " a = 3 in, h = 5e-5 in, E = 3e7 psi, ν = 0, α = 1e-5/K, ΔT = −20/3 K, ρ = 0.00073 lb s²/in⁴",
    why="the targets have zeros of Bessel functions to three or four digits",
)
def vm152() -> Iterator[Number]:
    film = {"radius_mm": 3e3 * INCH, "thickness_um": 50.0 * INCH, "poisson_ratio": 0.0}
    film |= {"youngs_modulus_GPa": 3e-2 * POUND / INCH**2, "thermal_expansion_per_K": 1e-5}
    film |= {"temperature_change_K": -20.0 / 3.0, "density_kg_m3": 0.00073 * POUND / INCH**4}
    known = {0: ("(0, 1)", 211.1), 1: ("(1, 1)", 336.5), 3: ("(2, 1)", 450.9)}
    known |= {5: ("(0, 2)", 484.7), 8: ("(1, 2)", 616.1)}
    yield from compared(Scene().with_(film=film), known, 1e-4, 8e-4)


@proof(
    "COMSOL's vibrating membrane",
    source="COMSOL Multiphysics, model library: a = 0.25 m, 20 kN/m, ρ = 7850 kg/m³, h = 0.2 mm",
    why="four digits are printed",
)
def comsol() -> Iterator[Number]:
    film = {"radius_mm": 250.0, "thickness_um": 200.0, "density_kg_m3": 7850.0}
    film |= {"pretension_N_m": 20e3}
    printed = {0: 172.80, 1: 275.3, 3: 369.0, 5: 396.6}
    known = {i: (str(i + 1), theirs) for i, theirs in printed.items()}
    yield from compared(Scene().with_(film=film), known, 1e-4, 8e-4)


@proof(
    "A clamped plate without tension",
    source="A. W. Leissa, Vibration of Plates (NASA SP-160), 2.1: λ² to four or five digits",
    why="the tolerance of the solve is 3e-3",
)
def plate() -> Iterator[Number]:
    film = {"thickness_um": 1000.0, "bending": True, "temperature_change_K": 0.0}
    scene = Scene().with_(film=film)
    E, nu = scene.film.youngs_modulus_GPa * 1e9, scene.film.poisson_ratio
    h, a, rho = scene.film.thickness, scene.film.radius, scene.film.density
    unit = math.sqrt(E * h**2 / (12 * (1 - nu**2) * rho)) / (2 * math.pi * a**2)
    printed = {0: ("(0, 1)", 10.2158), 1: ("(1, 1)", 21.26), 3: ("(2, 1)", 34.88)}
    printed |= {5: ("(0, 2)", 39.771)}
    known = {i: (mode, unit * square) for i, (mode, square) in printed.items()}
    yield from compared(scene, known, 3e-3, 3e-3)


@proof(
    "A kettledrum's head in air",
    source="measured without its kettle, 65 cm across: T. D. Rossing, The Physics of Kettledrums,"
    " Sci. Am. 247 (1982)",
    why="air is taken as incompressible, while ka is 0.9 to 2.5: the higher modes are up to 4 %"
    " low; in a vacuum the ratios are 1.34 to 2.29, up to 18 % off",
)
def kettledrum() -> Iterator[Number]:
    film = {"radius_mm": 325.0, "thickness_um": 190.0, "density_kg_m3": 0.262 / 190e-6}
    film |= {"pretension_N_m": 3397.0}
    air = {"density_kg_m3": 1.2, "baffle": False}
    scene = Scene().with_(film=film, air=air, **{"numerics.tolerance": 3e-3})
    found = np.asarray(modes(scene, 16).frequencies_in_air_Hz)
    # pairs count twice, and (0,2), (1,2), (2,2) and (0,3) are between
    places = {"2,1": 3, "3,1": 6, "4,1": 10, "5,1": 15}
    for (mode, place), theirs in zip(places.items(), (1.48, 1.92, 2.36, 2.78), strict=True):
        yield Number(f"frequency ({mode}) over (1,1)", found[place] / found[1], theirs, 8e-2)
