"""The initial guess of Newton's method where no similar film has been solved.

The tangent of a flat film without pretension is singular, so that the first iterate must not be the
flat film.
"""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import factorise


def compute_initial_guess(equilibrium: Equilibrium) -> Array:
    """Compute the deflection of a linear membrane under the loads, scaled to the least energy.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations.

    Returns
    -------
    ndarray, shape (unknowns,)
        The unknowns. Only deflections are nonzero, unless all forces are in the plane: then they
        displace the film in its plane.
    """
    laplace = equilibrium.assembly.matrix(equilibrium.space.laplace_matrices())
    forces = equilibrium.flat_forces
    moving = np.flatnonzero(equilibrium.unknowns.mark_deflections())
    if not forces[moving].any():
        moving = np.arange(len(forces))
    stiffness = laplace[moving][:, moving].tocsc()
    direction = np.zeros(equilibrium.unknowns.count)
    direction[moving] = factorise(stiffness).solve(forces[moving])
    direction *= equilibrium.film.radius / np.abs(direction).max()
    return _find_least_energy_factor(equilibrium, direction) * direction


def _find_least_energy_factor(
    equilibrium: Equilibrium,
    direction: Array,
    *,
    smallest: float = 1e-12,
    ratio: float = 1.1,
) -> float:
    """Find the factor on a direction up to which the energy falls, by bisection of its logarithm.

    A root finder of SciPy would need a change of sign, which is missing where the energy falls up
    to the factor 1, would evaluate both ends in addition, and its package is slow to import.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations.
    direction : ndarray, shape (unknowns,)
        The direction.
    smallest : float, optional
        Smallest factor; the largest is 1.
    ratio : float, optional
        Ratio of the ends of the interval at which the bisection stops.

    Returns
    -------
    float
        The lower end of the interval.
    """
    low = smallest
    high = 1.0
    while high > ratio * low:
        middle = np.sqrt(low * high)
        residual = equilibrium.residual(equilibrium.state(middle * direction))
        if residual @ direction > 0.0:  # the energy rises
            high = middle
        else:
            low = middle
    return float(low)
