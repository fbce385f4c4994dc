"""What the page shows as values: undo and redo, links, sliders, the scene file."""

from __future__ import annotations

from urllib.parse import parse_qs

import pytest

from pvdf_fem.explore.state import History, View, sliders_of
from pvdf_fem.scene.scene import Scene, SceneError

TRIANGLE = Scene.example("triangle")
TWO = Scene(
    probe=[
        {"shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "force_N": 0.4},
        {"shape": "triangle", "x_mm": 5.0, "force_N": 0.6},
    ]
)


def test_undo_and_redo():
    first = View(TRIANGLE)
    second = first.changed({"load.force_N": 2.0})
    history = History(first).to(second).to(second)
    assert history.past == (first,)
    undone = history.undone()
    assert (undone.view, undone.redone()) == (first, history)
    third = first.changed({"noise": 0.1})
    assert undone.to(third).future == ()


@pytest.mark.parametrize(
    ("start", "changes"),
    [
        (TRIANGLE, {}),
        (TRIANGLE, {"probe.x_mm": -3.25, "load.force_N": 2.0, "quantity": "stress"}),
        (TRIANGLE, {"probe.shape": "rectangle", "load.kind": "rigid", "noise": 0.0}),
        (TRIANGLE, {"electrodes": {"layout": "ring", "count": 6, "shape": "circle"}}),
        (TRIANGLE, {"film.pretension_N_m": [8.0, 9.0], "film.youngs_modulus_GPa": [2.0, 3.0]}),
        (TRIANGLE, {"readout": {"noise_V": {"A": 0.01}}}),
        (TRIANGLE.with_(film={"warming_K": 1.0}), {"film": {"warming_K": None, "radius_mm": 40}}),
        (TWO, {"probe[1].rotation_deg": 30.0, "probe[0].force_N": 0.5}),
    ],
)
def test_a_link_and_a_scene_file_give_the_view_again(start, changes):
    if "electrodes" in changes:
        changes["electrodes"]["radius_mm"] = 1.5
    view = View(start).changed(changes)
    assert View.of_query(start, view.query(start)) == view
    assert Scene.parse(view.scene.to_toml()) == view.scene


@pytest.mark.parametrize(
    ("start", "changes"),
    [
        (TRIANGLE, {"load.profile": "/srv/secret.csv"}),
        (TRIANGLE, {"load": {"profile": "secret.csv"}}),
        (TRIANGLE, {"probe": None, "load.profile": "secret.csv"}),
        (TWO, {"probe[0].load": {"profile": "secret.csv"}}),
    ],
)
def test_a_page_reads_no_file_that_the_scene_did_not_name(start, changes):
    with pytest.raises(SceneError, match=r"load\.profile"):
        View(start).changed(changes)
    given = View(TRIANGLE.with_(**{"load.profile": "mine.csv"}))
    moved = given.changed({"probe.x_mm": 1.0})
    assert View.of_query(given.scene, moved.query(given.scene)) == moved
    assert moved.changed({"load.profile": "uniform"}).scene.load.profile == "uniform"
    with pytest.raises(SceneError, match=r"load\.profile"):
        View.of_query(TRIANGLE, moved.query(TRIANGLE))


def test_a_link_tells_only_what_was_changed():
    view = View(TRIANGLE).changed({"probe.x_mm": -3.25})
    assert [*parse_qs(view.query(TRIANGLE))] == ["probe"]
    assert View(TRIANGLE).query(TRIANGLE) == ""
    assert View.of_query(TRIANGLE, "probe.x_mm=-3.25") == view


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("film.thickness_um=-1", "film.thickness_um"),
        ("probe.x_mm=44", "probe"),
        ("quantity=colour", "deflection"),
        ("noise=2", "noise = 2"),
        ("noise=nan", "noise = nan"),
        ("nothing.there=1", "nothing"),
        ("=3", "KEY=VALUE"),
    ],
)
def test_what_is_refused_is_named(query, told):
    with pytest.raises(SceneError, match=told):
        View.of_query(TRIANGLE, query)


def test_sliders_are_those_of_the_scene_and_reach_its_values():
    found = sliders_of(TRIANGLE.with_(**{"film.thickness_um": 500.0}))
    assert found["film.thickness_um"]["end"] == found["film.thickness_um"]["value"] == 500.0
    assert "electrodes.side_mm" in found
    assert not {"electrodes.radius_mm", "load.depth_mm", "probe.force_N"} & found.keys()
    assert not any("probe" in key for key in sliders_of(Scene()))
    assert {"probe[0].force_N", "probe[1].rotation_deg"} <= sliders_of(TWO).keys()
    assert "load.force_N" not in sliders_of(TWO)  # each probe says its own
