"""Common interface of probe and electrode outlines, in metres in the film's plane.

The origin is the film's centre. Areas, centroids and reaches are exact, without an approximating
polygon. A new shape is a file beside this file, with a subclass of `Outline`, its table in scene
files (`Shape`), and a line in `pvdf_fem.scene.shapes`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import affinity

from pvdf_fem.arrays import Array

#: Lengths closer than this, relative to the distance from the film's centre, count as equal.
LENGTH_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Line:
    """A straight boundary piece between two points (2,) in m."""

    start: Array
    end: Array


@dataclass(frozen=True, eq=False)
class EllipseCurve:
    """A whole ellipse as a boundary."""

    centre: Array  #: In m, (2,).
    axes: Array  #: The two semi-axes in m, as orthogonal columns, (2, 2).


class Outline(ABC):
    """The outline of a probe or an electrode."""

    @property
    def corners(self) -> Array:
        """Corners (n, 2) in m, counter-clockwise; a smooth outline has none."""
        return np.empty((0, 2))

    @property
    def size(self) -> float:
        """A length in m by which outlines with equal class and `defining_points` may differ."""
        return 0.0

    @property
    @abstractmethod
    def area(self) -> float:
        """Area in m²."""

    @cached_property
    def perimeter(self) -> float:
        """Length of the outline in m."""
        _, normals = self.boundary_rule(1 if len(self.corners) else 1024)
        return float(np.linalg.norm(normals, axis=1).sum())

    @property
    @abstractmethod
    def centroid(self) -> Array:
        """Centroid, shape (2,), in m."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest distance of a point of the outline from the film's centre, in m."""

    @property
    @abstractmethod
    def lower_left(self) -> Array:
        """Least x and least y, shape (2,), in m."""

    @property
    @abstractmethod
    def defining_points(self) -> Array:
        """Points (n, 2) in m, counter-clockwise, that fix an outline with this class and `size`."""

    @property
    @abstractmethod
    def boundary(self) -> tuple[Line | EllipseCurve, ...]:
        """The boundary pieces, end to end."""

    @property
    @abstractmethod
    def shape(self) -> shapely.Polygon:
        """The outline for shapely: an inscribed polygon."""

    @abstractmethod
    def transform(self, frame: Array, shift: Array | float = 0.0) -> Self:
        """The outline after the map x -> frame x + shift with an orthogonal matrix (2, 2)."""

    @abstractmethod
    def signed_distance(self, points: Array) -> Array:
        """Distances (n,) in m of points (n, 2) from the boundary, negative inside. They are exact
        to first order next to the boundary, and have the right sign anywhere."""

    @abstractmethod
    def compute_depth_in(self, other: Outline) -> float:
        """How deep this boundary reaches into another outline, in m; negative outside. It is taken
        where two outlines only touch but for rounding; there a polygon dips with its corners, and
        into its sides the other outline dips."""

    def arc_middles(self, starts: Array, ends: Array) -> Array:
        """Midside nodes (n, 2) in m that give curved elements the area of a smooth outline.
        `starts` and `ends` (n, 2) belong to their sides on a curved boundary piece."""
        raise NotImplementedError

    @abstractmethod
    def boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Points (n, 2) in m and outward normals (n, 2) times weights in m along the boundary.
        `count` points are taken along a side of a polygon or a quarter of a closed curve."""

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """A polygon with exactly the outline's area."""
        grown = float(np.sqrt(self.area / self.shape.area))
        x, y = self.centroid.tolist()
        return affinity.scale(self.shape, grown, grown, origin=(x, y))

    def coincides(self, other: Outline, slack: float) -> bool:
        """Whether another outline is the same, to `slack` in m in each coordinate."""
        if type(self) is not type(other) or len(self.defining_points) != len(other.defining_points):
            return False
        first = np.abs(other.defining_points - self.defining_points[0]).max(axis=1).argmin()
        apart = np.roll(other.defining_points, -first, axis=0) - self.defining_points
        return bool(max(np.abs(apart).max(), abs(self.size - other.size)) <= slack)

    def signature(self, unit: float, digits: int) -> tuple[str | float, ...]:
        """Values that are equal for outlines that cover the same points, after rounding lengths to
        `digits` after the point in units of `unit` m."""
        rounded = (np.round(self.defining_points / unit, digits) + 0.0).tolist()
        first = rounded.index(min(rounded))
        ordered = [x for point in rounded[first:] + rounded[:first] for x in point]
        return (type(self).__name__, round(self.size / unit, digits), *ordered)


def has_overlap(a: Outline, b: Outline) -> bool:
    """Whether the interiors of two outlines meet; outlines that touch do not overlap."""
    # chords are much nearer to their arcs
    if not shapely.dwithin(a.shape, b.shape, 1e-4 * (a.perimeter + b.perimeter)):
        return False
    slack = LENGTH_TOLERANCE * max(a.reach, b.reach)
    common = a.shape.intersection(b.shape)
    # 2 area / perimeter measures the width of the common part, however long it is
    if 2.0 * common.area > slack * common.length:
        return True
    # what the polygons do not show is between arcs and their chords
    return max(a.compute_depth_in(b), b.compute_depth_in(a)) > slack


def average_over(
    shape: shapely.Geometry, field: Callable[[Array], Array], lines: int = 24
) -> float:
    """Approximate mean over a shape, in m, for a field (n,) at points (n, 2): on a raster with
    `lines` by `lines` cells, or at a single point for a shape between cells."""
    low, high = np.reshape(shape.bounds, (2, 2))
    grid = low + (high - low) * (np.indices((lines, lines)).reshape(2, -1).T + 0.5) / lines
    inside = grid[shapely.contains_xy(shape, grid)]
    one = shapely.get_coordinates(shapely.point_on_surface(shape))
    return float(field(inside if len(inside) else one).mean())


def rotate(points: ArrayLike, angle_deg: float) -> Array:
    """Points, shape (..., 2), turned counter-clockwise about the origin; quarters are exact."""
    quarters, remainder = divmod(angle_deg, 90.0)
    c, s = np.cos(np.radians(remainder)), np.sin(np.radians(remainder))
    for _ in range(int(quarters % 4)):
        c, s = -s, c
    x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)
