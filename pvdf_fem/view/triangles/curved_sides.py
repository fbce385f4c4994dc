"""Places of the points of triangles along curved sides of elements.

A polygon through points on a curve is smaller than the area inside the curve.

- At the rim the points are moved outwards, so that the polygon encloses the whole film: each point
  of the film is found in a triangle. The polygon is larger by a²/12 with sides of the angle a.
- Along other curved sides, such as those of round electrodes, the points between the ends are moved
  so that the areas on both sides of the polygon are those of the elements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.points import compute_local_coordinates
from pvdf_fem.mesh.subdomains import RIM
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.view.triangles.element_points import find_facets
from pvdf_fem.view.triangles.rim import RimSides, circumscribe
from pvdf_fem.view.triangles.subdivision import Triangles

#: Height of a side divided by its length above which the side is curved; below, it is round-off.
BENT = 1e-9


class ElementPoints(NamedTuple):
    """Points in elements."""

    elements: Indices  #: Element of each point, shape (n,).
    local: Array  #: Local coordinates, which may be slightly outside, shape (n, 2).


class _FacetPoints(NamedTuple):
    """Points of triangles between the ends of element sides, along one side after another."""

    points: Indices  # number of each point, shape (n,)
    facets: Indices  # side of the mesh that the point is on, shape (n,)
    positions: Array  # position on the side, from 0 at its first end to 1, shape (n,)
    elements: Indices  # an element with this side, shape (n,)


def place_on_curved_sides(
    triangles: Triangles, mesh: MeshTri2, rim: Outline
) -> tuple[Array, Indices, ElementPoints]:
    """Move the points along curved sides of elements so that no area is lost.

    Parameters
    ----------
    triangles : Triangles
        The triangles inside the elements of `mesh`.
    mesh : MeshTri2
        The mesh in m.
    rim : Outline
        Outline of the film.

    Returns
    -------
    points : ndarray, shape (points, 2)
        The new places of all points in m.
    moved : ndarray of int, shape (n,)
        Numbers of the points that were moved inside the film. The displacement of the points at the
        rim remains that of the rim.
    owners : ElementPoints
        The new places of these points in elements.
    """
    on_sides = _find_facet_points(triangles, mesh)
    points = triangles.points.copy()
    is_at_rim = np.isin(on_sides.facets, mesh.boundaries[RIM])
    moves = _compute_area_moves(on_sides, mesh)
    is_moved = moves.any(axis=1) & ~is_at_rim
    moved = on_sides.points[is_moved]
    points[moved] += moves[is_moved]
    elements = on_sides.elements[is_moved]
    local = compute_local_coordinates(mesh, elements, points[moved][:, None])[:, :, 0].T

    at_rim, new_places = circumscribe(points, _list_rim_sides(on_sides, mesh), rim)
    points[at_rim] = new_places
    return points, moved, ElementPoints(elements, local)


def _list_rim_sides(on_sides: _FacetPoints, mesh: MeshTri2) -> RimSides:
    """List the sides of triangles along the rim, from the points on each side of an element."""
    facets = mesh.boundaries[RIM]
    first, last = mesh.facets[:, facets]
    is_at_rim = np.isin(on_sides.facets, facets)
    between = on_sides.points[is_at_rim]
    points = np.concatenate([first, between, last])
    owners = np.concatenate([facets, on_sides.facets[is_at_rim], facets])
    positions = np.concatenate(
        [np.zeros(len(facets)), on_sides.positions[is_at_rim], np.ones(len(facets))]
    )
    order = np.lexsort([positions, owners])
    points = points[order]
    owners = owners[order]
    starts = np.flatnonzero(owners[1:] == owners[:-1])
    elements = mesh.f2t[0, owners[starts]]
    centres = mesh.p[:, mesh.t[:, elements]].mean(axis=1).T
    return RimSides(starts=points[starts], ends=points[starts + 1], inner=centres)


def _find_facet_points(triangles: Triangles, mesh: MeshTri2) -> _FacetPoints:
    """Find the points between the ends of element sides, ordered along the sides."""
    numbers = triangles.corners.ravel()
    elements = np.repeat(triangles.elements, 3)
    local = triangles.local.reshape(-1, 2)
    facets = find_facets(mesh, elements, local[:, None])
    is_between = (facets >= 0) & (numbers >= mesh.nvertices)
    numbers, first = np.unique(numbers[is_between], return_index=True)
    facets = facets[is_between][first]
    elements = elements[is_between][first]
    weights = _compute_barycentric(local[is_between][first])
    # the weight of the vertex at the second end of the side
    is_second_end = mesh.t[:, elements] == mesh.facets[1, facets]
    positions = (weights.T * is_second_end).sum(axis=0)
    order = np.lexsort([positions, facets])
    return _FacetPoints(numbers[order], facets[order], positions[order], elements[order])


def _compute_barycentric(local: Array) -> Array:
    """Compute the weights of the three vertices at local coordinates, shape (n, 2)."""
    x, y = local.T
    return np.stack([1.0 - x - y, x, y], axis=1)


def _compute_area_moves(on_sides: _FacetPoints, mesh: MeshTri2) -> Array:
    """Compute moves of points on curved sides by which polygons keep the areas at the sides.

    Parameters
    ----------
    on_sides : _FacetPoints
        Points between the ends of sides.
    mesh : MeshTri2
        The mesh in m.

    Returns
    -------
    ndarray, shape (n, 2)
        Moves in m; zero at straight sides.

    Notes
    -----
    A side is a parabola p + v t + a t². Between the positions t and t + d it encloses the area
    d³ |v × a|/6 with its chord. If the points between the ends are moved by -k a, with a k for each
    point, the polygon gains the sum of the areas k |v × a| (t₊ - t₋)/2 with the positions t₊ and t₋
    of the neighbours. k is proportional to (t - t₋) (t₊ - t), which is small where points are dense
    and the polygon is near the side.
    """
    first, last = mesh.facets[:, on_sides.facets]
    middle = mesh.dofs.facet_dofs[0, on_sides.facets]
    nodes = mesh.doflocs.T
    bend = 2.0 * (nodes[first] + nodes[last] - 2.0 * nodes[middle])
    chord = nodes[last] - nodes[first]
    is_curved = np.abs(bend).max(axis=1) > BENT * np.abs(chord).max(axis=1)

    is_first = np.append(True, on_sides.facets[1:] != on_sides.facets[:-1])
    is_last = np.append(is_first[1:], True)
    before = on_sides.positions - np.where(is_first, 0.0, np.roll(on_sides.positions, 1))
    after = np.where(is_last, 1.0, np.roll(on_sides.positions, -1)) - on_sides.positions
    cubes = before**3 + np.where(is_last, after**3, 0.0)
    facet_count = mesh.facets.shape[1]
    missing = np.bincount(on_sides.facets, cubes, facet_count)
    gained = np.bincount(on_sides.facets, before * after * (before + after), facet_count)
    factors = (missing / (3.0 * np.where(gained > 0.0, gained, 1.0)))[on_sides.facets]
    moves = -(factors * before * after)[:, None] * bend
    return np.where(is_curved[:, None], moves, 0.0)
