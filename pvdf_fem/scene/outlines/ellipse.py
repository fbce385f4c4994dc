"""The outline of an ellipse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.curve_maximum import FINEST_ANGLE, find_curve_maximum
from pvdf_fem.scene.outlines.outline import EllipseCurve, Outline

#: Number of corners of an inscribed polygon, and of points of the coarsest grid along an ellipse.
CORNERS = 256


@dataclass(frozen=True, eq=False)
class Ellipse(Outline):
    """An ellipse: the image of the unit circle under the map z -> centre + axes z.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        Centre in m; stored as a read-only copy.
    first : ndarray, shape (2,)
        Vector from the centre to an end of one semi-axis in m; stored as a read-only copy.
    second : float
        Length of the other semi-axis in m.
    """

    centre: Array
    first: Array
    second: float

    def __post_init__(self) -> None:
        """Replace the vectors by read-only copies."""
        for name in ("centre", "first"):
            vector = np.array(getattr(self, name), dtype=float)
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)

    @cached_property
    def axes(self) -> Array:
        """Semi-axes in m as columns, the second rotated by 90° from the first, shape (2, 2)."""
        x, y = self.first
        across = np.array([-y, x]) * self.second / np.hypot(x, y)
        return np.stack([self.first, across], axis=-1)

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(np.pi * np.linalg.det(self.axes))

    @property
    def centroid(self) -> Array:
        """The centre in m, shape (2,)."""
        return self.centre

    @property
    def boundary(self) -> tuple[EllipseCurve]:
        """The whole ellipse as the only piece."""
        return (EllipseCurve(self.centre, self.axes),)

    @cached_property
    def inscribed_polygon(self) -> shapely.Polygon:
        """A polygon whose `CORNERS` corners are on the ellipse."""
        return shapely.Polygon(self.compute_points(_make_even_angles()))

    def compute_points(self, angles: Array) -> Array:
        """Compute points on the ellipse.

        Parameters
        ----------
        angles : ndarray, shape (n,)
            Angles in radians on the unit circle, of which the ellipse is the image.

        Returns
        -------
        ndarray, shape (n, 2)
            Points in m.
        """
        on_circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return self.centre + on_circle @ self.axes.T

    def compute_signed_distances(self, points: Array) -> Array:
        """Compute distances from the boundary, negative inside.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m.

        Returns
        -------
        ndarray, shape (n,)
            Distances in m, correct to first order close to the boundary.

        Notes
        -----
        The distances are f / |grad f| with f = |z| - 1, where z is the inverse image of the point
        under the map from the unit circle.
        """
        to_disc = np.linalg.inv(self.axes)
        z = (points - self.centre) @ to_disc.T
        radius = np.hypot(z[:, 0], z[:, 1])
        z[radius == 0.0] = 1.0, 0.0  # at the centre, take the direction of the first axis
        outward = z / np.where(radius > 0.0, radius, 1.0)[:, None]
        return (radius - 1.0) / np.linalg.norm(outward @ to_disc, axis=1)

    def compute_depth_in(self, other: Outline) -> float:
        """Compute how far the ellipse extends into another outline.

        Parameters
        ----------
        other : Outline
            The outline in whose interior the depth is measured, from its boundary inwards.

        Returns
        -------
        float
            Maximum depth in m of the ellipse's points, negative if all are outside.

        """
        return self._find_maximum(lambda points: -other.compute_signed_distances(points))

    def _find_excess(self, other: Outline) -> float:
        """Compute the maximum distance of the ellipse from another outline; see the base class."""
        return self._find_maximum(other.compute_signed_distances)

    def _find_maximum(self, function: Callable[[Array], Array]) -> float:
        """Find the maximum of a function along the ellipse.

        Parameters
        ----------
        function : callable
            Maps points in m, an ndarray of shape (n, 2), to values of shape (n,).

        Returns
        -------
        float
            Maximum in the unit of the function.
        """
        return find_curve_maximum(
            lambda angles: function(self.compute_points(angles)),
            _make_even_angles(),
            finest_step=FINEST_ANGLE,
            is_closed=True,
        )

    def compute_arc_midpoints(self, starts: Array, ends: Array) -> Array:
        """Compute the midside nodes of quadratic elements along the ellipse.

        With these nodes, the elements together have the area of the ellipse.

        Parameters
        ----------
        starts, ends : ndarray, shape (n, 2)
            Ends of element sides on the ellipse, in m.

        Returns
        -------
        ndarray, shape (n, 2)
            Midside nodes in m.

        Notes
        -----
        A quadratic arc through three points of the unit circle encloses too small an area, so its
        midpoint is moved outwards to the radius cos h + 3/4 (h - sin h cos h) / sin h, where h is
        half the angle of the arc. The remaining error changes its sign along the arc, so that its
        effect decays quickly with the distance. The linear map to the ellipse preserves ratios of
        areas.
        """
        to_disc = np.linalg.inv(self.axes)
        a = (starts - self.centre) @ to_disc.T
        b = (ends - self.centre) @ to_disc.T
        half_angle = np.arcsin(0.5 * np.linalg.norm(a - b, axis=1))
        # between arc and chord, the quadratic arc with its midpoint at the radius r encloses the
        # area 4/3 (r - cos h) sin h, and the circle encloses h - sin h cos h
        sine = np.sin(half_angle)
        cosine = np.cos(half_angle)
        radius = cosine + 0.75 * (half_angle - sine * cosine) / sine
        middle = a + b
        outward = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        return self.centre + radius[:, None] * outward @ self.axes.T

    def make_boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Make a quadrature rule on the boundary, with points at equal angles on the unit circle.

        Parameters
        ----------
        count : int
            Number of points per quarter of the ellipse.

        Returns
        -------
        points : ndarray, shape (4 count, 2)
            Quadrature points in m.
        normals : ndarray, shape (4 count, 2)
            Outward unit normals multiplied by the quadrature weights in m.
        """
        step = 0.5 * np.pi / count
        angles = step * np.arange(4.0 * count)
        tangents = np.stack([-np.sin(angles), np.cos(angles)], axis=-1) @ self.axes.T
        normals = step * np.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)
        return self.compute_points(angles), normals

    @cached_property
    def reach(self) -> float:
        """Maximum distance of the ellipse's points from the film's centre, in m."""
        # the extrema over t of |centre + axes (cos t, sin t)|² are at roots z = exp(it) of a
        # polynomial of degree 4, since the derivative is this polynomial divided by z²
        p, q = self.centre @ self.axes
        a, b = (self.axes**2).sum(axis=0)
        powers = np.array([b - a, 2j * q - 2.0 * p, 0.0, 2j * q + 2.0 * p, a - b])
        powers[np.abs(powers) < 1e-30 * (a + b)] = 0.0  # np.roots divides by the leading one
        # the angle 0 is for circles about the film's centre, whose polynomial is zero
        angles = np.append(np.angle(np.roots(powers)), 0.0)
        return float(np.linalg.norm(self.compute_points(angles), axis=1).max())

    @property
    def lower_left(self) -> Array:
        """Minimum x and minimum y in m, shape (2,)."""
        return self.centre - np.linalg.norm(self.axes, axis=1)

    @cached_property
    def defining_points(self) -> Array:
        """The ends of the axes in m, counter-clockwise, shape (4, 2)."""
        return self.centre + np.concatenate([self.axes.T, -self.axes.T])

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Ellipse:
        """Return a transformed copy; see `Outline.transform`."""
        return Ellipse(frame @ self.centre + shift, frame @ self.first, second=self.second)


def _make_even_angles() -> Array:
    """Make `CORNERS` evenly spaced angles in radians, from 0 to below 2 pi."""
    return 2.0 * np.pi * np.arange(CORNERS) / CORNERS
