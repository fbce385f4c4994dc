"""Equilibrium: the sum of the film's energy terms, on the unknowns that a scene leaves free.

The clamped rim fixes its dofs; a term, such as a rigid punch, may fix or share more dofs. The
equations on a part also hold on its mirror images: nothing crosses a mirror line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import replace
from functools import cached_property, reduce
from operator import add

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
from pvdf_fem.film.term import Load, State, Term
from pvdf_fem.film.unknowns import FIXED, Assembly, Unknowns
from pvdf_fem.mesh.gmsh_mesh import MIRRORS, RIM
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
        #: Dofs that the rim and mirror lines hold, (n,).
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
        """The equilibrium equations of other terms; the membrane term must stay first."""
        other = copy(self)
        for name in ("unknowns", "assembly", "flat_forces", "_uneven_forces"):
            other.__dict__.pop(name, None)
        other.terms = list(terms)
        return other

    def map_terms(self, change: Callable[[Term], Term]) -> Equilibrium:
        """The equations with every term changed."""
        return self.with_terms(map(change, self.terms))

    def with_scaled_loads(self, factor: float) -> Equilibrium:
        """The film under its loads times a factor."""
        return self.map_terms(lambda term: term.scaled(factor) if isinstance(term, Load) else term)

    @property
    def loads(self) -> list[ProbeLoad]:
        """The loads of the probes. Other terms may apply forces, too."""
        return select_probe_loads(self.terms)

    @property
    def force(self) -> float:
        """Sum of the magnitudes of the terms' forces, N."""
        return sum(term.force for term in self.terms if isinstance(term, Load))

    @property
    def conservative(self) -> bool:
        """Whether an energy exists."""
        return all(term.conservative for term in self.terms)

    @cached_property
    def unknowns(self) -> Unknowns:
        """The map from unknowns to dofs: displacements that are even about the mirror lines."""
        return Unknowns.from_terms(self.space, self.clamped, self.terms)

    @cached_property
    def assembly(self) -> Assembly:
        """Where entries of elements go, worked out at first use."""
        return Assembly(self.space, self.unknowns)

    def dofs(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return self.unknowns.expand(q)

    def restrict(self, x: Array) -> Array:
        """Unknowns for dofs `x`, averaged where dofs share an unknown."""
        return self.unknowns.restrict(x)

    def complete_initial_guess(self, x: Array) -> Array:
        """Unknowns near the dofs `x`, with suitable values of the terms' own dofs."""
        return self.restrict(reduce(lambda x, term: term.complete_initial_guess(x), self.terms, x))

    def state(self, q: Array) -> State:
        """Fields of the unknowns `q`."""
        state = self.membrane.state(self.dofs(q))
        if not self.problem.floating_electrodes or self.model.wrinkles:
            return state  # the residual of wrinkles is of the whole stress, which has no voltage
        added = np.zeros((len(state.stress), 1, 3))
        for elements, stress in filter(None, (term.added_stress(state) for term in self.terms)):
            added[elements] += stress
        return replace(state, stress=state.stress + added, added=added)

    def film_forces(self, state: State) -> Array:
        """Residual: internal forces minus load forces, (dofs,), in N."""
        return reduce(add, (term.residual(state) for term in self.terms))

    def residual(self, state: State) -> Array:
        """Internal minus external forces of the unknowns, N."""
        return self.unknowns.fold(self.film_forces(state))

    def tangent(self, state: State) -> sp.csc_matrix | LowRankUpdate:
        """Derivative of `residual` in N/m."""
        columns = [c for term in self.terms if (c := term.tangent_column(state)) is not None]
        sparse = self.sparse_tangent(state)
        return (
            LowRankUpdate(sparse, self.unknowns.fold(np.transpose(columns))) if columns else sparse
        )

    def sparse_tangent(self, state: State) -> sp.csc_matrix:
        """Tangent without the columns from terms that couple many elements."""
        by_element = (term.element_tangent(state) for term in self.terms)
        # the membrane is the first term and has every element
        (_, matrices), *others = [local for local in by_element if local is not None]
        for elements, values in others:
            matrices[elements] += values
        return self.with_coupled(self.assembly.matrix(matrices), state)

    def with_coupled(self, matrix: sp.csc_matrix, state: State) -> sp.csc_matrix:
        """A matrix (unknowns, unknowns) with the parts of the tangent that couple elements."""
        coupled = (term.coupled_tangent(self.assembly, state) for term in self.terms)
        return reduce(add, (c for c in coupled if c is not None), matrix)

    def element_action(self, state: State, step: Array) -> Array:
        """Element forces in N by a small step, (elements, dofs of an element).

        The matrices are symmetric: follower loads have no part in the tangent here.
        """
        x = self.unknowns.expand(step)
        actions = (term.element_action(state, x) for term in self.terms)
        return reduce(add, (action for action in actions if action is not None))

    def action(self, state: State, step: Array) -> Array:
        """Tangent without follower loads, times a step, (unknowns,)."""
        x = self.unknowns.expand(step)
        actions = (term.action(state, x) for term in self.terms)
        return self.unknowns.fold(reduce(add, (force for force in actions if force is not None)))

    def diagonal(self, state: State) -> Array:
        """Diagonal of the tangent without coupling between shared dofs, (unknowns,)."""
        diagonals = (term.diagonal(state) for term in self.terms)
        return self.unknowns.fold_diagonal(reduce(add, (d for d in diagonals if d is not None)))

    def energy_along(self, state: State, step: Array, slope: float) -> Array:
        """Potential energy in J at q + s step, coefficients (5,) of 1, s, ... s^4.

        `slope` is residual . step. Follower forces stay fixed.
        """
        x = self.unknowns.expand(step)
        energy: Array = reduce(add, (term.energy_along(state, x) for term in self.terms))
        energy[1] = slope
        return energy

    @cached_property
    def flat_forces(self) -> Array:
        """What moves the flat film, (unknowns,), in N: its residual with a minus sign."""
        return -self.residual(self._flat)

    @cached_property
    def _flat(self) -> State:
        return self.membrane.state(np.zeros(self.space.dof_count))

    @cached_property
    def _uneven_forces(self) -> Array:
        """Part of `flat_forces` that is no load."""
        return self.flat_forces - self.unknowns.fold(self.load_forces(self._flat))

    @property
    def is_flat(self) -> bool:
        """Whether the flat film is in balance."""
        return not self.flat_forces.any()

    def work(self, state: State, q: Array) -> float:
        """Work in J along `q` by the loads at a state and by everything else that moves the flat
        film."""
        return float((self.unknowns.fold(self.load_forces(state)) + self._uneven_forces) @ q)

    @property
    def is_abrupt(self) -> bool:
        """Whether a term changes abruptly."""
        return any(term.relaxed() is not term for term in self.terms)

    def load_forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""
        loads = (term for term in self.terms if isinstance(term, Load))
        return sum((load.forces(state) for load in loads), np.zeros(self.space.dof_count))

    def rim_reaction(self, state: State) -> Array:
        """Force in N, (3,), by which the rim, and guides of punches, hold the film."""
        held = self.unknowns.of_dof == FIXED
        return self._of_all_images(np.where(held, self.film_forces(state), 0.0))

    def applied_force(self, state: State) -> Array:
        """Force in N, (3,), by which the loads press."""
        return self._of_all_images(self.load_forces(state))

    def imbalance(self, state: State) -> float:
        """Imbalance in N between rim and loads, along the applied force."""
        applied = self.applied_force(state)
        size = float(np.linalg.norm(applied))
        return abs(float((self.rim_reaction(state) + applied) @ applied)) / size if size else 0.0

    def _of_all_images(self, forces: Array) -> Array:
        """Sum in N, (3,), of forces (dofs,) and their mirror images, in the scene's axes."""
        total = forces.reshape(-1, 3).sum(axis=0)
        total *= [*self.sector.signs.sum(axis=0), len(self.sector.signs)]
        return np.append(total[:2] @ self.sector.frame, total[2])
