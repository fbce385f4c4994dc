"""Whatever is combined gives the charges of a fresh solve, or is refused by key.

A run of the suite draws a few examples; ``./run test --all`` draws ten times as many, other ones
each time.
"""

from __future__ import annotations

import re

import numpy as np
from hypothesis import HealthCheck, assume, given, reject, settings
from hypothesis import strategies as st

from pvdf_fem import Response, Scene, SceneError, build_response, gradients, solve, sweep
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import ignore_progress
from pvdf_fem.scene.changes import get_number
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import PLACE_NAMES, list_parameters
from pvdf_fem.surrogate.response_options import ResponseOptions
from tests.helpers.damage import drawn
from tests.helpers.discs import values
from tests.helpers.features import (
    MIRROR,
    QUARTER_TURN,
    SENSORS,
    TOLERANCE,
    combinations,
    combined,
    image,
)

#: A response of a few seconds.
COARSE = ResponseOptions(error=1e-2, validation_touches=3, max_builds=1)
KEY = re.compile(r"(film|electrodes|probe|load|numerics|readout|stage|air|scene|axes|reach_mm)\b")


def scene_of(changes) -> Scene:
    """The drawn scene; an example that is refused by key ends here."""
    scene = combined(changes)
    if isinstance(scene, Scene):
        return scene
    assert_named(SceneError(scene))
    reject()


def assert_named(error: ValueError) -> None:
    """Each complaint of an error begins with a key."""
    problems = error.problems if isinstance(error, SceneError) else [str(error)]
    assert problems
    assert all(KEY.match(problem) for problem in problems), problems


def assert_alike(found, expected, most: float = 2.0 * TOLERANCE) -> None:
    """Charges agree to a part of the largest of them; those of both are equally unknown."""
    found, expected = np.array(found, dtype=float), np.array(expected, dtype=float)
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    size = np.nanmax(np.abs(expected), initial=1e-3)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=most * size)


@given(changes=combinations(), frame=st.sampled_from([QUARTER_TURN, MIRROR]))
@drawn(0.1)
def test_images_have_the_charges_of_the_scene(changes, frame):
    scene = scene_of(changes)
    try:
        other = image(scene, frame)
    except SceneError:  # the thesis's means are of squares along the axes
        assume(False)
    first, second = solve(scene), solve(other)
    assert (first.status is Status.CONVERGED) == (second.status is Status.CONVERGED)
    assume(first.status is Status.CONVERGED)
    assert_alike(values(second.charges_pC), values(first.charges_pC))
    changed = [values(s.charge_changes_pC) for s in (second, first)]
    assert_alike(*changed, most=4.0 * TOLERANCE)


#: Axes of sweeps.
AXES = [
    {"load.force_N": [0.2, 0.9]},
    {"load.kind": ["dead", "follower"]},
    {"load.profile": ["uniform", "gaussian"]},
    {"probe.x_mm": [2.0, -3.5]},
    {"film.thickness_um": [20.0, 40.0]},
    {"film.poisson_ratio": [0.3, 0.4]},
    {"film.d31_pC_N": [5.0, 15.0]},
    {"film.d33_pC_N": [-10.0, -30.0]},
    {"film.permittivity": [9.0, 13.0]},
    {"film.density_kg_m3": [1000.0, 1800.0]},
    {"film.warming_K": [0.2, 0.6]},
    {"film.compression": ["refuse", "tension-field"]},
    {"electrodes": [SENSORS[0]["electrodes"], SENSORS[1]["electrodes"]]},
    {"numerics.observable": ["material", "thesis-edge"]},
]


@given(changes=combinations(), grid=st.lists(st.sampled_from(AXES), min_size=1, max_size=2))
@drawn(0.05)
def test_sweeps_have_the_charges_of_fresh_solves(changes, grid):
    scene = scene_of(changes)
    assume(grid[0] is not grid[-1] or len(grid) == 1)
    try:
        found = sweep(scene, grid, processes=1)
    except SceneError as error:
        assert_named(error)
        reject()
    shape = tuple(len(values) for axis in grid for values in axis.values())
    for index in np.ndindex(shape):
        point = {k: v[i] for i, axis in zip(index, grid, strict=True) for k, v in axis.items()}
        fresh = solve(scene.with_(**point))
        there = found[dict(zip(list(found.dims)[: len(index)], index, strict=True))]
        assert str(there["status"].values) == str(fresh.status)
        names = [electrode.name for electrode in fresh.scene.electrode_list]
        there = there.sel(electrode=names)
        if fresh.status is Status.CONVERGED:
            assert_alike(there["charge_pC"].values, values(fresh.charges_pC))
            rest = list(fresh.rest_charges_pC.values())
            assert_alike(there["rest_charge_pC"].values, rest, most=4.0 * TOLERANCE)


@given(changes=combinations(), data=st.data())
@drawn(0.06)
def test_gradients_are_those_of_fresh_solves(changes, data):
    scene = scene_of(changes)
    try:
        known = list_parameters(Problem.from_scene(scene))
    except SceneError:
        assume(False)
    assume(known)
    key = data.draw(st.sampled_from(known))
    solution = solve(scene)
    assume(solution.status is Status.CONVERGED)
    step = 0.4 if key.endswith(PLACE_NAMES[:2]) else 8.0 if key.endswith("deg") else 0.0
    step = step or 0.1 * (abs(get_number(scene, key)) or 0.5)
    at = get_number(scene, key)
    ends = [solve(scene.with_(**{key: at + s})) for s in (-step, step)]
    assume(all(end.status is Status.CONVERGED for end in ends))
    low, high = (np.array(values(end.charges_pC)) for end in ends)
    found = np.array(list(gradients(solution, [key])[key].values()))
    secant = (high - low) / (2.0 * step)
    # two charges with their errors, and the curvature over the step
    slack = 2.0 * TOLERANCE * np.abs(high).max() / step + 0.05 * np.abs(secant).max()
    np.testing.assert_allclose(found, secant, rtol=0.0, atol=slack)


@given(changes=combinations())
@settings(drawn(0.01), suppress_health_check=[HealthCheck.filter_too_much])
def test_responses_have_the_charges_of_fresh_solves(changes):
    scene = scene_of(changes)
    how = {"reach_mm": 1.5, "force_range_N": (0.5, 1.5), "tolerance": 0.1, "processes": 1}
    try:
        response: Response = build_response(scene, **how, options=COARSE, progress=ignore_progress)
    except ValueError as error:
        assert_named(error)
        reject()
    bound = response.error_bound
    assume(bound < how["tolerance"])
    touch = (0.5, -0.8, 30.0, 0.8)
    keys = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg", "load.force_N")
    fresh = solve(scene.with_(**dict(zip(keys, touch, strict=True))))
    assume(fresh.status is Status.CONVERGED)
    assert_alike(
        response.evaluate(touch)[0][0], values(fresh.charges_pC), most=2.0 * bound + TOLERANCE
    )
