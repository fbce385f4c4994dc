"""Every table of a scene with a value for each key, and strategies, from the registry."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

from hypothesis import strategies as st

from pvdf_fem.scene.changes import to_plain_value
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.load import Load, LoadOverrides
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.scene import Numerics
from pvdf_fem.scene.scene_file import format_toml
from pvdf_fem.scene.validation.table_forms import TABLES as SCENE_TABLES
from pvdf_fem.scene.validation.table_forms import TableForm, list_forms

Tables = dict[str, Any]

#: Tables of a scene by their place, in each of their shapes.
TABLES: list[tuple[str, TableForm]] = [
    (place, form)
    for place, table in {**SCENE_TABLES, "numerics": Numerics}.items()
    for form in list_forms(table)
]
#: Values of required keys, small enough for electrodes side by side.
GIVEN = {"x_mm": 0.0, "y_mm": 0.0, "radius_mm": 1.0, "width_mm": 3.0, "height_mm": 2.0}
GIVEN["side_mm"] = 3.0


def example(form: TableForm, name: str) -> Any:
    """A value that a key takes: its default, or else its example."""
    form = TableForm(Load) if form.table is LoadOverrides else form
    field = form.fields[name]
    default = None if field.is_required() else field.default
    if default is None:
        usual = form.key_of(name).example
        default = usual if form.table is Film else GIVEN.get(name, usual)
    return to_plain_value(default)


def table_of(form: TableForm, *names: str) -> Tables:
    """The smallest table with some keys: they, what they need, and what is required."""
    fields = form.fields
    required = [name for name in fields if fields[name].is_required() or name == "shape"]
    if form.table is Patch:
        required.append("thickness_um")  # a patch is a layer or a backing
    table: Tables = {}

    def add(name: str, value: Any) -> None:
        table[name] = value
        key, needed = form.key_of(name).needs or ("", None)
        if key in fields:
            add(key, needed or example(form, key))

    for name in (*names, *required):
        add(name, example(form, name))
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


def values(form: TableForm, name: str) -> st.SearchStrategy[Any]:
    """Valid values of a key by itself."""
    key, value = form.key_of(name), example(form, name)
    words = [*key.words] or words_of(form.fields[name].annotation)
    if isinstance(value, bool):
        return st.sampled_from([True, False, *words])
    if words:
        return st.sampled_from(words)
    if isinstance(value, int):
        return st.integers(value // 2 + 1, 2 * value)
    if isinstance(value, float):
        low, high = key.limits or (-3.0, 3.0)
        numbers = st.floats(0.5, 2.0).map(lambda factor: factor * value)
        numbers = numbers if value else st.floats(-3.0, 3.0)
        return numbers.map(lambda number: min(max(number, low), high))
    return st.just(value)


@st.composite
def rows(draw: st.DrawFn, form: TableForm) -> Tables:
    """A table with some of its keys, beside what these need."""
    known = [name for name in form.fields if example(form, name) is not None]
    names = draw(st.lists(st.sampled_from(known), max_size=4, unique=True))
    table = table_of(form, *names)
    deciders = {(form.key_of(name).needs or ("",))[0] for name in table} | {"shape", "name"}
    return table | {n: draw(values(form, n)) for n in names if n not in deciders}


@st.composite
def tables(draw: st.DrawFn) -> Tables:
    """Tables of a scene; each value is valid by itself."""
    scene: Tables = {}
    places = st.floats(-15.0, 15.0)
    for where, form in draw(st.lists(st.sampled_from(TABLES), min_size=1, max_size=5)):
        section, _, inner = where.removesuffix("[0]").partition(".")
        row = draw(rows(form))
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
