"""Derivatives of the charges against differences of solves, and against closed forms."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pvdf_fem import NotConvergedError, Scene, solve, uncertainty
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.changes import get_number
from pvdf_fem.solver.sensitivity.gradients import gradients
from pvdf_fem.solver.sensitivity.parameters import PLACE_NAMES, list_parameters
from pvdf_fem.solver.sensitivity.rates import differentiate_stress_integrals
from reports.accuracy.drawn import make_random_scene
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE, charges, graded_mesh, values

PLACE = [f"probe.{name}" for name in PLACE_NAMES]
TURNED = TRIANGLE.with_(**{"probe.rotation_deg": 20.0, "film.d32_pC_N": 3.0})
ORTHOTROPIC = {"film.youngs_modulus_GPa": [2.0, 2.6], "film.poisson_ratio": 0.3}
TIGHT = {"film.pretension_N_m": 12.0}
UNEQUAL = {**ORTHOTROPIC, "film.pretension_N_m": [12.0, 5.0]}
EDGES = {"numerics.observable": "thesis-edge"}
RUBBER = {"film.law": "neo-hookean", "film.youngs_modulus_GPa": 1e-3, "film.poisson_ratio": 0.49}
RUBBER |= {"film.thickness_um": 200.0, **TIGHT}
TAPE = {"side_mm": 3.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0, "x_mm": 10.0, "y_mm": 0.0}
WARM = {"probe.temperature_K": 10.0, "film.pyroelectric_uC_m2K": 25.0}
WIRED = {"film.d31_pC_N": 60.0, "film.coupling": True, "readout.kind": "voltage"}
WEIGHT = {"film.gravity_m_s2": -2e3}
LIFTED = {"film.backing_N_m3": 2e5, "film.backing_one_sided": True}
PROBES = [
    {"shape": "triangle", "x_mm": -7.0, "y_mm": 3.0, "force_N": 0.4, "tangential_N": [0.0, 0.2]},
    {"shape": "circle", "radius_mm": 2.0, "x_mm": 5.0, "y_mm": -4.0},
]
FORCE_KEYS = {"probe[0].force_N", *(f"probe[0].tangential_N[{i}]" for i in (0, 1)), "load.force_N"}
SPHERE = {"shape": "sphere", "radius_mm": 5.0, "x_mm": 5.0, "y_mm": 1.0}


def difference(scene, direction, step, **how):
    """Compute the derivative of charges along changes by key: central, extrapolated, O(step^4)."""

    def at(s):
        changes = {key: get_number(scene, key) + s * d for key, d in direction.items()}
        return charges(scene.with_(**changes), **how)

    coarse, fine = ((at(s) - at(-s)) / (2 * s) for s in (step, step / 2))
    return (4 * fine - coarse) / 3


def along(derivatives, direction):
    return sum(d * values(derivatives[key]) for key, d in direction.items())


def test_derivatives_of_a_film_that_lifts_off_its_backing():
    """In differences, points of the quadrature pass from one side of the contact's edge to the
    other."""
    scene = TURNED.with_(**WEIGHT, **LIFTED)
    mesh = graded_mesh(scene, 3.0, 15.0)
    direction = {"film.backing_N_m3": 1e5, "film.gravity_m_s2": -1e3, "load.force_N": 0.5}
    derivatives = gradients(solve(scene, mesh=mesh, order=2), list(direction))
    expected = difference(scene, direction, 3e-3, mesh=mesh, order=2)
    assert along(derivatives, direction) == pytest.approx(expected, rel=2e-4)


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        *((load, {"film.temperature_change_K"}) for load in LOADS.values()),
        *(({**load, **EDGES}, set()) for load in LOADS.values()),
        (ORTHOTROPIC, {"film.youngs_modulus_GPa.1"}),
        ({**ORTHOTROPIC, "film.shear_modulus_GPa": 1.1}, {"film.youngs_modulus_GPa.1"}),
        (TIGHT, {"film.pretension_N_m"}),
        (UNEQUAL, {"film.pretension_N_m.0", "film.pretension_N_m.1"}),
        (RUBBER, {"film.pretension_N_m", "film.youngs_modulus_GPa"}),
        ({"film.patches": [TAPE]}, {"film.poisson_ratio"}),
        ({**RUBBER, "film.patches": [TAPE]}, {"film.thickness_um"}),
        (WARM, {"probe.temperature_K"}),
        ({"film.pressure_Pa": 100.0}, {"film.pressure_Pa"}),
        ({"film.gravity_m_s2": -200.0}, {"film.gravity_m_s2"}),
        ({"film.backing_N_m3": 2e5}, {"film.backing_N_m3", "film.thickness_um"}),
        (WIRED, {"load.force_N"}),
        ({"film.compression": "tension-field"}, {"load.force_N"}),
        ({"probe": PROBES}, FORCE_KEYS),
    ],
)
def test_derivatives_other_than_by_place_on_one_mesh(changes, keys):
    """On one mesh the adjoint gives the exact derivative of the discrete charges."""
    scene = TURNED.with_(**changes)
    mesh = graded_mesh(scene, 3.0, 15.0)
    signs = np.random.default_rng(5)
    keys_but_place = [
        key for key in list_parameters(Problem.from_scene(scene)) if not key.endswith(PLACE_NAMES)
    ]
    assert keys <= set(keys_but_place)
    direction = {
        k: signs.choice([-1.0, 1.0]) * (get_number(scene, k) or 0.1) for k in keys_but_place
    }
    derivatives = gradients(solve(scene, mesh=mesh, order=2), keys_but_place)
    expected = difference(scene, direction, 3e-3, mesh=mesh, order=2)
    assert along(derivatives, direction) == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize(
    ("scene", "direction"),
    [
        (TURNED, {"probe.x_mm": 0.3, "probe.y_mm": -0.2, "probe.rotation_deg": 2.0}),
        (TURNED.with_(**LOADS["follower"]), {"probe.x_mm": 0.3, "probe.rotation_deg": 2.0}),
        (TURNED.with_(**WARM, **{"probe.x_mm": 6.5}), {"probe.x_mm": 0.1, "probe.y_mm": -0.1}),
        (Scene(probe=PROBES), {"probe[0].x_mm": 0.3, "probe[1].y_mm": -0.4}),
        (Scene(probe=SPHERE, load={"kind": "contact"}), {"probe.x_mm": 0.3, "load.force_N": 0.1}),
        pytest.param(
            Scene(probe=SPHERE, load={"kind": "contact", "depth_mm": 2.5}),
            {"load.depth_mm": 0.1, "probe.y_mm": -0.2},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_derivatives_by_places_of_probes_and_tips(scene, direction):
    """Each place has its own mesh, so that both sides have discretisation errors."""
    scene = scene.with_(**{"numerics.tolerance": 1e-4})
    derivatives = gradients(solve(scene), list(direction))
    ends = (
        scene.with_(**{key: get_number(scene, key) + s * d for key, d in direction.items()})
        for s in (0.5, -0.5)
    )
    plus, minus = (charges(end) for end in ends)
    change = plus - minus
    true_errors = np.abs(along(derivatives, direction) - change)
    largest = np.abs(change).max()
    estimated = along(derivatives.errors, {key: abs(d) for key, d in direction.items()})
    assert (true_errors <= estimated + 4e-3 * largest).all()
    assert estimated.max() < 5e-2 * largest


def test_a_pressure_up_to_the_clamped_rim_has_no_derivative_by_place():
    derivatives = gradients(Scene(probe={"shape": "circle", "radius_mm": 45.0}), ["probe.x_mm"])
    assert np.abs(values(derivatives["probe.x_mm"])).max() < 1e-9


@pytest.fixture(scope="module")
def turned():
    return solve(TURNED)


def test_rates_of_stress_integrals_combine_to_those_of_charges(turned):
    keys = ["load.force_N", "probe.x_mm", "film.thickness_um"]
    derivatives = gradients(turned, keys)
    by_integrals = differentiate_stress_integrals(turned, keys) @ [8.0, 3.0]
    for key, rates in zip(keys, by_integrals, strict=True):
        assert values(derivatives[key]) == pytest.approx(rates, rel=1e-9)


def test_relative_errors_of_vanishing_derivatives_refer_to_the_charge_per_scale():
    """Opposite coefficients cancel under a disc at the centre, whatever is changed."""
    disc = {"shape": "circle", "radius_mm": 6.0, "x_mm": 0.0, "y_mm": 0.0}
    scene = Scene(film={"d32_pC_N": -8.0}, probe={**disc, "radius_mm": 4.0}, load={"force_N": 0.5})
    derivatives = gradients(scene.with_(electrodes=[{"name": "A", **disc}]))
    charge = (
        derivatives.solution.charges_by(8.0, 0.0)["A"]
        + derivatives.solution.charges_by(0.0, 8.0)["A"]
    )
    scales = {"probe.x_mm": 4.0, "load.force_N": 0.5, "film.thickness_um": 25.0}
    for key, scale in scales.items():
        assert abs(derivatives[key]["A"]) < 1e-3 * charge / scale
        part = derivatives.errors[key]["A"] * scale / charge
        assert derivatives.relative_errors[key] == pytest.approx(1e3 * part, rel=1e-6)
        assert part > 0.0
    for table in (derivatives, derivatives.errors):  # a disc has no orientation
        assert table["probe.rotation_deg"] == {"A": 0.0}
    assert derivatives.relative_errors["probe.rotation_deg"] == 0.0


def test_a_film_without_a_probe_has_only_its_own_parameters():
    """N0 alone: Q = A (d31 + d32) E α|ΔT|/(1 - ν), and Q = A (d31 N1 + d32 N2)/h of a given one."""
    tensioned = Scene().with_(**UNEQUAL, **{"film.d31_pC_N": 3.0})
    by_tension = 9.0 * np.array([3.0, 8.0]) / 25.0
    rates = {
        Scene(): {"film.temperature_change_K": -48.0, "film.poisson_ratio": 48.0 / (1 - 0.34)},
        tensioned: {f"film.pretension_N_m.{i}": by_tension[i] for i in (0, 1)}
        | {"film.thickness_um": -by_tension @ [12.0, 5.0] / 25.0}
        | {"film.poisson_ratio": 0.0, "film.youngs_modulus_GPa.0": 0.0},
    }
    for scene, expected in rates.items():
        derivatives = gradients(solve(scene))
        assert not any(key.startswith(("probe", "load")) for key in derivatives)
        for key, rate in expected.items():
            assert values(derivatives[key]) == pytest.approx(rate, rel=1e-9, abs=1e-7)


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        (TURNED.with_(**TIGHT), "film.temperature_change_K"),
        (RECTANGLE.with_(**LOADS["sliding"]), "probe.x_mm"),
        (RECTANGLE, "film.radius_mm"),
        (TURNED.with_(**WIRED), "film.d31_pC_N"),
        (TURNED.with_(**WIRED), "film.thickness_um"),
    ],
)
def test_refuses_keys_without_derivative(scene, key):
    with pytest.raises(ValueError, match=f'"{key}"'):
        gradients(scene, [key])


def test_refuses_a_solution_that_is_not_converged():
    slack = RECTANGLE.with_(**{"film.temperature_change_K": 10.0, "load.force_N": 0.0})
    with pytest.raises(NotConvergedError, match="unstable"):
        gradients(solve(slack))


@pytest.mark.parametrize("seed", [2, 4])
def test_estimated_errors_have_the_right_size(seed):
    """The reference is a much finer solve, whose errors are allowed for."""
    scene = make_random_scene(np.random.default_rng(seed), **{"numerics.tolerance": 5e-3})
    coarse = gradients(scene)
    fine = gradients(scene.with_(**{"numerics.tolerance": 1e-4}))
    coarse_values, expected, estimated, fine_errors = (
        np.array([list(table[key].values()) for key in coarse])
        for table in (coarse, fine, coarse.errors, fine.errors)
    )
    true_errors = np.abs(coarse_values - expected)
    assert np.all(estimated >= 0.3 * (true_errors - fine_errors))
    assert np.mean(estimated <= 10.0 * (true_errors + fine_errors)) > 0.6


def test_errors_do_not_depend_on_what_else_is_asked_for(turned):
    every, one = gradients(turned), gradients(turned, ["probe.rotation_deg"])
    assert list(one) == list(one.errors) == list(one.relative_errors) == ["probe.rotation_deg"]
    assert one.errors["probe.rotation_deg"] == every.errors["probe.rotation_deg"]
    assert one.solution is turned
    assert json.loads(json.dumps(one)) == one


def test_a_tolerance_of_derivatives(turned):
    """The rotation changes charges so little that its derivative needs finer charges."""
    key = "probe.rotation_deg"
    tolerance = 3e-2
    rough = gradients(turned, [key])
    derivatives = gradients(TURNED, [key], tolerance=tolerance)
    expected = values(gradients(solve(TURNED.with_(**{"numerics.tolerance": 1e-5})), [key])[key])
    errors = [np.abs(values(table[key]) - expected).max() for table in (rough, derivatives)]
    assert errors[1] <= tolerance * np.abs(expected).max() < errors[0]
    assert derivatives.relative_errors[key] <= tolerance < rough.relative_errors[key]
    assert derivatives.solution.scene.numerics.tolerance < TURNED.numerics.tolerance
    assert gradients(turned, [key], tolerance=0.5).solution is turned


def test_a_finer_tolerance_keeps_the_film_model():
    """At the usual tolerance this film is a membrane; but for finer charges it would bend."""
    auto = TURNED.with_(**{"film.bending": "auto", "film.thickness_um": 5.0})
    derivatives = gradients(auto, ["film.thickness_um"], tolerance=2e-4)
    assert derivatives.relative_errors["film.thickness_um"] <= 2e-4
    assert not derivatives.solution.included
    assert Problem.from_scene(
        derivatives.solution.scene.with_(**{"film.bending": "auto"})
    ).film.bends


def test_an_unreachable_tolerance_names_the_key_to_change():
    few = TURNED.with_(**{"numerics.max_unknowns": 4000})
    with pytest.raises(NotConvergedError, match=r"probe\.rotation_deg .*max_unknowns"):
        gradients(few, tolerance=1e-4)


def test_a_given_mesh_is_not_replaced():
    solution = solve(TURNED, mesh=graded_mesh(TURNED, 3.0, 15.0), order=2)
    assert gradients(solution, ["load.force_N"]).solution is solution
    for tolerance in (0.5, 0.0, -1e-3, 1.0, float("nan")):
        with pytest.raises(ValueError, match="tolerance"):
            gradients(solution, ["load.force_N"], tolerance=tolerance)


@pytest.mark.parametrize("name", ["width_mm", "height_mm", "corner_radius_mm"])
def test_sizes_of_the_film_have_no_derivative_and_say_so(name):
    film = {"shape": "rectangle", "width_mm": 60.0, "height_mm": 40.0}
    scene = Scene(film=film, probe={"shape": "circle", "radius_mm": 2.0})
    with pytest.raises(ValueError, match="size of the rim"):
        gradients(scene, [f"film.{name}"])
    with pytest.raises(ValueError, match="size of the rim"):
        uncertainty(scene, {f"film.{name}": 0.1})
