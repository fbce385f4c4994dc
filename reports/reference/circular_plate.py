"""Reference solutions of the clamped circular plate under a uniform load on a concentric disc.

Lengths are counted in the film's radius a. Stiffness D, tension N and force F are in any units in
which F/N or F a^2/D is a length, say N m, N/m and N.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_bvp
from scipy.special import ive, kve

from pvdf_fem.arrays import Array


def clamped_plate_deflection(patch_radius: float = 0.0) -> float:
    """Deflection of the centre in F a^2/D without tension.

    It is 1/(16 pi) for a point force and 1/(64 pi) for a load on the whole plate.

    Source: Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells (2nd ed.), section 19.

    Parameters
    ----------
    patch_radius : float
        Radius of the loaded disc over a, from 0 (a point force) to 1.
    """
    b = _require_in_film(patch_radius)
    logarithm = 4.0 * b**2 * math.log(b) if b > 0.0 else 0.0
    return (4.0 + logarithm - 3.0 * b**2) / (64.0 * math.pi)


def stretched_plate_deflection(
    radius_ratio: ArrayLike, *, patch_radius: float, bending_length: float
) -> Array:
    """Deflection in F/N of a plate under a tension N that the load does not change.

    The equation is D laplace laplace w - N laplace w = p. With l = sqrt(D/N), w is a sum of 1,
    ln r, I0(r/l) and K0(r/l) outside of the load, and of 1, r^2 and I0(r/l) within; w and its
    first two derivatives are continuous. The shear force is continuous too, since the factor
    -F/(2 pi N) of the logarithm bears the load.

    Parameters
    ----------
    radius_ratio : array_like
        r/a, of any shape.
    patch_radius : float
        b/a, in (0, 1).
    bending_length : float
        l/a, positive.
    """
    b, k = _require_in_film(patch_radius), 1.0 / bending_length
    if not (0.0 < b < 1.0 and bending_length > 0.0):
        raise ValueError(
            "patch_radius must lie in (0, 1) and bending_length be positive,"
            f" got {patch_radius!r} and {bending_length!r}"
        )

    edge, rim, constant = np.array(b), np.array(1.0), np.array([1.0, 0.0, 0.0])
    logarithm = -np.array([[math.log(b), 1.0 / b, -1.0 / b**2], [0.0, 1.0, -1.0]]) / (2.0 * math.pi)
    parabola = -np.array([b**2, 2.0 * b, 2.0]) / (4.0 * math.pi * b**2)
    # the unknowns are the factors of 1 and I0 within, and of 1, I0 and K0 outside
    inner = [constant, _growing(k, edge, b)]
    outer = [constant, _growing(k, edge, 1.0), _decaying(k, edge, b)]
    jump = np.column_stack([*(-function for function in inner), *outer])
    at_rim = [constant, _growing(k, rim, 1.0), _decaying(k, rim, b)]
    clamp = np.column_stack([np.zeros((3, 2)), *at_rim])
    matrix = np.vstack([jump, clamp[:2]])
    right = np.concatenate([parabola - logarithm[0], -logarithm[1, :2]])
    inner_1, inner_I, outer_1, outer_I, outer_K = np.linalg.solve(matrix, right)

    r = np.asarray(radius_ratio, dtype=float)
    inside, outside = np.minimum(r, b), np.maximum(r, b)
    within = inner_1 - inside**2 / (4.0 * math.pi * b**2) + inner_I * _growing(k, inside, b)[0]
    beyond = outer_1 - np.log(outside) / (2.0 * math.pi)
    beyond += outer_I * _growing(k, outside, 1.0)[0] + outer_K * _decaying(k, outside, b)[0]
    return np.where(r < b, within, beyond)


def _growing(k: float, r: Array, scale: float) -> Array:
    """I0(k r)/I0(k scale) with two derivatives by r, (3, ...)."""
    i0, i1 = (ive(n, k * r) / ive(0, k * scale) * np.exp(k * (r - scale)) for n in (0, 1))
    return np.array([i0, k * i1, k**2 * i0 - k * i1 / np.where(r > 0, r, 1.0)])


def _decaying(k: float, r: Array, scale: float) -> Array:
    """K0(k r)/K0(k scale) with two derivatives by r, (3, ...)."""
    k0, k1 = (kve(n, k * r) / kve(0, k * scale) * np.exp(k * (scale - r)) for n in (0, 1))
    return np.array([k0, -k * k1, k**2 * k0 + k * k1 / r])


class Plate(NamedTuple):
    """A plate at large deflection: w0/h at the centre, and N_r, N_t in D/a^2 at radii r/a."""

    deflection: float
    tensions: Callable[[ArrayLike], tuple[Array, Array]]


def von_karman_plate(pressure: float, *, poisson_ratio: float, pretension: float = 0.0) -> Plate:
    """Large deflection and tensions of a clamped plate under a uniform pressure.

    With r in a, w in h, N in D/a^2 and phi = dw/dr (von Karman 1910)::

        (phi' + phi/r)' = P r/2 + N phi,        P = p a^4/(D h)
        r^2 N'' + 3 r N' + 6 (1 - nu^2) phi^2 = 0

    phi = 0 and (r N)' - nu N = (1 - nu) N0 on the rim. Solved by collocation to about 9 digits;
    S. Way's series (Trans. ASME 56, 1934, 627-636) is a solution of the same equations.

    Parameters
    ----------
    pressure : float
        P, positive, up to 1e4; thinner boundary layers need other methods.
    poisson_ratio : float
        Poisson's ratio of the plate.
    pretension : float
        N0 a^2/D.

    Raises
    ------
    RuntimeError
        When the collocation does not converge.
    """
    factor = 6.0 * (1.0 - poisson_ratio**2)
    # the unknowns are psi = phi/r, kappa = phi' + phi/r, N and N'; `singular` is divided by r
    singular = np.zeros((4, 4))
    singular[0, :2], singular[3, 3] = (-2.0, 1.0), -3.0

    def equations(r: Array, y: Array) -> Array:
        psi, _, N, slope = y
        return np.array([0 * r, (0.5 * pressure + N * psi) * r, slope, -factor * psi**2])

    def ends(axis: Array, rim: Array) -> Array:
        clamp = rim[3] + (1.0 - poisson_ratio) * (rim[2] - pretension)
        return np.array([axis[1] - 2.0 * axis[0], axis[3], rim[0], clamp])

    # start with the deflection size (1 - r^2)^2 that bending or stretching alone would allow
    size = min(pressure / 64.0, float(np.cbrt(pressure)) / 3.0)
    r = np.linspace(0.0, 1.0, 100)
    start = np.array(
        [
            4.0 * size * (r**2 - 1.0),
            8.0 * size * (2.0 * r**2 - 1.0),
            pretension + size**2 + 0 * r,
            0 * r,
        ]
    )
    result = solve_bvp(equations, ends, r, start, S=singular, tol=1e-9, max_nodes=100_000)
    if not result.success:
        raise RuntimeError(f"von Karman plate at P = {pressure:g}: {result.message}")
    points, weights = np.polynomial.legendre.leggauss(200)
    points = 0.5 * (points + 1.0)
    deflection = -0.5 * float((weights * points * result.sol(points)[0]).sum())

    def tensions(radius_ratio: ArrayLike) -> tuple[Array, Array]:
        r = np.asarray(radius_ratio, dtype=float)
        _, _, tension, slope = result.sol(r)
        return tension, tension + r * slope

    return Plate(deflection, tensions)


def _require_in_film(patch_radius: float) -> float:
    """Return the radius; `ValueError` for a patch that is not in the film."""
    if not 0.0 <= patch_radius <= 1.0:
        raise ValueError(f"patch_radius must lie in [0, 1], got {patch_radius!r}")
    return patch_radius
