"""Equilibrium: the sum of the film's energy terms, on the unknowns that a scene leaves free.

The clamped rim fixes its dofs; a term may fix or share others, as a rigid punch does. Both are a
map from dofs to unknowns, so a constraint adds no equation and the tangent stays as sparse and as
symmetric as the film's. The equations of a part of the film are those of its mirror images too:
nothing crosses a mirror line.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, reduce
from operator import add
from typing import Any

import numpy as np
import scipy.sparse as sp
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.film.electric.raised import Raised
from pvdf_fem.film.loads.contact import Contact
from pvdf_fem.film.loads.contact_edge import Edge
from pvdf_fem.film.loads.posed import NOTHING, Posed
from pvdf_fem.film.loads.pressure import DeadPressure
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.models import film_model
from pvdf_fem.film.plate import Plate
from pvdf_fem.film.space import ELEMENTS, Space, shape_values
from pvdf_fem.film.term import State, Term
from pvdf_fem.mesh.gmsh_mesh import MIRRORS, RIM
from pvdf_fem.mesh.symmetry import WHOLE, MirroredPart
from pvdf_fem.scene.scene import Scene

#: Marks a dof without an unknown.
FIXED = -1
#: Values of shape functions below this, at nodes of a richer element, are rounding.
ROUNDING = 1e-13
#: Forces of the flat film's own stress below this part of those at the rim are rounding.
BALANCED = 1e-12


class Equilibrium:
    """The nonlinear equations of a scene on a mesh of it, or of a part: stationary energy."""

    def __init__(
        self,
        scene: Scene,
        mesh: MeshTri2,
        order: int = 2,
        part: MirroredPart = WHOLE,
        posed: Posed = NOTHING,
    ) -> None:
        self.scene, self.film, self.part, self.posed = scene, scene.film, part, posed
        self.model = film_model(scene)
        self.space = Space(mesh, order)
        #: The membrane, first, the loads, coupling and, where the film bends, the plate.
        self.terms: list[Term] = self.model.terms(self.space, part, posed)
        rim = self.space.basis.get_dofs(RIM).all()
        self.rim_dofs = (3 * rim[:, None] + np.arange(3)).ravel()
        self.unknowns = self._unknowns()

    def with_(self, **changes: Any) -> Equilibrium:
        """The equations of another `scene`, `mesh`, `order`, `part` or `posed`, set up anew."""
        own = {"scene": self.scene, "mesh": self.space.mesh, "order": self.space.order}
        return Equilibrium(**{**own, "part": self.part, "posed": self.posed, **changes})

    def _unknowns(self) -> Unknowns:
        """The unknowns of displacements that are even about the mirror lines."""
        fixed = [self.rim_dofs, *(term.fixed_dofs for term in self.terms)]
        shared = [group for term in self.terms for group in term.shared_dofs]
        for axis in self.part.mirrored:
            fixed.append(3 * self.space.basis.get_dofs(MIRRORS[axis]).all() + axis)
        modes = [mode for term in self.terms for mode in term.modes]
        return Unknowns(self.space.dof_count, np.concatenate(fixed), shared, modes)

    def _term(self, kind: type) -> Term | None:
        return next((term for term in self.terms if isinstance(term, kind)), None)

    @property
    def membrane(self) -> Membrane:
        """The membrane term."""
        term = self._term(Membrane)
        assert isinstance(term, Membrane)
        return term

    @property
    def loads(self) -> list[DeadPressure]:
        """The loads of the probes. Other terms may apply forces, too."""
        return [term for term in self.terms if isinstance(term, DeadPressure)]

    @property
    def force(self) -> float:
        """Sum of the sizes of the terms' forces, N."""
        return sum(term.force for term in self.terms)

    @property
    def plate(self) -> Plate | None:
        """The bending term, if there is one."""
        term = self._term(Plate)
        assert term is None or isinstance(term, Plate)
        return term

    @cached_property
    def contacts(self) -> list[Contact]:
        """The loads that are tips on which the film rests."""
        return [term for term in self.terms if isinstance(term, Contact)]

    def with_terms(self, terms: Sequence[Term]) -> Equilibrium:
        """The same equations with other terms, which constrain the same dofs."""
        other = copy(self)
        for worked_out in ("contacts", "_tip_forces", "uneven_forces"):
            other.__dict__.pop(worked_out, None)
        other.terms = list(terms)
        return other

    def under(self, factor: float) -> Equilibrium:
        """The same film under its loads times a factor."""
        return self.with_terms([term.scaled(factor) for term in self.terms])

    @property
    def conservative(self) -> bool:
        """Whether an energy exists."""
        return all(term.conservative for term in self.terms)

    @cached_property
    def assembly(self) -> Assembly:
        """Where entries of elements go, worked out at first use."""
        return Assembly(self.space, self.unknowns)

    def dofs(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return reduce(lambda x, contact: contact.rested(x), self.contacts, self.unknowns.expand(q))

    def restrict(self, x: Array) -> Array:
        """Unknowns of the dofs `x`, averaged where dofs share one."""
        return self.unknowns.restrict(reduce(lambda x, c: c.lifted(x), self.contacts, x))

    def state(self, q: Array) -> State:
        """Fields of the unknowns `q`."""
        state = self.membrane.state(self.dofs(q))
        if not self.model.floating or self.model.wrinkles:
            return state  # the residual of wrinkles is of the whole stress, which has no voltage
        added = np.zeros((len(state.stress), 1, 3))
        for elements, stress in filter(None, (term.added_stress(state) for term in self.terms)):
            added[elements] += stress
        return replace(state, stress=state.stress + added, added=added)

    def step(self, state: State, step: Array) -> Array:
        """Change of the dofs by a small step of the unknowns from a state."""
        x = self.unknowns.expand(step)
        return reduce(lambda x, contact: contact.pushed(x, state), self.contacts, x)

    def on_unknowns(self, state: State, forces: Array) -> Array:
        """Forces on the unknowns, of forces (dofs, ...) on the film: the transpose of `step`."""
        pulled = reduce(lambda f, contact: contact.pulled(f, state), self.contacts, forces)
        return self.unknowns.expansion.T @ pulled if pulled.ndim > 1 else self.unknowns.fold(pulled)

    def film_forces(self, state: State) -> Array:
        """Internal forces of the film less those of pressures, (dofs,), in N."""
        return reduce(add, (term.residual(state) for term in self.terms))

    def residual(self, state: State) -> Array:
        """Internal minus external forces of the unknowns, N."""
        return self._balanced(state, self.film_forces(state)) - self._tip_forces

    def _balanced(self, state: State, forces: Array) -> Array:
        """Forces (dofs,) on the unknowns, less what friction of tips bears of them."""
        return self.unknowns.fold(reduce(lambda f, c: c.balanced(f, state), self.contacts, forces))

    @cached_property
    def _tip_forces(self) -> Array:
        """The forces that press on unknown depths of tips, (unknowns,)."""
        forces = np.zeros(self.unknowns.count)
        for contact in self.contacts:
            for axis, force in enumerate(contact.components[: 2 + (contact.depth is None)]):
                if force:
                    forces[self.unknowns.of_dof[3 * contact.nodes[0] + axis]] = force
        return forces

    def tangent(self, state: State) -> sp.csc_matrix | Raised:
        """Derivative of `residual` in N/m."""
        columns = [c for term in self.terms if (c := term.tangent_column(state)) is not None]
        sparse = self.sparse_tangent(state)
        places = self.on_unknowns(state, np.transpose(columns)) if columns else None
        return sparse if places is None else Raised(sparse, places)

    def sparse_tangent(self, state: State) -> sp.csc_matrix:
        """The tangent without the columns of terms that couple many elements."""
        by_element = (term.element_tangent(state) for term in self.terms)
        # the membrane, which has all elements, is the first term
        (_, matrices), *others = [local for local in by_element if local is not None]
        for elements, values in others:
            matrices[elements] += values
        for contact in self.contacts:
            matrices = contact.pulled_matrices(matrices, self.film_forces(state), state)
        coupled = (term.coupled_tangent(self.assembly) for term in self.terms)
        return reduce(add, (c for c in coupled if c is not None), self.assembly.matrix(matrices))

    def element_action(self, state: State, step: Array) -> Array:
        """Forces in N of elements, (elements, dofs of an element), that a small step makes.

        They are symmetric: the tangent of a load that follows the film is left out.
        """
        x = self.step(state, step)
        actions = (term.element_action(state, x) for term in self.terms)
        return reduce(add, (action for action in actions if action is not None))

    def action(self, state: State, step: Array) -> Array:
        """The tangent, less that of a load that follows, times a step, (unknowns,)."""
        x = self.step(state, step)
        actions = (term.action(state, x) for term in self.terms)
        forces = reduce(add, (force for force in actions if force is not None))
        turned = np.zeros_like(x)
        for contact in self.contacts:
            turned = turned + contact.turned(self.film_forces(state), state, x)
        return self._balanced(state, forces) + self.unknowns.fold(turned)

    def diagonal(self, state: State) -> Array:
        """Diagonal of the tangent without the coupling of shared dofs, (unknowns,)."""
        diagonals = (term.diagonal(state) for term in self.terms)
        return self.unknowns.fold_diagonal(reduce(add, (d for d in diagonals if d is not None)))

    def energy_along(self, state: State, step: Array, slope: float) -> Array:
        """Potential energy in J at q + s step, coefficients (5,) of 1, s, ... s^4.

        `slope` is residual . step. Forces that follow the film are held as they are.
        """
        x = self.step(state, step)
        energy: Array = reduce(add, (term.along(state, x) for term in self.terms))
        energy[1] = slope
        return energy

    def load_forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""
        forces = (term.forces(state) for term in self.terms)
        return sum((f for f in forces if f is not None), np.zeros(self.space.dof_count))

    def external_forces(self, state: State) -> Array:
        """External forces on the unknowns, N."""
        return self.on_unknowns(state, self.load_forces(state)) + self._tip_forces

    @cached_property
    def uneven_forces(self) -> Array:
        """What moves the flat film besides loads, (unknowns,), in N: its own stress, where that is
        uneven. A film in balance to rounding has none."""
        if all(term.rests_flat for term in self.terms):
            return np.zeros(self.unknowns.count)
        flat = self.membrane.state(np.zeros(self.space.dof_count))
        internal = self.film_forces(flat) + self.load_forces(flat)
        forces = -self.on_unknowns(flat, internal)
        moves = np.abs(forces).max(initial=0.0) > BALANCED * np.abs(internal).max()
        return forces if moves else np.zeros(self.unknowns.count)

    @property
    def flat_forces(self) -> Array:
        """What moves the flat film, (unknowns,), in N: its residual with a minus sign."""
        flat = self.membrane.state(np.zeros(self.space.dof_count))
        return self.external_forces(flat) + self.uneven_forces

    @property
    def is_flat(self) -> bool:
        """Whether the flat film is in balance, and no tip deflects it."""
        return not (self.force or self.contacts or self.flat_forces.any())

    def work(self, state: State, q: Array) -> float:
        """Work in J of the external forces, held as they are at `state`, along `q`; and of those
        that move the flat film."""
        work = float((self.external_forces(state) + self.uneven_forces) @ q)
        given = [contact for contact in self.contacts if contact.depth is not None]
        forces = self.film_forces(state) if given else np.empty(0)
        return work + sum((c.depth or 0.0) * float(forces[c.raised].sum()) for c in given)

    def edges(self, state: State) -> tuple[Edge, ...]:
        """The edges of the contacts with tips."""
        forces = self.film_forces(state)
        return tuple(contact.edge(self.membrane, state, forces) for contact in self.contacts)

    def overlap(self, x: Array, edges: Sequence[Edge]) -> float:
        """Largest overlap of film and a tip where their contact ends, over the tip's depth."""
        pairs = zip(self.contacts, edges, strict=True)
        return max(edge.penetration / contact.depth_of(x) for contact, edge in pairs)

    def pressed(self) -> Equilibrium:
        """The same film under pressures in place of the tips."""
        terms = [t.as_pressure(self.film) if t in self.contacts else t for t in self.terms]
        other = self.with_terms(terms)
        other.__dict__.pop("assembly", None)
        other.unknowns = other._unknowns()
        return other

    def with_lagged_friction(self) -> Equilibrium:
        """The same film, with a tangent in which friction keeps its direction."""
        lagged = [t.lagged() if isinstance(t, Contact) else t for t in self.terms]
        return self.with_terms(lagged)

    def rim_reaction(self, state: State) -> Array:
        """Force in N, (3,), by which the rim, and guides of punches, hold the film."""
        held = self.unknowns.of_dof == FIXED
        for contact in self.contacts:
            held[contact.touched] = False
        return self._of_all_images(np.where(held, self.film_forces(state), 0.0))

    def applied_force(self, state: State) -> Array:
        """Force in N, (3,), by which the probes press."""
        touching, forces = self.load_forces(state), self.film_forces(state)
        for contact in self.contacts:
            touching[contact.touched] += forces[contact.touched]
        return self._of_all_images(touching)

    def imbalance(self, state: State) -> float:
        """What rim and probes lack of balance in N, along the applied force."""
        applied = self.applied_force(state)
        size = float(np.linalg.norm(applied))
        return abs(float((self.rim_reaction(state) + applied) @ applied)) / size if size else 0.0

    def _of_all_images(self, forces: Array) -> Array:
        """Sum in N, (3,), of forces (dofs,) and their mirror images, in the scene's axes."""
        total = forces.reshape(-1, 3).sum(axis=0)
        total *= [*self.part.signs.sum(axis=0), len(self.part.signs)]
        return np.append(total[:2] @ self.part.frame, total[2])


class Unknowns:
    """The map from dofs to unknowns.

    `fixed` dofs are zero. Each group of `shared` ones has one common value, the last unknowns; a
    group is zero if one of its dofs is. `of_dof` has the unknown of each dof. Only dofs of `modes`,
    which are sums of functions, have `places` of their own there, behind those of all others: the
    matrix `sums` takes unknowns to places, and `means` takes them back.
    """

    def __init__(
        self,
        dof_count: int,
        fixed: Indices,
        shared: Sequence[Indices],
        modes: Sequence[tuple[Indices, Array]] = (),
    ) -> None:
        free = np.ones(dof_count, dtype=bool)
        free[fixed] = False
        moving = [group for group in shared if len(group) and free[group].all()]
        for group in (*shared, *(dofs for dofs, _ in modes)):
            free[group] = False
        self.of_dof = np.full(dof_count, FIXED, dtype=np.int64)
        self.places = int(free.sum())
        self.of_dof[free] = np.arange(self.places)
        for group in moving:
            self.of_dof[group] = self.places
            self.places += 1
        self.count, alone = self.places, sp.identity(self.places)
        self.sums: sp.csr_matrix | None = None
        self.means: sp.csr_matrix | None = None
        for dofs, functions in modes:
            self.of_dof[dofs] = self.places + np.arange(len(dofs))
            self.places, self.count = self.places + len(dofs), self.count + functions.shape[1]
        if modes:
            self.sums = sp.block_diag([alone, *(f for _, f in modes)], "csr")
            self.means = sp.block_diag([alone, *(np.linalg.pinv(f) for _, f in modes)], "csr")

    @cached_property
    def expansion(self) -> sp.csr_matrix:
        """Matrix form of `expand`; its transpose sums forces on dofs."""
        dofs = np.flatnonzero(self.of_dof >= 0)
        shape = (len(self.of_dof), self.places)
        matrix = sp.csr_matrix((np.ones(len(dofs)), (dofs, self.of_dof[dofs])), shape=shape)
        return matrix if self.sums is None else matrix @ self.sums

    def fold(self, forces: Array) -> Array:
        """Forces on the unknowns of forces on the dofs; those on fixed dofs drop out."""
        total = np.bincount(self.of_dof + 1, forces, self.places + 1)[1:]
        return np.asarray(total if self.sums is None else self.sums.T @ total, dtype=np.float64)

    def fold_diagonal(self, diagonal: Array) -> Array:
        """A diagonal matrix of the dofs as that of the unknowns, without its coupling."""
        total = np.bincount(self.of_dof + 1, diagonal, self.places + 1)[1:]
        return np.asarray(total if self.sums is None else self.sums.power(2).T @ total)

    def expand(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return np.append(q if self.sums is None else self.sums @ q, 0.0)[self.of_dof]

    def restrict(self, x: Array) -> Array:
        """Unknowns of the dofs `x`, averaged where dofs share one."""
        total = np.bincount(self.of_dof + 1, x, self.places + 1)
        mean = total[1:] / np.bincount(self.of_dof + 1, minlength=self.places + 1)[1:]
        return np.asarray(mean if self.means is None else self.means @ mean)

    def deflections(self) -> Mask:
        """Mask (unknowns,) of those that are deflections, not in-plane displacements."""
        mask = np.zeros(self.places + 1, dtype=bool)
        mask[self.of_dof[2::3]] = True
        return mask[:-1] if self.sums is None else self.sums.T @ mask[:-1] != 0.0


class Assembly:
    """Sums matrices of elements, or of deflections, into matrices of unknowns."""

    def __init__(self, space: Space, unknowns: Unknowns) -> None:
        self.unknowns, self.count = unknowns, unknowns.places
        local = unknowns.of_dof[space.element_dofs]
        # Fixed dofs go to a last place, which is dropped.
        self._places = np.where(local == FIXED, self.count, local).astype(np.int32)

    def matrix(self, element_matrices: Array) -> sp.csc_matrix:
        """Sum of matrices of elements, (unknowns, unknowns)."""
        places = self._places
        rows = np.broadcast_to(places[:, :, None], element_matrices.shape)
        columns = np.broadcast_to(places[:, None, :], element_matrices.shape)
        entries = element_matrices.ravel(), (rows.ravel(), columns.ravel())
        total = sp.csc_matrix(entries, shape=(self.count + 1, self.count + 1))
        total = total[: self.count, : self.count]
        sums = self.unknowns.sums
        return total if sums is None else (sums.T @ total @ sums).tocsc()

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """The matrix (unknowns, unknowns) of one of the deflections (scalar dofs, scalar dofs)."""
        expansion = self.unknowns.expansion[2::3]
        return (expansion.T @ matrix @ expansion).tocsc()


def prolonged(coarse: Equilibrium, rich: Equilibrium, q: Array) -> Array:
    """The unknowns of `rich` for the displacement that has the unknowns `q` in `coarse`."""
    if not rich.contacts:
        return prolongation(coarse, rich) @ q
    values, nodes, _, _ = _representatives(coarse, rich, np.arange(rich.space.basis.N))
    x = np.einsum("nf,nfc->nc", values, coarse.dofs(q).reshape(-1, 3)[nodes])
    return rich.restrict(x.ravel())


def prolongation(
    coarse: Equilibrium, rich: Equilibrium, state: State | None = None
) -> sp.csr_matrix:
    """Matrix (rich unknowns, coarse unknowns) of the change of `prolonged` by that of `q`.

    It is the same everywhere but on a tip, where it is that at the `state` of `coarse`.
    """
    node, component = np.divmod(_first_places(rich.unknowns.of_dof, rich.unknowns.places), 3)
    values, nodes, matters, ends = _representatives(coarse, rich, node)
    dofs, shape = 3 * nodes + component[:, None], (rich.unknowns.places, coarse.space.dof_count)
    steps = coarse.unknowns.expansion
    for contact in coarse.contacts:
        assert state is not None
        steps = contact.push_matrix(state) @ steps
    matrix = sp.csr_matrix((values[matters], dofs[matters], ends), shape) @ steps
    if rich.unknowns.means is not None:
        matrix = rich.unknowns.means @ matrix
    for fine, contact in zip(rich.contacts, coarse.contacts, strict=True):
        if contact.depth is None:
            depths = rich.unknowns.of_dof[fine.raised[0]], coarse.unknowns.of_dof[contact.raised[0]]
            others = np.arange(rich.unknowns.count) != depths[0]
            one = sp.csr_matrix(([1.0], ([depths[0]], [depths[1]])), matrix.shape)
            matrix = sp.diags(others.astype(float)) @ matrix + one
    return matrix.tocsr()


def _representatives(
    coarse: Equilibrium, rich: Equilibrium, nodes: Indices
) -> tuple[Array, Indices, Mask, Indices]:
    """What makes a function of `coarse` at scalar dofs of `rich`.

    The values (n, functions) and scalar dofs (n, functions) of `coarse` in an element of each,
    which of the values are not zero, and their sums, (n + 1,).
    """
    shapes = shape_values(coarse.space.basis.elem, ELEMENTS[rich.space.order].doflocs.T)
    rich_nodes = rich.space.basis.element_dofs
    element, local = np.divmod(
        _first_places(rich_nodes.T.ravel(), rich.space.basis.N)[nodes], len(rich_nodes)
    )
    matters = np.abs(shapes)[local] > ROUNDING
    ends = np.append(0, np.cumsum(matters.sum(axis=1)))
    return shapes[local], coarse.space.nodes[element], matters, ends


def _first_places(labels: Indices, count: int) -> Indices:
    """Where each of the labels 0 ... count - 1 stands first, (count,); others are negative."""
    place = np.empty(count + 1, dtype=np.int64)
    place[labels[::-1]] = np.arange(len(labels))[::-1]
    return place[:count]
