"""Every key of a scene file, from the code: the page of the guide, and the example with all keys.

``python -m reports.guide.scene_keys`` writes the example, ``geometry/four_electrodes.toml``, which
``pvdf-fem keys`` and ``pvdf-fem --help`` read.
"""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pvdf_fem.scene.changes import to_plain_value
from pvdf_fem.scene.film import Air, Film
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.registry import Load
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.scene.scene_file import format_toml_value, get_example_text, read_examples
from pvdf_fem.scene.shapes import ELECTRODES, LAYOUTS, PATCHES, PROBES, Bonded, Layout, Pressing
from pvdf_fem.scene.stage import ResponseDomain, Stage

EXAMPLE = Path(__file__).parents[2] / "geometry" / "four_electrodes.toml"
#: Tables of a scene file and their models; shapes of one kind stand side by side.
TABLES: Mapping[str, tuple[type[Section], ...]] = {
    "[film]": (Film,),
    "[electrodes]": tuple(LAYOUTS.values()),
    "[[electrodes]]": tuple(ELECTRODES.values()),
    "[probe]": tuple(PROBES.values()),
    "[[probe]], besides the keys of [probe]": (Pressing,),
    "[[film.patches]]": tuple(PATCHES.values()),
    "[load]": (Load,),
    "[numerics]": (Numerics,),
    "[readout]": (Readout,),
    "[stage]": (Stage,),
    "[air]": (Air,),
    "[model]": (ResponseDomain,),
}
#: What tables of several shapes are, in the example.
ABOUT = {
    "[[film.patches]]": inspect.cleandoc(Bonded.__doc__ or ""),
    "[electrodes]": inspect.cleandoc(Layout.__doc__ or ""),
    "[[electrodes]]": "In place of the layout, any electrodes; they may touch, but not overlap.",
    "[probe]": "What presses on the film; without this table nothing does.",
}
UNCERTAIN = (
    "Standard deviations of numbers of the scene by their keys, in the key's unit or as shares of "
    "the number: `pvdf-fem solve` tells what they make of each charge."
)
HEAD = """\
# The sensor with four electrodes, without a probe: the film under its pretension only.
# Copy, keep what you change, delete the rest: every key has the value below as its default. Lines
# that begin with # and a key are tables and keys which this sensor has not, each with an example.
"""


@cache
def _texts(model: type[Section]) -> dict[str, str]:
    """The texts below the fields of a class in its source; none of a class that has no source."""
    try:
        source = textwrap.dedent(inspect.getsource(model))
    except OSError:
        return {}
    [table] = ast.parse(source).body
    found, body = {}, getattr(table, "body", [])
    hidden = (node.orelse for node in body if isinstance(node, ast.If))  # from type checkers
    for field, text in pairwise(chain(body, *hidden)):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str() as said)):
                found[name] = " ".join(said.split())
    return found


def meaning(model: type[Section], name: str) -> str:
    """What a key of a table means; empty where that is not said."""
    said = (_texts(table).get(name, "") for table in _tables(model))
    return next(filter(None, said), "")


def _tables(model: type[Section]) -> list[type[Section]]:
    """The tables from which a table has its keys; a ring has sizes from its electrodes."""
    ring = [ELECTRODES[model.model_fields["shape"].default]] if issubclass(model, Layout) else []
    parents = (table for one in (model, *ring) for table in one.__mro__)
    return [table for table in parents if issubclass(table, Section)]


def condition(model: type[Section], name: str) -> str:
    """What another key has to be for a key, and the range of its numbers."""
    key = model.key_of(name)
    needed, value = key.needs or ("", None)
    needs = f'Of {needed} = "{value}" only. ' if value else f"With {needed} only. " * bool(needed)
    if key.within is None:
        return needs.rstrip()
    return f"{needs}{key.within[0]:g} to {key.within[1]:g} {key.unit}".rstrip() + "."


def groups(models: Sequence[type[Section]]) -> Iterator[tuple[str, type[Section], list[str]]]:
    """Keys of a table by a caption and a model: all keys of one model, or the keys that models of
    shapes share, and then for each shape the keys of its own."""
    first, *others = models
    if not others:
        yield "", first, list(first.model_fields)
        return
    shared = [key for key in first.model_fields if all(key in m.model_fields for m in others)]
    yield "", first, shared
    for model in models:
        caption = f'shape = "{model.model_fields["shape"].default}": {cleaned(model.__doc__)}'
        yield caption, model, [key for key in model.model_fields if key not in shared]


def commented_scene() -> str:
    """The example scene with every key, its meaning, range, and default or example."""
    blocks, told = [HEAD], set()
    for heading, models in TABLES.items():
        table, _, more = heading.partition(", ")
        field = Scene.model_fields.get(table.strip("[]"))
        used = table[1] != "[" and field is not None and field.default is not None
        about = cleaned(models[0].__doc__) if len(models) == 1 else ABOUT[table]
        lines = [*_comment(": ".join(filter(None, [more, about]))), table if used else f"#{table}"]
        for caption, model, keys in groups(models):
            if caption in told:
                continue
            lines += _comment(caption)
            given = used and model is models[0]
            lines += [line for key in keys for line in _entry(model, key, given)]
            told |= {caption} - {""}
        blocks.append("\n".join(lines) + "\n")
    blocks.append(
        "\n".join([*_comment(UNCERTAIN), "#[uncertain]", '#"film.thickness_um" = "5 %"\n'])
    )
    return "\n".join(blocks)


def _entry(model: type[Section], name: str, used: bool) -> list[str]:
    """A key with its comment; as a comment too, where the table or the key has no value."""
    default = _default(model, name)
    value = model.key_of(name).example if default is None else default
    if value is None:
        fields = (table.model_fields.get(name) for table in _tables(model))
        value = next((f.default for f in fields if f and not f.is_required()), None)
    if value is None:  # a list of tables, which has a heading of its own
        return []
    mark = "" if used and default is not None else "#"
    lines = _comment(f"{meaning(model, name)} {condition(model, name)}")
    return [*lines, f"{mark}{name} = {format_toml_value(to_plain_value(value))}"]


def _default(model: type[Section], name: str) -> Any:
    """The default of a key; None for a key that is needed, or not given."""
    field = model.model_fields[name]
    return None if field.is_required() else field.get_default(call_default_factory=True)


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, 98, initial_indent="# ", subsequent_indent="# ")


def scene_page() -> str:
    """Every table of a scene file with its keys, defaults, ranges and meanings."""
    lines = [
        "# Scene files",
        "A scene is a TOML file of these tables. Every key has a default unless it is marked as",
        "needed, and the units are in the keys' names. `pvdf-fem keys` prints the scene at the end",
        "of this page, and `pvdf-fem keys WORD` what the scene has of a word.",
        "",
        cleaned(Scene.__doc__),
    ]
    for heading, models in TABLES.items():
        lines += ["", f"## `{heading}`", ""]
        lines += [cleaned(models[0].__doc__) if len(models) == 1 else ABOUT[heading], ""]
        for caption, model, keys in groups(models):
            shape, _, about = caption.partition(": ")
            lines += ["", f"`{shape}`: {about}", ""] if caption else []
            lines += table_of(model, keys)
    lines += ["", "## `[uncertain]`", "", UNCERTAIN]
    commented = get_example_text("four_electrodes", read_examples()).rstrip()
    lines += ["", "## A scene with every key", "", "```toml", commented, "```"]
    return "\n".join(lines) + "\n"


def cleaned(doc: str | None) -> str:
    """A docstring without examples as Markdown: double backticks are single ones."""
    return inspect.cleandoc(doc or "").partition("\n\nExamples\n")[0].replace("``", "`")


def table_of(model: type[Section], keys: Iterable[str]) -> list[str]:
    """A table of keys: default, values, and meaning where it is said."""
    lines = ["| key | default | values | meaning |", "| --- | --- | --- | --- |"]
    for key in keys:
        field, said = model.model_fields[key], model.key_of(key)
        default = "needed" if field.is_required() else _written(_default(model, key))
        needs = condition(model, key) if said.needs else ""
        about = f"{meaning(model, key)} {needs.partition('. ')[0]}".strip()
        values = _values(field.annotation, said)
        lines += [f"| `{key}` | {default} | {values} | {about.replace('|', chr(92) + '|')} |"]
    return lines


def _written(value: Any) -> str:
    if value is None:
        return "not given"
    if value in ((), {}):
        return "none"
    if isinstance(value, Section | tuple):
        return "the table's"
    return f"`{json.dumps(value)}`"


def _values(annotation: Any, key: Key) -> str:
    """What a type takes, in words; `key` has the range of its numbers."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if key.words:
        return ", ".join(map(_written, key.words))
    if origin is Annotated:
        return _values(arguments[0], next((k for k in arguments if isinstance(k, Key)), key))
    if origin is Literal:
        return ", ".join(_written(value) for value in arguments)
    if origin in (Union, types.UnionType):
        kinds = dict.fromkeys(_values(a, key) for a in arguments if a is not type(None))
        return " or ".join(kind for kind in kinds if kind)
    if origin is tuple:
        kinds = dict.fromkeys(_values(a, key) for a in arguments if a is not Ellipsis)
        is_tables = any("Patch" in kind for kind in kinds)
        return "list of the table" if is_tables else f"list of {'; '.join(kinds)}"
    if origin is dict:
        is_number = _values(arguments[1], key) not in ("value", "list of value")
        return f"table by {'electrode' if is_number else 'key'} of {_values(arguments[1], key)}"
    if inspect.isclass(annotation) and issubclass(annotation, Section):
        return f"table {annotation.__name__}"
    if annotation in (float, int) and key.within:
        return f"{key.within[0]:g} to {key.within[1]:g} {key.unit}".rstrip()
    names = {bool: "`true`, `false`", float: "number", int: "whole number", str: "text"}
    names[Any] = "value"
    return names.get(annotation, "as said above")


if __name__ == "__main__":
    EXAMPLE.write_text(commented_scene(), "utf-8")
