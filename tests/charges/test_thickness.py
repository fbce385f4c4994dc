"""The charge that a probe's pressure makes by d33, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, gradients, solve
from pvdf_fem.charges.thickness import thickness_remarks
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.sweeps.plan import plan
from tests.helpers.discs import LOADS, RECTANGLE

OVER_A = Scene.parse('[probe]\nshape = "triangle"\nx_mm = 10.0').with_(
    **{"film.d33_pC_N": -15.0, "numerics.tolerance": 3e-3}
)
SPHERE = {"probe": {"shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}
WIDE = [{"name": "W", "x_mm": 0.0, "y_mm": 0.0, "side_mm": 20.0}]


def added(scene):
    """Charge by d33 in pC by electrode, and the solution."""
    solution = solve(scene)
    film = scene.film
    plain = solution.charges_by(film.d31_pC_N, film.d32_pC_N)
    return {name: charge - plain[name] for name, charge in solution.charges_pC.items()}, solution


@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_uniform_pressure_over_an_electrode(kind):
    """15 pC/N x p/2 x 9 mm2, and nothing on the others; an edge of 8 mm has corners aside."""
    charges, solution = added(OVER_A.with_(**{"load.kind": kind, "probe.side_mm": 8.0}))
    by_hand = 15.0 * 1.0 / (np.sqrt(3.0) / 4.0 * 64.0) / 2.0 * 9.0
    assert charges == pytest.approx({"A": by_hand, "B": 0.0, "C": 0.0, "D": 0.0}, abs=1e-9)
    assert any("film.d33_pC_N" in text for text in solution.included)


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
    charges, _ = added(scene.with_(**load, **{"numerics.tolerance": 1e-2}))
    assert charges["W"] == pytest.approx(15.0 * 0.5 / 2.0, rel=1e-5)


@pytest.mark.parametrize("load", [LOADS["dead"], LOADS["sliding"], SPHERE])
def test_left_out_within_a_third_and_thirty_times(load):
    place = {"probe.x_mm": 11.2, "probe.y_mm": 0.7, "numerics.tolerance": 1e-2}
    scene = OVER_A.with_(**load, **place)
    charges, _ = added(scene)
    ((included, text),) = thickness_remarks(scene.with_(**{"film.d33_pC_N": None}))
    estimate = float(text.split("about ")[-1].split(" pC on A")[0])
    assert not included
    assert charges["A"] / 3.0 <= estimate <= 30.0 * charges["A"]


def test_refused_where_charges_are_of_the_plane_only():
    assert not list(thickness_remarks(RECTANGLE))
    for refuses in (mechanics_of, lambda scene: plan([scene]), gradients):
        with pytest.raises(SceneError, match=r"film\.d33_pC_N"):
            refuses(OVER_A)
