"""Air that moves with the film: its added mass, and the sound that a film in a baffle radiates.

The added mass is that of incompressible air around a flat disc. For a plane in air whose deflection
is w with the wavenumber |k|, the pressure difference between both sides is 2 rho w''/|k|, with the
density rho of air and time derivatives w', w''. In a rigid baffle (Rayleigh's integral), w vanishes
outside of the disc, and the kinetic energy is rho <w', w'/|k|>. Without a baffle, the pressure
difference vanishes outside of the disc, and the energy is rho <w', D^-1 w'>, where D is |k|
restricted to functions that vanish outside. On the unit disc with polar coordinates r, t, let
s = -1/2 with a baffle and s = 1/2 without. Then (Dyda, Kuznetsov and Kwasnicki, Constructive
Approximation 46 (2017) 311-335)

    |k|^2s (1 - r^2)^s phi_mn = lambda_mn phi_mn,   phi_mn = r^m cos(m t) P_n^(s, m)(2 r^2 - 1),
    lambda_mn = 2^2s Gamma(1 + s + n) Gamma(1 + s + m + n)/(n! (m + n)!),

with the Jacobi polynomials P_n, and likewise for sin(m t). The phi_mn are orthogonal with the
weight (1 - r^2)^s, so that both energies are sums of squares of the coefficients of w'. Therefore
the added mass is a product R R^T, where R has a column for each function.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.special import eval_jacobi, poch

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.scene.air import Air

SOUND_SPEED = 343.2  #: Speed of sound in air at 20 degrees Celsius, in m/s.
MAX_QUADRATURE_ORDER = 19  #: Highest quadrature order of scikit-fem.


@dataclass(frozen=True, eq=False)
class AirLoad:
    """Added mass and sound radiation of the air on both sides of a film, for its unknowns."""

    #: R of the added mass R R^T in kg^(1/2), shape (unknowns, functions).
    root: Array
    #: Volume v displaced per unit of each unknown, in m^2, shape (unknowns,).
    volume: Array
    #: Coefficient r of the radiation resistance r omega^2 v v^T, in kg s/m^4. It is that of a point
    #: source on each side of a baffle, the leading order in radius/wavelength. It is 0 without a
    #: baffle, where the sound of both sides cancels to this order.
    radiation: float

    @classmethod
    def from_equilibrium(cls, equilibrium: Equilibrium) -> AirLoad:
        """Compute the air load of a film.

        The functions phi_mn are used up to the degree m + 2 n that the largest element resolves.
        Without air in the scene, `root` and `radiation` are zero, but `volume` is not.

        Parameters
        ----------
        equilibrium : Equilibrium
            Equations of the film, with its mesh and unknowns.
        """
        scene = equilibrium.scene
        space = equilibrium.space
        air = scene.air or Air(density_kg_m3=0.0)
        radius = scene.film.radius
        largest_size = np.sqrt(2.0 * space.weights.sum(axis=1).max()) / radius
        degree = 10 + int(1.5 / largest_size) if scene.air else 0
        order = int(min(8.0 + degree * largest_size, float(MAX_QUADRATURE_ORDER)))
        every_element = np.arange(space.mesh.nelements)
        points, values, weights = space.make_quadrature(every_element, order)

        # The matrix `integrate` maps the values of a function at the quadrature points to its
        # integrals over the film, weighted with the deflection per unit of each unknown.
        columns_of_points = np.repeat(np.arange(weights.size), values.shape[2])
        nodes = np.repeat(space.nodes, weights.shape[1], axis=0).ravel()
        entries = (values * weights[..., None]).ravel()
        by_node = sp.csr_matrix(
            (entries, (nodes, columns_of_points)), (space.basis.N, weights.size)
        )
        integrate = equilibrium.unknowns.expansion[2::3].T @ by_node

        s = -0.5 if air.baffle else 0.5
        unit_points = points.reshape(-1, 2) / radius
        # With a baffle, the deflection w is expanded in (1 - r^2)^s phi_mn, and its coefficients
        # are integrals of w phi_mn. Without one, it is expanded in phi_mn, and the coefficients are
        # integrals of w (1 - r^2)^s phi_mn.
        rim_weight = np.maximum(1.0 - (unit_points**2).sum(axis=1), 0.0) ** max(s, 0.0)
        columns = []
        for functions in _evaluate_functions(unit_points, degree, s):
            columns.append(integrate @ (rim_weight[:, None] * functions))
        root = np.sqrt(2.0 * air.density_kg_m3 / radius) * np.hstack(columns)
        volume = integrate @ np.ones(weights.size)
        radiation = air.density_kg_m3 / (np.pi * SOUND_SPEED) if air.baffle else 0.0
        return cls(root, volume, radiation=radiation)


def _evaluate_functions(unit_points: Array, degree: int, s: float) -> Iterator[Array]:
    """Evaluate the functions phi_mn, scaled so that sums of squared coefficients are energies.

    Parameters
    ----------
    unit_points : ndarray, shape (n, 2)
        Points on the unit disc.
    degree : int
        Maximum of m + 2 n.
    s : float
        Exponent s: -1/2 with a baffle, 1/2 without.

    Yields
    ------
    ndarray, shape (n, functions)
        For each m = 0, 1, ..., the functions of all n with cos(m t), then those with sin(m t).
    """
    r = np.hypot(unit_points[:, 0], unit_points[:, 1])
    angle = np.arctan2(unit_points[:, 1], unit_points[:, 0])
    for m in range(degree + 1):
        n = np.arange((degree - m) // 2 + 1)
        # Ratios of Gamma functions in lambda_mn and in the norm of phi_mn.
        ratio = poch(m + n + 1, s) if s < 0.0 else 1.0 / poch(n + 1, s)
        angular_norm = 2.0 * np.pi if m == 0 else np.pi
        scale = ratio * np.sqrt((2 * n + m + s + 1) / angular_norm)
        polynomials = eval_jacobi(n, s, m, (2.0 * r**2 - 1.0)[:, None])
        radial = scale * polynomials * (r**m)[:, None]
        if m == 0:
            yield radial
        else:
            cosine = np.cos(m * angle)[:, None]
            sine = np.sin(m * angle)[:, None]
            yield np.hstack([radial * cosine, radial * sine])
