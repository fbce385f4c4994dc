"""The equilibrium equations: the sum of the film's energy terms as a function of the unknowns.

The clamped rim fixes its dofs; a term, such as a rigid punch, may fix or share more dofs. On a
symmetry sector the displacement normal to a mirror line is fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.coupling import Coupling
from pvdf_fem.film.loads.load_classes import make_loads, select_probe_loads
from pvdf_fem.film.loads.load_spec import count_auxiliary_nodes
from pvdf_fem.film.loads.probe_load import ProbeLoad
from pvdf_fem.film.low_rank import LowRankUpdate
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import LoadTerm, State, Term
from pvdf_fem.film.unknowns import FIXED, Assembly, Unknowns
from pvdf_fem.mesh.subdomains import MIRRORS, RIM
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.problem import Problem


class Equilibrium:
    """The nonlinear equations (stationary energy) of a problem on a mesh of the film or a sector.

    Parameters
    ----------
    problem : Problem
        Film model, loads and floating electrodes.
    mesh : MeshTri2
        Curved triangles in m, with the patches as subdomains.
    order : int, optional
        Polynomial order of the displacement.
    sector : SymmetrySector, optional
        The sector of the film that is meshed.
    space : Space, optional
        A finite-element space on the mesh to reuse; by default a new one is made.
    """

    def __init__(
        self,
        problem: Problem,
        mesh: MeshTri2,
        order: int = 2,
        *,
        sector: SymmetrySector = WHOLE_FILM,
        space: Space | None = None,
    ) -> None:
        self.problem = problem
        self.scene = problem.scene
        self.film = problem.scene.film
        self.model = problem.film
        self.sector = sector
        if space is None:
            space = Space(mesh, order, count_auxiliary_nodes(problem.scene))
        self.space = space
        self.membrane = self.model.make_membrane(space, sector)
        #: The membrane as the first term, then the loads, the coupling of floating electrodes, and
        #: the plate if the film bends.
        self.terms = self._make_terms()
        #: Numbers of the dofs that the rim and the mirror lines fix, shape (n,).
        self.clamped = self._find_clamped_dofs()

    def _make_terms(self) -> list[Term]:
        terms: list[Term] = [self.membrane]
        terms += make_loads(self.film, self.problem.loads, self.space, self.sector)
        for electrode in self.problem.floating_electrodes:
            terms.append(Coupling(electrode, self.space))
        terms += self.model.make_bending_terms(self.space, terms)
        return terms

    def _find_clamped_dofs(self) -> Indices:
        rim = self.space.basis.get_dofs(RIM).all()
        clamped = [(3 * rim[:, None] + np.arange(3)).ravel()]
        for axis in self.sector.mirror_axes:
            on_mirror = self.space.basis.get_dofs(MIRRORS[axis]).all()
            clamped.append(3 * on_mirror + axis)
        return np.concatenate(clamped)

    def at_order(self, order: int) -> Equilibrium:
        """Return the equations of the same problem and mesh in elements of another order."""
        return Equilibrium(self.problem, self.space.mesh, order, sector=self.sector)

    def on_whole_film(self, mesh: MeshTri2) -> Equilibrium:
        """Return the equations of the same problem and order on a mesh of the whole film."""
        return Equilibrium(self.problem, mesh, self.space.order)

    def of_problem(self, problem: Problem) -> Equilibrium:
        """Return the equations of another problem in the same finite-element space."""
        space = self.space
        return Equilibrium(problem, space.mesh, space.order, sector=self.sector, space=space)

    def with_terms(self, terms: Iterable[Term]) -> Equilibrium:
        """Return a copy of the equations with other terms; the first one is the membrane."""
        other = copy(self)
        for name in ("unknowns", "assembly", "flat_forces", "_forces_without_load"):
            other.__dict__.pop(name, None)
        other.terms = list(terms)
        return other

    def map_terms(self, change: Callable[[Term], Term]) -> Equilibrium:
        """Return a copy of the equations with every term replaced by `change` of it."""
        return self.with_terms(change(term) for term in self.terms)

    def with_scaled_loads(self, factor: float) -> Equilibrium:
        """Return a copy of the equations with all loads multiplied by a factor."""

        def scale(term: Term) -> Term:
            return term.scaled(factor) if isinstance(term, LoadTerm) else term

        return self.map_terms(scale)

    @property
    def loads(self) -> list[ProbeLoad]:
        """The loads of the probes, without those on the whole film."""
        return select_probe_loads(self.terms)

    @property
    def force(self) -> float:
        """Sum of the magnitudes of the loads' forces in N."""
        return sum(term.force for term in self.terms if isinstance(term, LoadTerm))

    @property
    def conservative(self) -> bool:
        """Whether the forces of all terms are derivatives of an energy."""
        return all(term.conservative for term in self.terms)

    @cached_property
    def unknowns(self) -> Unknowns:
        """The map from unknowns to dofs."""
        return Unknowns.from_terms(self.space, self.clamped, self.terms)

    @cached_property
    def assembly(self) -> Assembly:
        """The assembler of element matrices to matrices for the unknowns."""
        return Assembly(self.space, self.unknowns)

    def dofs(self, q: Array) -> Array:
        """Map unknowns `q` to dofs."""
        return self.unknowns.expand(q)

    def restrict(self, x: Array) -> Array:
        """Return the unknowns nearest to the dofs `x`, averaged where dofs share an unknown."""
        return self.unknowns.restrict(x)

    def complete_initial_guess(self, x: Array) -> Array:
        """Return unknowns near the dofs `x`, changed by every term to a better initial guess."""
        for term in self.terms:
            x = term.complete_initial_guess(x)
        return self.restrict(x)

    def state(self, q: Array) -> State:
        """Return deformation gradient, strain and stress at unknowns `q`."""
        state = self.membrane.state(self.dofs(q))
        if not self.problem.floating_electrodes or self.model.wrinkles:
            return state  # the solver for wrinkles needs the constitutive stress, without voltages
        added = np.zeros((len(state.stress), 1, 3))
        for term in self.terms:
            by_term = term.added_stress(state)
            if by_term is not None:
                elements, stress = by_term
                added[elements] += stress
        return replace(state, stress=state.stress + added, added=added)

    def film_forces(self, state: State) -> Array:
        """Return the internal minus the external forces at the dofs in N, with reactions.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        first, *others = self.terms
        forces = first.residual(state)
        for term in others:
            forces = forces + term.residual(state)
        return forces

    def residual(self, state: State) -> Array:
        """Return the internal minus the external forces on the unknowns in N.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        return self.unknowns.fold(self.film_forces(state))

    def tangent(self, state: State) -> sp.csc_matrix | LowRankUpdate:
        """Return the derivative of `residual` with respect to the unknowns in N/m."""
        sparse = self.sparse_tangent(state)
        columns = []
        for term in self.terms:
            column = term.tangent_column(state)
            if column is not None:
                columns.append(column)
        if not columns:
            return sparse
        return LowRankUpdate(sparse, self.unknowns.fold(np.transpose(columns)))

    def sparse_tangent(self, state: State) -> sp.csc_matrix:
        """Return the sparse part of the tangent, without the rank-one parts of terms."""
        first, *others = self.terms
        local = first.element_tangent(state)
        assert local is not None  # the membrane has every element
        _, matrices = local
        for term in others:
            by_term = term.element_tangent(state)
            if by_term is not None:
                elements, values = by_term
                matrices[elements] += values
        return self.with_coupled(self.assembly.matrix(matrices), state)

    def with_coupled(self, matrix: sp.csc_matrix, state: State) -> sp.csc_matrix:
        """Return a matrix plus the parts of the tangent that couple dofs of several elements.

        Parameters
        ----------
        matrix : sparse matrix, shape (unknowns, unknowns)
            A matrix in N/m; it is not changed.
        state : State
            The state at which the tangent is taken.
        """
        for term in self.terms:
            coupled = term.coupled_tangent(self.assembly, state)
            if coupled is not None:
                matrix = matrix + coupled
        return matrix

    def element_action(self, state: State, step: Array) -> Array:
        """Multiply the element tangents by a step, without forming them.

        Follower loads are left out, so that the element tangents are symmetric.

        Returns
        -------
        ndarray, shape (elements, element dofs)
            Forces in N.
        """
        x = self.unknowns.expand(step)
        return _add_existing(term.element_action(state, x) for term in self.terms)

    def action(self, state: State, step: Array) -> Array:
        """Multiply the tangent, without follower loads, by a step; return forces in N.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        x = self.unknowns.expand(step)
        return self.unknowns.fold(_add_existing(term.action(state, x) for term in self.terms))

    def diagonal(self, state: State) -> Array:
        """Return the diagonal of the tangent, without coupling of dofs that share an unknown.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        diagonal = _add_existing(term.diagonal(state) for term in self.terms)
        return self.unknowns.fold_diagonal(diagonal)

    def energy_along(self, state: State, step: Array, slope: float) -> Array:
        """Return the potential energy along a step as a polynomial of fourth degree.

        Follower forces are held constant.

        Parameters
        ----------
        state : State
            The state from which the step starts.
        step : ndarray, shape (unknowns,)
            The step in m.
        slope : float
            The scalar product of residual and step in J.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients of 1, s, ..., s^4 in J, where s is the fraction of the step.
        """
        x = self.unknowns.expand(step)
        energy = _add_existing(term.energy_along(state, x) for term in self.terms)
        energy[1] = slope
        return energy

    @cached_property
    def flat_forces(self) -> Array:
        """Minus the residual of the flat film in N, shape (unknowns,): the forces that move it."""
        return -self.residual(self._flat_state)

    @cached_property
    def _flat_state(self) -> State:
        return self.membrane.state(np.zeros(self.space.dof_count))

    @cached_property
    def _forces_without_load(self) -> Array:
        """The part of `flat_forces` due to a stress that is not uniform, without the loads."""
        return self.flat_forces - self.unknowns.fold(self.load_forces(self._flat_state))

    @property
    def is_flat(self) -> bool:
        """Whether the flat film is in equilibrium."""
        return not self.flat_forces.any()

    def work(self, state: State, q: Array) -> float:
        """Return the work along `q` in J by the loads at a state and by a nonuniform prestress."""
        loads = self.unknowns.fold(self.load_forces(state))
        return float((loads + self._forces_without_load) @ q)

    @property
    def is_abrupt(self) -> bool:
        """Whether a term changes abruptly, so that it has a relaxed approximation."""
        return any(term.relaxed() is not term for term in self.terms)

    def load_forces(self, state: State) -> Array:
        """Return the external forces at the dofs in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        forces = np.zeros(self.space.dof_count)
        for term in self.terms:
            if isinstance(term, LoadTerm):
                forces = forces + term.forces(state)
        return forces

    def rim_reaction(self, state: State) -> Array:
        """Return the force by which rim and guides of punches hold the film in N.

        Returns
        -------
        ndarray, shape (3,)
        """
        is_fixed = self.unknowns.of_dof == FIXED
        return self._sum_reflections(np.where(is_fixed, self.film_forces(state), 0.0))

    def applied_force(self, state: State) -> Array:
        """Return the force of all loads in N.

        Returns
        -------
        ndarray, shape (3,)
        """
        return self._sum_reflections(self.load_forces(state))

    def imbalance(self, state: State) -> float:
        """Return the imbalance between rim and loads along the applied force in N."""
        applied = self.applied_force(state)
        size = float(np.linalg.norm(applied))
        if size == 0.0:
            return 0.0
        along = (self.rim_reaction(state) + applied) @ applied
        return abs(float(along)) / size

    def _sum_reflections(self, forces: Array) -> Array:
        """Sum forces on dofs over all reflections; return N in the scene's axes, shape (3,)."""
        signs = self.sector.signs
        total = forces.reshape(-1, 3).sum(axis=0)
        total *= [*signs.sum(axis=0), len(signs)]
        return np.append(total[:2] @ self.sector.frame, total[2])


def _add_existing(arrays: Iterable[Array | None]) -> Array:
    """Add the arrays that are not None; at least one must not be."""
    existing = [array for array in arrays if array is not None]
    total = existing[0]
    for array in existing[1:]:
        total = total + array
    return total
