"""Observed orders of convergence to a manufactured solution."""

from __future__ import annotations

import numpy as np
import pytest
from skfem import Basis, ElementVector, LinearForm

from pvdf_fem import Scene
from pvdf_fem.film.membrane import IDENTITY, compute_strain, compute_strain_rate
from pvdf_fem.film.space import ELEMENTS
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.nonlinear.factors import factorise
from tests.helpers.discs import uniform_mesh

RADIUS = 45e-3
# A cold film, so that the manufactured stress is tensile everywhere and the solution a minimum.
# The only electrode is large: no outline forces small elements.
SCENE = Scene().with_(
    film={"temperature_change_K": -300.0},
    electrodes=[{"name": "A", "side_mm": 30.0, "x_mm": 0.0, "y_mm": 0.0}],
)


def manufactured(x, y):
    """Displacement (..., 3) that vanishes on the rim: b = 1 - r^2/a^2 times smooth functions
    without any symmetry. Slopes reach 0.3, so that every term of the equations matters."""
    X, Y = x / RADIUS, y / RADIUS
    u, v = 3e-4 * np.sin(2.0 * X + Y), 2e-4 * np.exp(X) * Y
    w = 5e-3 * (np.cos(2.0 * X - Y) + 0.5 * Y)
    return (1.0 - X**2 - Y**2)[..., None] * np.stack([u, v, w], axis=-1)


def gradient_of(x, y, h=1e-30):
    """Gradient (..., 3, 2) of the manufactured displacement, by complex steps."""
    moved = manufactured(x + 1j * h, y + 0j), manufactured(x + 0j, y + 1j * h)
    return np.stack(moved, axis=-1).imag / h


def solved(problem, forces):
    """Newton's method from the interpolant of the manufactured solution."""
    q = problem.unknowns.restrict(manufactured(*problem.space.basis.doflocs).ravel())
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
    problem = Equilibrium(Problem.from_scene(SCENE), uniform_mesh(SCENE, size_mm), order)
    membrane, h = problem.membrane, problem.film.thickness
    basis = Basis(problem.space.mesh, ElementVector(ELEMENTS[order](), 3), intorder=10)
    places = np.asarray(basis.global_coordinates())
    exact, stress = gradient_of(*places), membrane.stress(compute_strain(gradient_of(*places)))
    flux = h * np.matmul(exact + IDENTITY, stress[..., [[0, 2], [2, 1]]])
    # the forces under which the manufactured solution is exact
    forces = LinearForm(lambda v, _: np.einsum("epij,ijep->ep", flux, v.grad)).assemble(basis)
    found = basis.interpolate(solved(problem, forces))
    error = np.moveaxis(np.asarray(found), 0, -1) - manufactured(*places)
    slope = np.moveaxis(found.grad, (0, 1), (-2, -1)) - exact
    strain = compute_strain_rate(exact + IDENTITY, slope)
    geometric = compute_strain(slope) - compute_strain_rate(IDENTITY, slope)
    density = (strain @ membrane.law.stiffness * strain).sum(-1) + 2 * (stress * geometric).sum(-1)
    squares = ((error**2).sum(-1) * basis.dx).sum(), h * (density * basis.dx).sum()
    return np.sqrt([basis.dx.sum() / len(basis.dx), *squares])


@pytest.mark.parametrize(
    ("order", "sizes_mm"), [(1, (6, 4, 2.5, 1.5)), (2, (7, 5, 3.5)), (3, (7, 5, 3.5))]
)
def test_manufactured_solution_converges_with_the_order_of_theory(order, sizes_mm):
    """h^p in the energy norm and h^(p + 1) in L2, cubic elements on curved rims included. A lost
    order is a difference of 1; finer meshes leave the 0.15 of cubic elements in L2."""
    h, l2, energy = np.log([errors(size, order) for size in sizes_mm]).T
    assert np.polyfit(h, energy, 1)[0] == pytest.approx(order, abs=0.2)
    assert np.polyfit(h, l2, 1)[0] == pytest.approx(order + 1, abs=0.3)
