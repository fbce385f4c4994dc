"""Approximate curves by circular arcs, to a tolerance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.drawings.curves import Curve, Side
from pvdf_fem.scene.outlines.arc import Arc
from pvdf_fem.scene.outlines.arc_polygon import STRAIGHT_BULGE

#: Maximum number of halvings of a smooth part; more are only needed at the tip of a cusp.
MAX_HALVINGS = 12
#: Points at which the distance between a curve and its arcs is measured, per pair of arcs.
CHECKS = 17
#: Fraction of the tolerance up to which these distances may come; between the points they may be
#: larger.
SHARE_OF_TOLERANCE = 0.8


def fit_arcs(curve: Curve, tolerance: float) -> list[Side]:
    """Approximate a curve by straight sides and circular arcs.

    Parameters
    ----------
    curve : Curve
        Any curve. A `Side` is returned unchanged.
    tolerance : float
        Maximum distance between curve and arcs, in the unit of the curve.

    Returns
    -------
    list of Side
        Sides from the start to the end of the curve.

    Notes
    -----
    Every smooth part of the curve gets two arcs with the tangents of the curve at its ends
    (a biarc), or is halved if these are too far from the curve. The distance falls with the third
    power of the part's length, for chords only with the second one.
    """
    if isinstance(curve, Side):
        return [curve]
    sides: list[Side] = []
    for first, last in pairwise(curve.breaks.tolist()):
        sides += _fit_part(curve, first, last, tolerance=tolerance, halvings=MAX_HALVINGS)
    return sides


def _fit_part(
    curve: Curve, first: float, last: float, tolerance: float, halvings: int
) -> list[Side]:
    """Approximate the part of a curve between two parameters.

    Parameters
    ----------
    curve : Curve
        The curve.
    first, last : float
        Parameters of the ends of the part, between which the curve is smooth.
    tolerance : float
        See `fit_arcs`.
    halvings : int
        Maximum number of times that the part is halved.

    Returns
    -------
    list of Side
    """
    parameters = np.linspace(first, last, CHECKS)
    points = curve.compute_points(parameters)
    # tangents a little inside, since they jump at the knots of a spline with kinks
    inset = 1e-9 * (last - first)
    tangents = curve.compute_tangents(np.array([first + inset, last - inset]))
    sides = _make_biarc(points[0], points[-1], tangents)
    if halvings == 0 or _compute_deviation(sides, points) <= SHARE_OF_TOLERANCE * tolerance:
        return sides
    middle = 0.5 * (first + last)
    return [
        *_fit_part(curve, first, middle, tolerance=tolerance, halvings=halvings - 1),
        *_fit_part(curve, middle, last, tolerance=tolerance, halvings=halvings - 1),
    ]


def _make_biarc(start: Array, end: Array, tangents: Array) -> list[Side]:
    """Make two arcs between points that have given tangents at the ends and join smoothly.

    Parameters
    ----------
    start, end : ndarray, shape (2,)
        The points.
    tangents : ndarray, shape (2, 2)
        Unit tangents at the start and at the end.

    Returns
    -------
    list of Side
        Two arcs, or one straight side if the tangents lie along it or allow no biarc. Empty if both
        points are equal.

    Notes
    -----
    The joint is halfway between start + d t1 and end - d t2, where d is chosen such that these two
    points are 2 d apart.
    """
    chord = end - start
    first, last = tangents
    length_squared = float(chord @ chord)
    if length_squared == 0.0:
        return []
    along = float(chord @ (first + last))
    spread = 2.0 * (1.0 - float(first @ last))
    if spread > 1e-14:
        distance = (np.sqrt(along**2 + spread * length_squared) - along) / spread
    elif along > 0.0:
        distance = length_squared / (2.0 * along)
    else:
        return [Side(start, end)]
    joint = 0.5 * (start + end + distance * (first - last))
    bulges = [_compute_bulge(first, joint - start), _compute_bulge(end - joint, last)]
    if max(map(abs, bulges)) < STRAIGHT_BULGE:
        return [Side(start, end)]
    return [Side(start, joint, bulges[0]), Side(joint, end, bulges[1])]


def _compute_bulge(before: Array, after: Array) -> float:
    """Compute the bulge of an arc from the turn between its chord and the tangent at an end."""
    cross = before[0] * after[1] - before[1] * after[0]
    return float(np.tan(0.5 * np.arctan2(cross, before @ after)))


def _compute_deviation(sides: list[Side], points: Array) -> float:
    """Compute the maximum distance of points of a curve from the sides that approximate it.

    Parameters
    ----------
    sides : list of Side
        The sides; none if the curve ends where it begins.
    points : ndarray, shape (n, 2)
        Points along the curve.

    Returns
    -------
    float
    """
    if not sides:
        return float(np.linalg.norm(points - points[0], axis=1).max())
    distances = np.full(len(points), np.inf)
    for side in sides:
        if abs(side.bulge) >= STRAIGHT_BULGE:
            found = Arc(side.first, side.last, side.bulge).compute_distances(points)
        else:
            chord = side.last - side.first
            along = np.clip((points - side.first) @ chord / (chord @ chord), 0.0, 1.0)
            found = np.linalg.norm(points - side.first - along[:, None] * chord, axis=1)
        distances = np.minimum(distances, found)
    return float(distances.max())
