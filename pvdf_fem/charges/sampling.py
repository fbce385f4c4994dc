"""Points at which electrodes sample the stress: over their areas, or along their edges.

On a mesh that follows an electrode these are quadrature points of the electrode's elements or
facets; on any other mesh the electrode is cut out of the elements.
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
from pvdf_fem.mesh.points import PlacedQuadrature, facet_quadrature


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
    followed, others = _by_mesh(goals)
    if len(followed):
        patches = [goals[i].elements(space.mesh) for i in followed]
        elements, owners = np.concatenate(patches), np.repeat(followed, list(map(len, patches)))
        gradients, weights = space.gradients[elements], space.weights[elements]
        points = space.basis.quadrature[0][:, None]
        local = np.broadcast_to(points, (2, len(elements), points.shape[-1]))
        yield Sampling(owners, (0, 1), elements, gradients, weights, local)
    if len(others):
        cut = area_quadrature(space.mesh, [goals[i].placed for i in others])
        gradients = space.gradients_at(cut.elements, cut.points)
        owners = others[cut.owners]
        yield Sampling(owners, (0, 1), cut.elements, gradients, cut.weights, cut.points)


def edge_samplings(goals: Sequence[Goal], space: Space) -> Iterator[Sampling]:
    """Points along the edges of rectangles: left and right ones for X, lower and upper ones for Y.
    Left and lower are meant in the electrode's own scene. The stress on an edge is the mean of its
    traces from both sides. Beyond a mirror line it is that before the line."""
    followed, others = _by_mesh(goals)
    mesh = space.mesh
    sides = [facets for i in followed for facets in _side_facets(goals[i], mesh)]
    if any(map(len, sides)):
        edges = np.repeat(_edges_of(followed), list(map(len, sides)))
        traces = _both_traces(mesh, np.concatenate(sides))
        yield from _edge_means(goals, space, edges[traces.owners], traces)
    if len(others):
        lines = np.concatenate([_edge_lines(goals[i], axis) for i in others for axis in (0, 1)])
        cut = line_quadrature(mesh, lines)
        yield from _edge_means(goals, space, np.repeat(_edges_of(others), 2)[cut.owners], cut)


def _by_mesh(goals: Sequence[Goal]) -> tuple[Indices, Indices]:
    """Indices of the electrodes with edges along the mesh, and of electrodes without."""
    follows = np.array([goal.patch is not None for goal in goals], dtype=bool)
    return np.flatnonzero(follows), np.flatnonzero(~follows)


def _edges_of(indices: Indices) -> Indices:
    """Numbers 2 i + axis of the pairs of opposite edges of the electrodes i, (2 electrodes,)."""
    return (2 * indices[:, None] + np.arange(2)).ravel()


def _edge_means(
    goals: Sequence[Goal], space: Space, edges: Indices, along: PlacedQuadrature
) -> Iterator[Sampling]:
    """The area times the mean over opposite edges, whose numbers are those of `_edges_of`."""
    owners, axes = np.divmod(edges, 2)
    lengths = np.array([2.0 * np.ptp(goal.corners, axis=0)[::-1] for goal in goals])
    weights = (areas_of(goals)[owners] / lengths[owners, axes])[:, None] * along.weights
    gradients = space.gradients_at(along.elements, along.points)
    for axis in (0, 1):
        rows = np.flatnonzero(axes == axis)
        elements, local = along.elements[rows], along.points[:, rows]
        yield Sampling(owners[rows], (axis,), elements, gradients[rows], weights[rows], local)


def _both_traces(mesh: MeshTri2, facets: Indices) -> PlacedQuadrature:
    """Quadrature on facets, half of it in each of their two elements, by position in `facets`."""
    first, second = mesh.f2t[:, facets]
    elements = np.concatenate([first, np.where(second < 0, first, second)])
    traces, _ = facet_quadrature(mesh, np.tile(facets, 2), elements)
    owners = traces.owners % len(facets)
    return PlacedQuadrature(owners, elements, traces.points, 0.5 * traces.weights)


def _side_facets(goal: Goal, mesh: MeshTri2, close: float = 1e-6) -> tuple[Indices, Indices]:
    """Facets of a patch on the left and right edges of its rectangle, and on the lower and upper. A
    facet is on an edge if its middle is as `close` to it, relative to the rectangle's size. The
    patch of a part of the film ends at the mirror lines too, no edges of the electrode."""
    facets, count = np.unique(mesh.t2f[:, goal.elements(mesh)], return_counts=True)
    facets = facets[count == 1]
    middle = mesh.p[:, mesh.facets[:, facets]].mean(axis=1).T @ goal.frame
    low, high = goal.corners.min(axis=0), goal.corners.max(axis=0)
    distance = np.minimum(np.abs(middle - low), np.abs(middle - high)) / (high - low)
    return facets[distance[:, 0] < close], facets[distance[:, 1] < close]


def _edge_lines(goal: Goal, axis: int) -> Array:
    """Left and right (axis 0), or lower and upper edges (2, 2, 2) in the mesh's axes."""
    lines = np.stack([goal.corners, np.roll(goal.corners, -1, axis=0)], axis=1)
    return goal.place(lines[lines[:, 0, axis] == lines[:, 1, axis]])
