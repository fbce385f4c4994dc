"""The plate term: the film's bending stiffness in von Kármán's equations.

The energy is quadratic in the deflection w and does not depend on the in-plane displacement, so
that the stiffness is a constant matrix; see `pvdf_fem.film.bending.plate_form`.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.bending.plate_form import make_bending_form
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import MatrixAssembler, State, Term
from pvdf_fem.scene.film import Film


class Plate(Term):
    """The bending energy of a film as a plate.

    Parameters
    ----------
    space : Space
        A space of order 2 to 4.
    film : Film
        The film.
    rigid_elements : ndarray, shape (n,)
        Elements under rigid punches, which do not bend.
    rim_tension, punch_tension : float
        Tensions N in N/m that are expected at the rim and at the edges of punches. If elements are
        much larger than the bending length √(D/N), the penalty on the slope dw/dn at the edge
        represents the energy of the bending layer, √(D N)/2 (dw/dn)² per length of the edge.

    Raises
    ------
    ValueError
        If the space has order 1, whose functions have no curvature.
    """

    def __init__(
        self,
        space: Space,
        film: Film,
        rigid_elements: Indices,
        rim_tension: float = 0.0,
        punch_tension: float = 0.0,
    ) -> None:
        self.space = space
        self.film = film
        self.form = make_bending_form(space, film, rigid_elements, rim_tension, punch_tension)
        self._last_tangent: tuple[MatrixAssembler, sp.csc_matrix] | None = None

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """Stiffness of the deflections in N/m, shape (scalar dofs, scalar dofs)."""
        return self.form.matrix

    def energy(self, state: State) -> float:
        """Return the bending energy in J at the dofs of `state`."""
        return self._compute_energy(state.dofs)

    def _compute_energy(self, x: Array) -> float:
        """Compute the bending energy in J at the dofs `x`."""
        w = x[2::3]
        return 0.5 * float(w @ self.form.forces(w))

    def residual(self, state: State) -> Array:
        """Return the bending forces in N at the dofs of `state`.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self._expand_to_dofs(self.form.forces(state.dofs[2::3]))

    def _expand_to_dofs(self, deflection_values: Array) -> Array:
        """Pad values of the deflections, shape (scalar dofs,), with zeros at the in-plane dofs."""
        values = np.zeros(self.space.dof_count)
        values[2::3] = deflection_values
        return values

    def coupled_tangent(self, assembly: MatrixAssembler, state: State) -> sp.csc_matrix:
        """Return the plate's stiffness as a matrix of the unknowns.

        It is not assembled from element matrices, because the penalty on slope jumps couples dofs
        of neighbouring elements. The matrix for the last `assembly` is cached.

        Parameters
        ----------
        assembly : MatrixAssembler
            Reduces the stiffness of the deflections to the unknowns.
        state : State
            Ignored, since the stiffness is constant.

        Returns
        -------
        sparse matrix, shape (unknowns, unknowns)
            In N/m.
        """
        if self._last_tangent is None or self._last_tangent[0] is not assembly:
            self._last_tangent = assembly, assembly.of_deflections(self.matrix)
        return self._last_tangent[1]

    def element_action(self, state: State, x: Array) -> Array:
        """Distribute the bending forces at the dofs `x` to the elements.

        The force at a node is divided equally between the elements around it. `state` is ignored.

        Returns
        -------
        ndarray, shape (elements, element dofs)
            Forces in N.
        """
        nodes = self.space.nodes
        forces = np.zeros((*nodes.shape, 3))
        force_per_element = self.form.forces(x[2::3]) / np.bincount(nodes.ravel())
        forces[..., 2] = force_per_element[nodes]
        return forces.reshape(self.space.element_dofs.shape)

    def action(self, state: State, x: Array) -> Array:
        """Return the constant stiffness times the dofs `x`; `state` is ignored.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self._expand_to_dofs(self.matrix @ x[2::3])

    def diagonal(self, state: State) -> Array:
        """Return the diagonal of the constant stiffness in N/m; `state` is ignored.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self._expand_to_dofs(self.matrix.diagonal())

    def energy_along(self, state: State, x: Array) -> Array:
        """Return the energy as a polynomial in s along the line ``state.dofs + s * x``.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients in J of 1, s, ..., s⁴; the last two are zero. They are computed from the
            factors of the stiffness matrix, with less round-off than in the base class.
        """
        slope = float(x[2::3] @ self.form.forces(state.dofs[2::3]))
        return np.array([self.energy(state), slope, self._compute_energy(x), 0.0, 0.0])
