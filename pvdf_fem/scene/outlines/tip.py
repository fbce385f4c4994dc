"""Rounded tips: the height over the film's plane of a rigid probe.

A tip is the region that a ball covers which rolls over a flat face: over a point it is a sphere,
over a disc or a polygon it is a flat face with a rounded edge. The height over its lowest point is
z = rho - sqrt(rho^2 - d^2) at the distance d from the face, where rho is the radius of the ball. A
tip of another kind is a class with its own distances.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.polygon import Polygon

#: Share of the edge's radius up to which the height follows the ball. Farther out a parabola keeps
#: the heights finite for iterates there.
STEEPEST = 0.99


class Distances(NamedTuple):
    """Distances from a flat face at n points."""

    value: Array  #: In m, (n,).
    normal: Array  #: Gradient, (n, 2).
    curvature: Array  #: Curvature of the lines of equal distance in 1/m, (n,).


class Height(NamedTuple):
    """Height over the lowest point of a tip at n points."""

    value: Array  #: In m, (n,).
    slope: Array  #: Gradient, (n, 2).
    hessian: Array  #: In 1/m, (n, 2, 2).


class Tip(ABC):
    """A rigid tip above the film."""

    radius: float  #: Radius of the rounding in m.

    @abstractmethod
    def compute_distances(self, points: Array) -> Distances:
        """Compute the distances of points (n, 2) in m from the face; zero on it."""

    @abstractmethod
    def make_offset_outline(self, distance: float) -> Outline:
        """Make the outline around the points nearer to the face than a distance in m."""

    @abstractmethod
    def fit_outline(self, points: Array) -> Outline:
        """Fit an outline to points (n, 2) in m about the face, ordered counter-clockwise."""

    @abstractmethod
    def move(self, motion: Array, stretch: float) -> Self:
        """Return the tip moved by `motion` (2,) in m, its face larger by the factor 1 + stretch."""

    @property
    @abstractmethod
    def face(self) -> Outline | None:
        """The outline of the flat face, where the tip's curvature jumps; a sphere has none."""

    @property
    @abstractmethod
    def face_perimeter(self) -> float:
        """Length of the face's outline in m; 0 for a sphere."""

    def compute_profile(self, distances: Array) -> tuple[Array, Array, Array]:
        """Compute the height over the lowest point as a function of the distance from the face.

        Parameters
        ----------
        distances : ndarray, shape (n,)
            In m; 0 on the face.

        Returns
        -------
        value, first, second : ndarray, shape (n,)
            Height in m with its first and second derivatives.
        """
        largest = STEEPEST * self.radius
        on_ball = np.clip(distances, 0.0, largest)
        root = np.sqrt(self.radius**2 - on_ball**2)
        beyond = np.maximum(distances - largest, 0.0)
        second = self.radius**2 / root**3
        first = on_ball / root + second * beyond
        value = self.radius - root + (first - 0.5 * second * beyond) * beyond
        return value, first, second

    def compute_height(self, points: Array) -> Height:
        """Compute the height of the tip at points (n, 2) in m."""
        distances = self.compute_distances(points)
        d = distances.value
        n = distances.normal
        value, first, second = self.compute_profile(d)
        normal = n[:, :, None] * n[:, None, :]
        across = np.where(d > 0.0, first * distances.curvature, 1.0 / self.radius)
        is_curved = (d > 0.0) | (distances.curvature > 0.0)
        transverse = is_curved[:, None, None] * across[:, None, None] * (np.eye(2) - normal)
        hessian = second[:, None, None] * normal + transverse
        return Height(value, first[:, None] * n, hessian=hessian)


@dataclass(frozen=True, eq=False)
class DiscTip(Tip):
    """A disc with a rounded edge, or a sphere.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        In m.
    radius : float
        Radius of the rounding in m.
    face_radius : float
        Radius of the flat face in m; 0 for a sphere.
    """

    centre: Array
    radius: float
    face_radius: float = 0.0

    def move(self, motion: Array, stretch: float) -> DiscTip:
        """Return the tip moved by `motion` (2,) in m, its face larger by the factor 1 + stretch."""
        face_radius = (1.0 + stretch) * self.face_radius
        return replace(self, centre=self.centre + motion, face_radius=face_radius)

    @property
    def face(self) -> Circle | None:
        """The outline of the flat face; None for a sphere."""
        return Circle(self.centre, self.face_radius) if self.face_radius else None

    @property
    def face_perimeter(self) -> float:
        """Length of the face's outline in m; 0 for a sphere."""
        return 2.0 * np.pi * self.face_radius

    def compute_distances(self, points: Array) -> Distances:
        """Compute the distances of points (n, 2) in m from the face; zero on it."""
        offsets = points - self.centre
        r = np.linalg.norm(offsets, axis=1)
        is_outside = (r > self.face_radius) & (r > 0.0)
        safe_r = np.where(is_outside, r, 1.0)
        # a sphere is curved at its lowest point as everywhere: a finite curvature marks that
        curvature_inside = 1.0 if self.face_radius == 0.0 else 0.0
        curvature = np.where(is_outside, 1.0 / safe_r, curvature_inside)
        normal = np.where(is_outside[:, None], offsets / safe_r[:, None], 0.0)
        value = np.where(is_outside, r - self.face_radius, 0.0)
        return Distances(value, normal, curvature=curvature)

    def make_offset_outline(self, distance: float) -> Circle:
        """Make the circle around the points nearer to the face than a distance in m."""
        return Circle(self.centre, self.face_radius + distance)

    def fit_outline(self, points: Array) -> Ellipse:
        """Fit an ellipse to points (n, 2) in m, by least squares of a conic's equation.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            In m.

        Returns
        -------
        Ellipse

        Notes
        -----
        In units of the mean distance from the centre the conic is
        x² + y² + a (x² - y²) + 2 b x y + c x + d y + e = 0.
        """
        scale = float(np.linalg.norm(points - self.centre, axis=1).mean())
        x, y = ((points - self.centre) / scale).T
        columns = np.stack([x * x - y * y, 2.0 * x * y, x, y, np.ones_like(x)], axis=-1)
        a, b, c, d, e = np.linalg.lstsq(columns, -(x * x + y * y), rcond=None)[0]
        form = np.array([[1.0 + a, b], [b, 1.0 - a]])
        middle = -0.5 * np.linalg.solve(form, [c, d])
        level = middle @ form @ middle - e
        values, vectors = np.linalg.eigh(form)
        first, second = np.sqrt(level / values)
        centre = self.centre + scale * middle
        return Ellipse(centre, scale * first * vectors[:, 0], second=float(scale * second))


class _Sides(NamedTuple):
    """The sides of a polygon."""

    starts: Array  #: In m, (sides, 2).
    vectors: Array  #: From start to end in m, (sides, 2).


@dataclass(frozen=True, eq=False)
class PolygonTip(Tip):
    """A convex polygon with a rounded edge.

    Parameters
    ----------
    polygon : Polygon
        The flat face.
    radius : float
        Radius of the rounding in m.
    """

    polygon: Polygon
    radius: float

    def move(self, motion: Array, stretch: float) -> PolygonTip:
        """Return the tip moved by `motion` (2,) in m, its face larger by the factor 1 + stretch."""
        vertices = self.polygon.vertices
        offsets = vertices - self.polygon.centroid
        return replace(self, polygon=Polygon(vertices + motion + stretch * offsets))

    @property
    def face(self) -> Polygon:
        """The outline of the flat face."""
        return self.polygon

    @property
    def face_perimeter(self) -> float:
        """Length of the face's outline in m."""
        return self.polygon.perimeter

    @cached_property
    def _sides(self) -> _Sides:
        starts = self.polygon.vertices
        return _Sides(starts, np.roll(starts, -1, axis=0) - starts)

    def compute_distances(self, points: Array) -> Distances:
        """Compute the distances of points (n, 2) in m from the face; zero on it."""
        starts, vectors = self._sides
        offsets = points[:, None] - starts
        along = (offsets * vectors).sum(axis=-1) / (vectors**2).sum(axis=-1)
        nearest = starts + np.clip(along, 0.0, 1.0)[..., None] * vectors
        distances = np.linalg.norm(points[:, None] - nearest, axis=-1)
        rows = np.arange(len(points))
        side = distances.argmin(axis=1)
        distance = distances[rows, side]
        foot = nearest[rows, side]
        position = along[rows, side]  # on the side, from 0 to 1

        is_left_of_side = vectors[:, 0] * (points[:, None, 1] - starts[:, 1]) >= vectors[:, 1] * (
            points[:, None, 0] - starts[:, 0]
        )
        is_outside = ~is_left_of_side.all(axis=1) & (distance > 0.0)
        value = np.where(is_outside, distance, 0.0)
        safe_value = np.where(is_outside, value, 1.0)
        is_at_corner = is_outside & ((position <= 0.0) | (position >= 1.0))
        normal = np.where(is_outside[:, None], (points - foot) / safe_value[:, None], 0.0)
        return Distances(value, normal, curvature=is_at_corner / safe_value)

    def make_offset_outline(self, distance: float) -> Polygon:
        """Make a polygon around the points nearer to the face than a distance in m."""
        offset = self.polygon.inscribed_polygon.buffer(distance, quad_segs=4)
        return _simplify(offset, distance)

    def fit_outline(self, points: Array) -> Polygon:
        """Fit a polygon with few corners to points (n, 2) in m, ordered counter-clockwise."""
        shape = shapely.Polygon(points)
        if not shape.is_valid:  # gmsh does not end on sides that cross at a narrow corner
            shape = max(shapely.get_parts(shape.buffer(0.0)), key=shapely.area)
        return _simplify(shape, float(self.compute_distances(points).value.mean()))


def _simplify(shape: shapely.Polygon, width: float, detail: float = 0.03) -> Polygon:
    """Make a polygon with few corners from a shape.

    Parameters
    ----------
    shape : shapely.Polygon
        In m.
    width : float
        Width of a strip in m, of which sides move by at most the share `detail`.
    detail : float
        Share of the width by which a side may move.

    Returns
    -------
    Polygon
    """
    return Polygon(np.array(shape.simplify(detail * width).exterior.coords)[:-1])


def make_tip(outline: Outline, edge_radius_mm: float | None) -> Tip:
    """Make the rigid tip of a probe.

    Parameters
    ----------
    outline : Outline
        Outline of the probe in m.
    edge_radius_mm : float or None
        Radius of its rounded edge, of a sphere the sphere's radius.

    Returns
    -------
    Tip

    Raises
    ------
    ValueError
        With the reason, for an outline that is no tip.
    """
    radius = (edge_radius_mm or 0.0) / 1e3
    if not radius:
        raise ValueError("has a sharp edge")
    if isinstance(outline, Circle) and outline.radius >= radius:
        return DiscTip(outline.centre, radius, face_radius=outline.radius - radius)
    if isinstance(outline, Polygon):
        polygon = outline.inscribed_polygon
        face = polygon.buffer(-radius, join_style="mitre")
        if not np.isclose(polygon.convex_hull.area, outline.area, rtol=1e-9):
            raise ValueError("is not a tip, since it is not convex")
        if not face.is_empty:
            return PolygonTip(Polygon(np.array(face.exterior.coords)[:-1]), radius)
    if isinstance(outline, Circle | Polygon):
        raise ValueError(f"leaves no flat face with an edge of {1e3 * radius:g} mm")
    raise ValueError("cannot have a rounded edge; choose a circle or a polygon")
