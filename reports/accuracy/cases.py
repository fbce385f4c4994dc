"""Scenes whose charges are known by other means than the package's finite elements.

A case is a table of `cases.toml`. Its truth is a closed form or a problem in one dimension of
`reports.reference`, the digits of other codes, or else a much finer solve.
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
POINTS = 24  #: Of Gauss rules along a radius, or along a side of an electrode.
FINER = 30.0  #: Least tolerance of a case over the tolerance of the finer solve.
EDGES = (0.1, 0.4)  #: Radii of the contact between which the force of a sphere is found, in radii.
#: What the page calls each kind of truth.
SOURCES = {"exact": "in one dimension", "codes": "by other codes", "finer": "by a finer solve"}

#: N_r + N_t in N/m at radii in m.
Sum = Callable[[Array], Array]


@dataclass(frozen=True)
class RoundFilm:
    """A film under a centred round probe in the scale-free terms of `reports.reference`."""

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

    def charges(self, total: Sum) -> dict[str, float]:
        """Charges in pC of electrodes, from N_r + N_t; d31 and d32 are equal."""
        film = self.scene.film
        factor, edge = 1e12 * film.d31 / film.thickness, self.patch * film.radius
        return {
            electrode.name: factor * _integral(electrode.outline, total, edge)
            for electrode in self.scene.electrode_list
        }


def _integral(outline: Outline, total: Sum, edge: float) -> float:
    """Integral in N m over a disc about the film's centre, or over an upright rectangle beside the
    probe, whose edge has a radius in m."""
    x, weight = legendre.leggauss(POINTS)
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


def pressurised(film: RoundFilm) -> Sum:
    """Hencky's and Campbell's series: a dead pressure on the whole film, at vanishing slopes."""
    radius, size = film.scene.film.radius, (film.force / math.pi) ** (2.0 / 3.0)
    series = campbell(film.pretension / size, film.scene.film.poisson_ratio)
    step = 1e-30

    def total(r: Array) -> Array:  # N_t is the derivative of r N_r
        moved = r / radius + 1j * step
        tension = series.radial_tension(moved)
        return film.scale * size * (tension.real + (moved * tension).imag / step)

    return total


def one_dimensional(film: RoundFilm) -> Sum:
    """Green-Lagrange film under a dead pressure, a follower or a flat punch."""
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


def wrinkled(film: RoundFilm) -> Sum:
    """A film that wrinkles around a dead pressure."""
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


def plate(film: RoundFilm) -> Sum:
    """Von Karman's clamped plate under a dead pressure on all of it, at vanishing slopes."""
    material = film.scene.film
    h, a = material.thickness, material.radius
    stiffness = float(material.stiffness[0, 0]) * h**3 / 12.0
    pressure = film.scene.load.force / (math.pi * a**2) * a**4 / (stiffness * h)
    rest = float(material.prestress[0]) * h * a**2 / stiffness
    found = von_karman_plate(pressure, poisson_ratio=material.poisson_ratio, pretension=rest)
    return lambda r: stiffness / a**2 * np.sum(found.tensions(r / a), axis=0)


def sphere_charges(scene: Scene) -> dict[str, float]:
    """Charges in pC of discs about the centre of the film, on which a sphere slides."""
    (touch,) = scene.loaded_probes
    sphere = Sphere(scene.film, 1e-3 * float(getattr(touch.probe, "radius_mm", math.nan)))
    ends = [share * sphere.radius for share in EDGES]
    edge = brentq(lambda edge: sphere.sliding(edge).force - scene.load.force, *ends, rtol=1e-10)
    contact = sphere.sliding(edge)
    return {
        electrode.name: contact.charge_pC(
            1e3 * math.sqrt(electrode.outline.area / math.pi), scene.film
        )
        for electrode in scene.electrode_list
    }


SUMS: dict[str, Callable[[RoundFilm], Sum]] = {
    of.__name__: of for of in (pressurised, one_dimensional, wrinkled, plate)
}


def known_charges(truth: str, scene: Scene) -> dict[str, float]:
    """Charges in pC by one of `SUMS`, or by `sphere_charges`."""
    if truth == "sphere":
        return sphere_charges(scene)
    film = RoundFilm(scene)
    return film.charges(SUMS[truth](film))


class Case(Section):
    """A scene, and what tells its charges.

    `truth` is one of `SUMS` or ``sphere``; ``codes`` with the `charges_pC` that other codes gave;
    or ``finer`` for a solve to `FINER` times less than `finest`, the least tolerance that is asked
    of the case. NGSolve solves the case if it is a `peer` case.
    """

    name: str
    truth: Literal[
        "pressurised", "one_dimensional", "wrinkled", "plate", "sphere", "codes", "finer"
    ]
    charges_pC: dict[str, float] = Field(default_factory=dict)
    doubt: float = 1e-7  #: Relative error of the charges that are known.
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


def cases(file: str) -> list[Case]:
    """The cases of a file beside this one."""
    table = tomllib.loads((HERE / file).read_text("utf-8"))
    return [Case.model_validate(case) for case in table["case"]]
