"""What the probe does to the film: one class for each `load.kind`.

All press on the probe's patch Omega_p with the total force F:

- ``dead``: a pressure F/A_p along z per reference area;
- ``follower``: a pressure F/A_p normal to the deformed film, per deformed area (ANSYS's SFA);
- ``rigid``: a flat punch that stays horizontal, so that the deflection is one unknown over the
  patch. It either slides or sticks; a sticking punch is held by its guide, so u = v = 0 under it.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from pkgutil import resolve_name
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array, Indices, Selection
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State, Term
from pvdf_fem.mesh.gmsh_mesh import PROBE
from pvdf_fem.scene.registry import LOAD_CLASSES
from pvdf_fem.scene.scene import Scene

UP: Array = np.array([0.0, 0.0, 1.0])


class DeadPressure(Term):
    """A uniform pressure along z on the probe's reference area.

    Parameters
    ----------
    scene : Scene
        Without a probe there is no patch and no force.
    space : Space
    images : int
        Number of mirror images of the space that together are the film that bears the force.

    Attributes
    ----------
    force : float
        Total force in N on the whole film.
    patch : (n,) int
        Elements under the probe.
    rigid : bool
        Whether the film stays flat under the probe; tractions are then singular along its edge.
    """

    rigid = False

    def __init__(self, scene: Scene, space: Space, images: int = 1) -> None:
        self.space, self.images = space, images
        has_probe = scene.probe is not None
        self.patch: Indices = (
            space.mesh.subdomains[PROBE] if has_probe else np.empty(0, dtype=np.int64)
        )
        self.force = scene.load.force if has_probe else 0.0

    def with_force(self, force: float) -> Self:
        """The same load with another total force in N."""
        other = copy(self)
        other.__dict__.pop("_dead_forces", None)
        other.force = force
        return other

    @property
    def rigid_patch(self) -> Indices:
        """Elements that the load keeps flat."""
        return self.patch if self.rigid else self.patch[:0]

    @property
    def pressure(self) -> float:
        """Nominal pressure in Pa."""
        area = self.images * float(self.space.weights[self.patch].sum())
        return self.force / area if self.force else 0.0

    def direction(self, deformation_gradient: Array) -> Array:
        """Traction per reference area over the pressure, (..., 3)."""
        return np.broadcast_to(UP, deformation_gradient.shape[:-1])

    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""
        return self._dead_forces

    @cached_property
    def _dead_forces(self) -> Array:
        return self.forces_of(np.broadcast_to(UP, (*self.space.weights[self.patch].shape, 3)))

    def forces_of(self, direction: Array) -> Array:
        """Forces in N, (dofs,), of tractions in the directions (patch elements, points, 3)."""
        values, weights = self.space.values[self.patch], self.space.weights[self.patch]
        traction = self.pressure * weights[..., None] * direction
        local = np.matmul(values.swapaxes(1, 2), traction)
        return self.space.sum(local, self.patch)

    def energy(self, state: State) -> float:
        """The potential of the load in J."""
        return -float(self.forces(state) @ state.dofs)

    def residual(self, state: State) -> Array:
        """The forces in N, (dofs,), with a minus sign."""
        return -self.forces(state)

    def along(self, state: State, x: Array) -> Array:
        """Coefficients (5,) of the load's potential along `x`, its forces held as they are."""
        forces = self.forces(state)
        return np.array([-forces @ state.dofs, -forces @ x, 0.0, 0.0, 0.0])


class FollowerPressure(DeadPressure):
    """A pressure that stays normal to the deformed film.

    Attributes
    ----------
    following : float
        Part of the traction that follows the film, from 0, a dead load, to 1. Arc-length
        continuation raises it where Newton's method does not reach 1 directly.
    """

    following = 1.0

    @property
    def conservative(self) -> bool:  # type: ignore[override]
        """Whether nothing of the traction follows the film."""
        return self.following == 0.0

    def turned(self, following: float) -> FollowerPressure:
        """The same load of which another part follows the film."""
        other = copy(self)
        other.following = following
        return other

    def direction(self, deformation_gradient: Array) -> Array:
        """Traction per reference area over the pressure, (..., 3)."""
        normal = _normal(deformation_gradient)
        return (1.0 - self.following) * UP + self.following * normal

    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""
        if self.conservative:
            return self._dead_forces
        return self.forces_of(self.direction(state.deformation_gradient[self.patch]))

    def turning_forces(self, state: State) -> Array:
        """Derivative of `forces` by `following` in N, (dofs,)."""
        return self.forces_of(_normal(state.deformation_gradient[self.patch]) - UP)

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        if self.conservative or not len(self.patch):
            return None
        return self.patch, -self._stiffness(state)

    def _stiffness(self, state: State) -> Array:
        """Derivative of `forces` in N/m, (patch elements, dofs, dofs of an element)."""
        F = state.deformation_gradient[self.patch]
        values, gradients = self.space.values[self.patch], self.space.gradients[self.patch]
        # d(F1 x F2) = F1 x dF2 - F2 x dF1, with dFi = gradients_i du
        turned = [np.cross(F[..., i][..., None, :], np.eye(3)).swapaxes(-1, -2) for i in (0, 1)]
        normal = np.einsum("epij,epb->epibj", turned[0], gradients[..., 1]) - np.einsum(
            "epij,epb->epibj", turned[1], gradients[..., 0]
        )
        weights = self.following * self.pressure * self.space.weights[self.patch]
        stiffness = np.einsum("epa,epibj->eaibj", values * weights[..., None], normal)
        dofs = 3 * values.shape[-1]
        return stiffness.reshape(len(self.patch), dofs, dofs)


class Punch(DeadPressure):
    """A rigid flat punch under a dead force; the film under it moves up by one common deflection.

    A constraint on the dofs, so that it adds no equation and the tangent stays symmetric.
    """

    rigid = True

    def __init__(self, scene: Scene, space: Space, images: int = 1) -> None:
        super().__init__(scene, space, images)
        nodes = np.unique(space.basis.element_dofs[:, self.patch])
        self.shared_dofs = 3 * nodes + 2
        if scene.load.contact == "stuck":
            self.fixed_dofs = np.concatenate([3 * nodes, 3 * nodes + 1])


def _normal(deformation_gradient: Array) -> Array:
    """The film's normal, as long as its area over that in the reference, (..., 3)."""
    return np.cross(deformation_gradient[..., 0], deformation_gradient[..., 1])


#: The class of each ``load.kind``.
LOADS: dict[str, type[DeadPressure]] = {
    kind: resolve_name(path) for kind, path in LOAD_CLASSES.items()
}
