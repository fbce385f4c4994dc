"""Contact with a rigid tip: a penalty on how far the film reaches into the tip.

Over a displaced point X + u the tip's surface has the height d - z(X + u) with the depth d of its
lowest point. The overlap o = d - z(X + u) - w costs the energy k <o>²/2 per reference area, so that
the tip presses with the traction k <o> along z, and slides without friction. The edge of the
contact is where the overlap ends, and no mesh has to follow that edge.

Where the force F is given, the depth is an unknown, by which the energy less F d is convex.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Mask, Selection
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.pressure import DeadPressure
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import Assembly, State
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector

#: Overlap over depth for the softest tip; ratio of overlaps from a tip to the next stiffer tip.
SOFTEST, SOFTER = 0.1, 10.0


@dataclass(frozen=True, eq=False)
class Overlap:
    """How the film and a tip overlap at the quadrature points of all elements."""

    depth: float  #: Of the tip's lowest point in m.
    value: Array  #: The overlap in m, negative where there is a gap, (elements, points).
    rates: Array  #: Its derivatives by the displacement: -z_x, -z_y, -1, (elements, points, 3).
    hessian: Array  #: Second derivatives of the tip's height in 1/m, (elements, points, 2, 2).

    @property
    def touching(self) -> Mask:
        """Where the film touches, (elements, points)."""
        return self.value > 0.0


class RigidTip(DeadPressure):
    """A rigid tip that presses with a force, or down to a depth.

    Under a force the depth is a dof of its own, the last component of a node beside the film.
    """

    edge_share = 0.5
    on_patch = False

    def __init__(self, touch: LoadSpec, space: Space, part: SymmetrySector = WHOLE_FILM) -> None:
        super().__init__(touch, space, part)
        assert touch.contact is not None
        self.tip = touch.tip
        #: Depth of the tip's lowest point in m where given; otherwise the force decides it.
        self.depth: float | None = touch.load.depth
        #: Overlap in the middle of the contact over the depth, about.
        self.softness: float = touch.contact.softness
        self.components[2] = touch.contact.force
        # a mirror image presses where the tip does not
        if touch.auxiliary_node is not None and len(self.patch):
            self.auxiliary_dofs = 3 * (space.basis.N + touch.auxiliary_node) + np.array([2])
        self._last: tuple[Array, Overlap] | None = None

    def with_components(self, components: Array) -> Self:
        """The same tip with another force in N, (3,). A given depth grows as its third root."""
        other = super().with_components(components)
        if self.depth is not None:
            other.depth = self.depth * float(np.cbrt(components[2] / self.components[2]))
        other._last = None
        return other

    def relaxed(self) -> DeadPressure:
        """A tip into which the film reaches farther; at last a pressure on the guessed contact."""
        if self.softness > 0.1 * SOFTEST:
            return DeadPressure(self.spec, self.space, self.part).with_components(self.components)
        other = copy(self)
        other.softness, other._last = SOFTER * self.softness, None
        return other

    def complete_initial_guess(self, x: Array) -> Array:
        """The tip at the depth at which its overlap with a film balances the force."""
        if not len(self.auxiliary_dofs):
            return self._met(x)
        if x[self.auxiliary_dofs[0]]:
            return x
        risen = -self._overlap(x).value
        order = np.argsort(risen, axis=None)[: np.isfinite(risen).sum()]
        heights, weights = risen.ravel()[order], self.space.weights.ravel()[order]
        areas, moments = np.cumsum(weights), np.cumsum(weights * heights)
        needed = self._own_force / self.penalty
        last = np.searchsorted(areas * heights - moments, needed, side="right") - 1
        x = x.copy()
        x[self.auxiliary_dofs] = (needed + moments[last]) / areas[last]
        return x

    def _met(self, x: Array) -> Array:
        """The film, less deflected where it is below a tip of a given depth."""
        overlap = self._overlap(x)
        at = np.unravel_index(overlap.value.argmax(), overlap.value.shape)
        if not np.isfinite(overlap.depth) or overlap.touching[at]:
            return x
        lifted = self.softness * overlap.depth - overlap.value[at]
        return x * max(1.0 - lifted / self.displaced(x)[at][2], 0.0)

    @property
    def penalty(self) -> float:
        """Traction over overlap in Pa/m."""
        assert self.spec.contact is not None
        return self.spec.contact.stiffness / self.softness

    # --- the overlap

    def overlap(self, state: State) -> Overlap:
        """The overlap of a displacement."""
        if self._last is None or self._last[0] is not state.dofs:
            self._last = state.dofs, self._overlap(state.dofs)
        return self._last[1]

    def _overlap(self, x: Array) -> Overlap:
        places, frame = self.displaced(x), self.part.frame
        shape = places.shape[:2]
        height = self.tip.height(places[..., :2].reshape(-1, 2) @ frame)
        depth = -np.inf
        if len(self.patch):
            depth = (
                float(x[self.auxiliary_dofs][0]) if len(self.auxiliary_dofs) else self.depth or 0.0
            )
        rates = -np.ones((*shape, 3))
        rates[..., :2] = -(height.slope @ frame.T).reshape(*shape, 2)
        hessian = (frame @ height.hessian @ frame.T).reshape(*shape, 2, 2)
        value = depth - height.value.reshape(shape) - places[..., 2]
        if self.tip.face is not None:  # film without a load bears no pressure under a flat face
            value[height.value.reshape(shape) == 0.0] = -np.inf
        return Overlap(depth, value, rates, hessian)

    @property
    def _own_force(self) -> float:
        """The force in N on the part of the film."""
        if not len(self.patch):
            return 0.0
        weights = self.space.weights[self.patch]
        return float(self.components[2] * weights.sum() / self.area(weights))

    def displaced(self, x: Array) -> Array:
        """The quadrature points displaced by the dofs `x`, (elements, points, 3) in m."""
        places = np.matmul(self.space.values, x.reshape(-1, 3)[self.space.nodes])
        places[..., :2] += self.space.places
        return places

    # --- the term

    def tractions(self, state: State) -> Array:
        """Tractions along z times weights in N, (elements, points)."""
        return self.penalty * np.maximum(self.overlap(state).value, 0.0) * self.space.weights

    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,): on the film, and on the tip."""
        elements, traction = self._pressed(state)
        along = -self.overlap(state).rates[elements] * traction[..., None]
        forces = self._spread_out(along, elements)
        forces[self.auxiliary_dofs] = self._own_force - traction.sum()
        return forces

    def _spread_out(self, integrand: Array, elements: Indices) -> Array:
        """Forces in N, (dofs,), of tractions times weights (elements, points, 3)."""
        values = self.space.values[elements]
        return self.space.sum(np.matmul(values.swapaxes(1, 2), integrand), elements)

    def _pressed(self, state: State) -> tuple[Indices, Array]:
        """Elements that touch, (n,), and their tractions times weights, (n, points)."""
        traction = self.tractions(state)
        elements = np.flatnonzero(traction.any(axis=1))
        return elements, traction[elements]

    def energy(self, state: State) -> float:
        """Energy in J of the overlap; less the work of a given force."""
        overlap = self.overlap(state)
        energy = 0.5 * float((self.tractions(state) * np.maximum(overlap.value, 0.0)).sum())
        return energy - self._own_force * float(state.dofs[self.auxiliary_dofs].sum())

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        elements, traction = self._pressed(state)
        stiffness = self._stiffness(state, elements, traction)
        values = self.space.values[elements]
        local = np.einsum("epa,epij,epb->eaibj", values, stiffness, values, optimize=True)
        dofs = 3 * values.shape[2]
        return elements, local.reshape(len(elements), dofs, dofs)

    def _stiffness(self, state: State, elements: Indices, traction: Array) -> Array:
        """Derivative of the negative tractions by the displacement at a depth, times weights in
        N/m, (n, points, 3, 3)."""
        overlap = self.overlap(state)
        touching = self.penalty * self.space.weights[elements] * overlap.touching[elements]
        rates = overlap.rates[elements]
        stiffness = touching[..., None, None] * rates[..., :, None] * rates[..., None, :]
        stiffness[..., :2, :2] -= traction[..., None, None] * overlap.hessian[elements]
        return stiffness

    def coupled_tangent(self, assembly: Assembly, state: State) -> sp.csc_matrix | None:
        """The rows and columns of the depth."""
        if not len(self.auxiliary_dofs):
            return None
        by_depth, stiffness = self.by_depth(state)
        (film,), depth = np.nonzero(by_depth), self.auxiliary_dofs[0]
        here = np.full(len(film), depth)
        rows, columns = np.concatenate([[depth], film, here]), np.concatenate([[depth], here, film])
        values = np.concatenate([[stiffness], -by_depth[film], -by_depth[film]])
        shape = (self.space.dof_count, self.space.dof_count)
        return assembly.of_dofs(sp.csr_matrix((values, (rows, columns)), shape))

    def by_depth(self, state: State) -> tuple[Array, float]:
        """Derivatives by the depth of the film's forces (dofs,), and of their sum along z, in
        N/m."""
        overlap = self.overlap(state)
        touching = self.penalty * self.space.weights * overlap.touching
        elements = np.flatnonzero(touching.any(axis=1))
        along = -overlap.rates[elements] * touching[elements][..., None]
        return self._spread_out(along, elements), float(touching.sum())

    def element_action(self, state: State, x: Array) -> Array:
        """The tangent at a depth times the dofs `x`, (elements, dofs of an element), in N."""
        actions = np.zeros(self.space.element_dofs.shape)
        elements, traction = self._pressed(state)
        values = self.space.values[elements]
        moves = np.matmul(values, x.reshape(-1, 3)[self.space.nodes[elements]])
        stiff = np.matmul(self._stiffness(state, elements, traction), moves[..., None])[..., 0]
        actions[elements] = np.matmul(values.swapaxes(1, 2), stiff).reshape(len(elements), -1)
        return actions

    def action(self, state: State, x: Array) -> Array:
        """The tangent times the dofs `x`, (dofs,)."""
        forces = self.space.sum(self.element_action(state, x))
        if len(self.auxiliary_dofs):
            by_depth, stiffness = self.by_depth(state)
            sinks = x[self.auxiliary_dofs]
            forces -= by_depth * sinks
            forces[self.auxiliary_dofs] += stiffness * sinks - by_depth @ x
        return forces

    def diagonal(self, state: State) -> Array:
        """Diagonal of the tangent, (dofs,) in N/m."""
        elements, traction = self._pressed(state)
        stiffness = np.einsum("epii->epi", self._stiffness(state, elements, traction))
        values = self.space.values[elements]
        diagonal = self.space.sum(np.matmul(values.swapaxes(1, 2) ** 2, stiffness), elements)
        diagonal[self.auxiliary_dofs] = self.by_depth(state)[1]
        return diagonal

    def energy_along(self, state: State, x: Array) -> Array:
        """Coefficients (5,) of the energy along `x` while the same points touch."""
        slope, curvature = self.residual(state) @ x, self.action(state, x) @ x
        return np.array([self.energy(state), slope, 0.5 * curvature, 0.0, 0.0])

    # --- what the tip feels

    def pressed(self, state: State, film_forces: Array) -> tuple[Indices, Array]:
        elements, traction = self._pressed(state)
        return elements, traction.sum(axis=1)

    def reach(self, state: State) -> float:
        touching = self.space.places[self.overlap(state).touching]
        return float(np.linalg.norm(touching, axis=1).max(initial=0.0))

    def pressure_on(self, state: State, thickness: float) -> Array:
        """Pressure in Pa on the deformed film where it touches, and 0, (elements, points).

        The balance of a membrane across the tip's surface, p = h S : Fᵀ H F / √(1 + slope²) per
        reference area with the Hessian H of the tip's height, is smoother than the penalty's
        tractions.
        """
        overlap, F = self.overlap(state), state.deformation_gradient
        curved = np.einsum("epia,epij,epjb->epab", F[..., :2, :], overlap.hessian, F[..., :2, :])
        S11, S22, S12 = np.moveaxis(state.stress, -1, 0)
        normal = S11 * curved[..., 0, 0] + S22 * curved[..., 1, 1] + 2.0 * S12 * curved[..., 0, 1]
        steep = (overlap.rates**2).sum(axis=-1)
        area = np.linalg.norm(np.cross(F[..., 0], F[..., 1]), axis=-1)
        return np.where(overlap.touching, thickness * normal / np.sqrt(steep) / area, 0.0)
