"""Touches located by full solves: tangential forces, temperatures, two touches, and validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene, locate, solve
from pvdf_fem.inverse.least_squares import run_levenberg_marquardt
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.search import LocateOptions, make_location
from pvdf_fem.inverse.touch.solved_charges import SolvedResponse
from pvdf_fem.inverse.touch.superposition import (
    _choose_distant_candidates,
    search_along_weak_direction,
)
from pvdf_fem.surrogate.touch_domain import Domain
from tests.helpers.bump_response import make_bump_response

DISC = {"shape": "circle", "radius_mm": 2.0}
EIGHT_ELECTRODES = Scene().with_(
    electrodes={"layout": "ring", "count": 8, "shape": "square"}, probe={**DISC, "x_mm": 4.0}
)
TWO_PROBES = EIGHT_ELECTRODES.with_(
    probe=[
        {**DISC, "x_mm": -7.0, "y_mm": 3.0, "force_N": 0.4},
        {**DISC, "x_mm": 5.0, "y_mm": -4.0, "force_N": 1.1},
    ]
)
WARM_PROBE = Scene().with_(
    probe={**DISC, "x_mm": 8.0, "contact_time_s": 0.1}, **{"film.pyroelectric_uC_m2K": -25.0}
)
QUICK = LocateOptions(
    solved_pitch_mm=7.5,
    superposed_pitch_mm=2.5,
    superposed_candidates=3,
    refined_candidates=1,
    side_rounds=0,
    tolerance=1e-3,
)
POSITION_AND_FORCE = ("x_mm", "y_mm", "force_N")


def locate_near(response, scene, coordinates):
    """Locate a scene's touches from its exact charges by one search from given coordinates."""
    charges = np.array([[*solve(scene).charges_pC.values()]])
    electrodes = np.arange(charges.size)
    problem = LocationProblem(response, electrodes, charges, 1e-3 * charges, response.unknown)
    initial = np.array([coordinates])
    ends = run_levenberg_marquardt(problem, initial, options=QUICK.solved_search)
    return make_location(problem, ends)


def test_a_tangential_force_is_found_with_the_position_on_the_stage():
    truth = {"probe.x_mm": 5.0, "probe.y_mm": 3.0, "load.tangential_N": [0.4, -0.2]}
    charges = solve(EIGHT_ELECTRODES.with_(**truth)).charges_pC
    staged = EIGHT_ELECTRODES.with_(stage={"x_mm": 20.0, "y_mm": -5.0, "rotation_deg": 90.0})
    unknown = (*POSITION_AND_FORCE, "tangential_N")
    location = locate(staged, charges, 1e-3, unknown=unknown, options=QUICK)
    assert location.best.values == pytest.approx([17.0, 0.0, 90.0, 1.0, 0.4, -0.2], abs=0.03)
    assert location.deviations["force_N"] < 0.01


def test_a_touch_is_found_beside_a_clipped_charge():
    """The charge nearest to the touch is far above the end of its range."""
    truth = {"probe.x_mm": 5.0, "probe.y_mm": 3.0}
    charges = solve(EIGHT_ELECTRODES.with_(**truth)).charges_pC
    nearest = max(charges, key=charges.get)
    end = 0.4 * charges[nearest]
    readout = {"reading": "total", "range_V": {nearest: 1e-3 * end}}
    scene = EIGHT_ELECTRODES.with_(readout=readout)
    readings = charges | {nearest: end}
    location = locate(scene, readings, 1e-3, unknown=POSITION_AND_FORCE, unit="pC", options=QUICK)
    assert (location.status, location.clipped) == ("located", (nearest,))
    assert location.best.values == pytest.approx([5.0, 3.0, 0.0, 1.0], abs=0.03)


@pytest.mark.slow
def test_a_warm_touch_is_found_with_its_temperature():
    """Half of the probe is on one of four electrodes; the search begins where a cold one fits."""
    truth = {"probe.x_mm": 8.0, "probe.y_mm": 1.0, "probe.temperature_K": 10.0}
    touched = WARM_PROBE.with_(**truth, **{"numerics.tolerance": 1e-4})
    unknown = (*POSITION_AND_FORCE, "temperature_K")
    response = SolvedResponse.from_scene(WARM_PROBE, 1, unknown, 1e-4)
    (touch,) = locate_near(response, touched, [8.1, 0.9, 0.0, 0.02, 5.0]).touches
    assert touch.values == pytest.approx([8.0, 1.0, 0.0, 1.0, 10.0], abs=0.1)
    assert [touch.x_mm, touch.y_mm] == pytest.approx([8.0, 1.0], abs=0.02)
    assert touch.force_N == pytest.approx(1.0, rel=5e-3)


def test_two_touches_are_located_and_named_by_their_probes():
    initial = [-6.5, 2.6, 0.0, np.log(0.44), 5.3, -3.5, 0.0, np.log(1.0)]
    response = SolvedResponse.from_scene(EIGHT_ELECTRODES, 2, POSITION_AND_FORCE, 1e-3)
    location = locate_near(response, TWO_PROBES, initial)
    expected = [-7.0, 3.0, 0.0, 0.4, 5.0, -4.0, 0.0, 1.1]
    assert location.best.values == pytest.approx(expected, abs=0.02)
    assert location.status == "located"
    [touch] = location.to_json()["touches"]
    assert touch["probe[1].force_N"] == pytest.approx(1.1, abs=0.02)
    names = [f"probe[{index}].{name}" for index in (0, 1) for name in POSITION_AND_FORCE]
    assert [*touch["standard_deviations"]] == names


def test_both_sides_of_a_fold_are_searched():
    """Places mirror each other at a line of electrodes, near which charges hardly change across."""
    line = np.column_stack([[10.0, 5.0, -5.0, -10.0], np.zeros(4)])
    response = replace(make_bump_response("circle"), electrodes_mm=line)
    charges = response.evaluate(np.array([[3.0, 0.4, 0.0, 1.0]]))[0]
    unknown = np.array([0, 1, 3])
    problem = LocationProblem(response, np.arange(4), charges, 1e-4 * charges, unknown)
    initial = np.array([[3.2, -0.6, 0.0, 0.1]])
    ends = run_levenberg_marquardt(problem, initial, options=QUICK.solved_search)
    assert ends.coordinates[:, 1] == pytest.approx(-0.4, abs=0.02)
    every_end = search_along_weak_direction(problem, ends, LocateOptions()).coordinates
    assert np.abs(every_end[:, 1] + 0.4).min() < 0.02
    assert np.abs(every_end[:, 1] - 0.4).min() < 0.02


def test_the_domain_is_that_of_the_scenes_model_table():
    near = EIGHT_ELECTRODES.with_(model={"reach_mm": 4.0, "force_range_N": [0.2, 3.0]})
    response = SolvedResponse.from_scene(near, 2, POSITION_AND_FORCE, 1e-2)
    assert response.domain == Domain(4.0, (0.2, 3.0))
    far = EIGHT_ELECTRODES.with_(model={"reach_mm": 60.0})
    response = SolvedResponse.from_scene(far, 2, POSITION_AND_FORCE, 1e-2)
    assert 40.0 < response.domain.reach_mm < 45.0 - 2.0


def test_only_equal_probes_can_be_exchanged():
    response = SolvedResponse.from_scene(EIGHT_ELECTRODES, 2, POSITION_AND_FORCE, 1e-2)
    first = [5.0, -4.0, 0.0, 0.1]
    second = [-7.0, 3.0, 0.0, -0.9]
    coordinates = np.array([[*first, *second]])
    assert coordinates[:, response.swapped_columns].tolist() == [[*second, *first]]
    unequal = [{**DISC, "x_mm": -7.0}, {**DISC, "radius_mm": 3.0, "x_mm": 6.0}]
    scene = EIGHT_ELECTRODES.with_(probe=unequal)
    assert not SolvedResponse.from_scene(scene, 2, ("x_mm",), 1e-2).swapped_columns.size


@pytest.mark.parametrize(
    ("scene", "options", "key"),
    [
        (EIGHT_ELECTRODES, {"touches": 3}, "touches = 3"),
        (TWO_PROBES, {}, "probe"),
        (EIGHT_ELECTRODES, {"touches": 2, "unknown": ("force_N",)}, "unknown"),
        (EIGHT_ELECTRODES.with_(**{"load.kind": "rigid"}), {}, "unknown"),
        (EIGHT_ELECTRODES, {"unknown": ("temperature_K",)}, r"film\.pyroelectric_uC_m2K"),
        (EIGHT_ELECTRODES, {"known": {"x_mm": 1.0}}, "known"),
    ],
)
def test_bad_requests_are_rejected_before_any_solve(scene, options, key):
    names = [electrode.name for electrode in scene.electrode_list]
    with pytest.raises(ValueError, match=f"^{key}:"):
        locate(scene, dict.fromkeys(names, 900.0), **options)


def test_more_unknowns_than_charges_are_undetermined_without_any_solve():
    scene = Scene().with_(probe=DISC)
    solves = []
    location = locate(
        scene,
        dict.fromkeys("ABCD", 900.0),
        touches=2,
        progress=lambda *numbers: solves.append(numbers),
    )
    assert (location.status, location.touches, solves) == ("undetermined", (), [])


def test_the_first_solve_is_announced_with_the_number_of_solves_to_expect():
    """Those of all candidates, once and after each preliminary step, and ten per refined one."""

    def stop(done, expected):
        raise InterruptedError(done, expected)

    charges = dict.fromkeys("ABCDEFGH", 300.0)
    options = replace(QUICK, superposed_candidates=3, preliminary_steps=2, refined_candidates=4)
    with pytest.raises(InterruptedError) as announced:
        locate(TWO_PROBES, charges, 1e-3, touches=2, options=options, progress=stop)
    assert announced.value.args[1] == 3 * (1 + 2) + 10 * 4


def test_candidates_at_exactly_the_least_distance_are_kept():
    positions_mm = np.array([[[0.0, 0.0]], [[2.5, 2.5]], [[0.0, 5.0]], [[5.0, 5.0]]])
    options = LocateOptions(candidate_distance_mm=5.0, superposed_candidates=3)
    assert _choose_distant_candidates(positions_mm, options) == [0, 2, 3]


def test_charges_below_those_without_any_touch_have_no_location():
    charges = dict.fromkeys("ABCDEFGH", 30.0)
    location = locate(TWO_PROBES, charges, 1e-3, touches=2, options=QUICK)
    assert location.touches == ()
    assert location.status == "no_touch_found"


def test_an_uncertain_modulus_of_the_film_is_in_the_deviations():
    """A deviation of the modulus shifts the force as much as charges of such a film do."""
    truth = {"probe.x_mm": 5.0, "probe.y_mm": 3.0}
    table = {"keys": ["film.youngs_modulus_GPa"], "deviations": [0.1]}
    scene = EIGHT_ELECTRODES.with_(calibration=table)
    forces = []
    for modulus in (2.0, 2.1):
        stiffer = EIGHT_ELECTRODES.with_(truth, **{"film.youngs_modulus_GPa": modulus})
        location = locate(
            EIGHT_ELECTRODES, solve(stiffer).charges_pC, 1e-2, options=QUICK, noise_pC=0.0
        )
        forces.append(location.best.force_N)
    exact = locate(
        scene,
        solve(EIGHT_ELECTRODES.with_(truth)).charges_pC,
        1e-2,
        options=QUICK,
        include_calibration=False,
    )
    found = locate(
        scene, solve(EIGHT_ELECTRODES.with_(truth)).charges_pC, 1e-2, options=QUICK, noise_pC=0.0
    )
    expected = np.hypot(exact.deviations["force_N"], forces[1] - forces[0])
    assert expected > 1.5 * exact.deviations["force_N"]
    assert found.deviations["force_N"] == pytest.approx(expected, rel=0.05)
    assert found.best.values == pytest.approx(exact.best.values, abs=1e-3)
    assert found.explained
