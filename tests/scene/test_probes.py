"""Lists of probes and the keys of their loads: read, written, changed, refused."""

import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pvdf_fem import Scene, SceneError
from pvdf_fem.derivatives.parameters import touched
from pvdf_fem.response.build import build_response
from pvdf_fem.scene.change import number_at
from pvdf_fem.scene.registry import FORCES
from pvdf_fem.scene.scene import Load
from pvdf_fem.sweeps.grid import Grid

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


def problems(text):
    with pytest.raises(SceneError) as caught:
        Scene.parse(text)
    return caught.value.problems


def test_each_probe_has_its_load():
    scene = Scene.parse(TWO)
    assert [touch.patch for touch in scene.loaded_probes] == ["probe 1", "probe 2", "probe 3"]
    loads = [touch.load for touch in scene.loaded_probes]
    assert loads[0] == Load(force_N=0.5, tangential_N=(0.5, 0.0))
    pushed = (0.5, 0.0)
    assert loads[1] == Load(kind="rigid", contact="stuck", force_N=0.25, tangential_N=pushed)
    assert loads[2] == Load(profile="hertz", force_N=3.0, tangential_N=(0.0, -1.0))
    alone = scene.with_(probe={"shape": "circle"})
    assert [touch.load for touch in alone.loaded_probes] == [alone.load]


def test_a_list_is_written_and_read_again():
    scene = Scene.parse(TWO)
    assert Scene.parse(scene.to_toml()) == scene
    assert hash(Scene.parse(scene.to_toml())) == hash(scene)


def test_entries_change_by_index():
    scene = Scene.parse(TWO)
    changed = scene.with_(**{"probe[1].x_mm": 9.0, "probe.0.force_N": 1.5, "probe[0].y_mm": 1.0})
    assert (changed.probe[1].x_mm, changed.probe[0].y_mm) == (9.0, 1.0)
    assert changed.loaded_probes[0].load.force_N == 1.5
    kind = scene.with_(**{"probe[1].load.kind": "dead"})
    assert kind.loaded_probes[1].load == Load(force_N=0.25, tangential_N=(0.5, 0.0))
    grid = Grid.of(scene, [{"probe[1].x_mm": [8.0, 9.0], "probe[0].force_N": [1.0, 2.0]}])
    assert [s.loaded_probes[0].load.force_N for s in grid.scenes()] == [1.0, 2.0]
    with pytest.raises(SceneError, match="probes are addressed by index in a list"):
        Scene().with_(**{"probe.shape": "circle"}).with_(**{"probe[0].x_mm": 1.0})


@pytest.mark.parametrize(
    ("text", "key", "told"),
    [
        ("probe = []", "probe = []", "too few entries; give at least 1"),
        ("[[probe]]\nx_m = 1.0", "probe[0].x_m", "did you mean x_mm?"),
        ("[[probe]]\nradius_mm = 1.0", "probe[0].radius_mm", "give shape = sphere or circle"),
        ('[[probe]]\nshape = "disc"', 'probe[0].shape = "disc"', "choose from"),
        ("[[probe]]\nx_mm = 50.0", "probe[0].x_mm = 50.0", "over the rim"),
        ("[[probe]]\n[[probe]]\nx_mm = 1.0", "probe[1].x_mm = 1.0", "overlaps probe[0]"),
        ("[[probe]]\nforce_N = -1.0", "probe[0].force_N = -1.0", "0 to 1e+06 N"),
        ('[[probe]]\nload = { kind = "soft" }', "probe[0].load.kind", "choose from"),
        ("[[probe]]\nload = { forse_N = 1.0 }", "probe[0].load.forse_N", "did you mean force_N?"),
        (
            "[[probe]]\nforce_N = 1.0\nload = { force_N = 2.0 }",
            "probe[0].load = a table",
            "has force_N, which stands beside it too",
        ),
        (
            '[load]\nkind = "rigid"\n[[probe]]\ntangential_N = [1.0, 0.0]',
            "probe[0].tangential_N = [1.0, 0.0]",
            'contact = "stuck"',
        ),
        (
            '[[probe]]\nload = { profile = "hertz" }',
            'probe[0].load.profile = "hertz"',
            'probe[0].shape = "circle"',
        ),
        ('[probe]\n[load]\nprofile = "hertz"', 'load.profile = "hertz"', "discs and ellipses"),
        ('[load]\nprofile = "round"', 'load.profile = "round"', "choose from"),
        ('[load]\nkind = "rigid"\nprofile = "hertz"', "load.profile", 'for kind = "dead" only'),
        ("[load]\nprofile_width_mm = 1.0", "load.profile_width_mm", '"gaussian" only'),
        ('[load]\nkind = "follower"\ntangential_N = [1.0, 0.0]', "load.tangential_N", "normal to"),
        ('[load]\nkind = "rigid"\ntangential_N = [1.0, 0.0]', "load.tangential_N", "slides off"),
        ("[load]\ntangential_N = [1.0]", "load.tangential_N", ""),
        ("[load]\ntangential_N = 1.0", "load.tangential_N = 1.0", "must be a list"),
        ("[load]\ntangential_N = [1.0, 2e7]", "load.tangential_N[1] = 20000000.0", "too large"),
    ],
)
def test_refusals_name_the_key(text, key, told):
    (line,) = problems(text)
    assert line.startswith(key)
    assert told in line


def test_all_mistakes_of_a_list_are_told():
    text = "[[probe]]\nx_mm = 60.0\n[[probe]]\nx_mm = 1.0\n[[probe]]\n[[probe]]\nx = 1.0"
    keys = [line.split(" = ")[0] for line in problems(text)]
    assert keys == ["probe[3].x", "probe[0].x_mm", "probe[2].x_mm"]


def test_what_serves_one_probe_refuses_a_list():
    with pytest.raises(ValueError, match=r"probe = .*one probe only; give a table \[probe\]"):
        build_response(Scene.parse(TWO), 10.0)


def test_responses_are_of_a_force_along_z():
    scene = Scene().with_(**{"probe.shape": "circle", "load.tangential_N": [1.0, 0.0]})
    with pytest.raises(ValueError, match=r"remove load.tangential_N"):
        build_response(scene, 10.0)


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


def test_a_probes_load_is_merged_over_the_scenes():
    """A kind of its own leaves behind what that kind does not bear, as ``load.kind`` does."""
    scene = Scene.parse(MERGED)
    rigid, plain = (touch.load for touch in scene.loaded_probes)
    assert rigid == Load(kind="rigid", force_N=0.3)
    assert plain == scene.load
    assert scene.with_(**{"load.kind": "rigid"}).load == rigid
    stuck = scene.with_(**{"load.kind": "rigid", "load.contact": "stuck", "load.tilt": "free"})
    assert stuck.loaded_probes[0].load == stuck.load
    assert stuck.with_(**{"probe[0].load.kind": "dead"}).loaded_probes[0].load == Load(force_N=0.3)


def test_a_probes_force_and_the_scenes_depth_take_each_others_place():
    tip = '[[probe]]\nshape = "sphere"\nradius_mm = 5\n'
    contact = '[load]\nkind = "contact"\ndepth_mm = 1.0\n'
    assert Scene.parse(contact + tip).loaded_probes[0].load.depth_mm == 1.0
    (touch,) = Scene.parse(f"{contact}{tip}force_N = 0.4").loaded_probes
    assert touch.load == Load(kind="contact", force_N=0.4)
    pressed = "[load]\nkind = 'contact'\nforce_N = 3\n"
    (touch,) = Scene.parse(f"{pressed}{tip}depth_mm = 2").loaded_probes
    assert touch.load == Load(kind="contact", depth_mm=2.0)
    for both in ("force_N = 1\ndepth_mm = 2", "force_N = 1\nload = { depth_mm = 2 }"):
        (line,) = problems(f"{contact}{tip}{both}")
        assert line.startswith("probe[0].force_N = ")


def test_what_a_probe_does_not_say_stays_unsaid():
    scene = Scene.parse(MERGED)
    trips = Scene.parse(scene.to_toml()), scene.with_(), pickle.loads(pickle.dumps(scene))
    for other in (*trips, Scene.model_validate_json(scene.model_dump_json())):
        assert other == scene
        assert other.model_dump_json() == scene.model_dump_json()
        forces = [t.load.force_N for t in other.with_(**{"load.force_N": 0.7}).loaded_probes]
        assert forces == [0.7, 0.7]
    stuck = scene.with_(**{"probe[0].load.contact": "stuck"})
    assert stuck.with_(**{"probe[0].load.contact": None}) == scene
    whole = Scene(probe=[{"load": Load(kind="rigid")}]).with_(**{"load.force_N": 0.7})
    assert whole.loaded_probes[0].load == Load(kind="rigid")
    said = scene.with_(**{"probe[0].load.force_N": 0.3})
    assert said != scene  # the force of [load] moves one probe of two
    assert said.model_dump_json() != scene.model_dump_json()


@pytest.mark.parametrize("own", ["", "force_N = 2", "load = { force_N = 2, kind = 'rigid' }"])
@pytest.mark.parametrize("key", ["probe[0].force_N", "probe.0.load.force_N"])
def test_a_probes_force_is_changed_wherever_it_is_said(own, key):
    scene = Scene.parse(f"[[probe]]\n{own}").with_(**{key: 0.3})
    assert scene.loaded_probes[0].load.force_N == number_at(scene, key) == 0.3
    assert Scene.parse(scene.to_toml()) == scene


def test_forces_at_other_places_are_of_the_same_scene():
    beside = Scene.parse("[[probe]]\ntangential_N = [0.1, 0.0]")
    assert Scene.parse("[[probe]]\nload = { tangential_N = [0.1, 0.0] }") == beside
    pushed = beside.with_(**{"probe[0].load.tangential_N[1]": 0.2})
    assert pushed.loaded_probes[0].load.tangential_N == (0.1, 0.2)
    with pytest.raises(SceneError, match=r"probe\[0\].load.force_N"):
        beside.with_(**{"probe[0].force_N": 1.0, "probe[0].load.force_N": 2.0})


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("tangential_N = [1, 0]\n[[probe]]\nload = { kind = 'follower' }", "load.tangential_N"),
        ("[[probe]]\nload = { contact = 'stuck' }", "probe[0].load.contact"),
        ("kind = 'contact'\n[[probe]]", "probe[0].shape"),
        ("[[probe]]\nload = { kind = 'contact' }", "probe[0].shape"),
    ],
)
@pytest.mark.parametrize("bending", ["", "bending = true"])
def test_what_a_probe_does_not_bear_is_refused_by_the_key_that_says_it(text, key, bending):
    told = problems(f"[film]\n{bending}\n[load]\n{text}")
    assert any(line.startswith(f"{key} = ") for line in told)


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
    assert [number for _, number, _ in found["load.force_N"]] == [1]
    assert [number for _, number, _ in found["probe[0].force_N"]] == [0]
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


def some(keys):
    return st.fixed_dictionaries({}, optional={key: st.sampled_from(VALUES[key]) for key in keys})


LOADS = st.sampled_from([*OF_KIND]).flatmap(
    lambda kind: some(OF_KIND[kind]).map(lambda table: {"kind": kind, **table})
)


@given(load=LOADS, own=LOADS | some(VALUES), beside=some(FORCES[1:]))
@settings(deadline=None, max_examples=200)
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
    assert scene.loaded_probes[0].load == alone.with_(load={**own, **beside}).load
    trips = Scene.parse(scene.to_toml()), scene.with_(), pickle.loads(pickle.dumps(scene))
    for other in (*trips, Scene.model_validate_json(scene.model_dump_json())):
        assert other == scene
        assert other.loaded_probes == scene.loaded_probes
    said = {"probe[0]": {**beside, "load": own}}
    changed = Scene().with_(load=load, probe=[shape], **said)
    assert changed.loaded_probes == scene.loaded_probes


def test_a_scene_that_was_written_without_friction_is_read():
    text = '[probe]\nshape = "sphere"\nradius_mm = 3.0\n[load]\nkind = "contact"\nfriction = 0.0\n'
    assert Scene.parse(text) == Scene.parse(text.replace("friction = 0.0\n", ""))
    with pytest.raises(SceneError, match=r"load\.friction"):
        Scene.parse(text.replace("friction = 0.0", "friction = 0.1"))
