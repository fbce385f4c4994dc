"""The outline of a polygon, and the corners of common polygons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import Line, Outline


class _Moments(NamedTuple):
    """Area and centroid of a polygon."""

    area: float  #: Positive for counter-clockwise vertices.
    centroid: Array  #: Shape (2,).


@dataclass(frozen=True, eq=False)
class Polygon(Outline):
    """A simple polygon.

    Parameters
    ----------
    vertices : ndarray, shape (n, 2)
        Vertices in m, in order; stored as a read-only copy in counter-clockwise order.
    """

    vertices: Array

    def __post_init__(self) -> None:
        """Replace the vertices by a read-only copy in counter-clockwise order."""
        vertices = np.array(self.vertices, dtype=float)
        if _compute_moments(vertices).area < 0:
            vertices = vertices[::-1].copy()
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)

    @cached_property
    def area(self) -> float:
        """Area in m²."""
        return _compute_moments(self.vertices).area

    @property
    def longest_side(self) -> float:
        """Length of the longest side in m."""
        sides = np.roll(self.vertices, -1, axis=0) - self.vertices
        return float(np.linalg.norm(sides, axis=1).max())

    @cached_property
    def centroid(self) -> Array:
        """Centroid in m, shape (2,)."""
        return _compute_moments(self.vertices).centroid

    @cached_property
    def reach(self) -> float:
        """Maximum distance of the vertices from the film's centre, in m."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def lower_left(self) -> Array:
        """Minimum x and minimum y in m, shape (2,)."""
        return self.vertices.min(axis=0)

    @property
    def corners(self) -> Array:
        """The vertices in m, counter-clockwise, shape (n, 2)."""
        return self.vertices

    @property
    def defining_points(self) -> Array:
        """The vertices in m, counter-clockwise, shape (n, 2)."""
        return self.vertices

    @property
    def boundary(self) -> tuple[Line, ...]:
        """The sides, counter-clockwise."""
        ends = np.roll(self.vertices, -1, axis=0)
        return tuple(Line(start, end) for start, end in zip(self.vertices, ends, strict=True))

    @cached_property
    def inscribed_polygon(self) -> shapely.Polygon:
        """The polygon itself."""
        return shapely.Polygon(self.vertices)

    @cached_property
    def equal_area_polygon(self) -> shapely.Polygon:
        """The polygon itself."""
        return self.inscribed_polygon

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Polygon:
        """Return a transformed copy; see `Outline.transform`."""
        return Polygon(self.vertices @ np.transpose(frame) + shift)

    def compute_signed_distances(self, points: Array) -> Array:
        """Compute exact distances from the boundary; see `Outline.compute_signed_distances`."""
        geometries = shapely.points(points)
        polygon = self.inscribed_polygon
        distance = shapely.distance(polygon.exterior, geometries)
        return np.where(shapely.contains(polygon, geometries), -distance, distance)

    def compute_depth_in(self, other: Outline) -> float:
        """Compute the maximum depth of the vertices in another outline; see the base class.

        Points between the vertices may be deeper.
        """
        return -float(other.compute_signed_distances(self.vertices).min())

    def _find_excess(self, other: Outline) -> float:
        """Compute the maximum distance of the vertices from another outline; see the base class."""
        return float(other.compute_signed_distances(self.vertices).max())

    def make_boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Make a Gauss-Legendre rule on every side of the boundary.

        Parameters
        ----------
        count : int
            Number of points per side.

        Returns
        -------
        points : ndarray, shape (sides * count, 2)
            Quadrature points in m.
        normals : ndarray, shape (sides * count, 2)
            Outward unit normals multiplied by the quadrature weights in m.
        """
        local, weights = make_gauss_rule(count)
        starts = self.vertices[:, None]
        sides = np.roll(self.vertices, -1, axis=0)[:, None] - starts
        normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1) * 0.5 * weights[:, None]
        points = starts + 0.5 * (local[:, None] + 1.0) * sides
        return points.reshape(-1, 2), normals.reshape(-1, 2)


@cache
def make_gauss_rule(count: int) -> tuple[Array, Array]:
    """Make the points and weights of the Gauss-Legendre rule on [-1, 1], as read-only arrays."""
    points, weights = np.polynomial.legendre.leggauss(count)
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


def make_rectangle_corners(width: float, height: float) -> Array:
    """Make the corners of a rectangle about the origin with its width along x, shape (4, 2)."""
    x = width / 2
    y = height / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def make_triangle_corners(side: float) -> Array:
    """Make the corners of an equilateral triangle about the origin, one on +y, shape (3, 2)."""
    height = side * np.sqrt(3.0) / 2
    return np.array([[0.0, 2 * height / 3], [-side / 2, -height / 3], [side / 2, -height / 3]])


def find_polygon_defect(vertices: Sequence[Sequence[float]]) -> str | None:
    """Describe why vertices do not form a simple polygon that can be meshed.

    Parameters
    ----------
    vertices : sequence of pairs of float
        Vertices in any unit, in order.

    Returns
    -------
    str or None
        The first defect that is found, in words: repeated vertices, vertices on a line, a boundary
        that crosses itself, or a detail smaller than 1e-6 of the extent. None without a defect.
    """
    points = np.asarray(vertices, dtype=float)
    extent = float(np.ptp(points, axis=0).max())
    smallest_detail = 1e-6 * extent  # gmsh cannot mesh smaller details
    gaps = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
    repeats = np.flatnonzero(gaps <= smallest_detail)
    if repeats.size:
        first = int(repeats[0])
        return f"vertices {first} and {(first + 1) % len(points)} coincide"
    if shapely.MultiPoint(points).convex_hull.area <= smallest_detail * extent:
        return "the vertices lie on a line"
    ring = shapely.Polygon(points)
    if not ring.is_valid:
        return f"the outline crosses or touches itself ({shapely.is_valid_reason(ring)})"
    if shapely.minimum_clearance(ring) <= smallest_detail:
        return "the polygon is too thin somewhere"
    return None


def _compute_moments(vertices: Array) -> _Moments:
    """Compute signed area and centroid of a polygon by Green's theorem.

    Positions relative to the first vertex are used, to avoid cancellation.
    """
    starts = vertices - vertices[0]
    ends = np.concatenate([starts[1:], starts[:1]])
    cross = starts[:, 0] * ends[:, 1] - ends[:, 0] * starts[:, 1]
    area = cross.sum() / 2
    centroid = vertices[0] + cross @ (starts + ends) / (6 * area)
    return _Moments(float(area), centroid)
