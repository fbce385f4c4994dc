"""A film that wrinkles: its law, its tangent, and films of which everything is known."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.laws.tension_field import TensionField
from pvdf_fem.scene.film import Film
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.newton import negative_pivots
from pvdf_fem.solvers.status import Status
from pvdf_fem.solvers.wrinkling import barely_loaded
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.axisymmetric_wrinkled import wrinkled_membrane
from tests.helpers.discs import RECTANGLE, TRIANGLE, free_disc, graded_mesh

WRINKLING = {"film.compression": "tension-field"}
FILMS = {
    "isotropic": Film(),
    "without Poisson's ratio": Film(poisson_ratio=0.0),
    "incompressible": Film(poisson_ratio=0.499),
    "orthotropic": Film(youngs_modulus_GPa=(50.0, 1.0), poisson_ratio=0.3),
    "soft in shear": Film(
        youngs_modulus_GPa=(1.0, 50.0), poisson_ratio=0.005, shear_modulus_GPa=0.01
    ),
}


def strains(count):
    return 1e-3 * np.random.default_rng(3).normal(size=(count, 3))


def determinant(tensor, shear=1.0):
    return tensor[..., 0] * tensor[..., 1] - (shear * tensor[..., 2]) ** 2


# the law


@pytest.mark.parametrize("film", FILMS.values(), ids=FILMS)
def test_stress_and_wrinkles_are_complementary(film):
    """The conditions of the minimum over P, which has no other solution."""
    law, strain = TensionField(film.stiffness), strains(3000)
    stress = law.stress(strain)
    wrinkles = stress @ law.compliance - strain
    size, most = np.abs(stress).max(), np.abs(strain).max()
    assert stress[:, :2].sum(axis=1).min() >= 0.0
    assert wrinkles[:, :2].sum(axis=1).min() > -1e-12 * most
    assert determinant(stress).min() > -1e-12 * size**2
    assert determinant(wrinkles, 0.5).min() > -1e-10 * most**2
    assert np.abs((stress * wrinkles).sum(axis=1)).max() < 1e-12 * size * most
    taut = np.abs(wrinkles).max(axis=1) < 1e-12 * most
    slack = ~stress.any(axis=1)
    assert min(taut.mean(), slack.mean(), (~taut & ~slack).mean()) > 0.1


def test_isotropic_film_in_its_principal_axes():
    film = Film(youngs_modulus_GPa=2.0, poisson_ratio=0.3)
    law = TensionField(film.stiffness)
    wrinkled = law.stress(np.array([[2e-3, -1e-3, 0.0]]))
    assert np.abs(wrinkled - np.array([[4e6, 0.0, 0.0]])).max() < 1e-8
    taut = np.array([[2e-3, -1e-4, 0.0]])
    assert law.stress(taut) == pytest.approx(taut @ film.stiffness)
    assert not law.stress(np.array([[-1e-5, -1e-3, 0.0]])).any()


@pytest.mark.parametrize("film", FILMS.values(), ids=FILMS)
def test_moduli_are_the_derivative_of_the_stress(film):
    law, strain = TensionField(film.stiffness / 1e9), strains(500)
    step = np.random.default_rng(4).normal(size=strain.shape)
    h = 1e-9
    differences = (law.stress(strain + h * step) - law.stress(strain - h * step)) / (2 * h)
    derivative = law.stress(strain + 1j * step).imag
    error = np.abs(derivative - differences).max(axis=1) / np.abs(derivative).max()
    # a kink between the two points, at most
    assert np.quantile(error, 0.99) < 1e-7


# the film


@pytest.fixture(scope="module")
def slack():
    scene = TRIANGLE.with_(**WRINKLING, **{"film.temperature_change_K": 10.0})
    return Equilibrium(scene, graded_mesh(TRIANGLE, 2.5, 12.0), 2)


def test_tangent_is_the_derivative_of_the_residual(slack):
    q = equilibrate(slack).q
    random = np.random.default_rng(6)
    step = random.normal(size=len(q)) * np.abs(q).max()
    state, h = slack.state(q), 1e-7

    def residual(s):
        return slack.residual(slack.state(q + s * step))

    differences = (residual(h) - residual(-h)) / (2 * h)
    least = slack.membrane.floor * slack.membrane.mean_tension(state)
    floor = slack.assembly.matrix(least * slack.space.laplace())
    product = (slack.tangent(state) - floor) @ step
    assert np.abs(product - differences).max() < 1e-5 * np.abs(product).max()
    assert np.abs(floor @ step).max() < 1e-6 * np.abs(product).max()


def test_solution_is_a_minimum(slack):
    result = equilibrate(slack)
    assert result.status is Status.CONVERGED
    assert negative_pivots(result.factors) == 0
    state = slack.state(result.q)
    assert np.linalg.norm(slack.residual(state)) < 1e-8

    def energy(q):
        state = slack.state(q)
        return slack.membrane.energy(state) - slack.work(state, q)

    least, random = energy(result.q), np.random.default_rng(7)
    for size in (1e-4, 1e-2, 1.0):
        step = random.normal(size=len(result.q))
        assert energy(result.q + size * np.abs(result.q).max() * step) > least


@pytest.fixture(scope="module")
def barely():
    scene = TRIANGLE.with_(**WRINKLING, **{"film.temperature_change_K": 10.0, "load.force_N": 1e-3})
    assert barely_loaded(scene)
    return Equilibrium(scene, graded_mesh(TRIANGLE, 3.0, 15.0), 3)


def test_a_barely_loaded_film_is_reached_from_any_start(barely):
    """The energy has one stress at its minimum, and that balances the load."""
    found = equilibrate(barely)
    other = equilibrate(barely, 100.0 * found.q)
    assert found.status is other.status is Status.CONVERGED
    assert negative_pivots(found.factors) == negative_pivots(other.factors) == 0
    states = [barely.state(result.q) for result in (found, other)]
    assert max(barely.imbalance(state) for state in states) < 1e-4 * barely.force
    difference = states[0].stress - states[1].stress
    assert np.abs(difference).max() < 1e-3 * np.abs(states[0].stress).max()


def test_start_does_not_matter(slack):
    q = equilibrate(slack).q
    other = equilibrate(slack, 3.0 * q)
    assert other.status is Status.CONVERGED
    stresses = slack.state(q).stress, slack.state(other.q).stress
    assert np.abs(stresses[0] - stresses[1]).max() < 1e-6 * np.abs(stresses[0]).max()


@pytest.mark.parametrize(("force_N", "temperature_change_K"), [(1e-3, -10.0), (100.0, 0.0)])
def test_taut_film_does_not_know_the_option(force_N, temperature_change_K):
    scene = RECTANGLE.with_(
        **{"load.force_N": force_N, "film.temperature_change_K": temperature_change_K}
    )
    plain = solve(scene)
    assert not any("compression" in warning for warning in plain.warnings)
    mesh = plain.mesh
    wrinkling = solve(scene.with_(**WRINKLING), mesh=mesh, order=2)
    same = solve(scene, mesh=mesh, order=2)
    assert wrinkling.charges_pC == pytest.approx(same.charges_pC, rel=1e-7)


@pytest.mark.parametrize("kind", ["dead", "follower", "rigid"])
@pytest.mark.parametrize("force_N", [1e-2, 1.0])
def test_slack_film_has_a_result_under_any_load(force_N, kind):
    scene = TRIANGLE.with_(
        **WRINKLING,
        **{
            "film.temperature_change_K": 10.0,
            "load.force_N": force_N,
            "load.kind": kind,
            "numerics.tolerance": 0.1,
        },
    )
    result = solve(scene)
    assert result.status is Status.CONVERGED
    assert result.force_balance < 1e-6
    stress = result.fields.state.stress
    assert determinant(stress).min() > -1e-9 * np.abs(stress).max() ** 2


def test_unloaded_slack_film_lies_flat():
    result = solve(
        RECTANGLE.with_(**WRINKLING, **{"film.temperature_change_K": 10.0, "load.force_N": 0.0})
    )
    assert result.status is Status.CONVERGED
    assert result.charges_pC == dict.fromkeys("ABCD", 0.0)


# the axisymmetric film


def test_reference_meets_the_taut_one():
    force, patch = 4.444e-4, 5 / 45
    taut = axisymmetric_membrane(force, poisson_ratio=0.3, patch_radius=patch)
    other = wrinkled_membrane(force, poisson_ratio=0.3, patch_radius=patch, thermal_strain=0.0)
    assert other.centre_deflection == pytest.approx(taut.centre_deflection, rel=1e-8)
    radii = np.array([0.01, 0.1, 0.5, 0.99])
    assert other.radial_tension(radii) == pytest.approx(taut.radial_tension(radii), rel=1e-8)
    assert other.hoop_tension(radii) == pytest.approx(taut.hoop_tension(radii), rel=1e-8)


@pytest.mark.parametrize(("force", "strain"), [(4.444e-4, 1.1e-3), (1e-6, 1.1e-3)])
def test_taut_centre_and_wrinkled_surroundings(force, strain):
    """The electrode covers the taut centre and wrinkled film around it."""
    patch, reach = 0.2, 0.4
    reference = wrinkled_membrane(
        force, poisson_ratio=0.34, patch_radius=patch, thermal_strain=strain
    )
    nodes, weights = np.polynomial.legendre.leggauss(400)
    r = reach * (nodes + 1) / 2
    tension = reference.radial_tension(r) + reference.hoop_tension(r)
    assert reference.hoop_tension(np.array([0.05]))[0] > 0.0
    assert reference.hoop_tension(np.array([0.9]))[0] == 0.0
    scene = free_disc(
        force,
        poisson_ratio=0.34,
        patch_radius=patch,
        **WRINKLING,
        **{
            "film.temperature_change_K": 1e3 * strain,
            "numerics.tolerance": 1e-4,
            "electrodes": [
                {"name": "A", "shape": "circle", "radius_mm": 50 * reach, "x_mm": 0.0, "y_mm": 0.0}
            ],
        },
    )
    result = solve(scene)
    film = scene.film
    scale = 8.0 * 2e9 * film.radius**2
    charge = scale * np.pi * reach * (weights * r * tension).sum()
    assert result.charges_pC["A"] == pytest.approx(charge, rel=2e-4)
    deflection = 1e3 * film.radius * reference.centre_deflection
    assert result.deflection_max_mm == pytest.approx(deflection, rel=5e-4)


@pytest.mark.slow
def test_a_load_that_hardly_reaches_the_film_is_named():
    """Beside a rigid probe of 0.01 mm at the rim: tension runs in a line or two."""
    star = [[8.0, 2.6], [3.3, 6.1], [-2.2, 7.5], [-8.8, -1.8], [-2.7, -4.5], [3.7, -4.3]]
    scene = Scene().with_(
        film={"radius_mm": 1.36, "thickness_um": 616.0, "poisson_ratio": 0.455}
        | {"temperature_change_K": 0.44, "compression": "tension-field"},
        electrodes={"layout": "four", "ring_radius_mm": 0.78, "side_mm": 0.6},
        probe={"shape": "polygon", "vertices_mm": (1e-3 * np.array(star)).tolist()}
        | {"x_mm": 0.3148, "y_mm": -1.3034, "rotation_deg": 65.1},
        load={"kind": "rigid", "contact": "stuck", "force_N": 3e-8},
    )
    assert barely_loaded(scene)
    solution = solve(scene)
    assert solution.status is Status.SLACK
    assert "charges_pC" not in solution.to_json()


@pytest.mark.slow
def test_a_load_far_too_small_is_named():
    """Tension runs in a few lines: more elements only make them thinner."""
    changes = {"film.temperature_change_K": 5.0, "load.force_N": 1e-12, **WRINKLING}
    changes |= {"numerics.tolerance": 1e-2, "numerics.max_unknowns": 2000}
    solution = solve(TRIANGLE.with_(**changes))
    assert solution.status is Status.SLACK
    assert "load.force_N" in solution.reason
    assert "charges_pC" not in solution.to_json()
