"""Subdivision of elements by halving the sides of triangles.

A side is halved where the film or its displacement differs too much from the straight line between
the side's ends. This depends on the side alone, so that neighbouring elements get the same points
on a common side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import evaluate_in_pairs
from pvdf_fem.mesh.six_node import find_curved_elements
from pvdf_fem.mesh.subdomains import RIM
from pvdf_fem.view.triangles.element_points import (
    find_facets,
    interpolate_displacement,
    map_points,
)

#: Corners of the reference triangle.
REFERENCE_CORNERS: Array = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
#: Places along a side where it is compared with the straight line between its ends. A cubic that
#: meets this line in the middle differs from it at a quarter.
PLACES = (0.25, 0.5, 0.75)
#: Height of an element's side divided by its length, below which it is left whole as straight.
STRAIGHT = 1e-6
#: Displacements below this fraction of the film's radius are round-off.
ROUND_OFF = 1e-13


@dataclass(frozen=True)
class SubdivisionLimits:
    """Limits above which the sides of triangles are halved.

    The height of a side is the distance of its middle from the straight line between its ends.
    """

    #: Maximum difference of the displacement, as a fraction of the largest displacement.
    displacement: float = 4e-4
    #: Maximum height of a side divided by its length, on a film that is drawn with a largest
    #: deflection of a quarter of its hydraulic radius. The film turns by about eight times this
    #: angle.
    turn: float = 8e-3
    #: Maximum difference of the stress in the middle from the mean of both ends, as a fraction of
    #: the largest of the three, or of the mean stress of the film if this is larger.
    stress: float = 3e-3
    #: Number of triangles above which they are not subdivided for the stress.
    stress_triangles: int = 20_000
    #: Maximum height in the plane divided by the length, at the rim. A side that spans the angle a
    #: has a/8, and the polygon around the film is larger by a²/12: here by at most 5e-5.
    rim: float = 3e-3
    #: Maximum height in the plane divided by the length, along other sides of elements: a circle
    #: gets 64 sides.
    outline: float = 1.25e-2
    #: Maximum height in the plane divided by the length, inside elements.
    inside: float = 0.05
    halvings: int = 8  #: Maximum number of times that an element is subdivided.
    #: Number of triangles above which none is subdivided, so that limits may be exceeded.
    triangles: int = 60_000


#: Limits for files, views and maps.
LIMITS = SubdivisionLimits()


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles inside elements; triangles of neighbouring elements share their points."""

    points: Array  #: Corners of the triangles in m, shape (points, 2).
    displacement: Array  #: Displacement of the points in m, shape (points, 3).
    corners: Indices  #: Points of each triangle, shape (triangles, 3).
    elements: Indices  #: Element that contains each triangle, shape (triangles,).
    local: Array  #: Local coordinates of the corners in this element, shape (triangles, 3, 2).
    #: Whether a triangle was made in the last step, so that its sides are to be examined.
    is_new: Mask


@dataclass(frozen=True, eq=False)
class _Sides:
    """Distinct sides of triangles."""

    ends: Indices  # the two points of each side, shape (sides, 2)
    elements: Indices  # an element that contains each side, shape (sides,)
    local: Array  # local coordinates of both ends in this element, shape (sides, 2, 2)

    def select(self, numbers: Indices) -> _Sides:
        """Return some of the sides."""
        return _Sides(self.ends[numbers], self.elements[numbers], local=self.local[numbers])


@dataclass(frozen=True, eq=False)
class _AllSides(_Sides):
    """All sides of triangles. Side i of a triangle joins its corners i and i + 1."""

    of_triangle: Indices  # the three sides of each triangle, shape (triangles, 3)


def subdivide(film: FilmData, limits: SubdivisionLimits = LIMITS) -> Triangles:
    """Subdivide all elements of a solution until every side of a triangle is within the limits.

    Parameters
    ----------
    film : FilmData
        The solution.
    limits : SubdivisionLimits, optional
        The limits.

    Returns
    -------
    Triangles

    Notes
    -----
    If a side of a triangle is halved, its longest side is halved, too, which keeps angles away from
    zero (Rivara, International Journal for Numerical Methods in Engineering 20, 1984). Only sides
    are examined: a quadratic function differs from its linear interpolation inside a triangle by at
    most 4/3 of the largest difference on the sides.
    """
    triangles = _copy_elements(film)
    for _ in range(limits.halvings):
        sides = _find_sides(triangles)
        is_halved = np.zeros(len(sides.ends), dtype=bool)
        examined = np.unique(sides.of_triangle[triangles.is_new])
        is_halved[examined] = _exceeds_limits(
            triangles, sides.select(examined), film=film, limits=limits
        )
        if not is_halved.any() or len(triangles.corners) > limits.triangles:
            break
        is_halved = _add_longest_sides(triangles, sides, is_halved)
        triangles = _halve_sides(triangles, sides, is_halved, film=film)
    return triangles


def _copy_elements(film: FilmData) -> Triangles:
    """Return one triangle for each element."""
    mesh = film.mesh
    corners = np.asarray(mesh.t.T)
    elements = np.arange(len(corners))
    local = np.tile(REFERENCE_CORNERS, (len(corners), 1, 1))
    displacement = np.zeros((mesh.nvertices, 3))
    displacement[corners.ravel()] = interpolate_displacement(
        film, elements=np.repeat(elements, 3), local=local.reshape(-1, 2)
    )
    return Triangles(
        mesh.doflocs[:, : mesh.nvertices].T,
        displacement,
        corners=corners,
        elements=elements,
        local=local,
        is_new=np.ones(len(corners), dtype=bool),
    )


def _find_sides(triangles: Triangles) -> _AllSides:
    """Find the distinct sides of triangles."""
    starts = triangles.corners.ravel()
    stops = np.roll(triangles.corners, -1, axis=1).ravel()
    keys = np.minimum(starts, stops) * len(triangles.points) + np.maximum(starts, stops)
    _, first, numbers = np.unique(keys, return_index=True, return_inverse=True)
    local_starts = triangles.local.reshape(-1, 2)
    local_stops = np.roll(triangles.local, -1, axis=1).reshape(-1, 2)
    return _AllSides(
        ends=np.stack([starts[first], stops[first]], axis=1),
        of_triangle=numbers.reshape(-1, 3),
        elements=triangles.elements[first // 3],
        local=np.stack([local_starts[first], local_stops[first]], axis=1),
    )


def _exceeds_limits(
    triangles: Triangles,
    sides: _Sides,
    *,
    film: FilmData,
    limits: SubdivisionLimits,
) -> Mask:
    """Return whether each side exceeds a limit, shape (sides,)."""
    radius = film.scene.film.radius
    largest = float(np.linalg.norm(triangles.displacement, axis=1).max())
    deflection = float(np.abs(triangles.displacement[:, 2]).max())
    exaggeration = 0.25 * radius / deflection if deflection > ROUND_OFF * radius else 0.0
    allowed = max(limits.displacement * largest, ROUND_OFF * radius)

    ends = triangles.points[sides.ends]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    exceeds = _is_too_curved(sides, ends, mesh=film.mesh, limits=limits)
    for place in PLACES:
        differences = _compute_differences(triangles, sides, place, film=film)
        exceeds |= np.linalg.norm(differences, axis=1) > allowed
        exceeds |= exaggeration * np.abs(differences[:, 2]) > limits.turn * lengths
    if len(triangles.corners) <= limits.stress_triangles:
        others = np.flatnonzero(~exceeds)
        exceeds[others] = _has_uneven_stress(sides.select(others), film=film, limits=limits)
    return exceeds


def _has_uneven_stress(sides: _Sides, *, film: FilmData, limits: SubdivisionLimits) -> Mask:
    """Return whether the stress in the middle of each side exceeds its limit, shape (sides,)."""
    space = film.equilibrium.space
    weights = space.weights[..., None]
    mean_MPa = 1e-6 * float((np.abs(film.state.stress[..., :2]) * weights).sum() / weights.sum())
    # the two ends and the middle of each side
    local = np.concatenate([sides.local, sides.local.mean(axis=1, keepdims=True)], axis=1)
    values = evaluate_in_pairs(
        film.equilibrium,
        film.state,
        elements=np.repeat(sides.elements, 3),
        local=local.reshape(-1, 2),
    )
    stress = values.stress_MPa.reshape(-1, 3, 3)
    difference = np.abs(stress[:, 2] - stress[:, :2].mean(axis=1)).max(axis=1)
    largest = np.abs(stress).max(axis=(1, 2))
    return difference > limits.stress * np.maximum(largest, mean_MPa)


def _is_too_curved(
    sides: _Sides, ends: Array, *, mesh: MeshTri2, limits: SubdivisionLimits
) -> Mask:
    """Return whether sides exceed the limits on their heights in the plane.

    Parameters
    ----------
    sides : _Sides
        The sides.
    ends : ndarray, shape (sides, 2, 2)
        Places of the ends of each side in m.
    mesh : MeshTri2
        The mesh in m.
    limits : SubdivisionLimits
        The limits.

    Returns
    -------
    ndarray of bool, shape (sides,)
    """
    facets = find_facets(mesh, sides.elements, sides.local)
    allowed = np.where(facets >= 0, limits.outline, limits.inside)
    allowed[np.isin(facets, mesh.boundaries[RIM])] = limits.rim
    # the area beside a curved side can only be kept by points between its ends
    is_whole_side = (facets >= 0) & (sides.ends < mesh.nvertices).all(axis=1)
    allowed[is_whole_side] = STRAIGHT
    middles = map_points(mesh, sides.elements, sides.local.mean(axis=1))
    heights = np.linalg.norm(middles - ends.mean(axis=1), axis=1)
    return heights > allowed * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def _compute_differences(
    triangles: Triangles, sides: _Sides, place: float, *, film: FilmData
) -> Array:
    """Compute the differences of the displacement from its linear interpolation along sides.

    Parameters
    ----------
    triangles : Triangles
        The triangles.
    sides : _Sides
        Some of their sides.
    place : float
        The place on the straight line between the ends of each side, between 0 and 1.
    film : FilmData
        The solution.

    Returns
    -------
    ndarray, shape (sides, 3)
        Differences in m.

    Notes
    -----
    The local coordinates of a place on the straight line are not known if the element is curved.
    The displacement is evaluated at a point beside it, and extrapolated linearly.
    """

    def interpolate_linearly(values: Array) -> Array:
        """Interpolate between values at the ends of sides, shape (sides, 2, ...)."""
        return np.asarray((1.0 - place) * values[:, 0] + place * values[:, 1])

    space = film.equilibrium.space
    local = interpolate_linearly(sides.local)
    displacement = interpolate_displacement(film, elements=sides.elements, local=local)
    nodes = space.mesh.doflocs[:, space.mesh.dofs.element_dofs[:, sides.elements]]
    rows = np.flatnonzero(find_curved_elements(nodes))
    if len(rows):
        elements = sides.elements[rows]
        points = map_points(film.mesh, elements, local[rows])
        on_line = interpolate_linearly(triangles.points[sides.ends[rows]])
        shape_gradients = space.evaluate_gradients(elements, local[rows].T[:, :, None])[:, 0]
        nodal = film.state.dofs.reshape(-1, 3)[space.nodes[elements]]
        gradients = np.matmul(nodal.swapaxes(1, 2), shape_gradients)
        displacement[rows] += np.matmul(gradients, (on_line - points)[:, :, None])[:, :, 0]
    return displacement - interpolate_linearly(triangles.displacement[sides.ends])


def _rank_lengths(triangles: Triangles, sides: _AllSides) -> Indices:
    """Rank the sides by length, shape (sides,).

    Ranks are distinct, so that both triangles at a side agree which of two equal sides is longer.
    """
    ends = triangles.points[sides.ends]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    ranks = np.empty(len(lengths), dtype=int)
    ranks[lengths.argsort(kind="stable")] = np.arange(len(lengths))
    return ranks


def _add_longest_sides(triangles: Triangles, sides: _AllSides, is_halved: Mask) -> Mask:
    """Return which sides are halved, with the longest side of each triangle that is subdivided."""
    ranks = _rank_lengths(triangles, sides)
    place = ranks[sides.of_triangle].argmax(axis=1)
    longest = np.take_along_axis(sides.of_triangle, place[:, None], axis=1)[:, 0]
    while True:
        is_subdivided = is_halved[sides.of_triangle].any(axis=1)
        extended = is_halved.copy()
        extended[longest[is_subdivided]] = True
        if np.array_equal(extended, is_halved):
            return is_halved
        is_halved = extended


def _halve_sides(
    triangles: Triangles, sides: _AllSides, is_halved: Mask, *, film: FilmData
) -> Triangles:
    """Subdivide triangles by the middles of some sides.

    Parameters
    ----------
    triangles : Triangles
        The triangles.
    sides : _AllSides
        Their sides.
    is_halved : ndarray of bool, shape (sides,)
        Whether a side is halved. If any side of a triangle is halved, its longest one is.
    film : FilmData
        The solution.

    Returns
    -------
    Triangles
        Two to four triangles in place of each triangle with a halved side.
    """
    halved = np.flatnonzero(is_halved)
    local_middles = sides.local[halved].mean(axis=1)
    elements = sides.elements[halved]
    new_points = map_points(film.mesh, elements, local_middles)
    new_displacement = interpolate_displacement(film, elements=elements, local=local_middles)
    middles = np.full(len(is_halved), -1)
    middles[halved] = len(triangles.points) + np.arange(len(halved))

    corners, local, middles_of_triangle = _begin_with_longest(triangles, sides, middles)
    local_middles = 0.5 * (local + np.roll(local, -1, axis=1))
    nodes = np.hstack([corners, middles_of_triangle])
    local_nodes = np.concatenate([local, local_middles], axis=1)
    has_middle = middles_of_triangle >= 0
    is_divided = np.asarray(has_middle.any(axis=1))
    parents = [np.flatnonzero(~is_divided)]
    children = [corners[~is_divided]]
    local_children = [local[~is_divided]]
    for child, is_present in _list_children(has_middle):
        rows = np.flatnonzero(is_present)
        parents.append(rows)
        children.append(nodes[rows][:, child])
        local_children.append(local_nodes[rows][:, child])
    parent = np.concatenate(parents)
    return Triangles(
        points=np.concatenate([triangles.points, new_points]),
        displacement=np.concatenate([triangles.displacement, new_displacement]),
        corners=np.concatenate(children),
        elements=triangles.elements[parent],
        local=np.concatenate(local_children),
        is_new=is_divided[parent],
    )


def _list_children(has_middle: Mask) -> list[tuple[list[int], Mask]]:
    """List the triangles that replace a triangle with vertices 0, 1, 2 and midpoints 3, 4, 5.

    Parameters
    ----------
    has_middle : ndarray of bool, shape (triangles, 3)
        Whether the sides 0-1 (the longest), 1-2 and 2-0 are halved, at 3, 4 and 5.

    Returns
    -------
    list of tuple
        The corners of a child, and for which triangles there is this child, shape (triangles,).
    """
    first, second, third = has_middle.T
    return [
        ([0, 3, 2], first & ~third),
        ([0, 3, 5], third),
        ([3, 2, 5], third),
        ([3, 1, 2], first & ~second),
        ([3, 1, 4], second),
        ([3, 4, 2], second),
    ]


def _begin_with_longest(
    triangles: Triangles, sides: _AllSides, middles: Indices
) -> tuple[Indices, Array, Indices]:
    """Rotate the corners of triangles so that the first two are the ends of the longest side.

    Parameters
    ----------
    triangles : Triangles
        The triangles.
    sides : _AllSides
        Their sides.
    middles : ndarray of int, shape (sides,)
        The point in the middle of each side; -1 for a side that is not halved.

    Returns
    -------
    corners : ndarray of int, shape (triangles, 3)
        Points of each triangle.
    local : ndarray, shape (triangles, 3, 2)
        Local coordinates of the corners.
    middles_of_triangle : ndarray of int, shape (triangles, 3)
        The points in the middles of the sides that begin at these corners.
    """
    ranks = _rank_lengths(triangles, sides)
    first = ranks[sides.of_triangle].argmax(axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    sides_of_triangle = np.take_along_axis(sides.of_triangle, order, axis=1)
    return (
        np.take_along_axis(triangles.corners, order, axis=1),
        np.take_along_axis(triangles.local, order[..., None], axis=1),
        middles[sides_of_triangle],
    )
