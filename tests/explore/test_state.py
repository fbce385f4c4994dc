"""What the page shows as values: changes, links, controls, the scene file."""

from __future__ import annotations

import re
from urllib.parse import parse_qs

import pytest

from pvdf_fem.explore.controls import describe_controls
from pvdf_fem.explore.state import WORDS, View
from pvdf_fem.scene.scene import Scene, SceneError

TRIANGLE = Scene.example("triangle")
TWO = Scene(
    probe=[
        {"shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "force_N": 0.4},
        {"shape": "triangle", "x_mm": 5.0, "force_N": 0.6},
    ]
)
ORTHOTROPIC = TRIANGLE.with_(**{"film.youngs_modulus_GPa": [2.0, 3.0]})
LISTED = TRIANGLE.with_(electrodes=[{"name": "A", "x_mm": 8.0, "y_mm": 0.0}])


@pytest.mark.parametrize(
    ("start", "changes"),
    [
        (TRIANGLE, {"probe.x_mm": -3.25, "load.force_N": 2.0, "quantity": "stress"}),
        (TRIANGLE, {"probe.shape": "rectangle", "load.kind": "rigid", "noise": 0.0}),
        (TRIANGLE, {"electrodes": {"layout": "ring", "shape": "circle", "radius_mm": 1.5}}),
        (ORTHOTROPIC, {"film.pretension_N_m": [8.0, 9.0]}),
        (TRIANGLE.with_(film={"warming_K": 1.0}), {"film": {"warming_K": None, "radius_mm": 40}}),
        (TWO, {"probe[1].rotation_deg": 30.0, "probe[0].force_N": 0.5}),
    ],
)
def test_a_link_and_a_scene_file_give_the_view_again(start, changes):
    view = View(start).changed(changes)
    assert View.of_query(start, view.query(start)) == view
    tables = {re.split(r"[.[]", key)[0] for key in changes}
    assert {*parse_qs(view.query(start))} == tables  # only what was changed
    assert Scene.parse(view.scene.to_toml()) == view.scene


@pytest.mark.parametrize(
    ("start", "key"), [(TRIANGLE, "load.profile"), (TWO, "probe[0].load.profile")]
)
def test_a_page_reads_no_file_that_the_scene_did_not_name(start, key):
    with pytest.raises(SceneError, match=r"load\.profile"):
        View(start).changed({key: "secret.csv"})
    given = View(TRIANGLE.with_(**{"load.profile": "mine.csv"}))
    moved = given.changed({"probe.x_mm": 1.0})
    assert View.of_query(given.scene, moved.query(given.scene)) == moved
    with pytest.raises(SceneError, match=r"load\.profile"):
        View.of_query(TRIANGLE, moved.query(TRIANGLE))


@pytest.mark.parametrize("query", ["probe.x_mm=44", "quantity=red", "noise=nan", "no.key=1", "=3"])
def test_what_is_refused_is_named(query):
    table = re.split(r"[.=]", query)[0] or "KEY=VALUE"
    with pytest.raises(SceneError, match=table):
        View.of_query(TRIANGLE, query)
    with pytest.raises(SceneError, match=table):
        View(TRIANGLE).typed(query)


def test_several_values_are_changed_at_once():
    text = 'load.force_N = 2 electrodes = { layout = "ring", count = 6 } noise=0.02'
    expected = TRIANGLE.with_(load={"force_N": 2}, electrodes={"layout": "ring", "count": 6})
    assert View(TRIANGLE).typed(text) == View(expected, noise=0.02)
    with pytest.raises(SceneError, match="probe"):  # what was typed is not changed
        View(TRIANGLE).typed("probe.shape=sphere load.kind=dead")


@pytest.mark.parametrize("start", [TRIANGLE, Scene(), LISTED, Scene.example("sphere"), TWO])
def test_every_word_of_a_picker_gives_a_scene(start):
    pickers = [
        c for group in describe_controls(View(start)).values() for c in group if "words" in c
    ]
    wanted = [(c["key"], word) for c in pickers for word in c["words"]]
    assert {"probe.shape", "probe[1].shape"} & {key for key, _ in wanted}
    for key, word in wanted:
        if start is TWO and word in ("sphere", "contact", "polygon"):
            continue  # of all probes or of none; the polygon meets the other probe
        after = describe_controls(View(start).typed(f"{key}={word}"))
        assert word in [c["value"] for group in after.values() for c in group if c["key"] == key]


def test_controls_are_those_of_the_scene_and_reach_its_values():
    def of(scene):
        groups = describe_controls(View(scene)).values()
        return {control["key"]: control for group in groups for control in group}

    found = of(TRIANGLE.with_(**{"film.thickness_um": 500.0}))
    assert found["film.thickness_um"]["max"] == found["film.thickness_um"]["value"] == 500.0
    assert of(TRIANGLE)["film.pretension_N_m"]["value"] == 8.3333  # of a film that is cooled
    assert "electrodes.side_mm" in found
    assert not {"electrodes.radius_mm", "load.depth_mm", "probe.force_N"} & found.keys()
    assert "probe[0].rotation_deg" not in of(TWO)  # a disc does not turn
    assert "load.force_N" not in of(TWO)  # each probe says its own
    assert of(ORTHOTROPIC)["film.youngs_modulus_GPa"]["value"] == "[2.0, 3.0]"
    assert {key for key in of(Scene()) if key.startswith("probe")} == {"probe.shape"}
    assert WORDS.keys() <= found.keys()
    assert all(control["about"] and "_" not in control["title"] for control in found.values())
