"""Rounded tips: the height over the film's plane for a rigid probe.

A tip is what a ball of one radius covers that rolls over a flat core: over a point it is a sphere,
over a disc or a polygon a flat face with a rounded edge. Its height over its lowest point is
z = rho - sqrt(rho^2 - d^2) at the distance d from the core; a tip of another kind is a class with
its own distance.
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

#: Part of the edge's radius up to which the height follows the ball; farther out it goes on as
#: a parabola keeps heights finite for iterates there.
STEEPEST = 0.99


class Distances(NamedTuple):
    """Distances from a core (n,) in m, their gradients (n, 2) and the curvature of their lines."""

    value: Array
    normal: Array
    curvature: Array


class Height(NamedTuple):
    """Height over the lowest point in m (n,), its gradient (n, 2) and Hessian (n, 2, 2) in 1/m."""

    value: Array
    slope: Array
    hessian: Array


class Tip(ABC):
    """A rigid tip above the film."""

    radius: float  #: Of its rounding, m.

    @abstractmethod
    def distances(self, points: Array) -> Distances:
        """Distances of points (n, 2) from the core; zero on it."""

    @abstractmethod
    def make_offset_outline(self, distance: float) -> Outline:
        """The outline around points nearer to the core than this distance."""

    @abstractmethod
    def fit_outline(self, points: Array) -> Outline:
        """The outline through points (n, 2) about the core, ordered counter-clockwise."""

    @abstractmethod
    def moved_by(self, motion: Array, stretch: float) -> Self:
        """The tip moved by `motion` (2,) in m, its core larger by the factor 1 + `stretch`."""

    @property
    @abstractmethod
    def face(self) -> Outline | None:
        """The outline of the flat face, where the tip's curvature jumps."""

    @property
    @abstractmethod
    def core_perimeter(self) -> float:
        """Length of the core's outline in m."""

    def profile(self, d: Array) -> tuple[Array, Array, Array]:
        """Height in m over the lowest point at distances from the core, its first and second
        derivatives; 0 on the core."""
        most = STEEPEST * self.radius
        root = np.sqrt(self.radius**2 - np.clip(d, 0.0, most) ** 2)
        beyond = np.maximum(d - most, 0.0)
        second = self.radius**2 / root**3
        first = np.clip(d, 0.0, most) / root + second * beyond
        value = self.radius - root + (first - 0.5 * second * beyond) * beyond
        return value, first, second

    def height(self, points: Array) -> Height:
        """The tip's height at points (n, 2)."""
        d, n, curvature = self.distances(points)
        value, first, second = self.profile(d)
        normal = n[:, :, None] * n[:, None, :]
        across = np.where(d > 0.0, first * curvature, 1.0 / self.radius)[:, None, None]
        flat = ((d > 0.0) | (curvature > 0.0))[:, None, None]
        hessian = second[:, None, None] * normal + flat * across * (np.eye(2) - normal)
        return Height(value, first[:, None] * n, hessian)


@dataclass(frozen=True, eq=False)
class DiscTip(Tip):
    """A disc with a rounded edge; a sphere where the core has no radius. Lengths are in m."""

    centre: Array
    radius: float  #: Of the rounding.
    core: float = 0.0  #: Radius of the flat face.

    def moved_by(self, motion: Array, stretch: float) -> DiscTip:
        return replace(self, centre=self.centre + motion, core=(1.0 + stretch) * self.core)

    @property
    def face(self) -> Circle | None:
        return Circle(self.centre, self.core) if self.core else None

    @property
    def core_perimeter(self) -> float:
        return 2.0 * np.pi * self.core

    def distances(self, points: Array) -> Distances:
        away = points - self.centre
        r = np.linalg.norm(away, axis=1)
        outside = (r > self.core) & (r > 0.0)
        safe = np.where(outside, r, 1.0)
        # a sphere's lowest point is curved like every point: its curvature is marked as finite
        curvature = np.where(outside, 1.0 / safe, 1.0 if self.core == 0.0 else 0.0)
        normal = np.where(outside[:, None], away / safe[:, None], 0.0)
        return Distances(np.where(outside, r - self.core, 0.0), normal, curvature)

    def make_offset_outline(self, distance: float) -> Circle:
        return Circle(self.centre, self.core + distance)

    def fit_outline(self, points: Array) -> Ellipse:
        """The ellipse nearest to the points, by least squares of a conic's equation."""
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
        return Ellipse(centre, scale * first * vectors[:, 0], float(scale * second))


@dataclass(frozen=True, eq=False)
class PolygonTip(Tip):
    """A convex polygon with a rounded edge."""

    core: Polygon  #: The flat face.
    radius: float  #: Of the rounding, m.

    def moved_by(self, motion: Array, stretch: float) -> PolygonTip:
        arms = self.core.vertices - self.core.centroid
        return replace(self, core=Polygon(self.core.vertices + motion + stretch * arms))

    @property
    def face(self) -> Polygon:
        return self.core

    @property
    def core_perimeter(self) -> float:
        return self.core.perimeter

    @cached_property
    def _sides(self) -> tuple[Array, Array]:
        start = self.core.vertices
        return start, np.roll(start, -1, axis=0) - start

    def distances(self, points: Array) -> Distances:
        start, side = self._sides
        along = ((points[:, None] - start) * side).sum(axis=-1) / (side**2).sum(axis=-1)
        nearest = start + np.clip(along, 0.0, 1.0)[..., None] * side
        d = np.linalg.norm(points[:, None] - nearest, axis=-1)
        k, rows = d.argmin(axis=1), np.arange(len(points))
        inside = (
            side[:, 0] * (points[:, None, 1] - start[:, 1])
            >= side[:, 1] * (points[:, None, 0] - start[:, 0])
        ).all(axis=1)
        outside = ~inside & (d[rows, k] > 0.0)
        value = np.where(outside, d[rows, k], 0.0)
        safe = np.where(outside, value, 1.0)
        at_corner = outside & ((along[rows, k] <= 0.0) | (along[rows, k] >= 1.0))
        normal = np.where(outside[:, None], (points - nearest[rows, k]) / safe[:, None], 0.0)
        return Distances(value, normal, at_corner / safe)

    def make_offset_outline(self, distance: float) -> Polygon:
        return self._outline(self.core.shape.buffer(distance, quad_segs=4), distance)

    def fit_outline(self, points: Array) -> Polygon:
        shape = shapely.Polygon(points)
        if not shape.is_valid:  # gmsh does not end on sides that cross at a narrow corner
            shape = max(shapely.get_parts(shape.buffer(0.0)), key=shapely.area)
        return self._outline(shape, float(self.distances(points).value.mean()))

    @staticmethod
    def _outline(shape: shapely.Polygon, width: float, detail: float = 0.03) -> Polygon:
        """A polygon with few corners; sides move by at most `detail` times the width."""
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
        return DiscTip(outline.centre, radius, outline.radius - radius)
    if isinstance(outline, Polygon):
        face = outline.shape.buffer(-radius, join_style="mitre")
        if not np.isclose(outline.shape.convex_hull.area, outline.area, rtol=1e-9):
            raise ValueError("is not a tip, since it is not convex")
        if not face.is_empty:
            return PolygonTip(Polygon(np.array(face.exterior.coords)[:-1]), radius)
    if isinstance(outline, Circle | Polygon):
        raise ValueError(f"leaves no flat face with an edge of {1e3 * radius:g} mm")
    raise ValueError("cannot have a rounded edge; choose a circle or a polygon")
