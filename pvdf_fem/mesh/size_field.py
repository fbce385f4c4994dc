"""Element sizes: asked for along outlines, or at the vertices of an earlier mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.scene.outlines.outline import Outline

#: Factor by which gmsh's elements are smaller than the wanted sizes, approximately.
GMSH_SIZE_RATIO = 1.18


@dataclass(frozen=True)
class GradedSizes:
    """Element sizes in metres along outlines, growing linearly with the distance from them."""

    #: Element size along every patch's outline, by patch name; `gmsh_mesh.FILM` is the rim's.
    patches: dict[str, float]
    growth: float  #: Increase of the element size per unit of distance from an outline.
    film: float  #: Largest element size.

    def elements(
        self, area: float, outlines: Mapping[str, Outline], arcs: int, at_corner: float = 4.0
    ) -> float:
        """Estimated number of elements on a film with an area in m², within a factor near 2. A
        smooth outline has at least `arcs` sides. `at_corner` are elements at every corner, for
        outlines with many corners and sides shorter than the sizes."""
        total, corners = area / self.film**2, 0
        for name, outline in outlines.items():
            least = self.film if len(outline.corners) else outline.perimeter / arcs
            size = min(self.patches.get(name, self.film), least)
            # both sides of the outline, to where the size is the largest
            total += 2.0 * outline.perimeter / self.growth * max(1.0 / size - 1.0 / self.film, 0.0)
            corners += len(outline.corners)
        return float(4.0 / np.sqrt(3.0) * GMSH_SIZE_RATIO**2 * total + at_corner * corners)

    def scaled(self, factor: float) -> GradedSizes:
        """Element sizes, and therefore the gradient, times `factor`."""
        patches = {name: size * factor for name, size in self.patches.items()}
        return GradedSizes(patches, self.growth * factor, self.film * factor)


@dataclass(frozen=True, eq=False)
class SizeField:
    """Element sizes in metres at the vertices of a mesh, linear in its triangles."""

    mesh: MeshTri2
    sizes: Array  #: (vertices,)

    @classmethod
    def from_element_sizes(cls, mesh: MeshTri2, sizes: Array, growth: float = 0.5) -> SizeField:
        """From a size in m per element: geometric means at the vertices, lowered where the size
        grows by more than `growth` per length."""
        vertices, count = mesh.t.ravel(), np.bincount(mesh.t.ravel(), minlength=mesh.nvertices)
        total = np.bincount(vertices, np.tile(np.log(sizes), 3), mesh.nvertices)
        at_vertices = np.exp(total / np.maximum(count, 1))
        a, b = mesh.facets
        rise = growth * np.linalg.norm(mesh.p[:, a] - mesh.p[:, b], axis=0)
        while True:
            lowered = at_vertices.copy()
            np.minimum.at(lowered, a, at_vertices[b] + rise)
            np.minimum.at(lowered, b, at_vertices[a] + rise)
            if not (lowered < at_vertices).any():
                return cls(mesh, at_vertices)
            at_vertices = lowered

    @property
    def elements(self) -> float:
        """Estimated number of elements in a mesh with the field's sizes."""
        mean = self.sizes[self.mesh.t].mean(axis=0)
        return float(((GMSH_SIZE_RATIO * compute_element_sizes(self.mesh) / mean) ** 2).sum())

    def coarsened(self, most: float) -> SizeField:
        """The same field, or a coarser field with about `most` elements."""
        return SizeField(self.mesh, self.sizes * np.sqrt(max(self.elements / most, 1.0)))


def compute_element_sizes(mesh: MeshTri2, sliver: float = 0.5) -> Array:
    """Edge of an equilateral triangle with the element's area, or `sliver` times the longest edge,
    m. The larger value counts: a sliver's area says nothing about its neighbours, and gmsh would
    take minutes for equally fine meshes in the cusp between touching arcs."""
    corners = mesh.p[:, mesh.t]
    (x0, x1, x2), (y0, y1, y2) = corners
    area = 0.5 * np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0).max(axis=0)
    return np.maximum(np.sqrt(4.0 / np.sqrt(3.0) * area), sliver * longest)


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
    """Sizes that multiply the error by `reduction`, with fewest elements.

    An element's share in the error is proportional to size^(order + 2): the number of elements is
    least with equal `shares` (elements,) (equidistribution). Zero shares everywhere, on a slack
    film, count as equal. `most` bounds the sizes in m from above; `smallest` and `largest` bound
    the factor by which a size changes. Elements in `stiff` do not deform: they have no share, and
    their neighbours decide their sizes. Errors in charges fall with the power `order` of the size:
    less than 4 for smooth solutions, because corners of patches make solutions less smooth (see the
    convergence tests).
    """
    total = shares.sum()
    share = shares / total if total > 0.0 else np.full(len(shares), 1.0 / len(shares))
    share = np.maximum(share, 1e-12)
    factor = share ** (-1.0 / (order + 2.0))
    factor *= (reduction / (share ** (2.0 / (order + 2.0))).sum()) ** (1.0 / order)
    sizes = np.minimum(compute_element_sizes(mesh) * np.clip(factor, smallest, largest), most)
    if stiff is not None:
        around = np.full(mesh.nvertices, np.inf)
        soft = np.setdiff1d(np.arange(mesh.nelements), stiff)
        np.minimum.at(around, mesh.t[:, soft].ravel(), np.tile(sizes[soft], 3))
        sizes[stiff] = np.minimum(sizes[stiff], around[mesh.t[:, stiff]].min(axis=0))
    return SizeField.from_element_sizes(mesh, sizes)
