"""Equilibrium: the sum of the film's energy terms, on the unknowns that the constraints leave.

The clamped rim fixes its dofs; a term, such as a rigid punch, may fix or share more dofs. The
equations on a symmetry sector also hold on its reflections: nothing crosses a mirror line.
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
        The finite-element space on the mesh, where it exists already.
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
        #: The membrane, first, the loads, coupling and, where the film bends, the plate.
        self.terms = self._make_terms()
        #: Dofs that the rim and mirror lines hold, shape (n,).
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
        """Return the equations in elements of another order on the same mesh."""
        return Equilibrium(self.problem, self.space.mesh, order, sector=self.sector)

    def on_whole_film(self, mesh: MeshTri2) -> Equilibrium:
        """Return the equations on a mesh of the whole film."""
        return Equilibrium(self.problem, mesh, self.space.order)

    def of_problem(self, problem: Problem) -> Equilibrium:
        """Return the equations of another problem in the same finite-element space."""
        space = self.space
        return Equilibrium(problem, space.mesh, space.order, sector=self.sector, space=space)

    def with_terms(self, terms: Iterable[Term]) -> Equilibrium:
        """Return a copy of the equations with other terms, of which the membrane is the first."""
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
        """Whether the forces derive from an energy."""
        return all(term.conservative for term in self.terms)

    @cached_property
    def unknowns(self) -> Unknowns:
        """The map from unknowns to dofs."""
        return Unknowns.from_terms(self.space, self.clamped, self.terms)

    @cached_property
    def assembly(self) -> Assembly:
        """The sparsity pattern of the tangent, computed at first use."""
        return Assembly(self.space, self.unknowns)

    def dofs(self, q: Array) -> Array:
        """Return the dofs of unknowns `q`."""
        return self.unknowns.expand(q)

    def restrict(self, x: Array) -> Array:
        """Return unknowns for dofs `x`, averaged where dofs share an unknown."""
        return self.unknowns.restrict(x)

    def complete_initial_guess(self, x: Array) -> Array:
        """Return unknowns near dofs `x`, with suitable values of the terms' auxiliary dofs."""
        for term in self.terms:
            x = term.complete_initial_guess(x)
        return self.restrict(x)

    def state(self, q: Array) -> State:
        """Return deformation gradient, strain and stress at unknowns `q`."""
        state = self.membrane.state(self.dofs(q))
        if not self.problem.floating_electrodes or self.model.wrinkles:
            return state  # the residual of wrinkles is of the whole stress, which has no voltage
        added = np.zeros((len(state.stress), 1, 3))
        for term in self.terms:
            by_term = term.added_stress(state)
            if by_term is not None:
                elements, stress = by_term
                added[elements] += stress
        return replace(state, stress=state.stress + added, added=added)

    def film_forces(self, state: State) -> Array:
        """Return the internal less the external forces at the dofs in N.

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
        """Return the internal less the external forces of the unknowns in N.

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
        """Return the tangent without the columns of terms that couple many elements."""
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
        """Add the parts of the tangent that couple elements to a matrix.

        Returns
        -------
        ndarray, shape (unknowns, unknowns)
        """
        for term in self.terms:
            coupled = term.coupled_tangent(self.assembly, state)
            if coupled is not None:
                matrix = matrix + coupled
        return matrix

    def element_action(self, state: State, step: Array) -> Array:
        """Return the element forces of a small step in N.

        The matrices are symmetric: follower loads have no part in the tangent here.

        Returns
        -------
        ndarray, shape (elements, dofs of an element)
        """
        x = self.unknowns.expand(step)
        return _add_existing(term.element_action(state, x) for term in self.terms)

    def action(self, state: State, step: Array) -> Array:
        """Return the tangent without follower loads, times a step, in N.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        x = self.unknowns.expand(step)
        return self.unknowns.fold(_add_existing(term.action(state, x) for term in self.terms))

    def diagonal(self, state: State) -> Array:
        """Return the diagonal of the tangent, without coupling of shared dofs.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        diagonal = _add_existing(term.diagonal(state) for term in self.terms)
        return self.unknowns.fold_diagonal(diagonal)

    def energy_along(self, state: State, step: Array, slope: float) -> Array:
        """Return the potential energy along a step, a quartic polynomial.

        Follower forces stay fixed.

        Parameters
        ----------
        state : State
            Where the step starts.
        step : ndarray, shape (unknowns,)
            The step in m.
        slope : float
            The residual times the step in J.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients of 1, s, ..., s^4 in J, at the part s of the step.
        """
        x = self.unknowns.expand(step)
        energy = _add_existing(term.energy_along(state, x) for term in self.terms)
        energy[1] = slope
        return energy

    @cached_property
    def flat_forces(self) -> Array:
        """Forces that move the flat film in N, shape (unknowns,)."""
        return -self.residual(self._flat_state)

    @cached_property
    def _flat_state(self) -> State:
        return self.membrane.state(np.zeros(self.space.dof_count))

    @cached_property
    def _forces_without_load(self) -> Array:
        """The part of `flat_forces` by uneven stress, without the loads."""
        return self.flat_forces - self.unknowns.fold(self.load_forces(self._flat_state))

    @property
    def is_flat(self) -> bool:
        """Whether the flat film is in equilibrium."""
        return not self.flat_forces.any()

    def work(self, state: State, q: Array) -> float:
        """Return the work along `q` in J, by the loads at a state and by uneven stress."""
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
        """Sum forces (dofs,) and their reflections in the scene's axes, in N, shape (3,)."""
        signs = self.sector.signs
        total = forces.reshape(-1, 3).sum(axis=0)
        total *= [*signs.sum(axis=0), len(signs)]
        return np.append(total[:2] @ self.sector.frame, total[2])


def _add_existing(arrays: Iterable[Array | None]) -> Array:
    """Add the arrays that are not None, of which there is at least one."""
    existing = [array for array in arrays if array is not None]
    total = existing[0]
    for array in existing[1:]:
        total = total + array
    return total
