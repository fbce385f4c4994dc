"""Outlines of probes and electrodes, in metres in the plane of the film.

The origin is the film's centre. Areas, centroids and reaches are exact formulas, not those of an
approximating polygon; shapely only answers questions about pairs of polygons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

#: Lengths closer than this, relative to the distance from the film's centre, are the same:
#: outlines that overlap by less only touch.
TOUCH = 1e-9

#: Details of a ring smaller than this, relative to its extent, cannot be meshed.
DETAIL = 1e-6


@dataclass(frozen=True, eq=False)
class Polygon:
    """A simple polygon.

    Parameters
    ----------
    vertices : array_like, shape (n, 2)
        Corners in metres, in either orientation; stored counter-clockwise and read-only.
    """

    vertices: NDArray[np.float64]

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=float)
        if _moments(vertices)[0] < 0:
            vertices = vertices[::-1].copy()
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)

    @cached_property
    def area(self) -> float:
        """Area in m²."""
        return _moments(self.vertices)[0]

    @cached_property
    def perimeter(self) -> float:
        """Length of the outline in m."""
        edges = self.vertices - np.roll(self.vertices, 1, axis=0)
        return float(np.linalg.norm(edges, axis=1).sum())

    @cached_property
    def centroid(self) -> NDArray[np.float64]:
        """Centroid, shape (2,), in m."""
        return _moments(self.vertices)[1]

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point of the outline from the film's centre, in m."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def lowest(self) -> NDArray[np.float64]:
        """Least x and least y, shape (2,), in m."""
        return self.vertices.min(axis=0)

    @cached_property
    def shape(self) -> shapely.Polygon:
        """The same polygon for shapely."""
        return shapely.Polygon(self.vertices)


@dataclass(frozen=True, eq=False)
class Circle:
    """A disc.

    Parameters
    ----------
    centre : array_like, shape (2,)
        Centre in metres, stored read-only.
    radius : float
        Radius in metres.
    """

    centre: NDArray[np.float64]
    radius: float

    def __post_init__(self) -> None:
        centre = np.array(self.centre, dtype=float)
        centre.setflags(write=False)
        object.__setattr__(self, "centre", centre)

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(np.pi * self.radius**2)

    @property
    def perimeter(self) -> float:
        """Length of the outline in m."""
        return float(2.0 * np.pi * self.radius)

    @property
    def centroid(self) -> NDArray[np.float64]:
        """Centroid, shape (2,), in m."""
        return self.centre

    @property
    def reach(self) -> float:
        """Largest distance of a point of the disc from the film's centre, in m."""
        return float(np.linalg.norm(self.centre) + self.radius)

    @property
    def lowest(self) -> NDArray[np.float64]:
        """Least x and least y, shape (2,), in m."""
        return self.centre - self.radius

    @cached_property
    def shape(self) -> shapely.Polygon:
        """An inscribed polygon of 256 sides for shapely: good for pictures, not for predicates."""
        return shapely.Point(self.centre).buffer(self.radius, quad_segs=64)


Outline: TypeAlias = Polygon | Circle


def mapped(outline: Outline, frame: NDArray[np.float64]) -> Outline:
    """The outline after an orthogonal map, shape (2, 2), about the film's centre."""
    if isinstance(outline, Circle):
        return Circle(frame @ outline.centre, outline.radius)
    return Polygon(outline.vertices @ frame.T)


def overlaps(a: Outline, b: Outline) -> bool:
    """Whether the interiors of two outlines meet; outlines that touch do not overlap."""
    slack = TOUCH * max(a.reach, b.reach)
    if isinstance(a, Circle) and isinstance(b, Circle):
        return bool(np.linalg.norm(a.centre - b.centre) < a.radius + b.radius - slack)
    if isinstance(b, Circle):
        a, b = b, a
    if isinstance(a, Circle):
        # the distance is zero for a centre inside the polygon
        return bool(b.shape.distance(shapely.Point(a.centre)) < a.radius - slack)
    common = a.shape.intersection(b.shape)
    # 2 area / perimeter measures the width of the common part, however long it is
    return bool(2 * common.area > slack * common.length)


def turn(points: ArrayLike, angle_deg: float) -> NDArray[np.float64]:
    """Points, shape (..., 2), turned counter-clockwise about the origin; quarters are exact."""
    quarters, rest = divmod(angle_deg, 90.0)
    c, s = np.cos(np.radians(rest)), np.sin(np.radians(rest))
    for _ in range(int(quarters % 4)):
        c, s = -s, c
    x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def rectangle(width: float, height: float) -> NDArray[np.float64]:
    """Corners, shape (4, 2), of a rectangle about the origin with its width along x."""
    x, y = width / 2, height / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def triangle(side: float) -> NDArray[np.float64]:
    """Corners, shape (3, 2), of an equilateral triangle about the origin, one corner on +y."""
    height = side * np.sqrt(3.0) / 2
    return np.array([[0.0, 2 * height / 3], [-side / 2, -height / 3], [side / 2, -height / 3]])


def defect(vertices: Sequence[Sequence[float]]) -> str | None:
    """Why vertices, in any unit, are not those of a simple polygon that can be meshed, or None."""
    points = np.asarray(vertices, dtype=float)
    extent = float(np.ptp(points, axis=0).max())
    detail = DETAIL * extent
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


def _moments(vertices: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Signed area and centroid by Green's theorem, about the first vertex against cancellation."""
    here = vertices - vertices[0]
    there = np.roll(here, -1, axis=0)
    cross = here[:, 0] * there[:, 1] - there[:, 0] * here[:, 1]
    area = cross.sum() / 2
    return float(area), vertices[0] + cross @ (here + there) / (6 * area)
