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
    """The fields of one displacement at the quadrature points of all elements."""

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


class Assembly(Protocol):
    """Sums matrices of elements, or of deflections, into matrices of the unknowns."""

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """From a matrix (scalar dofs, scalar dofs) of the deflections."""


class Term(ABC):
    """One summand of the potential energy, or the forces of one load.

    All arrays of the size of the dofs are forces in N or displacements in m of the film's `Space`;
    which of the dofs are free is the equilibrium's business. The defaults are those of a load that
    does not depend on the displacement.
    """

    space: Space
    #: Whether `residual` derives from `energy`.
    conservative: bool = True
    #: Whether `residual` is no more than -`forces` while the film is flat, whatever the mesh.
    rests_flat: bool = False
    #: Dofs that the term holds at zero, (n,).
    fixed_dofs: Indices = np.empty(0, dtype=np.int64)
    #: Groups of dofs that it lets move by one common value each.
    shared_dofs: tuple[Indices, ...] = ()
    #: Dofs that it lets move by sums of functions: (n,), and the functions' values there, (n, m).
    modes: tuple[tuple[Indices, Array], ...] = ()

    @property
    def force(self) -> float:
        """Size in N of the force that the term applies to the whole film; 0 unless it is a load."""
        return 0.0

    def forces(self, state: State) -> Array | None:
        """External forces of a load in N, (dofs,), which `residual` has with a minus sign."""
        return None

    def held(self) -> Term:
        """A conservative term near this one, whose equilibrium is a start for this one's."""
        return self

    def scaled(self, factor: float) -> Term:
        """The term with its load times a factor; what is no load is as before."""
        return self

    @abstractmethod
    def energy(self, state: State) -> float:
        """Energy in J; of a load that is not conservative, that of its forces held as they are."""

    @abstractmethod
    def residual(self, state: State) -> Array:
        """Derivative of the energy by the dofs: internal less external forces in N, (dofs,)."""

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        """Elements, and their derivatives (elements, dofs, dofs) of `residual` in N/m."""
        return None

    def coupled_tangent(self, assembly: Assembly) -> sp.csc_matrix | None:
        """The constant part of the tangent that couples elements, of the unknowns in N/m."""
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

        None of a load: the small tangent of one that follows the film is left out, so that the sum
        of all terms is symmetric.
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
