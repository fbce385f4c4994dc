"""Proofs of frequencies: drums, a plate, and a drum in air."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq
from scipy.special import iv, jn_zeros, jv

from pvdf_fem import Scene, modes
from tests.validation.proof import Number, proof

#: Places of the modes (0,1), (0,2), (0,3) among those of a drum, pairs counted twice.
ROUND = (0, 5, 14)


def frequencies(film: dict[str, float], count: int, tolerance: float = 1e-5) -> list[float]:
    """Frequencies in Hz of a film without load."""
    scene = Scene().with_(film=film, **{"numerics.tolerance": tolerance})
    return [float(f) for f in modes(scene, count).frequencies_Hz]


@proof(
    "A stretched disc",
    source="Lord Rayleigh, Theory of Sound, chapter IX: zeros of Bessel functions",
    why="the tolerance of the solve",
)
def drum() -> Iterator[Number]:
    film = Scene().film
    speed = math.sqrt(film.stress_at_rest[0] / film.density)
    zeros = {"0,1": jn_zeros(0, 1)[-1], "1,1": jn_zeros(1, 1)[-1], "2,1": jn_zeros(2, 1)[-1]}
    found = frequencies({}, 6)
    for (mode, zero), ours in zip(zeros.items(), found[::2], strict=True):
        theirs = zero * speed / (2 * math.pi * film.radius)
        yield Number(f"frequency ({mode}) (Hz)", ours, theirs, 1e-5)


@proof(
    "VM55: a stretched circular membrane",
    source="ANSYS Mechanical APDL Verification Manual, VM55: a = 15 in, h = 0.01 in,"
    " N = 100 lb/in, ρ = 0.00073 lb s²/in⁴",
    why="the manual's target numbers have zeros of Bessel functions to four digits",
)
def vm55() -> Iterator[Number]:
    inch, pound = 25.4e-3, 4.4482216152605
    film = {"radius_mm": 15e3 * inch, "thickness_um": 0.01e6 * inch}
    film |= {"pretension_N_m": 100.0 * pound / inch, "temperature_change_K": None}
    film |= {"density_kg_m3": 0.00073 * pound / inch**4}
    found = frequencies(film, 15, 1e-4)
    for i, theirs in zip(ROUND, (94.406, 216.77, 339.85), strict=True):
        yield Number(f"frequency (0,{ROUND.index(i) + 1}) (Hz)", found[i], theirs, 8e-4)


@proof(
    "COMSOL's vibrating membrane",
    source="COMSOL Multiphysics, model library: a = 0.25 m, 20 kN/m, ρ = 7850 kg/m³, h = 0.2 mm",
    why="four digits are printed",
)
def comsol() -> Iterator[Number]:
    film = {"radius_mm": 250.0, "thickness_um": 200.0, "density_kg_m3": 7850.0}
    film |= {"pretension_N_m": 20e3, "temperature_change_K": None}
    found = frequencies(film, 6, 1e-4)
    printed = {0: 172.80, 1: 275.3, 3: 369.0, 5: 396.6}
    for i, theirs in printed.items():
        yield Number(f"frequency {i + 1} (Hz)", found[i], theirs, 8e-4)


@proof(
    "A clamped plate without tension",
    source="A. W. Leissa, Vibration of Plates (NASA SP-160), 2.1: zeros λ of"
    " Jₙ(λ) Iₙ'(λ) − Jₙ'(λ) Iₙ(λ), computed here",
    why="the tolerance of the solve is 3e-3",
)
def plate() -> Iterator[Number]:
    film = {"thickness_um": 1000.0, "bending": True, "temperature_change_K": 0.0}
    scene = Scene().with_(film=film)
    E, nu = scene.film.youngs_modulus_GPa * 1e9, scene.film.poisson_ratio
    h, a, rho = scene.film.thickness, scene.film.radius, scene.film.density
    unit = math.sqrt(E * h**2 / (12 * (1 - nu**2) * rho)) / (2 * math.pi * a**2)
    found = frequencies(film, 6, 3e-3)
    for n, (i, low, high) in enumerate([(0, 2.0, 4.0), (1, 4.0, 5.0), (3, 5.0, 6.5)]):

        def clamped(x: float, n: int = n) -> float:
            return float(jv(n, x) * iv(n + 1, x) + jv(n + 1, x) * iv(n, x))

        theirs = brentq(clamped, low, high) ** 2
        yield Number(f"λ² of mode ({n},1)", found[i] / unit, theirs, 3e-3)


@proof(
    "A kettledrum's head in air",
    source="measured without its kettle, 65 cm across: T. D. Rossing, The Physics of Kettledrums,"
    " Sci. Am. 247 (1982)",
    why="air is taken as incompressible, while ka is 0.9 to 2.5: the higher modes are up to 4 %"
    " low; in a vacuum the ratios are 1.34 to 2.29, up to 18 % off",
)
def kettledrum() -> Iterator[Number]:
    film = {"radius_mm": 325.0, "thickness_um": 190.0, "density_kg_m3": 0.262 / 190e-6}
    film |= {"pretension_N_m": 3397.0, "temperature_change_K": None}
    air = {"density_kg_m3": 1.2, "baffle": False}
    scene = Scene().with_(film=film, air=air, **{"numerics.tolerance": 3e-3})
    found = np.asarray(modes(scene, 16).frequencies_in_air_Hz)
    # pairs count twice, and (0,2), (1,2), (2,2) and (0,3) are between
    places = {"2,1": 3, "3,1": 6, "4,1": 10, "5,1": 15}
    for (mode, place), theirs in zip(places.items(), (1.48, 1.92, 2.36, 2.78), strict=True):
        yield Number(f"frequency ({mode}) over (1,1)", found[place] / found[1], theirs, 8e-2)
