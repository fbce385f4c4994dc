"""Bending against plates: clamped, stretched, at large deflection, vibrating; and its equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import iv, jv, kv

from pvdf_fem import solve
from pvdf_fem.charges.forces import charges_of, goal_forces
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.layers import uncertain_part
from pvdf_fem.film.plate import Plate, plate_stiffness
from pvdf_fem.film.space import Space
from pvdf_fem.film.unknowns import prolongation
from pvdf_fem.mesh.gmsh_mesh import FILM, PROBE, RIM
from pvdf_fem.mesh.six_node import compression
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.solution.first_sizes import first_sizes
from pvdf_fem.solvers.newton import factorise, negative_pivots
from reports.reference.circular_plate import (
    stretched_plate_deflection,
)
from tests.helpers.discs import (
    LOADS,
    RECTANGLE,
    TRIANGLE,
    free_disc,
    graded_mesh,
    model_mesh,
    uniform_mesh,
)

NONE = np.empty(0, dtype=np.int64)
PLATE = {"film.bending": True}
# F a^2/(D h): the deflection is some 1e-4 h, and its square what the linear plate leaves out.
LOAD = 1e-2


def plate(thickness_um, patch_radius=1.0, tension=0.0, **changes):
    """A film that bends, with `tension` N0 a^2/D, under so small a force that it is linear."""
    scene = free_disc(
        1.0,
        poisson_ratio=0.3,
        patch_radius=patch_radius,
        **{"film.thickness_um": thickness_um, "numerics.tolerance": 1e-4, **PLATE},
    )
    film = scene.film
    D = plate_stiffness(film)[0, 0]
    strain = tension * D / film.radius**2 / (film.thickness * film.stiffness[:2, :2].sum() / 2)
    return scene.with_(
        **{
            "load.force_N": LOAD * D * film.thickness / film.radius**2,
            "film.temperature_change_K": -strain / film.thermal_expansion_per_K,
            **changes,
        }
    )


def solved(scene, patch_mm=1.0):
    """On a mesh of fixed sizes, as charges of a nearly flat plate are second-order small."""
    mesh = graded_mesh(scene, min(patch_mm, scene.probe.radius_mm), 2.0 * patch_mm)
    return solve(scene, mesh=mesh, order=3)


def profile(solution):
    """r/a and deflection in m of all nodes."""
    radius = np.hypot(*solution.basis.doflocs) / solution.scene.film.radius
    return np.minimum(radius, 1.0), solution.displacement[:, 2]


def test_stretched_plate():
    bending_length = 0.1
    scene = plate(20.0, 0.2, bending_length**-2)
    solution = solved(scene)
    radius, w = profile(solution)
    expected = stretched_plate_deflection(radius, patch_radius=0.2, bending_length=bending_length)
    scale = LOAD * scene.film.thickness * bending_length**2
    np.testing.assert_allclose(w, scale * expected, rtol=0, atol=1e-4 * scale * expected.max())
    assert solution.force_balance < 1e-6


def stretched(widths):
    """Solution in elements of so many bending lengths at the rim; deflection lost by bending, m."""
    length = 0.05 / widths
    scene = plate(1.0, 0.5, length**-2)
    radius = scene.film.radius
    sizes = Sizes({FILM: 0.05 * radius, PROBE: 0.15 * radius}, 0.5, 0.15 * radius)
    scale = LOAD * scene.film.thickness * length**2
    membrane = scale * (np.log(2.0) + 0.5) / (2.0 * np.pi)
    bent = scale * stretched_plate_deflection(0.0, patch_radius=0.5, bending_length=length)
    return solve(scene, mesh=model_mesh(scene, sizes), order=3), membrane, membrane - bent


@pytest.mark.parametrize("widths", [3.0, 10.0, 25.0, 200.0])
def test_layer_narrower_than_the_elements(widths):
    solution, membrane, lost = stretched(widths)
    found = membrane - 1e-3 * solution.deflection_max_mm
    assert found / lost == pytest.approx(1.0, abs=0.08)


def test_a_part_of_what_narrow_layers_do_is_uncertain():
    solution, _, lost = stretched(200.0)
    solved, state = solution.fields.solved, solution.fields.solved_state
    layers = solved.model.layers(solved.terms, solved.unknowns.expansion, state)
    change = solved.unknowns.expand(layers.change(factorise(solved.tangent(state))))[2::3]
    centre = np.hypot(*solution.basis.doflocs).argmin()
    assert change[centre] / lost == pytest.approx(-uncertain_part(layers.widths.max()), rel=0.1)


def test_the_stated_error_has_what_is_uncertain():
    """Of bending layers that the elements do not resolve."""
    scene = RECTANGLE.with_(**{"film.thickness_um": 9.0}, **PLATE)
    solution = solve(scene, mesh=graded_mesh(scene, 2.0, 8.0))
    solved, state = solution.fields.solved, solution.fields.solved_state
    layers = solved.model.layers(solved.terms, solved.unknowns.expansion, state)
    change = layers.change(factorise(solved.tangent(state)))
    goals, q = goals_of(scene), solution.fields.q
    without, with_layers = (
        1e12 * charges_of(goals, goal_forces(goals, solved.membrane, solved.dofs(at)))
        for at in (q, q + change)
    )
    stated = np.array([*solution.charge_errors_pC.values()])
    assert np.all(stated >= np.abs(with_layers - without))


def punched(radius, b, length):
    """Deflection in F/N around a rigid punch on a stretched plate: flat at the punch's edge."""

    def functions(r):
        return np.array([np.ones_like(r), iv(0, r / length), kv(0, r / length)])

    def slopes(r):
        return np.array([0.0, iv(1, r / length), -kv(1, r / length)]) / length

    matrix = np.array([slopes(b), functions(np.array(1.0)), slopes(1.0)])
    factors = np.linalg.solve(matrix, np.array([1.0 / b, 0.0, 1.0]) / (2.0 * np.pi))
    return np.tensordot(factors, functions(radius), 1) - np.log(radius) / (2.0 * np.pi)


def test_punch_keeps_the_film_horizontal_up_to_its_edge():
    bending_length = 0.1
    scene = plate(20.0, 0.2, bending_length**-2, **LOADS["sliding"])
    scale = LOAD * scene.film.thickness * bending_length**2
    radius, w = profile(solved(scene))
    expected = scale * punched(np.maximum(radius, 0.2), 0.2, bending_length)
    np.testing.assert_allclose(w, expected, rtol=0, atol=1e-4 * expected.max())


@pytest.mark.parametrize(("order", "rate"), [(2, 2.0), (3, 4.0), (4, 4.0)])
def test_deflection_converges(order, rate):
    """Of p a^4/(64 D) (1 - r^2/a^2)^2; of order 4, the curved rim's fourth power is left."""
    scene, errors, sizes = plate(1000.0), [], []
    for size_mm in (12.0, 6.0, 3.0):
        space = Space(uniform_mesh(scene, size_mm), order)
        basis = space.basis
        free = np.setdiff1d(np.arange(basis.N), basis.get_dofs(RIM).all())
        forces = np.zeros(basis.N)
        shapes = np.stack([s[0] * np.ones_like(space.weights) for s in basis.basis], -1)
        loads = (shapes * space.weights[..., None]).sum(axis=1)
        np.add.at(forces, basis.element_dofs.T, loads)
        w = np.zeros(basis.N)
        matrix = Plate(space, scene.film, NONE).form.matrix[free][:, free].tocsc()
        w[free] = factorise(matrix).solve(forces[free])
        a, D = scene.film.radius, plate_stiffness(scene.film)[0, 0]
        exact = (a**2 - (basis.doflocs**2).sum(axis=0)) ** 2 / (64.0 * D)
        errors.append(np.sqrt(np.mean((w - exact) ** 2)))
        sizes.append(space.mesh.nelements**-0.5)
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] > rate - 0.35


ORTHOTROPIC = {"film.youngs_modulus_GPa": [50.0, 1.0], "film.poisson_ratio": 0.34}


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("material", [{}, ORTHOTROPIC, {"film.poisson_ratio": 0.499}])
def test_clamped_film_resists_any_bending(order, material):
    """Elements from 1 to 40 mm, and beside a cusp where the probe's circle touches electrodes."""
    cusp = plate(20.0, 0.2, 100.0)
    beside = model_mesh(cusp, first_sizes(cusp, 3))
    assert compression(beside).min() > 0.2
    film = TRIANGLE.with_(**material).film
    for mesh in (graded_mesh(TRIANGLE, 1.0, 40.0, 1.5), *([] if material else [beside])):
        space = Space(mesh, order)
        matrix = Plate(space, film, NONE).form.matrix
        free = np.setdiff1d(np.arange(space.basis.N), space.basis.get_dofs(RIM).all())
        assert abs(matrix - matrix.T).max() <= 1e-12 * abs(matrix).max()
        assert negative_pivots(factorise(matrix[free][:, free].tocsc())) == 0


@pytest.mark.parametrize("order", [2, 3, 4])
def test_flat_film_and_constant_moments_need_no_forces(order):
    """At nodes of straight-sided elements; their neighbours' edges are straight too."""
    space = Space(uniform_mesh(TRIANGLE, 6.0), order)
    matrix, (x, y) = Plate(space, TRIANGLE.film, NONE).form.matrix, space.basis.doflocs
    inner = np.hypot(x, y) < 0.6 * TRIANGLE.film.radius
    for w in (np.ones_like(x), x - 2.0 * y, x**2 - 3.0 * x * y + 0.5 * y**2):
        forces = matrix @ w
        assert np.abs(forces[inner]).max() < 1e-10 * abs(matrix).max() * np.abs(w).max()


def test_richer_space_has_the_energy_of_the_function_written_in_it():
    """Else the estimate would correct what is no error; edges of the rim are curved."""
    scene = TRIANGLE.with_(**PLATE)
    coarse, rich = (Equilibrium(scene, uniform_mesh(scene, 15.0), order) for order in (2, 3))
    q = 1e-4 * np.random.default_rng(4).normal(size=coarse.unknowns.count)
    energies = [
        term.energy(equations.state(x))
        for equations, x in ((coarse, q), (rich, prolongation(coarse, rich) @ q))
        for term in equations.terms
        if isinstance(term, Plate)
    ]
    assert energies[1] == pytest.approx(energies[0], rel=1e-3)


@pytest.mark.parametrize("bending", [True, "auto"])
def test_stretched_plate_vibrates(bending):
    """J0(p r) and I0(q r), q^2 - p^2 = N a^2/D; w and its slope vanish on the rim."""
    N = 100.0

    def determinant(p):
        q = np.sqrt(p**2 + N)
        return float(p * jv(1, p) / jv(0, p) + q * iv(1, q) / iv(0, q))

    p = brentq(determinant, 2.41, 3.8)
    scene = plate(1000.0, tension=N, **{"probe": None, "film.bending": bending})
    film, D = scene.film, plate_stiffness(scene.film)[0, 0]
    unit = np.sqrt(D / (film.density * film.thickness)) / (2 * np.pi * film.radius**2)
    (found,) = modes(scene, 1).frequencies_Hz
    assert found == pytest.approx(p * np.sqrt(p**2 + N) * unit, rel=1e-4)
