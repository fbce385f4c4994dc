"""Cases: scenes whose charges are known by other means than the package's finite elements.

A case is a table of `cases.toml`. Its charges are known from a closed form or a one-dimensional
problem of `reports.reference`, from other codes, or else from a much finer solve.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.polynomial import legendre
from pydantic import Field
from scipy.optimize import brentq

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.report.data import Changes
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from reports.reference.axisymmetric import Kind, axisymmetric_membrane
from reports.reference.axisymmetric_wrinkled import wrinkled_membrane
from reports.reference.circular_plate import von_karman_plate
from reports.reference.closed_form import campbell
from reports.reference.sphere_contact import Sphere

HERE = Path(__file__).parent
GAUSS_POINTS = 24  #: Of rules along a radius, or along a side of an electrode.
FINER = 30.0  #: Finest tolerance of a case over the tolerance of the finer solve.
#: Radii between which that of a sphere's contact is searched, over the radius of the sphere.
CONTACT_RANGE = (0.1, 0.4)
#: Words of the page for how charges are known.
SOURCES = {"exact": "in one dimension", "codes": "by other codes", "finer": "by a finer solve"}

#: Returns N_r + N_t in N/m at radii in m.
TensionSum = Callable[[Array], Array]


@dataclass(frozen=True)
class RoundFilm:
    """A film under a centred round probe in the dimensionless terms of `reports.reference`."""

    scene: Scene

    @property
    def modulus(self) -> float:
        """E in Pa."""
        film = self.scene.film
        return float(film.stiffness[0, 0]) * (1.0 - film.poisson_ratio**2)

    @property
    def scale(self) -> float:
        """E h in N/m."""
        return self.modulus * self.scene.film.thickness

    @property
    def force(self) -> float:
        """F/(E h a)."""
        return self.scene.load.force / (self.scale * self.scene.film.radius)

    @property
    def pretension(self) -> float:
        """N0/(E h)."""
        return float(self.scene.film.prestress[0]) / self.modulus

    @property
    def patch(self) -> float:
        """Radius of the probe over the radius of the film."""
        (probe,) = self.scene.loaded_probes
        radius = math.sqrt(probe.outline.area / math.pi)
        return min(radius / self.scene.film.radius, 1.0)  # the probe may be the film, to rounding

    def charges(self, total: TensionSum) -> dict[str, float]:
        """Return the charges of electrodes in pC from N_r + N_t, for equal d31 and d32."""
        film = self.scene.film
        factor, edge = 1e12 * film.d31 / film.thickness, self.patch * film.radius
        return {
            electrode.name: factor * _integrate(electrode.outline, total, edge)
            for electrode in self.scene.electrode_list
        }


def _integrate(outline: Outline, total: TensionSum, edge: float) -> float:
    """Integrate N_r + N_t over an electrode.

    Parameters
    ----------
    outline : Outline
        A disc about the film's centre, or an upright rectangle beside the probe.
    total : callable
        Returns N_r + N_t in N/m at radii in m.
    edge : float
        Radius of the probe in m.

    Returns
    -------
    float
        In N m.
    """
    x, weight = legendre.leggauss(GAUSS_POINTS)
    x, weight = 0.5 * (1.0 + x), 0.5 * weight
    if isinstance(outline, Circle) and not np.any(outline.centre):
        ends = sorted({0.0, min(edge, outline.radius), outline.radius})
        r = np.concatenate([a + (b - a) * x for a, b in pairwise(ends)])
        sizes = np.concatenate([(b - a) * weight for a, b in pairwise(ends)])
        return float((2.0 * np.pi * r * total(r)) @ sizes)
    left, low, right, high = outline.inscribed_polygon.bounds
    r = np.hypot((left + (right - left) * x)[:, None], low + (high - low) * x)
    values = total(r.ravel()).reshape(r.shape)
    return float(outline.inscribed_polygon.area * (weight @ values @ weight))


def sum_pressurised(film: RoundFilm) -> TensionSum:
    """Return N_r + N_t of a dead pressure on the whole film at small slopes (Campbell)."""
    radius, size = film.scene.film.radius, (film.force / math.pi) ** (2.0 / 3.0)
    series = campbell(film.pretension / size, film.scene.film.poisson_ratio)
    step = 1e-30

    def total(r: Array) -> Array:  # N_t is the derivative of r N_r
        moved = r / radius + 1j * step
        tension = series.radial_tension(moved)
        return film.scale * size * (tension.real + (moved * tension).imag / step)

    return total


def sum_one_dimensional(film: RoundFilm) -> TensionSum:
    """Return N_r + N_t at any slopes under a dead pressure, a follower or a flat punch."""
    load, radius = film.scene.load, film.scene.film.radius
    found = axisymmetric_membrane(
        film.force,
        poisson_ratio=film.scene.film.poisson_ratio,
        patch_radius=film.patch,
        pretension=film.pretension,
        kind=cast(Kind, load.kind),
        contact=load.contact or "sliding",
    )
    return lambda r: (
        film.scale * (found.radial_tension(r / radius) + found.hoop_tension(r / radius))
    )


def sum_wrinkled(film: RoundFilm) -> TensionSum:
    """Return N_r + N_t of a film that wrinkles around a dead pressure."""
    material, radius = film.scene.film, film.scene.film.radius
    found = wrinkled_membrane(
        film.force,
        poisson_ratio=material.poisson_ratio,
        patch_radius=film.patch,
        thermal_strain=-film.pretension * (1.0 - material.poisson_ratio),
    )
    return lambda r: (
        film.scale * (found.radial_tension(r / radius) + found.hoop_tension(r / radius))
    )


def sum_plate(film: RoundFilm) -> TensionSum:
    """Return N_r + N_t of a clamped plate under a dead pressure on all of it (von Karman)."""
    material = film.scene.film
    h, a = material.thickness, material.radius
    stiffness = float(material.stiffness[0, 0]) * h**3 / 12.0
    pressure = film.scene.load.force / (math.pi * a**2) * a**4 / (stiffness * h)
    rest = float(material.prestress[0]) * h * a**2 / stiffness
    found = von_karman_plate(pressure, poisson_ratio=material.poisson_ratio, pretension=rest)
    return lambda r: stiffness / a**2 * np.sum(found.tensions(r / a), axis=0)


def compute_sphere_charges(scene: Scene) -> dict[str, float]:
    """Return the charges in pC of discs about the centre of the film, on which a sphere slides."""
    (touch,) = scene.loaded_probes
    sphere = Sphere(scene.film, 1e-3 * float(getattr(touch.probe, "radius_mm", math.nan)))
    ends = [share * sphere.radius for share in CONTACT_RANGE]
    edge = brentq(lambda edge: sphere.sliding(edge).force - scene.load.force, *ends, rtol=1e-10)
    contact = sphere.sliding(edge)
    return {
        electrode.name: contact.charge_pC(
            1e3 * math.sqrt(electrode.outline.area / math.pi), scene.film
        )
        for electrode in scene.electrode_list
    }


#: Solutions by the name of a case's truth.
TENSION_SUMS: dict[str, Callable[[RoundFilm], TensionSum]] = {
    "pressurised": sum_pressurised,
    "one_dimensional": sum_one_dimensional,
    "wrinkled": sum_wrinkled,
    "plate": sum_plate,
}


def compute_known_charges(truth: str, scene: Scene) -> dict[str, float]:
    """Return charges in pC by one of `TENSION_SUMS`, or by `compute_sphere_charges`."""
    if truth == "sphere":
        return compute_sphere_charges(scene)
    film = RoundFilm(scene)
    return film.charges(TENSION_SUMS[truth](film))


class Case(Section):
    """A scene, and how its charges are known.

    `truth` is one of `TENSION_SUMS`, or ``sphere``; ``codes`` for the `charges_pC` of other codes;
    or ``finer`` for a solve to a tolerance `FINER` times finer than `finest`, the finest tolerance
    of the case. NGSolve solves the case if it is a `peer` case.
    """

    name: str
    truth: Literal[
        "pressurised", "one_dimensional", "wrinkled", "plate", "sphere", "codes", "finer"
    ]
    charges_pC: dict[str, float] = Field(default_factory=dict)
    doubt: float = 1e-7  #: Relative error of the known charges.
    finest: float = 1e-5
    peer: bool = False
    preview: bool = False  #: Whether it is in a preview of the report.
    set: Changes

    @property
    def scene(self) -> Scene:
        """The default scene with changes."""
        return Scene().with_(**self.set)

    @property
    def source(self) -> str:
        """The kind of truth, of `SOURCES`."""
        return self.truth if self.truth in SOURCES else "exact"

    @property
    def finer(self) -> Scene:
        """The scene of the finer solve."""
        return self.scene.with_(**{"numerics.tolerance": self.finest / FINER})


def read_cases(file: str) -> list[Case]:
    """Return the cases of a file in this folder."""
    table = tomllib.loads((HERE / file).read_text("utf-8"))
    return [Case.model_validate(case) for case in table["case"]]
