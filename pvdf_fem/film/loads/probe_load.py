"""Loads by probes: what they have in common, dead tractions, and pressures that follow the film.

Each presses on the probe's patch Ω_p with the total force F:

- ``dead``: a traction along F per undeformed area, F/A_p or distributed by a profile; F may have
  any direction;
- ``follower``: a pressure F/A_p normal to the deformed film, per deformed area (ANSYS's SFA).

`pvdf_fem.film.loads.punch` has rigid flat punches, `pvdf_fem.film.loads.rigid_tip` curved tips.
"""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from functools import cached_property
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array, Indices, Selection
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.profiles import make_profile
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import ElementForces, ElementMatrices, LoadTerm, State
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector

UP: Array = np.array([0.0, 0.0, 1.0])


class ProbeLoad(LoadTerm):
    """A load by a probe: the base of every ``load.kind``.

    Parameters
    ----------
    spec : LoadSpec
        The probe and its load.
    space : Space
        The finite-element space of the solved sector.
    sector : SymmetrySector
        The solved sector. Where a mirror image of the probe is another probe, the patch of this one
        may have no elements in the sector.
    """

    #: Whether the film stays plane under the probe. Tractions are then singular along its edge.
    is_rigid = False
    #: Approximate share of the force that acts along the patch's edge.
    edge_fraction = 0.0

    def __init__(self, spec: LoadSpec, space: Space, sector: SymmetrySector = WHOLE_FILM) -> None:
        self.spec = spec
        self.space = space
        self.sector = sector
        #: Elements of the probe's patch, shape (n,).
        self.patch: Indices = space.mesh.subdomains[spec.patch]
        #: Total force on the whole film in N, in the sector's axes, shape (3,).
        self.components: Array = np.array(spec.load.components)
        self.components[:2] = sector.frame @ self.components[:2]

    @property
    def force(self) -> float:
        """Size of the total force in N."""
        return float(np.linalg.norm(self.components))

    def scaled(self, factor: float) -> Self:
        """Return the same load with its force multiplied by a factor."""
        return self.with_components(factor * self.components)

    def with_components(self, components: Array) -> Self:
        """Return the same load with another total force in N.

        Returns
        -------
        ndarray, shape (3,)
        """
        other = copy(self)
        other.components = components
        return other

    def integrate_on_film(self, weighted: Array) -> float:
        """Return an integral over the probe's patch on the whole film.

        Parameters
        ----------
        weighted : ndarray, shape (patch elements, points)
            Values times quadrature weights on the solved sector.
        """
        image_count = len(self.sector.signs)
        patch_count = 1
        if self.sector.mirror_axes:
            # the mirror images complete this probe's patch, or are patches of other probes
            covered = float(self.space.weights[self.patch].sum()) * image_count
            patch_count = max(round(covered / self.spec.outline.area), 1)
        return float(weighted.sum()) * image_count / patch_count


class PatchLoad(ProbeLoad):
    """A traction on the probe's patch in the mesh.

    A subclass gives its `traction` only. If the traction depends on the deformation it also gives
    ``conservative = False``, `element_tangent` and `with_frozen_loads`.
    """

    @abstractmethod
    def traction(self, deformation_gradient: Array) -> Array:
        """Return the traction per undeformed area in Pa.

        Parameters
        ----------
        deformation_gradient : ndarray, shape (..., 3, 2)
            Deformation gradient of the film.

        Returns
        -------
        ndarray, shape (..., 3)
        """

    def forces(self, state: State) -> Array:
        """Return the integral of the traction over the patch in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        traction = self.traction(state.deformation_gradient[self.patch])
        return integrate_traction(self.space, self.patch, traction)

    @property
    def pressure(self) -> float:
        """Mean size of the traction in Pa."""
        if not len(self.patch):
            return 0.0
        return self.force / self.integrate_on_film(self.space.weights[self.patch])

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the traction along z times the undeformed area of the elements."""
        traction = self.traction(state.deformation_gradient[self.patch])[..., 2]
        return ElementForces(self.patch, (self.space.weights[self.patch] * traction).sum(axis=1))


class DeadPressure(PatchLoad):
    """A traction in the direction of the force, which does not depend on the displacement."""

    def traction(self, deformation_gradient: Array) -> Array:
        """Return the mean traction per undeformed area in Pa.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        force = self.force
        direction = self.components / force if force else UP
        return np.broadcast_to(self.pressure * direction, deformation_gradient.shape[:-1])

    def forces(self, state: State) -> Array:
        """Return the forces of the traction with its profile in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self._dead_forces

    def with_components(self, components: Array) -> Self:
        """Return the same load with another total force in N.

        Returns
        -------
        ndarray, shape (3,)
        """
        other = super().with_components(components)
        other.__dict__.pop("_dead_forces", None)  # it is kept for one force
        return other

    @cached_property
    def _dead_forces(self) -> Array:
        """The forces in N, shape (dofs,)."""
        return np.outer(self._nodal_fractions, self.components).ravel()

    @cached_property
    def _nodal_fractions(self) -> Array:
        """Force at each scalar dof over the total force, shape (scalar dofs with auxiliary nodes,)."""
        node_count = self.space.dof_count // 3
        if not len(self.patch):
            return np.zeros(node_count)
        values, weights = self._quadrature
        shares = np.matmul(values.swapaxes(1, 2), weights[..., None])[..., 0]
        nodes = self.space.nodes[self.patch]
        total = np.bincount(nodes.ravel(), shares.ravel(), node_count)
        return np.asarray(total / self.integrate_on_film(weights))

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the force along z, distributed over the patch by the load's profile."""
        _, weights = self._quadrature
        share = weights.sum(axis=1) / self.integrate_on_film(weights)
        return ElementForces(self.patch, self.components[2] * share)

    @property
    def _quadrature(self) -> tuple[Array, Array]:
        """Quadrature on the patch, in the order of its elements.

        Values of the functions, (n, points, functions), and weights times the profile in m²,
        (n, points).
        """
        profile = make_profile(self.spec)
        if profile.order is None:
            return self.space.values[self.patch], self.space.weights[self.patch]
        places, values, weights = self.space.make_quadrature(self.patch, profile.order)
        weights = weights * profile(places @ self.sector.frame)
        if len(weights) and not weights.any():
            raise profile.make_error("is zero wherever the probe presses; change it")
        return values, weights


class FollowerPressure(PatchLoad):
    """A pressure that stays normal to the deformed film."""

    conservative = False

    def traction(self, deformation_gradient: Array) -> Array:
        """Return the traction per undeformed area in Pa.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        return self.pressure * compute_normal(deformation_gradient)

    def element_tangent(self, state: State) -> ElementMatrices | None:
        """Return the derivative of `residual` in N/m."""
        if not len(self.patch):
            return None
        stiffness = compute_normal_stiffness(self.space, self.patch, self.pressure, state)
        return ElementMatrices(self.patch, -stiffness)

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the pressure times the undeformed area of the elements."""
        area = self.space.weights[self.patch].sum(axis=1)
        return ElementForces(self.patch, self.pressure * area)

    def with_frozen_loads(self) -> DeadPressure:
        """Return the dead pressure of the same size."""
        return DeadPressure(self.spec, self.space, self.sector).with_components(self.components)


def integrate_traction(space: Space, elements: Selection, traction: Array) -> Array:
    """Integrate a traction over elements.

    Parameters
    ----------
    space : Space
        The finite-element space.
    elements : slice or ndarray, shape (n,)
        Elements on which the traction acts.
    traction : ndarray, shape (n, points, 3)
        Force per undeformed area at the quadrature points in Pa.

    Returns
    -------
    ndarray, shape (dofs,)
        Forces in N.
    """
    weighted = space.weights[elements][..., None] * traction
    values = space.values[elements]
    return space.sum_at_dofs(np.matmul(values.swapaxes(1, 2), weighted), elements)


def compute_normal(deformation_gradient: Array) -> Array:
    """Return the film's normal, as long as the ratio of deformed to undeformed area.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    return np.cross(deformation_gradient[..., 0], deformation_gradient[..., 1])


def compute_normal_stiffness(
    space: Space, elements: Selection, pressure: float, state: State
) -> Array:
    """Differentiate the forces of a pressure that stays normal to the film.

    Parameters
    ----------
    space : Space
        The finite-element space.
    elements : slice or ndarray, shape (n,)
        Elements on which the pressure acts.
    pressure : float
        The pressure in Pa.
    state : State
        The state of the film.

    Returns
    -------
    ndarray, shape (n, element dofs, element dofs)
        Derivative of the forces by the element's dofs in N/m.

    Notes
    -----
    The normal is F₁ × F₂ with the columns of the deformation gradient, and its derivative
    F₁ × dF₂ - F₂ × dF₁.
    """
    F = state.deformation_gradient[elements]
    values = space.values[elements]
    gradients = space.gradients[elements]
    cross_1 = np.cross(F[..., 0][..., None, :], np.eye(3)).swapaxes(-1, -2)
    cross_2 = np.cross(F[..., 1][..., None, :], np.eye(3)).swapaxes(-1, -2)
    normal_rate = np.einsum("epij,epb->epibj", cross_1, gradients[..., 1])
    normal_rate -= np.einsum("epij,epb->epibj", cross_2, gradients[..., 0])
    weights = pressure * space.weights[elements]
    stiffness = np.einsum("epa,epibj->eaibj", values * weights[..., None], normal_rate)
    dofs = 3 * values.shape[-1]
    return stiffness.reshape(len(values), dofs, dofs)
