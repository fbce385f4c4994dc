"""Where Newton's method starts: a displacement near the solution.

A flat film without pretension has a singular tangent, so the first iterate is not the flat film.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import IDENTITY, strain_of, strain_rate
from pvdf_fem.solvers.newton import factorise, least_energy


def seed(equilibrium: Equilibrium) -> Array:
    """Unknowns near the solution of a film that carries compression. The linear membrane is solved
    under an estimate of the tension that the load itself makes, then the in-plane equations at that
    deflection; the result is scaled to the least energy."""
    film, membrane = equilibrium.film, equilibrium.membrane
    q = np.zeros(equilibrium.unknowns.count)
    forces = equilibrium.flat_forces
    if not forces.any():
        return q
    deflections = np.flatnonzero(equilibrium.unknowns.deflections())
    in_plane = np.flatnonzero(~equilibrium.unknowns.deflections())
    flat = membrane.state(np.zeros(equilibrium.space.dof_count))
    tangent = equilibrium.sparse_tangent(flat)
    factors = factorise(tangent[in_plane][:, in_plane].tocsc())
    moved = factors.solve(forces[in_plane])  # by oblique loads and uneven stress
    if not forces[deflections].any():
        q[in_plane] = moved
        return q

    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    induced = 0.3 * np.cbrt(stiffness * (equilibrium.force / film.radius) ** 2)
    tension = induced + max(film.thickness * film.stress_at_rest[:2].mean(), 0.0)
    assembly = equilibrium.assembly
    stretched = assembly.matrix(equilibrium.space.laplace() * tension)
    q[deflections] = _solve_block(equilibrium.with_coupled(stretched, flat), forces, deflections)
    residual = equilibrium.residual(equilibrium.state(q)) + forces
    q[in_plane] = -factors.solve(residual[in_plane])
    length = least_energy(_energy_of_scaled(equilibrium, q, deflections, forces))
    q[deflections] *= length
    q[in_plane] = q[in_plane] * length**2 + moved
    return q


def deflected_film(equilibrium: Equilibrium) -> Array:
    """Unknowns of the linear membrane's deflection alone, scaled to the least energy. For a film
    that wrinkles, whose energy is no polynomial: where it stops falling is bisected."""
    laplace = equilibrium.assembly.matrix(equilibrium.space.laplace())
    q, forces = np.zeros(equilibrium.unknowns.count), equilibrium.flat_forces
    moving = np.flatnonzero(equilibrium.unknowns.deflections())
    if not forces[moving].any():  # all forces are in the plane
        moving = np.arange(len(q))
    q[moving] = _solve_block(laplace, forces, moving)
    q *= equilibrium.film.radius / np.abs(q).max()
    low, high = 1e-12, 1.0
    while high > 1.1 * low:
        middle = np.sqrt(low * high)
        rises = equilibrium.residual(equilibrium.state(middle * q)) @ q > 0.0
        low, high = (low, middle) if rises else (middle, high)
    return low * q


def _solve_block(matrix: sp.csc_matrix, right: Array, block: Indices) -> Array:
    return factorise(matrix[block][:, block].tocsc()).solve(right[block])


def _energy_of_scaled(
    equilibrium: Equilibrium, q: Array, deflections: Indices, forces: Array
) -> Array:
    """Föppl-von Kármán energy of (s^2 u, s^2 v, s w), coefficients (5,) of 1, s, ... s^4."""
    membrane, film = equilibrium.membrane, equilibrium.film
    w = np.zeros_like(q)
    w[deflections] = q[deflections]
    x = equilibrium.unknowns.expand(w)
    bent = equilibrium.with_coupled(sp.csc_matrix((len(q), len(q))), equilibrium.state(0.0 * q))
    in_plane = equilibrium.space.gradient(equilibrium.unknowns.expand(q - w))
    strain = strain_rate(IDENTITY, in_plane) + strain_of(equilibrium.space.gradient(x))
    weighted = strain * membrane.volumes[..., None]
    stress = strain @ film.stiffness
    work = float(forces @ w)
    quadratic = float((weighted @ film.stress_at_rest).sum()) + 0.5 * float(w @ (bent @ w))
    return np.array([0.0, -work, quadratic, 0.0, 0.5 * float((stress * weighted).sum())])
