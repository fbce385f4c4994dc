"""The membrane term: a geometrically exact film under tension.

`pvdf_fem.film.weak_form` has its equations as scikit-fem forms. Here they are evaluated for all
elements at once on the same basis, quadrature and dofs; a test holds the two equal. The material
laws are in `pvdf_fem.film.laws`.

Symmetric tensors are in Voigt order (11, 22, 12), strains with engineering shear (2 E12).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import (
    ALL,
    Array,
    apply_matrix,
    move_components_first,
    move_components_last,
)
from pvdf_fem.film.laws.laminate import Laminate
from pvdf_fem.film.term import ElementMatrices, State, Term

IDENTITY: Array = np.eye(3, 2)
#: Pairs of displacement components with blocks in the tangent, up to symmetry.
PAIRS = [(i, j) for i in range(3) for j in range(i + 1)]


class Membrane(Laminate, Term):
    """The membrane's energy, residual and tangent on a space, of the plies of a `Laminate`.

    States have the resultant by all plies over the film's thickness.
    """

    #: Tension that keeps a slack film's tangent regular, over the mean tension.
    floor = 1e-6
    _last_moduli: tuple[State, Array] | None = None

    @cached_property
    def volumes(self) -> Array:
        """Quadrature weights times area times thickness in m^3, (elements, points)."""
        return self.film.thickness * self.space.weights

    def state(self, x: Array) -> State:
        """Fields of the dofs `x` in m."""
        gradient = self.space.gradient(x)
        strain = compute_strain(gradient)
        return State(gradient + IDENTITY, strain, self.resultant(strain), x)

    def own_stress(self, state: State) -> Array:
        """The stress of the strain alone."""
        return state.stress if state.added is None else state.stress - state.added

    def moduli(self, state: State) -> Array:
        """dS/dE in Pa, (3, 3), or (elements, points, 3, 3) where it is not the same everywhere."""
        if state.moduli is not None:
            return state.moduli
        if self._last_moduli is None or self._last_moduli[0] is not state:
            self._last_moduli = state, self.resultant_moduli(state.strain)
        return self._last_moduli[1]

    def energy(self, state: State) -> float:
        """Stored energy in J."""
        return self.stored(state.strain, self.volumes)

    @cached_property
    def _in_balance(self) -> Array:
        """Forces (dofs,) by the self-balanced part of the flat film's stress inside the rim: the
        whole stress if uniform, otherwise the mean."""
        flat = self.resultant(np.zeros((*self.volumes.shape, 3)))
        mean = np.einsum("epi,ep->i", flat, self.volumes) / self.volumes.sum()
        even = np.abs(flat - mean).max() <= 1e-12 * np.abs(mean).max()  # rounding
        balanced = flat if even else np.broadcast_to(mean, flat.shape)
        flux = self._first_piola(np.broadcast_to(IDENTITY, (*self.volumes.shape, 3, 2)), balanced)
        return self.space.sum(self.space.forces(flux))

    def residual(self, state: State) -> Array:
        """Internal forces in N, (dofs,), without balanced forces of the flat film.

        Added up, these would leave rounding that drowns a small load and moves a flat film.
        """
        return self.internal_forces(state) - self._in_balance

    def internal_forces(self, state: State) -> Array:
        """Internal forces in N, (dofs,), by the strain's stress."""
        flux = self._first_piola(state.deformation_gradient, self.own_stress(state))
        return self.space.sum(self.space.forces(flux))

    def element_action(self, state: State, x: Array) -> Array:
        F, step = state.deformation_gradient, self.space.gradient(x)
        stress = apply_matrix(self.moduli(state), compute_strain_rate(F, step))
        flux = self._first_piola(step, state.stress) + self._first_piola(F, stress)
        forces = self.space.forces(flux)
        if self.law.wrinkles:
            forces += apply_matrix(self._damping(state), x[self.space.element_dofs])
        return forces

    def diagonal(self, state: State) -> Array:
        return self.space.sum(self.element_diagonal(state))

    def element_diagonal(self, state: State) -> Array:
        """Diagonals of the element tangents, (elements, element dofs)."""
        factors, moduli = np.empty((*self.volumes.shape, 3, 3)), self.moduli(state)
        for i in range(3):
            m11, m12, _, m22 = self._derivatives(state, moduli, i, i)
            factors[..., i] = np.concatenate([m11, 2.0 * m12, m22], axis=-1)
        rows = self.space.gradient_rows
        g1, g2 = rows[:, 0::2], rows[:, 1::2]
        squares = np.stack([g1**2, g1 * g2, g2**2], axis=2)
        elements, points, _, functions = squares.shape
        squares = squares.reshape(elements, 3 * points, functions)
        diagonal = np.matmul(squares.swapaxes(1, 2), factors.reshape(elements, 3 * points, 3))
        diagonal = diagonal.reshape(elements, -1)
        if self.law.wrinkles:
            diagonal += np.einsum("eii->ei", self._damping(state))
        return diagonal

    def element_tangent(self, state: State) -> ElementMatrices:
        """Return the tangents of all elements in N/m."""
        return ElementMatrices(ALL, self.tangent_matrices(state))

    def tangent_matrices(self, state: State, together: int = 128) -> Array:
        """Tangents in N/m, (elements, element dofs, element dofs), computed for `together` elements
        at a time to stay in the processor's cache. Damping keeps the tangents of a wrinkling film
        regular where the film is slack; the residual is exact, and the damping changes no
        solution."""
        count, functions = len(self.space.gradient_rows), self.space.gradient_rows.shape[-1]
        blocks, moduli = np.empty((count, functions, 3, functions, 3)), self.moduli(state)
        for first in range(0, count, together):
            chunk = slice(first, first + together)
            products = self._tangent_products(state, moduli, chunk)
            for k, (i, j) in enumerate(PAIRS):
                blocks[chunk, :, i, :, j] = products[:, :, k]
                blocks[chunk, :, j, :, i] = products[:, :, k].swapaxes(1, 2)
        matrices = blocks.reshape(count, 3 * functions, 3 * functions)
        return matrices + self._damping(state) if self.law.wrinkles else matrices

    def _tangent_products(self, state: State, moduli: Array, chunk: slice) -> Array:
        """Tangent blocks, (elements, functions, component pairs, functions)."""
        rows = self.space.gradient_rows[chunk]
        elements, lines, functions = rows.shape
        g1, g2 = rows[:, 0::2], rows[:, 1::2]
        fluxes = np.empty((elements, lines // 2, 2, len(PAIRS), functions))
        for k, pair in enumerate(PAIRS):
            m11, m12, m21, m22 = self._derivatives(state, moduli, *pair, chunk)
            fluxes[:, :, 0, k] = m11 * g1 + m12 * g2
            fluxes[:, :, 1, k] = m21 * g1 + m22 * g2
        products = np.matmul(rows.swapaxes(1, 2), fluxes.reshape(elements, lines, -1))
        return products.reshape(elements, functions, len(PAIRS), functions)

    def _derivatives(
        self, state: State, moduli: Array, i: int, j: int, chunk: slice = ALL
    ) -> tuple[Array, Array, Array, Array]:
        """Weighted derivatives of (F S)_ia with respect to F_jb, (elements, points, 1).

        In the order ab = 11, 12, 21, 22. Uniform moduli are given in the film's axes and do not
        couple shear with normal strain.
        """
        weight = self.volumes[chunk, :, None]
        F, stress = state.deformation_gradient[chunk], state.stress[chunk]
        a1, a2, b1, b2 = (F[..., k, c, None] for k in (i, j) for c in (0, 1))
        s11, s22, s12 = (stress[..., k, None] * float(i == j) for k in range(3))
        C = moduli if moduli.ndim == 2 else moduli[chunk]
        c11, c12, c22, c33 = (C[..., k, m, None] for k, m in ((0, 0), (0, 1), (1, 1), (2, 2)))
        d11 = c11 * a1 * b1 + c33 * a2 * b2 + s11
        d12 = c12 * a1 * b2 + c33 * a2 * b1 + s12
        d21 = c12 * a2 * b1 + c33 * a1 * b2 + s12
        d22 = c22 * a2 * b2 + c33 * a1 * b1 + s22
        if moduli.ndim > 2:
            c13, c23 = C[..., 0, 2, None], C[..., 1, 2, None]
            d11 = d11 + c13 * (a1 * b2 + a2 * b1)
            d12 = d12 + c13 * a1 * b1 + c23 * a2 * b2
            d21 = d21 + c13 * a1 * b1 + c23 * a2 * b2
            d22 = d22 + c23 * (a1 * b2 + a2 * b1)
        return weight * d11, weight * d12, weight * d21, weight * d22

    def energy_along(self, state: State, x: Array) -> Array:
        """Coefficients (5,) of the stored energy along `x`, with the moduli of the state.

        They are exact where the law is linear: the strain is quadratic in s and the energy
        quadratic in the strain.
        """
        step, moduli = self.space.gradient(x), self.moduli(state)
        first = compute_strain_rate(state.deformation_gradient, step)
        second = compute_strain(step) - compute_strain_rate(IDENTITY, step)
        volumes = self.volumes[..., None]

        def product(stress: Array, strain: Array) -> float:
            return float((stress * strain * volumes).sum())

        stress = self.own_stress(state)
        stress_1, stress_2 = apply_matrix(moduli, first), apply_matrix(moduli, second)
        return np.array(
            [
                self.energy(state),
                product(stress, first),
                product(stress, second) + 0.5 * product(stress_1, first),
                product(stress_1, second),
                0.5 * product(stress_2, second),
            ]
        )

    def _first_piola(self, deformation_gradient: Array, stress: Array) -> Array:
        """First Piola-Kirchhoff stress F S times the volumes, (2, 3, elements, points)."""
        s11, s22, s12 = (stress[..., i] * self.volumes for i in range(3))
        f1, f2 = move_components_first(deformation_gradient, 2).swapaxes(0, 1)
        return np.stack([s11 * f1 + s12 * f2, s12 * f1 + s22 * f2])

    @cached_property
    def _laplace(self) -> Array:
        return self.space.laplace()

    def _damping(self, state: State) -> Array:
        return (state.damping + self.floor) * self.mean_tension(state) * self._laplace

    def mean_tension(self, state: State, least_strain: float = 1e-16) -> float:
        """Mean of both principal tensions in N/m. The tension by `least_strain` replaces the mean
        where the film is slack everywhere."""
        mean = 0.5 * state.stress[..., :2].sum(axis=-1)
        average = float((mean * self.volumes).sum() / self.volumes.sum())
        return self.film.thickness * max(average, least_strain * self.law.stiffness[0, 0])

    def predicted(self, state: State, stress: Array, damping: float) -> State:
        """The state with another stress in its tangent, and moduli of its own strain."""
        return replace(state, stress=stress, moduli=self.moduli(state), damping=damping)


def compute_strain(gradient: Array) -> Array:
    """Green-Lagrange strain (..., 3), Voigt, of a displacement gradient (..., 3, 2)."""
    return compute_strain_rate(IDENTITY + 0.5 * gradient, gradient)


def compute_strain_rate(deformation_gradient: Array, step: Array) -> Array:
    """Voigt components (..., 3) of sym(F^T grad v)."""
    f1, f2 = deformation_gradient[..., 0], deformation_gradient[..., 1]
    v1, v2 = step[..., 0], step[..., 1]
    return move_components_last(
        np.stack([_dot(f1, v1), _dot(f2, v2), _dot(f1, v2) + _dot(f2, v1)]), 1
    )


def _dot(a: Array, b: Array) -> Array:
    """a . b over the last axis; three terms in full take less time than a sum."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def compute_principal_values(tensor: Array) -> tuple[Array, Array]:
    """Smaller and larger principal values of (..., 11, 22, 12)."""
    mean = 0.5 * (tensor[..., 0] + tensor[..., 1])
    radius = np.hypot(0.5 * (tensor[..., 0] - tensor[..., 1]), tensor[..., 2])
    return mean - radius, mean + radius


def compute_tensile_part(stress: Array) -> Array:
    """The stress (..., 3) without its compressive principal values."""
    smallest, largest = (value[..., None] for value in compute_principal_values(stress))
    # The projection on the direction of the largest stress, which two equal stresses do not have.
    apart = np.where(largest > smallest, largest - smallest, 1.0)
    onto = (stress - smallest * np.array([1.0, 1.0, 0.0])) / apart
    return np.where(smallest >= 0.0, stress, np.maximum(largest, 0.0) * onto)
