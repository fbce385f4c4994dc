"""Changes of scenes by key: what each spelling means, what is left behind, and what is no key."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.scene.changes import normalize_key
from pvdf_fem.scene.placed.probe import Probe
from pvdf_fem.scene.registry import FLAT_SHAPES
from pvdf_fem.scene.scene import Film, Replaced
from pvdf_fem.scene.scene_file import parse_change
from pvdf_fem.scene.validation.table_forms import TableForm
from pvdf_fem.studies.scene_grid import SceneGrid
from tests.helpers.refusals import keys, refused
from tests.helpers.strategies import TABLES, placed, table_of

TRIANGLE = Scene.example("triangle")
LISTED = Scene().with_(
    electrodes=[{"name": f"E{i}", "x_mm": 9.0 * i, "y_mm": 0.0} for i in (1, -1)]
)
TIGHT = Scene().with_(**{"film.pretension_N_m": 9})
SPHERE = Scene().with_(probe={"shape": "sphere", "radius_mm": 5}, load={"kind": "contact"})
COOLING, EMPTY = "film.temperature_change_K", '""'


def test_with_changes_keys_and_does_not_change_the_scene():
    scene = Scene()
    changes = {"load.force_N": 2, "film.radius_mm": np.float64(40), "probe.x_mm": 1}
    for other in (scene.with_(**changes), scene.with_(changes)):
        assert (other.load.force, other.film.radius) == (2.0, 0.04)
        assert (other.probe.shape, other.probe.x_mm) == ("triangle", 1.0)
    assert scene == Scene()


@pytest.mark.parametrize("key", ["electrodes[1].x_mm", "electrodes.1.x_mm", "electrodes[01].x_mm"])
def test_spellings_of_a_key_are_equal(key):
    assert normalize_key(key) == "electrodes[1].x_mm"
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
def test_invalid_keys_are_refused(key, scene):
    assert f"{key or EMPTY} = 8.0" in refused(scene.with_, {key: 8.0})


@pytest.mark.parametrize(
    ("text", "change"),
    [
        ("load.force_N=2", ("load.force_N", 2)),
        (" load.kind = rigid ", ("load.kind", "rigid")),
        ("film.pretension_N_m=[9, 8]", ("film.pretension_N_m", [9, 8])),
        ('electrodes[0].name="a=b"', ("electrodes[0].name", "a=b")),
        ("electrodes.drawing=../pads-2.dxf", ("electrodes.drawing", "../pads-2.dxf")),
        *((text, None) for text in ("load.force_N", "=2", "load.force_N=", "load.force_N=2 N")),
        *((text, None) for text in ("film.radius_mm=.5.", "film.radius_mm=[9", "load.kind=a=b")),
    ],
)
def test_a_change_is_parsed_into_key_and_value(text, change):
    if change:
        assert parse_change(text) == change
    else:
        assert refused(parse_change, text) == [text]


def test_sections_are_replaced_removed_and_merged():
    small = TIGHT.with_(**{"film.radius_mm": 30.0})
    assert TRIANGLE.with_(probe=None) == Scene()
    assert Scene().with_(probe=TRIANGLE.probe) == TRIANGLE
    assert small.with_(film={"thickness_um": 12}) == small.with_(**{"film.thickness_um": 12})
    grid = SceneGrid.from_tables(small, [{"film": [{"thickness_um": 9}, {"thickness_um": 12}]}])
    assert [scene.film.radius_mm for scene in grid.scenes()] == [30.0, 30.0]
    assert Scene().with_(stage={}).stage is not None
    thin = Scene().with_(**{"film.thickness_um": 12})
    for film in (Replaced(thickness_um=12), Film(thickness_um=12)):
        assert small.with_(film=film) == thin
    three = {"layout": "three"}
    assert LISTED.with_(electrodes=three) == Scene(electrodes=three)
    channels = Scene().with_(readout={"gain": {"A": 1.02}}).with_(**{"readout.gain.C": 2.0})
    assert channels.readout.gain == {"A": 1.02, "C": 2.0}


@pytest.mark.parametrize(("old", "new"), [*itertools.permutations(FLAT_SHAPES, 2)])
def test_a_new_shape_keeps_the_place_and_drops_the_sizes_of_the_old_one(old, new):
    before, sizes = (
        table_of(TableForm(Probe, FLAT_SHAPES[name]), *FLAT_SHAPES[name].list_sizes())
        for name in (old, new)
    )
    scene = Scene(probe={**before, "x_mm": 4.0})
    changed = scene.with_(**{f"probe.{key}": value for key, value in sizes.items()})
    assert changed == scene.with_(probe=sizes) == Scene(probe={**sizes, "x_mm": 4.0})


@pytest.mark.parametrize(
    ("where", "key", "old", "new"),
    [
        ("load", "kind", "rigid", "dead"),
        ("load", "kind", "contact", "follower"),
        ("load", "profile", "gaussian", "uniform"),
        ("readout", "kind", "charge", "voltage"),
        ("readout", "kind", "voltage", "charge"),
        ("electrodes", "layout", "ring", "four"),
        ("probe[0].load", "kind", "rigid", "dead"),
    ],
)
def test_a_new_value_removes_the_keys_that_need_the_old_one(where, key, old, new):
    form = next(form for place, form in TABLES if place == where)
    names = [name for name in form.fields if form.key_of(name).needs == (key, old)]
    table = table_of(form, *names)
    rest = {name: value for name, value in table.items() if name not in names} | {key: new}
    changed = Scene(**placed(where, table)).with_(**{f"{where}.{key}": new})
    assert names
    assert changed == Scene(**placed(where, rest))
    kept = refused(Scene(**placed(where, table)).with_, placed(where, table | {key: new}))
    assert set(keys(kept)) <= {f"{where}.{name}" for name in names}


def test_a_kind_without_a_profile_removes_its_width_too():
    wide = Scene(load={"profile": "gaussian", "profile_width_mm": 2.0})
    assert wide.with_(**{"load.kind": "follower"}) == Scene(load={"kind": "follower"})
    by_channel = Scene(readout={"feedback_capacitance_pF": 500.0})
    by_channel = by_channel.with_(**{"readout.kind": {"A": "charge"}})
    assert by_channel.readout.feedback_capacitance_pF == 500.0


def test_pretension_and_temperature_replace_each_other():
    assert (TIGHT.film.pretension_N_m, TIGHT.film.temperature_change_K) == (9.0, None)
    for change in ({COOLING: -2}, {"film": {"temperature_change_K": -2}}):
        assert TIGHT.with_(**change) == Scene(film={"temperature_change_K": -2.0})
    assert TIGHT.with_(**{"film.pretension_N_m": None}) == Scene()
    assert TIGHT.with_(**{COOLING: None}) == TIGHT
    pair = TIGHT.with_(**{"film.pretension_N_m": [9, 8]}).with_(**{"film.pretension_N_m.1": -4})
    assert pair.film.pretension_N_m == (9.0, -4.0)


@pytest.mark.parametrize(
    ("one", "other", "named"),
    [
        ({"load.force_N": 0.5}, {"load.depth_mm": 2.0}, "load.force_N"),
        ({"load.force_N": 0.5}, {"load": {"force_N": 0.6}}, "load.force_N"),
        ({"film": {"pretension_N_m": 9}}, {COOLING: -2}, COOLING),
    ],
)
def test_alternative_keys_are_not_changed_together(one, other, named):
    for changes in ({**one, **other}, {**other, **one}):
        assert keys(refused(SPHERE.with_, changes)) == [named]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"load.kind": ["contact", "dead"]}, {"load.depth_mm": [1.0, 2.0]}),
        ({"load.profile": ["gaussian", "uniform"]}, {"load.profile_width_mm": [1.0, 2.0]}),
        ({"probe.shape": ["sphere", "triangle"]}, {"probe.radius_mm": [4.0, 5.0]}),
        ({"load.depth_mm": [1.0]}, {"load.force_N": [0.5]}),
    ],
)
def test_an_axis_without_effect_beside_another_is_refused(one, other):
    for axes in ([one, other], [other, one]):
        assert next(iter(other)) in keys(refused(SceneGrid.from_tables(SPHERE, axes).scenes))
