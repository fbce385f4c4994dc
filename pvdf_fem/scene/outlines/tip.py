"""Indenter tips: the height of a rigid, rounded probe as a function of the position.

The surface of a tip is the lower envelope of balls of radius rho whose lowest points lie on a flat
face. If the face is a point, the tip is a sphere; if it is a disc or a polygon, the tip has a flat
face with a rounded edge. At the distance d from the face, the height above the lowest point is
z = rho - sqrt(rho^2 - d^2). To add a kind of tip, write a class that computes these distances.
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

#: Distance from the face, as a fraction of rho, up to which the height is that of a ball. Farther
#: out a parabola continues the height, so that it is finite for all iterates of a solver.
MAX_RELATIVE_DISTANCE = 0.99


class Distances(NamedTuple):
    """Distances of n points from a flat face, with their derivatives."""

    value: Array  #: Distance in m, zero on the face, shape (n,).
    normal: Array  #: Gradient of the distance, zero on the face, shape (n, 2).
    curvature: Array  #: Curvature of the lines of equal distance in 1/m, shape (n,).


class Height(NamedTuple):
    """Height above the lowest point of a tip at n points, with its derivatives."""

    value: Array  #: Height in m, shape (n,).
    slope: Array  #: Gradient, shape (n, 2).
    hessian: Array  #: Second derivatives in 1/m, shape (n, 2, 2).


class Tip(ABC):
    """A rigid tip above the film."""

    radius: float  #: Radius rho of the rounding in m.

    @abstractmethod
    def compute_distances(self, points: Array) -> Distances:
        """Compute the distances of points from the face.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m.

        Returns
        -------
        Distances
        """

    @abstractmethod
    def make_offset_outline(self, distance: float) -> Outline:
        """Make the outline of the points at a distance in m from the face, or an approximation."""

    @abstractmethod
    def fit_outline(self, points: Array) -> Outline:
        """Fit an outline to points around the face, such as the edge of the contact area.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m in counter-clockwise order.

        Returns
        -------
        Outline
            An ellipse for a disc or a sphere, and a polygon for a polygon.
        """

    @abstractmethod
    def move(self, motion: Array, stretch: float) -> Self:
        """Return a copy that is moved, and whose face is enlarged about its centroid.

        Parameters
        ----------
        motion : ndarray, shape (2,)
            Displacement in m.
        stretch : float
            Relative increase of the face's lengths. The radius of the rounding does not change.

        Returns
        -------
        Tip
            Of the same class.
        """

    @property
    @abstractmethod
    def face(self) -> Outline | None:
        """Outline of the flat face in m, where the tip's curvature jumps; None for a sphere."""

    @property
    @abstractmethod
    def face_perimeter(self) -> float:
        """Length of the face's outline in m; 0 for a sphere."""

    def compute_profile(self, distances: Array) -> tuple[Array, Array, Array]:
        """Compute the height above the lowest point as a function of the distance from the face.

        Parameters
        ----------
        distances : ndarray, shape (n,)
            Distances in m; 0 on the face.

        Returns
        -------
        value : ndarray, shape (n,)
            Height in m.
        first, second : ndarray, shape (n,)
            First and second derivative with respect to the distance, the second one in 1/m.
        """
        largest = MAX_RELATIVE_DISTANCE * self.radius
        on_ball = np.clip(distances, 0.0, largest)
        root = np.sqrt(self.radius**2 - on_ball**2)
        beyond = np.maximum(distances - largest, 0.0)
        second = self.radius**2 / root**3
        first = on_ball / root + second * beyond
        value = self.radius - root + (first - 0.5 * second * beyond) * beyond
        return value, first, second

    def compute_height(self, points: Array) -> Height:
        """Compute the height of the tip's surface above its lowest point, with derivatives.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m in the plane of the film.

        Returns
        -------
        Height

        Notes
        -----
        With the distance d from the face, its gradient n, the curvature κ of the lines of equal
        distance and the height z(d), the Hessian is z'' n nᵀ + κ z' (I - n nᵀ). At the lowest point
        of a sphere it is I / rho, and on a flat face it is zero up to the jump at its edge.
        """
        distances = self.compute_distances(points)
        d = distances.value
        n = distances.normal
        value, first, second = self.compute_profile(d)
        normal = n[:, :, None] * n[:, None, :]
        # κ z' off the face; its limit 1 / rho counts only at the lowest point of a sphere
        across = np.where(d > 0.0, first * distances.curvature, 1.0 / self.radius)
        is_curved = (d > 0.0) | (distances.curvature > 0.0)
        transverse = is_curved[:, None, None] * across[:, None, None] * (np.eye(2) - normal)
        hessian = second[:, None, None] * normal + transverse
        return Height(value, first[:, None] * n, hessian=hessian)


@dataclass(frozen=True, eq=False)
class DiscTip(Tip):
    """A tip whose flat face is a disc with a rounded edge, or a sphere.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        Position of the centre in m.
    radius : float
        Radius rho of the rounded edge, or of the sphere, in m.
    face_radius : float
        Radius of the flat face in m; 0 for a sphere.
    """

    centre: Array
    radius: float
    face_radius: float = 0.0

    def move(self, motion: Array, stretch: float) -> DiscTip:
        """Return a copy that is moved and whose face is enlarged; see `Tip.move`."""
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
        """Compute the distances of points from the face; see `Tip.compute_distances`."""
        offsets = points - self.centre
        r = np.linalg.norm(offsets, axis=1)
        is_outside = (r > self.face_radius) & (r > 0.0)
        safe_r = np.where(is_outside, r, 1.0)
        # a positive curvature tells compute_height that a sphere is curved at its lowest point, too
        curvature_inside = 1.0 if self.face_radius == 0.0 else 0.0
        curvature = np.where(is_outside, 1.0 / safe_r, curvature_inside)
        normal = np.where(is_outside[:, None], offsets / safe_r[:, None], 0.0)
        value = np.where(is_outside, r - self.face_radius, 0.0)
        return Distances(value, normal, curvature=curvature)

    def make_offset_outline(self, distance: float) -> Circle:
        """Make the circle at a distance in m from the face."""
        return Circle(self.centre, self.face_radius + distance)

    def fit_outline(self, points: Array) -> Ellipse:
        """Fit an ellipse to points by linear least squares.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m, in any order.

        Returns
        -------
        Ellipse

        Notes
        -----
        The sum of the squared residuals of the conic's equation
        x² + y² + a (x² - y²) + 2 b x y + c x + d y + e = 0 is minimized over a to e. Here x
        and y are relative to the tip's centre, in units of the points' mean distance from it.
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

    starts: Array  #: In m, shape (sides, 2).
    vectors: Array  #: From start to end in m, shape (sides, 2).


@dataclass(frozen=True, eq=False)
class PolygonTip(Tip):
    """A tip whose flat face is a convex polygon with a rounded edge.

    Parameters
    ----------
    polygon : Polygon
        Outline of the flat face, without the rounded edge.
    radius : float
        Radius rho of the rounded edge in m.
    """

    polygon: Polygon
    radius: float

    def move(self, motion: Array, stretch: float) -> PolygonTip:
        """Return a copy that is moved and whose face is enlarged; see `Tip.move`."""
        vertices = self.polygon.vertices
        offsets = vertices - self.polygon.centroid
        return replace(self, polygon=Polygon(vertices + motion + stretch * offsets))

    @property
    def face(self) -> Polygon:
        """Outline of the flat face."""
        return self.polygon

    @property
    def face_perimeter(self) -> float:
        """Length of the face's outline in m."""
        return self.polygon.perimeter

    @cached_property
    def _sides(self) -> _Sides:
        """The sides of the face, counter-clockwise."""
        starts = self.polygon.vertices
        return _Sides(starts, np.roll(starts, -1, axis=0) - starts)

    def compute_distances(self, points: Array) -> Distances:
        """Compute the distances of points from the face; see `Tip.compute_distances`."""
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

        # the face is convex: a point is on it if it is to the left of all sides
        is_left_of_side = vectors[:, 0] * offsets[..., 1] >= vectors[:, 1] * offsets[..., 0]
        is_outside = ~is_left_of_side.all(axis=1) & (distance > 0.0)
        value = np.where(is_outside, distance, 0.0)
        safe_value = np.where(is_outside, value, 1.0)
        # lines of equal distance are arcs about a corner, and straight beside a side
        is_at_corner = is_outside & ((position <= 0.0) | (position >= 1.0))
        normal = np.where(is_outside[:, None], (points - foot) / safe_value[:, None], 0.0)
        return Distances(value, normal, curvature=is_at_corner / safe_value)

    def make_offset_outline(self, distance: float) -> Polygon:
        """Make a polygon with few corners, all at about `distance` (in m) from the face."""
        offset = self.polygon.inscribed_polygon.buffer(distance, quad_segs=4)
        return _simplify_polygon(offset, distance)

    def fit_outline(self, points: Array) -> Polygon:
        """Fit a polygon with few corners to points around the face; see `Tip.fit_outline`."""
        shape = shapely.Polygon(points)
        if not shape.is_valid:  # gmsh would not terminate if sides crossed at a narrow corner
            shape = max(shapely.get_parts(shape.buffer(0.0)), key=shapely.area)
        return _simplify_polygon(shape, float(self.compute_distances(points).value.mean()))


def _simplify_polygon(shape: shapely.Polygon, width: float, detail: float = 0.03) -> Polygon:
    """Return a polygon without those corners that hardly change its outline.

    Parameters
    ----------
    shape : shapely.Polygon
        The polygon, with coordinates in m.
    width : float
        Width in m of the strip between the tip's face and the polygon.
    detail : float
        Maximum distance of a removed corner from the new outline, as a fraction of `width`.

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
        Outline of the probe, including its rounded edge, in m.
    edge_radius_mm : float or None
        Radius of the rounded edge, or of a sphere, in mm. None or 0 for a sharp edge.

    Returns
    -------
    Tip

    Raises
    ------
    ValueError
        If the edge is sharp, leaves no flat face, or the outline is neither a circle nor a convex
        polygon. The message is a reason for `format_error`, without an advice.
    """
    radius = (edge_radius_mm or 0.0) / 1e3
    if not radius:
        raise ValueError("has a sharp edge, but a contact requires a rounded one")
    if isinstance(outline, Circle) and outline.radius >= radius:
        return DiscTip(outline.centre, radius, face_radius=outline.radius - radius)
    if isinstance(outline, Polygon):
        polygon = outline.inscribed_polygon
        face = polygon.buffer(-radius, join_style="mitre")
        if not np.isclose(polygon.convex_hull.area, outline.area, rtol=1e-9):
            raise ValueError("requires a convex polygon")
        if not face.is_empty:
            return PolygonTip(Polygon(np.array(face.exterior.coords)[:-1]), radius)
    if isinstance(outline, Circle | Polygon):
        raise ValueError("is too large, since it leaves no flat face")
    raise ValueError("requires a circle or a convex polygon")
