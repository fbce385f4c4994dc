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
    """A layer: stiffness of plane stress in Pa, (2, 2), lengths in m, and its strain at rest."""

    stiffness: Array
    thickness: float
    height: float  #: Of its middle over the film's; NaN in a membrane, where it does not matter.
    strain_at_rest: float
    radius: float


@dataclass(frozen=True, eq=False)
class LaminatedDisc:
    """Film and layers, the first of which is the film; its radius is the rim's."""

    plies: tuple[Ply, ...]
    load_radius: float
    force: float
    #: Round electrodes: distances from the centre and radii, m, (n, 2).
    electrodes: Array
    elements: int = 8  #: Between two of the centre, the ends of layers and load, and the rim.

    def as_membrane(self) -> LaminatedDisc:
        """Without bending stiffness, all layers in one plane."""
        return replace(self, plies=tuple(replace(ply, height=np.nan) for ply in self.plies))

    @cached_property
    def _nodes(self) -> Array:
        d, radius = self.electrodes.T
        edges = {
            self.load_radius,
            *(ply.radius for ply in self.plies),
            *abs(d - radius),
            *(d + radius),
        }
        ends = sorted({0.0, *edges})
        t = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, self.elements + 1)))
        pieces = [a + (b - a) * t[:-1] for a, b in pairwise(ends)]
        return np.concatenate([*pieces, ends[-1:]])

    @cached_property
    def _points(self) -> tuple[Array, Array, Array, Array]:
        """Radii (m,), weights of areas (m,), and u', u/r, w', w'', w'/r of the dofs, (5, m, dofs),
        and w, (m, dofs). Dofs are u at nodes and middles, then w and w' at nodes."""
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
        """Stiffness of strains and curvatures (m, 4, 4) and forces at rest (m, 4)."""
        r = self._points[0]
        stiffness, rest = np.zeros((len(r), 4, 4)), np.zeros((len(r), 4))
        for ply in self.plies:
            A, z, bends = (
                ply.thickness * ply.stiffness,
                np.nan_to_num(ply.height),
                np.isfinite(ply.height),
            )
            D = A * (z * z + bends * ply.thickness**2 / 12.0)
            on = r < ply.radius
            stiffness[on] += np.block([[A, z * A], [z * A, D]])
            N = ply.strain_at_rest * A.sum(axis=1)
            rest[on] += np.concatenate([N, z * N])
        return stiffness, rest

    @cached_property
    def _strains(self) -> Array:
        """Strains and curvatures of the film in balance, (m, 4)."""
        r, areas, (du, hoop, slope, bend, turn), w = self._points
        stiffness, rest = self._laminate
        nodes = len(self._nodes)
        pressed = (r < self.load_radius) * areas
        load = self.force * (pressed @ w) / pressed.sum()
        free = np.ones(w.shape[1], dtype=bool)
        free[[0, 2 * nodes - 2, 2 * nodes, -2]] = False  # u = 0 and w' = 0 on the axis, u = w = 0
        free[-1] = not np.isfinite(self.plies[0].height)  # a membrane turns on the rim

        def strains(q: Array) -> Array:
            phi = slope @ q
            return np.stack([du @ q + 0.5 * phi**2, hoop @ q, -bend @ q, -turn @ q], axis=1)

        def energy(q: Array) -> float:
            e = strains(q)
            density = 0.5 * np.einsum("mi,mij,mj->m", e, stiffness, e) + (rest * e).sum(axis=1)
            return float(areas @ density - load @ q)

        q = np.zeros(w.shape[1])
        for _ in range(200):
            e, phi = strains(q), slope @ q
            forces = np.einsum("mij,mj->mi", stiffness, e) + rest
            B = np.stack([du + phi[:, None] * slope, hoop, -bend, -turn], axis=1)
            residual = np.einsum("m,mi,mid->d", areas, forces, B) - load
            weighted = np.einsum("m,mij,mjd->mid", areas, stiffness, B)
            tangent = np.tensordot(B, weighted, axes=([0, 1], [0, 1]))
            tangent += (slope * (areas * np.maximum(forces[:, 0], 0.0))[:, None]).T @ slope
            step = np.zeros_like(q)
            step[free] = np.linalg.solve(tangent[np.ix_(free, free)], -residual[free])
            size, before = 1.0, energy(q)
            while (
                energy(q + size * step) > before + 1e-4 * size * (residual @ step) and size > 1e-6
            ):
                size *= 0.5
            q = q + size * step
            if abs(residual @ step) < 1e-16 * max(abs(before), 1e-12):
                return strains(q)
        raise RuntimeError("a laminated disc did not converge")

    def charges(self, d31: float) -> Array:
        """Charges in C of the electrodes, (n,), whose d31 = d32 in C/N."""
        r, areas, *_ = self._points
        film, (e_r, e_t, *_) = self.plies[0], self._strains.T
        traces = film.thickness * film.stiffness[0].sum() * (e_r + e_t + 2.0 * film.strain_at_rest)
        d, radius = self.electrodes.T[..., None]
        cosine = (r**2 + d**2 - radius**2) / (2.0 * r * np.maximum(d, 1e-9))
        inside = np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi
        return np.asarray(d31 / film.thickness * (inside * areas) @ traces)
