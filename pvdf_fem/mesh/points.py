"""Location of points in a mesh: the element that contains a point, and its local coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.six_node import find_curved_elements


def find_nearest_elements(
    mesh: MeshTri2, points: Array, candidates: int = 8
) -> tuple[Indices, Array]:
    """Find the elements that would contain points if all sides were straight.

    A point that no element contains gets the element that comes closest to containing it.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    points : ndarray, shape (2, n)
        Points in m.
    candidates : int
        Number of elements with the nearest centroids that are searched for each point.

    Returns
    -------
    elements : ndarray of int, shape (n,)
        The element of each point: among the candidates, the one with the largest minimum of the
        three barycentric coordinates, which is negative outside.
    local : ndarray, shape (2, n)
        Local coordinates of the points in these elements with straight sides.
    """
    from scipy.spatial import cKDTree  # imported here, since most solves do not need it

    corners = mesh.p[:, mesh.t]
    tree = cKDTree(corners.mean(axis=1).T)
    _, near = tree.query(points.T, k=min(candidates, mesh.nelements))
    near = near.reshape(points.shape[1], -1)
    origin = corners[:, 0][:, near]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    inverse = np.linalg.inv(edges.transpose(1, 0, 2))[near]
    local = np.einsum("pcij,jpc->ipc", inverse, points[:, :, None] - origin)
    # minimum of the three barycentric coordinates, negative outside of an element
    least_weight = np.minimum(local.min(axis=0), 1.0 - local.sum(axis=0))
    best = least_weight.argmax(axis=1)[:, None]
    elements = np.take_along_axis(near, best, axis=1)[:, 0]
    return elements, np.take_along_axis(local, best[None], axis=2)[..., 0]


def locate_points(mesh: MeshTri2, points: Array, steps: int = 50) -> tuple[Indices, Array]:
    """Find the elements that contain points, taking curved sides into account.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    points : ndarray, shape (2, n)
        Points in m.
    steps : int
        Maximum number of steps from an element to its neighbour, see Notes.

    Returns
    -------
    elements : ndarray of int, shape (n,)
        The element of each point. A point beyond the rim gets an element at the rim, and a point
        that is not located after the last step the element where the search ended.
    local : ndarray, shape (2, n)
        Local coordinates of the points in these elements. If the element does not contain the
        point, they are outside of the reference triangle.

    Notes
    -----
    The search starts in the element that would contain the point if sides were straight. While the
    point lies beyond a side of the element, the search goes on in the neighbour across that side.
    """
    opposite_facets = mesh.t2f[[1, 2, 0]]  # the facets opposite to the three vertices
    first, second = mesh.f2t[:, opposite_facets]
    neighbours = np.where(first == np.arange(mesh.nelements), second, first)
    elements, _ = find_nearest_elements(mesh, points, 32)
    for step in range(steps + 1):
        local = compute_local_coordinates(mesh, elements, points.T[:, None])[:, :, 0]
        weights = np.stack([1.0 - local.sum(axis=0), *local])
        opposite_vertex = weights.argmin(axis=0)
        following = neighbours[opposite_vertex, elements]
        leaves = (weights.min(axis=0) < -1e-9) & (following >= 0)
        if step == steps or not leaves.any():
            break
        elements = np.where(leaves, following, elements)
    return elements, local


def compute_local_coordinates(
    mesh: MeshTri2, elements: Indices, points: Array, newton_steps: int = 6
) -> Array:
    """Compute the local coordinates of points in given elements, by Newton's method if curved.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    elements : ndarray of int, shape (n,)
        The element of each row of points.
    points : ndarray, shape (n, k, 2)
        Rows of k points in m.
    newton_steps : int
        Number of Newton steps in curved elements; straight elements need none.

    Returns
    -------
    ndarray, shape (2, n, k)
        Local coordinates.
    """
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, elements]]
    jacobian = np.stack([nodes[:, 1] - nodes[:, 0], nodes[:, 2] - nodes[:, 0]], axis=1)
    inverse = np.linalg.inv(jacobian.transpose(2, 0, 1))
    local = np.einsum("nij,npj->inp", inverse, points - nodes[:, 0].T[:, None])
    curved_rows = np.flatnonzero(find_curved_elements(nodes))
    if len(curved_rows) == 0:
        return local
    mapping = mesh.mapping()
    targets = points.transpose(2, 0, 1)[:, curved_rows]
    curved = elements[curved_rows]
    for _ in range(newton_steps):
        guess = local[:, curved_rows]
        residual = targets - mapping.F(guess, curved)
        step = np.einsum("ijnp,jnp->inp", mapping.invDF(guess, curved), residual)
        local[:, curved_rows] += step
    return local


@dataclass(frozen=True, eq=False)
class PlacedQuadrature:
    """Quadrature points in the elements of a mesh, in n rows of k points.

    Parameters
    ----------
    owners : ndarray of int, shape (n,)
        Index of the outline, line or facet to whose integral each row contributes.
    elements : ndarray of int, shape (n,)
        The element in which each row of points lies.
    points : ndarray, shape (2, n, k)
        Local coordinates in the elements.
    weights : ndarray, shape (n, k)
        Quadrature weights, in m² for areas and in m for lines.
    """

    owners: Indices
    elements: Indices
    points: Array
    weights: Array


def make_facet_quadrature(
    mesh: MeshTri2, facets: Indices, elements: Indices, count: int = 3
) -> tuple[PlacedQuadrature, Array]:
    """Make a Gauss quadrature on facets, with points in the coordinates of a given element.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    facets : ndarray of int, shape (n,)
        Indices of the facets.
    elements : ndarray of int, shape (n,)
        For each facet, an element that it belongs to.
    count : int
        Number of points on each facet.

    Returns
    -------
    quadrature : PlacedQuadrature
        The owner of a row is the position of its facet in `facets`.
    tangents : ndarray, shape (n, count, 2)
        Unit tangents at the points, from the first vertex of the facet to the second one.

    Notes
    -----
    The local coordinates follow from the vertices of the facet. Locating the points by their global
    coordinates would be slower, and could fail in strongly curved elements.
    """
    s, weights = np.polynomial.legendre.leggauss(count)
    reference_corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    first_vertex, second_vertex = mesh.facets[:, facets]
    vertices = mesh.t[:, elements]
    start = reference_corners[:, (vertices == first_vertex).argmax(axis=0)]
    end = reference_corners[:, (vertices == second_vertex).argmax(axis=0)]
    points = start[..., None] + (end - start)[..., None] * (0.5 + 0.5 * s)
    jacobian = mesh.mapping().DF(points, elements)
    along = np.einsum("ijfq,jf->fqi", jacobian, end - start)
    speed = np.linalg.norm(along, axis=-1)
    quadrature = PlacedQuadrature(
        owners=np.arange(len(facets)),
        elements=elements,
        points=points,
        weights=0.5 * weights * speed,
    )
    return quadrature, along / speed[..., None]
