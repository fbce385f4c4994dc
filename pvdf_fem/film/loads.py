"""What the probe does to the film: dead pressure, follower pressure, rigid punch.

All three press on the probe's patch Omega_p with the total force F along +z:

- dead: pressure F/A_p along z per reference area;
- follower: pressure F/A_p normal to the deformed film, per deformed area (ANSYS's SFA); on the way
  to it the traction may be a mean of this and the dead one (`Load.following`);
- rigid: a flat face that stays horizontal, so the deflection is one unknown over the patch. The
  face either slides or sticks; a sticking face is held by the probe's guide, so u = v = 0 on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.film.membrane import Array, Membrane
from pvdf_fem.mesh.gmsh_mesh import PROBE
from pvdf_fem.scene.scene import Scene

UP: Array = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Load:
    """The forces and constraints of a scene's probe on a membrane's dofs.

    Attributes
    ----------
    kind, contact : str
        As in the scene file.
    force : float
        Total force in N.
    patch : (n,) int
        Elements under the probe.
    shapes : (n, points, functions)
        Values of the shape functions on the patch.
    weights : (n, points)
        Quadrature weights times area on the patch, m^2.
    membrane : Membrane
        Where the forces act.
    images : int
        Of the membrane, which together are the film that bears the force.
    following : float
        Part of the traction that follows the film, 0 of a dead load to 1 of a follower.
    """

    kind: str
    contact: str | None
    force: float
    patch: NDArray[np.int64]
    shapes: Array
    weights: Array
    membrane: Membrane
    images: int
    following: float

    @classmethod
    def of(cls, scene: Scene, membrane: Membrane, images: int = 1) -> Load:
        """The load of `scene`; without a probe, no patch and no force."""
        none = np.empty(0, dtype=np.int64)
        patch = membrane.mesh.subdomains[PROBE] if scene.probe else none
        force = scene.load.force if scene.probe else 0.0
        values = [np.broadcast_to(s[0], membrane.weights.shape) for s in membrane.basis.basis]
        shapes = np.stack([value[patch] for value in values], axis=-1)
        weights = membrane.weights[patch]
        kind, contact = scene.load.kind, scene.load.contact
        following = 1.0 if kind == "follower" else 0.0
        return cls(kind, contact, force, patch, shapes, weights, membrane, images, following)

    @property
    def conservative(self) -> bool:
        """Whether the forces do not depend on the displacement, so that an energy exists."""
        return self.following == 0.0

    @property
    def pressure(self) -> float:
        """Nominal pressure in Pa."""
        return self.force / (self.images * float(self.weights.sum())) if self.force else 0.0

    def shared_dofs(self) -> NDArray[np.int64]:
        """Dofs that have one common value: the deflection under a rigid punch."""
        return 3 * self._rigid_nodes() + 2

    def fixed_dofs(self) -> NDArray[np.int64]:
        """Dofs that a sticking punch holds in the plane."""
        nodes = self._rigid_nodes() if self.contact == "stuck" else self._rigid_nodes()[:0]
        return np.concatenate([3 * nodes, 3 * nodes + 1])

    def _rigid_nodes(self) -> NDArray[np.int64]:
        nodes = self.membrane.basis.element_dofs[:, self.patch]
        return np.unique(nodes if self.kind == "rigid" else nodes[:0])

    def forces(self, deformation_gradient: Array) -> Array:
        """External forces in N, (elements, dofs of an element)."""
        if self.conservative:
            return self._dead
        return self._forces(self.direction(deformation_gradient[self.patch]))

    def turning(self, deformation_gradient: Array) -> Array:
        """Derivative of `forces` by the part of the traction that follows, in N."""
        return self._forces(_normal(deformation_gradient[self.patch]) - UP)

    @cached_property
    def _dead(self) -> Array:
        return self._forces(UP)

    def _forces(self, direction: Array) -> Array:
        forces = np.zeros((*self.membrane.basis.element_dofs.T.shape, 3))
        traction = self.pressure * self.weights[..., None] * direction
        forces[self.patch] = np.matmul(self.shapes.swapaxes(1, 2), traction)
        return forces.reshape(len(forces), -1)

    def direction(self, deformation_gradient: Array) -> Array:
        """Traction over pressure, (..., 3), per reference area."""
        along = np.broadcast_to(UP, deformation_gradient.shape[:-1])
        if self.conservative:
            return along
        return (1.0 - self.following) * along + self.following * _normal(deformation_gradient)

    def stiffness(self, deformation_gradient: Array) -> Array:
        """Derivative of `forces` on the patch, (patch elements, dofs, dofs of an element)."""
        F = deformation_gradient[self.patch]
        gradients = self.membrane.gradients[self.patch]
        # d(F1 x F2) = F1 x dF2 - F2 x dF1, with dFi = gradients_i du
        turned = [np.cross(F[..., i][..., None, :], np.eye(3)).swapaxes(-1, -2) for i in (0, 1)]
        normal = np.einsum("epij,epb->epibj", turned[0], gradients[..., 1]) - np.einsum(
            "epij,epb->epibj", turned[1], gradients[..., 0]
        )
        scaled = self.shapes * (self.following * self.pressure * self.weights)[..., None]
        stiffness = np.einsum("epa,epibj->eaibj", scaled, normal)
        dofs = 3 * self.shapes.shape[-1]
        return stiffness.reshape(len(self.patch), dofs, dofs)


def _normal(deformation_gradient: Array) -> Array:
    """The film's normal, as long as its area over that in the reference, (..., 3)."""
    return np.cross(deformation_gradient[..., 0], deformation_gradient[..., 1])
