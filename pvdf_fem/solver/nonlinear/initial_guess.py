"""The initial guess of Newton's method if no similar film has been solved.

The tangent of a flat film without pretension is singular, so the iteration cannot start from the
flat film.
"""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import factorise


def compute_initial_guess(equilibrium: Equilibrium) -> Array:
    """Compute the deflection of a linear membrane under the loads, scaled to minimise the energy.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations, with at least one force on the flat film.

    Returns
    -------
    ndarray, shape (unknowns,)
        Unknowns of which only deflections are nonzero. If all forces act in the plane, the linear
        problem is solved for all unknowns instead.
    """
    laplace = equilibrium.assembly.matrix(equilibrium.space.laplace_matrices())
    forces = equilibrium.flat_forces
    solved = np.flatnonzero(equilibrium.unknowns.mark_deflections())
    if not forces[solved].any():
        solved = np.arange(len(forces))
    stiffness = laplace[solved][:, solved].tocsc()
    direction = np.zeros(equilibrium.unknowns.count)
    direction[solved] = factorise(stiffness).solve(forces[solved])
    # the largest factor, 1, makes the largest displacement as large as the film's radius
    direction *= equilibrium.film.radius / np.abs(direction).max()
    return _find_minimizing_factor(equilibrium, direction) * direction


def _find_minimizing_factor(
    equilibrium: Equilibrium,
    direction: Array,
    *,
    smallest: float = 1e-12,
    ratio: float = 1.1,
) -> float:
    """Find by bisection the factor up to which the energy decreases along a direction.

    The logarithm of the factor is bisected. A root finder of SciPy would need a change of sign,
    which is missing if the energy falls up to the factor 1.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations, for the residual.
    direction : ndarray, shape (unknowns,)
        Unknowns for the factor 1, the largest that is considered.
    smallest : float, optional
        Lower end of the first interval.
    ratio : float, optional
        The bisection stops if the ratio of the ends of the interval is at most this.

    Returns
    -------
    float
        Lower end of the last interval, where the energy still falls.
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
