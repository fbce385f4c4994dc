"""A term of the film's potential energy; an equilibrium makes the sum of all terms stationary."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Selection
from pvdf_fem.film.space import Space


@dataclass(frozen=True)
class State:
    """Deformation, strain and stress of a displacement at the quadrature points of the elements."""

    #: (elements, points, 3, 2)
    deformation_gradient: Array
    #: Green-Lagrange strain, Voigt with engineering shear, (elements, points, 3).
    strain: Array
    #: Second Piola-Kirchhoff stress in Pa, Voigt, (elements, points, 3), all that terms add to it.
    stress: Array
    #: The displacement in m, (dofs,).
    dofs: Array
    #: What terms add to the stress of the strain, if they do, (elements, 1, 3).
    added: Array | None = field(default=None, kw_only=True)
    #: Moduli in place of those of the strain, in Pa, where a tangent is to have others.
    moduli: Array | None = field(default=None, kw_only=True)
    #: Tension that a tangent has everywhere, over the film's mean tension.
    damping: float = field(default=0.0, kw_only=True)


class Assembly(Protocol):
    """Sums matrices of elements, or of deflections, into matrices of the unknowns."""

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """From a matrix (scalar dofs, scalar dofs) of the deflections."""

    def of_dofs(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """From a matrix (dofs, dofs)."""


class Term(ABC):
    """A summand of the potential energy, or a load given by its forces.

    All arrays of the size of the dofs are forces in N or displacements in m of the film's `Space`;
    which of the dofs are free is the equilibrium's business. The defaults are those of a load that
    does not depend on the displacement.
    """

    space: Space
    #: Whether `residual` derives from `energy`.
    conservative: bool = True
    #: Dofs beside the film that the term moves, (n,).
    own_dofs: Indices = np.empty(0, dtype=np.int64)
    #: Dofs that the term holds at zero, (n,).
    fixed_dofs: Indices = np.empty(0, dtype=np.int64)
    #: Groups of dofs; the dofs within a group move by a common value.
    shared_dofs: tuple[Indices, ...] = ()
    #: Dofs that it lets move by sums of functions: (n,), and the functions' values there, (n, m).
    modes: tuple[tuple[Indices, Array], ...] = ()
    #: Elements that the term keeps straight, (n,).
    rigid_patch: Indices = np.empty(0, dtype=np.int64)

    @property
    def force(self) -> float:
        """Size in N of the force that the term applies to the whole film; 0 unless it is a load."""
        return 0.0

    def forces(self, state: State) -> Array | None:
        """External forces of a load in N, (dofs,), which `residual` has with a minus sign."""
        return None

    def held(self) -> Term:
        """A conservative approximation of the term, whose equilibrium starts the solve."""
        return self

    def softer(self) -> Term:
        """An approximation of the term that changes less abruptly, whose equilibrium starts the
        solve."""
        return self

    def started(self, x: Array) -> Array:
        """The dofs `x` with values of the term's own dofs that suit the film."""
        return x

    def reach(self, state: State) -> float:
        """Largest distance in m from the film's centre at which a tip touches; 0 of other terms."""
        return 0.0

    def pressed(self, state: State, film_forces: Array) -> tuple[Selection, Array] | None:
        """Elements, and the force in N that presses each of them against the film's face, (n,), by
        the film's forces less those of loads, (dofs,)."""
        return None

    def scaled(self, factor: float) -> Term:
        """The term with its load times a factor; what is no load is as before."""
        return self

    @abstractmethod
    def energy(self, state: State) -> float:
        """Energy in J; a load that is not conservative returns minus the work of current forces."""

    @abstractmethod
    def residual(self, state: State) -> Array:
        """Derivative of the energy by the dofs: internal less external forces in N, (dofs,)."""

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        """Elements, and their derivatives (elements, dofs, dofs) of `residual` in N/m."""
        return None

    def coupled_tangent(self, assembly: Assembly, state: State) -> sp.csc_matrix | None:
        """The part of the tangent that couples elements, of the unknowns in N/m."""
        return None

    def added_stress(self, state: State) -> tuple[Indices, Array] | None:
        """Elements, and the stress (3,) in Pa that it adds to that of the strain there. Its
        geometric stiffness is then the membrane's business."""
        return None

    def tangent_column(self, state: State) -> Array | None:
        """c of a part c cᵀ of the tangent that couples many elements, (dofs,) in √(N/m)."""
        return None

    def element_action(self, state: State, x: Array) -> Array | None:
        """The film's tangent times the dofs `x`, (elements, dofs of an element), in N.

        None for a load: the small tangent of a follower load is left out to keep the sum of the
        tangents symmetric.
        """
        return None

    def action(self, state: State, x: Array) -> Array | None:
        """The same as `element_action` at the dofs, (dofs,)."""
        forces = self.element_action(state, x)
        return None if forces is None else self.space.sum(forces)

    def diagonal(self, state: State) -> Array | None:
        """Diagonal of the tangent that `element_action` is of, (dofs,) in N/m; None of a load."""
        return None

    @abstractmethod
    def along(self, state: State, x: Array) -> Array:
        """Coefficients (5,), lowest power first, of the energy in s at the dofs moved by s `x`.

        They do not hold for a film that wrinkles, whose energy is no polynomial.
        """


class Load(Term):
    """A term of external forces that no displacement, or only the present one, decides."""

    @abstractmethod
    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""

    def energy(self, state: State) -> float:
        """The potential of the load in J."""
        return -float(self.forces(state) @ state.dofs)

    def residual(self, state: State) -> Array:
        """The forces in N, (dofs,), with a minus sign."""
        return -self.forces(state)

    def along(self, state: State, x: Array) -> Array:
        """Coefficients (5,) of the load's potential along `x`, its forces held as they are."""
        forces = self.forces(state)
        return np.array([-forces @ state.dofs, -forces @ x, 0.0, 0.0, 0.0])
