"""Observed orders of convergence to a manufactured solution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from skfem import Basis

from pvdf_fem import Scene
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import IDENTITY, strain_of, strain_rate
from pvdf_fem.solvers.newton import factorise
from tests.helpers.discs import uniform_mesh

RADIUS = 45e-3
# A cold film, so that the manufactured stress is tensile everywhere and the solution a minimum.
# The only electrode is large: no outline forces small elements.
SCENE = Scene.parse(
    """
    [film]
    temperature_change_K = -300.0
    [[electrodes]]
    name = "A"
    side_mm = 30.0
    x_mm = 0.0
    y_mm = 0.0
    """
)


def manufactured(points):
    """Displacement (..., 3) and gradient (..., 3, 2) of a solution that vanishes on the rim.

    Each component is b = 1 - r^2/a^2 times a smooth function without any symmetry; slopes reach
    0.3, so that every term of the equations matters.
    """
    X, Y = points / RADIUS
    b, b_X, b_Y = 1 - X**2 - Y**2, -2 * X, -2 * Y
    parts = [  # (amplitude, f, f_X, f_Y)
        (3e-4, np.sin(2 * X + Y), 2 * np.cos(2 * X + Y), np.cos(2 * X + Y)),
        (2e-4, np.exp(X) * Y, np.exp(X) * Y, np.exp(X)),
        (
            5e-3,
            np.cos(2 * X - Y) + 0.5 * Y,
            -2 * np.sin(2 * X - Y),
            np.sin(2 * X - Y) + 0.5,
        ),
    ]
    value = np.stack([c * b * f for c, f, _, _ in parts], axis=-1)
    gradient = [
        np.stack([c * (b_X * f + b * f_X), c * (b_Y * f + b * f_Y)], axis=-1) / RADIUS
        for c, f, f_X, f_Y in parts
    ]
    return value, np.stack(gradient, axis=-2)


@dataclass(frozen=True)
class FineQuadrature:
    """A membrane's mesh and functions with a quadrature that adds no error."""

    values: np.ndarray  # (elements, points, functions)
    gradients: np.ndarray  # (elements, points, functions, 2)
    weights: np.ndarray  # (elements, points)
    exact: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, membrane):
        basis = Basis(membrane.space.mesh, membrane.space.basis.elem, intorder=10)
        shape = basis.dx.shape
        return cls(
            np.stack([np.broadcast_to(s[0], shape) for s in basis.basis], -1),
            np.stack([s[0].grad for s in basis.basis], -1).transpose(1, 2, 3, 0),
            basis.dx,
            manufactured(np.asarray(basis.global_coordinates())),
        )


def body_force(membrane, fine):
    """Internal forces of the manufactured solution: the load under which it is exact."""
    gradient = fine.exact[1]
    stress = membrane.stress(strain_of(gradient))[..., [[0, 2], [2, 1]]]
    first_piola = membrane.film.thickness * np.matmul(gradient + IDENTITY, stress)
    weighted = first_piola * fine.weights[..., None, None]
    forces = np.matmul(fine.gradients, weighted.swapaxes(2, 3)).sum(axis=1)
    return membrane.space.sum(forces.reshape(membrane.space.element_dofs.shape))


def solved(problem, forces):
    """Newton's method from the interpolant of the manufactured solution."""
    values, _ = manufactured(problem.membrane.space.basis.doflocs)
    q = problem.unknowns.restrict(values.ravel())
    right = problem.unknowns.fold(forces)
    for _ in range(8):
        state = problem.state(q)
        step = factorise(problem.tangent(state)).solve(right - problem.residual(state))
        q = q + step
        if np.abs(step).max() < 1e-13 * np.abs(q).max():
            return problem.unknowns.expand(q)
    raise AssertionError("no convergence")


def errors(size_mm, order):
    """Mean element size; error in L2 and in the energy norm (of the exact tangent)."""
    problem = Equilibrium(SCENE, uniform_mesh(SCENE, size_mm), order)
    membrane = problem.membrane
    fine = FineQuadrature.of(membrane)
    x = solved(problem, body_force(membrane, fine))
    nodal = x[membrane.space.element_dofs].reshape(len(x[membrane.space.element_dofs]), 1, -1, 3)
    value, gradient = fine.exact
    error = np.matmul(fine.values[:, :, None], nodal)[:, :, 0] - value
    slope = np.matmul(nodal.swapaxes(2, 3), fine.gradients) - gradient
    strain = strain_rate(gradient + IDENTITY, slope)
    geometric = strain_of(slope) - strain_rate(IDENTITY, slope)
    stress = membrane.stress(strain_of(gradient))
    density = (strain @ membrane.law.stiffness * strain).sum(-1) + 2 * (stress * geometric).sum(-1)
    size = math.sqrt(fine.weights.sum() / len(fine.weights))
    return (
        size,
        math.sqrt(((error**2).sum(-1) * fine.weights).sum()),
        math.sqrt((density * fine.weights).sum() * membrane.film.thickness),
    )


@pytest.mark.parametrize(
    ("order", "sizes_mm"), [(1, (6, 4, 2.5, 1.5)), (2, (7, 5, 3.5, 2.5)), (3, (7, 5, 3.5, 2.5))]
)
def test_manufactured_solution_converges_with_the_order_of_theory(order, sizes_mm):
    """h^p in the energy norm and h^(p + 1) in L2, cubic elements on curved rims included."""
    h, l2, energy = np.log([errors(size, order) for size in sizes_mm]).T
    assert np.polyfit(h, energy, 1)[0] == pytest.approx(order, abs=0.2)
    assert np.polyfit(h, l2, 1)[0] == pytest.approx(order + 1, abs=0.2)
