"""The outline of an ellipse."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import EllipseCurve, Outline

#: Number of corners of an inscribed polygon, and of starting points of a search along an ellipse.
CORNERS = 256


@dataclass(frozen=True, eq=False)
class Ellipse(Outline):
    """The image of the unit circle under z -> centre + axes z; arrays are stored read-only.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        In m.
    first : ndarray, shape (2,)
        From the centre to the end of one of the semi-axes, in m.
    second : float
        Length of the other semi-axis in m.
    """

    centre: Array
    first: Array
    second: float

    def __post_init__(self) -> None:
        for name in ("centre", "first"):
            vector = np.array(getattr(self, name), dtype=float)
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)

    @cached_property
    def axes(self) -> Array:
        """Semi-axes in m as orthogonal columns (2, 2), the second one 90° after the first one."""
        x, y = self.first
        across = np.array([-y, x]) * self.second / np.hypot(x, y)
        return np.stack([self.first, across], axis=-1)

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(np.pi * np.linalg.det(self.axes))

    @property
    def centroid(self) -> Array:
        """The centre (2,) in m."""
        return self.centre

    @property
    def boundary(self) -> tuple[EllipseCurve]:
        """The ellipse as its only piece."""
        return (EllipseCurve(self.centre, self.axes),)

    @cached_property
    def inscribed_polygon(self) -> shapely.Polygon:
        """A polygon with `CORNERS` corners on the ellipse."""
        return shapely.Polygon(self.compute_points(_make_even_angles()))

    def compute_points(self, angles: Array) -> Array:
        """Compute the images (n, 2) in m of the points at angles (n,) on the unit circle."""
        on_circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return self.centre + on_circle @ self.axes.T

    def compute_signed_distances(self, points: Array) -> Array:
        """Compute distances from the boundary, negative inside.

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            In m.

        Returns
        -------
        ndarray, shape (n,)
            In m, exact to first order next to the boundary.

        Notes
        -----
        The distances are f / |grad f| with f = |z| - 1 at the point's inverse image z.
        """
        to_disc = np.linalg.inv(self.axes)
        z = (points - self.centre) @ to_disc.T
        radius = np.hypot(z[:, 0], z[:, 1])
        z[radius == 0.0] = 1.0, 0.0
        outward = z / np.where(radius > 0.0, radius, 1.0)[:, None]
        return (radius - 1.0) / np.linalg.norm(outward @ to_disc, axis=1)

    def compute_depth_in(self, other: Outline) -> float:
        """Compute how deep the ellipse reaches into another outline, in m; negative outside.

        Parameters
        ----------
        other : Outline
            The other outline.

        Returns
        -------
        float

        Notes
        -----
        Around each point of a grid that is deeper than its neighbours, finer and finer grids are
        searched. The error of the depth is quadratic in the distance of neighbours.
        """
        angles = _make_even_angles()
        step = angles[1]
        deepest = -np.inf
        while step > 1e-8:
            points = self.compute_points(angles.ravel())
            depth = -other.compute_signed_distances(points).reshape(angles.shape)
            deepest = max(deepest, float(depth.max()))
            if angles.ndim == 1:
                is_peak = (depth >= np.roll(depth, 1)) & (depth >= np.roll(depth, -1))
                peaks = angles[is_peak]
            else:
                columns = depth.argmax(axis=1)[:, None]
                peaks = np.take_along_axis(angles, columns, axis=1)[:, 0]
            angles = peaks[:, None] + step * np.linspace(-1.0, 1.0, 33)
            step /= 16.0
        return deepest

    def compute_arc_midpoints(self, starts: Array, ends: Array) -> Array:
        """Compute midside nodes that give curved elements the area of the ellipse.

        Parameters
        ----------
        starts, ends : ndarray, shape (n, 2)
            Ends of the elements' sides on the ellipse, in m.

        Returns
        -------
        ndarray, shape (n, 2)
            In m.

        Notes
        -----
        A quadratic arc through three points of the unit circle lies inside the circle, so the
        midpoints are moved outwards. With the area right, the remaining error changes its sign
        along the arc, and has no effect far from it. The map to the ellipse is linear and keeps the
        ratio of areas.
        """
        to_disc = np.linalg.inv(self.axes)
        a = (starts - self.centre) @ to_disc.T
        b = (ends - self.centre) @ to_disc.T
        half_angle = np.arcsin(0.5 * np.linalg.norm(a - b, axis=1))
        # the area between the quadratic arc and its chord is (4/3) (r - cos) sin, and between the
        # circle and the chord half_angle - sin cos
        sine = np.sin(half_angle)
        cosine = np.cos(half_angle)
        radius = cosine + 0.75 * (half_angle - sine * cosine) / sine
        middle = a + b
        outward = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        return self.centre + radius[:, None] * outward @ self.axes.T

    def make_boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Make a quadrature rule on the boundary, `count` points per quarter.

        Parameters
        ----------
        count : int
            Number of points per side or quarter.

        Returns
        -------
        points : ndarray, shape (4 count, 2)
            In m.
        normals : ndarray, shape (4 count, 2)
            Outward unit normals times weights in m.
        """
        step = 0.5 * np.pi / count
        angles = step * np.arange(4.0 * count)
        tangents = np.stack([-np.sin(angles), np.cos(angles)], axis=-1) @ self.axes.T
        normals = step * np.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)
        return self.compute_points(angles), normals

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point of the ellipse from the film's centre, in m."""
        # at z = exp(it) the derivative of |centre + axes (cos t, sin t)|² is a polynomial of
        # degree 4 over z²
        p, q = self.centre @ self.axes
        a, b = (self.axes**2).sum(axis=0)
        powers = np.array([b - a, 2j * q - 2.0 * p, 0.0, 2j * q + 2.0 * p, a - b])
        powers[np.abs(powers) < 1e-30 * (a + b)] = 0.0  # their quotients overflow
        angles = np.append(np.angle(np.roots(powers)), 0.0)
        return float(np.linalg.norm(self.compute_points(angles), axis=1).max())

    @property
    def lower_left(self) -> Array:
        """Least x and least y (2,) in m."""
        return self.centre - np.linalg.norm(self.axes, axis=1)

    @cached_property
    def defining_points(self) -> Array:
        """The ends (4, 2) of the axes in m."""
        return self.centre + np.concatenate([self.axes.T, -self.axes.T])

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Ellipse:
        """Return the ellipse after a rotation or reflection and a shift; see `Outline`."""
        return Ellipse(frame @ self.centre + shift, frame @ self.first, second=self.second)


def _make_even_angles() -> Array:
    """Make `CORNERS` angles at even distances around the unit circle."""
    return 2.0 * np.pi * np.arange(CORNERS) / CORNERS
