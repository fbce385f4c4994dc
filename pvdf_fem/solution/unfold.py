"""From a part of the film to the whole of it: mesh and displacement, by mirror images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skfem import MeshTri2

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Array
from pvdf_fem.mesh.gmsh_mesh import electrode_patch, named
from pvdf_fem.mesh.six_node import with_sorted_vertices
from pvdf_fem.mesh.symmetry import WHOLE, Part


def unfolded(equilibrium: Equilibrium) -> Equilibrium:
    """The equations of the whole film, in the axes of the scene."""
    part, membrane = equilibrium.part, equilibrium.membrane
    if not part.mirrored:
        return equilibrium
    return Equilibrium(equilibrium.scene, unfolded_mesh(membrane.mesh, part), membrane.order)


def unfolded_mesh(mesh: MeshTri2, part: Part) -> MeshTri2:
    """The mesh of a part with its mirror images, in the axes of the scene."""
    nodes, triangles = mesh.doflocs, mesh.dofs.element_dofs.T
    # an image shares the nodes for which its change of signs makes no difference
    flips = np.array([np.where(nodes == 0.0, 1.0, signs[:, None]) for signs in part.signs])
    keys = 2 * (flips[:, 0] < 0.0) + (flips[:, 1] < 0.0) + 4 * np.arange(nodes.shape[1])
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    points = part.frame.T @ (flips * nodes).transpose(1, 0, 2).reshape(2, -1)[:, first]
    numbers = number.reshape(keys.shape)
    elements = np.concatenate([each[triangles] for each in numbers])
    whole = MeshTri2(points, with_sorted_vertices(elements).T)
    return named(whole, _subdomains(mesh, part), WHOLE)


def _subdomains(mesh: MeshTri2, part: Part) -> dict[str, NDArray[np.int64]]:
    """The patches of the whole film: an image of an electrode is where that of the part is."""
    found, added = {}, {electrode_patch(image) for image in part.images}
    for name in (name for name in mesh.subdomains if name not in added):
        places = []
        for image, swap in enumerate(part.swaps):
            patches = {electrode_patch(a): electrode_patch(b) for a, b in swap.items()}
            places.append(mesh.subdomains[patches.get(name, name)] + image * mesh.nelements)
        found[name] = np.concatenate(places)
    return found


def unfolded_dofs(solved: Equilibrium, x: Array, whole: Equilibrium) -> Array:
    """The displacement `x` of a part at the dofs of the whole film."""
    part = solved.part
    places = part.frame @ whole.membrane.basis.doflocs
    _, source = cKDTree(solved.membrane.basis.doflocs.T).query(_folded(places, part).T)
    displacement = x.reshape(-1, 3)[source]
    signs = np.where((places < 0.0) & _mirrored(part), -1.0, 1.0).T
    displacement[:, :2] = (signs * displacement[:, :2]) @ part.frame
    return displacement.ravel()


def _mirrored(part: Part) -> NDArray[np.bool_]:
    return np.array([[axis in part.mirrored] for axis in (0, 1)])


def _folded(places: Array, part: Part) -> Array:
    """The places (2, n) in the part whose images lie at `places`."""
    return np.where(_mirrored(part), np.abs(places), places)
