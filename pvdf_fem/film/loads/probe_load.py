"""Loads by probes: their common base, dead tractions, and pressures that follow the film.

A load presses on the probe's patch, of the undeformed area A_p, with the total force F:

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
    """The load of a probe: the base class of every ``load.kind``.

    Parameters
    ----------
    spec : LoadSpec
        Probe with its force or depth, and the patch of the mesh below it.
    space : Space
        The finite-element space of the solved sector.
    sector : SymmetrySector
        The solved sector of the film. If a mirror image of the probe is another probe, the patch of
        this one may have no elements in the sector.
    """

    #: Whether the film stays plane under the probe. Tractions are then singular along its edge.
    is_rigid = False
    #: Approximate fraction of the force that acts along the patch's edge.
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
        """Magnitude of the total force in N."""
        return float(np.linalg.norm(self.components))

    def scaled(self, factor: float) -> Self:
        """Return a copy of the load whose force is multiplied by a factor."""
        return self.with_components(factor * self.components)

    def with_components(self, components: Array) -> Self:
        """Return a copy of the load with another total force.

        Parameters
        ----------
        components : ndarray, shape (3,)
            Force on the whole film in N, in the sector's axes.
        """
        other = copy(self)
        other.components = components
        return other

    def integrate_on_film(self, weighted: Array) -> float:
        """Integrate over the probe's patch on the whole film, from values on the solved sector.

        Parameters
        ----------
        weighted : ndarray, shape (patch elements, points)
            Integrand times quadrature weights at the points of the patch in the sector.
        """
        image_count = len(self.sector.signs)
        patch_count = 1
        if self.sector.mirror_axes:
            # the mirror images complete this probe's patch, or are patches of other probes
            covered = float(self.space.weights[self.patch].sum()) * image_count
            patch_count = max(round(covered / self.spec.outline.area), 1)
        return float(weighted.sum()) * image_count / patch_count


class PatchLoad(ProbeLoad):
    """A distributed traction on the probe's patch of the mesh.

    Subclasses define `traction`. If the traction depends on the deformation, they also define
    ``conservative = False``, `element_tangent` and `with_frozen_loads`.
    """

    @abstractmethod
    def traction(self, deformation_gradient: Array) -> Array:
        """Return the traction per undeformed area in Pa.

        Parameters
        ----------
        deformation_gradient : ndarray, shape (..., 3, 2)
            Deformation gradient of the film at the points.

        Returns
        -------
        ndarray, shape (..., 3)
        """

    def forces(self, state: State) -> Array:
        """Return the forces in N: the integral of the traction over the patch.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        traction = self.traction(state.deformation_gradient[self.patch])
        return integrate_traction(self.space, self.patch, traction)

    @property
    def pressure(self) -> float:
        """Mean magnitude of the traction in Pa; 0 if the patch has no elements in the sector."""
        if not len(self.patch):
            return 0.0
        return self.force / self.integrate_on_film(self.space.weights[self.patch])

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces that press on the film's face: the traction along z, integrated."""
        traction = self.traction(state.deformation_gradient[self.patch])[..., 2]
        return ElementForces(self.patch, (self.space.weights[self.patch] * traction).sum(axis=1))


class DeadPressure(PatchLoad):
    """A traction in the direction of the force, which does not depend on the displacement."""

    def traction(self, deformation_gradient: Array) -> Array:
        """Return the mean traction per undeformed area in Pa, without the load's profile.

        Parameters
        ----------
        deformation_gradient : ndarray, shape (..., 3, 2)
            Used only for its shape.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        force = self.force
        direction = self.components / force if force else UP
        return np.broadcast_to(self.pressure * direction, deformation_gradient.shape[:-1])

    def forces(self, state: State) -> Array:
        """Return the forces of the traction, distributed by the load's profile, in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self._dead_forces

    def with_components(self, components: Array) -> Self:
        """Return a copy of the load with another total force.

        Parameters
        ----------
        components : ndarray, shape (3,)
            Force on the whole film in N, in the sector's axes.
        """
        other = super().with_components(components)
        other.__dict__.pop("_dead_forces", None)  # the cached forces are for the old components
        return other

    @cached_property
    def _dead_forces(self) -> Array:
        """Nodal forces in N, shape (dofs,)."""
        return np.outer(self._nodal_force_fractions, self.components).ravel()

    @cached_property
    def _nodal_force_fractions(self) -> Array:
        """Force at each node divided by the total force, shape (nodes,); 0 at auxiliary nodes."""
        node_count = self.space.dof_count // 3
        if not len(self.patch):
            return np.zeros(node_count)
        values, weights = self._load_weighted_quadrature
        fractions = np.matmul(values.swapaxes(1, 2), weights[..., None])[..., 0]
        nodes = self.space.nodes[self.patch]
        total = np.bincount(nodes.ravel(), fractions.ravel(), node_count)
        return np.asarray(total / self.integrate_on_film(weights))

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces that press on the film's face, distributed by the load's profile."""
        _, weights = self._load_weighted_quadrature
        fractions = weights.sum(axis=1) / self.integrate_on_film(weights)
        return ElementForces(self.patch, self.components[2] * fractions)

    @property
    def _load_weighted_quadrature(self) -> tuple[Array, Array]:
        """Quadrature on the patch, whose weights are multiplied by the load's profile.

        A pair of arrays: shape functions, shape (n, points, functions), and weights in m² times the
        profile, shape (n, points). Elements are in the order of `patch`.

        Raises
        ------
        SceneError
            If the profile is zero at all points.
        """
        profile = make_profile(self.spec)
        if profile.order is None:
            return self.space.values[self.patch], self.space.weights[self.patch]
        points, values, weights = self.space.make_quadrature(self.patch, profile.order)
        weights = weights * profile(points @ self.sector.frame)
        if len(weights) and not weights.any():
            raise profile.make_error("is zero wherever the probe presses; change it")
        return values, weights


class FollowerPressure(PatchLoad):
    """A uniform pressure that stays normal to the deformed film."""

    conservative = False

    def traction(self, deformation_gradient: Array) -> Array:
        """Return the pressure along the deformed film's normal, per undeformed area in Pa.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        return self.pressure * compute_normal(deformation_gradient)

    def element_tangent(self, state: State) -> ElementMatrices | None:
        """Return the derivative of `residual` in N/m; None if the patch has no elements."""
        if not len(self.patch):
            return None
        stiffness = compute_normal_stiffness(self.space, self.patch, self.pressure, state)
        return ElementMatrices(self.patch, -stiffness)

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces that press on the film's face: pressure times undeformed area."""
        area = self.space.weights[self.patch].sum(axis=1)
        return ElementForces(self.patch, self.pressure * area)

    def with_frozen_loads(self) -> DeadPressure:
        """Return a dead load with the same force, distributed by the load's profile."""
        return DeadPressure(self.spec, self.space, self.sector).with_components(self.components)


def integrate_traction(space: Space, elements: Selection, traction: Array) -> Array:
    """Compute the nodal forces of a traction on elements.

    Parameters
    ----------
    space : Space
        Space whose quadrature and shape functions are used.
    elements : slice or ndarray, shape (n,)
        Numbers of the elements on which the traction acts.
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
    """Compute normals of the deformed film whose length is the deformed per undeformed area.

    Parameters
    ----------
    deformation_gradient : ndarray, shape (..., 3, 2)
        Deformation gradient of the film.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    return np.cross(deformation_gradient[..., 0], deformation_gradient[..., 1])


def compute_normal_stiffness(
    space: Space, elements: Selection, pressure: float, state: State
) -> Array:
    """Differentiate the nodal forces of a pressure that stays normal to the deformed film.

    Parameters
    ----------
    space : Space
        Space whose quadrature and shape functions are used.
    elements : slice or ndarray, shape (n,)
        Numbers of the elements on which the pressure acts.
    pressure : float
        The pressure in Pa.
    state : State
        The state of the film.

    Returns
    -------
    ndarray, shape (n, element dofs, element dofs)
        Derivatives of the element's forces with respect to its dofs in N/m; not symmetric.

    Notes
    -----
    The normal is F₁ × F₂ with the columns F₁ and F₂ of the deformation gradient. Its derivative is
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
