"""Common interface of the outlines of probes, electrodes and patches.

Coordinates are in m, with the origin at the film's centre. Area, centroid and reach are exact
rather than those of an approximating polygon. The shapes in `pvdf_fem.scene.shapes` make outlines
from their sizes.
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
from pvdf_fem.scene.outlines.arc import Arc

#: Relative tolerance of lengths: points closer than this fraction of their distance from the film's
#: centre count as equal.
LENGTH_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Line:
    """A straight piece of a boundary."""

    start: Array  #: In m, shape (2,).
    end: Array  #: In m, shape (2,).


@dataclass(frozen=True, eq=False)
class EllipseCurve:
    """A whole ellipse as a boundary."""

    centre: Array  #: In m, shape (2,).
    axes: Array  #: The two semi-axes in m as orthogonal columns, shape (2, 2).


class Outline(ABC):
    """A closed curve in the plane of the film."""

    @property
    def corners(self) -> Array:
        """Corners in m, counter-clockwise, shape (n, 2); a smooth outline has none."""
        return np.empty((0, 2))

    @property
    @abstractmethod
    def area(self) -> float:
        """Area in m²."""

    @cached_property
    def perimeter(self) -> float:
        """Length of the outline in m, for curved outlines by quadrature."""
        _, normals = self.make_boundary_rule(1024 if self.is_curved else 1)
        return float(np.linalg.norm(normals, axis=1).sum())

    @property
    def hydraulic_radius(self) -> float:
        """Twice the area divided by the perimeter, in m: the radius of a circle.

        Of a slender outline it is nearly its width.
        """
        return 2.0 * self.area / self.perimeter

    @property
    def longest_side(self) -> float:
        """Length in m of the longest of the parts to which the boundary's rule gives points.

        A closed curve has four parts.
        """
        return self.perimeter / 4.0

    @property
    @abstractmethod
    def centroid(self) -> Array:
        """Centroid in m, shape (2,)."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Maximum distance of the outline's points from the film's centre, in m."""

    @property
    @abstractmethod
    def lower_left(self) -> Array:
        """Minimum x and minimum y in m, shape (2,)."""

    @property
    @abstractmethod
    def defining_points(self) -> Array:
        """Points in m that define the outline within its class, shape (n, 2).

        Some classes need `defining_length`, too. A closed sequence of points is counter-clockwise.
        """

    @property
    def defining_length(self) -> float:
        """Length in m that `defining_points` do not determine, such as a circle's radius, or 0."""
        return 0.0

    @property
    @abstractmethod
    def boundary(self) -> tuple[Line | Arc | EllipseCurve, ...]:
        """The pieces of the boundary, each of which begins at the end of the one before."""

    @property
    def is_curved(self) -> bool:
        """Whether a piece of the boundary is curved."""
        return not all(isinstance(piece, Line) for piece in self.boundary)

    @property
    @abstractmethod
    def inscribed_polygon(self) -> shapely.Polygon:
        """A polygon whose corners are on the outline; a polygonal outline itself."""

    @cached_property
    def equal_area_polygon(self) -> shapely.Polygon:
        """The inscribed polygon, enlarged about the centroid to the area of the outline."""
        inscribed = self.inscribed_polygon
        factor = float(np.sqrt(self.area / inscribed.area))
        x, y = self.centroid.tolist()
        return affinity.scale(inscribed, factor, factor, origin=(x, y))

    @abstractmethod
    def transform(self, frame: Array, shift: Array | float = 0.0) -> Self:
        """Return a copy that is transformed by the map x -> frame x + shift.

        Parameters
        ----------
        frame : ndarray, shape (2, 2)
            An orthogonal matrix: a rotation or a reflection.
        shift : ndarray, shape (2,), or float
            Translation in m.

        Returns
        -------
        Outline
            Of the same class.
        """

    @abstractmethod
    def compute_signed_distances(self, points: Array) -> Array:
        """Compute distances from the boundary, negative inside.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m.

        Returns
        -------
        ndarray, shape (n,)
            Distances in m, correct to first order close to the boundary and with the correct sign
            everywhere.
        """

    @abstractmethod
    def compute_depth_in(self, other: Outline) -> float:
        """Compute how far the boundary of this outline extends into another outline.

        Parameters
        ----------
        other : Outline
            The outline in whose interior the depth is measured, from its boundary inwards.

        Returns
        -------
        float
            Maximum depth in m of the boundary's points, negative if all are outside.

        Notes
        -----
        `has_overlap` uses the larger of both outlines' depths to detect overlaps that are only
        slightly larger than round-off. Polygons compute the depth of their corners only: if the
        other outline penetrates a side between corners, the depth of the other outline is larger.
        """

    @property
    def centred_radius(self) -> float | None:
        """Radius in m of a circle about the film's centre, None for any other outline."""
        return None

    def compute_excess(self, other: Outline) -> float:
        """Compute how far the boundary of this outline extends beyond another outline.

        Parameters
        ----------
        other : Outline
            The outline outside of which the excess is measured, from its boundary outwards.

        Returns
        -------
        float
            Maximum distance in m of the boundary's points from the other outline, negative if all
            are inside.

        Notes
        -----
        Polygons compute the excess of their corners only. If the other outline is not convex, their
        sides may leave it between the corners; `is_within` considers this.
        """
        if other.centred_radius is not None:  # the rim of most films, which needs no search
            return self.reach - other.centred_radius
        return self._find_excess(other)

    @abstractmethod
    def _find_excess(self, other: Outline) -> float:
        """Find the excess beyond an outline of any shape; see `compute_excess`."""

    def compute_arc_midpoints(self, starts: Array, ends: Array) -> Array:
        """Compute the midside nodes of quadratic elements on a curved boundary.

        With these nodes, the elements together have the area of the outline.

        Subclasses with curved boundaries override this method.

        Parameters
        ----------
        starts, ends : ndarray, shape (n, 2)
            Ends of element sides on a curved piece of the boundary, in m.

        Returns
        -------
        ndarray, shape (n, 2)
            Midside nodes in m.

        Raises
        ------
        NotImplementedError
            If the boundary has no curved pieces.
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
            Quadrature points in m.
        normals : ndarray, shape (n, 2)
            Outward unit normals multiplied by the quadrature weights in m.
        """

    def coincides(self, other: Outline, slack: float) -> bool:
        """Return whether another outline has the same class and the same geometry.

        Parameters
        ----------
        other : Outline
            The outline to compare with; its `defining_points` may start at another point.
        slack : float
            Maximum difference in m of each coordinate of the defining points, and of the defining
            length.

        Returns
        -------
        bool
        """
        points = self.defining_points
        other_points = other.defining_points
        if type(self) is not type(other) or len(points) != len(other_points):
            return False
        # the point of the other outline that is nearest to the first point of this one
        first = np.abs(other_points - points[0]).max(axis=1).argmin()
        offsets = np.roll(other_points, -first, axis=0) - points
        length_offset = abs(self.defining_length - other.defining_length)
        return bool(max(np.abs(offsets).max(), length_offset) <= slack)

    def make_signature(self, unit: float, digits: int) -> tuple[str | float, ...]:
        """Make a tuple that is equal for outlines that agree up to the rounding of lengths.

        Parameters
        ----------
        unit : float
            Length in m that is the unit of the rounded lengths.
        digits : int
            Number of decimals to which lengths in this unit are rounded.

        Returns
        -------
        tuple of str and float
            Name of the class, `defining_length`, and the coordinates of `defining_points`, all in
            `unit`. The points start from the one with the smallest x, and of these the smallest y.
        """
        # the sum turns -0.0 into 0.0, which has another text
        rounded = (np.round(self.defining_points / unit, digits) + 0.0).tolist()
        first = rounded.index(min(rounded))
        points = rounded[first:] + rounded[:first]
        coordinates = np.ravel(points).tolist()
        return (type(self).__name__, round(self.defining_length / unit, digits), *coordinates)


def has_overlap(a: Outline, b: Outline) -> bool:
    """Return whether the interiors of two outlines intersect.

    Outlines that only touch do not overlap; nor do those that intersect by less than the fraction
    `LENGTH_TOLERANCE` of their distance from the film's centre.
    """
    polygon_a = a.inscribed_polygon
    polygon_b = b.inscribed_polygon
    # far apart: this margin is much larger than the distance between an arc and its chord
    if not shapely.dwithin(polygon_a, polygon_b, 1e-4 * (a.perimeter + b.perimeter)):
        return False
    slack = LENGTH_TOLERANCE * max(a.reach, b.reach)
    common = polygon_a.intersection(polygon_b)
    # 2 area / perimeter estimates the width of a narrow intersection, whatever its length
    if 2.0 * common.area > slack * common.length:
        return True
    # the polygons do not intersect if the outlines overlap only between arcs and their chords
    return max(a.compute_depth_in(b), b.compute_depth_in(a)) > slack


def is_within(inner: Outline, outer: Outline) -> bool:
    """Return whether an outline lies inside of another one, which it may touch.

    It may extend beyond the other one by the fraction `LENGTH_TOLERANCE` of the larger distance
    from the film's centre.
    """
    slack = LENGTH_TOLERANCE * max(inner.reach, outer.reach)
    if inner.compute_excess(outer) > slack:
        return False
    if outer.centred_radius is not None:
        return True
    # a side may leave an outer outline that is not convex between two corners that are inside
    outside = inner.inscribed_polygon.difference(outer.inscribed_polygon)
    parts = shapely.get_parts(outside)
    points = shapely.get_coordinates(shapely.point_on_surface(parts))
    return not (outer.compute_signed_distances(points) > slack).any()


def average_over(
    region: shapely.Geometry, field: Callable[[Array], Array], lines: int = 24
) -> float:
    """Compute the approximate mean of a field over a region, from its values on a grid.

    Parameters
    ----------
    region : shapely.Geometry
        The region, with coordinates in m.
    field : callable
        Function that maps points in m, an ndarray of shape (n, 2), to values of shape (n,).
    lines : int
        Number of cells of the grid along x and along y. The field is evaluated at those centres of
        cells that are in the region, or at one point of the region if there are none.

    Returns
    -------
    float
        Mean in the unit of the field.
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
    points : array_like, shape (..., 2)
        Points in any unit.
    angle_deg : float
        Angle in degrees.

    Returns
    -------
    ndarray, shape (..., 2)
        Rotated points in the same unit.
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
