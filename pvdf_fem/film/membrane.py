"""The membrane term: a geometrically exact film under tension.

`pvdf_fem.film.weak_form` has its equations as scikit-fem forms. Here they are evaluated for all
elements at once on the same basis, quadrature and dofs; a test checks that both agree. The material
laws are in `pvdf_fem.film.laws`.

Symmetric tensors are in Voigt order (11, 22, 12), strains with engineering shear (2 E12).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import ALL, Array, apply_matrix, move_components_first, move_components_last
from pvdf_fem.film.laws.laminate import Laminate
from pvdf_fem.film.term import ElementMatrices, State, Term

#: Deformation gradient of the undeformed film.
IDENTITY: Array = np.eye(3, 2)
#: Pairs of displacement components that have blocks in the tangent; the others are transposes.
COMPONENT_PAIRS = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


class Membrane(Laminate, Term):
    """The membrane's energy, residual and tangent, summed over the plies of a `Laminate`.

    In its states, `State.stress` is that of all plies together: the membrane force in N/m divided
    by the thickness of the film without layers.
    """

    #: Artificial tension, as a fraction of the mean tension, that keeps the tangent of a wrinkling
    #: film regular where it is slack. Other films have none.
    floor = 1e-6
    _last_tangent_stiffness: tuple[State, Array] | None = None

    @cached_property
    def volumes(self) -> Array:
        """Quadrature weights times the film's thickness in m³, shape (elements, points)."""
        return self.film.thickness * self.space.weights

    def state(self, x: Array) -> State:
        """Return the state at the displacement dofs `x` in m, without stress that terms add."""
        gradient = self.space.displacement_gradient(x)
        strain = compute_strain(gradient)
        return State(gradient + IDENTITY, strain, self.resultant(strain), x)

    def constitutive_stress(self, state: State) -> Array:
        """Return the stress of the material law in Pa, without the stress that terms add."""
        return state.stress if state.added is None else state.stress - state.added

    def tangent_stiffness(self, state: State) -> Array:
        """Return the tangent stiffness dS/dE in Pa, at the strain or as the state prescribes it.

        The result for the last state is cached.

        Returns
        -------
        ndarray, shape (3, 3) or (elements, points or 1, 3, 3)
            A single matrix for a linear law and a film without layers.
        """
        if state.tangent_stiffness is not None:
            return state.tangent_stiffness
        if self._last_tangent_stiffness is None or self._last_tangent_stiffness[0] is not state:
            self._last_tangent_stiffness = state, self.resultant_tangent_stiffness(state.strain)
        return self._last_tangent_stiffness[1]

    def energy(self, state: State) -> float:
        """Return the stored energy in J."""
        return self.stored_energy(state.strain, self.volumes)

    def residual(self, state: State) -> Array:
        """Return the internal forces in N, without those of the flat film's prestress.

        The forces of a uniform prestress cancel at every dof inside the rim. Their sum in floating
        point would leave round-off that exceeds the forces of a small load and moves a flat film.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self.internal_forces(state) - self._prestress_forces

    @cached_property
    def _prestress_forces(self) -> Array:
        """Forces in N of the flat film's uniform stress, shape (dofs,).

        They are zero inside the rim up to round-off. If the stress of the flat film is not uniform,
        its mean is taken, whose forces are in equilibrium, too.
        """
        flat = self.resultant(np.zeros((*self.volumes.shape, 3)))
        mean = np.einsum("epi,ep->i", flat, self.volumes) / self.volumes.sum()
        is_uniform = np.abs(flat - mean).max() <= 1e-12 * np.abs(mean).max()  # up to round-off
        stress = flat if is_uniform else np.broadcast_to(mean, flat.shape)
        undeformed = np.broadcast_to(IDENTITY, (*self.volumes.shape, 3, 2))
        return self.space.sum_at_dofs(
            self.space.integrate_flux(self._compute_piola(undeformed, stress))
        )

    def internal_forces(self, state: State) -> Array:
        """Return the internal forces of the constitutive stress in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        flux = self._compute_piola(state.deformation_gradient, self.constitutive_stress(state))
        return self.space.sum_at_dofs(self.space.integrate_flux(flux))

    def element_action(self, state: State, x: Array) -> Array:
        """Multiply the element tangents by the dofs `x`.

        The matrices are not formed, except those of the artificial tension in a wrinkling film.

        Returns
        -------
        ndarray, shape (elements, element dofs)
            Forces in N.
        """
        F = state.deformation_gradient
        step = self.space.displacement_gradient(x)
        stress_rate = apply_matrix(self.tangent_stiffness(state), compute_strain_rate(F, step))
        flux = self._compute_piola(step, state.stress) + self._compute_piola(F, stress_rate)
        forces = self.space.integrate_flux(flux)
        if self.law.wrinkles:
            forces += apply_matrix(self._compute_damping(state), x[self.space.element_dofs])
        return forces

    def diagonal(self, state: State) -> Array:
        """Return the diagonal of the tangent in N/m, summed over the elements.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self.space.sum_at_dofs(self.element_diagonal(state))

    def element_diagonal(self, state: State) -> Array:
        """Return the diagonals of the element tangents in N/m.

        Returns
        -------
        ndarray, shape (elements, element dofs)
        """
        stiffness = self.tangent_stiffness(state)
        factors = np.empty((*self.volumes.shape, 3, 3))
        for i in range(3):
            d11, d12, _, d22 = self._differentiate_piola(state, stiffness, i, i)  # d21 equals d12
            factors[..., i] = np.concatenate([d11, 2.0 * d12, d22], axis=-1)
        rows = self.space.gradient_rows
        g1, g2 = rows[:, 0::2], rows[:, 1::2]
        # each point adds d11 g1² + 2 d12 g1 g2 + d22 g2² to the diagonal
        squares = np.stack([g1**2, g1 * g2, g2**2], axis=2)
        elements, points, _, functions = squares.shape
        squares = squares.reshape(elements, 3 * points, functions)
        diagonal = np.matmul(squares.swapaxes(1, 2), factors.reshape(elements, 3 * points, 3))
        diagonal = diagonal.reshape(elements, -1)
        if self.law.wrinkles:
            diagonal += np.einsum("eii->ei", self._compute_damping(state))
        return diagonal

    def element_tangent(self, state: State) -> ElementMatrices:
        """Return the tangent matrices of all elements in N/m."""
        return ElementMatrices(ALL, self.tangent_matrices(state))

    def tangent_matrices(self, state: State, chunk_size: int = 128) -> Array:
        """Compute the tangent matrices of all elements.

        Parameters
        ----------
        state : State
            The state of the film.
        chunk_size : int
            Number of elements that are computed at a time, so that their arrays fit into the
            processor's cache.

        Returns
        -------
        ndarray, shape (elements, element dofs, element dofs)
            Tangents in N/m. For a wrinkling film they include an artificial tension, which keeps
            them regular where the film is slack. The residual does not include it, so that it
            changes no solution.
        """
        count = len(self.space.gradient_rows)
        functions = self.space.gradient_rows.shape[-1]
        stiffness = self.tangent_stiffness(state)
        blocks = np.empty((count, functions, 3, functions, 3))
        for first in range(0, count, chunk_size):
            chunk = slice(first, first + chunk_size)
            products = self._multiply_tangents(state, stiffness, chunk)
            for k, (i, j) in enumerate(COMPONENT_PAIRS):
                blocks[chunk, :, i, :, j] = products[:, :, k]
                blocks[chunk, :, j, :, i] = products[:, :, k].swapaxes(1, 2)
        matrices = blocks.reshape(count, 3 * functions, 3 * functions)
        return matrices + self._compute_damping(state) if self.law.wrinkles else matrices

    def _multiply_tangents(self, state: State, stiffness: Array, chunk: slice) -> Array:
        """Compute the tangents of a chunk of elements, a block for each pair of components.

        Parameters
        ----------
        state : State
            The state of the film.
        stiffness : ndarray, shape (3, 3) or (elements, points, 3, 3)
            Tangent stiffness dS/dE in Pa.
        chunk : slice
            Range of element numbers.

        Returns
        -------
        ndarray, shape (elements, functions, component pairs, functions)
            Blocks in N/m, in the order of `COMPONENT_PAIRS`.
        """
        rows = self.space.gradient_rows[chunk]
        elements, lines, functions = rows.shape
        g1, g2 = rows[:, 0::2], rows[:, 1::2]
        fluxes = np.empty((elements, lines // 2, 2, len(COMPONENT_PAIRS), functions))
        for k, (i, j) in enumerate(COMPONENT_PAIRS):
            d11, d12, d21, d22 = self._differentiate_piola(state, stiffness, i, j, chunk)
            fluxes[:, :, 0, k] = d11 * g1 + d12 * g2
            fluxes[:, :, 1, k] = d21 * g1 + d22 * g2
        products = np.matmul(rows.swapaxes(1, 2), fluxes.reshape(elements, lines, -1))
        return products.reshape(elements, functions, len(COMPONENT_PAIRS), functions)

    def _differentiate_piola(
        self, state: State, stiffness: Array, i: int, j: int, chunk: slice = ALL
    ) -> tuple[Array, Array, Array, Array]:
        """Differentiate row i of the first Piola-Kirchhoff stress F S with respect to row j of F.

        Parameters
        ----------
        state : State
            The state of the film.
        stiffness : ndarray, shape (3, 3) or (elements, points, 3, 3)
            Tangent stiffness dS/dE in Pa. A single matrix is that of an orthotropic film in its
            axes, in which shear and normal strain do not couple.
        i, j : int
            Displacement components.
        chunk : slice
            Range of element numbers.

        Returns
        -------
        d11, d12, d21, d22 : ndarray, shape (elements, points, 1)
            d_ab is the derivative of (F S)_ia with respect to F_jb in Pa, times `volumes` in m³.
        """
        weight = self.volumes[chunk, :, None]
        F, stress = state.deformation_gradient[chunk], state.stress[chunk]
        a1, a2 = F[..., i, 0, None], F[..., i, 1, None]
        b1, b2 = F[..., j, 0, None], F[..., j, 1, None]
        kronecker = float(i == j)  # the stress acts on equal components only
        s11, s22, s12 = (stress[..., k, None] * kronecker for k in range(3))
        C = stiffness if stiffness.ndim == 2 else stiffness[chunk]
        c11, c12 = C[..., 0, 0, None], C[..., 0, 1, None]
        c22, c33 = C[..., 1, 1, None], C[..., 2, 2, None]
        d11 = c11 * a1 * b1 + c33 * a2 * b2 + s11
        d12 = c12 * a1 * b2 + c33 * a2 * b1 + s12
        d21 = c12 * a2 * b1 + c33 * a1 * b2 + s12
        d22 = c22 * a2 * b2 + c33 * a1 * b1 + s22
        if stiffness.ndim > 2:
            c13, c23 = C[..., 0, 2, None], C[..., 1, 2, None]
            d11 = d11 + c13 * (a1 * b2 + a2 * b1)
            d12 = d12 + c13 * a1 * b1 + c23 * a2 * b2
            d21 = d21 + c13 * a1 * b1 + c23 * a2 * b2
            d22 = d22 + c23 * (a1 * b2 + a2 * b1)
        return weight * d11, weight * d12, weight * d21, weight * d22

    def energy_along(self, state: State, x: Array) -> Array:
        """Return the stored energy as a polynomial in s along the line ``state.dofs + s * x``.

        Parameters
        ----------
        state : State
            The state at s = 0.
        x : ndarray, shape (dofs,)
            The direction in m.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients in J of 1, s, ..., s⁴, with the tangent stiffness of the state. They are
            exact for a linear law: the strain is quadratic in s, and the energy is quadratic in
            the strain.
        """
        step = self.space.displacement_gradient(x)
        stiffness = self.tangent_stiffness(state)
        volumes = self.volumes[..., None]
        # strain = E + s first + s² second
        first = compute_strain_rate(state.deformation_gradient, step)
        second = compute_strain(step) - compute_strain_rate(IDENTITY, step)

        def integrate(stress: Array, strain: Array) -> float:
            return float((stress * strain * volumes).sum())

        stress = self.constitutive_stress(state)
        stress_first = apply_matrix(stiffness, first)
        stress_second = apply_matrix(stiffness, second)
        return np.array(
            [
                self.energy(state),
                integrate(stress, first),
                integrate(stress, second) + 0.5 * integrate(stress_first, first),
                integrate(stress_first, second),
                0.5 * integrate(stress_second, second),
            ]
        )

    def _compute_piola(self, deformation_gradient: Array, stress: Array) -> Array:
        """Return the first Piola-Kirchhoff stress F S times `volumes`.

        Parameters
        ----------
        deformation_gradient : ndarray, shape (elements, points, 3, 2)
            Deformation gradient F.
        stress : ndarray, shape (elements, points, 3)
            Second Piola-Kirchhoff stress S in Pa.

        Returns
        -------
        ndarray, shape (2, 3, elements, points)
            In N m: the first index is the direction in the reference plane, the second the
            displacement component.
        """
        s11, s22, s12 = (stress[..., i] * self.volumes for i in range(3))
        f1, f2 = move_components_first(deformation_gradient, 2).swapaxes(0, 1)
        return np.stack([s11 * f1 + s12 * f2, s12 * f1 + s22 * f2])

    @cached_property
    def _laplace_matrices(self) -> Array:
        """Element matrices of the integral of grad v : grad u, which do not depend on the state."""
        return self.space.laplace_matrices()

    def _compute_damping(self, state: State) -> Array:
        """Return the element tangents of the artificial tension.

        Returns
        -------
        ndarray, shape (elements, element dofs, element dofs)
            Matrices in N/m.
        """
        return (state.damping + self.floor) * self.mean_tension(state) * self._laplace_matrices

    def mean_tension(self, state: State, min_strain: float = 1e-16) -> float:
        """Return the tension in N/m, averaged over the film and both principal directions.

        It is at least h C11 `min_strain`, and so positive if the film is slack everywhere.
        """
        mean = 0.5 * state.stress[..., :2].sum(axis=-1)
        average = float((mean * self.volumes).sum() / self.volumes.sum())
        return self.film.thickness * max(average, min_strain * self.law.stiffness[0, 0])

    def with_predicted_stress(self, state: State, stress: Array, damping: float) -> State:
        """Return a copy of a state from which a damped tangent with a predicted stress is computed.

        The copy's tangent stiffness dS/dE is that of `state`.

        Parameters
        ----------
        state : State
            The state to copy.
        stress : ndarray, shape (elements, points, 3)
            The stress in Pa that is predicted for the next step.
        damping : float
            Artificial tension as a fraction of the mean tension, in addition to `floor`.
        """
        return replace(
            state, stress=stress, tangent_stiffness=self.tangent_stiffness(state), damping=damping
        )


def compute_strain(gradient: Array) -> Array:
    """Compute the Green-Lagrange strain of a displacement gradient.

    Parameters
    ----------
    gradient : ndarray, shape (..., 3, 2)
        Displacement gradient; it may be complex (for complex-step derivatives).

    Returns
    -------
    ndarray, shape (..., 3)
        E11, E22 and 2 E12.
    """
    return compute_strain_rate(IDENTITY + 0.5 * gradient, gradient)


def compute_strain_rate(deformation_gradient: Array, step: Array) -> Array:
    """Compute sym(Fᵀ grad v), the derivative of the Green-Lagrange strain along v.

    Parameters
    ----------
    deformation_gradient : ndarray, shape (..., 3, 2)
        Deformation gradient F.
    step : ndarray, shape (..., 3, 2)
        Gradient of the displacement v.

    Returns
    -------
    ndarray, shape (..., 3)
        Components 11, 22 and twice 12.
    """
    f1, f2 = deformation_gradient[..., 0], deformation_gradient[..., 1]
    v1, v2 = step[..., 0], step[..., 1]
    shear = _dot(f1, v2) + _dot(f2, v1)
    return move_components_last(np.stack([_dot(f1, v1), _dot(f2, v2), shear]), 1)


def _dot(a: Array, b: Array) -> Array:
    """Return the scalar product over the last axis, written out because that is faster."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def compute_principal_values(tensor: Array) -> tuple[Array, Array]:
    """Compute the principal values of plane symmetric tensors.

    Parameters
    ----------
    tensor : ndarray, shape (..., 3)
        Components 11, 22 and 12 (not twice 12).

    Returns
    -------
    smaller, larger : ndarray, shape (...)
        The two principal values.
    """
    mean = 0.5 * (tensor[..., 0] + tensor[..., 1])
    radius = np.hypot(0.5 * (tensor[..., 0] - tensor[..., 1]), tensor[..., 2])
    return mean - radius, mean + radius


def compute_tensile_part(stress: Array) -> Array:
    """Return stresses with their negative principal values replaced by zero.

    Parameters
    ----------
    stress : ndarray, shape (..., 3)
        Components 11, 22 and 12.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    smaller, larger = compute_principal_values(stress)
    smallest, largest = smaller[..., None], larger[..., None]
    # if both are equal, the projector is multiplied by zero or not used; avoid dividing by zero
    difference = np.where(largest > smallest, largest - smallest, 1.0)
    projector = (stress - smallest * np.array([1.0, 1.0, 0.0])) / difference
    return np.where(smallest >= 0.0, stress, np.maximum(largest, 0.0) * projector)
