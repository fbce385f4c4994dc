"""Touches by full solves: shear and two touches from exact charges, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene, locate, solve
from pvdf_fem.inverse.least_squares import run_levenberg_marquardt
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.search import LocateOptions, make_location
from pvdf_fem.inverse.touch.solved_charges import SolvedResponse
from pvdf_fem.inverse.touch.superposition import search_along_weak_direction
from pvdf_fem.surrogate.touch_domain import Domain
from tests.helpers.bump_response import make_bump_response

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
FEW = LocateOptions(
    solved_pitch_mm=7.5,
    superposed_pitch_mm=2.5,
    superposed_candidates=3,
    refined_candidates=1,
    side_rounds=0,
    tolerance=1e-3,
)
USUAL = ("x_mm", "y_mm", "force_N")


def found_near(model, scene, start):
    """The touches that searches from one start find, from a scene's exact charges."""
    charges = np.array([[*solve(scene).charges_pC.values()]])
    problem = LocationProblem(
        model, np.arange(charges.size), charges, 1e-3 * charges, model.unknown
    )
    return make_location(
        problem, run_levenberg_marquardt(problem, np.array([start]), options=FEW.solved_search)
    )


def test_shear_of_a_touch_is_found_with_its_place_on_the_stage():
    truth = {"probe.x_mm": 5.0, "probe.y_mm": 3.0, "load.tangential_N": [0.4, -0.2]}
    charges = solve(EIGHT.with_(**truth)).charges_pC
    staged = EIGHT.with_(stage={"x_mm": 20.0, "y_mm": -5.0, "rotation_deg": 90.0})
    found = locate(staged, charges, 1e-3, unknown=(*USUAL, "tangential_N"), options=FEW)
    assert found.best.values == pytest.approx([17.0, 0.0, 90.0, 1.0, 0.4, -0.2], abs=0.03)
    assert found.deviations["force_N"] < 0.01


@pytest.mark.slow
def test_a_warm_touch_is_found_with_its_temperature():
    """Half of it on an electrode of four, from the place that a cold film would have."""
    truth = {"probe.x_mm": 8.0, "probe.y_mm": 1.0, "probe.temperature_K": 10.0}
    touched = FINGER.with_(**truth, **{"numerics.tolerance": 1e-4})
    model = SolvedResponse.from_scene(FINGER, 1, (*USUAL, "temperature_K"), 1e-4)
    (best,) = found_near(model, touched, [8.1, 0.9, 0.0, 0.02, 5.0]).touches
    assert best.values == pytest.approx([8.0, 1.0, 0.0, 1.0, 10.0], abs=0.1)
    assert [best.x_mm, best.y_mm] == pytest.approx([8.0, 1.0], abs=0.02)
    assert best.force_N == pytest.approx(1.0, rel=5e-3)


def test_two_touches_are_found_and_told_as_one_is():
    start = [-6.5, 2.6, 0.0, np.log(0.44), 5.3, -3.5, 0.0, np.log(1.0)]
    two = found_near(SolvedResponse.from_scene(EIGHT, 2, USUAL, 1e-3), PAIR, start)
    expected = [-7.0, 3.0, 0.0, 0.4, 5.0, -4.0, 0.0, 1.1]
    assert two.best.values == pytest.approx(expected, abs=0.02)
    assert two.status == "located"
    [told] = two.to_json()["touches"]
    assert told["probe[1].force_N"] == pytest.approx(1.1, abs=0.02)
    assert [*told["standard_deviations"]] == [
        f"probe[{i}].{name}" for i in (0, 1) for name in USUAL
    ]


def test_both_sides_of_a_fold_are_searched():
    """Places mirror each other at a line of electrodes, near which charges hardly change across."""
    line = np.column_stack([[10.0, 5.0, -5.0, -10.0], np.zeros(4)])
    model, touch = (
        replace(make_bump_response("circle"), electrodes_mm=line),
        np.array([[3.0, 0.4, 0.0, 1.0]]),
    )
    charges = model.evaluate(touch)[0]
    problem = LocationProblem(model, np.arange(4), charges, 1e-4 * charges, np.array([0, 1, 3]))
    ends = run_levenberg_marquardt(
        problem, np.array([[3.2, -0.6, 0.0, 0.1]]), options=FEW.solved_search
    )
    assert ends.coordinates[:, 1] == pytest.approx(-0.4, abs=0.02)
    ends = search_along_weak_direction(problem, ends, LocateOptions()).coordinates
    assert [np.abs(ends[:, 1] - y).min() < 0.02 for y in (-0.4, 0.4)] == [True, True]


def test_touches_are_sought_where_the_scenes_model_says():
    near = EIGHT.with_(model={"reach_mm": 4.0, "force_range_N": [0.2, 3.0]})
    assert SolvedResponse.from_scene(near, 2, USUAL, 1e-2).domain == Domain(4.0, (0.2, 3.0))
    far = SolvedResponse.from_scene(EIGHT.with_(model={"reach_mm": 60.0}), 2, USUAL, 1e-2)
    assert 40.0 < far.domain.reach_mm < 45.0 - 2.0


def test_equal_probes_are_one_pair_in_either_order():
    model = SolvedResponse.from_scene(EIGHT, 2, USUAL, 1e-2)
    at = np.array([[5.0, -4.0, 0.0, 0.1, -7.0, 3.0, 0.0, -0.9]])
    assert at[:, model.other_probe].tolist() == [[-7.0, 3.0, 0.0, -0.9, 5.0, -4.0, 0.0, 0.1]]
    other = [{**DISC, "x_mm": -7.0}, {**DISC, "radius_mm": 3.0, "x_mm": 6.0}]
    assert not SolvedResponse.from_scene(
        EIGHT.with_(probe=other), 2, ("x_mm",), 1e-2
    ).other_probe.size


@pytest.mark.parametrize(
    ("scene", "how", "key"),
    [
        (EIGHT, {"touches": 3}, "touches = 3"),
        (PAIR, {}, "probe"),
        (EIGHT, {"touches": 2, "unknown": ("force_N",)}, "unknown"),
        (EIGHT.with_(**{"load.kind": "rigid"}), {}, "unknown"),
        (EIGHT, {"unknown": ("temperature_K",)}, r"film\.pyroelectric_uC_m2K"),
        (EIGHT, {"known": {"x_mm": 1.0}}, "known"),
    ],
)
def test_bad_requests_are_refused_before_any_solve(scene, how, key):
    names = [electrode.name for electrode in scene.electrode_list]
    with pytest.raises(ValueError, match=f"^{key}:"):
        locate(scene, dict.fromkeys(names, 900.0), **how)


def test_more_unknowns_than_charges_are_undetermined_without_any_solve():
    scene, solves = Scene().with_(probe=DISC), []
    how = {"touches": 2, "progress": lambda *n: solves.append(n)}
    found = locate(scene, dict.fromkeys("ABCD", 900.0), **how)
    assert (found.status, found.touches, solves) == ("undetermined", (), [])
