"""Places of the points of triangles along the rim, so that their polygon encloses the film."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.scene.outlines.outline import Outline

#: Cross product of the normals of two sides below which they meet smoothly.
SMOOTH = 0.1
#: Maximum half angle of an arc in radians: a film of few elements must not get points at infinity.
MAX_HALF_ANGLE = 1.0


@dataclass(frozen=True, eq=False)
class RimSides:
    """Sides of triangles along the rim."""

    starts: Indices  #: Point at one end of each side, shape (n,).
    ends: Indices  #: Point at the other end, shape (n,).
    #: A point inside the film at each side, by which the outer side is known, in m, shape (n, 2).
    inner: Array


def circumscribe(points: Array, sides: RimSides, rim: Outline) -> tuple[Indices, Array]:
    """Move points at the rim outwards so that the polygon through them encloses the film.

    Parameters
    ----------
    points : ndarray, shape (points, 2)
        Places of all points in m.
    sides : RimSides
        The sides along the rim.
    rim : Outline
        The outline of the film.

    Returns
    -------
    at_rim : ndarray of int, shape (n,)
        Numbers of the points at the rim.
    moved : ndarray, shape (n, 2)
        Their new places in m. Points on the rim between straight sides, or at arcs that bulge
        inwards, do not move.

    Notes
    -----
    A side of the length c, from which the rim is s away in the middle, is the chord of an arc of
    the radius r with the angle a, where tan(a/4) = 2 s/c. The polygon encloses the arc if its
    points are at r/cos(a/2), by s/cos(a/2) further outwards. A point between two sides is moved to
    satisfy both, along a straight side if one of them is straight. Sides of curved elements deviate
    a little from the rim; their points are moved onto it before.
    """
    ends = np.concatenate([sides.starts, sides.ends])
    # the rim is closed: each point is the end of two sides
    order = np.argsort(ends, kind="stable").reshape(-1, 2)
    at_rim = ends[order[:, 0]]
    on_rim = points.copy()
    normals, _ = _examine_sides(points, sides, rim)
    depths = -rim.compute_signed_distances(points[at_rim])
    on_rim[at_rim] += _satisfy_both(normals[order], np.stack([depths, depths], axis=1))
    normals, excesses = _examine_sides(on_rim, sides, rim)
    return at_rim, on_rim[at_rim] + _satisfy_both(normals[order], excesses[order])


def _examine_sides(points: Array, sides: RimSides, rim: Outline) -> tuple[Array, Array]:
    """Compute normals at the ends of sides, and how far the ends are to move along them.

    Parameters
    ----------
    points : ndarray, shape (points, 2)
        Places of all points in m.
    sides : RimSides
        The sides along the rim.
    rim : Outline
        The outline of the film.

    Returns
    -------
    normals : ndarray, shape (2 n, 2)
        Outward normals of the rim at the starts of the sides, then at their ends.
    excesses : ndarray, shape (2 n,)
        Distances in m.
    """
    start = points[sides.starts]
    end = points[sides.ends]
    chord = end - start
    length = np.linalg.norm(chord, axis=1)
    along = chord / length[:, None]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
    is_inward = ((sides.inner - start) * outward).sum(axis=1) > 0.0
    outward[is_inward] *= -1.0

    height = np.maximum(-rim.compute_signed_distances(0.5 * (start + end)), 0.0)
    half_angle = np.minimum(2.0 * np.arctan(2.0 * height / length), MAX_HALF_ANGLE)
    excess = height / np.cos(half_angle)
    across = np.cos(half_angle)[:, None] * outward
    aside = np.sin(half_angle)[:, None] * along
    normals = np.concatenate([across - aside, across + aside])
    return normals, np.concatenate([excess, excess])


def _satisfy_both(normals: Array, excesses: Array) -> Array:
    """Compute the moves of points between two sides.

    Parameters
    ----------
    normals : ndarray, shape (n, 2, 2)
        Outward normals of the rim at the two sides of each point.
    excesses : ndarray, shape (n, 2)
        Distances in m by which the point is to move along each normal.

    Returns
    -------
    ndarray, shape (n, 2)
        Moves in m.
    """
    first = normals[:, 0]
    second = normals[:, 1]
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    is_smooth = np.abs(cross) < SMOOTH
    middle = first + second
    middle_length = np.linalg.norm(middle, axis=1)
    # the tip of a needle has opposite normals
    safe_length = np.where(middle_length > SMOOTH, middle_length, np.inf)
    smooth_moves = excesses.max(axis=1)[:, None] * middle / safe_length[:, None]
    matrices = np.where(is_smooth[:, None, None], np.eye(2), normals)
    corner_moves = np.linalg.solve(matrices, excesses[..., None])[..., 0]
    return np.where(is_smooth[:, None], smooth_moves, corner_moves)
