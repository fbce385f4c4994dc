"""The film around a point load, to a small factor: the basis of initial guesses and estimates.

With the tension N0 of the unloaded film, a force F causes at the distance r about the root N of

    N^2 (N - N0) = (0.24)^3 E h F^2/r^2,

which is Schwerin's point load without pretension and, to a small factor, the linear film under a
large pretension.

The roots are found by a few lines of Newton's method and bisection: `scipy.optimize` takes longer
to import than many scenes take to solve.
"""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.scene.film import Film


def estimate_tension(film: Film, force: float, r: float) -> float:
    """Estimate the tension of a loaded film.

    Parameters
    ----------
    film : Film
        The film.
    force : float
        Point load in N.
    r : float
        Distance from the load in m.

    Returns
    -------
    float
        Tension in N/m.
    """
    unloaded = film.thickness * float(film.prestress[:2].mean())
    return _solve_cubic(unloaded, estimate_tension_cube(film, force, r))


def estimate_tension_cube(film: Film, force: float, r: float, schwerin: float = 0.24) -> float:
    """Estimate the cube of the tension that a film without pretension would have.

    Parameters
    ----------
    film : Film
        The film.
    force : float
        Point load in N.
    r : float
        Distance from the load in m.
    schwerin : float
        The tension over (E h F^2/r^2)^(1/3), for a Poisson's ratio of 1/3.

    Returns
    -------
    float
        Cube of the tension in N^3/m^3.
    """
    C = film.stiffness[:2, :2]
    modulus = float(np.linalg.det(C) / C.max())
    return schwerin**3 * modulus * film.thickness * (force / r) ** 2


def estimate_load_fraction(film: Film, force: float, r: float) -> float:
    """Estimate the share of the tension that is due to the load, (N - N0)/N.

    Parameters
    ----------
    film : Film
        The film.
    force : float
        Point load in N.
    r : float
        Distance from the load in m.

    Returns
    -------
    float
        From 0 to 1, computed without cancellation.
    """
    if not force:
        return 0.0
    tension = estimate_tension(film, force, r)
    return min(estimate_tension_cube(film, force, r) / tension**3, 1.0)


def _solve_cubic(unloaded: float, cube: float) -> float:
    """Return the positive root N of N^2 (N - unloaded) = cube, or 0.

    Newton's method starts above the root, where the cubic is convex, and comes down monotonically.
    """
    if cube == 0.0:  # the squares of the least tensions would vanish, too
        return max(unloaded, 0.0)
    N = max(unloaded, 0.0) + math.cbrt(cube)
    while N > 0.0:
        slope = N * (3.0 * N - 2.0 * unloaded)
        lower = N - (N * N * (N - unloaded) - cube) / slope
        if lower >= N * (1.0 - 1e-9):
            break
        N = lower
    return N


def estimate_point_deflection(
    film: Film, force: float, nearest: float | None = None, reach: float | None = None
) -> float:
    """Estimate the deflection near a point load at the film's centre.

    Parameters
    ----------
    film : Film
        The film.
    force : float
        Point load in N.
    nearest : float, optional
        Distance from the load in m at which the film is deflected; by default a hundredth of the
        rim's distance.
    reach : float, optional
        Distance of the rim in m; by default the film's radius.

    Returns
    -------
    float
        Deflection in m: the integral of the slope F/(2π r N) from the rim.
    """
    reach = reach or film.radius
    r = np.geomspace(nearest or 1e-2 * reach, reach, 40)
    tension = np.array([estimate_tension(film, force, distance) for distance in r])
    slopes = force / (2.0 * np.pi * r * tension)
    return float(np.sum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(r)))


def estimate_point_force(film: Film, deflection: float) -> float:
    """Estimate the force in N that deflects the film's centre by `deflection` in m.

    It is exact to a hundredth, which is enough for an initial guess.
    """
    low, high = 1e-12, 1e12
    force = 1.0
    while high > 1.01 * low:
        force = float(np.sqrt(low * high))
        if estimate_point_deflection(film, force) < deflection:
            low = force
        else:
            high = force
    return force
