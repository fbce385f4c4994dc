"""The interface of the terms of the film's potential energy.

At an equilibrium the sum of all terms is stationary. A term needs an energy and its derivative,
`Term.residual`; a load needs its forces. All other members have defaults that a term may override:

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
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.patch import Patch

NO_INDICES: Indices = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class State:
    """A displacement, with its deformation, strain and stress at the quadrature points."""

    #: Deformation gradient F, shape (elements, points, 3, 2).
    deformation_gradient: Array
    #: Green-Lagrange strain, Voigt with engineering shear, shape (elements, points, 3).
    strain: Array
    #: Second Piola-Kirchhoff stress in Pa, Voigt, including the stress that terms add, shape
    #: (elements, points, 3).
    stress: Array
    #: The displacement in m, shape (dofs,).
    dofs: Array
    #: Stress in Pa that terms add to the constitutive stress, shape (elements, 1, 3); None if no
    #: term adds any.
    added: Array | None = field(default=None, kw_only=True)
    #: Prescribed tangent stiffness dS/dE in Pa; None if it is to be computed from the strain.
    tangent_stiffness: Array | None = field(default=None, kw_only=True)
    #: Additional artificial tension in the tangent of a wrinkling film, as a fraction of its mean
    #: tension.
    damping: float = field(default=0.0, kw_only=True)


class ElementMatrices(NamedTuple):
    """Element matrices of some elements."""

    elements: Selection  #: Numbers of the elements, shape (n,), or a slice.
    matrices: Array  #: Shape (n, element dofs, element dofs).


class ElementStress(NamedTuple):
    """A stress that is uniform over some elements."""

    elements: Indices  #: Numbers of the elements, shape (n,).
    stress: Array  #: Voigt, in Pa, shape (3,).


class ElementForces(NamedTuple):
    """Forces along z that press on the film's faces, one for each element listed."""

    elements: Selection  #: Numbers of the elements, shape (n,), or a slice.
    forces: Array  #: In N, shape (n,).


class CombinedMotion(NamedTuple):
    """Dofs whose values are a linear combination of a few functions, such as a rigid tilt."""

    dofs: Indices  #: Numbers of the dofs, shape (n,).
    functions: Array  #: Values of the functions at the dofs, shape (n, functions).


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints of a term on the dofs. They are eliminated, so that they add no equations."""

    #: Dofs that stay zero, shape (n,).
    fixed_dofs: Indices = field(default_factory=NO_INDICES.copy)
    #: Groups of dofs; all dofs of a group have the same value.
    shared_dofs: tuple[Indices, ...] = ()
    #: Groups of dofs that move by combinations of functions.
    motions: tuple[CombinedMotion, ...] = ()
    #: Auxiliary dofs that the term moves, shape (n,). Auxiliary dofs of no term stay zero.
    auxiliary_dofs: Indices = field(default_factory=NO_INDICES.copy)
    #: Elements that a rigid body keeps plane, shape (n,).
    rigid_elements: Indices = field(default_factory=NO_INDICES.copy)

    @property
    def can_tilt(self) -> bool:
        """Whether the rigid elements may tilt, instead of staying horizontal."""
        return len(self.motions) > 0


UNCONSTRAINED = Constraints()


class MatrixAssembler(Protocol):
    """An object that reduces matrices of deflections or of dofs to matrices of the unknowns."""

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """Reduce a matrix of the deflections, shape (nodes, nodes), with auxiliary nodes."""

    def of_dofs(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """Reduce a matrix of all dofs, shape (dofs, dofs)."""


class SolverHints:
    """Hints for initial guesses; the defaults suit smooth terms with an energy."""

    def with_frozen_loads(self) -> Self | Term:
        """Return a conservative approximation, such as a dead load for a follower load.

        Its equilibrium is the initial guess of the solve. Default: the term itself.
        """
        return self

    def relaxed(self) -> Self | Term:
        """Return an approximation of a term that changes less abruptly, such as a softer contact.

        Its equilibrium is the initial guess of the solve. Default: the term itself.
        """
        return self

    def complete_initial_guess(self, x: Array) -> Array:
        """Return a better initial guess near the dofs `x`.

        A term may set its auxiliary dofs or reduce the deflection, so that its forces nearly
        balance. Default: `x` itself.
        """
        return x


class NonlocalTangent:
    """Parts of a term's tangent that are not element matrices; by default there are none."""

    def coupled_tangent(self, assembly: MatrixAssembler, state: State) -> sp.csc_matrix | None:
        """Return the part of the tangent that couples dofs of several elements. Default: None.

        Parameters
        ----------
        assembly : MatrixAssembler
            Reduces the matrix to the unknowns.
        state : State
            The state at which the tangent is taken.

        Returns
        -------
        sparse matrix, shape (unknowns, unknowns), or None
            In N/m.
        """
        return None

    def tangent_column(self, state: State) -> Array | None:
        """Return the vector c of a rank-one part c cᵀ of the tangent. Default: None.

        Returns
        -------
        ndarray, shape (dofs,), or None
            In √(N/m).
        """
        return None

    def added_stress(self, state: State) -> ElementStress | None:
        """Return a stress to add to the constitutive stress of the film. Default: None.

        The added stress enters the geometric stiffness in the membrane's tangent, but not the
        membrane's residual: the term's own residual has its forces.
        """
        return None


class Term(SolverHints, NonlocalTangent, ABC):
    """A summand of the film's potential energy.

    Vectors of shape (dofs,) are forces in N or displacements in m in the film's `Space`; the
    equilibrium decides which dofs are free. Subclasses define `space`, `energy` and `residual`, and
    `element_tangent` if their forces depend on the displacement.
    """

    space: Space
    #: Whether `residual` is the derivative of `energy`.
    conservative: bool = True
    constraints: Constraints = UNCONSTRAINED

    @abstractmethod
    def energy(self, state: State) -> float:
        """Return the energy in J.

        For a nonconservative load it is the potential of its present forces, held constant.
        """

    @abstractmethod
    def residual(self, state: State) -> Array:
        """Return the derivative of the energy with respect to the dofs in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """

    def element_tangent(self, state: State) -> ElementMatrices | None:
        """Return the derivative of `residual` with respect to the dofs, by element, in N/m.

        Default: None, for a term whose forces do not depend on the displacement.
        """
        return None

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces | None:
        """Return the forces that press on the film's faces, element by element.

        They compress the film across its thickness, which causes a charge through d33.

        Parameters
        ----------
        state : State
            The state of the film.
        residual : ndarray, shape (dofs,)
            The residual of all terms at this state in N. At constrained dofs it contains the
            reactions, from which a rigid punch computes its forces.

        Returns
        -------
        ElementForces or None
            Default: None, for a term that does not press on a face, such as the film's weight.
        """
        return None

    # --- derived from the members above; a term may override them with faster or more exact methods

    def element_action(self, state: State, x: Array) -> Array | None:
        """Multiply the element tangents by the dofs `x`.

        Returns
        -------
        ndarray, shape (elements, element dofs), or None
            Forces in N, or None if the term has no tangent or is a nonconservative load, whose
            small, asymmetric tangent is left out to keep the sum over all terms symmetric.
        """
        tangent = self.element_tangent(state) if self.conservative else None
        if tangent is None:
            return None
        actions = np.zeros(self.space.element_dofs.shape)
        local = x[self.space.element_dofs[tangent.elements]]
        actions[tangent.elements] = np.matmul(tangent.matrices, local[..., None])[..., 0]
        return actions

    def action(self, state: State, x: Array) -> Array | None:
        """Multiply the tangent by the dofs `x`: the sum of `element_action` over the elements.

        Returns
        -------
        ndarray, shape (dofs,), or None
            Forces in N. None if `element_action` is None.
        """
        forces = self.element_action(state, x)
        return None if forces is None else self.space.sum_at_dofs(forces)

    def diagonal(self, state: State) -> Array | None:
        """Return the diagonal of the symmetric tangent, or None if `action` is None.

        Returns
        -------
        ndarray, shape (dofs,), or None
            In N/m.
        """
        tangent = self.element_tangent(state) if self.conservative else None
        if tangent is None:
            return None
        return self.space.sum_at_dofs(np.einsum("eii->ei", tangent.matrices), tangent.elements)

    def energy_along(self, state: State, x: Array) -> Array:
        """Return the energy as a polynomial in s along the line ``state.dofs + s * x``.

        Parameters
        ----------
        state : State
            The state at s = 0.
        x : ndarray, shape (dofs,)
            The direction in m.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients in J of 1, s, ..., s⁴. The default is the Taylor polynomial of second
            order, which is exact for a quadratic energy and for dead loads. For a wrinkling film,
            whose energy is not a polynomial, it is an approximation.
        """
        action = self.action(state, x)
        slope = float(self.residual(state) @ x)
        curvature = 0.0 if action is None else float(action @ x)
        return np.array([self.energy(state), slope, 0.5 * curvature, 0.0, 0.0])


class LoadTerm(Term):
    """A term of external forces, which may depend on the displacement.

    Subclasses define `force`, `forces` and `scaled`. A load whose forces follow the film also
    defines `element_tangent`, and either its `energy` or ``conservative = False`` together with
    `with_frozen_loads`, which returns a dead load.
    """

    @property
    @abstractmethod
    def force(self) -> float:
        """Magnitude of the total force on the whole film in N."""

    @abstractmethod
    def forces(self, state: State) -> Array:
        """Return the external forces in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """Return a copy of the load whose force is multiplied by a factor."""

    def energy(self, state: State) -> float:
        """Return minus the work of the present forces, held constant, in J."""
        return -float(self.forces(state) @ state.dofs)

    def residual(self, state: State) -> Array:
        """Return the residual of the load in N, the negative of its external forces.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return -self.forces(state)


class Support(Term):
    """A term of something outside of the film that holds it besides the rim, such as a backing.

    Its forces are reactions, not loads: they count in the balance of forces. It has no mass and no
    losses.

    Parameters
    ----------
    table : Film or Patch
        The table of the scene that describes the support.
    space : Space
        The finite-element space.
    elements : slice or ndarray, shape (n,)
        Numbers of the elements that the support holds.
    """

    @abstractmethod
    def __init__(self, table: Film | Patch, space: Space, elements: Selection) -> None: ...
