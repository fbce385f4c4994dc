"""The weak form of the membrane as scikit-fem forms, written for reading, not for speed.

Reference disc in the plane z = 0, displacement u = (u, v, w), total Lagrangian::

    F = [I; 0] + grad u                    deformation gradient, 3 x 2
    E = (F^T F - I) / 2                    Green-Lagrange strain
    S = C : (E + E0)                       second Piola-Kirchhoff stress, plane stress
    energy   = integral of h/2 (E + E0) : C : (E + E0)
    residual = integral of h S : dE,       dE = sym(F^T grad v)
    tangent  = integral of h (dE : C : DE + S : sym(grad v^T grad u))

with the displacements u and v of trial and test functions, the thickness h, the plane-stress
stiffness C and the prestrain E0 of the flat film, which is -alpha dT I for a film cooled by dT.
`pvdf_fem.film.membrane` evaluates the same equations for all elements at once, about fifty times
faster; a test checks that both agree.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem import Basis, BilinearForm, ElementVector, LinearForm

from pvdf_fem.arrays import Array
from pvdf_fem.film.space import ELEMENTS, INTEGRATION_ORDER, Space
from pvdf_fem.scene.film import Film


def make_vector_basis(space: Space) -> Basis:
    """Make the basis of three-component displacements on which the forms are assembled."""
    element = ElementVector(ELEMENTS[space.order](), 3)
    return Basis(space.mesh, element, intorder=INTEGRATION_ORDER[space.order])


def make_residual_form(film: Film) -> LinearForm:
    """Make the linear form h S : sym(F^T grad v) of the membrane's residual.

    Assemble it with the interpolated displacement as the keyword ``displacement``.
    """

    def form(v: Any, p: Any) -> Array:
        F = _compute_deformation_gradient(p.displacement)
        S = _compute_stress(F, film)
        return film.thickness * _contract(S, _compute_strain_variation(F, v.grad))

    return LinearForm(form)


def make_tangent_form(film: Film) -> BilinearForm:
    """Make the bilinear form h (dE : C : DE + S : sym(grad v^T grad u)) of the tangent.

    Assemble it with the interpolated displacement as the keyword ``displacement``.
    """

    def form(u: Any, v: Any, p: Any) -> Array:
        F = _compute_deformation_gradient(p.displacement)
        S = _compute_stress(F, film)
        material_stress = _apply_stiffness(_compute_strain_variation(F, u.grad), film)
        material = _contract(material_stress, _compute_strain_variation(F, v.grad))
        geometric = _contract(S, np.einsum("ca...,cb...->ab...", v.grad, u.grad))
        return film.thickness * (material + geometric)

    return BilinearForm(form)


def _compute_deformation_gradient(displacement: Any) -> Array:
    """Return F = [I; 0] + grad u, shape (3, 2, elements, points)."""
    return np.eye(3, 2)[:, :, None, None] + displacement.grad


def _compute_strain_variation(F: Array, gradient: Array) -> Array:
    """Return sym(F^T grad v), shape (2, 2, elements, points), for `gradient` = grad v."""
    product = np.einsum("ca...,cb...->ab...", F, gradient)
    return 0.5 * (product + product.swapaxes(0, 1))


def _contract(A: Array, B: Array) -> Array:
    """Return A : B, shape (elements, points)."""
    return np.einsum("ab...,ab...", A, B)


def _apply_stiffness(E: Array, film: Film) -> Array:
    """Return C : E in Pa, shape (2, 2, elements, points)."""
    voigt = [E[0, 0], E[1, 1], 2 * E[0, 1]]
    s11, s22, s12 = np.einsum("ij,j...->i...", film.stiffness, voigt)
    return np.array([[s11, s12], [s12, s22]])


def _compute_stress(F: Array, film: Film) -> Array:
    """Return S = C : (E + E0) in Pa, shape (2, 2, elements, points)."""
    identity = np.eye(2)[:, :, None, None]
    E = 0.5 * (np.einsum("ca...,cb...->ab...", F, F) - identity)
    e11, e22, e12 = film.prestrain
    E0 = np.array([[e11, 0.5 * e12], [0.5 * e12, e22]])
    return _apply_stiffness(E + E0[:, :, None, None], film)
