"""Estimates of the film under a point load, for initial guesses and the sizes of effects.

At the distance r from a force F, the tension N of a film is about the positive root of::

    N^2 (N - N0) = (0.24)^3 E h F^2/r^2

with the tension N0 of the unloaded film, Young's modulus E and the thickness h. Without pretension
this is Schwerin's solution for a point load; for a large pretension it agrees with the linear film
up to a factor near 1.

Newton's method and bisection are written out here, because the import of `scipy.optimize` takes
longer than the solve of many scenes.
"""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.scene.film import Film


def estimate_tension(film: Film, force: float, r: float) -> float:
    """Estimate the tension of a film under a point load.

    Parameters
    ----------
    film : Film
        Film with its thickness, stiffness and prestress.
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


def estimate_backed_tension(
    film: Film, force: float, r: float, backing: float, iterations: int = 20
) -> float:
    """Estimate the tension of a film on an elastic backing under a point load.

    Parameters
    ----------
    film : Film
        Film with its thickness, stiffness and prestress.
    force : float
        Point load in N.
    r : float
        Distance from the load in m.
    backing : float
        Stiffness of the backing in N/m³; 0 without one.
    iterations : int, optional
        Number of iterations, in which the tension decreases.

    Returns
    -------
    float
        Tension in N/m.

    Notes
    -----
    On a backing of the stiffness k, a film with the tension N transmits the fraction x K1(x) of the
    force beyond the distance r, with x = r sqrt(k/N). It is replaced by sqrt(1 + pi x/2) exp(-x),
    which differs by less than 3 % of the force.
    """
    tension = estimate_tension(film, force, r)
    if not backing:
        return tension
    for _ in range(iterations):
        if tension <= 0.0:
            break
        x = r * math.sqrt(backing / tension)
        fraction = math.sqrt(1.0 + 0.5 * math.pi * x) * math.exp(-x)
        tension = estimate_tension(film, fraction * force, r)
    return tension


def estimate_tension_cube(film: Film, force: float, r: float, schwerin: float = 0.24) -> float:
    """Estimate the cube of the tension under a point load in a film without pretension.

    Parameters
    ----------
    film : Film
        Film with its thickness, stiffness and prestress.
    force : float
        Point load in N.
    r : float
        Distance from the load in m.
    schwerin : float
        Schwerin's factor: the tension divided by (E h F^2/r^2)^(1/3), for a Poisson's ratio of
        1/3.

    Returns
    -------
    float
        Cube of the tension in N^3/m^3.
    """
    C = film.stiffness[:2, :2]
    modulus = float(np.linalg.det(C) / C.max())
    return schwerin**3 * modulus * film.thickness * (force / r) ** 2


def estimate_load_fraction(film: Film, force: float, r: float) -> float:
    """Estimate the fraction of the tension that is due to a point load, (N - N0)/N.

    Parameters
    ----------
    film : Film
        Film with its thickness, stiffness and prestress.
    force : float
        Point load in N.
    r : float
        Distance from the load in m.

    Returns
    -------
    float
        From 0 to 1; computed without the cancellation in N - N0. Without a force it is 0.
    """
    if not force:
        return 0.0
    tension = estimate_tension(film, force, r)
    return min(estimate_tension_cube(film, force, r) / tension**3, 1.0)


def _solve_cubic(unloaded: float, cube: float) -> float:
    """Return the positive root N of N^2 (N - unloaded) = cube, or 0 if there is none.

    Newton's method starts above the root, where the cubic is convex, so that its iterates decrease
    monotonically towards the root.
    """
    if cube == 0.0:  # the iteration would divide by zero where N squared underflows
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
    film: Film, force: float, distance: float | None = None, rim_distance: float | None = None
) -> float:
    """Estimate the deflection of the film at a distance from a point load.

    Parameters
    ----------
    film : Film
        Film with its thickness, stiffness and prestress.
    force : float
        Point load in N.
    distance : float, optional
        Distance from the load in m at which the deflection is estimated; by default a hundredth of
        `rim_distance`.
    rim_distance : float, optional
        Distance from the load to the rim in m; by default the film's radius, for a load at its
        centre.

    Returns
    -------
    float
        Deflection in m: the slope F/(2π r N), integrated from the rim.
    """
    if not rim_distance:
        rim_distance = film.radius
    if not distance:
        distance = 1e-2 * rim_distance
    radii = np.geomspace(distance, rim_distance, 40)
    tension = np.array([estimate_tension(film, force, r) for r in radii])
    slopes = force / (2.0 * np.pi * radii * tension)
    mean_slopes = 0.5 * (slopes[1:] + slopes[:-1])
    return float(np.sum(mean_slopes * np.diff(radii)))


def estimate_point_force(film: Film, deflection: float) -> float:
    """Estimate the point load in N at the film's centre that causes a `deflection` in m.

    The deflection is that of `estimate_point_deflection`. The bisection, between 1e-12 and 1e12 N,
    ends at a relative accuracy of 1 %, which is enough for an initial guess.
    """
    low = 1e-12
    high = 1e12
    force = 1.0
    while high > 1.01 * low:
        force = float(np.sqrt(low * high))
        if estimate_point_deflection(film, force) < deflection:
            low = force
        else:
            high = force
    return force
