"""Every key of a scene file, from the code: the page of the guide and the example with all keys.

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
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pvdf_fem.scene.air import Air
from pvdf_fem.scene.changes import to_plain_value
from pvdf_fem.scene.drawings.drawing import Drawing
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.instrument.calibration import CalibratedParameters
from pvdf_fem.scene.instrument.response_domain import ResponseDomain
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.placed.electrode import Electrode, Layout
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.placed.placed_shape import PLACEMENT_KEYS
from pvdf_fem.scene.placed.probe import ListedProbe, Probe
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.scene.scene_file import format_toml_value, get_example_text, read_examples
from pvdf_fem.scene.stage import Stage
from pvdf_fem.scene.validation.table_forms import TableForm, list_forms

EXAMPLE = Path(__file__).parents[2] / "geometry" / "four_electrodes.toml"
DRAWN_ELECTRODES = "[electrodes], in place of the layout"
LISTED_PROBE = "[[probe]], besides the keys of [probe]"
#: Tables of a scene file and their models.
MODELS: Mapping[str, type[Section]] = {
    "[film]": Film,
    "[electrodes]": Layout,
    "[[electrodes]]": Electrode,
    DRAWN_ELECTRODES: Drawing,
    "[probe]": Probe,
    LISTED_PROBE: ListedProbe,
    "[[film.patches]]": Patch,
    "[load]": Load,
    "[numerics]": Numerics,
    "[readout]": Readout,
    "[stage]": Stage,
    "[calibration]": CalibratedParameters,
    "[air]": Air,
    "[model]": ResponseDomain,
}
#: Tables of a scene file in each of their shapes; a listed probe has one form, see `_list_keys`.
TABLES: Mapping[str, list[TableForm]] = {
    heading: [TableForm(model)] if heading == LISTED_PROBE else list_forms(model)
    for heading, model in MODELS.items()
}
#: Descriptions of tables of several shapes, in the example.
ABOUT = {
    "[film]": "The film, flat and clamped along its rim, whose outline may have any flat shape; the"
    " point (x, y) of the shape is the film's centre.",
    "[[film.patches]]": inspect.cleandoc(Patch.__doc__ or ""),
    "[electrodes]": inspect.cleandoc(Layout.__doc__ or ""),
    "[[electrodes]]": "In place of the layout, any electrodes; they may touch, but not overlap.",
    "[probe]": "The probe that presses on the film; without this table nothing does.",
}
UNCERTAIN = (
    "Standard deviations of numbers of the scene by their keys, in the key's unit or as shares of "
    "the number: `pvdf-fem solve` prints the standard deviation that each charge has by them."
)
HEAD = """\
# The sensor with four electrodes, without a probe: the film under its pretension only.
# Copy, keep the keys that you change, delete the rest: every key has the value below as its
# default. Lines that begin with # and a key are tables and keys that this sensor does not have,
# each with an example.
"""


@cache
def _read_field_texts(model: type[Section]) -> dict[str, str]:
    """Read the texts below the fields of a class in its source."""
    source = textwrap.dedent(inspect.getsource(model))
    [table] = ast.parse(source).body
    assert isinstance(table, ast.ClassDef)
    texts = {}
    for field, text in pairwise(table.body):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str() as found)):
                texts[name] = " ".join(found.split())
    return texts


def get_meaning(form: TableForm, name: str) -> str:
    """Return the meaning of a key of a table; empty where its source has none."""
    for model in form.sources:
        text = _read_field_texts(model).get(name)
        if text:
            return text
    return ""


def describe_condition(form: TableForm, name: str) -> str:
    """Describe the value of another key that a key needs, and the limits of its numbers."""
    key = form.key_of(name)
    parts = []
    if key.needs is not None:
        needed, value = key.needs
        parts.append(f'Requires {needed} = "{value}".' if value else f"Requires {needed}.")
    if key.limits is not None:
        low, high = key.limits
        parts.append(f"{low:g} to {high:g} {key.unit}".rstrip() + ".")
    return " ".join(parts)


def iterate_groups(forms: Sequence[TableForm]) -> Iterator[tuple[str, TableForm, list[str]]]:
    """Yield the keys of a table in groups.

    Parameters
    ----------
    forms : sequence of TableForm
        The forms of one table.

    Yields
    ------
    str, TableForm, list of str
        A caption and the keys of one form: without a caption all keys of the only form, or the keys
        that all forms share, and then for each shape its own keys.
    """
    first, *others = forms
    if not others:
        yield "", first, list(first.fields)
        return
    shared = [key for key in first.fields if all(key in form.fields for form in others)]
    yield "", first, shared
    for form in forms:
        shape = form.fields["shape"].default
        caption = f'shape = "{shape}": {clean_docstring(form.description)}'
        yield caption, form, [key for key in form.fields if key not in shared]


def make_commented_scene() -> str:
    """Make the example scene with every key, its meaning, limits, and default or example."""
    blocks = [HEAD]
    seen_captions: set[str] = set()
    for heading, forms in TABLES.items():
        table, _, more = heading.partition(", ")
        field = Scene.model_fields.get(table.strip("[]"))
        has_default = field is not None and field.default is not None
        is_used = table[1] != "[" and has_default and not more
        about = clean_docstring(forms[0].description) if len(forms) == 1 else ABOUT[table]
        lines = _comment(f"{more}: {about}" if more else about)
        lines.append(table if is_used else f"#{table}")
        for caption, form, keys in iterate_groups(forms):
            if caption in seen_captions and form is not forms[0]:
                continue
            lines += _comment(caption)
            for key in _list_keys(heading, keys):
                entry = _make_entry(form, key, is_used=is_used and form is forms[0])
                if key == "shape":
                    entry[-1:-1] = _name_known_shapes(forms, seen_captions)
                lines += entry
            if caption:
                seen_captions.add(caption)
        blocks.append("\n".join(lines) + "\n")
    uncertain = [*_comment(UNCERTAIN), "#[uncertain]", '#"film.thickness_um" = "5 %"\n']
    blocks.append("\n".join(uncertain))
    return "\n".join(blocks)


def _name_known_shapes(forms: Sequence[TableForm], seen_captions: set[str]) -> list[str]:
    """Return a comment that names the shapes whose keys are in a table above; it may be empty."""
    names = [
        form.fields["shape"].default
        for caption, form, _ in iterate_groups(forms)
        if caption in seen_captions and form is not forms[0]
    ]
    return _comment(f"Or {', '.join(names)}, with the keys of [film].") if names else []


def _list_keys(heading: str, keys: list[str]) -> list[str]:
    """Return the keys below a heading; of a listed probe only those that others do not have."""
    if heading != LISTED_PROBE:
        return keys
    return [key for key in keys if key not in Probe.model_fields]


def _make_entry(form: TableForm, name: str, is_used: bool) -> list[str]:
    """Make a key with its comment; commented out where the scene does not have it."""
    default = _get_default(form, name)
    value = form.key_of(name).example if default is None else default
    if name in PLACEMENT_KEYS:
        value = 0.0
    if value is None:  # a list of tables, which has a heading of its own
        return []
    mark = "" if is_used and default is not None else "#"
    comment = f"{get_meaning(form, name)} {describe_condition(form, name)}"
    return [*_comment(comment), f"{mark}{name} = {format_toml_value(to_plain_value(value))}"]


def _get_default(form: TableForm, name: str) -> Any:
    """Return the default of a key; None for a key that is required, or not given."""
    field = form.fields[name]
    return None if field.is_required() else field.get_default(call_default_factory=True)


def _comment(text: str) -> list[str]:
    """Wrap a text as lines of comment."""
    return textwrap.wrap(text, 98, initial_indent="# ", subsequent_indent="# ")


def make_scene_page() -> str:
    """Make the page of every table of a scene file with its keys, defaults, limits and meanings."""
    lines = [
        "# Scene files",
        "A scene is a TOML file of these tables. Every key has a default unless it is marked as",
        "required, and the units are in the keys' names. `pvdf-fem keys` prints the scene at the",
        "end of this page, and `pvdf-fem keys WORD` only those keys that have this word.",
        "",
        clean_docstring(Scene.__doc__),
    ]
    for heading, forms in TABLES.items():
        lines += ["", f"## `{heading}`", ""]
        lines += [clean_docstring(forms[0].description) if len(forms) == 1 else ABOUT[heading], ""]
        for caption, form, keys in iterate_groups(forms):
            if caption:
                shape, _, about = caption.partition(": ")
                lines += ["", f"`{shape}`: {about}", ""]
            lines += make_key_table(form, _list_keys(heading, keys))
    lines += ["", "## `[uncertain]`", "", UNCERTAIN]
    commented = get_example_text("four_electrodes", read_examples()).rstrip()
    lines += ["", "## A scene with every key", "", "```toml", commented, "```"]
    return "\n".join(lines) + "\n"


def clean_docstring(doc: str | None) -> str:
    """Return a docstring without examples as Markdown, with single backticks."""
    return inspect.cleandoc(doc or "").partition("\n\nExamples\n")[0].replace("``", "`")


def make_key_table(form: TableForm, keys: Iterable[str]) -> list[str]:
    """Make a table of keys in Markdown: default, values, and meaning."""
    lines = ["| key | default | values | meaning |", "| --- | --- | --- | --- |"]
    for name in keys:
        field = form.fields[name]
        key = form.key_of(name)
        default = "required" if field.is_required() else _format_default(_get_default(form, name))
        about = get_meaning(form, name)
        if key.needs is not None:
            about += f" {describe_condition(form, name).partition('. ')[0]}"
        values = _describe_values(field.annotation, key)
        about = about.strip().replace("|", "\\|")
        lines.append(f"| `{name}` | {default} | {values} | {about} |")
    return lines


def _format_default(value: Any) -> str:
    if value is None:
        return "not given"
    if value in ((), {}):
        return "none"
    if isinstance(value, Section | tuple):
        return "the table's"
    return f"`{json.dumps(value)}`"


def _describe_values(annotation: Any, key: Key) -> str:
    """Describe the values of a type in words; `key` has the limits of its numbers."""
    origin = get_origin(annotation)
    arguments = get_args(annotation)
    if key.words:
        return ", ".join(map(_format_default, key.words))
    if origin is Annotated:
        marks = [mark for mark in arguments if isinstance(mark, Key)]
        return _describe_values(arguments[0], marks[0] if marks else key)
    if origin is Literal:
        return ", ".join(_format_default(value) for value in arguments)
    if origin in (Union, types.UnionType):
        kinds = [_describe_values(one, key) for one in arguments if one is not type(None)]
        return " or ".join(kind for kind in dict.fromkeys(kinds) if kind)
    if origin is tuple:
        kinds = [_describe_values(one, key) for one in arguments if one is not Ellipsis]
        if any("Patch" in kind for kind in kinds):
            return "list of the table"
        return f"list of {'; '.join(dict.fromkeys(kinds))}"
    if origin is dict:
        values = _describe_values(arguments[1], key)
        owner = "key" if values in ("value", "list of value") else "electrode"
        return f"table by {owner} of {values}"
    if inspect.isclass(annotation) and issubclass(annotation, Section):
        return f"table {annotation.__name__}"
    if annotation in (float, int) and key.limits:
        low, high = key.limits
        return f"{low:g} to {high:g} {key.unit}".rstrip()
    names = {bool: "`true`, `false`", float: "number", int: "whole number", str: "text"}
    names[Any] = "value"
    return names.get(annotation, "as described above")


if __name__ == "__main__":
    EXAMPLE.write_text(make_commented_scene(), "utf-8")
