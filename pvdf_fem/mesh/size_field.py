"""Element sizes: prescribed along outlines, or at the vertices of an earlier mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.scene.outlines.outline import Outline

#: Wanted element size over the size of gmsh's elements, approximately.
GMSH_SIZE_RATIO = 1.18


@dataclass(frozen=True)
class GradedSizes:
    """Element sizes along outlines that grow linearly with the distance from them.

    Parameters
    ----------
    patches : dict of str to float
        Element size in m along the outline of each patch; `subdomains.FILM` is the rim's.
    growth : float
        Increase of the element size per unit of distance from an outline.
    film : float
        Largest element size in m.
    """

    patches: dict[str, float]
    growth: float
    film: float

    def estimate_element_count(
        self, area: float, outlines: Mapping[str, Outline], arcs: int, per_corner: float = 4.0
    ) -> float:
        """Estimate the number of elements of a film, within a factor near 2.

        Parameters
        ----------
        area : float
            Area of the film in m².
        outlines : mapping of str to Outline
            Outlines by the names of their patches.
        arcs : int
            Least number of sides of a smooth outline.
        per_corner : float
            Number of elements at every corner, for outlines with many corners and with sides
            shorter than the sizes.

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
            # both sides of the outline, up to where the size is the largest
            excess = max(1.0 / size - 1.0 / self.film, 0.0)
            count += 2.0 * outline.perimeter / self.growth * excess
            corners += len(outline.corners)
        return float(4.0 / np.sqrt(3.0) * GMSH_SIZE_RATIO**2 * count + per_corner * corners)

    def scale(self, factor: float) -> GradedSizes:
        """Return the element sizes, and with them their growth, times a factor."""
        patches = {name: size * factor for name, size in self.patches.items()}
        return GradedSizes(patches, self.growth * factor, film=self.film * factor)


@dataclass(frozen=True, eq=False)
class SizeField:
    """Element sizes at the vertices of a mesh, linear in its triangles.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    sizes : ndarray, shape (vertices,)
        In m.
    """

    mesh: MeshTri2
    sizes: Array

    @classmethod
    def from_element_sizes(cls, mesh: MeshTri2, sizes: Array, growth: float = 0.5) -> SizeField:
        """Make a field from a size for every element of a mesh.

        Parameters
        ----------
        mesh : MeshTri2
            With coordinates in m.
        sizes : ndarray, shape (elements,)
            In m.
        growth : float
            Largest growth of the size per length; larger sizes are reduced.

        Returns
        -------
        SizeField
            With geometric means of the sizes at the vertices.
        """
        vertices = mesh.t.ravel()
        count = np.bincount(vertices, minlength=mesh.nvertices)
        logarithms = np.bincount(vertices, np.tile(np.log(sizes), 3), mesh.nvertices)
        vertex_sizes = np.exp(logarithms / np.maximum(count, 1))
        a, b = mesh.facets
        largest_rise = growth * np.linalg.norm(mesh.p[:, a] - mesh.p[:, b], axis=0)
        while True:
            reduced = vertex_sizes.copy()
            np.minimum.at(reduced, a, vertex_sizes[b] + largest_rise)
            np.minimum.at(reduced, b, vertex_sizes[a] + largest_rise)
            if not (reduced < vertex_sizes).any():
                return cls(mesh, vertex_sizes)
            vertex_sizes = reduced

    @property
    def element_count(self) -> float:
        """Estimated number of elements of a mesh with the field's sizes."""
        wanted_sizes = self.sizes[self.mesh.t].mean(axis=0)
        ratios = GMSH_SIZE_RATIO * compute_element_sizes(self.mesh) / wanted_sizes
        return float((ratios**2).sum())

    def coarsen(self, most_elements: float) -> SizeField:
        """Return the field, or a coarser one with about `most_elements` elements."""
        factor = np.sqrt(max(self.element_count / most_elements, 1.0))
        return SizeField(self.mesh, self.sizes * factor)


def compute_element_sizes(mesh: MeshTri2, sliver: float = 0.5) -> Array:
    """Compute the size of every element.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    sliver : float
        Least size over the longest edge.

    Returns
    -------
    ndarray, shape (elements,)
        Edge in m of an equilateral triangle with the element's area, or `sliver` times the longest
        edge where that is larger.

    Notes
    -----
    The area of a sliver says nothing about its neighbours, and gmsh would take minutes for equally
    fine meshes in the cusp between touching arcs.
    """
    corners = mesh.p[:, mesh.t]
    (x0, x1, x2), (y0, y1, y2) = corners
    area = 0.5 * np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0)
    return np.maximum(np.sqrt(4.0 / np.sqrt(3.0) * area), sliver * edges.max(axis=0))


def compute_refined_sizes(
    mesh: MeshTri2,
    shares: Array,
    reduction: float,
    most: Array | float = np.inf,
    stiff: Indices | None = None,
    order: float = 3.0,
    smallest: float = 0.05,
    largest: float = 2.0,
) -> SizeField:
    """Compute the sizes that reduce an error to a share of it with fewest elements.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    shares : ndarray, shape (elements,)
        Contributions of the elements to the error, in any unit. Where all are zero, on a slack
        film, they count as equal.
    reduction : float
        Wanted error over the error.
    most : ndarray, shape (elements,) or float
        Largest sizes in m.
    stiff : ndarray of int, optional
        Elements that do not deform. They contribute nothing, and their neighbours decide their
        sizes.
    order : float
        Power of the size with which errors in charges fall: less than 4, the power for smooth
        solutions, because solutions are less smooth at the corners of patches (see the convergence
        tests).
    smallest, largest : float
        Limits of the factor by which a size changes.

    Returns
    -------
    SizeField

    Notes
    -----
    The contribution of an element is proportional to size^(order + 2), so that the number of
    elements is least where all contributions are equal (equidistribution).
    """
    total = shares.sum()
    equal = np.full(len(shares), 1.0 / len(shares))
    relative = np.maximum(shares / total if total > 0.0 else equal, 1e-12)
    factors = relative ** (-1.0 / (order + 2.0))
    factors *= (reduction / (relative ** (2.0 / (order + 2.0))).sum()) ** (1.0 / order)
    sizes = compute_element_sizes(mesh) * np.clip(factors, smallest, largest)
    sizes = np.minimum(sizes, most)
    if stiff is not None:
        neighbour_sizes = np.full(mesh.nvertices, np.inf)
        soft = np.setdiff1d(np.arange(mesh.nelements), stiff)
        np.minimum.at(neighbour_sizes, mesh.t[:, soft].ravel(), np.tile(sizes[soft], 3))
        sizes[stiff] = np.minimum(sizes[stiff], neighbour_sizes[mesh.t[:, stiff]].min(axis=0))
    return SizeField.from_element_sizes(mesh, sizes)
