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
from tests.helpers.discs import RECTANGLE, TRIANGLE, graded_mesh

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


def test_taut_film_does_not_know_the_option():
    scene = RECTANGLE.with_(**{"load.force_N": 100.0, "film.temperature_change_K": 0.0})
    plain = solve(scene)
    assert not any(text.startswith("compression") for text in plain.warnings)
    wrinkling, same = (
        solve(s, mesh=plain.mesh, order=2).charges_pC for s in (scene.with_(**WRINKLING), scene)
    )
    assert wrinkling == pytest.approx(same, rel=1e-7)


@pytest.mark.parametrize("kind", ["dead", "follower", "rigid"])
@pytest.mark.parametrize("force_N", [1e-2, 1.0])
def test_slack_film_has_a_result_under_any_load(force_N, kind):
    heated = TRIANGLE.with_(**WRINKLING, **{"film.temperature_change_K": 10.0})
    changes = {"load.force_N": force_N, "load.kind": kind, "numerics.tolerance": 0.1}
    result = solve(heated.with_(**changes))
    assert result.status is Status.CONVERGED
    assert result.force_balance < 1e-6
    stress = result.fields.state.stress
    assert determinant(stress).min() > -1e-9 * np.abs(stress).max() ** 2


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
