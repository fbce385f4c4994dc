"""The film about a point load, to a small factor: what guesses and estimates are made of.

With N0 at rest, a force F makes at the distance r about the root N of

    N^2 (N - N0) = (0.24)^3 E h F^2/r^2,

which is Schwerin's point load without pretension and, to a small factor, the linear film under a
large one.
"""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.scene.film import Film


def estimate_tension(film: Film, force: float, r: float) -> float:
    """Tension in N/m that a force makes about the distance r in m."""
    rest = film.thickness * float(film.prestress[:2].mean())
    return _tension(rest, estimate_tension_cube(film, force, r))


def estimate_tension_cube(film: Film, force: float, r: float, schwerin: float = 0.24) -> float:
    """Cube in N^3/m^3 of the tension without pretension; `schwerin` is the tension over
    (E h F^2/r^2)^(1/3) for a Poisson's ratio of 1/3."""
    C = film.stiffness[:2, :2]
    modulus = float(np.linalg.det(C) / C.max())
    return schwerin**3 * modulus * film.thickness * (force / r) ** 2


def estimate_load_share(film: Film, force: float, r: float) -> float:
    """(N - N0)/N without cancellation, at most 1."""
    return (
        min(estimate_tension_cube(film, force, r) / estimate_tension(film, force, r) ** 3, 1.0)
        if force
        else 0.0
    )


def _tension(rest: float, cube: float) -> float:
    """The positive root N of N^2 (N - rest) = cube, or 0.

    Newton's method from above, where the cubic is convex, comes down monotonically.
    """
    if cube == 0.0:  # squares of the least tensions vanish, too
        return max(rest, 0.0)
    N = max(rest, 0.0) + math.cbrt(cube)
    while N > 0.0:
        lower = N - (N * N * (N - rest) - cube) / (N * (3.0 * N - 2.0 * rest))
        if lower >= N * (1.0 - 1e-9):
            break
        N = lower
    return N


def estimate_point_deflection(
    film: Film, force: float, nearest: float | None = None, reach: float | None = None
) -> float:
    """About the deflection in m at the distance `nearest` in m from a force in N.

    By default a hundredth of the film's radius; `reach` is the distance of the rim.
    """
    reach = reach or film.radius
    r = np.geomspace(nearest or 1e-2 * reach, reach, 40)
    tension = np.array([estimate_tension(film, force, x) for x in r])
    slopes = force / (2.0 * np.pi * r * tension)
    return float(np.sum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(r)))


def estimate_point_force(film: Film, deflection: float) -> float:
    """About the force in N that deflects the film's centre by `deflection` in m."""
    low, high = 1e-12, 1e12
    while high > 1.01 * low:
        force = float(np.sqrt(low * high))
        below = estimate_point_deflection(film, force) < deflection
        low, high = (force, high) if below else (low, force)
    return force
