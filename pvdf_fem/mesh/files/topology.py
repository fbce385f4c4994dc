"""Checks that triangles are one conforming mesh."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.six_node import SIDES


def require_conforming(triangles: Indices) -> None:
    """Raise `MeshFileError` unless triangles with a common side share its midside node.

    Parameters
    ----------
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle, in the order of `SIDES`.
    """
    ends = np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2)
    middles = triangles[:, 3:].reshape(-1, 1)
    sides = np.hstack([ends, middles])
    counts = {len(np.unique(nodes, axis=0)) for nodes in (ends, middles, sides)}
    if len(counts) > 1 or np.isin(middles, triangles[:, :3]).any():
        reason = "has neighbouring triangles without a common midside node"
        raise MeshFileError(f"{reason}; merge duplicate nodes (gmsh: Coherence Mesh)")
    _, owners = np.unique(middles, return_counts=True)
    crowded = int((owners > 2).sum())
    if crowded:
        reason = f"has {crowded} sides with more than two triangles"
        raise MeshFileError(f"{reason}; write each part of the film once")


def require_one_piece(triangles: Indices) -> None:
    """Raise `MeshFileError` unless triangles are connected by their sides.

    Parameters
    ----------
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle.
    """
    elements = np.repeat(np.arange(len(triangles)), 3)
    middles = triangles[:, 3:].ravel()
    incidence = sp.csr_matrix((np.ones(len(middles)), (elements, middles)))
    count, piece = connected_components(incidence @ incidence.T, directed=False)
    if count > 1:
        sizes = np.sort(np.bincount(piece))[::-1]
        listed = ", ".join(map(str, sizes[:5].tolist())) + (" ..." if count > 5 else "")
        raise MeshFileError(
            f"has {count} pieces without common sides, of {listed} triangles; give one film, whose"
            " parts share the nodes on their outlines (gmsh: BooleanFragments, Coherence Mesh)"
        )


def find_border_vertices(triangles: Indices) -> Indices:
    """Find the vertices of sides with only one triangle.

    Parameters
    ----------
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle, in the order of `SIDES`.

    Returns
    -------
    ndarray of int, shape (n,)
    """
    _, first, count = np.unique(triangles[:, 3:], return_index=True, return_counts=True)
    ends = triangles[:, SIDES].reshape(-1, 2)
    return np.unique(ends[first[count == 1]])
