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
    """Sort the vertices of six-node triangles (elements, 6), as cubic elements need them."""
    order = np.argsort(triangles[:, :3], axis=1)
    midside_node = np.array([[-1, 3, 5], [3, -1, 4], [5, 4, -1]])
    midsides = midside_node[order, np.roll(order, -1, axis=1)]
    return np.take_along_axis(triangles, np.hstack([order, midsides]), axis=1)


def bulge_arcs(
    points: Array,
    triangles: Indices,
    outline: Outline,
    is_curved: Mask,
    radius: float,
    near: float = 2.5e-9,
) -> None:
    """Move the midside nodes on a curved outline in place, so that its elements have its area.

    Parameters
    ----------
    points : ndarray, shape (2, nodes)
        In m; changed in place.
    triangles : ndarray of int, shape (elements, 6)
        Nodes of the triangles.
    outline : Outline
        The outline whose area the elements get.
    is_curved : ndarray of bool, shape (nodes,)
        Nodes inside of curved pieces of boundaries. Their distance alone is not enough: a short
        chord is equally near to the outline.
    radius : float
        Radius of the film in m.
    near : float
        A node is on the outline where its distance is below this share of the radius. Where curves
        lie up to twice this distance apart, gmsh makes a single node halfway; curves that touch are
        much farther apart an element's size from their contact.
    """
    is_near = np.abs(outline.compute_signed_distances(points.T)) < near * radius
    ends = triangles[:, SIDES].reshape(-1, 2)
    middles = triangles[:, 3:].ravel()
    is_arc = is_curved[middles] & is_near[middles] & is_near[ends].all(axis=1)
    starts, stops = points[:, ends[is_arc]].transpose(2, 1, 0)
    points[:, middles[is_arc]] = outline.compute_arc_midpoints(starts, stops).T


def find_curved_elements(nodes: Array, bent: float = 1e-9) -> Mask:
    """Find elements with a curved edge.

    Parameters
    ----------
    nodes : ndarray, shape (2, 6, elements)
        Places of the elements' nodes.
    bent : float
        An edge is curved where its midside node is farther from its middle than this share of the
        element's size.

    Returns
    -------
    ndarray of bool, shape (elements,)
    """
    corners = nodes[:, :3]
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    offsets = np.abs(nodes[:, 3:] - middles)
    return offsets.max(axis=(0, 1)) > bent * np.ptp(corners, axis=1).max(axis=0)


def compute_jacobian_ratios(mesh: MeshTri2) -> Array:
    """Compute the least Jacobian over the mean one of every element; below 0 where it folds."""
    points, _ = get_quadrature(mesh.elem.refdom, 8)
    ratios = np.ones(mesh.nelements)
    curved = np.flatnonzero(find_curved_elements(mesh.doflocs[:, mesh.dofs.element_dofs]))
    jacobian = mesh.mapping().detDF(points, curved)
    ratios[curved] = (jacobian / jacobian.mean(axis=1, keepdims=True)).min(axis=1)
    return ratios


def bend_sides(
    mesh: MeshTri2, is_distorted: Mask, min_jacobian_ratio: float
) -> tuple[MeshTri2, Mask]:
    """Bend sides inside of patches next to arcs, in gaps narrower than the height of the arcs.

    Straight sides would cross the arcs there.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    is_distorted : ndarray of bool, shape (elements,)
        Elements with a Jacobian ratio below `min_jacobian_ratio`.
    min_jacobian_ratio : float
        Least Jacobian of an element over its mean.

    Returns
    -------
    mesh : MeshTri2
    is_distorted : ndarray of bool, shape (elements,)
        Elements that are still distorted.

    Notes
    -----
    A side is bent by the height of the arc over its chord, times the square of the side's extent
    along this chord over the chord's length: a quadratic shear of the element, whose Jacobian is
    constant. Passes end when they repair no more elements.
    """
    elements = np.arange(mesh.nelements)
    patch_of = np.stack([np.isin(elements, patch) for patch in mesh.subdomains.values()])
    first, second = mesh.f2t
    is_inside_patch = (second >= 0) & (patch_of[:, first] == patch_of[:, second]).all(axis=0)
    movable = mesh.dofs.facet_dofs[0, is_inside_patch]
    while is_distorted.any():
        nodes = mesh.dofs.element_dofs[:, is_distorted]
        starts, ends = mesh.doflocs[:, nodes[np.transpose(SIDES)]].swapaxes(0, 1)
        chords = ends - starts
        middles = 0.5 * (starts + ends)
        heights = mesh.doflocs[:, nodes[3:]] - middles
        highest = np.linalg.norm(heights, axis=0).argmax(axis=0)[None, None]
        chord = np.take_along_axis(chords, highest, axis=1)
        height = np.take_along_axis(heights, highest, axis=1)
        extents = (chords * chord).sum(axis=0) / (chord**2).sum(axis=0)
        wanted = (middles + height * extents**2).reshape(2, -1)

        # a side of two distorted elements goes to the mean of both wanted places
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


def straighten_sides(
    mesh: MeshTri2, min_jacobian_ratio: float, largest_move: float
) -> tuple[MeshTri2, Mask]:
    """Repair distorted elements: bend sides in gaps, and straighten sides in narrow cusps.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    min_jacobian_ratio : float
        Least Jacobian of an element over its mean.
    largest_move : float
        Largest move of a midside node in m by which a side is straightened.

    Returns
    -------
    mesh : MeshTri2
    is_distorted : ndarray of bool, shape (elements,)
        Elements that are still distorted.
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
            is_near = moves <= largest_move
            points[:, nodes[middle][is_near]] = halfway[:, is_near]
        if np.array_equal(points, mesh.doflocs):
            break
        mesh = replace(mesh, doflocs=points)
        is_distorted = compute_jacobian_ratios(mesh) < min_jacobian_ratio
    return mesh, is_distorted
