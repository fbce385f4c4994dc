"""Ellipses: the outline, and its table in scene files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import EllipseCurve, Outline


@dataclass(frozen=True, eq=False)
class Ellipse(Outline):
    """The points centre + axes z, where z is in the unit disc; lengths are in m, arrays are stored
    read-only."""

    centre: Array
    first: Array  #: From the centre to the end of one of the axes.
    second: float  #: Length of the other semi-axis.

    def __post_init__(self) -> None:
        for name in ("centre", "first"):
            vector = np.array(getattr(self, name), dtype=float)
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)

    @cached_property
    def axes(self) -> Array:
        """Semi-axes in m as orthogonal columns (2, 2), the second a quarter counter-clockwise of
        the first."""
        x, y = self.first
        across = np.array([-y, x]) * self.second / np.hypot(x, y)
        return np.stack([self.first, across], axis=-1)

    @property
    def area(self) -> float:
        return float(np.pi * np.linalg.det(self.axes))

    @property
    def centroid(self) -> Array:
        return self.centre

    @property
    def boundary(self) -> tuple[EllipseCurve]:
        return (EllipseCurve(self.centre, self.axes),)

    @cached_property
    def shape(self) -> shapely.Polygon:
        """An inscribed polygon of 256 sides for shapely."""
        return shapely.Polygon(self.at(2.0 * np.pi * np.arange(256) / 256))

    def at(self, angles: Array) -> Array:
        """Points (n, 2) on the boundary in m: images of unit-circle points at angles (n,)."""
        return self.centre + np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ self.axes.T

    def signed_distance(self, points: Array) -> Array:
        """Distances (n,) in m of points (n, 2) from the boundary to first order, negative inside.
        They are f / |grad f| with f = |z| - 1."""
        to_disc = np.linalg.inv(self.axes)
        z = (points - self.centre) @ to_disc.T
        radius = np.hypot(z[:, 0], z[:, 1])
        z[radius == 0.0] = 1.0, 0.0
        outward = z / np.where(radius > 0.0, radius, 1.0)[:, None]
        return (radius - 1.0) / np.linalg.norm(outward @ to_disc, axis=1)

    def compute_depth_in(self, other: Outline) -> float:
        """How deep the boundary reaches into another outline, in m; negative outside. Points deeper
        than their neighbours are sought between the neighbours again and again; the depth's error
        is quadratic in their distance."""
        angles = 2.0 * np.pi * np.arange(256) / 256
        step, deepest = angles[1], -np.inf
        while step > 1e-8:
            depth = -other.signed_distance(self.at(angles.ravel())).reshape(angles.shape)
            deepest = max(deepest, float(depth.max()))
            if angles.ndim == 1:
                peaks = (depth >= np.roll(depth, 1)) & (depth >= np.roll(depth, -1))
                middles = angles[peaks]
            else:
                middles = np.take_along_axis(angles, depth.argmax(axis=1)[:, None], axis=1)[:, 0]
            angles = middles[:, None] + step * np.linspace(-1.0, 1.0, 33)
            step /= 16.0
        return deepest

    def arc_middles(self, starts: Array, ends: Array) -> Array:
        """Midside nodes (n, 2) that give curved elements the area of the disc's image. On the unit
        circle the points are moved outwards: a quadratic arc through three points lies inside the
        circle. With the area right, what is left of the error changes sign along the arc, and is
        not felt away from it. A linear map keeps the ratio of areas."""
        to_disc = np.linalg.inv(self.axes)
        a, b = ((points - self.centre) @ to_disc.T for points in (starts, ends))
        half = np.arcsin(0.5 * np.linalg.norm(a - b, axis=1))
        # (4/3) (r - cos) sin is the area between the quadratic arc and its chord, and
        # half - sin cos that between the circle and the chord
        sine, cosine = np.sin(half), np.cos(half)
        radius = cosine + 0.75 * (half - sine * cosine) / sine
        middle = a + b
        outward = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        return self.centre + radius[:, None] * outward @ self.axes.T

    def boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Points (n, 2) in m and outward normals (n, 2) times weights in m, `count` per quarter."""
        step = 0.5 * np.pi / count
        angles = step * np.arange(4.0 * count)
        tangents = np.stack([-np.sin(angles), np.cos(angles)], axis=-1) @ self.axes.T
        return self.at(angles), step * np.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point of the ellipse from the film's centre, in m. At z = exp(it)
        the derivative of |centre + axes (cos t, sin t)|² is a polynomial of degree 4 over z²."""
        p, q = self.centre @ self.axes
        a, b = (self.axes**2).sum(axis=0)
        powers = np.array([b - a, 2j * q - 2.0 * p, 0.0, 2j * q + 2.0 * p, a - b])
        powers[np.abs(powers) < 1e-30 * (a + b)] = 0.0  # their quotients overflow
        angles = np.append(np.angle(np.roots(powers)), 0.0)
        return float(np.linalg.norm(self.at(angles), axis=1).max())

    @property
    def lower_left(self) -> Array:
        return self.centre - np.linalg.norm(self.axes, axis=1)

    @cached_property
    def defining_points(self) -> Array:
        return self.centre + np.concatenate([self.axes.T, -self.axes.T])

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Ellipse:
        return Ellipse(frame @ self.centre + shift, frame @ self.first, self.second)
