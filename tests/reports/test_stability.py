"""The report of stability: its script, its oracles, and tasks whatever happens in them."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene
from reports.__main__ import load_report
from reports.stability import endings
from reports.stability.endings import (
    ExtremeScene,
    RangeValue,
    RatioOfScenes,
    compute_one_dimensional_charges,
)
from reports.stability.scenes import RANGES, draw_extreme_scene, enlarge
from tests.helpers.damage import drawn

SEED = 2026


def test_every_law_holds_to_rounding():
    plan = load_report("stability").plan
    (laws,) = (item.kind for item in plan.items if getattr(item.kind, "laws", ()))
    inputs, _ = plan.collect_requirements()
    for law, task in zip(laws.laws, laws.list_tasks(inputs), strict=True):
        assert isinstance(task, RatioOfScenes)
        assert task.run()[0]["ratio"] == pytest.approx(law.ratio, rel=3e-7)


def test_a_refused_value_and_an_exception_give_a_status(monkeypatch):
    scene = Scene().with_(**{"probe.shape": "circle"})
    (refused,) = RangeValue(scene, "film.poisson_ratio", 0.5, "finer").run()
    monkeypatch.setattr(endings, "solve", lambda _: 1 / 0)
    (crashed,) = ExtremeScene(1, SEED, 1e-2).run()
    assert (refused["status"], crashed["status"]) == ("refused", "crashed")
    assert refused["reason"].startswith("film.poisson_ratio = 0.5: ")
    assert "ZeroDivisionError" in crashed["reason"]


def test_an_extreme_scene_is_compared_with_two_others():
    (row,) = ExtremeScene(6, SEED, 1e-2).run()
    assert (row["status"], row["finer"], row["enlarged"]) == ("converged",) * 3
    assert row["error"] < 1.0
    assert row["scaled"] < 1e-6
    assert Scene.parse(row["scene"]).numerics.tolerance == 1e-2


@pytest.mark.parametrize(
    ("changes", "most"),
    [
        ({}, 1.0),
        ({"film.bending": True, "load.force_N": 1e-3}, 1.0),
        pytest.param(
            {"load.kind": "contact", "probe": {"shape": "sphere", "radius_mm": 6.0}},
            1.5,
            marks=pytest.mark.slow,
        ),
        ({"film.temperature_change_K": 3.0, "film.compression": "tension-field"}, 1.0),
    ],
)
def test_charges_are_those_of_problems_in_one_dimension(changes, most):
    disc = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 5.0}
    scene = Scene().with_(electrodes=[disc], probe={"shape": "circle", "radius_mm": 2.5})
    scene = scene.with_(**changes)
    (row,) = RangeValue(scene, "numerics.tolerance", 1e-3, "one-dimension").run()
    assert row["error"] < most
    doubled = compute_one_dimensional_charges(
        scene.with_(**{"film.d31_pC_N": 16.0, "film.d32_pC_N": 16.0})
    )
    assert doubled == pytest.approx(2.0 * compute_one_dimensional_charges(scene))


@given(number=st.integers(0, 10**6))
@drawn(0.2)
def test_random_scenes_are_within_their_ranges_and_reproducible(number):
    scene = draw_extreme_scene(number, SEED)
    assert scene == draw_extreme_scene(number, SEED)
    for key in ("film.radius_mm", "film.thickness_um", "film.youngs_modulus_GPa", "load.force_N"):
        low, high = RANGES[key]
        values = np.array(attrgetter(key)(scene))
        assert ((values >= low) & (values <= high)).all()
    film = scene.film
    assert (film.compression == "tension-field") == (film.temperature_change_K > 0.0)
    back = enlarge(enlarge(scene, 4.0, 0.25), 0.25, 4.0)
    assert back == scene  # powers of two leave no rounding
