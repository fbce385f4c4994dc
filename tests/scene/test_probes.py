"""Lists of probes and the keys of their loads: read, written, merged, changed."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene, SceneError
from pvdf_fem.derivatives.parameters import touched
from pvdf_fem.response.build import build_response
from pvdf_fem.scene.change import number_at
from pvdf_fem.scene.registry import FORCES
from pvdf_fem.scene.scene import Load
from pvdf_fem.sweeps.grid import Grid
from tests.helpers.damage import drawn
from tests.helpers.refusals import keys, refused, refused_text

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
MERGED = """
[load]
force_N = 0.3
profile = "gaussian"
profile_width_mm = 1.5

[[probe]]
shape = "circle"
x_mm = -8.0
load = { kind = "rigid" }

[[probe]]
shape = "circle"
x_mm = 8.0
"""


def loads(scene):
    return [touch.load for touch in scene.loaded_probes]


def assert_comes_back(scene):
    """By its file, as JSON, from another process and by no change."""
    trips = Scene.parse(scene.to_toml()), scene.with_(), pickle.loads(pickle.dumps(scene))
    for other in (*trips, Scene.model_validate_json(scene.model_dump_json())):
        assert (other, hash(other), loads(other)) == (scene, hash(scene), loads(scene))
        assert other.model_dump_json() == scene.model_dump_json()


def test_each_probe_has_its_load():
    scene = Scene.parse(TWO)
    assert [touch.patch for touch in scene.loaded_probes] == ["probe 1", "probe 2", "probe 3"]
    pushed = (0.5, 0.0)
    assert loads(scene) == [
        Load(force_N=0.5, tangential_N=pushed),
        Load(kind="rigid", contact="stuck", force_N=0.25, tangential_N=pushed),
        Load(profile="hertz", force_N=3.0, tangential_N=(0.0, -1.0)),
    ]
    alone = scene.with_(probe={"shape": "circle"})
    assert loads(alone) == [alone.load]
    assert_comes_back(scene)


def test_entries_change_by_index():
    scene = Scene.parse(TWO)
    changed = scene.with_(**{"probe[1].x_mm": 9.0, "probe.0.force_N": 1.5, "probe[0].y_mm": 1.0})
    assert (changed.probe[1].x_mm, changed.probe[0].y_mm) == (9.0, 1.0)
    assert loads(changed)[0].force_N == 1.5
    kind = scene.with_(**{"probe[1].load.kind": "dead"})
    assert loads(kind)[1] == Load(force_N=0.25, tangential_N=(0.5, 0.0))
    grid = Grid.of(scene, [{"probe[1].x_mm": [8.0, 9.0], "probe[0].force_N": [1.0, 2.0]}])
    assert [loads(s)[0].force_N for s in grid.scenes()] == [1.0, 2.0]
    single = Scene().with_(**{"probe.shape": "circle"})
    assert keys(refused(single.with_, {"probe[0].x_mm": 1.0})) == ["probe[0].x_mm"]


def test_what_serves_one_force_along_z_refuses_others_by_key():
    pushed = Scene().with_(**{"probe.shape": "circle", "load.tangential_N": [1.0, 0.0]})
    for scene, key in ((Scene.parse(TWO), "probe"), (pushed, "load.tangential_N")):
        with pytest.raises(ValueError, match=key.replace(".", r"\.")):
            build_response(scene, 10.0)


def test_a_probes_load_is_merged_over_the_scenes():
    """A kind of its own leaves behind what that kind does not bear, as ``load.kind`` does."""
    scene = Scene.parse(MERGED)
    rigid = Load(kind="rigid", force_N=0.3)
    assert loads(scene) == [rigid, scene.load]
    assert scene.with_(**{"load.kind": "rigid"}).load == rigid
    stuck = scene.with_(**{"load.kind": "rigid", "load.contact": "stuck", "load.tilt": "free"})
    assert loads(stuck)[0] == stuck.load
    assert loads(stuck.with_(**{"probe[0].load.kind": "dead"}))[0] == Load(force_N=0.3)


def test_a_probes_force_and_the_scenes_depth_take_each_others_place():
    tip = '[[probe]]\nshape = "sphere"\nradius_mm = 5\n'
    contact = '[load]\nkind = "contact"\ndepth_mm = 1.0\n'
    assert loads(Scene.parse(contact + tip))[0].depth_mm == 1.0
    assert loads(Scene.parse(f"{contact}{tip}force_N = 0.4")) == [Load(kind="contact", force_N=0.4)]
    pressed = "[load]\nkind = 'contact'\nforce_N = 3\n"
    assert loads(Scene.parse(f"{pressed}{tip}depth_mm = 2")) == [Load(kind="contact", depth_mm=2.0)]
    for both in ("force_N = 1\ndepth_mm = 2", "force_N = 1\nload = { depth_mm = 2 }"):
        assert keys(refused_text(f"{contact}{tip}{both}")) == ["probe[0].force_N"]


def test_what_a_probe_does_not_say_stays_unsaid():
    scene = Scene.parse(MERGED)
    assert_comes_back(scene)
    other = Scene.parse(scene.to_toml()).with_(**{"load.force_N": 0.7})
    assert [load.force_N for load in loads(other)] == [0.7, 0.7]
    stuck = scene.with_(**{"probe[0].load.contact": "stuck"})
    assert stuck.with_(**{"probe[0].load.contact": None}) == scene
    said = scene.with_(**{"probe[0].load.force_N": 0.3})
    assert said != scene  # the force of [load] moves one probe of two
    assert said.model_dump_json() != scene.model_dump_json()


@pytest.mark.parametrize("own", ["", "force_N = 2", "load = { force_N = 2, kind = 'rigid' }"])
@pytest.mark.parametrize("key", ["probe[0].force_N", "probe.0.load.force_N"])
def test_a_probes_force_is_changed_wherever_it_is_said(own, key):
    scene = Scene.parse(f"[[probe]]\n{own}").with_(**{key: 0.3})
    assert loads(scene)[0].force_N == number_at(scene, key) == 0.3
    assert Scene.parse(scene.to_toml()) == scene
    both = {"probe[0].force_N": 1.0, "probe[0].load.force_N": 2.0}
    assert keys(refused(scene.with_, both)) == ["probe[0].load.force_N"]


def test_keys_of_a_load_that_no_probe_has_are_told_and_do_not_vary():
    both = Scene.parse("[[probe]]\nforce_N = 1\n[[probe]]\nx_mm = 9\nload = { force_N = 2 }")
    assert both.doubts == ()
    assert [doubt[:14] for doubt in both.with_(**{"load.force_N": 2}).doubts] == ["load.force_N: "]
    one = Scene.parse("[[probe]]\nforce_N = 1\n[[probe]]\nx_mm = 9")
    assert one.with_(**{"load.force_N": 2}).doubts == ()
    for axis in ({"load.force_N": [1, 2]}, {"load": [{"force_N": 1}, {"force_N": 2}]}):
        assert len(Grid.of(one, [axis]).scenes()) == 2
        with pytest.raises(SceneError, match=r"load\.force_N"):
            Grid.of(both, [axis]).scenes()


def test_derivatives_are_by_the_keys_that_probes_have():
    found = touched(Scene.parse(MERGED.replace('load = { kind = "rigid" }', "force_N = 0.5")))
    numbers = {key: [number for _, number, _ in found[key]] for key in found}
    assert (numbers["load.force_N"], numbers["probe[0].force_N"]) == ([1], [0])
    both = touched(Scene.parse(MERGED))["load.force_N"]
    assert [number for _, number, _ in both] == [0, 1]


VALUES = {
    "contact": ["sliding", "stuck"],
    "tilt": ["held", "free"],
    "depth_mm": [1.0, 2.0],
    "force_N": [0.2, 1.0],
    "tangential_N": [[0.01, 0.0], [0.0, 0.02]],
    "profile": ["uniform", "hertz", "gaussian"],
}
OF_KIND = {
    "dead": ["profile", "force_N", "tangential_N"],
    "follower": ["force_N"],
    "rigid": ["contact", "tilt", "force_N"],
    "contact": ["depth_mm"],
}


def some(names):
    return st.fixed_dictionaries({}, optional={key: st.sampled_from(VALUES[key]) for key in names})


LOADS = st.sampled_from([*OF_KIND]).flatmap(
    lambda kind: some(OF_KIND[kind]).map(lambda table: {"kind": kind, **table})
)


@given(load=LOADS, own=LOADS | some(VALUES), beside=some(FORCES[1:]))
@drawn(2.0)
def test_a_merged_load_is_what_with_makes_of_the_scenes_load(load, own, beside):
    shape = {"shape": "circle"}
    if {**load, **own}["kind"] == "contact":
        shape["edge_radius_mm"] = 0.5
    own = {key: value for key, value in own.items() if key not in beside}
    told: tuple[str, ...] = ()
    try:
        scene = Scene(load=load, probe=[{**shape, **beside, "load": own}])
    except SceneError as error:
        told = error.problems
    assert all(line.startswith(("load", "probe[0]")) for line in told)
    if told:
        return
    alone = Scene(load=load)
    assert loads(scene) == [alone.with_(load={**own, **beside}).load]
    assert_comes_back(scene)
    said = {"probe[0]": {**beside, "load": own}}
    assert loads(Scene().with_(load=load, probe=[shape], **said)) == loads(scene)


def test_a_scene_that_was_written_without_friction_is_read():
    text = '[probe]\nshape = "sphere"\nradius_mm = 3.0\n[load]\nkind = "contact"\nfriction = 0.0\n'
    assert Scene.parse(text) == Scene.parse(text.replace("friction = 0.0\n", ""))
