"""Lists of probes and the keys of their loads: read, merged, changed."""

import pytest
from hypothesis import given

from pvdf_fem import Scene
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.load import Load, LoadOverrides
from pvdf_fem.scene.validation.table_forms import TableForm
from pvdf_fem.solver.sensitivity.parameters import map_probe_keys
from pvdf_fem.studies.scene_grid import SceneGrid
from tests.helpers.damage import drawn
from tests.helpers.refusals import keys, refused, refused_text, scene_or_mistakes
from tests.helpers.strategies import rows

TWO = """
[load]
force_N = 3.0
tangential_N = [0.5, 0.0]

[[probe]]
shape = "circle"
x_mm = -8.0
force_N = 0.5

[[probe]]
x_mm = 8.0
load = { kind = "rigid", contact = "stuck", force_N = 0.25 }

[[probe]]
shape = "circle"
y_mm = 9.0
tangential_N = [0.0, -1.0]
load = { profile = "hertz" }
"""


def list_loads(scene):
    return [touch.load for touch in scene.loaded_probes]


def test_each_probe_has_its_load():
    scene = Scene.parse(TWO)
    assert [touch.patch for touch in scene.loaded_probes] == ["probe 1", "probe 2", "probe 3"]
    pushed = (0.5, 0.0)
    assert list_loads(scene) == [
        Load(force_N=0.5, tangential_N=pushed),
        Load(kind="rigid", contact="stuck", force_N=0.25, tangential_N=pushed),
        Load(profile="hertz", force_N=3.0, tangential_N=(0.0, -1.0)),
    ]
    assert keys(refused(getattr, scene, "single_probe")) == ["probe"]
    alone = scene.with_(probe={"shape": "circle"})
    assert list_loads(alone) == [alone.load]
    kind = scene.with_(**{"probe[1].load.kind": "dead"})
    assert list_loads(kind)[1] == Load(force_N=0.25, tangential_N=pushed)


def test_entries_change_by_index():
    scene = Scene.parse(TWO)
    changed = scene.with_(**{"probe[1].x_mm": 9.0, "probe.0.force_N": 1.5, "probe[0].y_mm": 1.0})
    assert (changed.probe[1].x_mm, changed.probe[0].y_mm) == (9.0, 1.0)
    assert list_loads(changed)[0].force_N == 1.5
    merged = scene.with_(**{"probe[1]": {"load": {"force_N": 0.2}, "y_mm": 1.0}})
    assert merged == scene.with_(**{"probe[1].force_N": 0.2, "probe[1].y_mm": 1.0})
    single = Scene().with_(**{"probe.shape": "circle"})
    assert keys(refused(single.with_, {"probe[0].x_mm": 1.0})) == ["probe[0].x_mm"]


def test_a_probes_force_and_the_scenes_depth_replace_each_other():
    tip = '[[probe]]\nshape = "sphere"\nradius_mm = 5\n'
    contact = '[load]\nkind = "contact"\ndepth_mm = 1.0\n'
    deep = Scene.parse(contact + tip)
    assert list_loads(deep)[0].depth_mm == 1.0
    light = Load(kind="contact", force_N=0.4)
    assert list_loads(Scene.parse(f"{contact}{tip}force_N = 0.4")) == [light]
    assert list_loads(deep.with_(**{"probe[0].load.force_N": 0.4})) == [light]
    pressed = Scene.parse(f"[load]\nkind = 'contact'\nforce_N = 3\n{tip}force_N = 0.4")
    assert list_loads(pressed.with_(**{"probe[0].depth_mm": 2.0})) == [
        Load(kind="contact", depth_mm=2)
    ]
    for both in ("force_N = 1\ndepth_mm = 2", "force_N = 1\nload = { depth_mm = 2 }"):
        assert keys(refused_text(f"{contact}{tip}{both}")) == ["probe[0].force_N"]


def test_a_probe_inherits_other_keys_of_the_scenes_load():
    scene = Scene.parse('[load]\nforce_N = 0.3\n[[probe]]\nload = { kind = "rigid" }')
    other = Scene.parse(scene.to_toml()).with_(**{"load.force_N": 0.7})
    assert list_loads(other) == [Load(kind="rigid", force_N=0.7)]
    stuck = scene.with_(**{"probe[0].load.contact": "stuck"})
    assert stuck.with_(**{"probe[0].load.contact": None}) == scene


@pytest.mark.parametrize("own", ["", "force_N = 2", "load = { force_N = 2, kind = 'rigid' }"])
@pytest.mark.parametrize("key", ["probe[0].force_N", "probe.0.load.force_N"])
def test_a_probes_force_is_changed_beside_its_shape_or_in_its_load(own, key):
    scene = Scene.parse(f"[[probe]]\n{own}").with_(**{key: 0.3})
    assert list_loads(scene)[0].force_N == get_number(scene, key) == 0.3
    assert Scene.parse(scene.to_toml()) == scene
    both = {"probe[0].force_N": 1.0, "probe[0].load.force_N": 2.0}
    assert keys(refused(scene.with_, both)) == ["probe[0].load.force_N"]


def test_load_keys_without_effect_are_warned_of_and_cannot_vary():
    both = Scene.parse("[[probe]]\nforce_N = 1\n[[probe]]\nx_mm = 9\nload = { force_N = 2 }")
    assert both.warnings == ()
    assert [warning[:14] for warning in both.with_(**{"load.force_N": 2}).warnings] == [
        "load.force_N: "
    ]
    one = Scene.parse("[[probe]]\nforce_N = 1\n[[probe]]\nx_mm = 9")
    assert one.with_(**{"load.force_N": 2}).warnings == ()
    numbers = {
        key: [number for _, number, _ in found] for key, found in map_probe_keys(one).items()
    }
    assert (numbers["load.force_N"], numbers["probe[0].force_N"]) == ([1], [0])
    assert "load.force_N" not in map_probe_keys(both)
    for axis in ({"load.force_N": [1, 2]}, {"load": [{"force_N": 1}, {"force_N": 2}]}):
        assert len(SceneGrid.from_tables(one, [axis]).scenes()) == 2
        assert "load.force_N" in keys(refused(SceneGrid.from_tables(both, [axis]).scenes))


@given(load=rows(TableForm(Load)), own=rows(TableForm(LoadOverrides)))
@drawn(1.0)
def test_a_resolved_load_equals_the_changed_load_of_the_scene(load, own):
    tip = {"edge_radius_mm": 0.5} if {**load, **own}.get("kind") == "contact" else {}
    entry = {"shape": "circle", **tip}
    scene = scene_or_mistakes({"load": load, "probe": [{**entry, "load": own}]})
    if isinstance(scene, Scene):
        assert list_loads(scene) == [Scene(load=load).with_(load=own).load]
        said = {"probe[0]": {"load": own}}
        assert list_loads(Scene().with_(load=load, probe=[entry], **said)) == list_loads(scene)
    else:
        assert all(key.startswith(("load.", "probe[0].")) for key in scene)
