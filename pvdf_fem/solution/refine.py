"""From one mesh to the next: element sizes from error indicators, and the solution carried over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skfem import Basis, MeshTri2

from pvdf_fem.film.membrane import Array
from pvdf_fem.mesh.gmsh_mesh import SizeField, element_sizes

# Errors of charges fall with this power of the element size (see `tests/test_convergence.py`);
# lower than the 4 of smooth solutions, since corners of the patches make them less smooth.
ORDER = 3.0
# A size changes by no more than this in one go.
CHANGE = (0.05, 2.0)
# Triangles in which a point is sought.
CANDIDATES = 8


def refined_sizes(
    mesh: MeshTri2,
    shares: Array,
    reduction: float,
    most: Array | float = np.inf,
    stiff: NDArray[np.int64] | None = None,
) -> SizeField:
    """Sizes for which each goal's error is `reduction` times what it was, with fewest elements.

    With an element's share proportional to size^(ORDER + 2), the number of elements is least for
    equal shares (Brown and others: equidistribution).

    Parameters
    ----------
    mesh : MeshTri2
    shares : (elements,)
        Share of each element in the error. Where all are zero, as on a slack film, they count as
        equal.
    reduction : float
        Wanted sum of shares over the present one.
    most : (elements,) or float
        Sizes that are wanted to be no larger, m.
    stiff : (n,) int, optional
        Elements that do not deform. They have no share, and are as small as their neighbours want.
    """
    total = shares.sum()
    share = shares / total if total > 0.0 else np.full(len(shares), 1.0 / len(shares))
    share = np.maximum(share, 1e-12)
    factor = share ** (-1.0 / (ORDER + 2.0))
    factor *= (reduction / (share ** (2.0 / (ORDER + 2.0))).sum()) ** (1.0 / ORDER)
    sizes = element_sizes(mesh)
    wanted = np.minimum(sizes * np.clip(factor, *CHANGE), most)
    if stiff is not None:
        around = np.full(mesh.nvertices, np.inf)
        soft = np.setdiff1d(np.arange(mesh.nelements), stiff)
        np.minimum.at(around, mesh.t[:, soft].ravel(), np.tile(wanted[soft], 3))
        wanted[stiff] = np.minimum(wanted[stiff], around[mesh.t[:, stiff]].min(axis=0))
    return SizeField.of_elements(mesh, wanted)


def transferred(basis: Basis, x: Array, target: Basis) -> Array:
    """Dofs on the basis `target` of the displacement that has the dofs `x` on `basis`.

    A starting guess: see `located` for points that are in none of the triangles tried.
    """
    elements, values = located(basis, target.doflocs)
    nodal = x.reshape(-1, 3)[basis.element_dofs[:, elements]]
    return np.einsum("pi,ipc->pc", values, nodal).ravel()


def located(
    basis: Basis, points: Array, candidates: int = CANDIDATES
) -> tuple[NDArray[np.int64], Array]:
    """Triangles (n,) of points (2, n), and the values (n, functions) of their shape functions.

    Points are sought in the straight-sided triangles with the nearest centroids, and those in none
    of them are extrapolated from the closest.
    """
    mesh = basis.mesh
    corners = mesh.p[:, mesh.t]
    _, near = cKDTree(corners.mean(axis=1).T).query(points.T, k=min(candidates, mesh.nelements))
    near = near.reshape(points.shape[1], -1)
    origin = corners[:, 0][:, near]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    inverse = np.linalg.inv(edges.transpose(1, 0, 2))[near]
    local = np.einsum("pcij,jpc->ipc", inverse, points[:, :, None] - origin)
    inside = np.minimum(local.min(axis=0), 1.0 - local.sum(axis=0))
    best = inside.argmax(axis=1)[:, None]
    element = np.take_along_axis(near, best, axis=1)[:, 0]
    place = np.take_along_axis(local, best[None], axis=2)[..., 0]
    functions = range(basis.Nbfun)
    return element, np.stack([basis.elem.lbasis(place, i)[0] for i in functions], axis=-1)
