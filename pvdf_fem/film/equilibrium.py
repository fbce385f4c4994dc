"""Equilibrium: the sum of the film's energy terms, on the unknowns that a scene leaves free.

The clamped rim fixes its dofs; a term may fix or share others, as a rigid punch does. Both are a
map from dofs to unknowns, so a constraint adds no equation and the tangent stays as sparse and as
symmetric as the film's. The equations of a part of the film are those of its mirror images too:
nothing crosses a mirror line.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property, reduce
from operator import add

import numpy as np
import scipy.sparse as sp
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.film.loads import DeadPressure
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


class Equilibrium:
    """The nonlinear equations of a scene on a mesh: the derivative of its energy vanishes.

    Parameters
    ----------
    scene : Scene
    mesh : MeshTri2
        From `mesh_scene`.
    order : int
        Polynomial order of the displacement.
    part : MirroredPart, optional
        The part of the film that the mesh is of, where that is not all of it.

    Attributes
    ----------
    model : FilmModel
        Membrane, plate or tension field.
    space : Space
    terms : list of Term
        The membrane, first, the load and, where the film bends, the plate.
    unknowns : Unknowns
        The map from dofs to unknowns.
    """

    def __init__(
        self, scene: Scene, mesh: MeshTri2, order: int = 2, part: MirroredPart = WHOLE
    ) -> None:
        self.scene, self.film, self.part = scene, scene.film, part
        self.model = film_model(scene)
        self.space = Space(mesh, order)
        self.terms: list[Term] = self.model.terms(self.space, len(part.signs))
        rim = self.space.basis.get_dofs(RIM).all()
        self.rim_dofs = (3 * rim[:, None] + np.arange(3)).ravel()
        self.unknowns = self._unknowns()

    def _unknowns(self) -> Unknowns:
        """The unknowns of displacements that are even about the mirror lines."""
        fixed = [self.rim_dofs, *(term.fixed_dofs for term in self.terms)]
        shared = np.concatenate([term.shared_dofs for term in self.terms])
        for axis in self.part.mirrored:
            fixed.append(3 * self.space.basis.get_dofs(MIRRORS[axis]).all() + axis)
        return Unknowns(self.space.dof_count, np.concatenate(fixed), shared)

    def _term(self, kind: type) -> Term | None:
        return next((term for term in self.terms if isinstance(term, kind)), None)

    @property
    def membrane(self) -> Membrane:
        """The membrane term."""
        term = self._term(Membrane)
        assert isinstance(term, Membrane)
        return term

    @property
    def load(self) -> DeadPressure:
        """The load of the probe."""
        term = self._term(DeadPressure)
        assert isinstance(term, DeadPressure)
        return term

    @property
    def plate(self) -> Plate | None:
        """The bending term, if there is one."""
        term = self._term(Plate)
        assert term is None or isinstance(term, Plate)
        return term

    def replacing(self, old: Term, new: Term) -> Equilibrium:
        """The same equations with another term, which constrains the same dofs."""
        other = copy(self)
        other.terms = [new if term is old else term for term in self.terms]
        return other

    @property
    def conservative(self) -> bool:
        """Whether an energy exists."""
        return all(term.conservative for term in self.terms)

    @cached_property
    def assembly(self) -> Assembly:
        """Where entries of elements go, worked out at first use."""
        return Assembly(self.space, self.unknowns)

    def state(self, q: Array) -> State:
        """Fields of the unknowns `q`."""
        return self.membrane.state(self.unknowns.expand(q))

    def residual(self, state: State) -> Array:
        """Internal minus external forces of the unknowns, N."""
        return self.unknowns.fold(reduce(add, (term.residual(state) for term in self.terms)))

    def tangent(self, state: State) -> sp.csc_matrix:
        """Derivative of `residual` in N/m."""
        by_element = (term.element_tangent(state) for term in self.terms)
        # the membrane, which has all elements, is the first term
        (_, matrices), *others = [local for local in by_element if local is not None]
        for elements, values in others:
            matrices[elements] += values
        coupled = (term.coupled_tangent(self.assembly) for term in self.terms)
        return reduce(add, (c for c in coupled if c is not None), self.assembly.matrix(matrices))

    def element_action(self, state: State, step: Array) -> Array:
        """Forces in N of elements, (elements, dofs of an element), that a small step makes.

        They are symmetric: the tangent of a load that follows the film is left out.
        """
        x = self.unknowns.expand(step)
        actions = (term.element_action(state, x) for term in self.terms)
        return reduce(add, (action for action in actions if action is not None))

    def action(self, state: State, step: Array) -> Array:
        """The tangent, less that of a load that follows, times a step, (unknowns,)."""
        x = self.unknowns.expand(step)
        actions = (term.action(state, x) for term in self.terms)
        return self.unknowns.fold(reduce(add, (force for force in actions if force is not None)))

    def diagonal(self, state: State) -> Array:
        """Diagonal of the tangent without the coupling of shared dofs, (unknowns,)."""
        diagonals = (term.diagonal(state) for term in self.terms)
        return self.unknowns.fold(reduce(add, (d for d in diagonals if d is not None)))

    def energy_along(self, state: State, step: Array, slope: float) -> Array:
        """Potential energy in J at q + s step, coefficients (5,) of 1, s, ... s^4.

        `slope` is residual . step. Forces that follow the film are held as they are.
        """
        x = self.unknowns.expand(step)
        energy: Array = reduce(add, (term.along(state, x) for term in self.terms))
        energy[1] = slope
        return energy

    def external_forces(self, state: State) -> Array:
        """External forces on the unknowns, N."""
        return self.unknowns.fold(self.load.forces(state))

    def work(self, state: State, q: Array) -> float:
        """Work in J of the external forces, held as they are at `state`, along `q`."""
        return float(self.external_forces(state) @ q)

    def rim_reaction(self, state: State) -> float:
        """Force in N along z by which the rim holds the film."""
        forces: Array = reduce(add, (term.residual(state) for term in self.terms))
        return float(forces[self.rim_dofs[2::3]].sum()) * len(self.part.signs)

    def applied_force(self, state: State) -> float:
        """Force in N along z by which the probe presses."""
        return float(self.load.forces(state)[2::3].sum()) * len(self.part.signs)


class Unknowns:
    """The map from dofs to unknowns.

    Parameters
    ----------
    dof_count : int
    fixed : (n,) int
        Dofs that are zero.
    shared : (m,) int
        Dofs that have one common value, the last unknown.
    """

    def __init__(self, dof_count: int, fixed: Indices, shared: Indices) -> None:
        free = np.ones(dof_count, dtype=bool)
        free[fixed] = False
        free[shared] = False
        self.count = int(free.sum()) + (len(shared) > 0)
        self.of_dof = np.full(dof_count, FIXED, dtype=np.int64)
        self.of_dof[free] = np.arange(free.sum())
        self.of_dof[shared] = self.count - 1

    @cached_property
    def expansion(self) -> sp.csr_matrix:
        """Matrix form of `expand`; its transpose sums forces on dofs."""
        dofs = np.flatnonzero(self.of_dof >= 0)
        shape = (len(self.of_dof), self.count)
        return sp.csr_matrix((np.ones(len(dofs)), (dofs, self.of_dof[dofs])), shape=shape)

    def fold(self, forces: Array) -> Array:
        """Forces on the unknowns of forces on the dofs; those on fixed dofs drop out."""
        total = np.bincount(self.of_dof + 1, forces, self.count + 1)[1:]
        return np.asarray(total, dtype=np.float64)

    def expand(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return np.append(q, 0.0)[self.of_dof]

    def restrict(self, x: Array) -> Array:
        """Unknowns of the dofs `x`, averaged where dofs share one."""
        total = np.bincount(self.of_dof + 1, x, self.count + 1)
        return total[1:] / np.bincount(self.of_dof + 1, minlength=self.count + 1)[1:]

    def deflections(self) -> Mask:
        """Mask (unknowns,) of those that are deflections, not in-plane displacements."""
        mask = np.zeros(self.count + 1, dtype=bool)
        mask[self.of_dof[2::3]] = True
        return mask[:-1]


class Assembly:
    """Sums matrices of elements, or of deflections, into matrices of unknowns."""

    def __init__(self, space: Space, unknowns: Unknowns) -> None:
        self.unknowns, self.count = unknowns, unknowns.count
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
        return total[: self.count, : self.count]

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """The matrix (unknowns, unknowns) of one of the deflections (scalar dofs, scalar dofs)."""
        expansion = self.unknowns.expansion[2::3]
        return (expansion.T @ matrix @ expansion).tocsc()


def prolongation(coarse: Equilibrium, rich: Equilibrium) -> sp.csr_matrix:
    """Matrix (rich unknowns, coarse unknowns) that writes a function of `coarse` in `rich`."""
    points = ELEMENTS[rich.space.order].doflocs.T
    values = shape_values(coarse.space.basis.elem, points)
    rich_nodes, coarse_nodes = (e.space.basis.element_dofs for e in (rich, coarse))
    node, component = np.divmod(_first_places(rich.unknowns.of_dof, rich.unknowns.count), 3)
    place = _first_places(rich_nodes.T.ravel(), rich.space.basis.N)[node]
    element, local = np.divmod(place, len(rich_nodes))
    columns = coarse.unknowns.of_dof[3 * coarse_nodes[:, element].T + component[:, None]]
    used = (columns >= 0) & (np.abs(values) > ROUNDING)[local]
    ends = np.append(0, np.cumsum(used.sum(axis=1)))
    shape = (rich.unknowns.count, coarse.unknowns.count)
    return sp.csr_matrix((values[local][used], columns[used], ends), shape=shape)


def _first_places(labels: Indices, count: int) -> Indices:
    """Where each of the labels 0 ... count - 1 stands first, (count,); others are negative."""
    place = np.empty(count + 1, dtype=np.int64)
    place[labels[::-1]] = np.arange(len(labels))[::-1]
    return place[:count]
