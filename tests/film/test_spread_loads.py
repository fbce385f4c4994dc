"""Loads on the whole film, a pressure and the film's weight, with and without a probe."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, build_response, gradients, solve, sweep
from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.term import State
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.status import Status
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import campbell
from tests.helpers.discs import free_disc, graded_mesh

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


# the equations

TIGHT = Scene().with_(**{"film.pretension_N_m": 1e3})
DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 12.0, "y_mm": 3.0}
LIGHT = {"load.force_N": 1e-3}


def weighed(scene: Scene, gravity: float = -9.81) -> Equilibrium:
    """The equations of a scene whose film has a weight."""
    heavy = scene.with_(**{"film.gravity_m_s2": gravity})
    return Equilibrium(heavy, graded_mesh(heavy, 3.0, 8.0), 2)


def found(equilibrium: Equilibrium) -> tuple[Array, State]:
    """Deflections (nodes,) in m, and the state, of an equilibrium that converges."""
    result = equilibrate(equilibrium)
    assert result.converged
    return equilibrium.dofs(result.q)[2::3], equilibrium.state(result.q)


@pytest.mark.parametrize("gravity", [-9.81, 9.81e2])
def test_a_taut_film_sags_under_its_weight_as_a_linear_membrane(gravity):
    """w(r) = q (a² - r²)/(4 N0)."""
    equilibrium = weighed(TIGHT, gravity)
    w, state = found(equilibrium)
    q, a = 1760.0 * 25e-6 * gravity, 45e-3
    r = np.hypot(*equilibrium.space.basis.doflocs)
    assert w == pytest.approx(q * (a**2 - r**2) / 4e3, abs=1e-4 * abs(q) * a**2 / 4e3)
    assert equilibrium.force == pytest.approx(abs(q) * np.pi * a**2)
    total = equilibrium.rim_reaction(state) + equilibrium.applied_force(state)
    assert np.abs(total).max() < 1e-9 * equilibrium.force


@pytest.mark.parametrize("kind", ["dead", "follower", "rigid"])
def test_a_probe_beside_it_adds_its_own_deflection(kind):
    scene = TIGHT.with_(probe=DISC, **LIGHT, **{"load.kind": kind})
    both = weighed(scene, 9.81e2)
    membrane, press, weight = both.terms
    alone = both.with_terms([membrane, press])
    unloaded = both.with_terms([membrane, press.with_force(0.0), weight])
    deflections = [found(equations)[0] for equations in (both, alone, unloaded)]
    assert np.ptp(deflections[2]) > 0.05 * np.ptp(deflections[0])
    largest = np.abs(deflections[0]).max()
    assert deflections[0] == pytest.approx(deflections[1] + deflections[2], abs=1e-5 * largest)


@pytest.mark.parametrize(
    "changes",
    [
        {"film.temperature_change_K": 0.0},
        {"film.temperature_change_K": 0.5, "film.compression": "tension-field"},
    ],
)
def test_a_slack_film_bears_its_weight(changes):
    equilibrium = weighed(Scene().with_(**changes), -9.81)
    w, state = found(equilibrium)
    assert w.min() < -1e-4
    assert equilibrium.imbalance(state) < 1e-4 * equilibrium.force


def test_a_film_is_flat_where_nothing_moves_it():
    tight, weight = weighed(TIGHT, 0.0), weighed(TIGHT, 1e-12)
    assert tight.is_flat
    assert not weight.is_flat
    pressed = Scene().with_(probe=DISC, **LIGHT)
    assert not Equilibrium(pressed, graded_mesh(pressed, 4.0, 12.0), 1).is_flat


PATCH = {"shape": "circle", "x_mm": 20.0, "y_mm": 0.0, "radius_mm": 8.0, "thickness_um": 10.0}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("film.rim_displacement_um", [0.0, 0.0, 0.0, 1.0, 0.0]),
        ("film.patches", [{**PATCH, "bonded": "before stretching"}]),
    ],
)
def test_a_film_of_uneven_stress_moves_without_a_load(key, value):
    scene = Scene().with_(**{key: value})
    equilibrium = Equilibrium(scene, graded_mesh(scene, 4.0, 12.0), 2)
    assert not equilibrium.is_flat
    result = equilibrate(equilibrium)
    assert result.converged
    residual = equilibrium.residual(equilibrium.state(result.q))
    assert np.abs(residual).max() < 1e-6 * np.abs(equilibrium.flat_forces).max()
    assert result.q.any()


def test_a_rim_that_moves_inwards_makes_a_flat_film_unstable():
    scene = Scene().with_(**{"film.rim_displacement_um": [-10.0]})
    equilibrium = Equilibrium(scene, graded_mesh(scene, 4.0, 12.0), 2)
    assert equilibrium.is_flat
    assert equilibrate(equilibrium).status is Status.UNSTABLE
