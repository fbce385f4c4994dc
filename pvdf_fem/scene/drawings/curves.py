"""Curves of drawings: straight lines, circular and elliptic arcs, and splines, in the plane."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.arc import Arc

#: Axes of an ellipse that differ by less than this fraction make a circle.
CIRCLE_TOLERANCE = 1e-9
#: A derivative below this fraction of the extent of a spline's control points gives no tangent. It
#: is replaced by a chord over twice this step of the parameter.
STILL_SPEED = 1e-6
CHORD_STEP = 1e-4


class Curve(ABC):
    """A curve with a parameter from 0 at the start to 1 at the end; lengths in any unit."""

    @abstractmethod
    def compute_points(self, parameters: Array) -> Array:
        """Compute points of the curve.

        Parameters
        ----------
        parameters : ndarray, shape (n,)
            Parameters from 0 at the start to 1 at the end.

        Returns
        -------
        ndarray, shape (n, 2)
        """

    @abstractmethod
    def compute_tangents(self, parameters: Array) -> Array:
        """Compute unit tangents of the curve, towards its end.

        Parameters
        ----------
        parameters : ndarray, shape (n,)
            Parameters from 0 at the start to 1 at the end.

        Returns
        -------
        ndarray, shape (n, 2)
        """

    @abstractmethod
    def transform(self, frame: Array, shift: Array) -> list[Curve]:
        """Return the image of the curve under the map x -> frame x + shift.

        Parameters
        ----------
        frame : ndarray, shape (2, 2)
            Any invertible matrix.
        shift : ndarray, shape (2,)
            Translation.

        Returns
        -------
        list of Curve
            One or more curves in order.
        """

    @property
    def breaks(self) -> Array:
        """Parameters between which the curve is smooth, from 0 to 1."""
        return np.array([0.0, 1.0])

    @cached_property
    def start(self) -> Array:
        """First point, shape (2,)."""
        return self.compute_points(np.zeros(1))[0]

    @cached_property
    def end(self) -> Array:
        """Last point, shape (2,)."""
        return self.compute_points(np.ones(1))[0]

    @cached_property
    def samples(self) -> Array:
        """Points along the curve, with at least 12 on every smooth part, shape (n, 2)."""
        parts = [np.linspace(first, last, 13)[:-1] for first, last in pairwise(self.breaks)]
        return self.compute_points(np.append(np.concatenate(parts), 1.0))


@dataclass(frozen=True, eq=False)
class Side(Curve):
    """A straight line or a circular arc, as a side of a polyline.

    Parameters
    ----------
    first, last : ndarray, shape (2,)
        Ends.
    bulge : float
        Tangent of a quarter of the included angle, positive for a counter-clockwise arc, 0 for a
        straight line.
    """

    first: Array
    last: Array
    bulge: float = 0.0

    @property
    def arc(self) -> Arc:
        """The side as an arc; only for a bulge other than 0."""
        return Arc(self.first, self.last, self.bulge)

    def compute_points(self, parameters: Array) -> Array:
        """Compute points; see `Curve.compute_points`."""
        if not self.bulge:
            return self.first + parameters[:, None] * (self.last - self.first)
        points = self.arc.compute_points(parameters)
        points[parameters == 0.0] = self.first  # exact, to be joined with other curves
        points[parameters == 1.0] = self.last
        return points

    def compute_tangents(self, parameters: Array) -> Array:
        """Compute unit tangents; see `Curve.compute_tangents`."""
        if self.bulge:
            return self.arc.compute_tangents(self.compute_points(parameters))
        chord = self.last - self.first
        return np.broadcast_to(chord / np.hypot(*chord), (len(parameters), 2))

    def transform(self, frame: Array, shift: Array) -> list[Curve]:
        """Return the transformed side, an elliptic arc if the map is no similarity."""
        if self.bulge and not _is_similarity(frame):
            radius = self.arc.radius
            x, y = self.first - self.arc.centre
            ellipse = EllipticArc(
                self.arc.centre,
                radius * np.eye(2),
                first_angle=float(np.arctan2(y, x)),
                sweep=self.arc.angle,
            )
            return ellipse.transform(frame, shift)
        bulge = float(np.sign(np.linalg.det(frame))) * self.bulge
        return [Side(frame @ self.first + shift, frame @ self.last + shift, bulge)]


@dataclass(frozen=True, eq=False)
class EllipticArc(Curve):
    """An arc of an ellipse: the points centre + axes (cos t, sin t).

    Parameters
    ----------
    centre : ndarray, shape (2,)
        Centre.
    axes : ndarray, shape (2, 2)
        The semi-axes as orthogonal columns.
    first_angle : float
        Angle t at the start in radians.
    sweep : float
        Change of the angle to the end, between -2 pi and 2 pi.
    """

    centre: Array
    axes: Array
    first_angle: float
    sweep: float

    @property
    def is_whole(self) -> bool:
        """Whether the arc is the whole ellipse."""
        return abs(self.sweep) > 2.0 * np.pi * (1.0 - 1e-12)

    @property
    def breaks(self) -> Array:
        """Parameters that divide the arc into parts of up to 90°, where the fit begins."""
        count = max(1, int(np.ceil(abs(self.sweep) / (0.5 * np.pi) - 1e-9)))
        return np.linspace(0.0, 1.0, count + 1)

    def compute_points(self, parameters: Array) -> Array:
        """Compute points; see `Curve.compute_points`."""
        angles = self.first_angle + parameters * self.sweep
        return self.centre + np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ self.axes.T

    def compute_tangents(self, parameters: Array) -> Array:
        """Compute unit tangents; see `Curve.compute_tangents`."""
        angles = self.first_angle + parameters * self.sweep
        velocity = np.stack([-np.sin(angles), np.cos(angles)], axis=-1) @ self.axes.T
        velocity = np.sign(self.sweep) * velocity
        return velocity / np.linalg.norm(velocity, axis=1, keepdims=True)

    def transform(self, frame: Array, shift: Array) -> list[Curve]:
        """Return the transformed arc; see `make_elliptic_curves`."""
        return make_elliptic_curves(
            frame @ self.centre + shift,
            frame @ self.axes,
            first_angle=self.first_angle,
            sweep=self.sweep,
        )


@dataclass(frozen=True, eq=False)
class Spline(Curve):
    """A rational B-spline.

    Parameters
    ----------
    degree : int
        Degree of the polynomials.
    knots : ndarray, shape (n + degree + 1,)
        Knots in increasing order.
    points : ndarray, shape (n, 2)
        Control points.
    weights : ndarray, shape (n,)
        Weights of the control points, positive.
    """

    degree: int
    knots: Array
    points: Array
    weights: Array

    @classmethod
    def from_bezier_points(cls, points: Array) -> Spline:
        """Make a Bézier curve.

        Parameters
        ----------
        points : ndarray, shape (degree + 1, 2)
            Its control points.

        Returns
        -------
        Spline
        """
        count = len(points)
        knots = np.repeat([0.0, 1.0], count)
        return cls(count - 1, knots, points=points, weights=np.ones(count))

    @cached_property
    def _interval(self) -> tuple[float, float]:
        """First and last knot of the curve's domain."""
        return float(self.knots[self.degree]), float(self.knots[-self.degree - 1])

    @property
    def breaks(self) -> Array:
        """Parameters of the knots."""
        low, high = self._interval
        inner = np.unique(self.knots[(self.knots >= low) & (self.knots <= high)])
        return (inner - low) / (high - low)

    def _evaluate(self, parameters: Array, derivative: int) -> Array:
        """Evaluate the homogeneous coordinates (w x, w y, w), or a derivative, shape (n, 3)."""
        from scipy.interpolate import BSpline  # imported here to read scenes without SciPy

        homogeneous = np.column_stack([self.points * self.weights[:, None], self.weights])
        low, high = self._interval
        spline = BSpline(self.knots, homogeneous, self.degree)
        return np.asarray(spline(low + parameters * (high - low), nu=derivative))

    def compute_points(self, parameters: Array) -> Array:
        """Compute points; see `Curve.compute_points`."""
        values = self._evaluate(parameters, 0)
        return values[:, :2] / values[:, 2:]

    def compute_tangents(self, parameters: Array) -> Array:
        """Compute unit tangents; see `Curve.compute_tangents`.

        Where the derivative vanishes, as at coinciding control points, a chord replaces it.
        """
        values = self._evaluate(parameters, 0)
        slopes = self._evaluate(parameters, 1)
        weights = values[:, 2:]
        velocity = (slopes[:, :2] * weights - values[:, :2] * slopes[:, 2:]) / weights**2
        speed = np.linalg.norm(velocity, axis=1)
        is_still = speed < STILL_SPEED * np.ptp(self.points, axis=0).max()
        if is_still.any():
            before = self.compute_points(np.clip(parameters[is_still] - CHORD_STEP, 0.0, 1.0))
            after = self.compute_points(np.clip(parameters[is_still] + CHORD_STEP, 0.0, 1.0))
            velocity[is_still] = after - before
            speed = np.linalg.norm(velocity, axis=1)
        return velocity / np.where(speed > 0.0, speed, 1.0)[:, None]

    def transform(self, frame: Array, shift: Array) -> list[Curve]:
        """Return the transformed spline."""
        return [Spline(self.degree, self.knots, self.points @ frame.T + shift, self.weights)]


def make_elliptic_curves(
    centre: Array, axes: Array, first_angle: float, sweep: float
) -> list[Curve]:
    """Make an arc of an ellipse from conjugate semi-axes, or circular arcs if it is a circle.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        Centre.
    axes : ndarray, shape (2, 2)
        Two conjugate semi-axes as columns, which need not be orthogonal.
    first_angle : float
        Angle t at the start in radians; the points are centre + axes (cos t, sin t).
    sweep : float
        Change of the angle to the end, between -2 pi and 2 pi.

    Returns
    -------
    list of Curve
        One `EllipticArc`, or one or two arcs of a circle.

    Notes
    -----
    With the singular values S of the axes, U S V^T (cos t, sin t) is U S at the angle t + δ, where
    V^T is the rotation by δ.
    """
    left, lengths, right = np.linalg.svd(axes)
    if np.linalg.det(right) < 0.0:
        left = left * np.array([1.0, -1.0])
        right = right * np.array([[1.0], [-1.0]])
    turned = first_angle + float(np.arctan2(right[1, 0], right[0, 0]))
    orthogonal = left * lengths
    arc = EllipticArc(centre, orthogonal, first_angle=turned, sweep=sweep)
    if lengths[0] - lengths[1] > CIRCLE_TOLERANCE * lengths[0]:
        return [arc]
    count = 2 if abs(sweep) > np.pi * (1.0 + 1e-12) else 1
    stops = arc.compute_points(np.linspace(0.0, 1.0, count + 1))
    if arc.is_whole:
        stops[-1] = stops[0]
    handedness = float(np.sign(np.linalg.det(orthogonal)))
    bulge = handedness * float(np.tan(0.25 * sweep / count))
    return [Side(stops[number], stops[number + 1], bulge) for number in range(count)]


def _is_similarity(frame: Array) -> bool:
    """Return whether a matrix changes all lengths by the same factor."""
    gram = frame.T @ frame
    scale = 0.5 * np.trace(gram)
    return bool(np.abs(gram - scale * np.eye(2)).max() <= CIRCLE_TOLERANCE * scale)
