"""The nodes, triangles and named parts of a mesh, as mesh files store them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.subdomains import FILM, RIM

#: Numbers of nodes of a triangle and of a line, by the order of the elements.
TRIANGLE_NODES = {1: 3, 2: 6}
LINE_NODES = {1: 2, 2: 3}


class PatchCombination(NamedTuple):
    """The elements that lie in the same patches."""

    patches: tuple[str, ...]  #: Names of these patches; empty for the film outside of patches.
    elements: Indices  #: Indices of the elements, shape (n,).

    @property
    def name(self) -> str:
        """Name of the combination, as ``electrode A + probe``; ``film`` outside of patches."""
        return " + ".join(self.patches) or FILM


@dataclass(frozen=True, eq=False)
class MeshGrid:
    """A mesh of the whole film for a file: counter-clockwise triangles with their patches.

    Parameters
    ----------
    order : int
        1 for straight triangles of three nodes, 2 for curved triangles of six nodes.
    points : ndarray, shape (nodes, 2)
        Nodes in m.
    triangles : ndarray of int, shape (elements, 3 or 6)
        The vertices counter-clockwise, then the mid-side nodes in the same order.
    rim_lines : ndarray of int, shape (lines, 2 or 3)
        Lines along the rim: both ends, then the node in the middle.
    patches : dict of str to ndarray of int
        Indices of the elements of each patch by name; patches may overlap.
    """

    order: int
    points: Array
    triangles: Indices
    rim_lines: Indices
    patches: dict[str, Indices]

    @classmethod
    def from_mesh(cls, mesh: MeshTri2, order: int = 2) -> MeshGrid:
        """Make the grid of a mesh.

        Parameters
        ----------
        mesh : MeshTri2
            A mesh of the film with its patches, in m.
        order : int
            Order of the elements. Order 1 leaves out the nodes in the middle of sides.

        Returns
        -------
        MeshGrid
        """
        facets = mesh.boundaries[RIM]
        lines = np.vstack([mesh.facets[:, facets], mesh.dofs.facet_dofs[0, facets]]).T
        points = mesh.doflocs.T
        if order == 1:
            points = points[: mesh.t.max() + 1]  # vertices come before the other nodes
        patches = {name: part for name, part in mesh.subdomains.items() if name != FILM}
        return cls(
            order=order,
            points=points,
            triangles=orient_elements(mesh)[:, : TRIANGLE_NODES[order]],
            rim_lines=lines[:, : LINE_NODES[order]],
            patches=patches,
        )

    @property
    def rim_nodes(self) -> Indices:
        """Indices of the nodes on the rim in increasing order."""
        return np.unique(self.rim_lines)

    def with_patches(self, patches: dict[str, Indices]) -> MeshGrid:
        """Return a copy with other patches.

        Parameters
        ----------
        patches : dict of str to ndarray of int
            Indices of the elements of each patch by name.

        Returns
        -------
        MeshGrid
        """
        return replace(self, patches=patches)

    def make_masks(self) -> dict[str, NDArray[np.int32]]:
        """Return an array of shape (elements,) for each patch, 1 inside and 0 outside."""
        masks = {}
        for name, elements in self.patches.items():
            mask = np.zeros(len(self.triangles), dtype=np.int32)
            mask[elements] = 1
            masks[name] = mask
        return masks

    def find_combinations(self) -> list[PatchCombination]:
        """Divide the elements by the patches in which they lie.

        Returns
        -------
        list of PatchCombination
            Every element is in one of them.
        """
        masks = self.make_masks()
        stacked = np.array(list(masks.values())).reshape(len(masks), len(self.triangles))
        combinations, numbers = np.unique(stacked, axis=1, return_inverse=True)
        numbers = numbers.ravel()
        found = []
        for number, inside in enumerate(combinations.T):
            names = tuple(name for name, is_in in zip(masks, inside, strict=True) if is_in)
            found.append(PatchCombination(names, np.flatnonzero(numbers == number)))
        return found


def orient_elements(mesh: MeshTri2) -> Indices:
    """Return the nodes of the elements, with those of clockwise elements in reverse order.

    Parameters
    ----------
    mesh : MeshTri2
        Six-node triangles in any orientation.

    Returns
    -------
    ndarray of int, shape (elements, 6)
        The vertices counter-clockwise, then the mid-side nodes in the same order.
    """
    nodes = np.asarray(mesh.dofs.element_dofs.T)
    a, b, c = mesh.doflocs.T[nodes[:, :3]].swapaxes(0, 1)
    x1, y1 = (b - a).T
    x2, y2 = (c - a).T
    is_clockwise = x1 * y2 < x2 * y1  # the signed area is negative
    return np.where(is_clockwise[:, None], nodes[:, [0, 2, 1, 5, 4, 3]], nodes)
