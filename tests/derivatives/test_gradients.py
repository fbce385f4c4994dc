"""Derivatives of the charges against differences of solves, and against similarity."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pvdf_fem import NotConvergedError, Scene, solve
from pvdf_fem.derivatives.gradients import gradients
from pvdf_fem.derivatives.parameters import parameters_of
from pvdf_fem.film.models import film_model
from pvdf_fem.scene.change import steps_of
from reports.accuracy.drawn import random_scene
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE, graded_mesh

OBSERVABLES = ("material", "thesis-edge")
PLACE = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg")
TURNED = TRIANGLE.with_(**{"probe.rotation_deg": 20.0, "film.d32_pC_N": 3.0})
ORTHOTROPIC = TURNED.with_(**{"film.youngs_modulus_GPa": [2.0, 2.6], "film.poisson_ratio": 0.3})
STIFF_IN_SHEAR = ORTHOTROPIC.with_(**{"film.shear_modulus_GPa": 1.1})
TIGHT = TURNED.with_(**{"film.pretension_N_m": 12.0})
UNEQUAL = ORTHOTROPIC.with_(**{"film.pretension_N_m": [12.0, 5.0]})


def value(scene, key):
    for name in steps_of(key):
        scene = scene[name] if isinstance(name, int) else getattr(scene, name)
    return scene


def charges(scene, **how):
    return np.array(list(solve(scene, **how).charges_pC.values()))


def difference(scene, direction, step, **how):
    """Derivative of the charges along changes by key, central and extrapolated: O(step^4)."""

    def at(s):
        return charges(
            scene.with_(**{key: value(scene, key) + s * d for key, d in direction.items()}), **how
        )

    coarse, fine = ((at(s) - at(-s)) / (2 * s) for s in (step, step / 2))
    return (4 * fine - coarse) / 3


def along(found, direction):
    return sum(d * np.array(list(found[key].values())) for key, d in direction.items())


@pytest.mark.parametrize("observable", OBSERVABLES)
@pytest.mark.parametrize("load", LOADS)
def test_force_and_film_on_one_mesh(load, observable):
    """On one mesh the adjoint gives the derivative of the discrete charges: rounding is left."""
    scene = TURNED.with_(**LOADS[load], **{"numerics.observable": observable})
    check_on_one_mesh(scene)


@pytest.mark.parametrize("scene", [ORTHOTROPIC, STIFF_IN_SHEAR])
def test_both_moduli_of_an_orthotropic_film(scene):
    assert "film.youngs_modulus_GPa.1" in check_on_one_mesh(scene)


@pytest.mark.parametrize("observable", OBSERVABLES)
@pytest.mark.parametrize("scene", [TIGHT, UNEQUAL], ids=["even", "unequal"])
def test_film_of_given_pretension(scene, observable):
    keys = check_on_one_mesh(scene.with_(**{"numerics.observable": observable}))
    assert "film.temperature_change_K" not in keys
    ends = ("",) if scene is TIGHT else (".0", ".1")
    assert {f"film.pretension_N_m{end}" for end in ends} < set(keys)


@pytest.mark.parametrize("scene", [TIGHT, UNEQUAL], ids=["even", "unequal"])
def test_each_key_of_a_film_of_given_pretension(scene):
    """One by one, so that errors of two keys cannot cancel."""
    mesh = graded_mesh(scene, 3.0, 15.0)
    found = gradients(solve(scene, mesh=mesh, order=2))
    for key in (key for key in found if key.startswith("film.") and "d3" not in key):
        direction = {key: value(scene, key)}
        expected = difference(scene, direction, 4e-3, mesh=mesh, order=2)
        assert along(found, direction) == pytest.approx(expected, rel=2e-6), key


def check_on_one_mesh(scene):
    mesh = graded_mesh(scene, 3.0, 15.0)
    keys = [key for key in parameters_of(scene) if key not in PLACE]
    shares = np.random.default_rng(5).choice([-1.0, 1.0], len(keys)) * np.linspace(
        0.5, 1, len(keys)
    )
    direction = {k: s * value(scene, k) for k, s in zip(keys, shares, strict=True)}
    found = gradients(solve(scene, mesh=mesh, order=2), keys)
    expected = difference(scene, direction, 4e-3, mesh=mesh, order=2)
    assert along(found, direction) == pytest.approx(expected, rel=1e-6)
    return keys


@pytest.mark.parametrize("load", [pytest.param("dead", marks=pytest.mark.slow), "follower"])
def test_place_of_the_probe(load):
    """Each place has a mesh of its own, so both sides carry errors of the discretisation.

    The two loads differ by more than the bound.
    """
    scene = TURNED.with_(**LOADS[load], **{"numerics.tolerance": 1e-5})
    direction = {"probe.x_mm": 0.3, "probe.y_mm": -0.2, "probe.rotation_deg": 2.0}
    found = gradients(solve(scene), PLACE)
    expected = difference(scene, direction, 0.5)
    assert np.abs(along(found, direction) - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.fixture(scope="module")
def turned():
    return solve(TURNED)


def test_force_thickness_and_modulus_by_similarity(turned):
    """Without bending Q = E g(F/(E h)) with the stress, whatever the pretension's strain."""
    found, film = gradients(turned), TURNED.film
    by_force = TURNED.load.force_N * along(found, {"load.force_N": 1.0})
    by_thickness = film.thickness_um * along(found, {"film.thickness_um": 1.0})
    by_modulus = film.youngs_modulus_GPa * along(found, {"film.youngs_modulus_GPa": 1.0})
    charge = np.array(list(turned.charges_pC.values()))
    assert by_thickness == pytest.approx(-by_force, rel=1e-8)
    assert by_modulus == pytest.approx(charge - by_force, rel=1e-8)


def test_piezoelectric_coefficients(turned):
    found = gradients(turned, ["film.d31_pC_N", "film.d32_pC_N"])
    assert list(found) == ["film.d31_pC_N", "film.d32_pC_N"]
    assert found["film.d31_pC_N"] == pytest.approx(turned.charges(1.0, 0.0))
    assert found["film.d32_pC_N"] == pytest.approx(turned.charges(0.0, 1.0))


def test_a_disc_has_no_orientation():
    scene = TURNED.with_(**{"probe.shape": "circle", "probe.radius_mm": 4.0})
    found = gradients(solve(scene), PLACE)
    assert set(found["probe.rotation_deg"].values()) == {0.0}
    assert set(found.errors["probe.rotation_deg"].values()) == {0.0}
    assert found.relative_errors["probe.rotation_deg"] == 0.0
    assert min(found.errors["probe.x_mm"].values()) > 0.0


def test_a_film_without_a_probe_has_only_its_own_parameters():
    solution = solve(Scene())
    found = gradients(solution)
    assert not any(key.startswith(("probe", "load")) for key in found)
    # N0 alone: Q = A (d31 + d32) E α|ΔT|/(1 - ν)
    for name, charge in solution.charges_pC.items():
        assert found["film.temperature_change_K"][name] == pytest.approx(-charge, rel=1e-9)
        by_poisson = charge / (1 - 0.34)
        assert found["film.poisson_ratio"][name] == pytest.approx(by_poisson, rel=1e-9)


def test_force_thickness_and_modulus_by_similarity_at_a_pretension():
    """Q = E g(F/(E h), N/(E h)): forces and tension count over the thickness."""
    solution = solve(TIGHT)
    found, film = gradients(solution), TIGHT.film
    by_force = TIGHT.load.force_N * along(found, {"load.force_N": 1.0})
    by_tension = film.pretension_N_m * along(found, {"film.pretension_N_m": 1.0})
    by_thickness = film.thickness_um * along(found, {"film.thickness_um": 1.0})
    by_modulus = film.youngs_modulus_GPa * along(found, {"film.youngs_modulus_GPa": 1.0})
    charge = np.array(list(solution.charges_pC.values()))
    assert by_thickness == pytest.approx(-by_force - by_tension, rel=1e-8)
    assert by_modulus == pytest.approx(charge - by_force - by_tension, rel=1e-8)


def test_a_flat_film_of_given_pretension_knows_no_stiffness():
    """Q = A (d31 N1 + d32 N2)/h."""
    scene = Scene().with_(**{"film.pretension_N_m": [12.0, 5.0], "film.d31_pC_N": 3.0})
    found = gradients(solve(scene))
    charge = 9e-6 * (3.0 * 12.0 + 8.0 * 5.0) / 25e-6
    for name in "ABCD":
        assert found["film.pretension_N_m.0"][name] == pytest.approx(9.0 * 3.0 / 25.0, rel=1e-9)
        assert found["film.pretension_N_m.1"][name] == pytest.approx(9.0 * 8.0 / 25.0, rel=1e-9)
        assert found["film.thickness_um"][name] == pytest.approx(-charge / 25.0, rel=1e-9)
        assert found["film.youngs_modulus_GPa"][name] == pytest.approx(0.0, abs=1e-9 * charge)
        assert found["film.poisson_ratio"][name] == pytest.approx(0.0, abs=1e-9 * charge)


@pytest.mark.parametrize(
    ("scene", "key", "match"),
    [
        (TIGHT, "film.temperature_change_K", "'film.temperature_change_K' is not a parameter"),
        (RECTANGLE.with_(**LOADS["sliding"]), "probe.x_mm", "'probe.x_mm' of a rigid probe"),
        (RECTANGLE, "film.radius_mm", "'film.radius_mm' is not a parameter"),
    ],
)
def test_what_has_no_derivative_is_refused(scene, key, match):
    solution = solve(scene.with_(**{"numerics.tolerance": 1e-2}))
    with pytest.raises(ValueError, match=match):
        gradients(solution, [key])


def test_no_solution_has_no_gradients():
    slack = RECTANGLE.with_(**{"film.temperature_change_K": 10.0, "load.force_N": 0.0})
    with pytest.raises(NotConvergedError, match="unstable"):
        gradients(solve(slack))


@pytest.mark.parametrize("seed", range(2, 10))
def test_errors_are_of_the_right_size(seed):
    """Against a much finer tolerance, whose own errors count for it and against it."""
    scene = random_scene(np.random.default_rng(seed), **{"numerics.tolerance": 5e-3})
    coarse = gradients(scene)
    fine = gradients(scene.with_(**{"numerics.tolerance": 1e-4}))
    found, expected, stated, left = (
        np.array([list(table[key].values()) for key in coarse])
        for table in (coarse, fine, coarse.errors, fine.errors)
    )
    true = np.abs(found - expected)
    assert np.all(stated >= 0.3 * (true - left))
    assert np.mean(stated <= 10.0 * (true + left)) > 0.6


def test_errors_do_not_depend_on_what_else_is_asked_for(turned):
    every, one = gradients(turned), gradients(turned, ["probe.rotation_deg"])
    assert list(one) == list(one.errors) == list(one.relative_errors) == ["probe.rotation_deg"]
    assert one.errors["probe.rotation_deg"] == every.errors["probe.rotation_deg"]
    assert one.solution is turned
    assert json.loads(json.dumps(one)) == one


def test_tolerance_of_their_own(turned):
    """By the rotation a charge changes so little that its derivative needs finer charges."""
    key, tolerance = "probe.rotation_deg", 3e-2
    rough, found = gradients(turned, [key]), gradients(TURNED, [key], tolerance=tolerance)
    expected = gradients(solve(TURNED.with_(**{"numerics.tolerance": 1e-5})), [key])
    limit = tolerance * max(map(abs, expected[key].values()))
    errors = [
        {name: abs(value - expected[key][name]) for name, value in table[key].items()}
        for table in (rough, found)
    ]
    assert rough.relative_errors[key] > tolerance
    assert max(errors[0].values()) > limit
    assert found.relative_errors[key] <= tolerance
    assert max(errors[1].values()) <= limit
    assert found.solution.scene.numerics.tolerance < TURNED.numerics.tolerance
    assert gradients(turned, [key], tolerance=0.5).solution is turned


def test_a_finer_tolerance_keeps_the_model():
    """At the usual tolerance this film is a membrane; but for finer charges it would bend."""
    auto = TURNED.with_(**{"film.bending": "auto", "film.thickness_um": 5.0})
    found = gradients(auto, ["film.thickness_um"], tolerance=2e-4)
    assert found.relative_errors["film.thickness_um"] <= 2e-4
    assert not found.solution.included
    finer = found.solution.scene.with_(**{"film.bending": "auto"})
    assert film_model(finer).bends


def test_unreachable_tolerance_names_what_to_change():
    few = TURNED.with_(**{"numerics.max_unknowns": 4000})
    match = r"tolerance_not_reached: .*probe\.rotation_deg .*tolerance = 0\.0001 .*max_unknowns"
    with pytest.raises(NotConvergedError, match=match):
        gradients(few, tolerance=1e-4)


def test_a_mesh_that_was_given_is_not_left():
    solution = solve(TURNED, mesh=graded_mesh(TURNED, 3.0, 15.0), order=2)
    assert gradients(solution, ["load.force_N"]).solution is solution
    with pytest.raises(ValueError, match="tolerance"):
        gradients(solution, ["load.force_N"], tolerance=0.5)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1.0, float("nan")])
def test_tolerance_out_of_range_is_refused_before_meshing(tolerance, monkeypatch):
    monkeypatch.setattr("pvdf_fem.derivatives.gradients.solve", None)
    with pytest.raises(ValueError, match=r"tolerance = .*give a number from 0 to 1"):
        gradients(TURNED, tolerance=tolerance)


PROBES = [
    {"shape": "triangle", "x_mm": -7.0, "y_mm": 3.0, "force_N": 0.4, "tangential_N": [0.1, 0.2]},
    {"shape": "circle", "radius_mm": 2.0, "x_mm": 5.0, "y_mm": -4.0},
]
FORCE_KEYS = {"probe[0].force_N", *(f"probe[0].tangential_N[{i}]" for i in (0, 1)), "load.force_N"}
SPHERE = {"shape": "sphere", "radius_mm": 5.0, "x_mm": 5.0, "y_mm": 1.0}


def test_forces_of_several_probes_by_their_own_keys():
    scene = Scene(probe=PROBES, numerics={"tolerance": 1e-4})
    assert set(parameters_of(scene)) > FORCE_KEYS
    direction = {key: 0.1 + 0.05 * i for i, key in enumerate(sorted(FORCE_KEYS))}
    found = gradients(solve(scene), sorted(FORCE_KEYS))
    expected = difference(scene, direction, 0.2)
    assert along(found, direction) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("scene", "direction"),
    [
        (Scene(probe=PROBES), {"probe[0].x_mm": 0.3, "probe[1].y_mm": -0.4}),
        (Scene(probe=SPHERE, load={"kind": "contact"}), {"probe.x_mm": 0.3, "load.force_N": 0.1}),
        (
            Scene(probe=SPHERE, load={"kind": "contact", "depth_mm": 2.5}),
            {"load.depth_mm": 0.1, "probe.y_mm": -0.2},
        ),
    ],
)
def test_places_of_several_probes_and_of_tips(scene, direction):
    scene = scene.with_(**{"numerics.tolerance": 1e-4})
    found = gradients(solve(scene), list(direction))
    plus, minus = (
        charges(scene.with_(**{key: value(scene, key) + s * d for key, d in direction.items()}))
        for s in (0.5, -0.5)
    )
    expected = plus - minus
    wrong, most = np.abs(along(found, direction) - expected), np.abs(expected).max()
    stated = along(found.errors, {key: abs(d) for key, d in direction.items()})
    assert (wrong <= stated + 2e-3 * most).all()
    assert stated.max() < 3e-2 * most


def test_a_sphere_that_turns_changes_nothing():
    scene = Scene(probe=SPHERE, load={"kind": "contact"})
    found = gradients(solve(scene), ["probe.rotation_deg", "probe.y_mm"])
    assert max(map(abs, found["probe.rotation_deg"].values())) == 0.0
    assert max(map(abs, found["probe.y_mm"].values())) > 1.0
