"""Points at which electrodes sample the stress: over their areas, or along their edges.

On a mesh that follows an electrode, the points over its area are the quadrature points of its
elements. On other meshes the electrode's outline is intersected with the elements; edges always
are. The stress is smooth inside elements, so that an integral is accurate over each of the pieces
into which elements cut an outline. A piece is a polygon. It is the sum of the triangles from its
first corner to its edges, with the sign of their orientation, so that no triangulation is needed.
Curved element edges are replaced by chords, the same ones for both neighbours, so that no part of
an outline counts twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.points import PlacedQuadrature, compute_local_coordinates
from pvdf_fem.mesh.six_node import find_curved_elements
from pvdf_fem.problem.outputs import Output, compute_output_areas
from pvdf_fem.scene.outlines.outline import Outline

Geometries = NDArray[np.object_]


#: Polynomial degree that is integrated exactly over the pieces of an outline. The stress of a St.
#: Venant-Kirchhoff film has degree 2 (order - 1): 6 for the elements of order 4 in the estimate.
AREA_DEGREE = 6
#: Number of chords that replace a curved element edge.
CHORDS = 32


@dataclass(frozen=True, eq=False)
class Sampling:
    """Points at which electrodes sample the stress; the points of a row lie in one element.

    The functions are the scalar shape functions of the finite-element space.
    """

    outputs: Indices  #: Index of the electrode that a row belongs to, shape (n,).
    #: The stress integrals to which the points contribute: 0 for X (component 11 or xx), 1 for Y.
    axes: tuple[int, ...]
    elements: Indices  #: Element of each row, shape (n,).
    gradients: Array  #: Gradients of shape functions in 1/m, shape (n, points, functions, 2).
    #: Quadrature weights in m², shape (n, points). The weights of an electrode and its reflections
    #: add up to its area.
    weights: Array
    #: Local coordinates of the points in their elements, shape (2, n, points).
    local: Array

    def global_points(self, mesh: MeshTri2) -> Array:
        """Compute the global coordinates of the points in m.

        Returns
        -------
        ndarray, shape (n, points, 2)
        """
        points = mesh.mapping().F(self.local, self.elements)
        return np.moveaxis(np.asarray(points), 0, -1)

    def gradient(self, space: Space, x: Array) -> Array:
        """Compute the displacement gradient at the points from the dofs `x`.

        Returns
        -------
        ndarray, shape (n, points, 3, 2)
        """
        nodal = x[space.element_dofs[self.elements]].reshape(len(self.elements), 1, -1, 3)
        return np.matmul(nodal.swapaxes(2, 3), self.gradients)


class AreaPoints(NamedTuple):
    """Quadrature points inside outlines; the points of a row lie in one element."""

    owners: Indices  #: Index of the outline of a row, shape (n,).
    elements: Indices  #: Element of a row, shape (n,).
    points: Array  #: In m, shape (n, points, 2).
    #: In m², shape (n, points). Some may be negative: they are those of triangles with a sign.
    weights: Array


class Pieces(NamedTuple):
    """The pieces into which elements cut polygons or lines."""

    owners: Indices  #: Index of the polygon or line that a piece belongs to, shape (n,).
    elements: Indices  #: Element that a piece lies in, shape (n,).
    shapes: Geometries  #: The pieces, shape (n,).


def sample_areas(outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
    """Yield points over the areas of electrodes, for both stress integrals.

    Parameters
    ----------
    outputs : sequence of Output
        The electrodes. Those with a `patch`, which the mesh follows, are sampled at the quadrature
        points of their elements; the outlines of the others are cut by the elements.
    space : Space
        The finite-element space in which the displacement is given.

    Yields
    ------
    Sampling
        First the electrodes that the mesh follows, then the others; a group without electrodes is
        left out.
    """
    has_patch = np.array([output.patch is not None for output in outputs], dtype=bool)
    followed = np.flatnonzero(has_patch)
    others = np.flatnonzero(~has_patch)
    if len(followed):
        patches = [outputs[i].find_elements(space.mesh) for i in followed.tolist()]
        elements = np.concatenate(patches)
        points = space.basis.quadrature[0][:, None]
        yield Sampling(
            outputs=np.repeat(followed, [len(patch) for patch in patches]),
            axes=(0, 1),
            elements=elements,
            gradients=space.gradients[elements],
            weights=space.weights[elements],
            local=np.broadcast_to(points, (2, len(elements), points.shape[-1])),
        )
    if len(others):
        outlines = [outputs[i].placed for i in others.tolist()]
        area = place_area_points(space.mesh, outlines, AREA_DEGREE)
        local = compute_local_coordinates(space.mesh, area.elements, area.points)
        yield Sampling(
            outputs=others[area.owners],
            axes=(0, 1),
            elements=area.elements,
            gradients=space.evaluate_gradients(area.elements, local),
            weights=area.weights,
            local=local,
        )


def sample_edges(outputs: Sequence[Output], space: Space) -> Iterator[Sampling]:
    """Yield points along the edges of rectangular electrodes.

    The left and right edges are for X, the lower and upper edges for Y, as seen in the electrode's
    own scene. Half of the points lie on either side of an edge, so that the stress is the mean of
    its traces from both sides. If the mesh ends at an edge on a mirror line, the points beyond the
    line are left out, and the reflection of the electrode adds the other half.

    Parameters
    ----------
    outputs : sequence of Output
        Rectangular electrodes, with sides along the axes of their scene.
    space : Space
        The finite-element space in which the displacement is given.

    Yields
    ------
    Sampling
        Points for X, then points for Y.
    """
    lines = []
    lengths = []
    for output in outputs:
        lines += [_find_edges(output, axis=0), _find_edges(output, axis=1)]
        width, height = np.ptp(output.corners, axis=0)
        lengths.append([2.0 * height, 2.0 * width])
    cut = make_line_quadrature(space.mesh, np.concatenate(lines))
    # each output has two lines for X and two for Y
    owners, axes = np.divmod(cut.owners // 2, 2)
    per_length = compute_output_areas(outputs)[owners] / np.array(lengths)[owners, axes]
    weights = per_length[:, None] * cut.weights
    gradients = space.evaluate_gradients(cut.elements, cut.points)
    for axis in (0, 1):
        rows = np.flatnonzero(axes == axis)
        yield Sampling(
            outputs=owners[rows],
            axes=(axis,),
            elements=cut.elements[rows],
            gradients=gradients[rows],
            weights=weights[rows],
            local=cut.points[:, rows],
        )


def _find_edges(output: Output, axis: int) -> Array:
    """Find the two edges of a rectangular electrode on which a coordinate is constant.

    Parameters
    ----------
    output : Output
        The electrode.
    axis : int
        0 for the left and right edges, 1 for the lower and upper edges.

    Returns
    -------
    ndarray, shape (2, 2, 2)
        Start and end of both edges in m, in the axes of the mesh.
    """
    edges = np.stack([output.corners, np.roll(output.corners, -1, axis=0)], axis=1)
    is_across = edges[:, 0, axis] == edges[:, 1, axis]
    return output.to_mesh_axes(edges[is_across])


def place_area_points(mesh: MeshTri2, outlines: Sequence[Outline], degree: int) -> AreaPoints:
    """Place quadrature points inside outlines that the mesh need not follow.

    Parameters
    ----------
    mesh : MeshTri2
        Mesh whose elements cut the outlines.
    outlines : sequence of Outline
        Outlines in m, in the axes of the mesh.
    degree : int
        Polynomial degree up to which the quadrature is exact in every element.

    Returns
    -------
    AreaPoints
    """
    pieces = _cut_by_elements(mesh, [outline.equal_area_polygon for outline in outlines])
    rings = shapely.get_exterior_ring(shapely.orient_polygons(pieces.shapes))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    first = corners[np.searchsorted(ring, ring[:-1])]  # first corner of the ring of each corner
    # a triangle joins the first corner of a ring to each of the ring's edges, from a to b
    a = corners[:-1] - first
    b = corners[1:] - first
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    areas *= ring[1:] == ring[:-1]  # no triangle joins the last corner of a ring to the next ring
    used = np.flatnonzero(areas)
    (s, t), weights = get_quadrature(mesh.elem.refdom, degree)
    points = first[used, None] + a[used, None] * s[:, None] + b[used, None] * t[:, None]
    piece = ring[used]
    return AreaPoints(
        owners=pieces.owners[piece],
        elements=pieces.elements[piece],
        points=points,
        weights=2.0 * np.outer(areas[used], weights),
    )


def make_line_quadrature(
    mesh: MeshTri2, lines: Array, *, gauss_points: int = 4, offset: float = 1e-7
) -> PlacedQuadrature:
    """Make a quadrature along straight lines, with half of the points on either side of them.

    The stress jumps at element edges, and a line may run along an edge. Parts of a line that lie
    outside of the mesh get no points.

    Parameters
    ----------
    mesh : MeshTri2
        Mesh whose elements cut the lines.
    lines : ndarray, shape (n, 2, 2)
        Start and end of each line in m.
    gauss_points : int, optional
        Number of Gauss points on each piece of a line in an element.
    offset : float, optional
        Distance of the points from the line, as a fraction of its length.

    Returns
    -------
    PlacedQuadrature
        The owner of a row is the index of its line.
    """
    along = lines[:, 1] - lines[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)[:, None]
    both_sides = np.concatenate([lines + offset * normal, lines - offset * normal])
    pieces = _cut_by_elements(mesh, shapely.linestrings(both_sides))
    ends = shapely.get_coordinates(pieces.shapes).reshape(-1, 2, 2)
    middle = ends.mean(axis=1)
    half = 0.5 * (ends[:, 1] - ends[:, 0])
    s, weights = np.polynomial.legendre.leggauss(gauss_points)
    points = middle[:, None] + half[:, None] * s[:, None]
    return PlacedQuadrature(
        pieces.owners % len(lines),
        pieces.elements,
        compute_local_coordinates(mesh, pieces.elements, points),
        0.5 * np.outer(np.linalg.norm(half, axis=1), weights),
    )


def _cut_by_elements(
    mesh: MeshTri2, shapes: Sequence[shapely.Geometry] | Geometries, negligible: float = 1e-12
) -> Pieces:
    """Cut polygons or lines into pieces by the elements of a mesh.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh. Its curved sides are replaced by chords.
    shapes : sequence or ndarray of shapely.Geometry, shape (n,)
        Either only polygons or only lines, in m.
    negligible : float
        Pieces below this fraction of their shape's area or length are left out: an element that
        only touches a shape has a piece without size, or with one due to round-off.

    Returns
    -------
    Pieces
    """
    polygons = _make_element_polygons(mesh)
    cut = np.asarray(shapes)
    owners, elements = shapely.STRtree(polygons).query(cut)
    intersections = shapely.intersection(polygons[elements], cut[owners])
    pieces, pair = shapely.get_parts(intersections, return_index=True)
    owners = owners[pair]
    elements = elements[pair]
    measure = shapely.area if shapely.get_dimensions(cut[0]) == 2 else shapely.length
    is_proper = measure(pieces) > negligible * measure(cut)[owners]
    return Pieces(owners[is_proper], elements[is_proper], shapes=pieces[is_proper])


def _make_element_polygons(mesh: MeshTri2) -> Geometries:
    """Make the elements' polygons, with `CHORDS` chords along each edge of curved elements."""
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs]  # shape (2, 6, elements)
    corners = nodes[:, :3].transpose(2, 1, 0)  # shape (elements, 3, 2)
    polygons = shapely.polygons(corners)
    curved = np.flatnonzero(find_curved_elements(nodes))
    t = np.arange(CHORDS) / CHORDS
    edges = []
    for start, middle, end in ((0, 3, 1), (1, 4, 2), (2, 5, 0)):
        # quadratic interpolation of the nodes a, m and b at the parameters 0, 1/2 and 1
        a = nodes[:, start, curved, None]
        m = nodes[:, middle, curved, None]
        b = nodes[:, end, curved, None]
        from_start = a * (1 - t) * (1 - 2 * t)
        from_middle = 4 * m * t * (1 - t)
        from_end = b * t * (2 * t - 1)
        edges.append(from_start + from_middle + from_end)
    rings = np.concatenate(edges, axis=-1).transpose(1, 2, 0)  # shape (curved elements, points, 2)
    polygons[curved] = shapely.polygons(rings)
    return polygons
