"""The fixed scenes on which run times and errors are measured, with their reference charges.

A reference comes from two resolutions of this code that are compared, or from a closed form. Where
other codes' digits are at hand (`INDEPENDENT`) they are compared as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from pvdf_fem import Scene, solve
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import hencky

#: Radius of the round electrode of the closed-form cases, over the film's radius.
DISC_RATIO = 0.2
#: Pressure p a/(E h) at which Green-Lagrange strains are those of Foeppl and von Karman to 1e-7.
SMALL_PRESSURE = 1e-11

#: Charges in pC (material, dead load) on which two other codes agree to 1e-7.
INDEPENDENT = {
    "rectangle": {"A": 799.3932, "B": 768.6400, "C": 799.3932, "D": 768.6400},
    "triangle": {"A": 1217.9357, "B": 734.6291, "C": 578.6109, "D": 672.5436},
}


@dataclass(frozen=True)
class BenchmarkCase:
    """A scene to measure on.

    Attributes
    ----------
    name, title : str
        Key in tables, and title in figures.
    scene : Scene
    tolerances : (float, float)
        Tolerances of the two solves that the reference comes from, the finer one first.
    exact : callable, optional
        From the scene to the charges in pC of a closed form, which are then the reference.
    """

    name: str
    title: str
    scene: Scene
    tolerances: tuple[float, float] = (1e-7, 1e-6)
    exact: Callable[[Scene], dict[str, float]] | None = None


@dataclass(frozen=True)
class Reference:
    """Charges in pC that errors are counted from, and how well they are known.

    Attributes
    ----------
    charges_pC : dict
    doubt : float
        Largest relative difference between the two resolutions, or of the closed form's digits.
    source : str
    independent : float
        Largest relative difference from another code's values, NaN without any.
    """

    charges_pC: dict[str, float]
    doubt: float
    source: str
    independent: float = math.nan


def worst_error(charges: dict[str, float], reference: dict[str, float]) -> float:
    """Largest relative difference of a charge."""
    return max(abs(charges[name] / value - 1.0) for name, value in reference.items())


def reference(case: BenchmarkCase) -> Reference:
    """The reference of a case; raises `NotConvergedError` if it cannot be computed."""
    if case.exact is not None:
        return Reference(case.exact(case.scene), 1e-8, "closed form")
    fine, coarse = (
        solve(case.scene.with_(**{"numerics.tolerance": tolerance})).charges_pC
        for tolerance in case.tolerances
    )
    independent = INDEPENDENT.get(case.name)
    source = "tolerances {:g} and {:g}".format(*case.tolerances)
    return Reference(
        fine,
        worst_error(coarse, fine),
        source,
        worst_error(fine, independent) if independent else math.nan,
    )


def _triangle(**changes: object) -> Scene:
    probe = {"shape": "triangle", "side_mm": 7.0, "x_mm": 5.0714, "y_mm": 0.8757}
    return Scene().with_(probe=probe).with_(**changes)


def _rectangle(**changes: object) -> Scene:
    probe = {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0}
    return Scene().with_(probe=probe).with_(**changes)


def _disc(x_mm: float, y_mm: float, radius_mm: float) -> Scene:
    probe = {"shape": "circle", "radius_mm": radius_mm, "x_mm": x_mm, "y_mm": y_mm}
    return Scene().with_(probe=probe)


def _round(patch_ratio: float, force: float, poisson_ratio: float, pretension: float) -> Scene:
    """A round film under a round probe of radius `patch_ratio` a, over a round electrode.

    `force` is F/(E h a) and `pretension` N0/(E h), as in `reports.reference.axisymmetric`.
    """
    radius_mm, thickness_um, modulus_GPa = 45.0, 25.0, 2.0
    stiffness = modulus_GPa * 1e9 * thickness_um * 1e-6
    film = {
        "film.poisson_ratio": poisson_ratio,
        "film.temperature_change_K": -pretension * (1.0 - poisson_ratio) / 110e-6,
        "load.force_N": force * stiffness * radius_mm / 1e3,
    }
    electrode = {"name": "A", "x_mm": 0.0, "y_mm": 0.0, "shape": "circle"}
    return Scene().with_(
        **film,
        electrodes=[{**electrode, "radius_mm": DISC_RATIO * radius_mm}],
        probe={"shape": "circle", "radius_mm": patch_ratio * radius_mm},
    )


def _charge_pC(scene: Scene, tension: float) -> dict[str, float]:
    """Charge of the round electrode from the integral of (N_r + N_t) r dr, in E h a^2.

    By symmetry the integrals of S11 and S22 over a concentric disc are equal.
    """
    film = scene.film
    modulus = film.stiffness[0, 0] * (1.0 - film.poisson_ratio**2)
    force = math.pi * tension * modulus * film.radius**2
    return {"A": (film.d31_pC_N + film.d32_pC_N) * force}


def _patch_charge(scene: Scene, points: int = 40) -> dict[str, float]:
    """Charge from the one-dimensional solver with Green-Lagrange strains.

    A Gauss rule of `points` integrates the tension inside and outside of the probe.
    """
    film = scene.film
    modulus = film.stiffness[0, 0] * (1.0 - film.poisson_ratio**2)
    scale = modulus * film.thickness
    assert scene.single_probe is not None
    patch = math.sqrt(scene.single_probe.outline.area / math.pi) / film.radius
    solution = axisymmetric_membrane(
        scene.load.force / (scale * film.radius),
        poisson_ratio=film.poisson_ratio,
        patch_radius=patch,
        pretension=film.stress_at_rest[0] / modulus,
    )
    total = 0.0
    for inner, outer in ((0.0, patch), (patch, DISC_RATIO)):
        xi, weight = legendre.leggauss(points)
        r = inner + (outer - inner) * (1.0 + xi) / 2.0
        tension_sum = solution.radial_tension(r) + solution.hoop_tension(r)
        total += float((weight * tension_sum * r).sum()) * (outer - inner) / 2.0
    return _charge_pC(scene, total)


def _hencky_charge(scene: Scene) -> dict[str, float]:
    """Charge from Hencky's series: (N_r + N_t) r is the derivative of r^2 N_r at small slopes."""
    solution = hencky(scene.film.poisson_ratio)
    tension = float(solution.radial_tension(np.array(DISC_RATIO)))
    return _charge_pC(scene, DISC_RATIO**2 * tension * SMALL_PRESSURE ** (2.0 / 3.0))


CASES: tuple[BenchmarkCase, ...] = (
    BenchmarkCase("rectangle", "rectangle 14 x 7 mm, centre", _rectangle()),
    BenchmarkCase("triangle", "triangle 7 mm, off centre", _triangle()),
    BenchmarkCase("small disc", "disc, radius 1 mm, off centre", _disc(3.0, -2.0, 1.0)),
    BenchmarkCase("110 um", "triangle, film of 110 µm", _triangle(**{"film.thickness_um": 110.0})),
    BenchmarkCase(
        "9 um",
        "triangle, film of 9 µm, 7.5 N",
        _triangle(**{"film.thickness_um": 9.0, "load.force_N": 7.5}),
    ),
    BenchmarkCase(
        "tight", "triangle, ΔT = −20 K", _triangle(**{"film.temperature_change_K": -20.0})
    ),
    BenchmarkCase(
        "near rim",
        "disc, radius 3 mm, near the rim",
        _disc(31.0, 22.0, 3.0),
        (3e-7, 3e-6),
    ),
    BenchmarkCase(
        "follower",
        "rectangle, follower pressure, 7.5 N",
        _rectangle(**{"load.kind": "follower", "load.force_N": 7.5}),
    ),
    BenchmarkCase(
        "rigid",
        "triangle, rigid and sliding",
        _triangle(**{"load.kind": "rigid"}),
        (3e-5, 1e-4),
    ),
    BenchmarkCase(
        "thesis-edge",
        "triangle, thesis-edge charge",
        _triangle(**{"numerics.observable": "thesis-edge"}),
        (1e-6, 1e-5),
    ),
)

ROUND_CASES: tuple[BenchmarkCase, ...] = (
    BenchmarkCase(
        "Hencky",
        "uniform pressure, no pretension",
        _round(1.0, math.pi * SMALL_PRESSURE, 0.3, 0.0),
        exact=_hencky_charge,
    ),
    BenchmarkCase(
        "patch",
        "pressure on a disc of 5 mm, 1 N",
        _round(1.0 / 9.0, 4.444e-4, 0.3, 1.7e-4),
        exact=_patch_charge,
    ),
)


def cases_named(names: Sequence[str]) -> tuple[BenchmarkCase, ...]:
    """Cases by name, in the order of `CASES`; all cases if no name is given."""
    return tuple(case for case in CASES if not names or case.name in names)
