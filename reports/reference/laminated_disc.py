"""A clamped film with a centred round layer on one side, under a centred disc of pressure.

Von Karman's axisymmetric plate of two layers: u is quadratic in each element and w Hermite's cubic,
so that strains and curvatures may jump where the layer ends. It shares nothing with the package's
finite elements.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from pvdf_fem.arrays import Array


@dataclass(frozen=True, eq=False)
class Ply:
    """A layer: plane-stress stiffness in Pa, (2, 2), lengths in m, strain of the unloaded disc."""

    stiffness: Array
    thickness: float
    height: float  #: Of its middle over the film's; NaN in a membrane, where it does not matter.
    prestrain: float
    radius: float


@dataclass(frozen=True, eq=False)
class LaminatedDisc:
    """Film and layers, the first of which is the film; its radius is the rim's."""

    plies: tuple[Ply, ...]
    load_radius: float
    force: float
    #: Round electrodes, (n, 3): distances from the centre in m, directions in rad, radii in m.
    electrodes: Array
    elements: int = 8  #: Between two of the centre, the ends of layers and load, and the rim.

    def as_membrane(self) -> LaminatedDisc:
        """Without bending stiffness, all layers in one plane."""
        return replace(self, plies=tuple(replace(ply, height=np.nan) for ply in self.plies))

    @cached_property
    def _nodes(self) -> Array:
        d, _, radius = self.electrodes.T
        layers = (ply.radius for ply in self.plies)
        ends = sorted({0.0, self.load_radius, *layers, *abs(d - radius), *(d + radius)})
        t = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, self.elements + 1)))
        pieces = [a + (b - a) * t[:-1] for a, b in pairwise(ends)]
        return np.concatenate([*pieces, ends[-1:]])

    @cached_property
    def _points(self) -> tuple[Array, Array, Array, Array]:
        """Gauss points with the fields of the degrees of freedom.

        Radii (m,), weights of areas (m,), the fields u', u/r, w', w'', w'/r (5, m, dofs), and w (m,
        dofs). The degrees of freedom are u at nodes and middles, then w and w' at nodes.
        """
        nodes = self._nodes
        n, size = len(nodes) - 1, np.diff(nodes)
        x, weight = np.polynomial.legendre.leggauss(4)
        x, weight = 0.5 * (x + 1.0), 0.5 * weight
        r = (nodes[:-1, None] + size[:, None] * x).ravel()
        table = np.zeros((6, n, len(x), 4 * n + 3))
        first = 2 * n + 1
        u = np.array([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)])
        slope = np.array([4 * x - 3, 4 - 8 * x, 4 * x - 1])
        w = np.array(
            [1 - 3 * x**2 + 2 * x**3, x - 2 * x**2 + x**3, 3 * x**2 - 2 * x**3, x**3 - x**2]
        )
        w1 = np.array([6 * x**2 - 6 * x, 1 - 4 * x + 3 * x**2, 6 * x - 6 * x**2, 3 * x**2 - 2 * x])
        w2 = np.array([12 * x - 6, 6 * x - 4, 6 - 12 * x, 6 * x - 2])
        for i, h in enumerate(size):
            table[0, i][:, 2 * i : 2 * i + 3] = slope.T / h
            table[1, i][:, 2 * i : 2 * i + 3] = u.T / (nodes[i] + h * x[:, None])
            scale = np.array([1.0, h, 1.0, h])
            at = slice(first + 2 * i, first + 2 * i + 4)
            table[2, i][:, at] = w1.T * scale / h
            table[3, i][:, at] = w2.T * scale / h**2
            table[4, i][:, at] = table[2, i][:, at] / (nodes[i] + h * x[:, None])
            table[5, i][:, at] = w.T * scale
        flat = table.reshape(6, n * len(x), -1)
        areas = 2.0 * np.pi * r * (size[:, None] * weight).ravel()
        return r, areas, flat[:5], flat[5]

    @cached_property
    def _laminate(self) -> tuple[Array, Array]:
        """Stiffness of strains and curvatures (m, 4, 4) and forces in the unloaded disc (m, 4)."""
        r = self._points[0]
        stiffness, rest = np.zeros((len(r), 4, 4)), np.zeros((len(r), 4))
        for ply in self.plies:
            A, z = ply.thickness * ply.stiffness, np.nan_to_num(ply.height)
            D = A * (z * z + np.isfinite(ply.height) * ply.thickness**2 / 12.0)
            N, on = ply.prestrain * A.sum(axis=1), r < ply.radius
            stiffness[on] += np.block([[A, z * A], [z * A, D]])
            rest[on] += np.concatenate([N, z * N])
        return stiffness, rest

    @property
    def deflections(self) -> Array:
        """At the nodes in m, the first of which is the centre."""
        return self._balanced[2 * len(self._nodes) - 1 :: 2]

    def _strains(self, q: Array) -> Array:
        """Strains and curvatures of the film, (m, 4)."""
        du, hoop, slope, bend, turn = self._points[2] @ q
        return np.stack([du + 0.5 * slope**2, hoop, -bend, -turn], axis=1)

    @cached_property
    def _load(self) -> Array:
        r, areas, _, w = self._points
        pressed = (r < self.load_radius) * areas
        return self.force * (pressed @ w) / pressed.sum()

    def _energy(self, q: Array) -> float:
        e, (stiffness, rest) = self._strains(q), self._laminate
        density = 0.5 * np.einsum("mi,mij,mj->m", e, stiffness, e) + (rest * e).sum(axis=1)
        return float(self._points[1] @ density - self._load @ q)

    def _equations(self, q: Array) -> tuple[Array, Array]:
        """Residual, and tangent without what compression takes away, so that steps go downhill."""
        _, areas, (du, hoop, slope, bend, turn), _ = self._points
        stiffness, rest = self._laminate
        forces = np.einsum("mij,mj->mi", stiffness, self._strains(q)) + rest
        B = np.stack([du + (slope @ q)[:, None] * slope, hoop, -bend, -turn], axis=1)
        residual = np.einsum("m,mi,mid->d", areas, forces, B) - self._load
        weighted = np.einsum("m,mij,mjd->mid", areas, stiffness, B)
        tensions = (areas * np.maximum(forces[:, 0], 0.0))[:, None]
        tangent = np.tensordot(B, weighted, axes=([0, 1], [0, 1]))
        return residual, tangent + (slope * tensions).T @ slope

    @cached_property
    def _balanced(self) -> Array:
        """The dofs in balance, by Newton's method that goes back by halves."""
        nodes, q = len(self._nodes), np.zeros(len(self._load))
        free = np.ones(len(q), dtype=bool)
        free[[0, 2 * nodes - 2, 2 * nodes, -2]] = False  # u = w' = 0 on the axis, u = w = 0
        free[-1] = not np.isfinite(self.plies[0].height)  # a membrane turns on the rim
        for _ in range(200):
            residual, tangent = self._equations(q)
            step = np.zeros_like(q)
            step[free] = np.linalg.solve(tangent[np.ix_(free, free)], -residual[free])
            slope, before = float(residual @ step), self._energy(q)
            while self._energy(q + step) > before + 1e-4 * slope and abs(slope) > 1e-18:
                step, slope = 0.5 * step, 0.5 * slope
            q = q + step
            if abs(slope) < 1e-16 * max(abs(before), 1e-12):
                return q
        raise RuntimeError("a laminated disc did not converge")

    def charges(self, d31: float, d32: float) -> Array:
        """Charges in C of the electrodes, (n,), by coefficients in C/N along x and y."""
        r, areas, *_ = self._points
        film, strains = self.plies[0], self._strains(self._balanced)[:, :2]
        radial, hoop = film.stiffness @ (strains + film.prestrain).T
        d, direction, radius = self.electrodes.T[..., None]
        cosine = (r**2 + d**2 - radius**2) / (2.0 * r * np.maximum(d, 1e-9))
        half_arc = np.arccos(np.clip(cosine, -1.0, 1.0))
        even = (d31 + d32) * (radial + hoop) * half_arc
        along = 0.5 * np.cos(2.0 * direction) * np.sin(2.0 * half_arc)
        uneven = (d31 - d32) * (radial - hoop) * along
        return np.asarray((even + uneven) @ areas / (2.0 * np.pi))
