"""A pressure on the whole film and the film's weight, as keys of a scene."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, build_response, gradients, solve, sweep
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import campbell
from tests.helpers.discs import free_disc

SENSOR = Scene().with_(**{"film.d32_pC_N": 3.0, "numerics.tolerance": 1e-3})
PROBE = {"shape": "circle", "radius_mm": 4.0, "x_mm": 12.0, "y_mm": 3.0}
TOUCHED = SENSOR.with_(probe=PROBE, **{"load.force_N": 0.3})
BULGED = SENSOR.with_(**{"film.pressure_Pa": 300.0})


def scale_free(pressure: float, **changes: object) -> tuple[Scene, float]:
    """A scene under p a/(E h) without a probe, and its radius in mm."""
    scene = free_disc(0.0, poisson_ratio=0.3, **{"numerics.tolerance": 1e-4, **changes})
    film = scene.film
    pascal = pressure * 2e9 * film.thickness / film.radius
    return scene.with_(**{"probe": None, "film.pressure_Pa": pascal}), film.radius_mm


@pytest.mark.parametrize("pretension", [0.0, 0.1, 1.0])
def test_a_weak_pressure_is_campbells(pretension):
    """J. D. Campbell, Q. J. Mech. Appl. Math. 9 (1956) 84-93; without pretension Hencky's."""
    load = 1e-6
    tension = pretension * load ** (2 / 3)
    scene, a = scale_free(load)
    cooled = -tension * 0.7 / scene.film.thermal_expansion_per_K
    solution = solve(scene.with_(**{"film.temperature_change_K": cooled}))
    exact = campbell(pretension, 0.3).centre_deflection * load ** (1 / 3)
    assert solution.deflection_max_mm / a == pytest.approx(exact, rel=2e-4)
    assert solution.force_balance < 1e-6


@pytest.mark.parametrize("follows", [False, True])
def test_a_strong_pressure_is_fichters(follows):
    """The problem of W. B. Fichter, NASA TP-3658 (1997), with Green-Lagrange strains."""
    scene, a = scale_free(1e-2, **{"film.radius_mm": 50.0})
    scene = scene.with_(**{"film.pressure_follows": follows})
    kind = "follower" if follows else "dead"
    exact = axisymmetric_membrane(math.pi * 1e-2, poisson_ratio=0.3, kind=kind)
    assert solve(scene).deflection_max_mm / a == pytest.approx(exact.centre_deflection, rel=1e-4)


@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_a_probe_as_large_as_the_film_presses_as_the_pressure_does(kind):
    radius = SENSOR.film.radius_mm
    force = 300.0 * math.pi * SENSOR.film.radius**2
    covered = SENSOR.with_(
        **{"probe": {"shape": "circle", "radius_mm": radius}, "load.force_N": force},
        **{"load.kind": kind},
    )
    follows = {"film.pressure_follows": kind == "follower"}
    found, wanted = solve(BULGED.with_(**follows)), solve(covered)
    assert found.charges_pC == pytest.approx(wanted.charges_pC, rel=2e-3)
    assert found.rest_charges_pC == pytest.approx(wanted.rest_charges_pC, rel=1e-12)


def test_a_probe_presses_beside_a_pressure():
    """The stiffened film has less charge by the probe; balance holds with both."""
    beside = solve(TOUCHED.with_(**{"film.pressure_Pa": 300.0}))
    applied = 0.3 + 300.0 * math.pi * SENSOR.film.radius**2
    force = beside.fields.equilibrium.applied_force(beside.fields.state)
    assert force[2] == pytest.approx(applied, rel=1e-3)
    assert beside.force_balance < 1e-6
    alone, touched = solve(BULGED), solve(TOUCHED)
    added = beside.charges_pC["A"] - alone.charges_pC["A"]
    assert 0.0 < added < touched.charges_pC["A"] - touched.rest_charges_pC["A"]


def test_weight_is_there_at_rest_and_a_pressure_is_not():
    heavy = solve(SENSOR.with_(**{"film.gravity_m_s2": -9.81e2}))
    flat = solve(SENSOR)
    assert heavy.charges_pC["A"] > 1.01 * flat.charges_pC["A"]
    assert heavy.rest_charges_pC == pytest.approx(heavy.charges_pC, rel=1e-9)
    assert solve(BULGED).rest_charges_pC == pytest.approx(flat.charges_pC, rel=1e-12)


def test_weight_that_is_left_out_is_told_where_it_matters():
    def about_weight(solution):
        return [text for text in solution.left_out if "film.gravity_m_s2" in text]

    light = TOUCHED.with_(**{"load.force_N": 0.02})
    assert about_weight(solve(light))
    assert not about_weight(solve(TOUCHED.with_(**{"load.force_N": 20.0})))
    with_weight = solve(light.with_(**{"film.gravity_m_s2": -9.81}))
    assert not about_weight(with_weight)
    change = with_weight.charge_changes_pC["A"] / solve(light).charge_changes_pC["A"] - 1.0
    assert 1e-3 < abs(change) < 0.1


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        (TOUCHED.with_(**{"film.pressure_Pa": 100.0}), "film.pressure_Pa"),
        (TOUCHED.with_(**{"film.gravity_m_s2": -200.0}), "film.gravity_m_s2"),
        (BULGED.with_(**{"film.pressure_follows": True}), "film.thickness_um"),
    ],
)
def test_gradients_are_those_of_solves(scene, key):
    scene = scene.with_(**{"numerics.tolerance": 1e-4})
    found, value = gradients(scene, [key]), getattr(scene.film, key.partition(".")[2])
    moved = [solve(scene.with_(**{key: value * (1.0 + s)})).charges_pC for s in (0.03, -0.03)]
    for name, rate in found[key].items():
        wanted = (moved[0][name] - moved[1][name]) / (0.06 * value)
        assert rate == pytest.approx(wanted, rel=5e-3)
        assert found.errors[key][name] < 1e-2 * abs(rate)


def test_a_sweep_and_json_have_them():
    axes = [{"film.pressure_Pa": [100.0, 300.0]}, {"film.gravity_m_s2": [0.0, -300.0]}]
    data = sweep(SENSOR, axes, processes=1)
    found = data.charge_pC.sel(electrode="A").values
    assert len(np.unique(found.round(6))) == 4
    heavy = BULGED.with_(**{"film.gravity_m_s2": -300.0})
    printed = json.loads(json.dumps(solve(heavy).to_json()))
    assert found.flat[3] == pytest.approx(printed["charges_pC"]["A"], rel=1e-3)


def test_heavier_films_share_no_solve():
    heavy = SENSOR.with_(**{"film.gravity_m_s2": -300.0})
    data = sweep(heavy, [{"film.density_kg_m3": [1000.0, 3000.0]}], processes=1)
    assert np.ptp(data.charge_pC.sel(electrode="A").values) > 0.1


@pytest.mark.parametrize("key", ["film.pressure_Pa", "film.gravity_m_s2"])
def test_what_has_no_place_for_them_names_the_key(key):
    loaded = TOUCHED.with_(**{key: 5.0})
    with pytest.raises(ValueError, match=key):
        build_response(loaded)
    tip = {"probe": {"shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}
    with pytest.raises(SceneError, match=key):
        loaded.with_(**tip)
    with pytest.raises(SceneError, match="pressure_follows"):
        SENSOR.with_(**{"film.pressure_follows": True})
