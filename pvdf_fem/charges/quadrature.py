"""Quadrature over outlines that a mesh does not follow.

The stress is smooth inside each element, so an integral over an outline is exact when it is taken
over the pieces into which the elements cut the outline. A piece is a polygon; with the triangles
that join its edges to its first corner, counted with their sign, it needs no triangulation. Curved
edges are replaced by chords, the same ones for both neighbours, so that nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.film.membrane import Array, Membrane
from pvdf_fem.scene.outline import Circle, Outline

# Exact for the stress of the richest space, in which it is a polynomial of this degree.
DEGREE = 6
LINE_POINTS = 4
# Chords of a curved edge.
CHORDS = 32
# A line that may run along edges of elements is taken on both sides, this part of its length off.
ASIDE = 1e-7
# Newton steps from global to local coordinates of a curved element.
STEPS = 6
# Pieces of less than this part of an outline's area are rounding.
NOTHING = 1e-12


@dataclass(frozen=True, eq=False)
class Cut:
    """Quadrature points in elements of a mesh.

    Attributes
    ----------
    owners : (n,) int
        Which of the outlines, or lines, a row of points belongs to.
    elements : (n,) int
    points : (2, n, points)
        Local coordinates in their elements.
    weights : (n, points)
        In m^2 over an area, in m along lines.
    """

    owners: NDArray[np.int64]
    elements: NDArray[np.int64]
    points: Array
    weights: Array

    def gradients(self, membrane: Membrane) -> Array:
        """Gradients of the shape functions in 1/m, (n, points, functions, 2)."""
        element, shape = membrane.basis.elem, self.points.shape[1:]
        flat = self.points.reshape(2, -1)
        local = np.stack([element.lbasis(flat, i)[1] for i in range(membrane.basis.Nbfun)])
        inverse = membrane.mesh.mapping().invDF(self.points, self.elements)
        local = local.reshape(-1, 2, *shape).transpose(2, 3, 0, 1)
        return np.matmul(local, inverse.transpose(2, 3, 0, 1))


def area_cut(mesh: MeshTri2, outlines: Sequence[Outline]) -> Cut:
    """Quadrature over what each of the outlines covers."""
    owners, elements, pieces = _pieces(mesh, [_as_polygon(outline) for outline in outlines])
    rings = shapely.get_exterior_ring(pieces)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    of, follows = ring[:-1], ring[1:] == ring[:-1]
    first = corners[np.searchsorted(ring, of)]
    a, b = corners[:-1] - first, corners[1:] - first
    signed = np.where(follows, 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), 0.0)
    signed *= np.sign(np.bincount(of, signed))[of]
    used = signed != 0.0
    (s, t), w = get_quadrature(mesh.elem.refdom, DEGREE)
    at = first[used, None] + a[used, None] * s[:, None] + b[used, None] * t[:, None]
    of, weights = of[used], 2.0 * np.outer(signed[used], w)
    return Cut(owners[of], elements[of], local_coordinates(mesh, elements[of], at), weights)


def line_cut(mesh: MeshTri2, lines: Array) -> Cut:
    """Quadrature along lines (n, 2, 2) from start to end, half of it on each of their sides."""
    along = lines[:, 1] - lines[:, 0]
    aside = ASIDE * np.stack([-along[:, 1], along[:, 0]], axis=-1)[:, None]
    both = np.concatenate([lines + aside, lines - aside])
    owners, elements, pieces = _pieces(mesh, shapely.linestrings(both))
    ends = shapely.get_coordinates(pieces).reshape(-1, 2, 2)
    middle, half = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
    s, w = np.polynomial.legendre.leggauss(LINE_POINTS)
    at = middle[:, None] + half[:, None] * s[:, None]
    weights = 0.5 * np.outer(np.linalg.norm(half, axis=1), w)
    return Cut(owners % len(lines), elements, local_coordinates(mesh, elements, at), weights)


def edge_cut(
    mesh: MeshTri2, facets: NDArray[np.int64], elements: NDArray[np.int64], count: int
) -> tuple[Cut, Array]:
    """Gauss points on edges, each in one of its two elements, and unit tangents there.

    Both elements of an edge see the same curve, so that its points need not be sought in them,
    which can fail in an element that is curved very much.

    Parameters
    ----------
    mesh : MeshTri2
    facets, elements : (n,) int
        Edges, and for each an element that has it.
    count : int
        Points of an edge.

    Returns
    -------
    cut : Cut
        Its owners are the positions in `facets`.
    tangents : (n, points, 2)
        From the edge's first vertex to its second.
    """
    s, w = np.polynomial.legendre.leggauss(count)
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    a, b = (
        corners[:, (mesh.t[:, elements] == end).argmax(axis=0)] for end in mesh.facets[:, facets]
    )
    points = a[..., None] + (b - a)[..., None] * (0.5 + 0.5 * s)
    along = np.einsum("ijfq,jf->fqi", mesh.mapping().DF(points, elements), b - a)
    length = np.linalg.norm(along, axis=-1)
    cut = Cut(np.arange(len(facets)), elements, points, 0.5 * w * length)
    return cut, along / length[..., None]


def _as_polygon(outline: Outline) -> shapely.Polygon:
    """The outline, or a polygon with the area of a disc."""
    if not isinstance(outline, Circle):
        return outline.shape
    grown = np.sqrt(outline.area / outline.shape.area)
    corners = shapely.get_coordinates(outline.shape)
    return shapely.Polygon(outline.centre + grown * (corners - outline.centre))


def _pieces(
    mesh: MeshTri2, shapes: Sequence[shapely.Geometry]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.object_]]:
    """Pieces of polygons or lines by elements: which shape, which element, and the piece."""
    polygons, given = _polygons(mesh), np.asarray(shapes)
    owners, elements = shapely.STRtree(polygons).query(given)
    common = shapely.intersection(polygons[elements], given[owners])
    parts, of = shapely.get_parts(common, return_index=True)
    owners, elements = owners[of], elements[of]
    if shapely.get_dimensions(given[0]) == 2:
        # what only touches is no polygon, or has rounding for an area
        kept = shapely.area(parts) > NOTHING * shapely.area(given)[owners]
    else:
        kept = shapely.length(parts) > NOTHING * shapely.length(given)[owners]
    return owners[kept], elements[kept], parts[kept]


def _polygons(mesh: MeshTri2) -> NDArray[np.object_]:
    """The elements as polygons, curved edges as chords."""
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
    t = np.arange(CHORDS) / CHORDS
    edges = []
    for start, middle, end in ((0, 3, 1), (1, 4, 2), (2, 5, 0)):
        a, m, b = (nodes[:, i, :, None] for i in (start, middle, end))
        edges.append(a * (1 - t) * (1 - 2 * t) + 4 * m * t * (1 - t) + b * t * (2 * t - 1))
    rings = np.concatenate(edges, axis=-1).transpose(1, 2, 0)
    polygons = shapely.polygons(rings[:, ::CHORDS])
    curved = _curved(nodes)
    polygons[curved] = shapely.polygons(rings[curved])
    return polygons


def _curved(nodes: Array) -> NDArray[np.bool_]:
    """Which of the elements with the nodes (2, 6, elements) have a curved edge."""
    corners = nodes[:, :3]
    off = np.abs(nodes[:, 3:] - 0.5 * (corners + np.roll(corners, -1, axis=1)))
    return off.max(axis=(0, 1)) > 1e-9 * np.ptp(corners, axis=1).max(axis=0)


def local_coordinates(mesh: MeshTri2, elements: NDArray[np.int64], at: Array) -> Array:
    """Local coordinates (2, n, points) of points (n, points, 2), each row in one element."""
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, elements]]
    J = np.stack([nodes[:, 1] - nodes[:, 0], nodes[:, 2] - nodes[:, 0]], axis=1)
    points = np.einsum(
        "nij,npj->inp", np.linalg.inv(J.transpose(2, 0, 1)), at - nodes[:, 0].T[:, None]
    )
    rows = np.flatnonzero(_curved(nodes))
    mapping, target = mesh.mapping(), at.transpose(2, 0, 1)[:, rows]
    for _ in range(STEPS if len(rows) else 0):
        here = points[:, rows]
        miss = target - mapping.F(here, elements[rows])
        points[:, rows] += np.einsum("ijnp,jnp->inp", mapping.invDF(here, elements[rows]), miss)
    return points
