"""Touches by full solves: shear and two touches from exact charges, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import NotConvergedError, Scene, locate, solve
from pvdf_fem.response.model import Domain
from pvdf_fem.touch.by_solves import Search, SolveOptions, reach_by_electrodes_mm
from pvdf_fem.touch.least_squares import descend

DISC = {"shape": "circle", "radius_mm": 2.0}
EIGHT = Scene().with_(
    electrodes={"layout": "ring", "count": 8, "shape": "square"}, probe={**DISC, "x_mm": 4.0}
)
PAIR = EIGHT.with_(
    probe=[
        {**DISC, "x_mm": -7.0, "y_mm": 3.0, "force_N": 0.4},
        {**DISC, "x_mm": 5.0, "y_mm": -4.0, "force_N": 1.1},
    ]
)
WARM = {**DISC, "x_mm": 8.0, "contact_time_s": 0.1}
FINGER = Scene().with_(probe=WARM, **{"film.pyroelectric_uC_m2K": -25.0})
FEW = SolveOptions(pitch_mm=7.5, fine_mm=2.5, starts=3, followed=1, rounds=0, tolerance=1e-3)


def test_shear_of_a_touch_is_found_with_its_place():
    truth = {"probe.x_mm": 5.0, "probe.y_mm": 3.0, "load.tangential_N": [0.4, -0.2]}
    charges = solve(EIGHT.with_(**truth)).charges_pC
    unknown = ("x_mm", "y_mm", "force_N", "tangential_N")
    best, *_ = locate(EIGHT, charges, 1e-3, unknown=unknown, options=FEW)
    assert [*best.values.values()] == pytest.approx([5.0, 3.0, 1.0, 0.4, -0.2], abs=0.03)
    assert best.deviations["probe[0].force_N"] < 0.01


def test_a_touch_beyond_reach_is_told():
    charges = solve(EIGHT.with_(**{"probe.x_mm": 7.0})).charges_pC
    near = replace(FEW, reach_mm=4.0, pitch_mm=4.0)
    best, *_ = locate(EIGHT, charges, 1e-3, touches=1, options=near)
    assert best.at_edge == ("reach_mm",)
    unexplained, beyond = best.remarks
    assert unexplained.startswith("unexplained")
    assert "may lie beyond" in beyond


def test_touches_are_sought_about_the_electrodes():
    """Not only within a third of the film: a small film may be covered by its electrodes."""
    assert reach_by_electrodes_mm(EIGHT) == pytest.approx(15.0)
    small = {"film.radius_mm": 15.0, "electrodes.ring_radius_mm": 7.0, "electrodes.side_mm": 2.0}
    assert reach_by_electrodes_mm(EIGHT.with_(**small)) == pytest.approx(10.5)


def test_a_film_that_bears_no_touch_is_told():
    slack = PAIR.with_(**{"film.temperature_change_K": 20.0, "film.bending": False})
    charges = dict.fromkeys("ABCDEFGH", 500.0)
    with pytest.raises(NotConvergedError, match="one touch alone"):
        locate(slack, charges, 1e-3, touches=2, options=replace(FEW, pitch_mm=15.0))


def test_a_warm_touch_is_found_with_its_temperature():
    """Half of it on an electrode of four, from the place that a cold film would have."""
    truth = {"probe.x_mm": 8.0, "probe.y_mm": 1.0, "probe.temperature_K": 10.0}
    last = SolveOptions().tolerance
    touched = FINGER.with_(**truth, **{"numerics.tolerance": last})
    charges = np.array([*solve(touched).charges_pC.values()])
    listed = FINGER.with_(probe=[{**WARM, "force_N": 1.0, "temperature_K": 0.0}])
    keys = tuple(f"probe[0].{name}" for name in ("x_mm", "y_mm", "force_N", "temperature_K"))
    domain = Domain(15.0, (0.1, 10.0))
    search = Search(listed, keys, domain, last, np.arange(4), charges, 1e-3 * charges)
    assert {cold.keys for cold in search.of_cold_touches()} == {keys[:3]}
    assert [len(cold.electrodes) for cold in search.of_cold_touches()] == [4, 3, 3, 3, 3]
    ends = descend(search, np.array([[8.1, 0.9, 0.02, 5.0]]), options=search.how(FEW))
    (best,) = search.fits(ends)
    x, y, force, kelvins = best.values.values()
    assert [x, y] == pytest.approx([8.0, 1.0], abs=0.01)
    assert force == pytest.approx(1.0, rel=2e-3)
    assert kelvins == pytest.approx(10.0, abs=0.1)
    # deviations by central differences: a shift changes charges least, so it needs finer solves
    slopes = []
    for key, step in zip(keys, (0.1, 0.1, 0.03, 3.0), strict=True):
        scene = best.scene.with_(**{"numerics.tolerance": 2e-5 if key.endswith("_mm") else last})
        ends = [
            np.array([*solve(scene.with_(**{key: best.values[key] + h})).charges_pC.values()])
            for h in (step, -step)
        ]
        slopes.append((ends[0] - ends[1]) / (2.0 * step) / (1e-3 * charges))
    normal = np.array(slopes) @ np.transpose(slopes)
    told = np.linalg.inv(normal + np.diag((4.0 * search.longest) ** -2.0))
    # measured about this place: within 1.2 % by the last solves of a search, 6 % by coarser ones
    assert [*best.deviations.values()] == pytest.approx(np.sqrt(told.diagonal()), rel=0.03)


def test_two_touches_are_found_from_near_by_whatever_their_order():
    solution = solve(PAIR)
    keys = tuple(f"probe[{i}].{name}" for i in (0, 1) for name in ("x_mm", "y_mm", "force_N"))
    charges = np.array(list(solution.charges_pC.values()))
    search = Search(
        PAIR, keys, Domain(15.0, (0.1, 10.0)), 1e-3, np.arange(8), charges, 1e-3 * charges
    )
    truth = np.array([-7.0, 3.0, np.log(0.4), 5.0, -4.0, np.log(1.1)])
    start = np.roll(truth, 3) + np.array([0.5, -0.4, 0.1, 0.3, 0.5, -0.1])
    ends = descend(search, start[None], options=search.how(FEW))
    (best,) = search.fits(search.distinct(ends, FEW))
    assert [*best.values.values()] == pytest.approx([-7.0, 3.0, 0.4, 5.0, -4.0, 1.1], abs=0.02)


@pytest.mark.parametrize(
    ("scene", "how", "told"),
    [
        (Scene().with_(probe=DISC), {"touches": 2}, "4 channels do not tell 6 unknown"),
        (EIGHT, {"touches": 3}, "touches = 3: give 1 or 2"),
        (EIGHT, {"unknown": ("z_mm",)}, "z_mm: no quantity"),
        (PAIR, {}, "probe: the scene has 2; give 1"),
        (EIGHT, {"touches": 2, "unknown": ("force_N",)}, "need x_mm and y_mm"),
        (EIGHT.with_(**{"load.kind": "rigid"}), {}, "no derivative by probe"),
        (
            FINGER,
            {
                "unknown": (
                    "x_mm",
                    "y_mm",
                    "rotation_deg",
                    "force_N",
                    "temperature_K",
                    "tangential_N",
                )
            },
            "4 channels do not tell 6",
        ),
        (
            FINGER.with_(**{"film.pyroelectric_uC_m2K": None}),
            {"unknown": ("temperature_K",)},
            "film.pyroelectric_uC_m2K: not given",
        ),
        (
            FINGER.with_(**{"probe.contact_time_s": None}),
            {"unknown": ("temperature_K",)},
            "probe.contact_time_s: not given",
        ),
        (EIGHT, {"known": {"x_mm": 1.0}}, "known: a scene has what is known"),
    ],
)
def test_bad_requests_are_refused_before_any_solve(scene, how, told):
    names = [electrode.name for electrode in scene.electrode_list]
    with pytest.raises(ValueError, match=told.replace("[", r"\[")):
        locate(scene, dict.fromkeys(names, 900.0), **how)
