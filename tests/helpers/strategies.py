"""Every table of a scene with a value for each key, and strategies, from the registry."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

from hypothesis import strategies as st

from pvdf_fem.scene.changes import to_plain_value
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.registry import Load, LoadOverrides
from pvdf_fem.scene.scene import Air, Film, Numerics, Readout, ResponseDomain, Stage
from pvdf_fem.scene.scene_file import format_toml
from pvdf_fem.scene.shapes import ELECTRODES, LAYOUTS, LISTED_PROBES, PATCHES, PROBES

Tables = dict[str, Any]

#: Tables of a scene by where they stand; those of shapes have a model for each shape.
TABLES: list[tuple[str, type[Section]]] = [
    *(("film", Film), ("load", Load), ("numerics", Numerics), ("readout", Readout)),
    *(("stage", Stage), ("air", Air), ("model", ResponseDomain), ("probe[0].load", LoadOverrides)),
    *(("electrodes", model) for model in LAYOUTS.values()),
    *(("electrodes[0]", model) for model in ELECTRODES.values()),
    *(("probe", model) for model in PROBES.values()),
    *(("probe[0]", model) for model in LISTED_PROBES.values()),
    *(("film.patches[0]", model) for model in PATCHES.values()),
]
#: Values of keys that have neither default nor example.
GIVEN = {"x_mm": 0.0, "y_mm": 0.0, "radius_mm": 1.0, "width_mm": 3.0, "height_mm": 2.0}
GIVEN["side_mm"] = 3.0


def example(model: type[Section], name: str) -> Any:
    """A value that a key takes: its default, or else its example."""
    model = Load if model is LoadOverrides else model
    field = model.model_fields[name]
    default = None if field.is_required() else field.default
    found = model.key_of(name).example if default is None else default
    return to_plain_value(GIVEN.get(name) if found is None else found)


def table_of(model: type[Section], *names: str) -> Tables:
    """The smallest table with some keys: they, what they need, and what is required."""
    fields = model.model_fields
    required = [name for name in fields if fields[name].is_required() or name == "shape"]
    table = {}
    for name in (*names, *required):
        table[name] = example(model, name)
        key, needed = model.key_of(name).needs or ("", None)
        if key in fields:
            table[key] = needed or example(model, key)
    return table


def placed(where: str, table: Tables) -> Tables:
    """The tables of a scene that has a table somewhere."""
    if where == "probe[0].load":
        return {"probe": [{"load": table}]}
    section, _, inner = where.removesuffix("[0]").partition(".")
    rows = [table] if where.endswith("[0]") else table
    return {section: {inner: rows} if inner else rows}


def words_of(annotation: Any) -> list[Any]:
    """The words of a type, wherever in it they stand."""
    inner = get_args(annotation)
    is_choice = get_origin(annotation) is Literal
    return [*inner] if is_choice else [word for part in inner for word in words_of(part)]


def values(model: type[Section], name: str) -> st.SearchStrategy[Any]:
    """Valid values of a key by itself."""
    key, value = model.key_of(name), example(model, name)
    words = [*key.words] or words_of(model.model_fields[name].annotation)
    if isinstance(value, bool):
        return st.sampled_from([True, False, *words])
    if words:
        return st.sampled_from(words)
    if isinstance(value, int):
        return st.integers(value // 2 + 1, 2 * value)
    if isinstance(value, float):
        low, high = key.within or (-3.0, 3.0)
        numbers = st.floats(0.5, 2.0).map(lambda factor: factor * value)
        numbers = numbers if value else st.floats(-3.0, 3.0)
        return numbers.map(lambda number: min(max(number, low), high))
    return st.just(value)


@st.composite
def rows(draw: st.DrawFn, model: type[Section]) -> Tables:
    """A table with some of its keys, beside what these need."""
    known = [name for name in model.model_fields if example(model, name) is not None]
    names = draw(st.lists(st.sampled_from(known), max_size=4, unique=True))
    table = table_of(model, *names)
    deciders = {(model.key_of(name).needs or ("",))[0] for name in table} | {"shape", "name"}
    return table | {n: draw(values(model, n)) for n in names if n not in deciders}


@st.composite
def tables(draw: st.DrawFn) -> Tables:
    """Tables of a scene; each value is valid by itself."""
    scene: Tables = {}
    places = st.floats(-15.0, 15.0)
    for where, model in draw(st.lists(st.sampled_from(TABLES), min_size=1, max_size=5)):
        section, _, inner = where.removesuffix("[0]").partition(".")
        row = draw(rows(model))
        if where in ("electrodes[0]", "probe[0]"):
            row |= {"x_mm": draw(places), "y_mm": draw(places)}
            before = scene.get(section)
            listed = before if isinstance(before, list) else []
            row |= {"name": "ABCDE"[len(listed)]} if section == "electrodes" else {}
            scene[section] = [*listed, row]
        elif inner:
            scene |= placed(where, row)
        else:
            scene[section] = row
    return scene


def electrode(name: str = "A", **keys: object) -> str:
    """One [[electrodes]] table as text, at the centre unless told otherwise."""
    row = {"name": name, "x_mm": 0.0, "y_mm": 0.0, **keys}
    return format_toml({"electrodes": [row]})
