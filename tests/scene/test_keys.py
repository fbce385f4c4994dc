"""Every key of every table of a scene, from the registry: what is said of it, what it refuses, and
what scenes of any keys have in common."""

from __future__ import annotations

import itertools
import json
import math
import pickle
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pvdf_fem import Scene
from pvdf_fem.scene.keys import split_unit
from pvdf_fem.scene.load import FORCE_KEYS
from pvdf_fem.scene.scene_file import flatten
from pvdf_fem.scene.validation.table_forms import TableForm
from reports.guide.scene_keys import get_meaning
from tests.helpers.damage import drawn
from tests.helpers.refusals import keys, refused, scene_or_mistakes
from tests.helpers.strategies import TABLES, example, placed, table_of, tables

each_table = pytest.mark.parametrize(("where", "form"), TABLES)


def test_each_key_has_a_meaning_a_unit_and_limits():
    for form in [TableForm(Scene), *(form for _, form in TABLES)]:
        for name, field in form.fields.items():
            key = form.key_of(name)
            assert get_meaning(form, name), (form, name)
            is_number = re.search(r"\b(float|int)\b", str(field.annotation))
            assert not is_number or key.limits, (form, name)
            assert split_unit(name)[1] in ("", key.unit), (form, name)
            assert field.default is not None or key.example is not None or not is_number


def key_in_file(where, name):
    """The key in messages: the forces of a listed probe stand beside its shape."""
    return (
        f"probe[0].{name}" if where == "probe[0].load" and name in FORCE_KEYS else f"{where}.{name}"
    )


def wrong_values(value, key):
    """Values that a key does not take."""
    if isinstance(value, list):
        return [3, *([wrong, *value[1:]] for wrong in wrong_values(value[0], key))]
    if isinstance(value, bool):
        return [1, "yes"]
    if not isinstance(value, int | float):
        return [3] if value is None else [3, "", -2]
    low, high = key.limits
    if isinstance(value, int):
        return ["2", True, value + 0.5, low - 1, high + 1, 10**400]
    ends = [math.nextafter(low, -math.inf), math.nextafter(high, math.inf)]
    return ["2", True, math.nan, math.inf, 10**400, *ends]


@each_table
def test_wrong_values_and_misspelt_keys_are_refused_by_key(where, form):
    for name in form.fields:
        table = table_of(form, name)
        for wrong in wrong_values(example(form, name), form.key_of(name)):
            [message] = keys(refused(Scene, **placed(where, {**table, name: wrong})))
            assert re.sub(r"(\[\d+\])+$", "", message) == key_in_file(where, name), wrong
        message = refused(Scene, **placed(where, {**table_of(form), f"{name}x": 1}))
        assert message == [f"{where}.{name}x = 1"]


def find_refused_keys(model, table):
    """The keys of a table that are refused."""
    try:
        model(**table)
    except ValidationError as error:
        return {details["loc"][-1] for details in error.errors()}
    return set()


#: Keys whose validators refuse the ends of the range.
NARROWER = ("poisson_ratio", "vertices_mm", "force_range_N", "edge_radius_mm", "range_V")


@each_table
def test_the_ends_of_a_range_are_valid(where, form):
    for name in form.fields:
        value, key = example(form, name), form.key_of(name)
        if key.limits is None or name in NARROWER:
            continue
        for end in key.limits:
            end = int(end) if isinstance(value, int) else end
            given = [end] * len(value) if isinstance(value, list) else end
            table = {**table_of(form, name), name: given}
            assert name not in find_refused_keys(form.table, table), end


#: Values that further keys need, and another value.
OTHERS = {"charge": "voltage", "voltage": "charge", "ring": "four", "gaussian": "uniform"}
OTHERS |= dict.fromkeys(["dead", "rigid", "contact"], "follower")
OTHERS["before stretching"] = "at rest"
#: Values that need something, where the default needs nothing.
NEEDY = {"tilt": "free", "profile": "hertz", "centre": True, "pressure_follows": True}
NEEDY |= {"cable_capacitance_pF": 30.0, "both_sides": True, "backing_one_sided": True}
NEEDY["bonded"] = "before stretching"


@each_table
def test_a_key_is_refused_without_the_key_that_it_needs(where, form):
    for name in form.fields:
        decider, needed = form.key_of(name).needs or ("", None)
        if decider not in form.fields or example(form, name) == "square":
            continue
        table = {**table_of(form, name), name: NEEDY.get(name, example(form, name))}
        table.pop(decider)
        table |= {decider: OTHERS[needed]} if needed else {}
        assert keys(refused(Scene, **placed(where, table)))[0] == key_in_file(where, name)


@pytest.mark.parametrize("where", ["film", "load", "film.patches[0]"])
def test_a_number_in_another_unit_is_warned_of_or_refused_with_a_likely_unit(where):
    form = next(form for place, form in TABLES if place == where)
    checked = []
    for name in form.fields:
        value, key = example(form, name), form.key_of(name)
        for number in (value / size for size in key.likely_units.values()):
            if key.usual_limits[0] <= abs(number) <= key.usual_limits[1]:
                continue
            tables = {"probe": {}, **placed(where, {**table_of(form, name), name: number})}
            scene = scene_or_mistakes(tables)
            message = scene.warnings if isinstance(scene, Scene) else scene
            assert any(f" {value:.3g} {key.unit} " in line for line in message), name
            checked.append(name)
    assert checked


SECTIONS = re.compile(rf"({'|'.join(Scene.model_fields)})\b")


@given(tables=tables(), data=st.data())
@drawn(1.0)
def test_a_scene_survives_round_trips_or_is_refused_by_key(tables, data):
    """From its file, as JSON, from another process, and by its keys set in any order."""
    scene = scene_or_mistakes(tables)
    if not isinstance(scene, Scene):
        assert all(SECTIONS.match(problem) for problem in scene)
        return
    pairs = flatten(scene.to_json())
    shuffled = dict(data.draw(st.permutations([*pairs.items()])))
    again = [Scene.parse(scene.to_toml()), Scene.model_validate_json(scene.model_dump_json())]
    again += [scene.with_(), pickle.loads(pickle.dumps(scene)), Scene().with_(shuffled)]
    for other in again:
        assert (other, hash(other)) == (scene, hash(scene))
        assert other.loaded_probes == scene.loaded_probes
        # tables by electrode may come in any order
        assert json.loads(other.model_dump_json()) == json.loads(scene.model_dump_json())
    assert np.linalg.eigvalsh(scene.film.stiffness).min() > 0
    outlines = [e.outline for e in scene.electrode_list]
    assert max(o.reach for o in outlines) <= scene.film.radius * (1.0 + 1e-8)
    for a, b in itertools.combinations(outlines, 2):
        # shapely's discs are inscribed polygons, so they do not overlap either
        assert a.inscribed_polygon.intersection(b.inscribed_polygon).area <= 1e-9 * min(
            a.area, b.area
        )
