"""Where a point lies: the element that holds it, and its local coordinates there."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices, Mask

#: A point is sought in this number of triangles, those with the nearest centroids.
CANDIDATES = 8


def nearest_elements(
    mesh: MeshTri2, points: Array, candidates: int = CANDIDATES
) -> tuple[Indices, Array]:
    """Elements (n,) of points (2, n), and the points' local coordinates (2, n) there.

    Elements count as straight-sided. A point is sought in the `candidates` with the nearest
    centroids; a point in none of them gets the one whose sides it oversteps least, with coordinates
    outside of it.
    """
    corners = mesh.p[:, mesh.t]
    _, near = cKDTree(corners.mean(axis=1).T).query(points.T, k=min(candidates, mesh.nelements))
    near = near.reshape(points.shape[1], -1)
    origin = corners[:, 0][:, near]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    inverse = np.linalg.inv(edges.transpose(1, 0, 2))[near]
    local = np.einsum("pcij,jpc->ipc", inverse, points[:, :, None] - origin)
    inside = np.minimum(local.min(axis=0), 1.0 - local.sum(axis=0))
    best = inside.argmax(axis=1)[:, None]
    elements = np.take_along_axis(near, best, axis=1)[:, 0]
    return elements, np.take_along_axis(local, best[None], axis=2)[..., 0]


def local_coordinates(
    mesh: MeshTri2, elements: Indices, points: Array, newton_steps: int = 6
) -> Array:
    """Local coordinates (2, n, points) of points (n, points, 2), each row in one element.

    In curved elements they take Newton's method.
    """
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, elements]]
    J = np.stack([nodes[:, 1] - nodes[:, 0], nodes[:, 2] - nodes[:, 0]], axis=1)
    local = np.einsum(
        "nij,npj->inp", np.linalg.inv(J.transpose(2, 0, 1)), points - nodes[:, 0].T[:, None]
    )
    rows = np.flatnonzero(curved_elements(nodes))
    mapping, target = mesh.mapping(), points.transpose(2, 0, 1)[:, rows]
    for _ in range(newton_steps if len(rows) else 0):
        here = local[:, rows]
        miss = target - mapping.F(here, elements[rows])
        local[:, rows] += np.einsum("ijnp,jnp->inp", mapping.invDF(here, elements[rows]), miss)
    return local


def curved_elements(nodes: Array, bent: float = 1e-9) -> Mask:
    """Which of the elements with the nodes (2, 6, elements) have a curved edge.

    An edge is curved whose midside node is farther than `bent` from its middle, relative to the
    element's size.
    """
    corners = nodes[:, :3]
    off = np.abs(nodes[:, 3:] - 0.5 * (corners + np.roll(corners, -1, axis=1)))
    return off.max(axis=(0, 1)) > bent * np.ptp(corners, axis=1).max(axis=0)
