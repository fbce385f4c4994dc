"""Changes of scenes by key: what each spelling means, what is left behind, and what is no key."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.change import spelled
from pvdf_fem.scene.scene import Film, Load, Replaced
from pvdf_fem.scene.shapes import LAYOUTS
from pvdf_fem.sweeps.grid import Grid
from tests.helpers.refusals import keys, refused

TRIANGLE = Scene.example("triangle")
LISTED = Scene().with_(
    electrodes=[{"name": f"E{i}", "x_mm": 9.0 * i, "y_mm": 0.0} for i in (1, -1)]
)
Squares = LAYOUTS["square"]
TIGHT = Scene().with_(**{"film.pretension_N_m": 9})
SMALL = TIGHT.with_(**{"film.radius_mm": 30.0})
SPHERE = Scene().with_(probe={"shape": "sphere", "radius_mm": 5}, load={"kind": "contact"})


def test_with_changes_dotted_keys_and_leaves_the_scene_alone():
    scene = Scene()
    changes = {"load.force_N": 2, "film.radius_mm": np.float64(40), "probe.x_mm": 1}
    for other in (scene.with_(**changes), scene.with_(changes)):
        assert (other.load.force, other.film.radius) == (2.0, 0.04)
        assert (other.probe.shape, other.probe.x_mm) == ("triangle", 1.0)
    assert scene == Scene()
    with pytest.raises(AttributeError, match=r"Scene\.with_"):
        scene.film.thickness_um = 25.0


@pytest.mark.parametrize("key", ["electrodes[1].x_mm", "electrodes.1.x_mm", "electrodes[01].x_mm"])
def test_every_spelling_of_a_key_means_the_same(key):
    assert spelled(key) == "electrodes[1].x_mm"
    assert LISTED.with_(**{key: np.int64(-8)}).electrodes[1].x_mm == -8.0
    if key != "electrodes[1].x_mm":
        assert keys(refused(LISTED.with_, {"electrodes[1].x_mm": -8.0, key: 1})) == [key]


@pytest.mark.parametrize("scene", [Scene(), LISTED])
@pytest.mark.parametrize(
    "key",
    [
        *("electrodes.E1.x_mm", "electrodes.\u0661.x_mm", "electrodes.-1.x_mm"),
        *("electrodes.2.x_mm", "electrodes.2", "electrodes.-1"),
        *("", ".", "film..radius_mm", "film[radius_mm]", "electrodes[1.x_mm", "electrodes]1[.x_mm"),
    ],
)
def test_what_is_no_key_is_refused(key, scene):
    assert f"{key or EMPTY} = 8.0" in refused(scene.with_, {key: 8.0})


EMPTY = '""'


def test_with_reports_all_mistakes():
    changes = {"load.force": 2, "film.radius_mm.x": 1, "electrodes.0.x_mm": 1, "probe.side_mm": -1}
    assert set(keys(refused(Scene().with_, {**changes, "": 1}))) == {*changes, EMPTY}


def test_sections_are_replaced_removed_and_merged():
    assert TRIANGLE.with_(probe=None) == Scene()
    assert Scene().with_(probe=TRIANGLE.probe) == TRIANGLE
    assert SMALL.with_(film={"thickness_um": 12}) == SMALL.with_(**{"film.thickness_um": 12})
    grid = Grid.of(SMALL, [{"film": [{"thickness_um": 9}, {"thickness_um": 12}]}])
    assert [scene.film.radius_mm for scene in grid.scenes()] == [30.0, 30.0]
    assert Scene().with_(stage={}).stage is not None
    thin = Scene().with_(**{"film.thickness_um": 12})
    assert SMALL.with_(film=Replaced(thickness_um=12)) == thin
    assert SMALL.with_(film=Film(thickness_um=12)) == thin
    assert SMALL.with_(film=Replaced()) == Scene()
    assert LISTED.with_(electrodes={"layout": "three"}).electrodes == Squares(layout="three")


def test_a_new_shape_drops_the_sizes_of_the_old_one():
    for changes in ({"probe.radius_mm": 2.0}, {}):
        probe = TRIANGLE.with_(**changes, **{"probe.shape": "circle"}).probe
        assert probe.outline.radius == changes.get("probe.radius_mm", 1.0) / 1e3
        assert (probe.x_mm, probe.y_mm) == (5.0714, 0.8757)
    disc = Scene().with_(probe={"shape": "circle", "radius_mm": 2.0, "x_mm": 4.0})
    square = disc.with_(probe={"shape": "rectangle"})
    assert square == disc.with_(**{"probe.shape": "rectangle"})
    assert square.probe.x_mm == 4.0


def test_another_kind_of_load_drops_the_contact():
    stuck = Scene().with_(load={"kind": "rigid", "contact": "stuck"})
    assert stuck.with_(**{"load.kind": "dead"}) == stuck.with_(load={"kind": "dead"}) == Scene()
    assert Scene().with_(**{"load.kind": "rigid"}).load.contact == "sliding"
    told = refused(stuck.with_, {"load.kind": "dead", "load.contact": "stuck"})
    assert told == ['load.contact = "stuck"']
    pair = Scene().with_(probe=[{"x_mm": 9.0}, {"x_mm": -9.0, "load": {"kind": "rigid"}}])
    changed = pair.with_(**{"probe[1]": {"load": {"force_N": 0.2}, "y_mm": 1.0}})
    assert changed == pair.with_(**{"probe[1].force_N": 0.2, "probe[1].y_mm": 1.0})


def test_pretension_and_temperature_take_each_others_place():
    assert (TIGHT.film.pretension_N_m, TIGHT.film.temperature_change_K) == (9.0, None)
    for change in ({"film.temperature_change_K": -2}, {"film": {"temperature_change_K": -2}}):
        cooled = TIGHT.with_(**change)
        assert (cooled.film.pretension_N_m, cooled.film.temperature_change_K) == (None, -2.0)
    assert TIGHT.with_(**{"film.pretension_N_m": None}) == Scene()
    assert TIGHT.with_(**{"film.temperature_change_K": None}) == TIGHT
    pair = TIGHT.with_(**{"film.pretension_N_m": [9, 8]})
    for key in ("film.pretension_N_m.1", "film.pretension_N_m[1]"):
        assert pair.with_(**{key: -4}).film.pretension_N_m == (9.0, -4.0)
    for scene, absent in ((pair, "temperature"), (Scene(), "pretension")):
        assert absent not in scene.to_toml()
        assert Scene.parse(scene.to_toml()) == scene


def test_layouts_change_into_rings_and_back():
    changes = {"electrodes.radius_mm": 1.5, "electrodes.shape": "circle", "electrodes.count": 3}
    circles = Scene().with_(**changes, **{"electrodes.layout": "ring"})
    assert {e.radius_mm for e in circles.electrode_list} == {1.5}
    more = circles.with_(**{"electrodes.count": 5, "electrodes.centre": True})
    assert [e.name for e in more.electrode_list] == ["A", "B", "C", "D", "E", "F"]
    squares = more.with_(**{"electrodes.shape": "square", "electrodes.ring_radius_mm": 12})
    assert (squares.electrodes.count, squares.electrode_list[0].side_mm) == (5, 3.0)
    assert squares.with_(**{"electrodes.layout": "four"}).electrodes == Squares(ring_radius_mm=12.0)
    assert circles.with_(electrodes={"layout": "three"}).electrodes == Squares(layout="three")
    ellipses = {"layout": "ring", "shape": "ellipse", "semi_axes_mm": [2, 1]}
    ring = Scene().with_(electrodes=ellipses)
    assert ring.with_(**{"electrodes.semi_axes_mm[1]": 3}).electrodes.semi_axes_mm == (2.0, 3.0)


@pytest.mark.parametrize(
    ("one", "other", "named"),
    [
        ({"load.force_N": 0.5}, {"load.depth_mm": 2.0}, "load.force_N"),
        ({"load": {"force_N": 0.5}}, {"load.depth_mm": 2.0}, "load.force_N"),
        ({"load.force_N": 0.5}, {"load": {"force_N": 0.6}}, "load.force_N"),
        ({"film.radius_mm": 40.0}, {"film": {"radius_mm": 30.0}}, "film.radius_mm"),
        (
            {"film": {"pretension_N_m": 9}},
            {"film.temperature_change_K": -2},
            "film.temperature_change_K",
        ),
    ],
)
def test_rivals_that_are_changed_together_are_refused(one, other, named):
    for changes in ({**one, **other}, {**other, **one}):
        assert keys(refused(SPHERE.with_, changes)) == [named]
    axes = [{key: [value]} for key, value in (one | other).items()]
    if all(not isinstance(values[0], dict) for axis in axes for values in axis.values()):
        assert named in keys(refused(Grid.of(SPHERE, axes).scenes))


def test_rivals_of_a_probe_are_refused_together_and_replace_each_other():
    listed = SPHERE.with_(probe=[{"shape": "sphere", "radius_mm": 5, "force_N": 0.5}])
    deep = listed.with_(**{"probe[0].load.depth_mm": 2.0})
    assert deep.loaded_probes[0].load == Load(kind="contact", depth_mm=2.0)
    light = deep.with_(**{"probe[0].load.force_N": 0.4})
    assert light.loaded_probes[0].load == Load(kind="contact", force_N=0.4)
    both = {"probe[0].force_N": 0.4, "probe[0].load.depth_mm": 2.0}
    assert keys(refused(listed.with_, both)) == ["probe[0].force_N"]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"load.kind": ["contact", "dead"]}, {"load.depth_mm": [1.0, 2.0]}),
        ({"load.profile": ["gaussian", "uniform"]}, {"load.profile_width_mm": [1.0, 2.0]}),
        ({"probe.shape": ["sphere", "triangle"]}, {"probe.radius_mm": [4.0, 5.0]}),
    ],
)
def test_an_axis_that_another_makes_meaningless_is_refused(one, other):
    for axes in ([one, other], [other, one]):
        with pytest.raises(SceneError, match=next(iter(other)).replace(".", r"\.")):
            Grid.of(SPHERE, axes).scenes()
