"""The state of the page: changes, links, controls, the scene file."""

from __future__ import annotations

import re
from urllib.parse import parse_qs

import pytest

from pvdf_fem.explore.controls import describe_controls
from pvdf_fem.explore.state import CHOICES, View
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


def list_controls(view):
    """Return the controls of a view by key."""
    return {c["key"]: c for group in describe_controls(view).values() for c in group}


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
    view = View(start).with_changes(changes)
    assert View.from_query(start, view.format_query(start)) == view
    tables = {re.split(r"[.[]", key)[0] for key in changes}
    assert {*parse_qs(view.format_query(start))} == tables  # only what was changed
    assert Scene.parse(view.scene.to_toml()) == view.scene


@pytest.mark.parametrize(
    ("start", "key"), [(TRIANGLE, "load.profile"), (TWO, "probe[0].load.profile")]
)
def test_the_page_opens_only_files_that_the_scene_names(start, key):
    with pytest.raises(SceneError, match=r"load\.profile"):
        View(start).with_changes({key: "secret.csv"})
    given = View(TRIANGLE.with_(**{"load.profile": "mine.csv"}))
    moved = given.with_changes({"probe.x_mm": 1.0})
    assert View.from_query(given.scene, moved.format_query(given.scene)) == moved
    with pytest.raises(SceneError, match=r"load\.profile"):
        View.from_query(TRIANGLE, moved.format_query(TRIANGLE))


@pytest.mark.parametrize("query", ["probe.x_mm=44", "quantity=red", "noise=nan", "no.key=1", "=3"])
def test_errors_name_the_table(query):
    table = re.split(r"[.=]", query)[0] or "KEY=VALUE"
    with pytest.raises(SceneError, match=table):
        View.from_query(TRIANGLE, query)
    with pytest.raises(SceneError, match=table):
        View(TRIANGLE).with_typed_changes(query)


def test_several_values_are_changed_at_once():
    text = 'load.force_N = 2 electrodes = { layout = "ring", count = 6 } noise=0.02'
    expected = TRIANGLE.with_(load={"force_N": 2}, electrodes={"layout": "ring", "count": 6})
    assert View(TRIANGLE).with_typed_changes(text) == View(expected, noise=0.02)
    with pytest.raises(SceneError, match="probe"):  # typed values are not changed
        View(TRIANGLE).with_typed_changes("probe.shape=sphere load.kind=dead")


@pytest.mark.parametrize("start", [TRIANGLE, Scene(), LISTED, Scene.example("sphere"), TWO])
def test_every_choice_gives_a_scene(start):
    choices = [
        (key, word)
        for key, control in list_controls(View(start)).items()
        for word in control.get("choices", ())
    ]
    assert {"probe.shape", "probe[1].shape"} & {key for key, _ in choices}
    for key, word in choices:
        if start is TWO and word in ("sphere", "contact", "polygon"):
            continue  # all probes or none are spheres; the polygon overlaps the other probe
        view = View(start).with_typed_changes(f"{key}={word}")
        assert list_controls(view)[key]["value"] == word


def test_controls_are_those_of_the_scene_and_reach_its_values():
    def of(scene):
        return list_controls(View(scene))

    found = of(TRIANGLE.with_(**{"film.thickness_um": 500.0}))
    assert found["film.thickness_um"]["max"] == found["film.thickness_um"]["value"] == 500.0
    assert of(TRIANGLE)["film.pretension_N_m"]["value"] == 8.3333  # of a film that is cooled
    assert "electrodes.side_mm" in found
    assert not {"electrodes.radius_mm", "load.depth_mm", "probe.force_N"} & found.keys()
    assert "probe[0].rotation_deg" not in of(TWO)  # a disc does not turn
    assert "load.force_N" not in of(TWO)  # each probe says its own
    assert of(ORTHOTROPIC)["film.youngs_modulus_GPa"]["value"] == "[2.0, 3.0]"
    assert {key for key in of(Scene()) if key.startswith("probe")} == {"probe.shape"}
    assert CHOICES.keys() <= found.keys()
    assert all(control["meaning"] and "_" not in control["title"] for control in found.values())
