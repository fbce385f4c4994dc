"""Scenes that an input deck cannot state."""

from __future__ import annotations

import pytest

from pvdf_fem import Scene, SceneError
from pvdf_fem.problem.problem import Problem
from pvdf_fem.view.deck.restrictions import require_deck

TRIANGLE = Scene.example("triangle")
HEAT = {"film.pyroelectric_uC_m2K": -25.0, "film.warming_K": 0.3}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"film.bending": True}, "film.bending"),
        ({"film.bending": "auto", "numerics.tolerance": 1e-5}, "film.bending"),
        ({"film.compression": "tension-field"}, "film.compression"),
        ({"film.law": "neo-hookean"}, "film.law"),
        ({"film.d33_pC_N": -15.0}, "film.d33_pC_N"),
        ({"film.rim_displacement_um": [1.0]}, "film.rim_displacement_um"),
        ({"film.backing_N_m3": 1e5}, "film.backing_N_m3"),
        (HEAT, "film.pyroelectric_uC_m2K"),
        ({"numerics.observable": "thesis-edge"}, "numerics.observable"),
        ({"load.kind": "rigid"}, "load.kind"),
        ({"probe": {"shape": "sphere"}, "load": {"kind": "contact"}}, "load.kind"),
        ({"probe.temperature_K": 10.0}, "probe.temperature_K"),
        ({"film.temperature_change_K": 0.0}, "film.temperature_change_K"),
        ({"film.temperature_change_K": None, "film.pretension_N_m": -2.0}, "film.pretension_N_m"),
    ],
)
def test_what_a_deck_cannot_state_is_refused_by_its_key(changes, key):
    problem = Problem.from_scene(TRIANGLE.with_(**changes))
    with pytest.raises(SceneError) as caught:
        require_deck(problem)
    assert [text.split(" =")[0].split(":")[0] for text in caught.value.problems] == [key]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"film.bending": "auto", "numerics.tolerance": 0.05},
        {"film.coupling": "auto"},
        {"film.material": "te-copolymer"},  # its pyroelectric effect needs warming
        {"load.kind": "follower", "film.warming_K": 0.3, "film.gravity_m_s2": -9.81},
        {"probe": None, "film.pressure_Pa": 100.0},
    ],
)
def test_other_scenes_are_accepted(changes):
    require_deck(Problem.from_scene(TRIANGLE.with_(**changes)))
