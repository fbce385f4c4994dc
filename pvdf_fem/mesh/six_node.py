"""Six-node triangles: the order of their vertices, their curved sides, and how sound they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.scene.outline import Circle

# Ends of the sides of a six-node triangle, in the order of its midside nodes.
SIDES = [[0, 1], [1, 2], [0, 2]]
# How near to a circle a node counts as on it, relative to the film's radius: well above rounding,
# and far below the distance of two circles that touch, an element's size away.
ON_CIRCLE = 1e-12


def with_sorted_vertices(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Six-node triangles with their vertices in ascending order, as cubic elements need them."""
    order = np.argsort(triangles[:, :3], axis=1)
    midside = np.array([[-1, 3, 5], [3, -1, 4], [5, 4, -1]])
    edges = midside[order, np.roll(order, -1, axis=1)]
    return np.take_along_axis(triangles, np.hstack([order, edges]), axis=1)


def bulge(
    points: NDArray[np.float64],
    triangles: NDArray[np.int64],
    circle: Circle,
    curved: NDArray[np.bool_],
    film: float,
) -> None:
    """Move the midside nodes on a circle outwards, so that it has its area.

    They are among the nodes `curved`, inside of arcs: a short chord is as near to the circle.
    `film` is the film's radius.
    A quadratic arc through three points of a circle lies inside it. With the area right, what is
    left of the error changes sign along the arc, and is not felt away from it.
    """
    centre = circle.centre[:, None]
    radius = np.linalg.norm(points - centre, axis=0)
    on = np.abs(radius - circle.radius) < ON_CIRCLE * film
    ends, middle = triangles[:, SIDES].reshape(-1, 2), triangles[:, 3:].ravel()
    arcs = curved[middle] & on[middle] & on[ends].all(axis=1)
    (a, b), middle = ends[arcs].T, middle[arcs]
    half = np.arcsin(0.5 * np.linalg.norm(points[:, a] - points[:, b], axis=0) / circle.radius)
    # Between the arc and its chord: (4/3) (r - cos) sin = half - sin cos, of a unit circle.
    sine, cosine = np.sin(half), np.cos(half)
    bulged = cosine + 0.75 * (half - sine * cosine) / sine
    points[:, middle] = centre + (points[:, middle] - centre) / radius[middle] * (
        bulged * circle.radius
    )


def compression(mesh: MeshTri2) -> NDArray[np.float64]:
    """Least Jacobian over the mean one of each element, (elements,); below 0 where it folds."""
    points, _ = get_quadrature(mesh.elem.refdom, 8)
    jacobian = mesh.mapping().detDF(points)
    mean = jacobian.mean(axis=1, keepdims=True)
    return (jacobian / mean).min(axis=1)
