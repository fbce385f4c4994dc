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
from pvdf_fem.film.supports import make_supports
from pvdf_fem.film.term import LoadTerm, State, Support, Term
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
        #: The membrane as the first term, then the loads, the supports, the coupling of floating
        #: electrodes, and the plate if the film bends.
        self.terms = self._make_terms()
        #: Numbers of the dofs that the rim and the mirror lines fix, shape (n,).
        self.clamped = self._find_clamped_dofs()

    def _make_terms(self) -> list[Term]:
        """Make the terms; those of bending are last, since they depend on the others."""
        terms: list[Term] = [self.membrane]
        terms += make_loads(self.film, self.problem.loads, self.space, self.sector)
        terms += make_supports(self.film, self.space)
        for electrode in self.problem.floating_electrodes:
            terms.append(Coupling(electrode, self.space))
        terms += self.model.make_bending_terms(self.space, terms)
        return terms

    def _find_clamped_dofs(self) -> Indices:
        """Find the dofs that stay zero: all at the rim, the normal ones on mirror lines."""
        rim = self.space.basis.get_dofs(RIM).all()
        clamped = [(3 * rim[:, None] + np.arange(3)).ravel()]
        for axis in self.sector.mirror_axes:
            on_mirror = self.space.basis.get_dofs(MIRRORS[axis]).all()
            clamped.append(3 * on_mirror + axis)
        return np.concatenate(clamped)

    def at_order(self, order: int) -> Equilibrium:
        """Return the equations of this problem and mesh in elements of another order."""
        return Equilibrium(self.problem, self.space.mesh, order, sector=self.sector)

    def on_whole_film(self, mesh: MeshTri2) -> Equilibrium:
        """Return the equations of this problem and order on a mesh of the whole film."""
        return Equilibrium(self.problem, mesh, self.space.order)

    def of_problem(self, problem: Problem) -> Equilibrium:
        """Return the equations of another problem in this finite-element space and sector."""
        space = self.space
        return Equilibrium(problem, space.mesh, space.order, sector=self.sector, space=space)

    def with_terms(self, terms: Iterable[Term]) -> Equilibrium:
        """Return a copy of the equations with other terms, the first of which is the membrane.

        The copy does not take over cached values that depend on the terms.
        """
        other = copy(self)
        for name in ("unknowns", "assembly", "flat_forces", "_forces_of_nonuniform_stress"):
            other.__dict__.pop(name, None)
        other.terms = list(terms)
        return other

    def map_terms(self, change: Callable[[Term], Term]) -> Equilibrium:
        """Return a copy of the equations in which every term is replaced by ``change(term)``."""
        return self.with_terms(change(term) for term in self.terms)

    def with_scaled_loads(self, factor: float) -> Equilibrium:
        """Return a copy of the equations with all loads multiplied by a factor."""

        def scale(term: Term) -> Term:
            """Scale a load; return any other term itself."""
            return term.scaled(factor) if isinstance(term, LoadTerm) else term

        return self.map_terms(scale)

    @property
    def loads(self) -> list[ProbeLoad]:
        """The loads of the probes, without those on the whole film."""
        return select_probe_loads(self.terms)

    @property
    def force(self) -> float:
        """Sum of the magnitudes of all loads' forces on the whole film in N."""
        return sum(term.force for term in self.terms if isinstance(term, LoadTerm))

    @property
    def conservative(self) -> bool:
        """Whether the residual of every term is the derivative of an energy."""
        return all(term.conservative for term in self.terms)

    @cached_property
    def unknowns(self) -> Unknowns:
        """The linear map from unknowns to dofs, given the constraints of rim and terms."""
        return Unknowns.from_terms(self.space, self.clamped, self.terms)

    @cached_property
    def assembly(self) -> Assembly:
        """The assembler of element matrices to sparse matrices for the unknowns."""
        return Assembly(self.space, self.unknowns)

    def dofs(self, q: Array) -> Array:
        """Map unknowns `q`, shape (unknowns,), to dofs, shape (dofs,)."""
        return self.unknowns.expand(q)

    def restrict(self, x: Array) -> Array:
        """Return the unknowns nearest to the dofs `x`, averaged where dofs share an unknown."""
        return self.unknowns.restrict(x)

    def complete_initial_guess(self, x: Array) -> Array:
        """Return unknowns near the dofs `x`, after every term has improved this initial guess."""
        for term in self.terms:
            x = term.complete_initial_guess(x)
        return self.restrict(x)

    def state(self, q: Array) -> State:
        """Compute deformation gradient, strain and stress at unknowns `q`.

        The stress includes that due to voltages of floating electrodes, unless the film wrinkles.
        """
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

    def unbalanced_forces(self, state: State) -> Array:
        """Return the internal minus the external forces at all dofs in N.

        At equilibrium, only the reactions at constrained dofs differ from zero.

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
        return self.unknowns.fold(self.unbalanced_forces(state))

    def tangent(self, state: State) -> sp.csc_matrix | LowRankUpdate:
        """Return the derivative of `residual` with respect to the unknowns in N/m.

        It is a sparse matrix, or a `LowRankUpdate` of one if terms have rank-one parts.
        """
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
        """Assemble the tangent in N/m without the rank-one parts of terms."""
        first, *others = self.terms
        local = first.element_tangent(state)
        assert local is not None  # the membrane has every element
        _, matrices = local
        for term in others:
            by_term = term.element_tangent(state)
            if by_term is not None:
                elements, values = by_term
                matrices[elements] += values
        return self._add_coupled_tangents(self.assembly.matrix(matrices), state)

    def _add_coupled_tangents(self, matrix: sp.csc_matrix, state: State) -> sp.csc_matrix:
        """Return a matrix plus the `coupled_tangent` of every term that has one.

        These are parts of the tangent that couple dofs of several elements.

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
        """Multiply the element tangents by a step of the unknowns in m, without forming them.

        The tangents of nonconservative loads are left out, so that the product is symmetric.

        Returns
        -------
        ndarray, shape (elements, element dofs)
            Forces in N.
        """
        x = self.unknowns.expand(step)
        return _sum_arrays(term.element_action(state, x) for term in self.terms)

    def action(self, state: State, step: Array) -> Array:
        """Multiply the tangent by a step of the unknowns in m; return forces in N.

        The tangents of nonconservative loads are left out.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        x = self.unknowns.expand(step)
        return self.unknowns.fold(_sum_arrays(term.action(state, x) for term in self.terms))

    def diagonal(self, state: State) -> Array:
        """Return an approximate diagonal of the tangent in N/m, to scale the unknowns.

        It lacks the coupling of dofs that share an unknown, and the tangents of nonconservative
        loads.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        diagonal = _sum_arrays(term.diagonal(state) for term in self.terms)
        return self.unknowns.fold_diagonal(diagonal)

    def energy_along(self, state: State, step: Array, slope: float) -> Array:
        """Return the potential energy along a step as a polynomial of fourth degree.

        The forces of nonconservative loads are held constant. For a wrinkling film the polynomial
        is an approximation.

        Parameters
        ----------
        state : State
            The state from which the step starts.
        step : ndarray, shape (unknowns,)
            The step in m.
        slope : float
            The scalar product of residual and step in J, which replaces the computed coefficient
            of s.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients of 1, s, ..., s^4 in J, where s is the fraction of the step.
        """
        x = self.unknowns.expand(step)
        energy = _sum_arrays(term.energy_along(state, x) for term in self.terms)
        energy[1] = slope
        return energy

    @cached_property
    def flat_forces(self) -> Array:
        """Forces in N that move the flat film: its negative residual, shape (unknowns,)."""
        return -self.residual(self._flat_state)

    @cached_property
    def _flat_state(self) -> State:
        """The state of the membrane without displacement."""
        return self.membrane.state(np.zeros(self.space.dof_count))

    @cached_property
    def _forces_of_nonuniform_stress(self) -> Array:
        """The part of `flat_forces` that is due to a nonuniform stress, not to loads, in N."""
        return self.flat_forces - self.unknowns.fold(self.load_forces(self._flat_state))

    @property
    def is_flat(self) -> bool:
        """Whether the flat film is in equilibrium: all `flat_forces` are exactly zero."""
        return not self.flat_forces.any()

    def work(self, state: State, q: Array) -> float:
        """Return the work in J of the forces that move the film along the displacement `q`.

        These are the loads at `state` and the forces of a nonuniform stress in the flat film.
        """
        loads = self.unknowns.fold(self.load_forces(state))
        return float((loads + self._forces_of_nonuniform_stress) @ q)

    @property
    def is_abrupt(self) -> bool:
        """Whether a term has a relaxed approximation, since it changes abruptly like contact."""
        return any(term.relaxed() is not term for term in self.terms)

    def load_forces(self, state: State) -> Array:
        """Return the sum of all loads' forces at the dofs in N.

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
        """Return the force in N by which the rim and the guides of punches hold the film.

        It is summed over the fixed dofs, and on a sector over its reflections.

        Returns
        -------
        ndarray, shape (3,)
            Components in the scene's axes.
        """
        is_fixed = self.unknowns.of_dof == FIXED
        return self._sum_reflections(np.where(is_fixed, self.unbalanced_forces(state), 0.0))

    def applied_force(self, state: State) -> Array:
        """Return the resultant of all loads on the whole film in N.

        Returns
        -------
        ndarray, shape (3,)
            Components in the scene's axes.
        """
        return self._sum_reflections(self.load_forces(state))

    def support_reaction(self, state: State) -> Array:
        """Return the force in N by which supports such as a backing hold the whole film.

        Returns
        -------
        ndarray, shape (3,)
            Components in the scene's axes; zero without supports.
        """
        forces = np.zeros(self.space.dof_count)
        for term in self.terms:
            if isinstance(term, Support):
                forces = forces - term.residual(state)
        return self._sum_reflections(forces)

    def imbalance(self, state: State) -> float:
        """Return by how much reactions and applied force fail to cancel along the latter, in N.

        The reactions are those of the rim and of supports.

        It is 0 without an applied force.
        """
        applied = self.applied_force(state)
        size = float(np.linalg.norm(applied))
        if size == 0.0:
            return 0.0
        reaction = self.rim_reaction(state) + self.support_reaction(state)
        along = (reaction + applied) @ applied
        return abs(float(along)) / size

    def _sum_reflections(self, forces: Array) -> Array:
        """Sum forces at dofs, shape (dofs,), over all nodes and over all reflections of the sector.

        Returns
        -------
        ndarray, shape (3,)
            The resultant on the whole film in N, in the scene's axes.
        """
        signs = self.sector.signs
        total = forces.reshape(-1, 3).sum(axis=0)
        total *= [*signs.sum(axis=0), len(signs)]
        return np.append(total[:2] @ self.sector.frame, total[2])


def _sum_arrays(arrays: Iterable[Array | None]) -> Array:
    """Sum the arrays that are not None, of which there must be at least one."""
    existing = [array for array in arrays if array is not None]
    total = existing[0]
    for array in existing[1:]:
        total = total + array
    return total
