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

from pvdf_fem.film import Film

Array = NDArray[np.float64]
Selection = slice | NDArray[np.int64]
ALL = slice(None)

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
    """

    deformation_gradient: Array
    strain: Array
    stress: Array


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
        dofs = self.element_dofs[elements]
        nodal = x[dofs].reshape(len(dofs), 1, -1, 3)
        return np.matmul(nodal.swapaxes(2, 3), self.gradients[elements])

    def state(self, x: Array, elements: Selection = ALL) -> MembraneState:
        """Fields of the dofs `x` (metres), on all elements or on some."""
        gradient = self.gradient(x, elements)
        strain = strain_of(gradient)
        return MembraneState(gradient + IDENTITY, strain, self.stress(strain))

    def stress(self, strain: Array) -> Array:
        """Second Piola-Kirchhoff stress in Pa of a Green-Lagrange strain."""
        return self.elastic(strain) @ self.stiffness

    def elastic(self, strain: Array) -> Array:
        """Strain without the free thermal one."""
        return strain - self.film.thermal_strain * np.array([1.0, 1.0, 0.0])

    def root(self, state: MembraneState) -> Array:
        """R with dS/dE = R^T R, (..., 3, 3)."""
        return np.asarray(np.linalg.cholesky(self.stiffness).T)

    def residual(self, state: MembraneState) -> Array:
        """Internal forces in N, (elements, dofs of an element)."""
        flat = self._forces(np.matmul(IDENTITY, self._pretension))
        return self.added_residual(state) + flat

    def added_residual(self, state: MembraneState) -> Array:
        """The same less those of the flat film's pretension, which is in balance inside of the rim.

        Added up, it would leave rounding that drowns a small load.
        """
        added = self._resultant(state.strain @ self.stiffness)
        turned = np.matmul(state.deformation_gradient - IDENTITY, self._pretension)
        return self._forces(np.matmul(state.deformation_gradient, added) + turned)

    @cached_property
    def _pretension(self) -> Array:
        """Weighted resultant of the flat film."""
        stress = self.elastic(np.zeros(3)) @ self.stiffness
        return self._resultant(np.broadcast_to(stress, (*self.weights.shape, 3)))

    def _forces(self, first_piola: Array) -> Array:
        forces = np.matmul(self.gradients, first_piola.swapaxes(2, 3)).sum(axis=1)
        return forces.reshape(self.element_dofs.shape)

    def tangent(self, state: MembraneState) -> Array:
        """Tangent stiffness in N/m, (elements, dofs of an element, dofs of an element)."""
        elements, points, functions, _ = self.gradients.shape
        strains = self._strain_operator(state.deformation_gradient)
        thickness = np.sqrt(self.film.thickness * self.weights)[..., None, None]
        scaled = (thickness * np.matmul(self.root(state), strains)).reshape(
            elements, 3 * points, 3 * functions
        )
        stiffness = np.matmul(scaled.swapaxes(1, 2), scaled)

        resultant = self._resultant(state.stress)
        transposed = self.gradients.swapaxes(2, 3)
        geometric = np.matmul(np.matmul(self.gradients, resultant), transposed).sum(axis=1)
        blocks = stiffness.reshape(elements, functions, 3, functions, 3)
        for c in range(3):
            blocks[:, :, c, :, c] += geometric
        return stiffness

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

    def _resultant(self, stress: Array) -> Array:
        """Weighted stress resultant (elements, points, 2, 2): h S dA."""
        scaled = stress * (self.film.thickness * self.weights)[..., None]
        return scaled[..., [[0, 2], [2, 1]]]

    def _strain_operator(self, deformation_gradient: Array) -> Array:
        """B with dE = B du: (elements, points, 3, dofs of an element)."""
        elements, points, functions, _ = self.gradients.shape
        f1, f2 = (deformation_gradient[..., None, :, i] for i in (0, 1))
        g1, g2 = (self.gradients[..., i, None] for i in (0, 1))
        operator = np.stack([g1 * f1, g2 * f2, g1 * f2 + g2 * f1], axis=2)
        return operator.reshape(elements, points, 3, 3 * functions)


IDENTITY: Array = np.eye(3, 2)


def shape_gradients(basis: AbstractBasis) -> Array:
    """Gradients of a scalar basis' functions, (elements, points, functions, 2)."""
    return np.stack([shape[0].grad for shape in basis.basis], -1).transpose(1, 2, 3, 0)


def strain_of(gradient: Array) -> Array:
    """Green-Lagrange strain (..., 3), Voigt, of a displacement gradient (..., 3, 2)."""
    return strain_rate(IDENTITY + 0.5 * gradient, gradient)


def strain_rate(deformation_gradient: Array, step: Array) -> Array:
    """Voigt components (..., 3) of sym(F^T grad v)."""
    f1, f2 = deformation_gradient[..., 0], deformation_gradient[..., 1]
    v1, v2 = step[..., 0], step[..., 1]
    return np.stack(
        [(f1 * v1).sum(-1), (f2 * v2).sum(-1), (f1 * v2).sum(-1) + (f2 * v1).sum(-1)], axis=-1
    )


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
