"""The charge that a probe's pressure makes by d33, by hand."""

from __future__ import annotations

import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.problem.problem import Problem
from pvdf_fem.problem.thickness_effect import describe_thickness_effect
from tests.helpers.discs import LOADS, RECTANGLE

OVER_A = Scene.parse('[probe]\nshape = "triangle"\nx_mm = 10.0').with_(
    **{"film.d33_pC_N": -15.0, "numerics.tolerance": 1e-2}
)
SPHERE = {"probe": {"shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}
WIDE = [{"name": "W", "x_mm": 0.0, "y_mm": 0.0, "side_mm": 20.0}]


def added(scene):
    """Charge by d33 in pC by electrode."""
    solution, film = solve(scene), scene.film
    plain = solution.charges_by(film.d31_pC_N, film.d32_pC_N)
    assert any("film.d33_pC_N" in text for text in solution.included)
    return {name: charge - plain[name] for name, charge in solution.charges_pC.items()}


def describe(scene):
    """Describe the charge by d33 of a scene."""
    problem = Problem.from_scene(scene)
    return list(describe_thickness_effect(scene, problem.loads, problem.floating_electrodes))


@pytest.mark.parametrize(
    "load",
    [
        *LOADS.values(),
        {"load.kind": "rigid", "load.tilt": "free"},
        {"load.tangential_N": [0.4, -0.3]},
        {"probe": {"shape": "circle", "radius_mm": 3.0}, "load.profile": "hertz"},
        SPHERE,
    ],
)
def test_whole_load_over_one_electrode(load):
    """-d33 F/2 of the force along z, however it is spread; on a mirrored part of the film too."""
    scene = RECTANGLE.with_(electrodes=WIDE, **{"film.d33_pC_N": -15.0, "load.force_N": 0.5})
    charges = added(scene.with_(**load, **{"numerics.tolerance": 1e-2}))
    assert charges["W"] == pytest.approx(15.0 * 0.5 / 2.0, rel=1e-5)


@pytest.mark.parametrize("load", [LOADS["dead"], LOADS["sliding"], SPHERE])
def test_neglected_effects_within_a_third_and_thirty_times(load):
    scene = OVER_A.with_(**load, **{"probe.x_mm": 11.2, "probe.y_mm": 0.7})
    charges = added(scene)
    ((included, text),) = describe(scene.with_(**{"film.d33_pC_N": None}))
    estimate = float(text.split("about ")[-1].split(" pC on A")[0])
    assert not included
    assert charges["A"] / 3.0 <= estimate <= 30.0 * charges["A"]
    assert not describe(RECTANGLE)
