"""Coulomb friction between the film and a tip, from one step of the load to the next.

Film that slid along the tip since the step before feels friction against that way, as large as the
coefficient times the normal force. At a node with the film's force f, the tip's slope s and the
way d in the plane, the balance along the tip is

    f_xy - s f_z + friction (s . f_xy + f_z) g/sqrt(1 + |s|^2) = 0,  g = G d/sqrt(d . G d + e^2)

with the metric G = 1 + s s^T of the tip's surface. The length e is that of a way too short to tell
from sticking. Without friction it is the balance of `pvdf_fem.film.loads.contact`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.space import Space
from pvdf_fem.scene.outlines.tip import Height

#: Length of a way that is like sticking, over the longest one that is expected.
LIKE_STICKING = 1e-3


@dataclass(frozen=True, eq=False)
class Displacement:
    """That of a film after a step of its load, seen from a tip that has `moved` since, (2,) in m.

    `dofs` (dofs,) are those of a `space`. The error of all steps is the `share` of the change by
    a film that was untouched before.
    """

    space: Space
    dofs: Array
    share: float
    less_exact: ClassVar[None] = None
    moved: Array = field(default_factory=lambda: np.zeros(2))

    def __call__(self, points: Array) -> Array:
        """In the plane, (n, 2) in m, at points (n, 2)."""
        places = self.space.interpolation(points.T) @ self.dofs.reshape(-1, 3)[:, :2]
        return np.asarray(places + self.moved)


@dataclass(frozen=True)
class Coulomb:
    """Friction at nodes; `friction` is its coefficient, `shortest` the length e in m.

    Where it `lags`, derivatives are those with a fixed denominator of g. Newton's method overshoots
    without that, as friction turns within the length e.
    """

    friction: float
    shortest: float
    lags: bool = False

    def balance(self, height: Height, way: Array) -> Array:
        """What of a node's force (3,) is out of balance along x and y: (n, 2, 3)."""
        s = height.slope
        rows = np.zeros((len(s), 2, 3))
        rows[:, :, :2], rows[:, :, 2] = np.eye(2), -s
        if self.friction:
            normal = np.column_stack([s, np.ones(len(s))]) / self._steep(s)[:, None]
            rows += self.friction * self._direction(s, way)[:, :, None] * normal[:, None]
        return rows

    def turned(self, height: Height, way: Array, forces: Array) -> Array:
        """Derivative of `balance` times the forces (n, 3) by the displacement, (n, 2, 2)."""
        s, H = height.slope, height.hessian
        change = -forces[:, 2, None, None] * H
        if not self.friction:
            return change
        steep = self._steep(s)
        pressed = (s * forces[:, :2]).sum(axis=1) + forces[:, 2]
        normal = pressed / steep
        by_slope = forces[:, :2] / steep[:, None] - (pressed / steep**3)[:, None] * s
        d_normal = np.einsum("ni,nij->nj", by_slope, H)
        direction = self._direction(s, way)
        d_direction = self._direction_change(s, H, way)
        rubbed = direction[:, :, None] * d_normal[:, None] + normal[:, None, None] * d_direction
        return np.asarray(change + self.friction * rubbed)

    def _direction(self, s: Array, way: Array) -> Array:
        along = way + s * (s * way).sum(axis=1, keepdims=True)
        return np.asarray(along / self._length(along, way)[:, None])

    def _direction_change(self, s: Array, H: Array, way: Array) -> Array:
        """Derivative of `_direction` by the displacement, which moves way and slope."""
        climb = (s * way).sum(axis=1)
        along = way + s * climb[:, None]
        length = self._length(along, way)[:, None, None]
        d_climb = np.einsum("nij,ni->nj", H, way)  # by the slope alone
        d_along = np.eye(2) + s[:, :, None] * (s + d_climb)[:, None] + climb[:, None, None] * H
        if self.lags:
            return d_along / length
        d_square = along + climb[:, None] * d_climb  # half the derivative of way . along
        return d_along / length - along[:, :, None] * d_square[:, None] / length**3

    def _length(self, along: Array, way: Array) -> Array:
        return np.sqrt((way * along).sum(axis=1) + self.shortest**2)

    @staticmethod
    def _steep(s: Array) -> Array:
        return np.sqrt(1.0 + (s**2).sum(axis=1))
