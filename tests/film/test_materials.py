"""Films of several materials, unloaded and loaded: stretched, wrinkling, of rubber."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene, solve
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.film import Film
from pvdf_fem.solver.adaptive import compute_unloaded_charges, compute_unloaded_integrals
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import is_barely_loaded
from reports.reference.neo_hookean_inflation import inflated
from tests.helpers.discs import LOADS, TRIANGLE

WRINKLING = {"film.compression": "tension-field"}


@given(
    tension=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    thickness_um=st.floats(1.0, 500.0),
    moduli=st.tuples(st.floats(0.5, 5.0), st.floats(0.5, 5.0)),
)
def test_the_flat_film_has_the_pretension_of_its_key(tension, thickness_um, moduli):
    film = {"pretension_N_m": tension, "thickness_um": thickness_um, "youngs_modulus_GPa": moduli}
    film = Film(**film, poisson_ratio=0.3, d32_pC_N=-2.0)
    stress = np.array([*tension, 0.0]) / (1e-6 * thickness_um)
    assert film.prestress == pytest.approx(stress, rel=1e-15)
    scale = max(np.abs(stress).max(), 1.0)
    assert film.stiffness @ film.prestrain == pytest.approx(stress, abs=1e-14 * scale)
    if min(tension) >= 0.0:  # in compression no membrane is at rest
        found = compute_unloaded_charges(Problem.from_scene(Scene(film=film))) / (9e-6 * 1e-12)
        assert found == pytest.approx(stress @ [8.0, -2.0, 0.0], abs=1e-11 * scale)


@pytest.mark.parametrize("across", [0.0, -1.0])
def test_the_smaller_tension_decides_whether_a_flat_film_is_stable(across):
    scene = TRIANGLE.with_(**{"film.pretension_N_m": [9.0, across], "load.force_N": 0.0})
    solution = solve(scene)
    assert solution.status is (Status.UNSTABLE if across else Status.CONVERGED)
    assert np.isnan(solution.rest_charges_pC["A"]) == bool(across)
    # wrinkles along x leave E h times the strain along x, which is (N1 - ν N2)/(E h)
    tension = (
        compute_unloaded_integrals(Problem.from_scene(scene.with_(**WRINKLING))).values[0]
        / 9e-6
        * scene.film.thickness
    )
    assert tension == pytest.approx([9.0 - 0.34 * across, 0.0], abs=1e-9)
    # cooled, E1 + ν12 E2 < 0 pushes along x, however negative the free strain is
    auxetic = {"film.youngs_modulus_GPa": [1.0, 10.0], "film.poisson_ratio": -0.3}
    assert solve(TRIANGLE.with_(**auxetic, **{"load.force_N": 0.0})).status is Status.UNSTABLE


# wrinkling

HEATED = TRIANGLE.with_(**WRINKLING, **{"film.temperature_change_K": 10.0})


@pytest.mark.parametrize(
    ("kind", "force_N"), [("dead", 1e-2), ("follower", 1.0), ("sliding", 1e-2), ("sliding", 1.0)]
)
def test_slack_film_has_a_result_under_any_load(force_N, kind):
    changes = {**LOADS[kind], "load.force_N": force_N, "numerics.tolerance": 0.1}
    result = solve(HEATED.with_(**changes))
    assert result.status is Status.CONVERGED
    assert result.force_balance < 1e-6
    s11, s22, s12 = np.moveaxis(result.discrete.state.stress, -1, 0)
    assert (s11 * s22 - s12**2).min() > -1e-9 * max(s11.max(), s22.max()) ** 2


@pytest.mark.slow
def test_a_load_on_a_line_of_slack_film_has_a_status():
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
    assert is_barely_loaded(scene)
    solution = solve(scene)
    assert solution.status is Status.SLACK
    assert "charges_pC" not in solution.to_json()


# rubber

RUBBER = Scene().with_(
    **{
        "film.law": "neo-hookean",
        "film.youngs_modulus_GPa": 1e-3,
        "film.thickness_um": 200.0,
        "film.temperature_change_K": 0.0,
    }
)


def test_the_pretension_is_the_tension_of_unloaded_rubber():
    taut = {"film.pretension_N_m": [40.0, 15.0], "film.d31_pC_N": 1.0, "film.d32_pC_N": 0.0}
    charge = solve(RUBBER.with_(**taut)).charges_pC["A"]
    assert charge == pytest.approx(9e-6 * 40.0 / 200e-6, rel=1e-12)  # of 9 mm²


@pytest.mark.parametrize(("nu", "stretch"), [(0.49, 1.3), (0.3, 1.15)])
def test_an_inflated_disc_agrees_with_one_dimensional_equations(nu, stretch):
    exact, mu = inflated(stretch, nu), 1e6 / (2.0 * (1.0 + nu))
    pascal = exact.pressure * mu * 200e-6 / 45e-3
    changes = {"film.poisson_ratio": nu, "film.pressure_Pa": pascal}
    solution = solve(RUBBER.with_(**changes, **{"film.pressure_follows": True}))
    assert solution.deflection_max_mm / 45.0 == pytest.approx(exact.height, rel=2e-4)
    centre = 1e6 * float(solution.at(0.0, 0.0).stress_MPa[0])
    m = nu / (1.0 - nu)
    assert centre == pytest.approx(mu * (1.0 - stretch ** (-4.0 * m - 2.0)), rel=2e-3)


def test_strains_beyond_the_limit_of_a_law_have_a_warning():
    warned = []
    for law, pascal in (("neo-hookean", 600.0), ("hooke", 600.0), ("neo-hookean", 4500.0)):
        changes = {"film.law": law, "film.pressure_Pa": pascal, "film.poisson_ratio": 0.49}
        warnings = solve(RUBBER.with_(**changes)).warnings
        warned.append(any(text.startswith("strain") for text in warnings))
    assert warned == [False, True, True]
