"""A term of the film's potential energy; an equilibrium makes the sum over terms stationary."""

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
    #: Second Piola-Kirchhoff stress in Pa, Voigt, (elements, points, 3), with everything added by
    #: terms.
    stress: Array
    #: The displacement in m, (dofs,).
    dofs: Array
    #: Stress added by terms to the strain's stress, if present, (elements, 1, 3).
    added: Array | None = field(default=None, kw_only=True)
    #: Moduli in Pa that replace the strain's moduli in a tangent.
    moduli: Array | None = field(default=None, kw_only=True)
    #: Tension that a tangent has everywhere, over the film's mean tension.
    damping: float = field(default=0.0, kw_only=True)


class Assembly(Protocol):
    """Sums matrices for elements or for deflections into matrices for unknowns."""

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """From a matrix (scalar dofs, scalar dofs) of the deflections."""

    def of_dofs(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """From a matrix (dofs, dofs)."""


class Term(ABC):
    """A summand of the potential energy, or a load given by its forces.

    Arrays (dofs,) are forces in N or displacements in m in the film's `Space`;
    the equilibrium decides which dofs are free. The defaults describe a load that does not depend
    on the displacement.
    """

    space: Space
    #: Whether `residual` derives from `energy`.
    conservative: bool = True
    #: Dofs beside the film that the term moves, (n,).
    auxiliary_dofs: Indices = np.empty(0, dtype=np.int64)
    #: Dofs that the term holds at zero, (n,).
    fixed_dofs: Indices = np.empty(0, dtype=np.int64)
    #: Groups of dofs; the dofs within a group move by a common value.
    shared_dofs: tuple[Indices, ...] = ()
    #: Dofs (n,) that move by sums of functions, and the functions' values there, (n, m).
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

    def with_frozen_loads(self) -> Term:
        """A conservative approximation: its equilibrium starts the solve."""
        return self

    def relaxed(self) -> Term:
        """A smoother approximation: its equilibrium starts the solve."""
        return self

    def complete_initial_guess(self, x: Array) -> Array:
        """The dofs `x` with values of the term's own dofs that suit the film."""
        return x

    def reach(self, state: State) -> float:
        """Largest distance in m from the film's centre at which a tip touches; 0 of other terms."""
        return 0.0

    def pressed(self, state: State, film_forces: Array) -> tuple[Selection, Array] | None:
        """Elements, and their forces in N against the film's face, (n,), from the residual
        (dofs,)."""
        return None

    def scaled(self, factor: float) -> Term:
        """The term with its load times a factor; what is no load is as before."""
        return self

    @abstractmethod
    def energy(self, state: State) -> float:
        """Energy in J; a nonconservative load returns minus the work of its current forces."""

    @abstractmethod
    def residual(self, state: State) -> Array:
        """Derivative of the energy by the dofs: internal less external forces in N, (dofs,)."""

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        """Elements, and their derivatives (elements, dofs, dofs) of `residual` in N/m."""
        return None

    def coupled_tangent(self, assembly: Assembly, state: State) -> sp.csc_matrix | None:
        """The part of the tangent in N/m that couples elements, for the unknowns."""
        return None

    def added_stress(self, state: State) -> tuple[Indices, Array] | None:
        """Elements, and the stress (3,) in Pa added there to the strain's stress. Its
        geometric stiffness is then the membrane's business."""
        return None

    def tangent_column(self, state: State) -> Array | None:
        """c in a part c cᵀ of the tangent that couples many elements, (dofs,) in √(N/m)."""
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
        """Diagonal of the tangent in `element_action`, (dofs,) in N/m; None of a load."""
        return None

    @abstractmethod
    def energy_along(self, state: State, x: Array) -> Array:
        """Coefficients (5,), lowest power first, of the energy in s at the dofs moved by s `x`.

        They do not hold for a wrinkling film: its energy is no polynomial.
        """


class Load(Term):
    """A term with external forces that depend on no displacement or on the present displacement."""

    @abstractmethod
    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""

    def energy(self, state: State) -> float:
        """The potential of the load in J."""
        return -float(self.forces(state) @ state.dofs)

    def residual(self, state: State) -> Array:
        """The forces in N, (dofs,), with a minus sign."""
        return -self.forces(state)

    def energy_along(self, state: State, x: Array) -> Array:
        """Coefficients (5,) of the load's potential along `x`, with fixed forces."""
        forces = self.forces(state)
        return np.array([-forces @ state.dofs, -forces @ x, 0.0, 0.0, 0.0])
