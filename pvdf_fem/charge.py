"""Charges of the electrodes: two observables of one mechanical solution.

A charge is d31 X + d32 Y with two forces X, Y of each electrode, so that one solution serves
every pair of piezoelectric coefficients.

- ``material``: X, Y = integrals of S11, S22 over the electrode's reference area.
- ``thesis-edge``: X = A mean of sigma_xx over the left and the right edge, Y = A mean of sigma_yy
  over the upper and the lower edge, with the Cauchy stress sigma = F S F^T / J in global axes and
  A the electrode's area: what the post-processor of Mirbagheri's thesis (sections 2.1.6, App. 3)
  computes. The stress on an edge is the mean of its traces from both sides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import InteriorFacetBasis, MeshTri2

from pvdf_fem.membrane import IDENTITY, Array, Membrane, shape_gradients, strain_of
from pvdf_fem.mesh import electrode_patch
from pvdf_fem.scene import Scene

# Squire and Trapp, SIAM Rev. 40 (1998) 110-112: the derivative is exact to rounding.
COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class Sampling:
    """Points at which an electrode samples one stress component.

    Attributes
    ----------
    electrode, axis : int
        Which force it adds to; axis 0 is X (component 11 or xx), axis 1 is Y.
    elements : (n,) int
    gradients : (n, points, functions, 2)
        Gradients of the shape functions, 1/m.
    weights : (n, points)
        What a point's stress is multiplied by, m^2.
    """

    electrode: int
    axis: int
    elements: NDArray[np.int64]
    gradients: Array
    weights: Array


def electrode_forces(scene: Scene, membrane: Membrane, x: Array) -> Array:
    """The forces X, Y in N of each electrode, (electrodes, 2), at the dofs `x`.

    The observable is that of ``scene.numerics``.
    """
    stress = OBSERVABLES[scene.numerics.observable]
    forces = np.zeros((len(scene.electrode_list), 2))
    for part in _samplings(scene, membrane):
        values = stress(membrane, _gradient(membrane, x, part))[..., part.axis]
        forces[part.electrode, part.axis] += (part.weights * values).sum()
    return forces


def charge_gradients(scene: Scene, membrane: Membrane, x: Array) -> Array:
    """Derivative of each electrode's charge with respect to the dofs, C/m, (dofs, electrodes)."""
    stress = OBSERVABLES[scene.numerics.observable]
    d = (scene.film.d31, scene.film.d32)
    result = np.zeros((membrane.dof_count, len(scene.electrode_list)))
    for part in _samplings(scene, membrane):
        gradient = _gradient(membrane, x, part)
        slopes = np.empty_like(gradient)
        for entry in np.ndindex(3, 2):
            moved = gradient.astype(complex)
            moved[..., *entry] += 1j * COMPLEX_STEP
            slopes[..., *entry] = stress(membrane, moved)[..., part.axis].imag / COMPLEX_STEP
        weighted = d[part.axis] * part.weights[..., None, None] * slopes
        local = np.matmul(part.gradients, weighted.swapaxes(2, 3)).sum(axis=1)
        dofs = membrane.element_dofs[part.elements]
        np.add.at(result[:, part.electrode], dofs.ravel(), local.ravel())
    return result


def cauchy_stress(membrane: Membrane, gradient: Array) -> Array:
    """Cauchy stress F S F^T / J in Pa, global axes, (..., 2): xx, yy.

    `gradient` (..., 3, 2) is the displacement gradient; J the ratio of deformed to reference area.
    """
    F = gradient + IDENTITY
    S = membrane.stress(strain_of(gradient))[..., [[0, 2], [2, 1]]]
    J = np.sqrt((np.cross(F[..., 0], F[..., 1]) ** 2).sum(axis=-1))
    pushed = np.einsum("...ca,...ab,...cb->...c", F[..., :2, :], S, F[..., :2, :])
    return pushed / J[..., None]


def material_stress(membrane: Membrane, gradient: Array) -> Array:
    """Second Piola-Kirchhoff stress in Pa, film axes, (..., 2): 11, 22."""
    return membrane.stress(strain_of(gradient))[..., :2]


OBSERVABLES: dict[str, Callable[[Membrane, Array], Array]] = {
    "material": material_stress,
    "thesis-edge": cauchy_stress,
}


def _gradient(membrane: Membrane, x: Array, part: Sampling) -> Array:
    nodal = x[membrane.element_dofs[part.elements]].reshape(len(part.elements), 1, -1, 3)
    return np.matmul(nodal.swapaxes(2, 3), part.gradients)


def _samplings(scene: Scene, membrane: Membrane) -> Iterator[Sampling]:
    for index, electrode in enumerate(scene.electrode_list):
        patch = membrane.mesh.subdomains[electrode_patch(electrode.name)]
        if scene.numerics.observable == "material":
            for axis in (0, 1):
                gradients, weights = membrane.gradients[patch], membrane.weights[patch]
                yield Sampling(index, axis, patch, gradients, weights)
        else:
            yield from _edge_samplings(membrane, index, patch)


def _edge_samplings(
    membrane: Membrane, electrode: int, patch: NDArray[np.int64]
) -> Iterator[Sampling]:
    area = membrane.weights[patch].sum()
    for axis, facets in enumerate(_edges(membrane.mesh, patch)):
        for side in (0, 1):
            basis = InteriorFacetBasis(
                membrane.mesh, membrane.basis.elem, facets=facets, side=side, intorder=4
            )
            weights = 0.5 * area * basis.dx / basis.dx.sum()
            yield Sampling(electrode, axis, basis.tind, shape_gradients(basis), weights)


def _edges(mesh: MeshTri2, patch: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """Facets on the left and right edges of a rectangular patch, and on the upper and lower."""
    facets, count = np.unique(mesh.t2f[:, patch], return_counts=True)
    facets = facets[count == 1]
    extent = np.abs(np.diff(mesh.p[:, mesh.facets[:, facets]], axis=1))[:, 0]
    upright = extent[1] > extent[0]
    return facets[upright], facets[~upright]
