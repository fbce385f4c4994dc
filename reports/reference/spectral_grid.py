"""Spectral elements along a radius: pieces, quadrature and the shape functions of their nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from pvdf_fem.arrays import Array, Mask

#: Degree of the polynomials on a piece; 12 already gives nine digits.
ORDER = 24


@dataclass(frozen=True)
class Piece:
    """Interval of the radius, mapped to xi in [-1, 1] so that the solution is smooth in xi.

    Around the centre the solution is even in r and analytic in r^2, which xi is there. Outside of
    the load the solution is close to r^(2/3) or ln r and smooth in ln r, which xi is there.
    """

    inner: float
    outer: float

    def radius(self, xi: Array) -> Array:
        """Return the radii at coordinates of [-1, 1]."""
        if self.inner == 0:
            return self.outer * np.sqrt((1 + xi) / 2)
        return self.inner * (self.outer / self.inner) ** ((1 + xi) / 2)

    def coordinate(self, radius: Array) -> Array:
        """Return the coordinates of [-1, 1] at radii."""
        if self.inner == 0:
            return 2 * (radius / self.outer) ** 2 - 1
        return 2 * np.log(radius / self.inner) / math.log(self.outer / self.inner) - 1

    def rate(self, radius: Array) -> Array:
        """Return the derivative of the coordinate by the radius."""
        if self.inner == 0:
            return 4 * radius / self.outer**2
        return 2 / (radius * math.log(self.outer / self.inner))


@dataclass(frozen=True)
class SpectralGrid:
    """Quadrature points (q,) and the shape functions of n nodes there."""

    node_radius: Array  # (n,)
    radius: Array  # (q,)
    weight: Array  # weights of r dr, (q,)
    value: Array  # shape functions, (q, n)
    gradient: Array  # their derivatives by r, (q, n)
    in_patch: Mask  # whether a point is under the load, (q,)


def pieces_of(patch_radius: float) -> tuple[Piece, ...]:
    """Return the patch, and rings of equal ratios of radii, of about e^1.5, around it."""
    count = math.ceil(-math.log(patch_radius) / 1.5)
    breaks = np.geomspace(patch_radius, 1.0, count + 1) if count else np.array([1.0])
    return tuple(Piece(*ends) for ends in zip([0.0, *breaks[:-1]], breaks, strict=True))


@cache
def _nodal_to_legendre() -> Array:
    """Legendre coefficients of the shape functions on the Chebyshev-Lobatto points."""
    return np.asarray(np.linalg.inv(legendre.legvander(_lobatto(), ORDER)), dtype=float)


def _lobatto() -> Array:
    """Chebyshev-Lobatto points, (degree + 1,)."""
    return -np.cos(np.pi * np.arange(ORDER + 1) / ORDER)


def legendre_series(nodal: Array, pieces: int) -> Array:
    """Legendre coefficients (pieces, degree + 1) of nodal values (n,)."""
    nodes = np.arange(pieces)[:, None] * ORDER + np.arange(ORDER + 1)
    return np.asarray(nodal[nodes] @ _nodal_to_legendre().T)


def grid_of(pieces: tuple[Piece, ...]) -> SpectralGrid:
    """Return the grid of all pieces; neighbours share a node."""
    xi, weight = legendre.leggauss(2 * ORDER + 2)
    value = legendre.legvander(xi, ORDER) @ _nodal_to_legendre()
    slope = legendre.legvander(xi, ORDER - 1) @ legendre.legder(_nodal_to_legendre())
    rows, nodes = len(xi), len(pieces) * ORDER + 1
    values, gradients = np.zeros((2, len(pieces) * rows, nodes))
    radii, weights = np.empty((2, len(pieces), rows))
    for i, piece in enumerate(pieces):
        radii[i] = piece.radius(xi)
        rate = piece.rate(radii[i])
        weights[i] = weight * radii[i] / rate
        block = np.s_[i * rows : (i + 1) * rows, i * ORDER : (i + 1) * ORDER + 1]
        values[block], gradients[block] = value, rate[:, None] * slope
    in_patch = np.arange(len(pieces) * rows) < rows
    node_radius = np.concatenate([[0.0], *(piece.radius(_lobatto()[1:]) for piece in pieces)])
    return SpectralGrid(node_radius, radii.ravel(), weights.ravel(), values, gradients, in_patch)
