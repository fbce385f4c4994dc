"""A centred round or ring-shaped layer on a film under a centred disc, axisymmetric, by shooting.

Green-Lagrange membrane under a dead pressure; it shares nothing with the finite elements. Forces
per length along r and z, X = N_r (1 + u') and Z = N_r w', do not jump where the layer ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pvdf_fem.arrays import Array


@dataclass(frozen=True)
class LayeredDisc:
    """Film and layer, lengths in m, stiffness E h in N/m; `rest` are their tensions at rest."""

    radius: float
    layer_radius: float
    stiffness: tuple[float, float]
    poisson_ratio: float
    rest: tuple[float, float]
    load_radius: float
    force: float
    layer_hole: float = 0.0

    def sums(self, radii: list[float]) -> Array:
        """Integrals of the film's own N_r + N_t over discs of these radii, N m, and last the
        deflection of the centre in m."""
        taut = -sum(self.rest) * (1.0 - self.poisson_ratio) / sum(self.stiffness)

        def rim(c: float) -> float:
            return float(self._shoot(c, [])[-1][0])

        high, low = 2e-2, 0.99 * taut
        if self.force:  # with too little tension there is no film to the rim
            while rim(low := 0.7 * high) > 0.0:
                high = low
        c = brentq(rim, low, high, xtol=1e-15)
        ends = self._shoot(c, radii)
        return np.array([*(self._film_sum(y) for y in ends[:-1]), -ends[-1][1]])

    def _film_sum(self, y: Array) -> float:
        return float(y[3])

    def _shoot(self, c: float, radii: list[float]) -> list[Array]:
        """u, w, X and the film's sum at these radii and at the rim, from a strain of the centre."""
        start = 1e-7 * self.radius
        e = c + 0.5 * c * c
        first = sum(k / (1 - self.poisson_ratio) * e + n for k, n in self._parts(0.0))
        y = np.array([c * start, 0.0, first * (1.0 + c), 0.0])
        at, r, ends = [], start, []
        kinks = {self.layer_hole, self.layer_radius, self.load_radius, self.radius, *radii} - {0.0}
        for end in sorted(kink for kink in kinks if kink <= self.radius):
            inside = 0.5 * (r + end)
            y = solve_ivp(
                lambda r, y, inside=inside: self._rates(r, y, inside),
                (r, end),
                y,
                method="DOP853",
                rtol=1e-10,
                atol=1e-15,
            ).y[:, -1]
            r = end
            if end in radii:
                at.append(end)
                ends.append(y)
        assert at == radii
        return [*ends, y]

    def _parts(self, r: float) -> list[tuple[float, float]]:
        """Stiffness and tension at rest of what there is at a radius."""
        parts = list(zip(self.stiffness, self.rest, strict=True))
        return parts if self.layer_hole <= r < self.layer_radius else parts[:1]

    def _rates(self, r: float, y: Array, inside: float) -> list[float]:
        nu, (u, _, X, _) = self.poisson_ratio, y
        pressed = min(r / self.load_radius, 1.0) ** 2
        Z = -self.force * pressed / (2.0 * math.pi * r)
        A = sum(k for k, _ in self._parts(inside)) / (1.0 - nu * nu)
        n = sum(n for _, n in self._parts(inside))
        e_t = u / r + 0.5 * (u / r) ** 2
        pull = math.hypot(X, Z)
        e_r = (pull - n) / A - nu * e_t
        for _ in range(50):  # N_r √(1 + 2 e_r) is the pull
            N, stretch = n + A * (e_r + nu * e_t), math.sqrt(1.0 + 2.0 * e_r)
            step = (N * stretch - pull) / (A * stretch + N / stretch)
            e_r -= step
            if abs(step) < 1e-16:
                break
        N = n + A * (e_r + nu * e_t)
        hoop = n + A * (e_t + nu * e_r)
        k, rest = self.stiffness[0], self.rest[0]
        film = k / (1.0 - nu) * (e_r + e_t) + 2.0 * rest
        return [X / N - 1.0, Z / N, (hoop * (1.0 + u / r) - X) / r, 2.0 * math.pi * r * film]
