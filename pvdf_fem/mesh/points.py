"""Where a point lies: the element that holds it, and its local coordinates there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.six_node import find_curved_elements


def find_nearest_elements(
    mesh: MeshTri2, points: Array, candidates: int = 8
) -> tuple[Indices, Array]:
    """Elements (n,) of points (2, n), and the points' local coordinates (2, n) there. Elements
    count as straight-sided. A point is sought in the `candidates` with the nearest centroids; a
    point outside the candidates gets the candidate with the least negative local coordinate."""
    from scipy.spatial import cKDTree  # many scenes are solved without

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


def locate_points(mesh: MeshTri2, points: Array, steps: int = 50) -> tuple[Indices, Array]:
    """Elements (n,) that hold points (2, n), and the points' local coordinates (2, n) there. Curved
    sides count as they are. From the nearest element whose straight triangle holds a point a walk
    of up to `steps` elements crosses the sides that the point lies beyond. A point just beyond the
    rim stays in the element there, with local coordinates outside."""
    facets = mesh.t2f[[1, 2, 0]]  # opposite of each vertex
    first, second = mesh.f2t[:, facets]
    across = np.where(first == np.arange(mesh.nelements), second, first)
    elements, _ = find_nearest_elements(mesh, points, 32)
    for step in range(steps + 1):
        local = compute_local_coordinates(mesh, elements, points.T[:, None])[:, :, 0]
        weights = np.stack([1.0 - local.sum(axis=0), *local])
        beyond = weights.argmin(axis=0)
        following = across[beyond, elements]
        leaves = (weights.min(axis=0) < -1e-9) & (following >= 0)
        if step == steps or not leaves.any():
            break
        elements = np.where(leaves, following, elements)
    return elements, local


def compute_local_coordinates(
    mesh: MeshTri2, elements: Indices, points: Array, newton_steps: int = 6
) -> Array:
    """Local coordinates (2, n, points) of points (n, points, 2), with a row in a single element. In
    curved elements they take Newton's method."""
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, elements]]
    J = np.stack([nodes[:, 1] - nodes[:, 0], nodes[:, 2] - nodes[:, 0]], axis=1)
    local = np.einsum(
        "nij,npj->inp", np.linalg.inv(J.transpose(2, 0, 1)), points - nodes[:, 0].T[:, None]
    )
    rows = np.flatnonzero(find_curved_elements(nodes))
    mapping, target = mesh.mapping(), points.transpose(2, 0, 1)[:, rows]
    for _ in range(newton_steps if len(rows) else 0):
        here = local[:, rows]
        miss = target - mapping.F(here, elements[rows])
        local[:, rows] += np.einsum("ijnp,jnp->inp", mapping.invDF(here, elements[rows]), miss)
    return local


@dataclass(frozen=True, eq=False)
class PlacedQuadrature:
    """Quadrature points in mesh elements, in rows with equally many points."""

    owners: Indices  #: Index of the outline, line or facet that a row of points belongs to, (n,).
    elements: Indices  #: The element that a row of points lies in, (n,).
    points: Array  #: Local coordinates in the element, (2, n, points).
    weights: Array  #: In m^2 over an area, in m along a line, (n, points).


def make_facet_quadrature(
    mesh: MeshTri2, facets: Indices, elements: Indices, count: int = 3
) -> tuple[PlacedQuadrature, Array]:
    """`count` Gauss points on facets (n,), each seen from one of its elements (n,), and unit
    tangents (n, points, 2) from the facet's first vertex to its second. Owners are positions in
    `facets`. Both elements of a facet see the same curve. So the points need not be sought in the
    elements, which can fail in an element that is curved very much."""
    s, weights = np.polynomial.legendre.leggauss(count)
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    start, end = (
        corners[:, (mesh.t[:, elements] == vertex).argmax(axis=0)]
        for vertex in mesh.facets[:, facets]
    )
    points = start[..., None] + (end - start)[..., None] * (0.5 + 0.5 * s)
    along = np.einsum("ijfq,jf->fqi", mesh.mapping().DF(points, elements), end - start)
    speed = np.linalg.norm(along, axis=-1)
    owners = np.arange(len(facets))
    quadrature = PlacedQuadrature(owners, elements, points, 0.5 * weights * speed)
    return quadrature, along / speed[..., None]
