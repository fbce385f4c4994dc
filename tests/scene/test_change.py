"""Keys of changes: what each of their spellings means, and which are none."""

from __future__ import annotations

import pytest

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.change import spelled
from pvdf_fem.scene.scene import Film, Load, Replaced
from pvdf_fem.scene.shapes import LAYOUTS
from pvdf_fem.sweeps.grid import Grid

LISTED = Scene().with_(
    electrodes=[{"name": f"E{i}", "x_mm": 9.0 * i, "y_mm": 0.0} for i in (1, -1)]
)
EMPTY = '""'
BY_INDEX = "electrodes are addressed by index in a list [[electrodes]], as in electrodes[0].x_mm"


@pytest.mark.parametrize("key", ["electrodes[1].x_mm", "electrodes.1.x_mm", "electrodes[01].x_mm"])
def test_every_spelling_of_a_key_means_the_same(key):
    assert spelled(key) == "electrodes[1].x_mm"
    assert LISTED.with_(**{key: -8.0}).electrodes[1].x_mm == -8.0


def test_two_spellings_of_one_key_are_refused():
    with pytest.raises(SceneError, match=r"electrodes.1.x_mm = 1: is the same key as electrodes"):
        LISTED.with_(**{"electrodes[1].x_mm": -8.0, "electrodes.1.x_mm": 1})


@pytest.mark.parametrize("scene", [Scene(), LISTED])
def test_electrodes_are_addressed_by_index(scene):
    for key in ("electrodes.E1.x_mm", "electrodes.\u0661.x_mm", "electrodes.-1.x_mm"):
        with pytest.raises(SceneError) as error:
            scene.with_(**{key: 8.0})
        assert error.value.problems == (f"{key} = 8.0: {BY_INDEX}",)


@pytest.mark.parametrize(
    "key",
    ["", ".", "film..radius_mm", "film[radius_mm]", "electrodes[1.x_mm", "electrodes]1[.x_mm"],
)
def test_what_is_no_key_is_refused(key):
    with pytest.raises(SceneError) as error:
        LISTED.with_(**{key: 8.0})
    assert error.value.problems == (
        f"{key or EMPTY} = 8.0: is no key; write one such as film.radius_mm or electrodes[0].x_mm",
    )


Squares = LAYOUTS["square"]
TIGHT = Scene().with_(**{"film.pretension_N_m": 9})


def test_pretension_and_temperature_take_each_others_place():
    assert (TIGHT.film.pretension_N_m, TIGHT.film.temperature_change_K) == (9.0, None)
    cooled = TIGHT.with_(**{"film.temperature_change_K": -2})
    assert (cooled.film.pretension_N_m, cooled.film.temperature_change_K) == (None, -2.0)
    assert TIGHT.with_(**{"film.pretension_N_m": None}) == Scene()
    assert TIGHT.with_(**{"film.temperature_change_K": None}) == TIGHT
    assert TIGHT.with_(film={"pretension_N_m": 9}) == TIGHT
    pair = TIGHT.with_(**{"film.pretension_N_m": [9, 8]})
    for key in ("film.pretension_N_m.1", "film.pretension_N_m[1]"):
        assert pair.with_(**{key: -4}).film.pretension_N_m == (9.0, -4.0)


def test_pretension_and_temperature_together_are_refused():
    with pytest.raises(SceneError) as error:
        Scene().with_(**{"film.temperature_change_K": -2, "film.pretension_N_m": 9})
    (line,) = error.value.problems
    assert line.startswith("film.temperature_change_K = -2: ")


def test_a_file_has_the_one_that_counts():
    assert "temperature" not in TIGHT.to_toml()
    assert "pretension_N_m = 9.0\n" in TIGHT.to_toml()
    assert "pretension" not in Scene().to_toml()
    pair = TIGHT.with_(**{"film.pretension_N_m": [9, 8]})
    assert "pretension_N_m = [9.0, 8.0]\n" in pair.to_toml()
    assert Scene.parse(pair.to_toml()) == pair


def test_layouts_change_into_rings_and_back():
    changes = {"electrodes.radius_mm": 1.5, "electrodes.shape": "circle", "electrodes.count": 3}
    circles = Scene().with_(**changes, **{"electrodes.layout": "ring"})
    assert [e.name for e in circles.electrode_list] == ["A", "B", "C"]
    assert {e.radius_mm for e in circles.electrode_list} == {1.5}
    more = circles.with_(**{"electrodes.count": 5, "electrodes.centre": True})
    assert [e.name for e in more.electrode_list] == ["A", "B", "C", "D", "E", "F"]
    squares = more.with_(**{"electrodes.shape": "square", "electrodes.ring_radius_mm": 12})
    assert (squares.electrodes.count, squares.electrode_list[0].side_mm) == (5, 3.0)
    assert squares.with_(**{"electrodes.layout": "four"}).electrodes == Squares(ring_radius_mm=12.0)
    three = circles.with_(**{"electrodes.layout": "three", "electrodes.side_mm": 2})
    assert three.electrodes == Squares(layout="three", side_mm=2.0)


def test_numbers_of_a_ring_are_reached():
    changes = {"layout": "ring", "shape": "ellipse", "semi_axes_mm": [2, 1]}
    ring = Scene().with_(electrodes=changes)
    for key in ("electrodes.semi_axes_mm.1", "electrodes.semi_axes_mm[1]"):
        assert ring.with_(**{key: 3}).electrodes.semi_axes_mm == (2.0, 3.0)
    with pytest.raises(SceneError, match="electrodes are addressed by index"):
        ring.with_(**{"electrodes.0.x_mm": 3})


SMALL = Scene().with_(**{"film.radius_mm": 30.0, "film.pretension_N_m": 9})


def test_tables_are_merged():
    assert SMALL.with_(film={"thickness_um": 12}) == SMALL.with_(**{"film.thickness_um": 12})
    cooled = SMALL.with_(film={"temperature_change_K": -2})
    assert (cooled.film.radius_mm, cooled.film.pretension_N_m) == (30.0, None)
    grid = Grid.of(SMALL, [{"film": [{"thickness_um": 9}, {"thickness_um": 12}]}])
    assert [scene.film.radius_mm for scene in grid.scenes()] == [30.0, 30.0]
    read = Scene().with_(readout={"gain": {"A": 2.0}}).with_(readout={"gain": {"B": 3.0}})
    assert read.readout.gain == {"A": 2.0, "B": 3.0}
    assert Scene().with_(stage={}).stage is not None


def test_a_merged_table_leaves_behind_what_keys_do():
    disc = Scene().with_(probe={"shape": "circle", "radius_mm": 2.0, "x_mm": 4.0})
    square = disc.with_(probe={"shape": "rectangle"})
    assert square == disc.with_(**{"probe.shape": "rectangle"})
    assert square.probe.x_mm == 4.0
    ring = Scene().with_(electrodes={"layout": "ring", "shape": "circle", "radius_mm": 1.5})
    assert ring.with_(electrodes={"layout": "three"}).electrodes == Squares(layout="three")
    stuck = disc.with_(load={"kind": "rigid", "contact": "stuck", "force_N": 0.3})
    assert stuck.with_(load={"kind": "dead"}).load == Load(force_N=0.3)
    pair = Scene().with_(probe=[{"x_mm": 9.0}, {"x_mm": -9.0, "load": {"kind": "rigid"}}])
    changed = pair.with_(**{"probe[1]": {"load": {"force_N": 0.2}, "y_mm": 1.0}})
    assert changed == pair.with_(**{"probe[1].force_N": 0.2, "probe[1].y_mm": 1.0})


def test_replacing_has_a_name_of_its_own():
    thin = Scene().with_(**{"film.thickness_um": 12})
    assert SMALL.with_(film=Replaced(thickness_um=12)) == thin
    assert SMALL.with_(film=Film(thickness_um=12)) == thin
    assert SMALL.with_(film=Replaced()) == Scene()
    assert LISTED.with_(electrodes={"layout": "three"}).electrodes == Squares(layout="three")


SPHERE = Scene().with_(probe={"shape": "sphere", "radius_mm": 5}, load={"kind": "contact"})


@pytest.mark.parametrize(
    ("one", "other", "named"),
    [
        ({"load.force_N": 0.5}, {"load.depth_mm": 2.0}, "load.force_N"),
        ({"load": {"force_N": 0.5}}, {"load.depth_mm": 2.0}, "load.force_N"),
        ({"load.force_N": 0.5}, {"load": {"force_N": 0.6}}, "load.force_N"),
        ({"film.radius_mm": 40.0}, {"film": {"radius_mm": 30.0}}, "film.radius_mm"),
        ({"film": {"pretension_N_m": 9}}, {"film.temperature_change_K": -2}, "film.temperature"),
    ],
)
def test_rivals_that_are_changed_together_are_refused(one, other, named):
    for changes in ({**one, **other}, {**other, **one}):
        with pytest.raises(SceneError, match=named.replace(".", r"\.")):
            SPHERE.with_(**changes)
    axes = [{key: [value]} for key, value in (one | other).items()]
    if all(not isinstance(values[0], dict) for axis in axes for values in axis.values()):
        with pytest.raises(SceneError, match=named.replace(".", r"\.")):
            Grid.of(SPHERE, axes).scenes()


def test_rivals_of_a_probe_are_refused_together_and_replace_each_other():
    listed = SPHERE.with_(probe=[{"shape": "sphere", "radius_mm": 5, "force_N": 0.5}])
    deep = listed.with_(**{"probe[0].load.depth_mm": 2.0})
    assert deep.loaded_probes[0].load == Load(kind="contact", depth_mm=2.0)
    light = deep.with_(**{"probe[0].load.force_N": 0.4})
    assert light.loaded_probes[0].load == Load(kind="contact", force_N=0.4)
    both = {"probe[0].force_N": 0.4, "probe[0].load.depth_mm": 2.0}
    with pytest.raises(SceneError, match=r"probe\[0\]\.force_N"):
        listed.with_(**both)
    with pytest.raises(SceneError, match=r"probe\[0\]\.force_N"):
        Grid.of(listed, [{key: [value]} for key, value in both.items()]).scenes()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"load.kind": ["contact", "dead"]}, {"load.depth_mm": [1.0, 2.0]}),
        ({"load.profile": ["gaussian", "uniform"]}, {"load.profile_width_mm": [1.0, 2.0]}),
        ({"probe.shape": ["sphere", "triangle"]}, {"probe.radius_mm": [4.0, 5.0]}),
    ],
)
def test_an_axis_that_another_makes_meaningless_is_refused(one, other):
    (key,) = other
    for axes in ([one, other], [other, one]):
        with pytest.raises(SceneError, match=key.replace(".", r"\.")):
            Grid.of(SPHERE, axes).scenes()


def test_another_kind_of_readout_leaves_the_keys_of_the_old_kind_behind():
    charge = Scene().with_(readout={"feedback_capacitance_pF": 500.0, "gain": 2.0})
    voltage = charge.with_(readout={"kind": "voltage", "cable_capacitance_pF": 30.0})
    assert voltage == charge.with_(**{"readout.kind": "voltage"}).with_(
        **{"readout.cable_capacitance_pF": 30.0}
    )
    assert voltage.readout.gain == 2.0
    by_channel = charge.with_(**{"readout.kind": {"A": "charge"}})
    assert by_channel.readout.feedback_capacitance_pF == 500.0
