"""Isocharge contours: the places of the probe at which an electrode has a given charge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import contourpy
import numpy as np
import shapely
from scipy.interpolate import CubicSpline

from pvdf_fem.arrays import Array
from reports.maps.charge_map import ChargeFunction

# Distance in mm between samples of a curve: chords leave a curve of 3 mm radius by 0.4 µm.
_SAMPLE_MM = 0.1
# Distance in mm from a curve below which a point that Newton's method moves there has arrived.
_ARRIVED_MM = 1e-7


@dataclass(frozen=True, eq=False)
class ContourCurve:
    """A smooth curve: a cubic spline over the chord length through points."""

    #: At least two, different from their neighbours; of a closed curve the last is the first, (n,
    #: 2).
    points_mm: Array

    @property
    def closed(self) -> bool:
        """Whether the curve ends where it starts."""
        return len(self.points_mm) > 3 and bool(np.all(self.points_mm[0] == self.points_mm[-1]))

    @cached_property
    def spline(self) -> CubicSpline:
        """Points, (..., 2), over the chord length in mm."""
        chords = np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(chords)])
        ends = "periodic" if self.closed else "not-a-knot"
        return CubicSpline(along, self.points_mm, bc_type=ends)

    @cached_property
    def parameters(self) -> Array:
        """Chord lengths in mm, (m,), of the samples that make the polyline."""
        length = self.spline.x[-1]
        return np.linspace(0.0, length, max(2, int(np.ceil(length / _SAMPLE_MM)) + 1))

    @cached_property
    def polyline_mm(self) -> Array:
        """The curve as a polyline, (m, 2)."""
        return self.spline(self.parameters)

    @cached_property
    def line(self) -> shapely.LineString:
        """The polyline for shapely."""
        return shapely.LineString(self.polyline_mm)

    def crossings(self, other: ContourCurve) -> Array:
        """All points, (n, 2), at which two curves cross."""
        crossings = shapely.get_coordinates(shapely.intersection(self.line, other.line))
        return distinct(np.reshape([self._refined(other, point) for point in crossings], (-1, 2)))

    def _refined(self, other: ContourCurve, point: Array, most_steps: int = 8) -> Array:
        """A crossing of the polylines moved to that of the splines by Newton's method.

        If the splines do not cross nearby, as may be where curves nearly touch or end, the crossing
        of the polylines is returned.
        """
        st = np.array([self._parameter(point), other._parameter(point)])
        for _ in range(most_steps):
            gap = self.spline(st[0]) - other.spline(st[1])
            slopes = np.stack([self.spline(st[0], 1), -other.spline(st[1], 1)], axis=-1)
            if abs(np.linalg.det(slopes)) < 1e-9:
                return point
            st = st - np.linalg.solve(slopes, gap)
        s, t = np.clip(st, 0.0, [self.spline.x[-1], other.spline.x[-1]])
        crossing = self.spline(s)
        crossed = np.linalg.norm(crossing - other.spline(t)) < _ARRIVED_MM
        nearby = np.linalg.norm(crossing - point) < 2 * _SAMPLE_MM
        return crossing if crossed and nearby else point

    def _parameter(self, point: Array) -> float:
        """Chord length in mm at which the polyline is nearest to a point."""
        share = shapely.line_locate_point(self.line, shapely.Point(point), normalized=True)
        chords = np.linalg.norm(np.diff(self.polyline_mm, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(chords)])
        return float(np.interp(share * along[-1], along, self.parameters))


@dataclass(frozen=True, eq=False)
class Contour:
    """All places at which an electrode has a charge."""

    #: Name.
    electrode: str
    charge_pC: float
    #: Empty when the charge occurs nowhere.
    curves: tuple[ContourCurve, ...]

    def crossings(self, other: Contour) -> Array:
        """All points, (n, 2) in mm, at which two contours cross."""
        pairs = [a.crossings(b) for a in self.curves for b in other.curves]
        return distinct(np.concatenate([np.zeros((0, 2)), *pairs]))

    def nearest(self, other: Contour) -> Array:
        """The points of either contour, (2, 2) in mm, where they are closest to each other.

        The points are those of the polylines, right to within a µm. Both contours need a curve.
        """
        lines = (shapely.MultiLineString([curve.line for curve in c.curves]) for c in (self, other))
        return shapely.get_coordinates(shapely.shortest_line(*lines))


def contour(
    electrode: str, charge: ChargeFunction, charge_pC: float, step_mm: float = 0.5
) -> Contour:
    """The contour of a charge function within its reach.

    Parameters
    ----------
    electrode : str
        Name, for the result.
    charge : ChargeFunction
    charge_pC : float
    step_mm : float
        Pitch of the raster on which contours are sought, and distance between points of the curves.
        The points are then moved onto the contour by Newton's method.
    """
    curves = []
    for line in _raster_lines(charge, charge_pC, step_mm):
        points = _moved_onto(charge, charge_pC, _evenly(line, step_mm), step_mm)
        if len(points) > 1:
            curves.append(ContourCurve(points))
    return Contour(electrode, charge_pC, tuple(curves))


def _raster_lines(
    charge: ChargeFunction, charge_pC: float, step_mm: float
) -> Iterator[shapely.LineString]:
    reach = charge.reach_mm
    count = int(np.ceil(reach / step_mm)) + 1
    ticks = step_mm * np.arange(-count, count + 1)
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1)
    values, _ = charge.value_and_gradient(places.reshape(-1, 2))
    generator = contourpy.contour_generator(ticks, ticks, values.reshape(places.shape[:2]))
    disc = shapely.Point(0.0, 0.0).buffer(reach, quad_segs=256)
    for points in generator.lines(charge_pC):
        inside = shapely.intersection(shapely.LineString(points), disc)
        merged = shapely.line_merge(inside) if inside.geom_type == "MultiLineString" else inside
        for piece in shapely.get_parts(merged):
            if piece.geom_type == "LineString" and piece.length > 0.0:
                yield piece


def _evenly(line: shapely.LineString, step_mm: float) -> Array:
    count = max(4, int(np.ceil(line.length / step_mm)))
    shares = np.linspace(0.0, 1.0, count + 1)
    return shapely.get_coordinates(shapely.line_interpolate_point(line, shares, normalized=True))


def _moved_onto(
    charge: ChargeFunction, charge_pC: float, points: Array, step_mm: float, most_steps: int = 8
) -> Array:
    """Distinct points, moved to where the charge is `charge_pC` by `step_mm` at a time."""
    closed = bool(np.all(points[0] == points[-1]))
    for _ in range(most_steps):
        value, gradient = charge.value_and_gradient(points)
        steep = np.maximum((gradient**2).sum(axis=1), 1e-30)
        step = ((charge_pC - value) / steep)[:, None] * gradient
        length = np.linalg.norm(step, axis=1)
        points = points + step * np.minimum(1.0, step_mm / np.maximum(length, 1e-30))[:, None]
        if length.max() < _ARRIVED_MM:
            break
    if closed:
        points[-1] = points[0]  # to the last digit
    moved_on = np.linalg.norm(np.diff(points, axis=0, prepend=np.inf), axis=1) > 1e-6
    return points[moved_on]


def distinct(points: Array, tolerance_mm: float = 1e-6) -> Array:
    """Points, (n, 2), without those that repeat an earlier one."""
    unlike: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > tolerance_mm for other in unlike):
            unlike.append(point)
    return np.reshape(unlike, (-1, 2))
