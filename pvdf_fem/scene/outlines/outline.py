"""Common interface of the outlines of probes, electrodes and patches, in metres.

The origin is the film's centre. Areas, centroids and reaches are exact, without an approximating
polygon. The shapes in `pvdf_fem.scene.shapes` make outlines from their sizes.
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
    """A straight piece of a boundary between two points (2,) in m."""

    start: Array
    end: Array


@dataclass(frozen=True, eq=False)
class EllipseCurve:
    """A whole ellipse as a boundary."""

    centre: Array  #: In m, (2,).
    axes: Array  #: The two semi-axes in m, as orthogonal columns, (2, 2).


class Outline(ABC):
    """A closed curve in the plane of the film."""

    @property
    def corners(self) -> Array:
        """Corners (n, 2) in m, counter-clockwise; a smooth outline has none."""
        return np.empty((0, 2))

    @property
    @abstractmethod
    def area(self) -> float:
        """Area in m²."""

    @cached_property
    def perimeter(self) -> float:
        """Length of the outline in m."""
        _, normals = self.make_boundary_rule(1024 if self.is_curved else 1)
        return float(np.linalg.norm(normals, axis=1).sum())

    @property
    @abstractmethod
    def centroid(self) -> Array:
        """Centroid (2,) in m."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest distance of a point of the outline from the film's centre, in m."""

    @property
    @abstractmethod
    def lower_left(self) -> Array:
        """Least x and least y (2,) in m."""

    @property
    @abstractmethod
    def defining_points(self) -> Array:
        """Points (n, 2) in m, counter-clockwise.

        They and `defining_length` define an outline among those of its class.
        """

    @property
    def defining_length(self) -> float:
        """A length in m, such as the radius of a circle; 0 where the points are enough."""
        return 0.0

    @property
    @abstractmethod
    def boundary(self) -> tuple[Line | EllipseCurve, ...]:
        """The pieces of the boundary, end to end."""

    @property
    def is_curved(self) -> bool:
        """Whether a piece of the boundary is curved."""
        return not all(isinstance(piece, Line) for piece in self.boundary)

    @property
    @abstractmethod
    def inscribed_polygon(self) -> shapely.Polygon:
        """A polygon with its corners on the outline."""

    @cached_property
    def equal_area_polygon(self) -> shapely.Polygon:
        """A polygon with exactly the outline's area."""
        inscribed = self.inscribed_polygon
        factor = float(np.sqrt(self.area / inscribed.area))
        x, y = self.centroid.tolist()
        return affinity.scale(inscribed, factor, factor, origin=(x, y))

    @abstractmethod
    def transform(self, frame: Array, shift: Array | float = 0.0) -> Self:
        """Return the outline after the map x -> frame x + shift.

        Parameters
        ----------
        frame : ndarray, shape (2, 2)
            An orthogonal matrix: a rotation or a reflection.
        shift : ndarray, shape (2,) or float
            In m.

        Returns
        -------
        Outline
        """

    @abstractmethod
    def compute_signed_distances(self, points: Array) -> Array:
        """Compute distances from the boundary, negative inside.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            In m.

        Returns
        -------
        ndarray, shape (n,)
            In m. Distances are exact to first order next to the boundary, and have the right sign
            everywhere.
        """

    @abstractmethod
    def compute_depth_in(self, other: Outline) -> float:
        """Compute how deep the boundary reaches into another outline, in m; negative outside.

        Notes
        -----
        The depth is needed where two outlines overlap by little more than rounding. There a polygon
        reaches in with its corners; where the other outline reaches into the sides of the polygon,
        that outline has the larger depth.
        """

    def compute_arc_midpoints(self, starts: Array, ends: Array) -> Array:
        """Compute midside nodes that give curved elements the area of a curved outline.

        Parameters
        ----------
        starts, ends : ndarray, shape (n, 2)
            Ends in m of the elements' sides on a curved piece of the boundary.

        Returns
        -------
        ndarray, shape (n, 2)
            In m.
        """
        raise NotImplementedError

    @abstractmethod
    def make_boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Make a quadrature rule on the boundary.

        Parameters
        ----------
        count : int
            Number of points along a side of a polygon, or a quarter of a closed curve.

        Returns
        -------
        points : ndarray, shape (n, 2)
            In m.
        normals : ndarray, shape (n, 2)
            Outward unit normals times weights in m.
        """

    def coincides(self, other: Outline, slack: float) -> bool:
        """Return whether another outline is the same, to `slack` in m in each coordinate."""
        points = self.defining_points
        other_points = other.defining_points
        if type(self) is not type(other) or len(points) != len(other_points):
            return False
        first = np.abs(other_points - points[0]).max(axis=1).argmin()
        offsets = np.roll(other_points, -first, axis=0) - points
        length_offset = abs(self.defining_length - other.defining_length)
        return bool(max(np.abs(offsets).max(), length_offset) <= slack)

    def make_signature(self, unit: float, digits: int) -> tuple[str | float, ...]:
        """Make values that are equal for outlines that cover the same points.

        Parameters
        ----------
        unit : float
            Unit of lengths in m.
        digits : int
            Number of decimals to which lengths are rounded in this unit.

        Returns
        -------
        tuple of str and float
            Class, `defining_length`, and `defining_points` from the least one on.
        """
        rounded = (np.round(self.defining_points / unit, digits) + 0.0).tolist()
        first = rounded.index(min(rounded))
        points = rounded[first:] + rounded[:first]
        coordinates = np.ravel(points).tolist()
        return (type(self).__name__, round(self.defining_length / unit, digits), *coordinates)


def has_overlap(a: Outline, b: Outline) -> bool:
    """Return whether the interiors of two outlines meet; outlines that touch do not overlap."""
    polygon_a = a.inscribed_polygon
    polygon_b = b.inscribed_polygon
    # chords are much nearer to their arcs
    if not shapely.dwithin(polygon_a, polygon_b, 1e-4 * (a.perimeter + b.perimeter)):
        return False
    slack = LENGTH_TOLERANCE * max(a.reach, b.reach)
    common = polygon_a.intersection(polygon_b)
    # 2 area / perimeter measures the width of the common part, however long it is
    if 2.0 * common.area > slack * common.length:
        return True
    # an overlap between arcs and their chords is not seen by the polygons
    return max(a.compute_depth_in(b), b.compute_depth_in(a)) > slack


def average_over(
    region: shapely.Geometry, field: Callable[[Array], Array], lines: int = 24
) -> float:
    """Compute an approximate mean of a field over a region.

    Parameters
    ----------
    region : shapely.Geometry
        In m.
    field : callable
        From points (n, 2) in m to values (n,).
    lines : int
        Number of cells of a raster along x and along y. Where no centre of a cell is in the region,
        one point of the region is taken.

    Returns
    -------
    float
    """
    low, high = np.reshape(region.bounds, (2, 2))
    cells = np.indices((lines, lines)).reshape(2, -1).T
    centres = low + (high - low) * (cells + 0.5) / lines
    inside = centres[shapely.contains_xy(region, centres)]
    if len(inside) == 0:
        inside = shapely.get_coordinates(shapely.point_on_surface(region))
    return float(field(inside).mean())


def rotate(points: ArrayLike, angle_deg: float) -> Array:
    """Rotate points counter-clockwise about the origin; multiples of 90 degrees are exact.

    Parameters
    ----------
    points : ndarray, shape (..., 2)
        The points.
    angle_deg : float
        Angle in degrees.

    Returns
    -------
    ndarray, shape (..., 2)
    """
    quarters, remainder = divmod(angle_deg, 90.0)
    cosine = np.cos(np.radians(remainder))
    sine = np.sin(np.radians(remainder))
    for _ in range(int(quarters % 4)):
        cosine, sine = -sine, cosine
    coordinates = np.asarray(points, dtype=float)
    x = coordinates[..., 0]
    y = coordinates[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
