"""Circular arcs as pieces of a boundary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.curve_maximum import FINEST_ANGLE, find_curve_maximum


@dataclass(frozen=True, eq=False)
class Arc:
    """A circular arc between two points.

    Parameters
    ----------
    start, end : ndarray, shape (2,)
        Ends in m.
    bulge : float
        Tangent of a quarter of the included angle, positive for a counter-clockwise arc, as in DXF
        files. The arc is to the right of the chord if the bulge is positive.
    """

    start: Array
    end: Array
    bulge: float

    @property
    def angle(self) -> float:
        """Included angle in radians, positive for a counter-clockwise arc."""
        return 4.0 * float(np.arctan(self.bulge))

    @cached_property
    def chord(self) -> Array:
        """Vector from the start to the end in m, shape (2,)."""
        return self.end - self.start

    @cached_property
    def middle(self) -> Array:
        """Point of the arc halfway between its ends in m, shape (2,)."""
        x, y = self.chord
        return 0.5 * (self.start + self.end) + 0.5 * self.bulge * np.array([y, -x])

    @cached_property
    def centre(self) -> Array:
        """Centre of the circle in m, shape (2,)."""
        x, y = self.chord
        height = (1.0 - self.bulge**2) / (4.0 * self.bulge)
        return 0.5 * (self.start + self.end) + height * np.array([-y, x])

    @cached_property
    def radius(self) -> float:
        """Radius of the circle in m."""
        chord = float(np.hypot(*self.chord))
        return chord * (1.0 + self.bulge**2) / (4.0 * abs(self.bulge))

    @property
    def length(self) -> float:
        """Length of the arc in m."""
        return self.radius * abs(self.angle)

    @property
    def segment_area(self) -> float:
        """Area in m² between chord and arc, positive for a counter-clockwise arc.

        Notes
        -----
        The area is c² (φ - sin φ) / (8 sin²(φ/2)) with the chord c and the included angle φ. For
        small angles, a series replaces the difference, which would lose all digits.
        """
        phi = self.angle
        difference = phi - np.sin(phi)
        if abs(phi) < 0.1:
            difference = phi**3 / 6.0 * (1.0 - phi**2 / 20.0 * (1.0 - phi**2 / 42.0))
        chord_squared = float(self.chord @ self.chord)
        return float(chord_squared * difference / (8.0 * np.sin(0.5 * phi) ** 2))

    @property
    def segment_moment(self) -> Array:
        """Area between chord and arc times its centroid in m³, shape (2,); signed as the area.

        Notes
        -----
        The moment about the centre is c³ / 12 along the direction to the middle of the arc, where c
        is the chord.
        """
        outward = (self.middle - self.centre) / self.radius
        chord = float(np.hypot(*self.chord))
        return self.segment_area * self.centre + np.sign(self.bulge) * chord**3 / 12.0 * outward

    def compute_points(self, fractions: Array) -> Array:
        """Compute points of the arc.

        Parameters
        ----------
        fractions : ndarray, shape (n,)
            Fractions of the included angle, from 0 at the start to 1 at the end.

        Returns
        -------
        ndarray, shape (n, 2)
            Points in m.
        """
        # turn the vector from the centre to the middle, which is exact for both directions
        angles = (fractions - 0.5) * self.angle
        x, y = self.middle - self.centre
        across = np.array([-y, x])
        along = np.array([x, y])
        cosines = np.cos(angles)[:, None]
        sines = np.sin(angles)[:, None]
        return self.centre + cosines * along + sines * across

    def compute_tangents(self, points: Array) -> Array:
        """Compute unit tangents at points of the arc, from its start to its end, shape (n, 2)."""
        radial = (points - self.centre) / self.radius
        return np.sign(self.bulge) * np.stack([-radial[:, 1], radial[:, 0]], axis=-1)

    def covers(self, points: Array) -> Array:
        """Return whether the rays from the centre to points hit the arc, ends included, shape (n,).

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        offsets = points - self.centre
        outward = (self.middle - self.centre) / self.radius
        along = offsets @ outward
        across = offsets[:, 0] * outward[1] - offsets[:, 1] * outward[0]
        return np.abs(np.arctan2(across, along)) <= 0.5 * abs(self.angle)

    def compute_distances(self, points: Array) -> Array:
        """Compute the distances of points from the arc in m, shape (n,).

        Parameters
        ----------
        points : ndarray, shape (n, 2)
            Points in m.

        Returns
        -------
        ndarray, shape (n,)
        """
        from_circle = np.abs(np.linalg.norm(points - self.centre, axis=1) - self.radius)
        from_start = np.linalg.norm(points - self.start, axis=1)
        from_end = np.linalg.norm(points - self.end, axis=1)
        return np.where(self.covers(points), from_circle, np.minimum(from_start, from_end))

    def find_farthest(self, direction: Array) -> Array:
        """Find the point of the arc that is farthest along a direction, in m, shape (2,).

        Parameters
        ----------
        direction : ndarray, shape (2,)
            A unit vector.

        Returns
        -------
        ndarray, shape (2,)
        """
        candidates = [self.start, self.end]
        top = self.centre + self.radius * direction
        if self.covers(top[None])[0]:
            candidates.append(top)
        return max(candidates, key=lambda point: float(point @ direction))

    def compute_midpoints(self, starts: Array, ends: Array) -> Array:
        """Compute the midside nodes of element sides along the arc.

        Parameters
        ----------
        starts, ends : ndarray, shape (n, 2)
            Ends of the element sides on the arc, in m.

        Returns
        -------
        ndarray, shape (n, 2)
            Midside nodes in m.
        """
        half_angle = np.arcsin(0.5 * np.linalg.norm(ends - starts, axis=1) / self.radius)
        sine = np.sin(half_angle)
        cosine = np.cos(half_angle)
        # between arc and chord, the quadratic arc encloses 4/3 (r - cos h) sin h
        radius = cosine + 0.75 * (half_angle - sine * cosine) / sine
        middle = 0.5 * (starts + ends) - self.centre
        outward = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        return self.centre + (self.radius * radius)[:, None] * outward

    def find_maximum(self, function: Callable[[Array], Array]) -> float:
        """Find the maximum of a function along the arc.

        Parameters
        ----------
        function : callable
            Maps points in m, an ndarray of shape (n, 2), to values of shape (n,).

        Returns
        -------
        float
            Maximum in the unit of the function.
        """
        count = max(8, int(256.0 * abs(self.angle) / (2.0 * np.pi)))
        return find_curve_maximum(
            lambda fractions: function(self.compute_points(fractions)),
            np.linspace(0.0, 1.0, count + 1),
            finest_step=FINEST_ANGLE / abs(self.angle),
            is_closed=False,
        )
