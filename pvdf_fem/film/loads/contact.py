"""Contact with a rigid tip: inside an edge that the mesh follows the film rests on it.

At a node X that rests on the tip the deflection is w = depth - z(X + u), with the tip's height z
over the displaced point. So it is no unknown: the node's in-plane displacement u, which slides
without friction, and the depth decide it. The tip's force belongs to the depth.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import ALL, Array, Indices, Mask, Selection
from pvdf_fem.film.loads.contact_edge import Edge, EdgeFacets
from pvdf_fem.film.loads.contact_guess import face_patch, guessed_force
from pvdf_fem.film.loads.coulomb import LIKE_STICKING, Coulomb
from pvdf_fem.film.loads.posed import PosedProbe
from pvdf_fem.film.loads.pressure import DeadPressure, shared
from pvdf_fem.film.membrane import IDENTITY, Membrane, strain_of
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State
from pvdf_fem.mesh.symmetry import WHOLE, MirroredPart
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import Height, Tip


class Contact(DeadPressure):
    """A rigid tip on which the film rests inside the mesh's patch of the probe."""

    edge_share = 0.5

    def __init__(self, touch: PosedProbe, space: Space, part: MirroredPart = WHOLE) -> None:
        super().__init__(touch, space, part)
        self.tip: Tip = touch.tip
        #: Of the tip's lowest point in m where it is given; otherwise the force decides it.
        self.depth: float | None = touch.load.depth
        self._last: tuple[Array, Height] | None = None
        #: Scalar dofs that rest on the tip, (n,).
        self.nodes: Indices = np.unique(space.basis.element_dofs[:, self.patch])
        self.raised: Indices = 3 * self.nodes + 2
        self.borne: Indices = (3 * self.nodes[:, None] + np.arange(3)).ravel()
        self.places: Array = space.basis.doflocs.T[self.nodes]
        moving = self.depth is None, touch.load.tangential_N is not None
        known = None if touch.held is None else touch.held(self.places)
        sticks = touch.load.friction == "stuck"
        self.friction = 0.0 if sticks else float(touch.load.friction)
        self._held: Array | None = known if sticks else None
        self._before = known if self.friction and known is not None else np.zeros(2)
        sideways = () if self._held is None else (self.raised - 2, self.raised - 1)
        self.shared_dofs = sideways * moving[1] + (self.raised,) * moving[0]
        fixed = sideways * (not moving[1]) + (self.raised,) * (not moving[0])
        self.fixed_dofs = np.concatenate([self.fixed_dofs, *fixed])

    def loose(self, film: Film) -> DeadPressure:
        """A uniform pressure on the same patch, about as large."""
        pressure = DeadPressure(self.touch, self.space, self.part)
        return pressure.with_force(guessed_force(self.touch.load, film))

    @property
    def seat(self) -> Self:
        """The contact itself."""
        return self

    @property
    def driven(self) -> Array:
        """The tip's force, on the dofs that move with it as far as they have unknowns."""
        forces, first = np.zeros(self.space.dof_count), 3 * self.nodes[0]
        forces[first : first + 3] = self.components
        return forces

    @property
    def lead(self) -> int | None:
        """A dof whose unknown is the depth."""
        return int(self.raised[0]) if self.depth is None else None

    def raised_work(self, forces: Array) -> float:
        """Work in J of the film's forces on a tip of given depth."""
        return (self.depth or 0.0) * float(forces[self.raised].sum())

    def depth_of(self, x: Array) -> float:
        """The tip's depth in m, of the film's dofs."""
        return float(self.lifted(x)[self.raised[0]]) if self.depth is None else self.depth

    def forces(self, state: State) -> Array:
        """None on the dofs: the force is on the depth."""
        return np.zeros(self.space.dof_count)

    def pressed(self, film_forces: Array) -> tuple[Selection, Array]:
        return self.patch, shared(self.space, self.patch, film_forces)

    # --- the map from the unknowns' dofs, whose deflections here are the depth, to the film's

    def face(self, x: Array) -> dict[str, Outline]:
        """The points of the film that lie on the edge of the flat face, by the name of a patch."""
        if self.tip.face is None:
            return {}
        points = np.array(self.tip.face.shape.exterior.coords)[:-1]
        moved = self.space.interpolation(points.T) @ x.reshape(-1, 3)[:, :2]
        return {face_patch(self.touch): self.tip.fitted(points - moved)}

    def rested(self, x: Array) -> Array:
        """The film's dofs."""
        rows = x.reshape(-1, 3)
        if self._held is not None:
            rows[self.nodes, :2] += self._held
        rows[self.nodes, 2] += (self.depth or 0.0) - self._height(rows).value
        return x

    def lifted(self, x: Array) -> Array:
        """The inverse of `rested`."""
        rows = x.reshape(-1, 3).copy()
        rows[self.nodes, 2] += self._height(rows).value - (self.depth or 0.0)
        if self._held is not None:
            rows[self.nodes, :2] -= self._held
        return rows.ravel()

    def _height(self, rows: Array) -> Height:
        held = self._held
        return self.tip.height(self.places + (rows[self.nodes, :2] if held is None else held))

    def pushed(self, x: Array, state: State) -> Array:
        """The film's small change that a change `x` of the unknowns' dofs makes, (dofs,)."""
        rows, slope = x.reshape(-1, 3), self._at(state).slope
        rows[self.nodes, 2] -= (slope * rows[self.nodes, :2]).sum(axis=1)
        return x

    def push_matrix(self, state: State) -> sp.csr_matrix:
        """`pushed` as a matrix (dofs, dofs)."""
        slope, w = self._at(state).slope, self.raised
        columns = np.concatenate([w - 2, w - 1])
        entries = -slope.T.ravel(), (np.tile(w, 2), columns)
        count = self.space.dof_count
        return sp.identity(count, format="csr") + sp.csr_matrix(entries, (count, count))

    def balanced(self, forces: Array, state: State) -> Array:
        """The forces (dofs,) of the film on the unknowns' dofs, less what friction bears of them.

        Without friction that is `pulled`.
        """
        total = forces.reshape(-1, 3).copy()
        rows = self._coulomb.balance(self._at(state), self._way(state))
        total[self.nodes, :2] = np.einsum("nij,nj->ni", rows, total[self.nodes])
        return total.ravel()

    def turned(self, forces: Array, state: State, x: Array) -> Array:
        """Change of the forces (dofs,) as the way that they are balanced changes."""
        result, rows = np.zeros((len(x) // 3, 3)), x.reshape(-1, 3)[self.nodes, :2]
        result[self.nodes, :2] = np.einsum("nij,nj->ni", self._turning(forces, state), rows)
        return result.ravel()

    def _turning(self, forces: Array, state: State) -> Array:
        at, way = self._at(state), self._way(state)
        return self._coulomb.turned(at, way, forces.reshape(-1, 3)[self.nodes])

    def _way(self, state: State) -> Array:
        """How far the nodes have come since the step before, (n, 2) in m."""
        return state.dofs.reshape(-1, 3)[self.nodes, :2] - self._before

    @cached_property
    def _coulomb(self) -> Coulomb:
        """The friction; the film is stretched about as much as a sphere raises it."""
        width = 0.5 * float(np.ptp(self.places, axis=0).max())
        longest = 0.25 * width * (width / self.tip.radius) ** 2
        return Coulomb(self.friction, LIKE_STICKING * longest)

    @property
    def conservative(self) -> bool:  # type: ignore[override]
        """Whether it slides without friction, or not at all."""
        return self.friction == 0.0

    def lagged(self) -> Contact:
        """The same tip, with a tangent in which friction keeps its direction."""
        if not self.friction:
            return self
        other = copy(self)
        other.__dict__["_coulomb"] = replace(self._coulomb, lags=True)
        return other

    def pulled(self, forces: Array, state: State) -> Array:
        """The forces (dofs, ...) of the film on the unknowns' dofs: the transpose of `pushed`."""
        total = forces.copy()
        for axis, slope in enumerate(self._at(state).slope.T):
            down = total[self.raised]
            total[3 * self.nodes + axis] -= (slope * down.T).T
        return total

    def _at(self, state: State) -> Height:
        if self._last is None or self._last[0] is not state.dofs:
            height = self._height(state.dofs.reshape(-1, 3))
            if self._held is not None:  # what sticks does not slide along the tip
                height = Height(height.value, 0.0 * height.slope, 0.0 * height.hessian)
            self._last = state.dofs, height
        return self._last[1]

    def _shift(self, state: State) -> Array:
        """How far the tip has moved sideways with what sticks to it, (2,) in m."""
        moved = state.dofs.reshape(-1, 3)[self.nodes[0], :2]
        return np.zeros(2) if self._held is None else moved - self._held[0]

    def pulled_matrices(self, matrices: Array, forces: Array, state: State) -> Array:
        """Tangents (elements, dofs, dofs) of the film as those of the unknowns' dofs.

        `forces` (dofs,) are the film's at the state: those on the tip turn with its surface.
        """
        height, nodes = self._at(state), self.space.nodes
        slopes, rows = np.zeros((self.space.basis.N, 2)), np.zeros((self.space.basis.N, 2, 3))
        slopes[self.nodes], rows[:, (0, 1), (0, 1)] = height.slope, 1.0
        rows[self.nodes] = self._coulomb.balance(height, self._way(state))
        blocks = matrices.reshape(*nodes.shape, 3, nodes.shape[1], 3)
        touched = np.flatnonzero(self._rests[nodes].any(axis=1))
        local, here = slopes[nodes[touched]], blocks[touched]
        here[:, :, :2] = np.einsum("enij,enjmk->enimk", rows[nodes[touched]], here)
        for axis in (0, 1):
            here[..., axis] -= local[:, None, None, :, axis] * here[..., 2]
        blocks[touched] = here
        element, place = self._first_places
        turning = self._turning(forces, state)
        for i, j in np.ndindex(2, 2):
            np.add.at(blocks, (element, place, i, place, j), turning[:, i, j])
        return blocks.reshape(matrices.shape)

    @cached_property
    def _rests(self) -> Mask:
        """Which scalar dofs rest on the tip."""
        rests = np.zeros(self.space.basis.N, dtype=bool)
        rests[self.nodes] = True
        return rests

    @cached_property
    def _first_places(self) -> tuple[Indices, Indices]:
        """An element of the patch that has each node, and the node's place in it."""
        nodes = self.space.nodes[self.patch]
        _, first = np.unique(nodes, return_index=True)
        element, place = np.divmod(first, nodes.shape[1])
        return self.patch[element], place

    # --- what the tip feels

    def traction(self, state: State, thickness: float) -> tuple[Array, Array]:
        """Vertical traction and pressure on the deformed film in Pa, (patch elements, points).

        The balance of a membrane across its surface: p = h S : F^T H F / sqrt(1 + slope^2) per
        reference area, with the tip's Hessian H.
        """
        moved, _ = self._moved(state, self.patch)
        height = self.tip.height(moved.reshape(-1, 2) - self._shift(state))
        F = state.deformation_gradient[self.patch]
        steep = 1.0 + (height.slope**2).sum(axis=-1).reshape(F.shape[:2])
        normal = self._bent(F, state.stress[self.patch], height.hessian.reshape(*F.shape[:2], 2, 2))
        area = np.linalg.norm(np.cross(F[..., 0], F[..., 1]), axis=-1)
        normal = thickness * normal
        return normal / steep, normal / np.sqrt(steep) / area

    def overlap(self, state: State) -> float:
        """How far the film reaches into the tip in m, at the worst of all quadrature points."""
        return self._deepest(*self._moved(state, ALL), state)

    def penetration(self, state: State) -> float:
        """How far a node of the film lies in the tip in m: nodes in the contact rest on it."""
        rows = state.dofs.reshape(-1, 3)
        return self._deepest(self.space.basis.doflocs.T + rows[:, :2], rows[:, 2], state)

    def _deepest(self, moved: Array, deflection: Array, state: State) -> float:
        shifted = moved.reshape(-1, 2) - self._shift(state)
        height = self.tip.height(shifted).value.reshape(deflection.shape)
        return max(float((self.depth_of(state.dofs) - height - deflection).max()), 0.0)

    def _moved(self, state: State, elements: Selection) -> tuple[Array, Array]:
        """Displaced quadrature points (elements, points, 2), and their deflections, in m."""
        rows = state.dofs.reshape(-1, 3)[self.space.nodes[elements]]
        displacement = np.matmul(self.space.values[elements], rows)
        return self.space.places[elements] + displacement[..., :2], displacement[..., 2]

    @staticmethod
    def _bent(F: Array, stress: Array, hessian: Array) -> Array:
        """S : F^T H F in Pa/m, (...)."""
        curved = np.einsum("...ia,...ij,...jb->...ab", F[..., :2, :], hessian, F[..., :2, :])
        s11, s22, s12 = (stress[..., i] for i in range(3))
        return s11 * curved[..., 0, 0] + s22 * curved[..., 1, 1] + 2.0 * s12 * curved[..., 0, 1]

    def edge(self, membrane: Membrane, state: State, forces: Array) -> Edge:
        """The edge of the contact in a displacement, and where it should be."""
        facets = self._facets
        rows = state.dofs.reshape(-1, 3)[facets.nodes]
        place, gradient = facets.values(rows), facets.gradient(rows)
        place[:, :2] -= self._shift(state)
        height = self.tip.height(facets.points + place[:, :2])
        F = gradient + IDENTITY
        leaving = np.einsum("nca,na->nc", F, facets.normals)
        kinks = leaving[:, 2] + (height.slope * leaving[:, :2]).sum(axis=1)
        stress = membrane.resultant_in(strain_of(gradient), facets.elements)
        if state.added is not None:
            stress += state.added[facets.elements, 0]
        (a, b), (s11, s22, s12) = facets.normals.T, stress.T
        across = a * a * s11 + b * b * s22 + 2.0 * a * b * s12
        jumps = self._bent(F, stress, height.hessian) / across
        jumps = np.where(jumps > 0.0, jumps, 1.0 / self.tip.radius)  # on the flat face
        widths = self.tip.distances(facets.points + place[:, :2]).value
        tension = membrane.film.thickness * across
        traction, _ = self.traction(state, membrane.film.thickness)
        slope = self._height(state.dofs.reshape(-1, 3)).slope
        across_tip = np.column_stack([slope, np.ones(len(slope))])
        normal = (forces.reshape(-1, 3)[self.nodes] * across_tip).sum(axis=1)
        normal /= (across_tip**2).sum(axis=1)
        steep = 1.0 + (height.slope**2).sum(axis=1)  # a kink has a line force N e / steep along z
        moves = self._smooth(traction, normal, facets, tension * jumps / steep)
        kinks = kinks if moves is None else -jumps * moves
        return Edge(self.tip, facets, height, place, gradient, kinks, jumps, widths, tension)

    def _smooth(
        self, traction: Array, forces: Array, facets: EdgeFacets, stiffness: Array
    ) -> Array | None:
        """How far a round edge has to move, from the line force along it.

        The nodes' normal `forces` have that and the traction lacks it. Its moments with harmonic
        functions are far more accurate than kinks at points.
        """
        modes, along = self.tip.modes(self.places), self.tip.modes(facets.points)
        if modes is None or along is None:
            return None
        weighted = (self.space.weights[self.patch] * traction)[..., None]
        local = np.zeros((*self.space.nodes[self.patch].shape, 3))
        local[..., 2] = np.matmul(self.space.values[self.patch].swapaxes(1, 2), weighted)[..., 0]
        spread = self.space.sum(local, self.patch)
        line = (forces - spread[self.raised]) @ modes
        mass = (along.T * (facets.lengths * stiffness)) @ along
        return along @ np.linalg.solve(mass, line)

    @cached_property
    def _facets(self) -> EdgeFacets:
        return EdgeFacets.of(self.space, self.patch)
