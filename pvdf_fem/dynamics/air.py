"""Air that moves with the film: its added mass, and the sound that a film in a baffle radiates.

The air is incompressible, around a flat disc. Where a plane in air moves by w, the pressures on
its sides resist with 2 rho w''/|k|, |k| the wavenumber. In a rigid baffle (Rayleigh's integral) w
vanishes outside of the disc, and the kinetic energy is rho <w', w'/|k|>. Without a baffle pressures
are equal out there, and it is rho <w', D^-1 w'>, D the operator |k| on functions that vanish
outside. On the unit disc, with s = -1/2 and 1/2 (Dyda, Kuznetsov and Kwasnicki 2017),

    |k|^2s (1 - r^2)^s phi_mn = lambda_mn phi_mn,   phi_mn = r^m cos(m t) P_n^(s, m)(2 r^2 - 1),
    lambda_mn = 2^2s Gamma(1 + s + n) Gamma(1 + s + m + n)/(n! (m + n)!),

and so for sin(m t). The phi_mn are orthogonal with the weight (1 - r^2)^s. Both energies are sums
of squares in the coefficients, and the added mass is a product R R^T with a column per function.
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


@dataclass(frozen=True, eq=False)
class AirLoad:
    """The air on both sides of a film's unknowns."""

    root: Array  #: R of the added mass R R^T, (unknowns, functions), in kg^(1/2).
    volume: Array  #: v, the volume that a unit of each unknown displaces, m^2, (unknowns,).
    #: r in the resistance r omega^2 v v^T, in kg s/m^4: for a point source on both sides of a
    #: baffle, to leading order in the radius over the wavelength; without one both cancel.
    radiation: float

    @classmethod
    def of(cls, equilibrium: Equilibrium) -> AirLoad:
        """The scene's air, if present, for shapes that the largest element resolves."""
        scene, space = equilibrium.scene, equilibrium.space
        air, a = scene.air or Air(density_kg_m3=0.0), scene.film.radius
        largest = np.sqrt(2.0 * space.weights.sum(axis=1).max()) / a
        degree = 10 + int(1.5 / largest) if scene.air else 0
        s = -0.5 if air.baffle else 0.5
        rule = int(min(8.0 + degree * largest, 19.0))  # the highest order that scikit-fem has
        places, values, weights = space.make_quadrature(np.arange(space.mesh.nelements), rule)
        points = np.repeat(np.arange(weights.size), values.shape[2])
        nodes = np.repeat(space.nodes, weights.shape[1], axis=0).ravel()
        entries = (values * weights[..., None]).ravel(), (nodes, points)
        integrals = sp.csr_matrix(entries, (space.basis.N, weights.size))
        onto = equilibrium.unknowns.expansion[2::3].T @ integrals
        unit = places.reshape(-1, 2) / a
        weight = np.maximum(1.0 - (unit**2).sum(axis=1), 0.0) ** max(s, 0.0)
        blocks = [onto @ (weight[:, None] * f) for f in _functions(unit, degree, s)]
        root = np.sqrt(2.0 * air.density_kg_m3 / a) * np.hstack(blocks)
        radiation = air.density_kg_m3 / (np.pi * SOUND_SPEED) if air.baffle else 0.0
        return cls(root, onto @ np.ones(weights.size), radiation)


def _functions(unit: Array, degree: int, s: float) -> Iterator[Array]:
    """Values (points, functions) for phi_mn up to a degree at points on the unit disc, by m. In
    this scaling, sums of squares are the energies."""
    r, angle = np.hypot(*unit.T), np.arctan2(*unit.T[::-1])
    for m in range(degree + 1):
        n = np.arange((degree - m) // 2 + 1)
        ratio = poch(m + n + 1, s) if s < 0.0 else 1.0 / poch(n + 1, s)  # of Gamma functions
        scale = ratio * np.sqrt((2 * n + m + s + 1) / (2.0 * np.pi if m == 0 else np.pi))
        radial = scale * eval_jacobi(n, s, m, (2.0 * r**2 - 1.0)[:, None]) * (r**m)[:, None]
        turns = [np.cos(m * angle), np.sin(m * angle)][: 1 + (m > 0)]
        yield np.hstack([radial * t[:, None] for t in turns])
