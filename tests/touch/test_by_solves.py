"""Touches by full solves: shear and two touches from exact charges, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import NotConvergedError, Scene, locate, solve
from pvdf_fem.touch.least_squares import descend
from pvdf_fem.touch.problem import Problem, extents
from pvdf_fem.touch.search import location
from pvdf_fem.touch.solves import SolveOptions, Solves, ordered, reach_by_electrodes_mm
from pvdf_fem.touch.superposed import SuperposedOptions

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
BEGIN = SuperposedOptions(pitch_mm=7.5, fine_mm=2.5, starts=3)
FEW = SolveOptions(begin=BEGIN, followed=1, rounds=0, tolerance=1e-3)


def test_shear_of_a_touch_is_found_with_its_place():
    truth = {"probe.x_mm": 5.0, "probe.y_mm": 3.0, "load.tangential_N": [0.4, -0.2]}
    charges = solve(EIGHT.with_(**truth)).charges_pC
    unknown = ("x_mm", "y_mm", "force_N", "tangential_N")
    asked = []
    found = locate(
        EIGHT, charges, 1e-3, unknown=unknown, options=FEW, progress=lambda *n: asked.append(n)
    )
    assert found.best.values == pytest.approx([5.0, 3.0, 0.0, 1.0, 0.4, -0.2], abs=0.03)
    assert found.deviations["force_N"] < 0.01
    assert found.to_json()["touches"][0]["tangential_N[1]"] == pytest.approx(-0.2, abs=0.03)
    assert [done for done, _ in asked] == [*range(1, len(asked) + 1)]
    assert all(done <= total for done, total in asked)


def test_places_are_on_the_stage():
    """One start beside the touch: what is not sought is the scene's there."""
    staged = EIGHT.with_(stage={"x_mm": 20.0, "y_mm": -5.0, "rotation_deg": 90.0})
    charges = solve(EIGHT.with_(**{"probe.y_mm": 3.0})).charges_pC
    found = locate(staged, charges, 1e-3, options=FEW)
    assert [found.best.x_mm, found.best.y_mm] == pytest.approx([17.0, -1.0], abs=0.03)


def test_a_touch_beyond_reach_is_told():
    charges = solve(EIGHT.with_(**{"probe.x_mm": 7.0})).charges_pC
    near = replace(FEW, reach_mm=4.0, begin=replace(BEGIN, pitch_mm=4.0))
    found = locate(EIGHT, charges, 1e-3, touches=1, options=near)
    assert found.best.at_edge == ("reach_mm",)
    assert found.status == "unexplained"


def test_touches_are_sought_about_the_electrodes():
    """Not only within a third of the film: a small film may be covered by its electrodes."""
    assert reach_by_electrodes_mm(EIGHT) == pytest.approx(15.0)
    small = {"film.radius_mm": 15.0, "electrodes.ring_radius_mm": 7.0, "electrodes.side_mm": 2.0}
    assert reach_by_electrodes_mm(EIGHT.with_(**small)) == pytest.approx(10.5)


def test_a_film_that_bears_no_touch_is_told():
    slack = PAIR.with_(**{"film.temperature_change_K": 20.0, "film.bending": False})
    charges = dict.fromkeys("ABCDEFGH", 500.0)
    with pytest.raises(NotConvergedError, match="one touch alone"):
        locate(
            slack,
            charges,
            1e-3,
            touches=2,
            options=replace(FEW, begin=replace(BEGIN, pitch_mm=15.0)),
        )


def problem_of(model, charges, sigma):
    sought = np.sort([model.quantities.index(name) for name in model.sought])
    every = np.arange(len(charges))
    return Problem(model, every, charges[None], sigma * charges[None], sought)


def test_a_warm_touch_is_found_with_its_temperature():
    """Half of it on an electrode of four, from the place that a cold film would have."""
    truth = {"probe.x_mm": 8.0, "probe.y_mm": 1.0, "probe.temperature_K": 10.0}
    last = SolveOptions().tolerance
    touched = FINGER.with_(**truth, **{"numerics.tolerance": last})
    charges = np.array([*solve(touched).charges_pC.values()])
    names = ("x_mm", "y_mm", "force_N", "temperature_K")
    model = Solves.of(FINGER, 1, names, replace(SolveOptions(), reach_mm=15.0))
    problem = problem_of(model, charges, 1e-3)
    start = np.array([[8.1, 0.9, 0.0, 0.02, 5.0]])
    (best,) = location(problem, descend(problem, start, options=FEW.search)).touches
    assert [best.x_mm, best.y_mm] == pytest.approx([8.0, 1.0], abs=0.01)
    assert best.force_N == pytest.approx(1.0, rel=2e-3)
    assert best.by_name["temperature_K"] == pytest.approx(10.0, abs=0.1)
    # deviations by central differences: a shift changes charges least, so it needs finer solves
    slopes = []
    for name, step in zip(names, (0.1, 0.1, 0.03, 3.0), strict=True):
        tolerance = 2e-5 if name.endswith("_mm") else last
        scene = replace(model, error_bound=tolerance).scene_of(best.values)
        key = model.key(name)
        ends = [
            np.array([*solve(scene.with_(**{key: best.by_name[name] + h})).charges_pC.values()])
            for h in (step, -step)
        ]
        slopes.append((ends[0] - ends[1]) / (2.0 * step) / (1e-3 * charges))
    normal = np.array(slopes) @ np.transpose(slopes)
    extent = np.delete(extents(model), 2)
    told = np.linalg.inv(normal + np.diag(extent**-2.0))
    # measured about this place: within 1.2 % by the last solves of a search, 6 % by coarser ones
    assert [*best.deviations.values()] == pytest.approx(np.sqrt(told.diagonal()), rel=0.03)


@pytest.fixture(scope="module")
def two():
    """Two touches from exact charges, sought from near by in the other order."""
    names = ("x_mm", "y_mm", "force_N")
    model = Solves.of(EIGHT, 2, names, replace(SolveOptions(), tolerance=1e-3))
    problem = problem_of(model, np.array([*solve(PAIR).charges_pC.values()]), 1e-3)
    start = np.array([[5.3, -3.5, 0.0, np.log(1.0), -6.5, 2.6, 0.0, np.log(0.44)]])
    return location(problem, ordered(problem, descend(problem, start, options=FEW.search)))


def test_two_touches_are_found_in_the_order_of_their_places(two):
    expected = [-7.0, 3.0, 0.0, 0.4, 5.0, -4.0, 0.0, 1.1]
    assert two.best.values == pytest.approx(expected, abs=0.02)
    assert two.unknown[0] == "probe[0].x_mm"
    assert two.status == "located"


def test_two_touches_are_told_as_one_is(two):
    json = two.to_json()
    assert json["touches"][0]["probe[1].force_N"] == pytest.approx(1.1, abs=0.02)
    assert json["touches"][0]["standard_deviations"].keys() == set(two.unknown)
    assert str(two).startswith("located: 1 touch listed")
    assert "<table" in two._repr_html_()
    assert len(two.plot().axes) > 0


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
