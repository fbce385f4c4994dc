"""The weak form of the membrane, as scikit-fem forms: the page to read first.

Reference disc in the plane z = 0, displacement u = (u, v, w), total Lagrangian::

    F = [I; 0] + grad u                    deformation gradient, 3 x 2
    E = (F^T F - I) / 2                    Green-Lagrange strain
    S = C : (E + E0)                       second Piola-Kirchhoff stress, plane stress
    energy   = integral of h/2 (E + E0) : C : (E + E0)
    residual = integral of h S : dE,       dE = sym(F^T grad v)
    tangent  = integral of h (dE : C : DE + S : sym(grad v^T grad u))

with the elastic strain E0 of the film at rest, -alpha dT I of one that is cooled.
`pvdf_fem.film.membrane` evaluates the same equations for all elements at once, about fifty times
faster; a test holds the two equal.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem import Basis, BilinearForm, ElementVector, LinearForm

from pvdf_fem.arrays import Array
from pvdf_fem.film.space import ELEMENTS, INTEGRATION_ORDER, Space
from pvdf_fem.scene.film import Film


def make_vector_basis(space: Space) -> Basis:
    """The three-component basis on which forms assemble."""
    element = ElementVector(ELEMENTS[space.order](), 3)
    return Basis(space.mesh, element, intorder=INTEGRATION_ORDER[space.order])


def make_residual_form(film: Film) -> LinearForm:
    """h S : sym(F^T grad v), to be assembled with the field `displacement`."""

    def form(v: Any, p: Any) -> Array:
        F = _deformation_gradient(p.displacement)
        S = _stress(F, film)
        return film.thickness * _double_contraction(S, _sym(F, v.grad))

    return LinearForm(form)


def make_tangent_form(film: Film) -> BilinearForm:
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
    e11, e22, e12 = film.prestrain
    at_rest = np.array([[e11, 0.5 * e12], [0.5 * e12, e22]])
    return _elastic(E + at_rest[:, :, None, None], film)
