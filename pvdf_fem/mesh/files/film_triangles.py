"""The triangles of a flat film, from the content of a mesh file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.files.content import MeshContent, MeshFileError
from pvdf_fem.mesh.six_node import SIDES

# Nodes closer than these fractions of the film's size and of the median side are one node. The
# first is less than the size of any element and more than the round-off of 32-bit coordinates; the
# second limits the distance if a damaged file has a node far away.
_MERGING_FRACTION = 2e-7
_MERGING_FRACTION_OF_SIDE = 1e-3
# Differences of z up to this fraction of the film's size are round-off.
_FLATNESS = 1e-6
# Larger coordinates come from damaged files; their squares and sums would overflow.
_LARGEST_COORDINATE = 1e100


@dataclass(frozen=True, eq=False)
class FilmTriangles:
    """Triangles in the plane of the film.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        The nodes, each of which belongs to a triangle.
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle, in the order of `SIDES`.
    notes : tuple of str
        What was changed.
    """

    points: Array
    triangles: Indices
    notes: tuple[str, ...] = ()


def select_film_triangles(content: MeshContent) -> FilmTriangles:
    """Select the triangles of a mesh file, and merge duplicates of nodes and elements.

    Three-node triangles get midside nodes in the middle of their sides.

    Parameters
    ----------
    content : MeshContent
        The content of the file.

    Returns
    -------
    FilmTriangles
        In the unit of the file.

    Raises
    ------
    MeshFileError
        If the file has other elements, has no triangles, or is not flat.
    """
    _require_triangles(content)
    is_first_order = len(content.triangles) > 0
    nodes = content.triangles if is_first_order else content.triangles6
    if nodes.min() < 0 or nodes.max() >= len(content.points):
        raise MeshFileError("has triangles whose nodes are missing; write the mesh again")
    used, numbers = np.unique(nodes, return_inverse=True)
    points = np.asarray(content.points, dtype=float)[used]
    triangles = numbers.reshape(nodes.shape)
    _require_flat(points)
    points, triangles, merged = _merge_nodes(points[:, :2], triangles)
    # MSH 2.2 files list an element once for each of its groups, partitions have copies of others
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    triangles = triangles[np.sort(first)]
    if is_first_order:
        points, triangles = _add_midside_nodes(points, triangles)
    notes = (f"{merged} duplicate nodes were merged with others at the same place",)
    return FilmTriangles(points, triangles, notes=notes if merged else ())


def _require_triangles(content: MeshContent) -> None:
    """Raise `MeshFileError` unless a file has either three-node or six-node triangles only."""
    if content.others:
        counts = ", ".join(f"{count} {name}" for name, count in content.others.items())
        raise MeshFileError(
            f"has other elements than triangles of three or six nodes: {counts}; mesh the film with"
            " triangles (gmsh: Mesh.RecombineAll = 0 and Mesh.ElementOrder = 2, without volumes)"
        )
    if len(content.triangles) and len(content.triangles6):
        raise MeshFileError(
            f"has {len(content.triangles)} triangles of three nodes and {len(content.triangles6)}"
            " of six; use one kind (gmsh: Mesh.ElementOrder = 2)"
        )
    if not len(content.triangles) and not len(content.triangles6):
        raise MeshFileError(
            "has no triangles; write the elements of the film (gmsh: Mesh.SaveAll = 1)"
        )


def _require_flat(points: Array) -> None:
    """Raise `MeshFileError` unless points of shape (nodes, 3) are in a plane of constant z."""
    if not (np.abs(points) < _LARGEST_COORDINATE).all():  # also of nan
        raise MeshFileError("has nodes at nan, inf or beyond 1e100; write the mesh again")
    size = np.ptp(points, axis=0).max()
    heights = points[:, 2]
    if np.ptp(heights) > _FLATNESS * size:
        raise MeshFileError(
            f"is not flat: z is between {heights.min():.6g} and {heights.max():.6g};"
            " give the undeformed film in the x-y plane"
        )


def _merge_nodes(points: Array, triangles: Indices) -> tuple[Array, Indices, int]:
    """Merge nodes at the same place.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        The nodes.
    triangles : ndarray of int, shape (elements, 3) or (elements, 6)
        Indices of the nodes.

    Returns
    -------
    points : ndarray, shape (nodes, 2)
        The nodes that remain.
    triangles : ndarray of int
        With indices of these nodes.
    merged : int
        Number of nodes that were merged with others.
    """
    from scipy.spatial import KDTree  # slow to import, and solves without a file do not need it

    size = np.ptp(points, axis=0).max()
    sides = np.linalg.norm(points[triangles[:, 1]] - points[triangles[:, 0]], axis=1)
    distance = min(_MERGING_FRACTION * size, _MERGING_FRACTION_OF_SIDE * float(np.median(sides)))
    pairs = KDTree(points).query_pairs(distance, output_type="ndarray")
    if not len(pairs):
        return points, triangles, 0
    links = sp.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    count, place = connected_components(links, directed=False)
    _, first = np.unique(place, return_index=True)
    return points[first], place[triangles], len(points) - count


def _add_midside_nodes(points: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Add a node in the middle of each side of three-node triangles.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        The vertices.
    triangles : ndarray of int, shape (elements, 3)
        Indices of the vertices of each triangle.

    Returns
    -------
    points : ndarray, shape (nodes, 2)
        The vertices and then the new nodes.
    triangles : ndarray of int, shape (elements, 6)
        Indices of vertices and midside nodes.
    """
    ends = np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2)
    sides, side_of = np.unique(ends, axis=0, return_inverse=True)
    middles = points[sides].mean(axis=1)
    midside_nodes = len(points) + side_of.reshape(-1, 3)
    return np.concatenate([points, middles]), np.hstack([triangles, midside_nodes])
