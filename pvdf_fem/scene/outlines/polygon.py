"""Polygons, and polygonal shapes: triangle, square, rectangle and free polygons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import Line, Outline


@dataclass(frozen=True, eq=False)
class Polygon(Outline):
    """A simple polygon. Its `vertices` (n, 2) in m may be in either orientation; they are stored
    counter-clockwise and read-only."""

    vertices: Array

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=float)
        if _moments(vertices)[0] < 0:
            vertices = vertices[::-1].copy()
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)

    @cached_property
    def area(self) -> float:
        return _moments(self.vertices)[0]

    @cached_property
    def centroid(self) -> Array:
        return _moments(self.vertices)[1]

    @cached_property
    def reach(self) -> float:
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def lower_left(self) -> Array:
        return self.vertices.min(axis=0)

    @property
    def corners(self) -> Array:
        return self.vertices

    @property
    def defining_points(self) -> Array:
        return self.vertices

    @property
    def boundary(self) -> tuple[Line, ...]:
        ends = np.roll(self.vertices, -1, axis=0)
        return tuple(Line(a, b) for a, b in zip(self.vertices, ends, strict=True))

    @cached_property
    def shape(self) -> shapely.Polygon:
        return shapely.Polygon(self.vertices)

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return self.shape

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Polygon:
        return Polygon(self.vertices @ np.transpose(frame) + shift)

    def signed_distance(self, points: Array) -> Array:
        at = shapely.points(points)
        distance = shapely.distance(self.shape.exterior, at)
        return np.where(shapely.contains(self.shape, at), -distance, distance)

    def compute_depth_in(self, other: Outline) -> float:
        return -float(other.signed_distance(self.vertices).min())

    def boundary_rule(self, count: int) -> tuple[Array, Array]:
        s, w = _make_gauss_rule(count)
        begin = self.vertices[:, None]
        sides = np.roll(self.vertices, -1, axis=0)[:, None] - begin
        normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1) * 0.5 * w[:, None]
        points = begin + 0.5 * (s[:, None] + 1.0) * sides
        return points.reshape(-1, 2), normals.reshape(-1, 2)


@cache
def _make_gauss_rule(count: int) -> tuple[Array, Array]:
    """Make the points and weights (count,) of the Gauss-Legendre rule on [-1, 1], read-only."""
    points, weights = np.polynomial.legendre.leggauss(count)
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


def make_rectangle_corners(width: float, height: float) -> Array:
    """Corners, shape (4, 2), of a rectangle about the origin with its width along x."""
    x, y = width / 2, height / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def make_triangle_corners(side: float) -> Array:
    """Corners, shape (3, 2), of an equilateral triangle about the origin, one corner on +y."""
    height = side * np.sqrt(3.0) / 2
    return np.array([[0.0, 2 * height / 3], [-side / 2, -height / 3], [side / 2, -height / 3]])


def find_polygon_defect(vertices: Sequence[Sequence[float]]) -> str | None:
    """Why vertices are no simple polygon for a mesh, or None; the unit is arbitrary."""
    points = np.asarray(vertices, dtype=float)
    extent = float(np.ptp(points, axis=0).max())
    detail = 1e-6 * extent  # smaller details cannot be meshed
    gaps = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
    repeats = np.flatnonzero(gaps <= detail)
    if repeats.size:
        first = int(repeats[0])
        return f"vertices {first} and {(first + 1) % len(points)} coincide"
    if shapely.MultiPoint(points).convex_hull.area <= detail * extent:
        return "the vertices lie on a line"
    ring = shapely.Polygon(points)
    if not ring.is_valid:
        return f"the outline crosses or touches itself ({shapely.is_valid_reason(ring)})"
    if shapely.minimum_clearance(ring) <= detail:
        return "the polygon is too thin somewhere"
    return None


def _moments(vertices: Array) -> tuple[float, Array]:
    """Signed area and centroid by Green's theorem, about the first vertex against cancellation."""
    here = vertices - vertices[0]
    there = np.roll(here, -1, axis=0)
    cross = here[:, 0] * there[:, 1] - there[:, 0] * here[:, 1]
    area = cross.sum() / 2
    return float(area), vertices[0] + cross @ (here + there) / (6 * area)
