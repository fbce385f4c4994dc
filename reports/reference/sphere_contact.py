"""A rigid sphere pressed into the centre of a clamped film that slides on it.

Green-Lagrange membrane, axisymmetric, by shooting; it shares nothing with the finite elements.
Outside of the contact's edge b the forces balance: r N_r w' is constant and (r N_r (1 + u'))' =
N_t (1 + u/r). At the edge the film leaves the sphere without a kink and without a jump of N_r.
On the sphere the film obeys the same balance along its surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from pvdf_fem.arrays import Array

Fields = Callable[[float], Array]
Rates = Callable[[float, Array], Sequence[float]]


@dataclass(frozen=True)
class SphereContact:
    """A contact: its edge and depth in m, the force in N.

    `sums` (r) are the integral of N_r + N_t in N m over the reference disc of radius r.
    """

    edge: float
    depth: float
    force: float
    sums: Callable[[float], float]

    def charge_pC(self, radius_mm: float, film: Film) -> float:
        """Of a centred disc."""
        return 1e12 * film.d31 * self.sums(radius_mm / 1e3) / film.thickness


class Film(Protocol):
    """The properties of a film that are used here, in SI units."""

    @property
    def radius(self) -> float:
        """Radius in m."""

    @property
    def thickness(self) -> float:
        """Thickness in m."""

    @property
    def stiffness(self) -> Array:
        """Plane stress stiffness (3, 3) in Pa."""

    @property
    def prestress(self) -> Array:
        """Stress (3,) of the flat film in Pa."""

    @property
    def d31(self) -> float:
        """Coefficient d31 in C/N."""


@dataclass(frozen=True)
class Sphere:
    """A sphere of a radius in m on the centre of an isotropic film."""

    film: Film
    radius: float
    rtol: float = 1e-9

    def sliding(self, edge: float) -> SphereContact:
        """Return the contact with an edge in m on which all film slides outwards."""

        def leaving(strain: float) -> tuple[Fields, Fields]:
            inside = self._inside(edge, strain)
            u, pull = inside(edge)
            return inside, self._outside(edge, u, pull / (1.0 + self._sphere(edge + u)[1] ** 2))

        strain = self._clamped(lambda e: leaving(e)[1], 0.25 * (edge / self.radius) ** 2)
        inside, outside = leaving(strain)

        def density(r: float) -> float:
            u, pull = inside(r)
            return self._sum(r, u, pull / math.sqrt(1.0 + self._sphere(r + u)[1] ** 2))

        return self._contact(edge, outside, lambda r: _disc(density, 0.0, r))

    def _contact(
        self, edge: float, outside: Fields, inside: Callable[[float], float]
    ) -> SphereContact:
        def density(r: float) -> float:
            u, _, pull, force = outside(r)
            return self._sum(r, u, math.hypot(pull, force))

        def sums(r: float) -> float:
            return inside(min(r, edge)) + (_disc(density, edge, r) if r > edge else 0.0)

        u, _, _, force = outside(edge)
        depth = self._sphere(edge + u)[0] - outside(self.film.radius)[1]
        return SphereContact(edge, depth, 2.0 * np.pi * force, sums)

    def _clamped(self, outside: Callable[[float], Fields], guess: float) -> float:
        """Return the argument near a guess at which the rim does not move."""

        def moved(x: float) -> float:
            return float(outside(guess * x)(self.film.radius)[0]) / self.radius

        low, high = 0.99, 1.01
        while moved(low) > 0.0:
            low, high = 1.0 - 3.0 * (1.0 - low), low
        while moved(high) < 0.0:
            low, high = high, 1.0 + 3.0 * (high - 1.0)
        return guess * float(brentq(moved, low, high, xtol=1e-10))

    # --- the film: N_r and N_t are `stiffness` times the strains, and the unloaded tension

    @cached_property
    def _stiffness(self) -> tuple[float, float, float]:
        """Stiffness in N/m, Poisson's ratio, and the tension of the unloaded film in N/m."""
        film, C = self.film, self.film.stiffness
        tension = float(film.prestress[0]) * film.thickness
        return float(C[0, 0]) * film.thickness, float(C[0, 1] / C[0, 0]), tension

    def _tensions(self, r: float, u: float, pull: float) -> tuple[float, float, float]:
        """N_r, N_t and the radial stretch where r N_r times it is `pull`."""
        k, nu, rest = self._stiffness
        hoop = u / r + 0.5 * (u / r) ** 2
        base, stretch = rest + k * (nu * hoop - 0.5), 1.0
        for _ in range(20):
            n_r = base + 0.5 * k * stretch**2
            step = (stretch * n_r - pull / r) / (n_r + k * stretch**2)
            stretch -= step
            if abs(step) < 1e-14:
                break
        n_t = rest + k * (hoop + 0.5 * nu * (stretch**2 - 1.0))
        return base + 0.5 * k * stretch**2, n_t, stretch

    def _sum(self, r: float, u: float, pull: float) -> float:
        return sum(self._tensions(r, u, pull)[:2])

    def _sphere(self, place: float) -> tuple[float, float, float]:
        """Height over the lowest point, and its first two derivatives."""
        root_ = math.sqrt(self.radius**2 - place**2)
        return self.radius - root_, place / root_, self.radius**2 / root_**3

    def _outer(self, r: float, y: Array) -> list[float]:
        """Rates of u, w, r N_r (1 + u') and the force/(2 pi) outside."""
        u, _, pull, force = y.tolist()
        n_r, n_t, _ = self._tensions(r, u, math.hypot(pull, force))
        return [pull / (r * n_r) - 1.0, -force / (r * n_r), n_t * (1.0 + u / r), 0.0]

    def _outside(self, edge: float, u: float, pull: float) -> Fields:
        """Return the fields of the film that leaves the sphere without a kink."""
        y = [u, 0.0, pull, self._sphere(edge + u)[1] * pull]
        return _integrated(self._outer, (edge, self.film.radius), y, self.rtol)

    def _inside(self, edge: float, strain: float) -> Fields:
        """u and r N_r (1 + u') (1 + z'^2), of the strain at the centre."""

        def rates(r: float, y: Array) -> list[float]:
            u, pull = y.tolist()
            _, first, second = self._sphere(r + u)
            steep = 1.0 + first**2
            n_r, n_t, stretch = self._tensions(r, u, pull / math.sqrt(steep))
            radial, around = stretch / math.sqrt(steep), 1.0 + u / r
            turned = r * n_r * radial**2 * first * second
            return [radial - 1.0, n_t * around + turned]

        k, nu, rest = self._stiffness
        start = 1e-4 * edge
        tension = rest + k * (1.0 + nu) * strain
        y = [strain * start, start * tension * (1.0 + strain)]
        return _integrated(rates, (start, edge), y, self.rtol)


def _integrated(rates: Rates, span: tuple[float, float], y: list[float], rtol: float) -> Fields:
    found = solve_ivp(rates, span, y, "DOP853", dense_output=True, rtol=rtol, atol=1e-14)
    return lambda r: found.sol(r)


def _disc(density: Callable[[float], float], inner: float, outer: float) -> float:
    start = max(inner, 1e-4 * outer)
    value, _ = quad(lambda r: 2.0 * np.pi * r * density(r), start, outer, epsrel=1e-9)
    return float(value)
