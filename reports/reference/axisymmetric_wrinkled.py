"""Axisymmetric membrane that wrinkles: a reference for the 2-D code.

As in `axisymmetric` lengths are counted in a, forces in E h a, tensions in E h. With the
displacements u along the radius r and w along the load, and the force P(r) within the radius r,
equilibrium of a tension field is

    (r N_r (1 + u'))' = N_t (1 + u/r),    r N_r w' = -P/(2 pi)

where the hoop tension N_t is zero if the hoop is wrinkled; N_r is then that of uniaxial tension.
Outside of the load all radial lines of a wrinkled film are straight. Near the centre a film is
always taut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pvdf_fem.arrays import Array

# Radius, over that of the patch, from which integration starts with the first terms of the series
# about the centre. The error of these is of the order of the square of the radius.
CORE = 1e-4


@dataclass(frozen=True)
class WrinkledMembrane:
    """Deflected membrane that wrinkles; lengths in a, tensions in E h.

    Profiles are functions of r/a from 0 to 1.
    """

    centre_deflection: float
    _profile: Callable[[Array], tuple[Array, ...]]

    def deflection(self, radius_ratio: Array) -> Array:
        """Deflection w."""
        return self.centre_deflection + self._profile(radius_ratio)[0]

    def radial_tension(self, radius_ratio: Array) -> Array:
        """Radial tension N_r."""
        return self._profile(radius_ratio)[1]

    def hoop_tension(self, radius_ratio: Array) -> Array:
        """Hoop tension N_t, zero where the film is wrinkled."""
        return self._profile(radius_ratio)[2]


def wrinkled_membrane(
    force: float, *, poisson_ratio: float, patch_radius: float, thermal_strain: float
) -> WrinkledMembrane:
    """Clamped membrane under a vertical force on a concentric circle, by shooting.

    The hoop strain at the centre is varied until the rim does not move.

    Parameters
    ----------
    force : float
        F/(E h a), positive, spread evenly over the reference area of the patch.
    poisson_ratio : float
        Poisson's ratio of the film.
    patch_radius : float
        b/a, in (0, 1].
    thermal_strain : float
        alpha dT, positive for a film that is too large for its rim.

    Raises
    ------
    ValueError
        For a force or a patch radius out of range.
    """
    if not (force > 0 and 0 < patch_radius <= 1):
        raise ValueError(f"no force {force!r} on a patch of radius {patch_radius!r}")
    problem = _Problem(force, poisson_ratio, patch_radius, thermal_strain)
    added = force ** (2 / 3)
    while problem.rim(thermal_strain + added) > 0.0:
        added *= 0.5
    while problem.rim(thermal_strain + added) < 0.0:
        added *= 2.0
    added = brentq(lambda x: problem.rim(thermal_strain + x), added / 2, added, rtol=1e-12)
    solution = problem.integrate(thermal_strain + added)

    def profile(radius: Array) -> tuple[Array, ...]:
        r = np.maximum(radius, CORE * patch_radius)
        u, moment, w = solution(r)
        radial, hoop, _ = problem.tensions(r, u, moment)
        return w, radial, hoop

    return WrinkledMembrane(float(-solution(np.array([1.0]))[2, 0]), profile)


@dataclass(frozen=True)
class _Problem:
    """The differential equations in the logarithm of the radius."""

    force: float
    poisson_ratio: float
    patch_radius: float
    thermal_strain: float

    def rim(self, centre_strain: float) -> float:
        """Displacement u at the rim of a film with u/r = `centre_strain` at the centre."""
        return float(self.integrate(centre_strain)(np.array(1.0))[0])

    def integrate(self, centre_strain: float) -> Callable[[Array], Array]:
        """Return the functions u, r N_r (1 + u') and w - w(0) of the radius."""
        c, nu = centre_strain, self.poisson_ratio
        tension = (c + c**2 / 2 - self.thermal_strain) / (1 - nu)
        core = CORE * self.patch_radius
        deflection = -float(self._pull(core)) / (2 * tension)
        start = np.array([c * core, core * tension * (1 + c), deflection])
        ends = (core, self.patch_radius, 1.0)
        inner = self._solve_between(start, ends[:2])
        if self.patch_radius == 1.0:
            return inner
        outer = self._solve_between(inner(np.array(self.patch_radius)), ends[1:])
        return lambda r: np.where(np.less_equal(r, self.patch_radius), inner(r), outer(r))

    def _solve_between(self, start: Array, ends: tuple[float, ...]) -> Callable[[Array], Array]:
        """Return the functions between two radii, from their values at the first."""

        def rates(log_r: float, y: Array) -> list[float]:
            r = math.exp(log_r)
            radial, hoop, stretch = self.tensions(r, y[0], y[1])
            return [r * stretch, hoop * (r + y[0]), -self._pull(r) / radial]

        options = {"rtol": 1e-10, "atol": 1e-16, "dense_output": True}
        result = solve_ivp(rates, np.log(ends), start, "DOP853", **options)
        return lambda r: np.asarray(result.sol(np.log(r)))

    def _pull(self, r: Array | float) -> Array:
        """Force within a radius, P(r)/(2 pi)."""
        return self.force / (2 * math.pi) * np.minimum(np.asarray(r) / self.patch_radius, 1.0) ** 2

    def tensions(
        self, r: Array | float, u: Array | float, moment: Array | float
    ) -> tuple[Array, Array, Array]:
        """N_r, N_t and u' from u and r N_r (1 + u'), by Newton's method for u'."""
        nu, incline = self.poisson_ratio, (self._pull(r) / moment) ** 2
        hoop_strain = u / r + (u / r) ** 2 / 2 - self.thermal_strain
        stretch = np.zeros_like(incline)
        for _ in range(50):
            strain = (1 + incline) * (1 + stretch) ** 2 / 2 - 0.5 - self.thermal_strain
            taut = hoop_strain + nu * strain > 0
            modulus = np.where(taut, 1 / (1 - nu**2), 1.0)
            radial = np.where(taut, (strain + nu * hoop_strain) / (1 - nu**2), strain)
            excess = radial * (1 + stretch) - moment / r
            slope = radial + modulus * (1 + incline) * (1 + stretch) ** 2
            step = excess / slope
            stretch = stretch - step
            if np.all(np.abs(step) <= 1e-15):
                break
        hoop = np.where(taut, (hoop_strain + nu * strain) / (1 - nu**2), 0.0)
        return np.asarray(radial), hoop, np.asarray(stretch)
