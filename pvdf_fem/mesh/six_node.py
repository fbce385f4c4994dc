"""Six-node triangles: the order of their vertices, their curved sides, and their distortion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.scene.outlines.outline import Outline

#: Ends of the sides in a six-node triangle, in the order of midside nodes.
SIDES = [[0, 1], [1, 2], [0, 2]]


def sort_vertices(triangles: Indices) -> Indices:
    """Six-node triangles with vertices in ascending order, for cubic elements."""
    order = np.argsort(triangles[:, :3], axis=1)
    midside = np.array([[-1, 3, 5], [3, -1, 4], [5, 4, -1]])
    edges = midside[order, np.roll(order, -1, axis=1)]
    return np.take_along_axis(triangles, np.hstack([order, edges]), axis=1)


def bulge_arcs(
    points: Array,
    triangles: Indices,
    outline: Outline,
    curved: Mask,
    film: float,
    near: float = 2.5e-9,
) -> None:
    """Move the midside nodes on a smooth outline, in place, so that its elements have its area.
    `points` (2, nodes) and the film's radius `film` are in m. `curved` (nodes,) are nodes inside
    curved pieces of boundaries: a short chord is equally near to the outline. A node is on the
    outline if its distance is below `near` times the radius. Where curves lie up to twice this
    distance apart, gmsh makes a single node halfway; touching curves are much farther apart an
    element's size from their contact."""
    on = np.abs(outline.compute_signed_distances(points.T)) < near * film
    ends, middle = triangles[:, SIDES].reshape(-1, 2), triangles[:, 3:].ravel()
    arcs = curved[middle] & on[middle] & on[ends].all(axis=1)
    starts, stops = points[:, ends[arcs]].transpose(2, 1, 0)
    points[:, middle[arcs]] = outline.compute_arc_midpoints(starts, stops).T


def find_curved_elements(nodes: Array, bent: float = 1e-9) -> Mask:
    """Which of the elements with the nodes (2, 6, elements) have a curved edge. An edge is curved
    whose midside node is farther than `bent` from its middle, relative to the element's size."""
    corners = nodes[:, :3]
    off = np.abs(nodes[:, 3:] - 0.5 * (corners + np.roll(corners, -1, axis=1)))
    return off.max(axis=(0, 1)) > bent * np.ptp(corners, axis=1).max(axis=0)


def compute_jacobian_ratios(mesh: MeshTri2) -> Array:
    """Least Jacobian in every element over its mean, (elements,); below 0 where it folds."""
    points, _ = get_quadrature(mesh.elem.refdom, 8)
    least = np.ones(mesh.nelements)
    curved = np.flatnonzero(find_curved_elements(mesh.doflocs[:, mesh.dofs.element_dofs]))
    jacobian = mesh.mapping().detDF(points, curved)
    least[curved] = (jacobian / jacobian.mean(axis=1, keepdims=True)).min(axis=1)
    return least


def bend_sides(mesh: MeshTri2, distorted: Mask, least_jacobian: float) -> tuple[MeshTri2, Mask]:
    """The mesh with bent sides inside of patches, where elements (elements,) are `distorted`: they
    have a Jacobian below `least_jacobian` times its mean; and which elements still are. In a gap
    narrower than the height of its arcs over their chords, straight sides would cross the arcs. A
    side is bent by the arc's height times the square of its own extent along the arc's chord over
    that chord: a quadratic shear of the element, whose Jacobian is constant. Passes end when they
    mend no more elements."""
    every = np.arange(mesh.nelements)
    patch_of = np.stack([np.isin(every, elements) for elements in mesh.subdomains.values()])
    first, second = mesh.f2t
    inside = (second >= 0) & (patch_of[:, first] == patch_of[:, second]).all(axis=0)
    movable = mesh.dofs.facet_dofs[0, inside]
    while distorted.any():
        nodes = mesh.dofs.element_dofs[:, distorted]
        starts, ends = mesh.doflocs[:, nodes[np.transpose(SIDES)]].swapaxes(0, 1)
        chords, middles = ends - starts, 0.5 * (starts + ends)
        heights = mesh.doflocs[:, nodes[3:]] - middles
        highest = np.linalg.norm(heights, axis=0).argmax(axis=0)[None, None]
        chord, height = (np.take_along_axis(a, highest, axis=1) for a in (chords, heights))
        extents = (chords * chord).sum(axis=0) / (chord**2).sum(axis=0)
        wanted = (middles + height * extents**2).reshape(2, -1)
        points, sides = mesh.doflocs.copy(), nodes[3:].ravel()
        moved, owner, count = np.unique(sides, return_inverse=True, return_counts=True)
        mean = np.stack([np.bincount(owner, places) for places in wanted]) / count
        chosen = np.isin(moved, movable)
        points[:, moved[chosen]] = mean[:, chosen]
        after = replace(mesh, doflocs=points)
        still = compute_jacobian_ratios(after) < least_jacobian
        if still.sum() >= distorted.sum():
            break
        mesh, distorted = after, still
    return mesh, distorted


def straighten_sides(mesh: MeshTri2, least_jacobian: float, most: float) -> tuple[MeshTri2, Mask]:
    """The mesh with bent sides for distorted elements in gaps (`bend_sides`), then with straight
    sides where they move by up to `most`, in cusps too narrow for an arc. And which elements
    (elements,) are distorted still."""
    distorted = compute_jacobian_ratios(mesh) < least_jacobian
    if distorted.any():
        mesh, distorted = bend_sides(mesh, distorted, least_jacobian)
    while distorted.any():
        points, nodes = mesh.doflocs.copy(), mesh.dofs.element_dofs[:, distorted]
        for middle, (a, b) in enumerate(SIDES, start=3):
            halfway = 0.5 * (points[:, nodes[a]] + points[:, nodes[b]])
            near = np.linalg.norm(halfway - points[:, nodes[middle]], axis=0) <= most
            points[:, nodes[middle][near]] = halfway[:, near]
        if np.array_equal(points, mesh.doflocs):
            break
        mesh = replace(mesh, doflocs=points)
        distorted = compute_jacobian_ratios(mesh) < least_jacobian
    return mesh, distorted
