"""Closed-form reference solutions of the clamped circular membrane.

The linear solutions are in SI. Those of the Foeppl-von Karman (FvK) equations are scale-free,
with radius a, Young's modulus E and thickness h, and counted in the load:

======================  =============================  ===========================
                        uniform pressure p             point load F
======================  =============================  ===========================
deflection              a (p a/(E h))^(1/3)            (F a^2/(E h))^(1/3)
tension, pretension     (E h p^2 a^2)^(1/3)            (E h F^2/a^2)^(1/3)
======================  =============================  ===========================

FvK strains hold for small slopes: at a slope of 0.1 they are off by 5e-5 in the centre deflection
and by 0.2 to 0.4 % in the tension there. `axisymmetric` solves for either kind of strain.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import jn_zeros

from pvdf_fem.arrays import Array


@dataclass(frozen=True)
class PressurisedMembrane:
    """FvK membrane under uniform dead pressure, scaled with the pressure (see the module)."""

    #: W0 = w0/(a (p a/(E h))^(1/3)).
    centre_deflection: float
    #: centre_tension, edge_tension: Radial tension at the centre and at the rim, in (E h p^2
    #: a^2)^(1/3).
    centre_tension: float
    edge_tension: float

    def deflection(self, radius_ratio: ArrayLike) -> Array:
        """Deflection at r/a (any shape), in a (p a/(E h))^(1/3)."""
        inverse = polynomial.polyint(_pressure_series()[1])
        return np.asarray(
            self.centre_deflection
            - polynomial.polyval(self._argument(radius_ratio), inverse) * 8 * self.centre_tension**2
        )

    def radial_tension(self, radius_ratio: ArrayLike) -> Array:
        """Radial tension at r/a (any shape), in (E h p^2 a^2)^(1/3)."""
        series = _pressure_series()[0]
        return np.asarray(
            self.centre_tension * polynomial.polyval(self._argument(radius_ratio), series)
        )

    def _argument(self, radius_ratio: ArrayLike) -> Array:
        return np.asarray(np.square(radius_ratio) / (32 * self.centre_tension**3))


@cache
def _pressure_series(terms: int = 100) -> tuple[Array, Array]:
    """Taylor coefficients of f and 1/f, where f^2 (z f'' + 2 f') = -1 and f(0) = 1.

    With the tension N = y0 f(z) and z = (r/a)^2/(32 y0^3), the differential equation is that of the
    pressurised membrane. All coefficients of 1/f are positive, so that no terms of its sums cancel.
    """
    f, inverse = np.zeros(terms), np.zeros(terms)
    f[0] = inverse[0] = 1.0
    for k in range(terms - 1):
        f[k + 1] = -(inverse[: k + 1] @ inverse[k::-1]) / ((k + 1) * (k + 2))
        inverse[k + 1] = -(f[1 : k + 2] @ inverse[k::-1])
    return f, inverse


def hencky(poisson_ratio: float) -> PressurisedMembrane:
    """Membrane without pretension under uniform dead pressure, to about 14 digits.

    Source: H. Hencky, Z. Math. Phys. 63 (1915) 311-317, whose power series is summed here to
    convergence. Meaningful for small slopes, (p a/(E h))^(1/3) << 1.

    Parameters
    ----------
    poisson_ratio : float
        From 0 to below 1.
    """
    return campbell(0.0, poisson_ratio)


def campbell(pretension: float, poisson_ratio: float) -> PressurisedMembrane:
    """Membrane with pretension under uniform dead pressure, to about 14 digits.

    Source: J. D. Campbell, Q. J. Mech. Appl. Math. 9 (1956) 84-93. Meaningful for small slopes
    and any n0; W0 tends to the linear 1/(4 n0) for large n0, and to Hencky's for n0 = 0.

    Parameters
    ----------
    pretension : float
        n0 = N0/(E h p^2 a^2)^(1/3), not negative.
    poisson_ratio : float
        From 0 to below 1.
    """
    require_taut(pretension, poisson_ratio)
    f, inverse = _pressure_series()
    slope = polynomial.polyder(f)

    def clamp(z: float) -> float:
        """Rim condition N_t - nu N = (1 - nu) N0, divided by the tension at the centre."""
        surplus = polynomial.polyval(z, f) - pretension * (32 * z) ** (1 / 3)
        return float((1 - poisson_ratio) * surplus + 2 * z * polynomial.polyval(z, slope))

    # For nu >= 0 the rim lies at z below 0.55 (the series converge up to 0.94), and the tension at
    # the centre is above N0.
    z = _root(clamp, 0.0, min(0.55, 1 / (32 * pretension**3)) if pretension else 0.55)
    y0 = (32 * z) ** (-1 / 3)
    return PressurisedMembrane(
        centre_deflection=float(polynomial.polyval(z, polynomial.polyint(inverse)) * 8 * y0**2),
        centre_tension=y0,
        edge_tension=float(y0 * polynomial.polyval(z, f)),
    )


@dataclass(frozen=True)
class PointLoadedMembrane:
    """FvK membrane under a central point load, scaled with the load (see the module)."""

    #: W0 = w0/(F a^2/(E h))^(1/3).
    centre_deflection: float
    #: Radial tension at the rim, in (E h F^2/a^2)^(1/3).
    edge_tension: float


def schwerin(pretension: float, poisson_ratio: float) -> PointLoadedMembrane:
    """Membrane with pretension under a dead point load at its centre.

    Source: E. Schwerin, Z. techn. Phys. (1929). With x = (r/a)^2 and Y = x N, equilibrium is
    Y'' = -c/(4 Y^2), c = 1/(8 pi^2): a fall into a centre, Y ~ sinh^2, x ~ sinh cosh - identity,
    or the same with sin. Both branches are one analytic function of theta^2, which is negative on
    the second; nu = 1/3 without pretension is theta = 0, w = w0 (1 - (r/a)^(2/3)).
    Meaningful for small slopes only, thus away from the load, where the slope is infinite.

    Parameters
    ----------
    pretension : float
        n0 = N0/(E h F^2/a^2)^(1/3), not negative.
    poisson_ratio : float
        From 0 to below 1.
    """
    require_taut(pretension, poisson_ratio)

    def edge(square: float) -> tuple[float, float, float]:
        """k/theta, radial tension and rim strain (N_t - nu N) for theta^2 = square."""
        sine, cosine, lag = _fall(square)
        k = (lag / (16 * math.pi**2)) ** (1 / 3)
        tension = (sine / k) ** 2 / (16 * math.pi**2)
        return k, tension, 2 * k * cosine / sine - (1 + poisson_ratio) * tension

    def clamp(square: float) -> float:
        return edge(square)[2] - (1 - poisson_ratio) * pretension

    # n0 grows with theta^2; at theta = 3.1 on the branch of the sine it is negative for nu >= 0.
    upper = 4.0
    while clamp(upper) < 0:
        upper *= 2
    k, tension, _ = edge(_root(clamp, -(3.1**2), upper))
    return PointLoadedMembrane(centre_deflection=1 / (2 * math.pi * k), edge_tension=tension)


def _fall(square: float) -> tuple[float, float, float]:
    """sinh(t)/t, cosh(t) and (sinh(t) cosh(t) - t)/t^3 as functions of t^2, of either sign."""
    t = math.sqrt(abs(square))
    if abs(square) < 1:  # the terms of the third's closed form cancel here
        lag = sum(4 * (4 * square) ** k / math.factorial(2 * k + 3) for k in range(16))
        sine = sum(square**k / math.factorial(2 * k + 1) for k in range(12))
        return sine, math.cosh(t) if square >= 0 else math.cos(t), lag
    if square > 0:
        return math.sinh(t) / t, math.cosh(t), (math.sinh(2 * t) / 2 - t) / t**3
    return math.sin(t) / t, math.cos(t), (t - math.sin(2 * t) / 2) / t**3


def linear_patch_deflection(
    points: ArrayLike,
    *,
    centre: ArrayLike,
    patch_radius: float,
    film_radius: float,
    force: float,
    tension: float,
) -> Array:
    """Deflection of a tight membrane under uniform pressure on a circle anywhere in it.

    Green's function of the disc by Kelvin's image in the rim, averaged over the patch: with
    z = x + i y, w = F/(2 pi N) ln|(a^2 - z conj(z0))/(a (z - z0))| outside of the patch; within,
    the potential of the patch itself becomes a parabola and the image's, harmonic, stays.
    Meaningful as long as the deflection adds little tension, (F/(E h a))^(2/3) << N/(E h).

    Parameters
    ----------
    points : array_like, shape (..., 2)
        Points within the film.
    centre : array_like, shape (2,)
        Centre of the patch.
    patch_radius, film_radius : float
        Radii in the unit of `points`, say m.
    force, tension : float
        F and N in units whose quotient is the unit of the deflection, say N and N/m for metres.

    Returns
    -------
    ndarray, shape (...)

    Raises
    ------
    ValueError
        For shapes or values out of range, or a patch that sticks out of the film.
    """
    x = np.asarray(points, dtype=float)
    x0 = np.asarray(centre, dtype=float)
    if x.shape[-1:] != (2,) or x0.shape != (2,):
        raise ValueError(
            f"points must have shape (..., 2) and centre (2,), got {x.shape} and {x0.shape}"
        )
    reach = float(np.hypot(*x0)) + patch_radius
    if not (patch_radius > 0 and reach <= film_radius * (1 + 1e-12)):
        raise ValueError(f"patch must lie within {film_radius!r}, it reaches out to {reach!r}")
    if not tension > 0:
        raise ValueError(f"tension must be positive, got {tension!r}")
    z, z0 = x @ [1, 1j], x0 @ [1, 1j]
    distance = np.abs(z - z0) / patch_radius
    patch = np.where(distance < 1, (1 - distance**2) / 2, -np.log(np.maximum(distance, 1)))
    image = np.log(np.abs(film_radius**2 - z * z0.conjugate()) / (film_radius * patch_radius))
    return np.asarray(force / (2 * math.pi * tension) * (patch + image))


def disc_frequencies(count: int, *, radius: float, tension: float, areal_density: float) -> Array:
    """Lowest frequencies (Hz) of a stretched disc, j_mn/(2 pi a) sqrt(N/(rho h)).

    Modes with m > 0 nodal diameters come in pairs, which are listed twice. Source: Lord Rayleigh,
    Theory of Sound, chapter IX. Meaningful for small amplitudes, without bending, without the air
    that moves along.

    Parameters
    ----------
    count : int
        Number of frequencies.
    radius, tension, areal_density : float
        m, N/m, kg/m^2.

    Returns
    -------
    ndarray, shape (count,)
        Ascending.
    """
    # j_m1 > m and j_0n > n: the lowest `count` are among the first `count` of either number.
    zeros = [jn_zeros(m, count) for m in range(count)]
    all_zeros = np.sort(np.concatenate([*zeros, *zeros[1:]]))[:count]
    return np.asarray(all_zeros / (2 * math.pi * radius) * math.sqrt(tension / areal_density))


def require_taut(pretension: float, poisson_ratio: float) -> None:
    """Raise `ValueError` for a film that none of the reference solutions describes."""
    if not 0 <= poisson_ratio < 1:
        raise ValueError(f"poisson_ratio must lie in [0, 1), got {poisson_ratio!r}")
    if not (math.isfinite(pretension) and pretension >= 0):
        raise ValueError(
            f"pretension must be finite and not negative, got {pretension!r}: "
            "a slack membrane wrinkles, which none of these solutions describes"
        )


def _root(function: Callable[[float], float], lower: float, upper: float) -> float:
    """Root to the last digits, even if it is many orders smaller than the bracket."""
    return float(brentq(function, lower, upper, xtol=1e-300, rtol=1e-15))
