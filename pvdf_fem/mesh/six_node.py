"""Six-node triangles: the order of their vertices, their curved sides, and their distortion."""

from __future__ import annotations

import numpy as np
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.scene.outlines.outline import Outline

#: Ends of the sides of a six-node triangle, in the order of its midside nodes.
SIDES = [[0, 1], [1, 2], [0, 2]]


def with_sorted_vertices(triangles: Indices) -> Indices:
    """Six-node triangles with their vertices in ascending order, as cubic elements need them."""
    order = np.argsort(triangles[:, :3], axis=1)
    midside = np.array([[-1, 3, 5], [3, -1, 4], [5, 4, -1]])
    edges = midside[order, np.roll(order, -1, axis=1)]
    return np.take_along_axis(triangles, np.hstack([order, edges]), axis=1)


def bulge(
    points: Array,
    triangles: Indices,
    outline: Outline,
    curved: Mask,
    film: float,
    near: float = 1e-12,
) -> None:
    """Move the midside nodes on a smooth outline, in place, so that its elements have its area.
    `points` (2, nodes) and the film's radius `film` are in m. `curved` (nodes,) are nodes inside of
    curved pieces of boundaries: a short chord is as near to the outline. A node is on the outline
    if it is nearer than `near` times the radius: well above rounding, and far below the distance of
    two curves that touch, an element's size away from where they do."""
    on = np.abs(outline.signed_distance(points.T)) < near * film
    ends, middle = triangles[:, SIDES].reshape(-1, 2), triangles[:, 3:].ravel()
    arcs = curved[middle] & on[middle] & on[ends].all(axis=1)
    starts, stops = points[:, ends[arcs]].transpose(2, 1, 0)
    points[:, middle[arcs]] = outline.arc_middles(starts, stops).T


def compression(mesh: MeshTri2) -> Array:
    """Least Jacobian of each element over its mean, (elements,); below 0 where it folds."""
    points, _ = get_quadrature(mesh.elem.refdom, 8)
    jacobian = mesh.mapping().detDF(points)
    mean = jacobian.mean(axis=1, keepdims=True)
    return (jacobian / mean).min(axis=1)
