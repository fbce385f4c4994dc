"""Charges of the untouched film, exact and as solves find them."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve, sweep
from pvdf_fem.charges.rest import rest_charges

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
    if scene.film.thermal_strain > 0.0:  # slack: there is no charge, and nothing to solve
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
