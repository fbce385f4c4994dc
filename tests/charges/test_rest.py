"""Charges of the untouched film, exact and as solves find them."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, gradients, solve, sweep
from pvdf_fem.charges.rest import rest_charges
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.sweeps.plan import plan
from tests.helpers.discs import RECTANGLE

CASES = {
    "thesis": {},
    "orthotropic": {"film.youngs_modulus_GPa": [3.0, 1.5], "film.d32_pC_N": -2.0},
    "edges": {"numerics.observable": "thesis-edge"},
    "heated, wrinkling": {"film.compression": "tension-field", "film.temperature_change_K": 2.0},
    "bends": {"film.bending": True, "film.thickness_um": 110.0},
    "circles": {
        "electrodes": [
            {"name": "A", "shape": "circle", "x_mm": 3.0, "y_mm": 4.0, "radius_mm": 2.0},
            {"name": "B", "shape": "ellipse", "x_mm": -9.0, "y_mm": 0.0, "semi_axes_mm": [3, 1]},
        ]
    },
}


def test_the_thesis_electrode_carries_48_pC() -> None:
    """E α ΔT/(1 - ν) = 1/3 MPa on 9 mm², times 16 pC/N."""
    assert rest_charges(Scene()) == pytest.approx(48e-12, rel=1e-12)


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES.keys())
def test_solves_without_a_probe_find_the_same(changes: dict[str, object]) -> None:
    scene = Scene().with_(**changes)
    if scene.film.strain_at_rest[0] < 0.0:  # slack: there is no charge, and nothing to solve
        assert not rest_charges(scene).any()
        return
    solution = solve(scene)
    charges = np.array(list(solution.charges_pC.values()))
    np.testing.assert_allclose(charges, 1e12 * rest_charges(scene), rtol=2e-6)
    assert list(solution.charge_changes_pC.values()) == pytest.approx(
        [0.0] * len(charges), abs=1e-3
    )


def test_a_solution_tells_total_rest_change_and_reading() -> None:
    scene = Scene().with_(
        **{
            "probe": {"shape": "circle", "radius_mm": 2.0},
            "readout": {"feedback_capacitance_pF": 500.0, "gain": {"A": 2.0}},
        }
    )
    solution = solve(scene)
    changes, result = solution.charge_changes_pC, solution.to_json()
    assert changes["A"] == pytest.approx(solution.charges_pC["A"] - 48.0)
    assert result["rest_charges_pC"]["B"] == pytest.approx(48.0)
    assert result["readings_V"]["A"] == pytest.approx(2.0 * changes["A"] / 500.0)
    assert result["readings_V"]["B"] == pytest.approx(changes["B"] / 500.0)
    assert result["time_constants_s"] == dict.fromkeys("ABCD")
    assert "change by touch" in str(solution)
    assert "readings at once" in str(solution)
    total = solve(scene.with_(**{"readout.reading": "total"}))
    assert total.readings_V["B"] == pytest.approx(solution.charges_pC["B"] / 500.0)


def test_a_sweep_has_charges_at_rest_even_where_solves_fail() -> None:
    data = sweep(Scene(), [{"film.temperature_change_K": [-2.0, 1.0]}], processes=1)
    assert data.rest_charge_pC.sel(electrode="A").values == pytest.approx([96.0, -48.0])
    assert data.rest_charge_pC.attrs["units"] == "pC"


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
    assert any("film.pyroelectric_uC_m2K = -25" in text for text in solution.included)
    left = solve(warm.with_(**{"film.pyroelectric_uC_m2K": None}), mesh=loose.mesh).left_out
    assert any("about 90 pC on" in text for text in left)
    key = "film.youngs_modulus_GPa"
    rate = gradients(solution, [key])[key]
    ahead, behind = (solve(warm.with_(**{key: E}), mesh=loose.mesh) for E in (2.01, 1.99))
    for name, charge in ahead.charges_pC.items():
        assert rate[name] == pytest.approx((charge - behind.charges_pC[name]) / 0.02, rel=1e-3)


def test_warming_is_refused_where_charges_are_of_the_stress_only() -> None:
    for refuses in (mechanics_of, lambda scene: plan([scene])):
        with pytest.raises(SceneError, match=r"film\.warming_K"):
            refuses(RECTANGLE.with_(**WARM))
