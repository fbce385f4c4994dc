"""Six-node triangles: the order of their vertices, their curved sides, and their distortion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.scene.outlines.outline import Outline

#: Ends of the sides of a six-node triangle, in the order of the midside nodes.
SIDES = [[0, 1], [1, 2], [0, 2]]


def sort_vertices(triangles: Indices) -> Indices:
    """Sort the vertices of every triangle by index, as conforming cubic elements require.

    Parameters
    ----------
    triangles : ndarray of int, shape (elements, 6)
        Indices of the vertices and then of the midside nodes, in the order of `SIDES`.

    Returns
    -------
    ndarray of int, shape (elements, 6)
        A copy of the triangles with sorted vertices and rearranged midside nodes.
    """
    order = np.argsort(triangles[:, :3], axis=1)
    # column of the midside node between two vertices of a triangle
    midside_node = np.array([[-1, 3, 5], [3, -1, 4], [5, 4, -1]])
    midsides = midside_node[order, np.roll(order, -1, axis=1)]
    return np.take_along_axis(triangles, np.hstack([order, midsides]), axis=1)


def move_midside_nodes_to_arcs(
    points: Array,
    triangles: Indices,
    outline: Outline,
    is_inside_curve: Mask,
    radius: float,
    near: float = 2.5e-9,
) -> None:
    """Move midside nodes on a curved outline, so that the elements inside have the outline's area.

    A side gets a quadratic arc over its chord with the area of the outline's curved piece. Nodes on
    straight pieces and vertices are not moved.

    Parameters
    ----------
    points : ndarray, shape (2, nodes)
        Nodes in m; the array is changed in place.
    triangles : ndarray of int, shape (elements, 6)
        Indices of the vertices and then of the midside nodes, in the order of `SIDES`.
    outline : Outline
        An outline with curved pieces, which the sides of elements follow.
    is_inside_curve : ndarray of bool, shape (nodes,)
        Whether a node is on a curved line of the geometry, but not at its ends. The distance from
        the outline does not show this, since the middle of a short chord is equally close to it.
    radius : float
        Radius of the film in m.
    near : float
        Nodes closer to the outline than this fraction of the radius are on the outline. gmsh merges
        two curves that are up to twice this distance apart, with nodes halfway between them.
        Elements next to the contact of touching curves are large enough to have distinct nodes.
    """
    is_near = np.abs(outline.compute_signed_distances(points.T)) < near * radius
    ends = triangles[:, SIDES].reshape(-1, 2)
    middles = triangles[:, 3:].ravel()
    is_arc = is_inside_curve[middles] & is_near[middles] & is_near[ends].all(axis=1)
    first, second = ends[is_arc].T
    midpoints = outline.compute_arc_midpoints(points[:, first].T, points[:, second].T)
    points[:, middles[is_arc]] = midpoints.T


def find_curved_elements(nodes: Array, bent: float = 1e-9) -> Mask:
    """Find elements with a curved side.

    Parameters
    ----------
    nodes : ndarray, shape (2, 6, elements)
        Coordinates of the vertices and then of the midside nodes of each element.
    bent : float
        A side is curved if a coordinate of its midside node differs from that of the side's
        midpoint by more than this fraction of the element's size.

    Returns
    -------
    ndarray of bool, shape (elements,)
        Whether an element has a curved side.
    """
    corners = nodes[:, :3]
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    offsets = np.abs(nodes[:, 3:] - middles)
    return offsets.max(axis=(0, 1)) > bent * np.ptp(corners, axis=1).max(axis=0)


def compute_jacobian_ratios(mesh: MeshTri2) -> Array:
    """Compute the minimum Jacobian determinant divided by the mean one, in every element.

    Both are taken over quadrature points. The ratio is 1 for straight sides; it is not positive for
    an element that is folded at one of the points.

    Returns
    -------
    ndarray, shape (elements,)
    """
    points, _ = get_quadrature(mesh.elem.refdom, 8)
    ratios = np.ones(mesh.nelements)
    curved = np.flatnonzero(find_curved_elements(mesh.doflocs[:, mesh.dofs.element_dofs]))
    jacobian = mesh.mapping().detDF(points, curved)
    ratios[curved] = (jacobian / jacobian.mean(axis=1, keepdims=True)).min(axis=1)
    return ratios


def bend_sides(
    mesh: MeshTri2, is_distorted: Mask, min_jacobian_ratio: float
) -> tuple[MeshTri2, Mask]:
    """Bend the sides of distorted elements along the most curved side of each element.

    In a gap between outlines that is narrower than the height of an arc over its chord, straight
    sides would cross the arc. Sides on the boundary of the mesh or of a subdomain are not bent.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m; it is not changed.
    is_distorted : ndarray of bool, shape (elements,)
        Whether the Jacobian ratio of an element is below `min_jacobian_ratio`.
    min_jacobian_ratio : float
        Minimum Jacobian of an element as a fraction of its mean.

    Returns
    -------
    mesh : MeshTri2
        A copy of the mesh with bent sides, or the mesh itself if this does not help.
    is_distorted : ndarray of bool, shape (elements,)
        Whether an element is still distorted.

    Notes
    -----
    With the height h of the arc over its chord c, a side s is bent by h (s·c / c·c)². All three
    sides are then images of straight ones under one quadratic shear, whose Jacobian is constant.
    This is repeated for the elements that are still distorted, until their number does not decrease
    any more; the last attempt is discarded.
    """
    elements = np.arange(mesh.nelements)
    patch_of = np.stack([np.isin(elements, patch) for patch in mesh.subdomains.values()])
    first, second = mesh.f2t
    is_inside_patch = (second >= 0) & (patch_of[:, first] == patch_of[:, second]).all(axis=0)
    movable = mesh.dofs.facet_dofs[0, is_inside_patch]
    while is_distorted.any():
        nodes = mesh.dofs.element_dofs[:, is_distorted]
        first_ends, second_ends = np.transpose(SIDES)
        starts = mesh.doflocs[:, nodes[first_ends]]  # shape (2, 3, distorted elements)
        ends = mesh.doflocs[:, nodes[second_ends]]
        chords = ends - starts
        middles = 0.5 * (starts + ends)
        heights = mesh.doflocs[:, nodes[3:]] - middles
        highest = np.linalg.norm(heights, axis=0).argmax(axis=0)[None, None]
        chord = np.take_along_axis(chords, highest, axis=1)
        height = np.take_along_axis(heights, highest, axis=1)
        extents = (chords * chord).sum(axis=0) / (chord**2).sum(axis=0)  # s·c / c·c
        wanted = (middles + height * extents**2).reshape(2, -1)

        # a side between two distorted elements gets the mean of the positions that they require
        sides, owner, count = np.unique(nodes[3:].ravel(), return_inverse=True, return_counts=True)
        mean = np.stack([np.bincount(owner, coordinate) for coordinate in wanted]) / count
        is_movable = np.isin(sides, movable)
        points = mesh.doflocs.copy()
        points[:, sides[is_movable]] = mean[:, is_movable]
        bent_mesh = replace(mesh, doflocs=points)
        is_still_distorted = compute_jacobian_ratios(bent_mesh) < min_jacobian_ratio
        if is_still_distorted.sum() >= is_distorted.sum():
            break
        mesh = bent_mesh
        is_distorted = is_still_distorted
    return mesh, is_distorted


def repair_distorted_elements(
    mesh: MeshTri2, min_jacobian_ratio: float, max_move: float
) -> tuple[MeshTri2, Mask]:
    """Repair distorted elements: bend sides in narrow gaps, then straighten those that remain.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m; it is not changed.
    min_jacobian_ratio : float
        Minimum Jacobian of an element as a fraction of its mean; elements below it are distorted.
    max_move : float
        Maximum displacement in m of a midside node to straighten its side. Sides that need a larger
        one stay curved, so that elements may stay distorted.

    Returns
    -------
    mesh : MeshTri2
        A repaired copy of the mesh, or the mesh itself if no side was changed.
    is_distorted : ndarray of bool, shape (elements,)
        Whether an element is still distorted.
    """
    is_distorted = compute_jacobian_ratios(mesh) < min_jacobian_ratio
    if is_distorted.any():
        mesh, is_distorted = bend_sides(mesh, is_distorted, min_jacobian_ratio)
    while is_distorted.any():
        points = mesh.doflocs.copy()
        nodes = mesh.dofs.element_dofs[:, is_distorted]
        for middle, (a, b) in enumerate(SIDES, start=3):
            halfway = 0.5 * (points[:, nodes[a]] + points[:, nodes[b]])
            moves = np.linalg.norm(halfway - points[:, nodes[middle]], axis=0)
            is_near = moves <= max_move
            points[:, nodes[middle][is_near]] = halfway[:, is_near]
        if np.array_equal(points, mesh.doflocs):
            break
        mesh = replace(mesh, doflocs=points)
        is_distorted = compute_jacobian_ratios(mesh) < min_jacobian_ratio
    return mesh, is_distorted
