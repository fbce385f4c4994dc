"""Element sizes: prescribed along outlines, or at the vertices of an earlier mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.scene.outlines.outline import Outline

#: Approximate ratio of the requested element size to the size of the elements that gmsh makes.
GMSH_SIZE_RATIO = 1.18


class PointSize(NamedTuple):
    """Element size at a point, such as a re-entrant corner of the film."""

    point: tuple[float, float]  #: In m, in the axes of the scene.
    size: float  #: In m.


@dataclass(frozen=True)
class GradedSizes:
    """Element sizes that are given along outlines and grow linearly with the distance from them.

    Parameters
    ----------
    patches : dict of str to float
        Element size in m along the outline of each subdomain; that of `subdomains.FILM` is for the
        rim.
    growth : float
        Increase of the element size per unit of distance from an outline.
    film : float
        Maximum element size in m.
    points : tuple of PointSize, optional
        Sizes at points, from which they grow in the same way.
    """

    patches: dict[str, float]
    growth: float
    film: float
    points: tuple[PointSize, ...] = ()

    def estimate_element_count(
        self, area: float, outlines: Mapping[str, Outline], arcs: int, per_corner: float = 4.0
    ) -> float:
        """Estimate the number of elements of a mesh with these sizes, to a factor of about 2.

        Parameters
        ----------
        area : float
            Area of the film in m².
        outlines : mapping of str to Outline
            Outlines of the film and all subdomains, by the keys of `patches`. The size along an
            outline that `patches` does not contain is `film`.
        arcs : int
            Minimum number of element sides along an outline without corners.
        per_corner : float
            Number of elements to add for each side of an outline. It matters for outlines with
            many sides, which are shorter than the element sizes.

        Returns
        -------
        float
        """
        count = area / self.film**2
        corners = 0
        for name, outline in outlines.items():
            is_smooth = not len(outline.corners)
            largest = outline.perimeter / arcs if is_smooth else self.film
            size = min(self.patches.get(name, self.film), largest)
            # integral of 1 / size² on both sides of the outline, up to the maximum size
            excess = max(1.0 / size - 1.0 / self.film, 0.0)
            count += 2.0 * outline.perimeter / self.growth * excess
            corners += max(len(outline.corners), len(outline.boundary) - 1)
        for _, size in self.points:
            # integral of 1 / size² around a point, where the size is proportional to the distance
            count += 2.0 * np.pi / self.growth**2 * np.log(max(self.film / size, 1.0))
        return float(4.0 / np.sqrt(3.0) * GMSH_SIZE_RATIO**2 * count + per_corner * corners)

    def scale(self, factor: float) -> GradedSizes:
        """Return a copy in which all sizes and `growth` are multiplied by a factor."""
        patches = {name: size * factor for name, size in self.patches.items()}
        points = tuple(PointSize(point, size * factor) for point, size in self.points)
        return GradedSizes(patches, self.growth * factor, film=self.film * factor, points=points)


@dataclass(frozen=True, eq=False)
class SizeField:
    """Element sizes at the vertices of a mesh, linear in its triangles.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    sizes : ndarray, shape (vertices,)
        Element sizes in m.
    """

    mesh: MeshTri2
    sizes: Array

    @classmethod
    def from_element_sizes(cls, mesh: MeshTri2, sizes: Array, growth: float = 0.5) -> SizeField:
        """Make a field from the desired size in the region of each element of a mesh.

        Parameters
        ----------
        mesh : MeshTri2
            With coordinates in m.
        sizes : ndarray, shape (elements,)
            Desired sizes in m, as opposed to the present sizes of the elements.
        growth : float
            Maximum increase of the size per unit of length along the sides of the mesh; sizes that
            exceed it are reduced.

        Returns
        -------
        SizeField
            At each vertex, the geometric mean over the adjacent elements, reduced if it exceeds the
            size at a neighbouring vertex by more than `growth` allows.
        """
        vertices = mesh.t.ravel()
        count = np.bincount(vertices, minlength=mesh.nvertices)
        logarithms = np.bincount(vertices, np.tile(np.log(sizes), 3), mesh.nvertices)
        vertex_sizes = np.exp(logarithms / np.maximum(count, 1))
        a, b = mesh.facets
        max_increase = growth * np.linalg.norm(mesh.p[:, a] - mesh.p[:, b], axis=0)
        while True:
            reduced = vertex_sizes.copy()
            np.minimum.at(reduced, a, vertex_sizes[b] + max_increase)
            np.minimum.at(reduced, b, vertex_sizes[a] + max_increase)
            if not (reduced < vertex_sizes).any():
                return cls(mesh, vertex_sizes)
            vertex_sizes = reduced

    @property
    def element_count(self) -> float:
        """Estimated number of elements of a mesh with the field's sizes."""
        wanted_sizes = self.sizes[self.mesh.t].mean(axis=0)
        ratios = GMSH_SIZE_RATIO * compute_element_sizes(self.mesh) / wanted_sizes
        return float((ratios**2).sum())

    def coarsen(self, max_elements: float) -> SizeField:
        """Return a copy whose sizes are increased if they need more than `max_elements` elements.

        All sizes are multiplied by one factor, after which the estimated number is `max_elements`.
        """
        factor = np.sqrt(max(self.element_count / max_elements, 1.0))
        return SizeField(self.mesh, self.sizes * factor)


def count_arcs(tolerance: float) -> int:
    """Choose the minimum number of element sides around a circle for a tolerance of charges.

    The rule is empirical: 16 quadratic arcs with the area of the circle change the charges under a
    disc by less than 2e-7.
    """
    return int(np.ceil(max(12.0, 16.0 * (1e-5 / tolerance) ** 0.25)))


def compute_element_sizes(mesh: MeshTri2, sliver: float = 0.5) -> Array:
    """Compute the size of every element from its area, with a correction for slivers.

    Curved sides are replaced by straight ones.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    sliver : float
        Minimum size of an element as a fraction of its longest edge.

    Returns
    -------
    ndarray, shape (elements,)
        Edge in m of the equilateral triangle with the element's area, but at least `sliver` times
        the element's longest edge.

    Notes
    -----
    The area of a sliver is not representative of its neighbours: in the cusp between touching arcs,
    gmsh would take minutes for a mesh of sizes derived from the areas alone.
    """
    corners = mesh.p[:, mesh.t]
    (x0, x1, x2), (y0, y1, y2) = corners
    area = 0.5 * np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0)
    return np.maximum(np.sqrt(4.0 / np.sqrt(3.0) * area), sliver * edges.max(axis=0))


def compute_refined_sizes(
    mesh: MeshTri2,
    contributions: Array,
    reduction: float,
    max_sizes: Array | float = np.inf,
    stiff: Indices | None = None,
    order: float = 3.0,
    min_factor: float = 0.05,
    max_factor: float = 2.0,
) -> SizeField:
    """Compute the element sizes that reduce an error as requested with the fewest elements.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    contributions : ndarray, shape (elements,)
        Contributions of the elements to the error, in any unit. If all are zero, as on a slack
        film, they count as equal.
    reduction : float
        Requested error divided by the present error.
    max_sizes : ndarray, shape (elements,), or float
        Maximum element sizes in m.
    stiff : ndarray of int, optional
        Elements that do not deform and thus do not contribute to the error. Their sizes are reduced
        to the smallest size of the other elements at their vertices.
    order : float
        Order of convergence p of the charges. It is below 4, the order for smooth solutions,
        because solutions are less smooth at the corners of outlines (see the convergence tests).
    min_factor, max_factor : float
        Limits of the factors by which sizes change; `max_sizes` and the growth of the field may
        reduce sizes further.

    Returns
    -------
    SizeField
        Sizes at the vertices of `mesh`.

    Notes
    -----
    The contribution e of an element is proportional to size^(p + 2), and the number of elements is
    smallest if all contributions are equal (equidistribution). With contributions that add up to 1,
    the factors are e^(-1/(p + 2)) (reduction / Σ e^(2/(p + 2)))^(1/p).
    """
    total = contributions.sum()
    if total > 0.0:
        relative = np.maximum(contributions / total, 1e-12)
    else:
        relative = np.full(len(contributions), 1.0 / len(contributions))
    factors = relative ** (-1.0 / (order + 2.0))
    factors *= (reduction / (relative ** (2.0 / (order + 2.0))).sum()) ** (1.0 / order)
    sizes = compute_element_sizes(mesh) * np.clip(factors, min_factor, max_factor)
    sizes = np.minimum(sizes, max_sizes)
    if stiff is not None:
        neighbour_sizes = np.full(mesh.nvertices, np.inf)
        soft = np.setdiff1d(np.arange(mesh.nelements), stiff)
        np.minimum.at(neighbour_sizes, mesh.t[:, soft].ravel(), np.tile(sizes[soft], 3))
        sizes[stiff] = np.minimum(sizes[stiff], neighbour_sizes[mesh.t[:, stiff]].min(axis=0))
    return SizeField.from_element_sizes(mesh, sizes)
