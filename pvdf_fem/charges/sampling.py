"""Points at which electrodes sample the stress: over their areas, or along their edges.

On a mesh that follows an electrode points over its area are the quadrature points of its elements;
on any other mesh the electrode is cut out of the elements, as its edges are on all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.charges.goals import Goal, areas_of
from pvdf_fem.charges.quadrature import area_quadrature, line_quadrature
from pvdf_fem.film.space import Space


@dataclass(frozen=True, eq=False)
class Sampling:
    """Points at which electrodes sample the stress, in rows that lie in one element each."""

    goals: Indices  #: Index of the electrode that a row of points belongs to, (n,).
    #: The forces that the points add to: 0 is X (component 11 or xx), 1 is Y.
    axes: tuple[int, ...]
    elements: Indices  #: (n,)
    gradients: Array  #: Gradients of the space's functions, 1/m, (n, points, functions, 2).
    #: Factors of the stress in m^2. They add up to an electrode's area for each of its forces, (n,
    #: points).
    weights: Array
    #: Local coordinates of the points in their elements, (2, n, points).
    local: Array

    def places(self, mesh: MeshTri2) -> Array:
        """The points in m, (n, points, 2)."""
        return np.moveaxis(np.asarray(mesh.mapping().F(self.local, self.elements)), 0, -1)

    def gradient(self, space: Space, x: Array) -> Array:
        """Displacement gradient (n, points, 3, 2) of the dofs `x`."""
        nodal = x[space.element_dofs[self.elements]].reshape(len(self.elements), 1, -1, 3)
        return np.matmul(nodal.swapaxes(2, 3), self.gradients)


def area_samplings(goals: Sequence[Goal], space: Space) -> Iterator[Sampling]:
    """Points over the areas of electrodes, for both forces."""
    follows = np.array([goal.patch is not None for goal in goals], dtype=bool)
    followed, others = np.flatnonzero(follows), np.flatnonzero(~follows)
    if len(followed):
        patches = [goals[i].elements(space.mesh) for i in followed.tolist()]
        elements, owners = np.concatenate(patches), np.repeat(followed, list(map(len, patches)))
        gradients, weights = space.gradients[elements], space.weights[elements]
        points = space.basis.quadrature[0][:, None]
        local = np.broadcast_to(points, (2, len(elements), points.shape[-1]))
        yield Sampling(owners, (0, 1), elements, gradients, weights, local)
    if len(others):
        cut = area_quadrature(space.mesh, [goals[i].placed for i in others.tolist()])
        gradients = space.gradients_at(cut.elements, cut.points)
        owners = others[cut.owners]
        yield Sampling(owners, (0, 1), cut.elements, gradients, cut.weights, cut.points)


def edge_samplings(goals: Sequence[Goal], space: Space) -> Iterator[Sampling]:
    """Points along the edges of rectangles: left and right ones for X, lower and upper ones for Y.
    Left and lower are meant in the electrode's own scene. The stress on an edge is the mean of its
    traces from both sides. Beyond a mirror line it is that before the line."""
    lines = np.concatenate([_edge_lines(goal, axis) for goal in goals for axis in (0, 1)])
    cut = line_quadrature(space.mesh, lines)
    owners, axes = np.divmod(cut.owners // 2, 2)
    lengths = np.array([2.0 * np.ptp(goal.corners, axis=0)[::-1] for goal in goals])
    weights = (areas_of(goals)[owners] / lengths[owners, axes])[:, None] * cut.weights
    gradients = space.gradients_at(cut.elements, cut.points)
    for axis in (0, 1):
        rows = np.flatnonzero(axes == axis)
        elements, local = cut.elements[rows], cut.points[:, rows]
        yield Sampling(owners[rows], (axis,), elements, gradients[rows], weights[rows], local)


def _edge_lines(goal: Goal, axis: int) -> Array:
    """Left and right (axis 0), or lower and upper edges (2, 2, 2) in the mesh's axes."""
    lines = np.stack([goal.corners, np.roll(goal.corners, -1, axis=0)], axis=1)
    return goal.place(lines[lines[:, 0, axis] == lines[:, 1, axis]])
