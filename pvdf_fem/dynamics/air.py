"""Air that moves with the film: its added mass, and the sound that a film in a baffle radiates.

The air is incompressible, around a flat disc. Where a plane in air moves by w, the pressures on
its sides resist with 2 rho w''/|k|, where |k| is the wavenumber. In a rigid baffle (Rayleigh's
integral) w vanishes outside of the disc, and the kinetic energy is rho <w', w'/|k|>. Without a
baffle the pressures are equal outside, and it is rho <w', D^-1 w'>, where D is the operator |k| on
functions that vanish outside. On the unit disc, with s = -1/2 with a baffle and 1/2 without (Dyda,
Kuznetsov and Kwasnicki, Constructive Approximation 46 (2017) 311-335),

    |k|^2s (1 - r^2)^s phi_mn = lambda_mn phi_mn,   phi_mn = r^m cos(m t) P_n^(s, m)(2 r^2 - 1),
    lambda_mn = 2^2s Gamma(1 + s + n) Gamma(1 + s + m + n)/(n! (m + n)!),

and likewise for sin(m t). The phi_mn are orthogonal with the weight (1 - r^2)^s. Both energies are
sums of squares in the coefficients of w', and the added mass is a product R R^T with a column for
each function.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.special import eval_jacobi, poch

from pvdf_fem.arrays import Array
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.scene.film import Air

SOUND_SPEED = 343.2  #: Of air at 20 degrees Celsius, m/s.
MAX_QUADRATURE_ORDER = 19  #: The highest order that scikit-fem has.


@dataclass(frozen=True, eq=False)
class AirLoad:
    """The mass and the radiation of the air on both sides of a film, for its unknowns."""

    root: Array  #: R of the added mass R R^T, (unknowns, functions), in kg^(1/2).
    volume: Array  #: v, the volume that a unit of each unknown displaces, m^2, (unknowns,).
    #: r in the resistance r omega^2 v v^T, in kg s/m^4: for a point source on both sides of a
    #: baffle, to leading order in the radius over the wavelength. Without a baffle both cancel.
    radiation: float

    @classmethod
    def from_equilibrium(cls, equilibrium: Equilibrium) -> AirLoad:
        """Compute the air load of a scene; zero for a scene without air.

        The functions phi_mn are taken up to the degree that the largest element still resolves.
        """
        scene = equilibrium.scene
        space = equilibrium.space
        air = scene.air or Air(density_kg_m3=0.0)
        radius = scene.film.radius
        largest_size = np.sqrt(2.0 * space.weights.sum(axis=1).max()) / radius
        degree = 10 + int(1.5 / largest_size) if scene.air else 0
        order = int(min(8.0 + degree * largest_size, float(MAX_QUADRATURE_ORDER)))
        every_element = np.arange(space.mesh.nelements)
        places, values, weights = space.make_quadrature(every_element, order)

        # integrals over the film of the deflection by each unknown times functions at the points
        points = np.repeat(np.arange(weights.size), values.shape[2])
        nodes = np.repeat(space.nodes, weights.shape[1], axis=0).ravel()
        entries = (values * weights[..., None]).ravel()
        by_node = sp.csr_matrix((entries, (nodes, points)), (space.basis.N, weights.size))
        integrate = equilibrium.unknowns.expansion[2::3].T @ by_node

        s = -0.5 if air.baffle else 0.5
        unit_places = places.reshape(-1, 2) / radius
        # The deflection is expanded in (1 - r^2)^s phi_mn with a baffle, with coefficients by
        # integrals of w phi_mn, and in phi_mn without one, by integrals of w (1 - r^2)^s phi_mn.
        rim_weight = np.maximum(1.0 - (unit_places**2).sum(axis=1), 0.0) ** max(s, 0.0)
        columns = []
        for functions in _evaluate_functions(unit_places, degree, s):
            columns.append(integrate @ (rim_weight[:, None] * functions))
        root = np.sqrt(2.0 * air.density_kg_m3 / radius) * np.hstack(columns)
        volume = integrate @ np.ones(weights.size)
        radiation = air.density_kg_m3 / (np.pi * SOUND_SPEED) if air.baffle else 0.0
        return cls(root, volume, radiation=radiation)


def _evaluate_functions(unit_places: Array, degree: int, s: float) -> Iterator[Array]:
    """Evaluate the functions phi_mn up to a degree, scaled so that sums of squares are energies.

    Parameters
    ----------
    unit_places : ndarray, shape (points, 2)
        Points on the unit disc.
    degree : int
        Largest m + 2 n.
    s : float
        -1/2 with a baffle, 1/2 without.

    Yields
    ------
    ndarray, shape (points, functions)
        The functions of m = 0, 1 ... in turn: for all n with cos(m t), then with sin(m t).
    """
    r = np.hypot(unit_places[:, 0], unit_places[:, 1])
    angle = np.arctan2(unit_places[:, 1], unit_places[:, 0])
    for m in range(degree + 1):
        n = np.arange((degree - m) // 2 + 1)
        # quotients of Gamma functions
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
