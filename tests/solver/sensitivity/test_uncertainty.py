"""Deviations of charges by uncertain values, against solves at changed values."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve, uncertainty
from pvdf_fem.scene.changes import get_number
from tests.helpers.discs import values
from tests.helpers.refusals import keys, refused

SCENE = Scene().with_(
    {
        "film": {"radius_mm": 20.0, "d32_pC_N": 3.0},
        "electrodes": {"ring_radius_mm": 6.0},
        "probe": {"shape": "circle", "x_mm": 2.0},
        "load": {"force_N": 0.5},
    }
)
UNCERTAIN = {"film.thickness_um": "5 %", "film.d31_pC_N": 0.8, "load.force_N": "2 %"}


def by_solves(scene, key, size, part=0.05):
    """Yield the changes of total charges and of changes by one deviation, from two solves."""
    value = get_number(scene, key)
    fine = scene.with_({"numerics.tolerance": 1e-5})
    ends = [solve(fine.with_({key: value + sign * part * size})) for sign in (1.0, -1.0)]
    for kind in ("charges_pC", "charge_changes_pC"):
        high, low = (values(getattr(end, kind)) for end in ends)
        yield np.abs(high - low) / (2.0 * part)


@pytest.fixture(scope="module")
def result():
    return uncertainty(SCENE, UNCERTAIN)


@pytest.mark.parametrize("key", UNCERTAIN)
def test_parts_agree_with_solves_at_changed_values(result, key):
    total, change = by_solves(SCENE, key, result.deviations[key])
    assert values(result.parts_pC[key]) == pytest.approx(total, rel=5e-3)
    assert values(result.change_parts_pC[key]) == pytest.approx(change, rel=5e-3)


def test_deviations_are_roots_of_sums_of_squares_and_shares_add_up_to_one(result):
    for name, deviation in result.charges_pC.items():
        parts = [of_key[name] for of_key in result.parts_pC.values()]
        assert deviation == pytest.approx(np.sqrt(np.sum(np.square(parts))))
        assert sum(of_key[name] for of_key in result.shares().values()) == pytest.approx(1.0)


def test_a_cooled_film_has_an_uncertain_pretension():
    """Other values are uncertain at this pretension."""
    tension = float(SCENE.film.prestress[0] * SCENE.film.thickness)
    tensioned = SCENE.with_({"film.pretension_N_m": tension})
    uncertain = {"film.pretension_N_m": "30 %", "film.thickness_um": "5 %"}
    cooled, same = (uncertainty(scene, uncertain) for scene in (SCENE, tensioned))
    assert cooled.deviations == pytest.approx(same.deviations)
    assert cooled.charge_changes_pC == pytest.approx(same.charge_changes_pC, rel=1e-3)


def test_both_numbers_of_a_pair_deviate_together():
    """By similarity, at no force and a given strain charges go with the moduli."""
    flat = SCENE.with_({"film.youngs_modulus_GPa": [2.4, 1.8], "probe": None})
    result = uncertainty(flat, {"film.youngs_modulus_GPa": "10 %"})
    expected = {name: 0.1 * charge for name, charge in solve(flat).charges_pC.items()}
    assert result.charges_pC == pytest.approx(expected, rel=1e-6)


def test_charges_of_a_solved_unloaded_film_have_deviations():
    patch = {"shape": "circle", "radius_mm": 2.0, "x_mm": 6.0, "y_mm": 0.0, "thickness_um": 9.0}
    scene = SCENE.with_({"film.patches": [{**patch, "youngs_modulus_GPa": 3.0}]})
    key = "film.thickness_um"
    result = uncertainty(scene, {key: "5 %"})
    _, change = by_solves(scene, key, result.deviations[key])
    assert values(result.charge_changes_pC) == pytest.approx(change, rel=1e-2)


@pytest.mark.parametrize(
    ("uncertain", "key"),
    [
        ({"film.radius_mm": "5 %"}, "uncertain.film.radius_mm"),
        ({"film.thickness_um": "5"}, "uncertain"),
        ({"film.thickness_um": -1.0}, "uncertain"),
        ({}, "uncertain"),
    ],
)
def test_refuses_keys_without_deviation_before_a_solve(uncertain, key, monkeypatch):
    monkeypatch.setattr("pvdf_fem.solver.sensitivity.uncertainty.solve_problem", None)
    assert keys(refused(uncertainty, SCENE, uncertain)) == [key]
