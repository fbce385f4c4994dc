"""Where Newton's method starts: a displacement near the solution.

A flat film without pretension has a singular tangent, so the first iterate is not the flat film.
"""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.newton import factorise


def compute_initial_guess(equilibrium: Equilibrium) -> Array:
    """Unknowns of the linear membrane's deflection alone, scaled to the least energy: where the
    energy stops falling is bisected. Forces in the plane alone displace the film in its plane."""
    laplace = equilibrium.assembly.matrix(equilibrium.space.laplace())
    q, forces = np.zeros(equilibrium.unknowns.count), equilibrium.flat_forces
    moving = np.flatnonzero(equilibrium.unknowns.deflections())
    if not forces[moving].any():
        moving = np.arange(len(q))
    q[moving] = factorise(laplace[moving][:, moving].tocsc()).solve(forces[moving])
    q *= equilibrium.film.radius / np.abs(q).max()
    low, high = 1e-12, 1.0
    while high > 1.1 * low:
        middle = np.sqrt(low * high)
        rises = equilibrium.residual(equilibrium.state(middle * q)) @ q > 0.0
        low, high = (low, middle) if rises else (middle, high)
    return low * q
