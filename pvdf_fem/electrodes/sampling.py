"""Points at which electrodes sample the stress: over their areas, or along their edges.

On a mesh that follows an electrode points over its area are the quadrature points of its elements.
On further meshes the electrode is cut from the elements; edges are always cut. The stress is smooth
inside elements, and an integral is exact over the pieces into which elements cut an outline. A
piece is a polygon. Triangles from the first corner to the edges, counted with the sign of their
orientation, add up to a piece: no triangulation is needed. Chords replace curved element edges,
equal for both neighbours: no part of an outline counts twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.points import PlacedQuadrature, compute_local_coordinates
from pvdf_fem.mesh.six_node import find_curved_elements
from pvdf_fem.problem.outputs import Output, output_areas
from pvdf_fem.scene.outlines.outline import Outline

Geometries = NDArray[np.object_]


@dataclass(frozen=True, eq=False)
class Sampling:
    """Sampling points of electrodes for the stress, in rows with a single element."""

    outputs: Indices  #: Index of the electrode that a row of points belongs to, (n,).
    #: The forces that the points add to: 0 is X (component 11 or xx), 1 is Y.
    axes: tuple[int, ...]
    elements: Indices  #: (n,)
    gradients: Array  #: Gradients of the space's functions, 1/m, (n, points, functions, 2).
    #: Factors of the stress in m^2. They add up to an electrode's area for either force, (n,
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


def sample_areas(outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
    """Points over the areas of electrodes, for both forces."""
    follows = np.array([output.patch is not None for output in outputs], dtype=bool)
    followed, others = np.flatnonzero(follows), np.flatnonzero(~follows)
    if len(followed):
        patches = [outputs[i].find_elements(space.mesh) for i in followed.tolist()]
        elements, owners = np.concatenate(patches), np.repeat(followed, list(map(len, patches)))
        gradients, weights = space.gradients[elements], space.weights[elements]
        points = space.basis.quadrature[0][:, None]
        local = np.broadcast_to(points, (2, len(elements), points.shape[-1]))
        yield Sampling(owners, (0, 1), elements, gradients, weights, local)
    if len(others):
        # a stress of St. Venant and Kirchhoff has degree 2 (order - 1), 6 for the highest order
        outlines = [outputs[i].placed for i in others.tolist()]
        owners, elements, points, weights = place_area_points(space.mesh, outlines, degree=6)
        local = compute_local_coordinates(space.mesh, elements, points)
        gradients = space.gradients_at(elements, local)
        yield Sampling(others[owners], (0, 1), elements, gradients, weights, local)


def sample_edges(outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
    """Points along the edges of rectangles: left and right edges for X, lower and upper edges for
    Y. Left and lower are meant in the electrode's own scene. The stress on an edge is the mean of
    its traces from both sides. Beyond a mirror line the stress is taken before the line."""
    lines = np.concatenate([_edge_lines(output, axis) for output in outputs for axis in (0, 1)])
    cut = line_quadrature(space.mesh, lines)
    owners, axes = np.divmod(cut.owners // 2, 2)
    lengths = np.array([2.0 * np.ptp(output.corners, axis=0)[::-1] for output in outputs])
    weights = (output_areas(outputs)[owners] / lengths[owners, axes])[:, None] * cut.weights
    gradients = space.gradients_at(cut.elements, cut.points)
    for axis in (0, 1):
        rows = np.flatnonzero(axes == axis)
        elements, local = cut.elements[rows], cut.points[:, rows]
        yield Sampling(owners[rows], (axis,), elements, gradients[rows], weights[rows], local)


def _edge_lines(output: Output, axis: int) -> Array:
    """Left and right (axis 0), or lower and upper edges (2, 2, 2) in the mesh's axes."""
    lines = np.stack([output.corners, np.roll(output.corners, -1, axis=0)], axis=1)
    return output.to_mesh_axes(lines[lines[:, 0, axis] == lines[:, 1, axis]])


def place_area_points(
    mesh: MeshTri2, outlines: Sequence[Outline], degree: int
) -> tuple[Indices, Indices, Array, Array]:
    """Quadrature over outline areas, exact for polynomials of a `degree` in every element: outline
    and element of each row of points, (n,), points in m, (n, points, 2), and weights in m^2."""
    owners, elements, pieces = _pieces(mesh, [outline.equal_area_polygon for outline in outlines])
    rings = shapely.get_exterior_ring(shapely.orient_polygons(pieces))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    first = corners[np.searchsorted(ring, ring[:-1])]
    a, b = corners[:-1] - first, corners[1:] - first
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    areas *= ring[1:] == ring[:-1]  # no triangle joins the last corner of a ring to the next ring
    used = np.flatnonzero(areas)
    (s, t), weights = get_quadrature(mesh.elem.refdom, degree)
    points = first[used, None] + a[used, None] * s[:, None] + b[used, None] * t[:, None]
    piece = ring[used]
    return owners[piece], elements[piece], points, 2.0 * np.outer(areas[used], weights)


def line_quadrature(
    mesh: MeshTri2, lines: Array, count: int = 4, aside: float = 1e-7
) -> PlacedQuadrature:
    """Quadrature along straight lines (n, 2, 2) from start to end in m, half on either side: the
    stress jumps at element edges, and a line may run along an edge. A piece of a line in an element
    has `count` Gauss points, `aside` times its length beside the line."""
    along = lines[:, 1] - lines[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)[:, None]
    both_sides = np.concatenate([lines + aside * normal, lines - aside * normal])
    owners, elements, pieces = _pieces(mesh, shapely.linestrings(both_sides))
    ends = shapely.get_coordinates(pieces).reshape(-1, 2, 2)
    middle, half = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
    s, weights = np.polynomial.legendre.leggauss(count)
    points = middle[:, None] + half[:, None] * s[:, None]
    return PlacedQuadrature(
        owners % len(lines),
        elements,
        compute_local_coordinates(mesh, elements, points),
        0.5 * np.outer(np.linalg.norm(half, axis=1), weights),
    )


def _pieces(
    mesh: MeshTri2, shapes: Sequence[shapely.Geometry] | Geometries, negligible: float = 1e-12
) -> tuple[Indices, Indices, Geometries]:
    """Pieces into which elements cut polygons, or lines: index of the shape, element, and piece. An
    element that only touches a shape has a piece without size, or below the `negligible` part of
    the shape by rounding."""
    polygons, cut = _element_polygons(mesh), np.asarray(shapes)
    owners, elements = shapely.STRtree(polygons).query(cut)
    pieces, pair = shapely.get_parts(
        shapely.intersection(polygons[elements], cut[owners]), return_index=True
    )
    size = shapely.area if shapely.get_dimensions(cut[0]) == 2 else shapely.length
    owners, elements = owners[pair], elements[pair]
    proper = size(pieces) > negligible * size(cut)[owners]
    return owners[proper], elements[proper], pieces[proper]


def _element_polygons(mesh: MeshTri2, chords: int = 32) -> Geometries:
    """The elements as polygons with this number of chords along curved edges."""
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
    polygons = shapely.polygons(nodes[:, :3].transpose(2, 1, 0))
    curved = np.flatnonzero(find_curved_elements(nodes))
    t = np.arange(chords) / chords
    edges = []
    for start, middle, end in ((0, 3, 1), (1, 4, 2), (2, 5, 0)):
        a, m, b = (nodes[:, i, curved, None] for i in (start, middle, end))
        edges.append(a * (1 - t) * (1 - 2 * t) + 4 * m * t * (1 - t) + b * t * (2 * t - 1))
    rings = np.concatenate(edges, axis=-1).transpose(1, 2, 0)
    polygons[curved] = shapely.polygons(rings)
    return polygons
