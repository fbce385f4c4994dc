"""Charges of the untouched film, and changes from there."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, solve
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.adaptive import compute_unloaded_charges
from tests.helpers.discs import RECTANGLE, values


def test_a_solution_tells_total_rest_change_and_reading():
    readout = {"feedback_capacitance_pF": 500.0, "gain": {"A": 2.0}}
    scene = Scene().with_(probe={"shape": "circle", "radius_mm": 2.0}, readout=readout)
    solution, total = (solve(scene.with_(**{"readout.reading": r})) for r in ("change", "total"))
    for name, charge in solution.charges_pC.items():
        change, gain = charge - 48.0, 2.0 if name == "A" else 1.0
        assert solution.rest_charges_pC[name] == pytest.approx(48.0)
        assert solution.charge_changes_pC[name] == pytest.approx(change)
        assert solution.readings_V[name] == pytest.approx(gain * change / 500.0)
        assert total.readings_V[name] == pytest.approx(gain * charge / 500.0)
    assert solution.to_json()["time_constants_s"] == dict.fromkeys("ABCD")


TOUCHED = RECTANGLE.with_(**{"numerics.tolerance": 1e-2})
#: A rim that compresses the film until it is touched.
TORN = {"film.rim_displacement_um": [0.0, 0.0, 0.0, 10.0, 0.0]}
HEATED = {"film.temperature_change_K": 1.0}
NAMES = ("rest_charges_pC", "rest_charge_errors_pC", "charge_changes_pC", "charge_change_errors_pC")


def test_a_solve_that_moves_at_rest_states_the_errors_of_both():
    """Against a solve with a tolerance 30 times finer."""
    patch = {"shape": "rectangle", "x_mm": 11.0, "y_mm": 1.0, "width_mm": 4.0, "height_mm": 3.0}
    patches = [{**patch, "thickness_um": 20.0, "bonded": "before stretching"}]
    light = TOUCHED.with_(**{"film.patches": patches, "load.force_N": 1e-3})
    solution, fine = solve(light), solve(light.with_(**{"numerics.tolerance": 3e-4}))
    rest, change, errors, of_rest, of_change = (
        values(getattr(solution, name)) for name in (*NAMES[::2], "charge_errors_pC", *NAMES[1::2])
    )
    assert np.all((0.2 * errors < of_rest) & (of_rest < 1e-2 * rest))
    assert np.all(np.abs(rest - values(fine.rest_charges_pC)) < 2.0 * of_rest)
    assert of_change == pytest.approx(of_rest + errors)
    off = np.abs(change - values(fine.charge_changes_pC))
    assert np.all(off <= of_change + values(fine.charge_change_errors_pC))


@pytest.mark.parametrize(("changes", "key"), [(TORN, "rim_displacement_um"), (HEATED, "temper")])
def test_totals_without_a_film_at_rest_are_given_and_changes_are_not(changes, key):
    readout = {"feedback_capacitance_pF": 500.0}
    solution = solve(TOUCHED.with_(**changes, readout=readout))
    result = json.loads(json.dumps(solution.to_json(), allow_nan=False))
    assert result["charges_pC"]["A"] > 0.0
    assert {result[name] for name in (*NAMES, "readings_V")} == {None}
    assert np.isnan(solution.to_dataframe()[[*NAMES, "readings_V"]].values).all()
    assert [text for text in solution.warnings if text.startswith(f"film.{key}")]
    assert str(solution)
    total = solve(TOUCHED.with_(**changes, readout={**readout, "reading": "total"}))
    assert total.readings_V["A"] > 0.0


def test_a_film_in_a_tension_field_has_no_compression_at_rest():
    slack = {"film.compression": "tension-field", "film.d32_pC_N": 0.0}
    heated = solve(TOUCHED.with_(**HEATED, **slack))
    assert set(heated.rest_charges_pC.values()) == {0.0}
    assert heated.charge_changes_pC == heated.charges_pC


def test_a_plate_bears_compression_below_its_buckling_load():
    """Critical tension of a clamped disc: 14.682 D/a² (Timoshenko and Gere, section 7.3)."""
    plate = {"film.bending": True, "film.thickness_um": 1000.0}
    critical = 14.682 * 2e9 * 1e-3**3 / 12.0 / (1.0 - 0.34**2) / 45e-3**2
    bears, buckles = (
        Scene().with_(**plate, **{"film.pretension_N_m": -part * critical}) for part in (0.95, 1.05)
    )
    expected = -16.0 * 9.0 * 0.95 * critical / 1000.0
    assert 1e12 * compute_unloaded_charges(Problem.from_scene(bears)) == pytest.approx(expected)
    assert [solve(scene).status for scene in (bears, buckles)] == ["converged", "unstable"]
    with pytest.raises(SceneError, match=r"film\.pretension_N_m"):
        compute_unloaded_charges(Problem.from_scene(buckles))


def test_a_warmed_film_counts_from_before_it_warmed():
    """Warmed beyond its stretch it is slack, and was taut when it was zeroed."""
    warm = TOUCHED.with_(**{"film.warming_K": 2.0, "film.compression": "tension-field"})
    plain, electric = (solve(warm.with_(**{"film.pyroelectric_uC_m2K": p})) for p in (None, -25.0))
    assert values(electric.rest_charges_pC) == pytest.approx(48.0)
    added = values(electric.charges_pC) - values(plain.charges_pC)
    assert added == pytest.approx(-25.0 * 9.0 * 2.0)  # p A ΔT
