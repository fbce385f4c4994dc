"""Polygons, and polygonal shapes: triangle, square, rectangle and free polygons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
import shapely
from pydantic import AfterValidator, Field

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import make_validation_error
from pvdf_fem.scene.outlines.outline import Line, Outline, rotate
from pvdf_fem.scene.outlines.shape import PLACE, SIZE, Shape


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
        s, w = np.polynomial.legendre.leggauss(count)
        begin = self.vertices[:, None]
        sides = np.roll(self.vertices, -1, axis=0)[:, None] - begin
        normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1) * 0.5 * w[:, None]
        points = begin + 0.5 * (s[:, None] + 1.0) * sides
        return points.reshape(-1, 2), normals.reshape(-1, 2)


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


class _PolygonalShape(Shape):
    def _placed(self, corners_mm: Array) -> Polygon:
        turned = rotate(corners_mm, self.rotation_deg)
        return Polygon((turned + np.array([self.x_mm, self.y_mm])) / 1e3)


class TriangleShape(_PolygonalShape):
    """An equilateral triangle; (x, y) is its centroid, unrotated a vertex points to +y."""

    period_deg = 120.0
    is_mirror_symmetric = True
    shape: Literal["triangle"] = "triangle"
    side_mm: Annotated[float, SIZE] = 7.0
    """Length of a side."""

    @cached_property
    def outline(self) -> Polygon:
        return self._placed(make_triangle_corners(self.side_mm))


class SquareShape(_PolygonalShape):
    """A square about (x, y), unrotated with its edges along x and y."""

    period_deg = 90.0
    is_mirror_symmetric = True
    is_rectangle = True
    shape: Literal["square"] = "square"
    side_mm: Annotated[float, SIZE] = 3.0
    """Length of a side."""

    @cached_property
    def outline(self) -> Polygon:
        return self._placed(make_rectangle_corners(self.side_mm, self.side_mm))


class RectangleShape(_PolygonalShape):
    """A rectangle about (x, y), unrotated with its width along x."""

    period_deg = 180.0
    is_mirror_symmetric = True
    is_rectangle = True
    size_key = "width_mm"
    shape: Literal["rectangle"] = "rectangle"
    width_mm: Annotated[float, SIZE] = 14.0
    """Width, unrotated along x."""
    height_mm: Annotated[float, SIZE] = 7.0
    """Height, unrotated along y."""

    @cached_property
    def outline(self) -> Polygon:
        return self._placed(make_rectangle_corners(self.width_mm, self.height_mm))


def _is_simple(vertices: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if wrong := find_polygon_defect(vertices):
        raise make_validation_error(f"{wrong}; list the corners of a simple polygon once, in order")
    return vertices


class PolygonShape(_PolygonalShape):
    """A simple polygon in either orientation; its vertices are relative to (x, y), unrotated."""

    size_key = "vertices_mm"
    shape: Literal["polygon"] = "polygon"
    vertices_mm: Annotated[
        tuple[tuple[float, float], ...],
        Field(min_length=3, max_length=1000),
        replace(PLACE, example=[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]),
        AfterValidator(_is_simple),
    ]
    """Corners [[x, y], ...] of a simple polygon in order."""

    @cached_property
    def outline(self) -> Polygon:
        return self._placed(np.array(self.vertices_mm))
