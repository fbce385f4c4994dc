"""Loads on the whole film, a pressure and the film's weight, with and without a probe."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.status import Status
from tests.helpers.discs import graded_mesh

SENSOR = Scene().with_(**{"film.d32_pC_N": 3.0, "numerics.tolerance": 1e-3})
DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 12.0, "y_mm": 3.0}
TOUCHED = SENSOR.with_(probe=DISC, **{"load.force_N": 0.3})
BULGED = SENSOR.with_(**{"film.pressure_Pa": 300.0})


@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_a_probe_as_large_as_the_film_presses_as_the_pressure_does(kind):
    pressure, fine = 3e3, {"numerics.tolerance": 1e-4}
    film = {"film.pressure_Pa": pressure, "film.pressure_follows": kind == "follower"}
    probe = {"shape": "circle", "radius_mm": SENSOR.film.radius_mm}
    load = {"kind": kind, "force_N": pressure * math.pi * SENSOR.film.radius**2}
    found = solve(SENSOR.with_(**film, **fine))
    wanted = solve(SENSOR.with_(probe=probe, load=load, **fine))
    assert found.charges_pC == pytest.approx(wanted.charges_pC, rel=2e-4)
    assert found.deflection_max_mm == pytest.approx(wanted.deflection_max_mm, rel=2e-4)
    assert found.rest_charges_pC == pytest.approx(wanted.rest_charges_pC, rel=1e-12)


def test_weight_is_there_at_rest_and_a_pressure_is_not():
    heavy = solve(SENSOR.with_(**{"film.gravity_m_s2": -9.81e2}))
    flat = solve(SENSOR)
    assert heavy.charges_pC["A"] > 1.01 * flat.charges_pC["A"]
    assert heavy.rest_charges_pC == pytest.approx(heavy.charges_pC, rel=1e-9)
    assert solve(BULGED).rest_charges_pC == pytest.approx(flat.charges_pC, rel=1e-12)


def test_weight_that_is_left_out_is_told_where_it_matters():
    def told(**changes):
        found = solve(TOUCHED.with_(**changes))
        return found, any("film.gravity_m_s2" in text for text in found.left_out)

    light, strong = {"load.force_N": 0.02}, {"load.force_N": 20.0}
    weighed, without = told(**light, **{"film.gravity_m_s2": -9.81}), told(**light)
    assert [weighed[1], without[1], told(**strong)[1]] == [False, True, False]
    change = weighed[0].charge_changes_pC["A"] / without[0].charge_changes_pC["A"] - 1.0
    assert 1e-3 < abs(change) < 0.1


# the equations

TIGHT = {"film.pretension_N_m": 1e3, "load.force_N": 1e-3}
SLACK = {"film.temperature_change_K": 0.5, "film.compression": "tension-field"}
TAPE = {"shape": "circle", "x_mm": 20.0, "y_mm": 0.0, "radius_mm": 8.0, "thickness_um": 10.0}


def equations(**changes: object) -> Equilibrium:
    scene = Scene().with_(**changes)
    return Equilibrium(scene, graded_mesh(scene, 3.0, 10.0), 2)


def deflections(film: Equilibrium) -> Array:
    """Deflections (nodes,) in m of an equilibrium that converges."""
    result = equilibrate(film)
    assert result.converged
    assert film.imbalance(film.state(result.q)) <= 1e-4 * film.force
    return film.dofs(result.q)[2::3]


@pytest.mark.parametrize("kind", ["dead", "follower", "rigid"])
def test_a_taut_film_has_the_sum_of_both_deflections(kind):
    """By the weight q a tight film alone has w(r) = q (a² - r²)/(4 N0)."""
    both = equations(probe=DISC, **TIGHT, **{"load.kind": kind, "film.gravity_m_s2": 9.81e2})
    membrane, press, weight = both.terms
    pressed = deflections(both.with_terms([membrane, press]))
    heavy = deflections(equations(**TIGHT, **{"film.gravity_m_s2": 9.81e2}))
    q, r = 1760.0 * 25e-6 * 9.81e2, np.hypot(*equations(**TIGHT).space.basis.doflocs)
    assert heavy == pytest.approx(q * (45e-3**2 - r**2) / 4e3, abs=1e-3 * heavy.max())
    sagging = deflections(both.with_terms([membrane, press.with_force(0.0), weight]))
    together = deflections(both)
    assert np.ptp(sagging) > 0.05 * np.ptp(together)
    assert together == pytest.approx(pressed + sagging, abs=1e-5 * together.max())


@pytest.mark.parametrize("changes", [{"film.temperature_change_K": 0.0}, SLACK])
def test_a_slack_film_bears_its_weight(changes):
    assert deflections(equations(**changes, **{"film.gravity_m_s2": -9.81})).min() < -1e-4


def test_a_film_is_flat_where_nothing_moves_it():
    assert equations(**TIGHT).is_flat
    assert not equations(**{"film.gravity_m_s2": 1e-12}).is_flat
    assert not equations(probe=DISC).is_flat
    inwards = equations(**{"film.rim_displacement_um": [-10.0]})
    assert inwards.is_flat
    assert equilibrate(inwards).status is Status.UNSTABLE


@pytest.mark.parametrize(
    "uneven",
    [
        {"film.rim_displacement_um": [0.0, 0.0, 0.0, 1.0, 0.0]},
        {"film.patches": [{**TAPE, "bonded": "before stretching"}]},
    ],
)
def test_a_film_of_uneven_stress_moves_without_a_load(uneven):
    film = equations(**uneven)
    result = equilibrate(film)
    assert result.converged
    assert result.q.any()
    residual = film.residual(film.state(result.q))
    assert np.abs(residual).max() < 1e-6 * np.abs(film.flat_forces).max()
