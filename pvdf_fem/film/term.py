"""Terms of the film's potential energy: their interface, and everything that is optional in it.

An equilibrium makes the sum of its terms stationary. A term needs an energy and its derivative,
`Term.residual`; a load needs its forces. All other members have defaults:

- `Term.element_tangent`, and with it products and diagonals of the tangent;
- `Term.constraints`, for a term that fixes or joins dofs (`Constraints`);
- `SolverHints`, for a term that changes abruptly or has no energy;
- `NonlocalTangent`, for a term whose tangent couples dofs across elements.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, Self

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Selection
from pvdf_fem.film.space import Space

NO_INDICES: Indices = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class State:
    """Deformation, strain and stress of a displacement at the quadrature points of the elements."""

    #: (elements, points, 3, 2)
    deformation_gradient: Array
    #: Green-Lagrange strain, Voigt with engineering shear, shape (elements, points, 3).
    strain: Array
    #: Second Piola-Kirchhoff stress in Pa, Voigt, (elements, points, 3), with the stress that terms
    #: add.
    stress: Array
    #: The displacement in m, shape (dofs,).
    dofs: Array
    #: Stress that terms add to the strain's stress, if any does, shape (elements, 1, 3).
    added: Array | None = field(default=None, kw_only=True)
    #: Moduli in Pa that replace the strain's moduli in a tangent.
    tangent_stiffness: Array | None = field(default=None, kw_only=True)
    #: Artificial tension in a tangent, over the film's mean tension.
    damping: float = field(default=0.0, kw_only=True)


class ElementMatrices(NamedTuple):
    """Matrices of some elements."""

    elements: Selection  #: (n,)
    matrices: Array  #: (n, element dofs, element dofs)


class ElementStress(NamedTuple):
    """A stress that is constant over some elements."""

    elements: Indices  #: (n,)
    stress: Array  #: Voigt, in Pa, shape (3,).


class ElementForces(NamedTuple):
    """Forces on some elements, against the film's face."""

    elements: Selection  #: (n,)
    forces: Array  #: In N, shape (n,).


class CombinedMotion(NamedTuple):
    """Dofs that move together, by a combination of a few functions."""

    dofs: Indices  #: (n,)
    functions: Array  #: The functions' values at the dofs, shape (n, functions).


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints of a term on the dofs. They add no equation, but map unknowns to dofs."""

    #: Dofs that stay zero, shape (n,).
    fixed_dofs: Indices = field(default_factory=NO_INDICES.copy)
    #: Groups of dofs; the dofs of a group have a common value.
    shared_dofs: tuple[Indices, ...] = ()
    motions: tuple[CombinedMotion, ...] = ()
    #: Dofs beside the film that the term moves, (n,). All others stay zero.
    auxiliary_dofs: Indices = field(default_factory=NO_INDICES.copy)
    #: Elements that stay plane, (n,).
    rigid_elements: Indices = field(default_factory=NO_INDICES.copy)

    @property
    def can_tilt(self) -> bool:
        """Whether the rigid elements may tilt, instead of staying horizontal."""
        return len(self.motions) > 0


UNCONSTRAINED = Constraints()


class MatrixAssembler(Protocol):
    """Sums matrices of deflections or of dofs into matrices of the unknowns."""

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """Reduce a matrix (scalar dofs, scalar dofs) of the deflections."""

    def of_dofs(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """Reduce a matrix.

        Returns
        -------
        ndarray, shape (dofs, dofs)
        """


class SolverHints:
    """How a term helps the solver. The defaults suit smooth terms with an energy."""

    def with_frozen_loads(self) -> Self | Term:
        """Return a conservative approximation, whose equilibrium starts the solve."""
        return self

    def relaxed(self) -> Self | Term:
        """Return a smoother approximation, whose equilibrium starts the solve."""
        return self

    def complete_initial_guess(self, x: Array) -> Array:
        """Return the dofs `x` with suitable values of the term's auxiliary dofs."""
        return x


class NonlocalTangent:
    """Parts of a tangent that are no element matrices. By default there are none."""

    def coupled_tangent(self, assembly: MatrixAssembler, state: State) -> sp.csc_matrix | None:
        """Return a sparse part in N/m that couples elements.

        Returns
        -------
        ndarray, shape (unknowns, unknowns)
        """
        return None

    def tangent_column(self, state: State) -> Array | None:
        """Return c of a part c cᵀ that couples many elements, (dofs,) in √(N/m)."""
        return None

    def added_stress(self, state: State) -> ElementStress | None:
        """Return a stress to add to the strain's stress.

        The membrane has the geometric stiffness of the sum.
        """
        return None


class Term(SolverHints, NonlocalTangent, ABC):
    """A summand of the film's potential energy.

    Arrays (dofs,) are forces in N or displacements in m in the film's `Space`; the equilibrium
    decides which dofs are free. A subclass gives `space`, `energy` and `residual`, and the
    `element_tangent` if its forces depend on the displacement.
    """

    space: Space
    #: Whether `residual` is the derivative of `energy`.
    conservative: bool = True
    constraints: Constraints = UNCONSTRAINED

    @abstractmethod
    def energy(self, state: State) -> float:
        """Return the energy in J.

        For a nonconservative load it is minus the work of its present forces.
        """

    @abstractmethod
    def residual(self, state: State) -> Array:
        """Return the derivative of the energy: internal less external forces in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """

    def element_tangent(self, state: State) -> ElementMatrices | None:
        """Return the derivative of `residual` in N/m, element by element; None if it is zero."""
        return None

    # --- derived from the members above; overridden where there is a faster or more exact way

    def element_action(self, state: State, x: Array) -> Array | None:
        """Return the symmetric tangent times the dofs `x` in N.

        None where there is no tangent, and for a nonconservative load: leaving out its small
        tangent keeps the sum over all terms symmetric.

        Returns
        -------
        ndarray, shape (elements, element dofs)
        """
        tangent = self.element_tangent(state) if self.conservative else None
        if tangent is None:
            return None
        actions = np.zeros(self.space.element_dofs.shape)
        local = x[self.space.element_dofs[tangent.elements]]
        actions[tangent.elements] = np.matmul(tangent.matrices, local[..., None])[..., 0]
        return actions

    def action(self, state: State, x: Array) -> Array | None:
        """Return the sum of `element_action` at the dofs in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        forces = self.element_action(state, x)
        return None if forces is None else self.space.sum_at_dofs(forces)

    def diagonal(self, state: State) -> Array | None:
        """Return the diagonal of the symmetric tangent in N/m, (dofs,); None as `action`."""
        tangent = self.element_tangent(state) if self.conservative else None
        if tangent is None:
            return None
        return self.space.sum_at_dofs(np.einsum("eii->ei", tangent.matrices), tangent.elements)

    def energy_along(self, state: State, x: Array) -> Array:
        """Return the energy of the dofs moved by s `x`, as a polynomial in s.

        Parameters
        ----------
        state : State
            The state at s = 0.
        x : ndarray, shape (dofs,)
            The direction in m.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients in J of 1, s, ... s⁴: by default of the second order, which is exact for a
            quadratic energy and for dead loads. They do not hold for a wrinkling film, whose energy
            is no polynomial.
        """
        action = self.action(state, x)
        slope = float(self.residual(state) @ x)
        curvature = 0.0 if action is None else float(action @ x)
        return np.array([self.energy(state), slope, 0.5 * curvature, 0.0, 0.0])


class LoadTerm(Term):
    """External forces, dead or depending on the present displacement.

    A subclass gives `force`, `forces` and `scaled`. A load whose forces follow the film gives
    `element_tangent` as well, and either its `energy` or ``conservative = False`` with a dead load
    in `with_frozen_loads`.
    """

    @property
    @abstractmethod
    def force(self) -> float:
        """Size of the total force on the whole film in N."""

    @abstractmethod
    def forces(self, state: State) -> Array:
        """Return the external forces in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """Return the same load, multiplied by a factor."""

    def energy(self, state: State) -> float:
        """Return the potential of the present forces in J."""
        return -float(self.forces(state) @ state.dofs)

    def residual(self, state: State) -> Array:
        """Return the forces with a minus sign in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return -self.forces(state)

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces | None:
        """Return the forces by which the load compresses the film across its thickness.

        Parameters
        ----------
        state : State
            The state of the film.
        residual : ndarray, shape (dofs,)
            The residual of all terms at this state in N, which has the reactions of constraints.

        Returns
        -------
        ElementForces or None
            None for a load that does not press on a face, as the film's weight.
        """
        return None
