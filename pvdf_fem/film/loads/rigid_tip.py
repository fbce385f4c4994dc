"""Frictionless contact with a rigid tip, by a penalty on the overlap of film and tip.

The point X of the film moves by u in the plane and by the deflection w. There the tip's surface is
at d - z(X + u), with the depth d of its lowest point and its height profile z. The overlap
o = d - z(X + u) - w adds the energy k <o>²/2 per undeformed area, with the penalty k and the
positive part <o>, so that the tip presses with the traction k <o> along z. The contact ends where
the overlap ends; no mesh has to follow its edge.

If the force F is prescribed, the depth is an unknown, and the energy minus F d is convex in it.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.probe_load import DeadPressure, ProbeLoad
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import (
    NO_INDICES,
    Constraints,
    ElementForces,
    ElementMatrices,
    MatrixAssembler,
    State,
    Term,
)
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector

#: Overlap as a fraction of the depth that no tip exceeds, not even the softest one.
MAX_SOFTNESS = 0.1
#: Factor by which `RigidTip.relaxed` increases the softness.
SOFTNESS_STEP = 10.0


@dataclass(frozen=True, eq=False)
class Overlap:
    """The overlap of film and tip at rows of points, such as the quadrature points of elements."""

    depth: float  #: Depth of the tip's lowest point in m.
    #: The overlap in m, negative for a gap, -inf where no tip can press, shape (elements, points).
    value: Array
    #: Derivatives of the overlap with respect to the displacement, -z_x, -z_y and -1, shape
    #: (elements, points, 3).
    rates: Array
    #: Second derivatives of the tip's height in 1/m, shape (elements, points, 2, 2).
    hessian: Array

    @property
    def is_touching(self) -> Mask:
        """Whether the film touches the tip, shape (elements, points)."""
        return self.value > 0.0


class _Tractions(NamedTuple):
    """Tractions along z in the elements that touch the tip."""

    elements: Indices  # numbers of the elements, shape (n,)
    weighted: Array  # tractions times quadrature weights in N, shape (n, points)


class RigidTip(ProbeLoad):
    """A rigid tip that presses with a prescribed force, or down to a prescribed depth.

    Under a force the depth is an unknown: the last component of an auxiliary node.

    Parameters
    ----------
    spec : LoadSpec
        The probe, its load, and an estimate of the contact.
    space : Space
        The finite-element space of the solved sector.
    sector : SymmetrySector
        The solved sector of the film.
    """

    edge_fraction = 0.5

    def __init__(self, spec: LoadSpec, space: Space, sector: SymmetrySector = WHOLE_FILM) -> None:
        super().__init__(spec, space, sector)
        assert spec.contact is not None
        self.tip = spec.tip
        #: Prescribed depth of the tip's lowest point in m; None under a force.
        self.depth: float | None = spec.load.depth
        #: Approximate overlap in the middle of the contact, as a fraction of the depth.
        self.softness: float = spec.contact.softness
        self.components[2] = spec.contact.force
        #: The dof of an unknown depth, shape (1,) or (0,).
        self.depth_dof: Indices = NO_INDICES
        # no depth is an unknown if only a mirror image of the tip presses on the solved sector
        if spec.auxiliary_node is not None and len(self.patch):
            self.depth_dof = 3 * (space.basis.N + spec.auxiliary_node) + np.array([2])
        self.constraints = Constraints(auxiliary_dofs=self.depth_dof)
        self._last_overlap: tuple[Array, Overlap] | None = None

    @property
    def has_unknown_depth(self) -> bool:
        """Whether the depth is an unknown of the solved sector."""
        return len(self.depth_dof) > 0

    @property
    def penalty(self) -> float:
        """Traction divided by overlap in Pa/m."""
        assert self.spec.contact is not None
        return self.spec.contact.stiffness / self.softness

    def with_components(self, components: Array) -> Self:
        """Return a copy of the tip with another force, or with another prescribed depth.

        Parameters
        ----------
        components : ndarray, shape (3,)
            Force in N. A prescribed depth changes with the cube root of the force along z.
        """
        other = super().with_components(components)
        if self.depth is not None:
            other.depth = self.depth * float(np.cbrt(components[2] / self.components[2]))
        other._last_overlap = None
        return other

    # --- hints for the solver

    def relaxed(self) -> Term:
        """Return a copy of the tip with a larger `softness`, which overlaps with the film more.

        If `softness` would exceed `MAX_SOFTNESS`, a dead pressure on the patch is returned instead.
        """
        if self.softness > 0.1 * MAX_SOFTNESS:
            return DeadPressure(self.spec, self.space, self.sector).with_components(self.components)
        other = copy(self)
        other.softness = SOFTNESS_STEP * self.softness
        other._last_overlap = None
        return other

    def complete_initial_guess(self, x: Array) -> Array:
        """Return dofs at which the tip touches the film: a changed copy of `x`, or `x` itself.

        An unknown depth that is still zero is set so that the overlap balances the force; a nonzero
        one is not changed. If the depth is prescribed, a film below the tip is lifted up to it.
        """
        if not self.has_unknown_depth:
            return self._lift_film(x)
        if x[self.depth_dof[0]]:
            return x
        x = x.copy()
        x[self.depth_dof] = self._find_balanced_depth(x)
        return x

    def _find_balanced_depth(self, x: Array) -> float:
        """Compute the depth at which the overlap with a film at the dofs `x` balances the force.

        The total traction is piecewise linear in the depth, with a kink at every depth at which a
        further quadrature point begins to touch.
        """
        # the depth in `x` is zero: minus the overlap is the depth at which a point begins to touch
        touch_depth = -self._compute_overlap(x).value
        # points that the tip cannot press have infinite depths, which are sorted last and left out
        finite_count = np.isfinite(touch_depth).sum()
        order = np.argsort(touch_depth, axis=None)[:finite_count]
        depths = touch_depth.ravel()[order]
        weights = self.space.weights.ravel()[order]
        areas = np.cumsum(weights)
        moments = np.cumsum(weights * depths)
        overlap_volumes = areas * depths - moments  # for a tip at each of the depths
        needed = self._force_on_sector / self.penalty
        last = np.searchsorted(overlap_volumes, needed, side="right") - 1
        return float((needed + moments[last]) / areas[last])

    def _lift_film(self, x: Array) -> Array:
        """Scale down the dofs `x` until a film that hangs below the tip just touches it.

        `x` itself is returned if the film touches the tip already, or if only a mirror image of the
        tip presses on the solved sector.
        """
        overlap = self._compute_overlap(x)
        nearest = np.unravel_index(overlap.value.argmax(), overlap.value.shape)
        if not np.isfinite(overlap.depth) or overlap.is_touching[nearest]:
            return x
        wanted_overlap = self.softness * overlap.depth
        lift = wanted_overlap - overlap.value[nearest]
        deflection = self.compute_deformed_points(x)[nearest][2]
        return x * max(1.0 - lift / deflection, 0.0)

    # --- the overlap

    def overlap(self, state: State) -> Overlap:
        """Return the overlap at a state; that of the last state is cached."""
        if self._last_overlap is None or self._last_overlap[0] is not state.dofs:
            self._last_overlap = state.dofs, self._compute_overlap(state.dofs)
        return self._last_overlap[1]

    def _compute_overlap(self, x: Array) -> Overlap:
        """Compute the overlap of the tip with the film at the dofs `x`.

        It is -inf below a flat face, and everywhere if only a mirror image of the tip presses.
        """
        return self.overlap_at(self.compute_deformed_points(x), x)

    def overlap_at(self, points: Array, x: Array) -> Overlap:
        """Compute the overlap at points of the film displaced by the dofs `x`.

        The points are given by their positions in m on the displaced film, shape (n, points, 3).
        """
        depth = self._find_depth(x)
        frame = self.sector.frame
        shape = points.shape[:2]
        height = self.tip.compute_height(points[..., :2].reshape(-1, 2) @ frame)
        rates = -np.ones((*shape, 3))
        rates[..., :2] = -(height.slope @ frame.T).reshape(*shape, 2)
        hessian = (frame @ height.hessian @ frame.T).reshape(*shape, 2, 2)
        heights = height.value.reshape(shape)
        value = depth - heights - points[..., 2]
        if self.tip.face is not None:  # flat film under a flat face bears no pressure
            value[heights == 0.0] = -np.inf
        return Overlap(depth=depth, value=value, rates=rates, hessian=hessian)

    def _find_depth(self, x: Array) -> float:
        """Return the depth in m at the dofs `x`; -inf if only a mirror image of the tip presses."""
        if not len(self.patch):
            return -np.inf
        if self.has_unknown_depth:
            return float(x[self.depth_dof][0])
        return self.depth or 0.0

    def compute_deformed_points(self, x: Array) -> Array:
        """Compute the positions in m of the quadrature points displaced by the dofs `x`.

        Returns
        -------
        ndarray, shape (elements, points, 3)
        """
        points = np.matmul(self.space.values, x.reshape(-1, 3)[self.space.nodes])
        points[..., :2] += self.space.quadrature_points
        return points

    @property
    def _force_on_sector(self) -> float:
        """The part of the force along z that acts on the solved sector, in N."""
        if not len(self.patch):
            return 0.0
        weights = self.space.weights[self.patch]
        return float(self.components[2] * weights.sum() / self.integrate_on_film(weights))

    # --- the term

    def tractions(self, state: State) -> Array:
        """Return the penalty's tractions along z times the quadrature weights, in N.

        Returns
        -------
        ndarray, shape (elements, points)
        """
        return self.penalty * np.maximum(self.overlap(state).value, 0.0) * self.space.weights

    def _select_tractions(self, state: State) -> _Tractions:
        """Return the tractions, restricted to the elements that touch the tip."""
        weighted = self.tractions(state)
        elements = np.flatnonzero(weighted.any(axis=1))
        return _Tractions(elements, weighted[elements])

    def forces(self, state: State) -> Array:
        """Return the forces of the tip on the dofs of the film.

        Returns
        -------
        ndarray, shape (dofs,)
            In N. If the depth is unknown, its dof has the net force on the tip, 0 in equilibrium.
        """
        elements, weighted = self._select_tractions(state)
        on_film = -self.overlap(state).rates[elements] * weighted[..., None]
        forces = self._integrate_forces(on_film, elements)
        forces[self.depth_dof] = self._force_on_sector - weighted.sum()
        return forces

    def _integrate_forces(self, weighted: Array, elements: Indices) -> Array:
        """Integrate a vector field on some elements to nodal forces.

        Parameters
        ----------
        weighted : ndarray, shape (n, points, 3)
            The field times quadrature weights.
        elements : ndarray, shape (n,)
            Numbers of the elements.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        values = self.space.values[elements]
        return self.space.sum_at_dofs(np.matmul(values.swapaxes(1, 2), weighted), elements)

    def energy(self, state: State) -> float:
        """Return the energy of the overlap minus the work of a prescribed force, in J."""
        overlap = np.maximum(self.overlap(state).value, 0.0)
        energy = 0.5 * float((self.tractions(state) * overlap).sum())
        return energy - self._force_on_sector * float(state.dofs[self.depth_dof].sum())

    def element_tangent(self, state: State) -> ElementMatrices:
        """Return the derivative of `residual` at constant depth in N/m, for touching elements."""
        elements, weighted = self._select_tractions(state)
        stiffness = self._compute_film_stiffness(state, elements, weighted)
        values = self.space.values[elements]
        local = np.einsum("epa,epij,epb->eaibj", values, stiffness, values, optimize=True)
        dofs = 3 * values.shape[2]
        return ElementMatrices(elements, local.reshape(len(elements), dofs, dofs))

    def _compute_film_stiffness(self, state: State, elements: Indices, weighted: Array) -> Array:
        """Differentiate the tip's residual with respect to the displacement at constant depth.

        Parameters
        ----------
        state : State
            The state of the film.
        elements : ndarray, shape (n,)
            Elements that touch the tip.
        weighted : ndarray, shape (n, points)
            Tractions along z times quadrature weights in N.

        Returns
        -------
        ndarray, shape (n, points, 3, 3)
            Derivatives at the quadrature points, times quadrature weights, in N/m.
        """
        overlap = self.overlap(state)
        touching = overlap.is_touching[elements]
        stiff = self.penalty * self.space.weights[elements] * touching
        rates = overlap.rates[elements]
        stiffness = stiff[..., None, None] * rates[..., :, None] * rates[..., None, :]
        stiffness[..., :2, :2] -= weighted[..., None, None] * overlap.hessian[elements]
        return stiffness

    def coupled_tangent(self, assembly: MatrixAssembler, state: State) -> sp.csc_matrix | None:
        """Return the row and column of an unknown depth in the tangent; None without one.

        Returns
        -------
        sparse matrix, shape (unknowns, unknowns), or None
            In N/m.
        """
        if not self.has_unknown_depth:
            return None
        force_rates, total_rate = self._compute_depth_rates(state)
        depth = self.depth_dof[0]
        film = np.flatnonzero(force_rates)
        depths = np.full(len(film), depth)
        rows = np.concatenate([[depth], film, depths])
        columns = np.concatenate([[depth], depths, film])
        values = np.concatenate([[total_rate], -force_rates[film], -force_rates[film]])
        shape = (self.space.dof_count, self.space.dof_count)
        return assembly.of_dofs(sp.csr_matrix((values, (rows, columns)), shape))

    def _compute_depth_rates(self, state: State) -> tuple[Array, float]:
        """Differentiate the tip's forces on the film with respect to its depth.

        Returns
        -------
        force_rates : ndarray, shape (dofs,)
            Derivatives of the forces on the film in N/m.
        total_rate : float
            Derivative of the total force along z in N/m.
        """
        overlap = self.overlap(state)
        stiff = self.penalty * self.space.weights * overlap.is_touching
        elements = np.flatnonzero(stiff.any(axis=1))
        rates = -overlap.rates[elements] * stiff[elements][..., None]
        return self._integrate_forces(rates, elements), float(stiff.sum())

    # The products below form no element matrices and so take much less time than `element_tangent`.

    def element_action(self, state: State, x: Array) -> Array:
        """Multiply the element tangents at constant depth by the dofs `x`; return forces in N."""
        actions = np.zeros(self.space.element_dofs.shape)
        elements, weighted = self._select_tractions(state)
        values = self.space.values[elements]
        displacement = np.matmul(values, x.reshape(-1, 3)[self.space.nodes[elements]])
        stiffness = self._compute_film_stiffness(state, elements, weighted)
        rates = np.matmul(stiffness, displacement[..., None])[..., 0]
        actions[elements] = np.matmul(values.swapaxes(1, 2), rates).reshape(len(elements), -1)
        return actions

    def action(self, state: State, x: Array) -> Array:
        """Return the tangent, including that of an unknown depth, times the dofs `x`, in N."""
        forces = self.space.sum_at_dofs(self.element_action(state, x))
        if self.has_unknown_depth:
            force_rates, total_rate = self._compute_depth_rates(state)
            depth_change = x[self.depth_dof]
            forces -= force_rates * depth_change
            forces[self.depth_dof] += total_rate * depth_change - force_rates @ x
        return forces

    def diagonal(self, state: State) -> Array:
        """Return the diagonal of the tangent in N/m, including the entry of an unknown depth."""
        elements, weighted = self._select_tractions(state)
        stiffness = np.einsum("epii->epi", self._compute_film_stiffness(state, elements, weighted))
        values = self.space.values[elements]
        diagonal = self.space.sum_at_dofs(
            np.matmul(values.swapaxes(1, 2) ** 2, stiffness), elements
        )
        if self.has_unknown_depth:
            _, diagonal[self.depth_dof] = self._compute_depth_rates(state)
        return diagonal

    # --- results

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces that press on the film's face: the tractions along z, integrated."""
        elements, weighted = self._select_tractions(state)
        return ElementForces(elements, weighted.sum(axis=1))

    def find_touching_points(self, state: State) -> Array:
        """Find the quadrature points of the undeformed film that touch the tip.

        Return them in m, in the axes of the scene, shape (n, 2).
        """
        return self.space.quadrature_points[self.overlap(state).is_touching] @ self.sector.frame
