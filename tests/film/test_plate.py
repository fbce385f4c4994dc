"""Bending against plates: clamped, stretched, under a punch, vibrating; and its equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import iv, jv, kv

from pvdf_fem import solve
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.electrodes.stress_integrals import combine_charges, compute_stress_integrals
from pvdf_fem.film.bending.layers import (
    BendingLayers,
    estimate_missing_fraction,
    estimate_uncertain_fraction,
)
from pvdf_fem.film.bending.plate import Plate
from pvdf_fem.film.bending.plate_form import compute_plate_stiffness
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.six_node import compute_jacobian_ratios
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM, PROBE, RIM
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.first_sizes import choose_first_sizes
from pvdf_fem.solver.nonlinear.factors import count_negative_pivots, factorise
from reports.reference.circular_plate import stretched_plate_deflection
from tests.helpers.discs import (
    LOADS,
    RECTANGLE,
    TRIANGLE,
    free_disc,
    graded_mesh,
    model_mesh,
    uniform_mesh,
)

PLATE = {"film.bending": True}
# F a^2/(D h): the deflection is some 1e-4 h, and its square the error of the linear plate.
LOAD = 1e-2


def plate(thickness_um, patch_radius=1.0, tension=0.0, force=LOAD, **changes):
    """A film that bends, with `tension` N0 a^2/D, under so small a `force` that it is linear."""
    scene = free_disc(1.0, poisson_ratio=0.3, patch_radius=patch_radius)
    scene = scene.with_(**{"film.thickness_um": thickness_um, "numerics.tolerance": 1e-4, **PLATE})
    film = scene.film
    D = compute_plate_stiffness(film)[0, 0]
    strain = tension * D / film.radius**2 / (film.thickness * film.stiffness[:2, :2].sum() / 2)
    load = {"load.force_N": force * D * film.thickness / film.radius**2}
    cooling = {"film.temperature_change_K": -strain / film.thermal_expansion_per_K}
    return scene.with_(**load, **cooling, **changes)


def clamped(radius):
    """Deflection in F a^2/D under a uniform pressure."""
    return (1.0 - radius**2) ** 2 / (64.0 * np.pi)


def pressed(radius):
    """Deflection in F a^2/D of a plate with N0 a^2/D = 100 under a pressure on r < 0.2 a."""
    return 0.01 * stretched_plate_deflection(radius, patch_radius=0.2, bending_length=0.1)


def punched(radius, b=0.2, length=0.1):
    """Likewise around a rigid punch: the plate is flat at the punch's edge."""

    def functions(r):
        return np.array([np.ones_like(r), iv(0, r / length), kv(0, r / length)])

    def slopes(r):
        return np.array([0.0, iv(1, r / length), -kv(1, r / length)]) / length

    matrix = np.array([slopes(b), functions(np.array(1.0)), slopes(1.0)])
    factors = np.linalg.solve(matrix, np.array([1.0 / b, 0.0, 1.0]) / (2.0 * np.pi))
    outside = np.maximum(radius, b)
    return 0.01 * (np.tensordot(factors, functions(outside), 1) - np.log(outside) / (2.0 * np.pi))


@pytest.mark.parametrize(
    ("exact", "patch_radius", "tension", "load", "size_mm"),
    [
        (clamped, 1.0, 0.0, "dead", 2.0),
        (pressed, 0.2, 100.0, "dead", 1.0),
        (punched, 0.2, 100.0, "sliding", 1.0),
    ],
)
def test_deflection_of_plates_with_closed_forms(exact, patch_radius, tension, load, size_mm):
    """On a mesh of fixed sizes: charges of a nearly flat plate are second-order small."""
    scene = plate(20.0, patch_radius, tension, **LOADS[load])
    solution = solve(scene, mesh=graded_mesh(scene, size_mm, 2.0 * size_mm), order=3)
    radius = np.minimum(np.hypot(*solution.basis.doflocs) / scene.film.radius, 1.0)
    expected, w = LOAD * scene.film.thickness * exact(radius), solution.displacement[:, 2]
    assert w == pytest.approx(expected, rel=0.0, abs=1e-4 * expected.max())
    assert solution.force_balance < 1e-6


def solve_stretched(widths):
    """Solve in elements of so many bending lengths at the rim.

    Return the solution, the deflection of the membrane, and the deflection lost by bending in m.
    """
    length = 0.05 / widths
    scene = plate(1.0, 0.5, length**-2, LOAD * length**-2)
    radius = scene.film.radius
    sizes = GradedSizes({FILM: 0.05 * radius, PROBE: 0.15 * radius}, 0.5, 0.15 * radius)
    scale = LOAD * scene.film.thickness
    membrane = scale * (np.log(2.0) + 0.5) / (2.0 * np.pi)
    bent = scale * stretched_plate_deflection(0.0, patch_radius=0.5, bending_length=length)
    return solve(scene, mesh=model_mesh(scene, sizes), order=3), membrane, membrane - bent


@pytest.mark.parametrize("widths", [3.0, 10.0, 25.0, 200.0])
def test_deflection_lost_in_a_layer_narrower_than_the_elements(widths):
    solution, membrane, lost = solve_stretched(widths)
    found = membrane - 1e-3 * solution.deflection_max_mm
    assert found / lost == pytest.approx(1.0, abs=0.08)


def find_uncertain_change(solution):
    """Return the change of the unknowns by uncertain bending forces, and the layers."""
    solved, state = solution.discrete.solved, solution.discrete.solved_state
    layers = solved.model.make_bending_layers(solved.terms, solved.unknowns.expansion, state)
    return layers.compute_change_of_unknowns(factorise(solved.tangent(state))), layers


def test_a_part_of_the_bending_forces_is_uncertain():
    solution, _, lost = solve_stretched(200.0)
    change, layers = find_uncertain_change(solution)
    centre = np.hypot(*solution.basis.doflocs).argmin()
    found = solution.discrete.solved.dofs(change)[2::3][centre] / lost
    uncertain = estimate_uncertain_fraction(layers.widths.max())  # a fit, here within 6 %
    assert found == pytest.approx(-uncertain, rel=0.13)


def test_the_stated_error_covers_the_uncertain_forces():
    scene = RECTANGLE.with_(**{"film.thickness_um": 9.0}, **PLATE)
    solution = solve(scene, mesh=graded_mesh(scene, 2.0, 8.0))
    outputs, solved, q = (
        Problem.from_scene(scene).outputs,
        solution.discrete.solved,
        solution.discrete.q,
    )
    without, with_layers = (
        1e12
        * combine_charges(
            outputs, compute_stress_integrals(outputs, solved.membrane, solved.dofs(at))
        )
        for at in (q, q + find_uncertain_change(solution)[0])
    )
    stated = np.array([*solution.charge_errors_pC.values()])
    assert np.all(stated >= np.abs(with_layers - without))


# the equations

ORTHOTROPIC = {"film.youngs_modulus_GPa": [50.0, 1.0], "film.poisson_ratio": 0.34}


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("material", [{}, ORTHOTROPIC, {"film.poisson_ratio": 0.499}])
def test_clamped_film_resists_any_bending(order, material):
    """Elements from 1 to 40 mm, and beside a cusp where the probe's circle touches electrodes."""
    cusp = plate(20.0, 0.2, 100.0)
    beside = model_mesh(cusp, choose_first_sizes(Problem.from_scene(cusp), 3))
    assert compute_jacobian_ratios(beside).min() > 0.2
    film = TRIANGLE.with_(**material).film
    for mesh in (graded_mesh(TRIANGLE, 1.0, 40.0, 1.5), *([] if material else [beside])):
        space = Space(mesh, order)
        matrix = Plate(space, film, []).form.matrix
        free = np.setdiff1d(np.arange(space.basis.N), space.basis.get_dofs(RIM).all())
        assert abs(matrix - matrix.T).max() <= 1e-12 * abs(matrix).max()
        assert count_negative_pivots(factorise(matrix[free][:, free].tocsc())) == 0


@pytest.mark.parametrize("order", [2, 3, 4])
def test_flat_film_and_constant_moments_need_no_forces(order):
    """At nodes of straight-sided elements; their neighbours' edges are straight too."""
    space = Space(uniform_mesh(TRIANGLE, 6.0), order)
    matrix, (x, y) = Plate(space, TRIANGLE.film, []).form.matrix, space.basis.doflocs
    inner = np.hypot(x, y) < 0.6 * TRIANGLE.film.radius
    for w in (np.ones_like(x), x - 2.0 * y, x**2 - 3.0 * x * y + 0.5 * y**2):
        forces = matrix @ w
        assert np.abs(forces[inner]).max() < 1e-10 * abs(matrix).max() * np.abs(w).max()


@pytest.mark.parametrize("bending", [True, "auto"])
def test_stretched_plate_vibrates(bending):
    """J0(p r) and I0(q r), q^2 - p^2 = N a^2/D; w and its slope vanish on the rim."""
    N = 100.0

    def determinant(p):
        q = np.sqrt(p**2 + N)
        return float(p * jv(1, p) / jv(0, p) + q * iv(1, q) / iv(0, q))

    p = brentq(determinant, 2.41, 3.8)
    scene = plate(1000.0, tension=N, **{"probe": None, "film.bending": bending})
    film, D = scene.film, compute_plate_stiffness(scene.film)[0, 0]
    unit = np.sqrt(D / (film.density * film.thickness)) / (2 * np.pi * film.radius**2)
    (found,) = modes(scene, 1).frequencies_Hz
    assert found == pytest.approx(p * np.sqrt(p**2 + N) * unit, rel=1e-4)


@pytest.mark.parametrize("reduction", [0.5, 0.7, 0.9])
def test_sizes_leave_the_error_that_is_allowed(reduction):
    """Elements of all widths and effects; those with little error stay."""
    random = np.random.default_rng(1)
    lengths, widths, effects = 10.0 ** random.uniform(
        [[-3], [-1], [-4]], [[0], [1.3], [0]], (3, 500)
    )
    wanted = reduction * (effects * estimate_missing_fraction(widths)).sum()
    sizes = BendingLayers(None, None, lengths, widths, np.empty(0)).choose_sizes(effects, wanted)
    now = effects * estimate_missing_fraction(np.minimum(sizes / lengths, widths))
    assert 0.5 * wanted <= now.sum() <= wanted * (1.0 + 1e-3)
    assert np.isinf(sizes).any()
