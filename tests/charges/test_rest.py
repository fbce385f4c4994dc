"""Charges of the untouched film, exact and as solves find them."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, locate, solve, sweep
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.solution.solve import rest_charges, solve_goals
from pvdf_fem.solvers.budget import Budget
from tests.helpers.discs import RECTANGLE

solve_module = sys.modules["pvdf_fem.solution.solve"]
records_module = sys.modules["pvdf_fem.sweeps.records"]

CASES = {
    "thesis": {},
    "orthotropic": {"film.youngs_modulus_GPa": [3.0, 1.5], "film.d32_pC_N": -2.0},
    "edges": {"numerics.observable": "thesis-edge"},
    "bends": {"film.bending": True, "film.thickness_um": 110.0},
    "circles": {
        "electrodes": [
            {"name": "A", "shape": "circle", "x_mm": 3.0, "y_mm": 4.0, "radius_mm": 2.0},
            {"name": "B", "shape": "ellipse", "x_mm": -9.0, "y_mm": 0.0, "semi_axes_mm": [3, 1]},
        ]
    },
}


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES.keys())
def test_solves_without_a_probe_find_the_same(changes: dict[str, object]) -> None:
    scene = Scene().with_(**changes)
    solution = solve(scene)
    charges = np.array(list(solution.charges_pC.values()))
    np.testing.assert_allclose(charges, 1e12 * rest_charges(scene), rtol=2e-6)
    assert list(solution.charge_changes_pC.values()) == pytest.approx(
        [0.0] * len(charges), abs=1e-3
    )


def test_a_solution_tells_total_rest_change_and_reading() -> None:
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


WARM = {"film.warming_K": 0.4, "film.pyroelectric_uC_m2K": -25.0}


@pytest.mark.parametrize("stretched", [{}, {"film.pretension_N_m": [9.0, 7.0]}])
def test_warming_makes_a_charge_and_loosens_the_film(stretched: dict[str, object]) -> None:
    """p A dT, at a pretension less by E h alpha dT/(1 - nu); charges at rest are those before."""
    scene = RECTANGLE.with_(**stretched, **{"numerics.tolerance": 1e-2})
    loss = 2e9 * 25e-6 * 110e-6 * 0.4 / (1.0 - 0.34)
    before = np.array(stretched.get("film.pretension_N_m", 2e9 * 25e-6 * 110e-6 / 0.66))
    cold, warm = scene.with_(**{"film.pretension_N_m": before.tolist()}), scene.with_(**WARM)
    loose = solve(cold.with_(**{"film.pretension_N_m": (before - loss).tolist()}))
    solution = solve(warm, mesh=loose.mesh)
    charges = {name: charge - 25.0 * 9.0 * 0.4 for name, charge in loose.charges_pC.items()}
    assert solution.charges_pC == pytest.approx(charges, rel=1e-9)
    assert rest_charges(warm) == pytest.approx(rest_charges(cold), rel=1e-12)


TOUCHED = RECTANGLE.with_(**{"numerics.tolerance": 1e-2})
#: A rim that leaves the film taut, and one that compresses it until it is touched.
MOVED = {"film.rim_displacement_um": [0.0, 0.0, 0.0, 1.0, 0.0]}
TORN = {"film.rim_displacement_um": [0.0, 0.0, 0.0, 10.0, 0.0]}
HEATED = {"film.temperature_change_K": 1.0}
NAMES = ("rest_charges_pC", "rest_charge_errors_pC", "charge_changes_pC", "charge_change_errors_pC")


def test_a_solve_that_moves_at_rest_states_the_errors_of_both() -> None:
    """Against a solve with a tolerance 30 times finer."""
    patch = {"shape": "rectangle", "x_mm": 11.0, "y_mm": 1.0, "width_mm": 4.0, "height_mm": 3.0}
    patches = [{**patch, "thickness_um": 20.0, "bonded": "before stretching"}]
    light = TOUCHED.with_(**{"film.patches": patches, "load.force_N": 1e-3})
    solution = solve(light)
    fine = solve(light.with_(**{"numerics.tolerance": 3e-4}))
    for name, rest in solution.rest_charges_pC.items():
        assert 0.2 * solution.charge_errors_pC[name] < solution.rest_charge_errors_pC[name]
        assert solution.rest_charge_errors_pC[name] < 1e-2 * rest
        off = rest - fine.rest_charges_pC[name]
        assert abs(off) < 2.0 * solution.rest_charge_errors_pC[name]
        both = solution.rest_charge_errors_pC[name] + solution.charge_errors_pC[name]
        assert solution.charge_change_errors_pC[name] == pytest.approx(both)
        off = solution.charge_changes_pC[name] - fine.charge_changes_pC[name]
        assert abs(off) <= both + fine.charge_change_errors_pC[name]


@pytest.fixture
def counted(monkeypatch):
    """Makes a module keep the scenes that it solves."""

    def count(module):
        asked: list[Scene] = []

        def solved(scene, *arguments, **options):
            asked.append(scene)
            return solve_goals(scene, *arguments, **options)

        monkeypatch.setattr(module, "solve_goals", solved)
        return asked

    return count


def test_the_film_at_rest_is_solved_once_and_within_the_budget(counted) -> None:
    asked = counted(solve_module)
    budget, alone = Budget.of(TOUCHED), Budget.of(TOUCHED)
    solution = solve(TOUCHED.with_(**MOVED), budget=budget)
    assert [scene.probe is None for scene in asked] == [False, True]
    assert solution.to_json()["rest_charges_pC"] == solution.rest_charges_pC
    solve_goals(TOUCHED.with_(**MOVED), goals_of(TOUCHED), budget=alone)
    assert budget.spent_seconds > alone.spent_seconds
    solve(TOUCHED)
    assert len(asked) == 3


@pytest.mark.parametrize(("changes", "key"), [(TORN, "rim_displacement_um"), (HEATED, "temper")])
def test_totals_without_a_film_at_rest_are_given_and_changes_are_not(changes, key) -> None:
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


def test_a_film_in_a_tension_field_has_no_compression_at_rest() -> None:
    slack = {"film.compression": "tension-field", "film.d32_pC_N": 0.0}
    heated = solve(TOUCHED.with_(**HEATED, **slack))
    assert set(heated.rest_charges_pC.values()) == {0.0}
    assert heated.charge_changes_pC == heated.charges_pC


def test_a_plate_bears_compression_below_its_buckling_load() -> None:
    """Critical tension of a clamped disc: 14.682 D/a² (Timoshenko and Gere, section 7.3)."""
    plate = {"film.bending": True, "film.thickness_um": 1000.0}
    critical = 14.682 * 2e9 * 1e-3**3 / 12.0 / (1.0 - 0.34**2) / 45e-3**2
    bears, buckles = (
        Scene().with_(**plate, **{"film.pretension_N_m": -part * critical}) for part in (0.95, 1.05)
    )
    expected = -16.0 * 9.0 * 0.95 * critical / 1000.0
    assert 1e12 * rest_charges(bears) == pytest.approx(expected)
    assert [solve(scene).status for scene in (bears, buckles)] == ["converged", "unstable"]
    with pytest.raises(SceneError, match=r"film\.pretension_N_m"):
        rest_charges(buckles)


def test_a_warmed_film_counts_from_before_it_warmed() -> None:
    """Warmed beyond its stretch it is slack, and was taut when it was zeroed."""
    warm = TOUCHED.with_(**{"film.warming_K": 2.0, "film.compression": "tension-field"})
    assert 1e12 * rest_charges(warm) == pytest.approx(48.0)
    assert solve(warm).rest_charges_pC["A"] == pytest.approx(48.0)


def test_a_sweep_solves_each_untouched_film_once_and_keeps_it(counted, tmp_path) -> None:
    asked = counted(records_module)
    rims = [MOVED["film.rim_displacement_um"], TORN["film.rim_displacement_um"]]
    axes = [{"film.rim_displacement_um": rims}, {"load.force_N": [0.5, 1.0]}]
    data, again = (sweep(TOUCHED, axes, tmp_path / "s.db", processes=1) for _ in range(2))
    assert sorted(scene.probe is None for scene in asked) == [False] * 4 + [True] * 2
    assert data.identical(again)
    fresh = solve(TOUCHED.with_(**MOVED, **{"load.force_N": 1.0}))
    found = data.isel({"rim_displacement_um": 0, "force_N": 1})
    rest, errors = found.rest_charge_pC.values, found.rest_charge_error_pC.values
    assert rest == pytest.approx([*fresh.rest_charges_pC.values()])
    assert errors == pytest.approx([*fresh.rest_charge_errors_pC.values()])
    torn = data.isel({"rim_displacement_um": 1})
    assert np.isnan(torn.rest_charge_pC.values).all()
    assert (torn.charge_pC.values > 0.0).all()


def test_changes_without_a_film_at_rest_are_refused() -> None:
    with pytest.raises(ValueError, match=r"film\.temperature_change_K"):
        locate(TOUCHED.with_(**HEATED), dict.fromkeys("ABCD", 500.0), reading="change")
