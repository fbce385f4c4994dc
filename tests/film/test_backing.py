"""Backings: balance of forces, symmetry sectors, thickness charges and which scenes share a solve.

The closed forms are in `tests/validation/backings.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, modes, solve
from pvdf_fem.film.bending.effect import estimate_bending_effect
from pvdf_fem.problem.equivalence import compute_mechanical_key
from pvdf_fem.problem.problem import Problem
from tests.helpers.discs import LOADS, values

STIFFNESS = 1e5
BACKED = Scene().with_(
    **{"film.backing_N_m3": STIFFNESS, "probe": {"shape": "circle", "radius_mm": 5.0}}
)
#: A patch that makes a scene unsymmetric, but is too soft to matter.
SKEW = {"shape": "circle", "radius_mm": 2.0, "x_mm": -9.0, "y_mm": 17.0, "backing_N_m3": 1e-3}
#: Two patches, of which a quarter of the film has one half at most.
PATCHES = [
    {"shape": "circle", "radius_mm": 6.0, "x_mm": x_mm, "y_mm": 0.0, "backing_N_m3": 5e5}
    for x_mm in (-20.0, 20.0)
]
LIFTED = {"film.backing_one_sided": True, "film.pressure_Pa": -50.0}


@pytest.mark.parametrize(
    "changes",
    [
        *LOADS.values(),
        {"film.backing_N_m3": None, "film.patches": PATCHES},
        LIFTED,
        {"film.compression": "tension-field"},
    ],
)
def test_a_sector_has_the_charges_of_the_whole_film_and_its_forces_balance(changes):
    scene = BACKED.with_(**changes, **{"numerics.tolerance": 1e-4})
    skew = scene.with_(**{"film.patches": [*changes.get("film.patches", []), SKEW]})
    assert Problem.from_scene(scene).sector.mirror_axes
    assert not Problem.from_scene(skew).sector.mirror_axes
    found = solve(scene)
    whole = solve(skew)
    assert values(found.charges_pC) == pytest.approx(values(whole.charges_pC), rel=3e-4)
    assert max(found.force_balance, whole.force_balance) < 1e-9


def test_a_backing_only_presses_on_a_film_that_may_lift_off():
    """All of the film is lifted off, so that the backing has no effect."""
    lifted = {**LIFTED, "probe": None}
    free = {**lifted, "film.backing_N_m3": None, "film.backing_one_sided": False}
    assert values(solve(BACKED.with_(lifted)).charges_pC) == pytest.approx(
        values(solve(BACKED.with_(free)).charges_pC), rel=1e-9
    )


def test_a_backing_compresses_the_film_across_its_thickness():
    d33_pC_N = -20.0
    scene = BACKED.with_(**{"numerics.tolerance": 1e-4})
    plain = solve(scene)
    pressed = solve(scene.with_(**{"film.d33_pC_N": d33_pC_N}))
    deflection = 1e-3 * float(pressed.at(10.0, 0.0).deflection_mm)
    expected_pC = -0.5 * d33_pC_N * STIFFNESS * deflection * 9e-6
    added_pC = pressed.charges_pC["A"] - plain.charges_pC["A"]
    assert added_pC == pytest.approx(expected_pC, rel=3e-3)  # the deflection at the centre


def test_twice_the_thickness_and_force_deflect_a_backed_film_less():
    twice = {"film.thickness_um": 50.0, "load.force_N": 2.0}
    free = BACKED.with_(**{"film.backing_N_m3": None})
    keys = {}
    for name, scene in {"free": free, "backed": BACKED}.items():
        pair = (scene, scene.with_(**twice))
        keys[name] = {compute_mechanical_key(Problem.from_scene(one)).text for one in pair}
    assert len(keys["free"]) == 1
    assert len(keys["backed"]) == 2


def test_modes_about_a_film_that_is_pressed_against_a_one_sided_backing():
    one_sided = BACKED.with_(**{"film.backing_one_sided": True})
    pressed = modes(one_sided, 2, loaded=True).frequencies_Hz
    np.testing.assert_allclose(pressed, modes(BACKED, 2, loaded=True).frequencies_Hz, rtol=1e-9)
    with pytest.raises(SceneError, match=r"film\.backing_one_sided = true"):
        modes(one_sided)


@pytest.mark.parametrize(
    "changes",
    [
        {"film.backing_N_m3": 1e7, "film.thickness_um": 110.0, "load.force_N": 0.2},
        {"film.backing_N_m3": 5e5, "film.thickness_um": 110.0, "load.kind": "rigid"},
    ],
)
def test_the_estimated_effect_of_bending_is_at_least_a_third(changes):
    scene = BACKED.with_(**{"film.pretension_N_m": 60.0, **changes})
    plain = values(solve(scene).charges_pC)
    bent = values(solve(scene.with_(**{"film.bending": True})).charges_pC)
    change = np.max(np.abs(plain / bent - 1.0))
    assert 3.0 * estimate_bending_effect(scene).change > change > 1e-3


def test_a_patch_is_a_layer_or_a_backing():
    nothing = {"shape": "square", "side_mm": 3.0, "x_mm": 0.0, "y_mm": 0.0}
    with pytest.raises(SceneError, match=r"film\.patches\[0\]\.thickness_um"):
        Scene().with_(**{"film.patches": [nothing]})
    stiff = {**nothing, "backing_N_m3": 1e5, "youngs_modulus_GPa": 3.0}
    with pytest.raises(SceneError, match=r"film\.patches\[0\]\.youngs_modulus_GPa"):
        Scene().with_(**{"film.patches": [stiff]})
