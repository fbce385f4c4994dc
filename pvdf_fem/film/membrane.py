"""The film: a geometrically exact membrane of St. Venant-Kirchhoff material.

Reference disc in the plane z = 0, displacement u = (u, v, w), total Lagrangian::

    F = [I; 0] + grad u                    deformation gradient, 3 x 2
    E = (F^T F - I) / 2                    Green-Lagrange strain
    S = C : (E - alpha dT I)               second Piola-Kirchhoff stress, plane stress
    energy   = integral of h/2 (E - alpha dT I) : C : (E - alpha dT I)
    residual = integral of h S : dE,       dE = sym(F^T grad v)
    tangent  = integral of h (dE : C : DE + S : sym(grad v^T grad u))

The same equations stand here twice. `residual_form` and `tangent_form` are scikit-fem forms, to be
read. `Membrane` evaluates them for all elements at once on the same basis, quadrature and dofs;
this is what a solve uses (about fifteen times faster), and a test holds the two equal.

Symmetric tensors are in Voigt order (11, 22, 12), strains with engineering shear (2 E12). The dofs
are those of ``ElementVector(element, 3)``: component c of scalar dof i is dof 3 i + c.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import (
    Basis,
    BilinearForm,
    Element,
    ElementTriP1,
    ElementTriP2,
    ElementTriP3,
    ElementTriP4,
    ElementVector,
    LinearForm,
    MeshTri2,
)
from skfem.assembly.basis import AbstractBasis

from pvdf_fem.scene.film import Film

Array = NDArray[np.float64]
Selection = slice | NDArray[np.int64]
ALL = slice(None)
# Elements whose tangents are made together: their work space stays in the processor's cache.
CHUNK = 128

ELEMENTS: dict[int, type[Element]] = {
    1: ElementTriP1,
    2: ElementTriP2,
    3: ElementTriP3,
    4: ElementTriP4,
}
# Exact for the residual of straight-sided elements: four gradients of degree order - 1. The tangent
# of order 3 keeps its full rank with degree 6, and quadrature of higher degree moves no digit.
INTEGRATION_ORDER = {1: 1, 2: 4, 3: 6, 4: 8}


@dataclass(frozen=True)
class MembraneState:
    """Fields of one displacement at the quadrature points of all elements.

    Attributes
    ----------
    deformation_gradient : (elements, points, 3, 2)
    strain : (elements, points, 3)
        Green-Lagrange strain, Voigt with engineering shear.
    stress : (elements, points, 3)
        Second Piola-Kirchhoff stress in Pa, Voigt.
    dofs : (dofs,)
        The displacement in m.
    """

    deformation_gradient: Array
    strain: Array
    stress: Array
    dofs: Array


class Membrane:
    """The membrane's energy, residual and tangent on a mesh, element by element.

    Parameters
    ----------
    mesh : MeshTri2
        Reference disc, metres.
    film : Film
        Thickness, stiffness and thermal strain.
    order : int
        Polynomial order of all three displacement components: 1, 2 or 3.
    """

    def __init__(self, mesh: MeshTri2, film: Film, order: int = 2) -> None:
        self.mesh, self.film, self.order = mesh, film, order
        self.stiffness = film.stiffness
        self.basis = Basis(mesh, ELEMENTS[order](), intorder=INTEGRATION_ORDER[order])
        self.gradients = shape_gradients(self.basis)
        elements, points, functions, _ = self.gradients.shape
        rows = self.gradients.swapaxes(2, 3).reshape(elements, 2 * points, functions)
        self._rows = np.ascontiguousarray(rows)
        self.weights: Array = self.basis.dx
        nodes = self.basis.element_dofs.T
        self.element_dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
        self.dof_count = 3 * self.basis.N

    @cached_property
    def vector_basis(self) -> Basis:
        """The three-component basis on which the scikit-fem forms assemble."""
        element = ElementVector(ELEMENTS[self.order](), 3)
        return Basis(self.mesh, element, intorder=INTEGRATION_ORDER[self.order])

    def gradient(self, x: Array, elements: Selection = ALL) -> Array:
        """Displacement gradient (elements, points, 3, 2) of the dofs `x`."""
        rows, nodes = self._rows[elements], self.basis.element_dofs.T[elements]
        slopes = np.matmul(rows, x.reshape(-1, 3)[nodes]).reshape(len(rows), -1, 2, 3)
        return _last(np.ascontiguousarray(slopes.transpose(3, 2, 0, 1)), 2)

    def state(self, x: Array, elements: Selection = ALL) -> MembraneState:
        """Fields of the dofs `x` (metres), on all elements or on some."""
        gradient = self.gradient(x, elements)
        strain = strain_of(gradient)
        return MembraneState(gradient + IDENTITY, strain, self.stress(strain), x)

    def stress(self, strain: Array) -> Array:
        """Second Piola-Kirchhoff stress in Pa of a Green-Lagrange strain."""
        return times(self.stiffness, self.elastic(strain))

    def elastic(self, strain: Array) -> Array:
        """Strain without the free thermal one."""
        return strain - self.film.thermal_strain * np.array([1.0, 1.0, 0.0])

    def residual(self, state: MembraneState) -> Array:
        """Internal forces in N, (elements, dofs of an element)."""
        return self._forces(self._first_piola(state.deformation_gradient, state.stress))

    def added_residual(self, state: MembraneState) -> Array:
        """The same less those of the flat film's pretension, which is in balance inside of the rim.

        Added up, it would leave rounding that drowns a small load.
        """
        F, flat = state.deformation_gradient, self.elastic(np.zeros(3)) @ self.stiffness
        added = self._first_piola(F, times(self.stiffness, state.strain))
        turned = self._first_piola(F - IDENTITY, flat)
        return self._forces(added + turned)

    def moduli(self, state: MembraneState) -> Array:
        """dS/dE in Pa, (3, 3), or (elements, points, 3, 3) where it is not the same everywhere."""
        return self.stiffness

    def tangent_action(self, state: MembraneState, x: Array) -> Array:
        """Change of `residual` with the dofs by `x`, without the tangent's matrices."""
        F, step = state.deformation_gradient, self.gradient(x)
        stress = times(self.moduli(state), strain_rate(F, step))
        return self._forces(self._first_piola(step, state.stress) + self._first_piola(F, stress))

    def tangent_diagonal(self, state: MembraneState) -> Array:
        """Diagonal of each element's `tangent`, (elements, dofs of an element)."""
        factors, moduli = np.empty((*self.weights.shape, 3, 3)), self.moduli(state)
        for i in range(3):
            m11, m12, _, m22 = self._derivatives(state, moduli, i, i)
            factors[..., i] = np.concatenate([m11, 2.0 * m12, m22], axis=-1)
        g1, g2 = self._rows[:, 0::2], self._rows[:, 1::2]
        squares = np.stack([g1**2, g1 * g2, g2**2], axis=2)
        elements, points, _, functions = squares.shape
        squares = squares.reshape(elements, 3 * points, functions)
        diagonal = np.matmul(squares.swapaxes(1, 2), factors.reshape(elements, 3 * points, 3))
        return diagonal.reshape(elements, -1)

    def tangent(self, state: MembraneState) -> Array:
        """Tangent stiffness in N/m, (elements, dofs of an element, dofs of an element)."""
        count, functions = len(self._rows), self._rows.shape[-1]
        blocks, moduli = np.empty((count, functions, 3, functions, 3)), self.moduli(state)
        for first in range(0, count, CHUNK):
            chunk = slice(first, first + CHUNK)
            products = self._tangent_products(state, moduli, chunk)
            for k, (i, j) in enumerate(PAIRS):
                blocks[chunk, :, i, :, j] = products[:, :, k]
                blocks[chunk, :, j, :, i] = products[:, :, k].swapaxes(1, 2)
        return blocks.reshape(count, 3 * functions, 3 * functions)

    def _tangent_products(self, state: MembraneState, moduli: Array, chunk: slice) -> Array:
        """Blocks of the tangent, (elements, functions, pairs of components, functions)."""
        rows = self._rows[chunk]
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
        self, state: MembraneState, moduli: Array, i: int, j: int, chunk: slice = ALL
    ) -> tuple[Array, Array, Array, Array]:
        """Weighted derivatives of (F S)_ia with respect to F_jb, each (elements, points, 1).

        In the order ab = 11, 12, 21, 22. Moduli that are the same everywhere are those of the
        film's axes and do not couple shear with normal strain.
        """
        weight = self.film.thickness * self.weights[chunk, :, None]
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

    def laplace(self) -> Array:
        """Integrals of grad v . grad u, (elements, dofs of an element, dofs of an element)."""
        elements, _, functions, _ = self.gradients.shape
        weighted = self.gradients * self.weights[..., None, None]
        scalar = np.matmul(weighted, self.gradients.swapaxes(2, 3)).sum(axis=1)
        blocks = np.einsum("eab,ij->eaibj", scalar, np.eye(3))
        return blocks.reshape(elements, 3 * functions, 3 * functions)

    def energy(self, state: MembraneState) -> float:
        """Stored energy in J."""
        density = (self.elastic(state.strain) * state.stress).sum(axis=-1)
        return 0.5 * self.film.thickness * float((density * self.weights).sum())

    def energy_along(self, state: MembraneState, direction: Array) -> Array:
        """Coefficients (5,), lowest power first, of the stored energy in s at x + s direction.

        Exact: the strain is quadratic in s and the energy quadratic in the strain.
        """
        step = self.gradient(direction)
        first = strain_rate(state.deformation_gradient, step)
        second = strain_of(step) - strain_rate(IDENTITY, step)
        weights = (self.film.thickness * self.weights)[..., None]

        def product(stress: Array, strain: Array) -> float:
            return float((stress * strain * weights).sum())

        stress_1, stress_2 = first @ self.stiffness, second @ self.stiffness
        return np.array(
            [
                self.energy(state),
                product(state.stress, first),
                product(state.stress, second) + 0.5 * product(stress_1, first),
                product(stress_1, second),
                0.5 * product(stress_2, second),
            ]
        )

    def _first_piola(self, deformation_gradient: Array, stress: Array) -> Array:
        """Weighted first Piola-Kirchhoff stress F S, components first: (2, 3, elements, points)."""
        weight = self.film.thickness * self.weights
        s11, s22, s12 = (stress[..., i] * weight for i in range(3))
        f1, f2 = _first(deformation_gradient, 2).swapaxes(0, 1)
        return np.stack([s11 * f1 + s12 * f2, s12 * f1 + s22 * f2])

    def _forces(self, first_piola: Array) -> Array:
        """Forces on the dofs of each element, (elements, dofs of an element)."""
        stresses = first_piola.transpose(2, 3, 0, 1).reshape(len(self._rows), -1, 3)
        return np.matmul(self._rows.swapaxes(1, 2), stresses).reshape(self.element_dofs.shape)


IDENTITY: Array = np.eye(3, 2)
# Pairs of displacement components whose blocks the tangent has, up to symmetry.
PAIRS = [(i, j) for i in range(3) for j in range(i + 1)]


def shape_gradients(basis: AbstractBasis) -> Array:
    """Gradients of a scalar basis' functions, (elements, points, functions, 2)."""
    return np.stack([shape[0].grad for shape in basis.basis], -1).transpose(1, 2, 3, 0)


def _first(components: Array, axes: int) -> Array:
    """The last `axes` moved to the front."""
    return np.moveaxis(components, range(-axes, 0), range(axes))


def _last(components: Array, axes: int) -> Array:
    """The first `axes` moved to the end, in memory still the first: each component is one block,
    on which sums and products over all points are several times faster."""
    return np.moveaxis(components, range(axes), range(-axes, 0))


def times(matrix: Array, vector: Array) -> Array:
    """Vectors (..., n) times one matrix (n, n), or times one (..., n, n) each."""
    if matrix.ndim > 2:
        return np.matmul(matrix, vector[..., None])[..., 0]
    return _last(np.tensordot(matrix, _first(vector, 1), 1), 1)


def strain_of(gradient: Array) -> Array:
    """Green-Lagrange strain (..., 3), Voigt, of a displacement gradient (..., 3, 2)."""
    return strain_rate(IDENTITY + 0.5 * gradient, gradient)


def strain_rate(deformation_gradient: Array, step: Array) -> Array:
    """Voigt components (..., 3) of sym(F^T grad v)."""
    f1, f2 = deformation_gradient[..., 0], deformation_gradient[..., 1]
    v1, v2 = step[..., 0], step[..., 1]
    return _last(np.stack([_dot(f1, v1), _dot(f2, v2), _dot(f1, v2) + _dot(f2, v1)]), 1)


def _dot(a: Array, b: Array) -> Array:
    """a . b over the last axis; three terms in full take less time than a sum."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def principal(tensor: Array) -> tuple[Array, Array]:
    """Smaller and larger principal values of (..., 11, 22, 12)."""
    mean = 0.5 * (tensor[..., 0] + tensor[..., 1])
    radius = np.hypot(0.5 * (tensor[..., 0] - tensor[..., 1]), tensor[..., 2])
    return mean - radius, mean + radius


def tensile_part(stress: Array) -> Array:
    """The stress (..., 3) without its compressive principal values."""
    mean = 0.5 * (stress[..., :1] + stress[..., 1:2])
    radius = np.hypot(0.5 * (stress[..., :1] - stress[..., 1:2]), stress[..., 2:])
    smallest, largest = mean - radius, mean + radius
    # The projection on the direction of the largest stress; no direction without a difference.
    onto = (stress - smallest * np.array([1.0, 1.0, 0.0])) / np.where(radius > 0, 2 * radius, 1)
    return np.where(smallest >= 0.0, stress, np.maximum(largest, 0.0) * onto)


def residual_form(film: Film) -> LinearForm:
    """h S : sym(F^T grad v), to be assembled with the field `displacement`."""

    def form(v: Any, p: Any) -> Array:
        F = _deformation_gradient(p.displacement)
        S = _stress(F, film)
        return film.thickness * _double_contraction(S, _sym(F, v.grad))

    return LinearForm(form)


def tangent_form(film: Film) -> BilinearForm:
    """h (dE : C : DE + S : sym(grad v^T grad u)), to be assembled with `displacement`."""

    def form(u: Any, v: Any, p: Any) -> Array:
        F = _deformation_gradient(p.displacement)
        S = _stress(F, film)
        material = _double_contraction(_elastic(_sym(F, u.grad), film), _sym(F, v.grad))
        geometric = _double_contraction(S, np.einsum("ca...,cb...->ab...", v.grad, u.grad))
        return film.thickness * (material + geometric)

    return BilinearForm(form)


def _deformation_gradient(displacement: Any) -> Array:
    return np.eye(3, 2)[:, :, None, None] + displacement.grad


def _sym(F: Array, step: Array) -> Array:
    product = np.einsum("ca...,cb...->ab...", F, step)
    return 0.5 * (product + product.swapaxes(0, 1))


def _double_contraction(A: Array, B: Array) -> Array:
    return np.einsum("ab...,ab...", A, B)


def _elastic(E: Array, film: Film) -> Array:
    """C : E as 2 x 2 tensors."""
    s11, s22, s12 = np.einsum("ij,j...->i...", film.stiffness, [E[0, 0], E[1, 1], 2 * E[0, 1]])
    return np.array([[s11, s12], [s12, s22]])


def _stress(F: Array, film: Film) -> Array:
    identity = np.eye(2)[:, :, None, None]
    E = 0.5 * (np.einsum("ca...,cb...->ab...", F, F) - identity)
    return _elastic(E - film.thermal_strain * identity, film)
