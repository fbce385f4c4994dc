"""Mistakes in a scene, under the keys in the scene file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placement import find_placement_errors
from pvdf_fem.scene.registry import Load
from pvdf_fem.scene.scene_file import format_error, quote, suggest
from pvdf_fem.scene.shapes import MODELS, Electrode, Electrodes, PressingProbe, Probe

MAX_ERRORS = 100  #: The largest number of mistakes that are told about one scene.

#: Keys of neglected effects, with the change by each effect, and of other files.
NOT_MODELLED = {
    "axes": "is of a sweep file, not of a scene; use `pvdf-fem sweep` or sweep(scene, axes)",
    "section": "is of a report script, not of a scene; use `pvdf-fem report` or Report.load",
    "friction": "is not part of the model: film slides freely on tips. Under a 6 mm sphere and 1 N"
    " a coefficient of 0.23 changes a charge beside the contact by 0.03 %, and film that sticks by"
    " 0.3 %; only an electrode under the tip feels more, 3 % and up to 80 %; remove it",
}
REASONS = {
    "bool_type": "must be true or false; write one of them without quotes",
    "dict_type": "must be a table of keys with their values; give one",
    "finite_number": "must be finite; give a number",
    "float_type": "must be a number; write digits without quotes",
    "int_type": "must be a whole number; write digits without a point or quotes",
    "missing": "is required; add it",
    "model_type": "must be a table; put its keys below a heading in brackets",
    "nameless": "is no table by name; use Scene.from_file(path) or Scene().with_({...})",
    "path_type": "must be a path; give the name of a file",
    "string_unicode": "is not Unicode text; write it with other characters",
    "string_type": "must be text; put it in quotes",
    "tuple_type": "must be a list; put it in brackets",
    "union_tag_not_found": "must be a table; put its keys below a heading in brackets",
}


def describe_scene_errors(
    error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]
) -> list[str]:
    """Lines for mistakes in `data`, at most `MAX_ERRORS`, from pydantic's `error`.
    A scene compares its shapes only when each table is valid by itself. Valid tables are compared
    here, to report both sorts of mistakes together."""
    errors = error.errors(include_url=False)
    lines: Iterator[str]
    if errors[0]["type"] == "misplaced":
        lines = iter(errors[0]["ctx"]["problems"])
    else:
        lines = chain(describe_errors(error, "", model), _among_valid_tables(data))
    shown = list(islice(lines, MAX_ERRORS + 1))
    if len(shown) > MAX_ERRORS:
        shown[MAX_ERRORS:] = ["there are more mistakes; correct these first"]
    return shown


def describe_errors(error: ValidationError, where: str, model: type[BaseModel]) -> Iterator[str]:
    """Lines for mistakes in the table at a key, from pydantic's `error`. Union tags begin with
    ``<`` and are no keys."""
    errors = error.errors(include_url=False)
    return (_line(d, where, model) for d in errors if not _is_shortened(d))


def join_key(where: str, steps: Sequence[int | str]) -> str:
    """The key some steps below a key: ``data.touches``, ``section[0].title``."""
    further = (f"[{step}]" if isinstance(step, int) else f".{_bare(step)}" for step in steps)
    return (where + "".join(further)).removeprefix(".")


def _bare(key: str) -> str:
    return key if re.fullmatch(r"[\w-]{1,60}", key) else quote(key)


def _is_shortened(details: ErrorDetails) -> bool:
    """Whether a list is called too short only because its invalid entries were not counted."""
    short = details["type"] == "too_short"
    return short and len(details["input"]) >= details["ctx"]["min_length"]


def _line(details: ErrorDetails, where: str, model: type[BaseModel]) -> str:
    """pydantic's complaint in the words of the scene file."""
    kind, loc, value = details["type"], details["loc"], details["input"]
    context = details.get("ctx", {})
    unknown = kind == "extra_forbidden"
    steps = [s for s in loc[: len(loc) - unknown] if not str(s).startswith("<")]
    key = join_key(where, [*steps, *loc[len(loc) - unknown :]])
    reason = REASONS.get(kind, f"{details['msg'][:120]}; change it")
    if kind == "missing":
        return f"{key} = (nothing): {reason}"
    if kind == "scene":
        reason = context["reason"]
    elif unknown:
        left_out = NOT_MODELLED.get(str(loc[-1]))
        reason = left_out or f"is no key there; {_instead(key, loc, model)}"
    elif kind == "tuple_type" and isinstance(value, Mapping):
        reason = f"must be a list of tables; begin each with [[{key}]]"
    elif kind == "model_type" and isinstance(value, list):
        reason = f"must be one table; begin it with [{key}]"
    elif kind == "literal_error":
        known = _quoted(context["expected"])
        reason = f"is not known; {suggest(value, known)}"
    elif kind == "union_tag_invalid":
        value = value["shape"] if isinstance(value, Mapping) else value.shape
        known = [tag.strip("<>") for tag in _quoted(context["expected_tags"])]
        key, reason = f"{key}.shape", f"is not known; {suggest(value, known)}"
    elif kind == "float_type" and isinstance(value, int) and not isinstance(value, bool):
        reason = "is too large; give a smaller number"
    elif kind in ("too_short", "too_long"):
        few, bound = ("few", "at least") if kind == "too_short" else ("many", "at most")
        limit = context["min_length" if kind == "too_short" else "max_length"]
        reason = f"has too {few} entries; give {bound} {limit}"
    return format_error(key, value, reason)


def _instead(key: str, loc: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Advice about the last step in `loc`, an unknown key in its table."""
    where = tuple(str(step).strip("<>") for step in loc[:-1] if not isinstance(step, int))
    known = _keys_at(where, model)
    if where[:2] == ("electrodes", "table") and loc[-1] in ("name", "x_mm", "y_mm", "rotation_deg"):
        return "it is one of an electrode; begin each with [[electrodes]]"
    others = (place for place, table in MODELS.items() if loc[-1] in table.model_fields)
    if shapes := [place[-1] for place in others if where and place[:-1] == where[:-1]]:
        return f"give shape = {' or '.join(shapes)}, or choose from {', '.join(known)}"
    return suggest(loc[-1], known) if known else "remove it"


def _keys_at(where: tuple[str, ...], model: type[BaseModel]) -> list[str]:
    """The keys of the table some steps below a model; none where that is not known."""
    if where in MODELS or not where:
        return list(MODELS.get(where, model).model_fields)
    field = model.model_fields.get(where[0]) if len(where) == 1 else None
    inner = (field.annotation, *get_args(field.annotation)) if field else ()
    tables = (t for t in inner if isinstance(t, type) and issubclass(t, BaseModel))
    return [key for table in islice(tables, 1) for key in table.model_fields]


def _quoted(text: str) -> list[str]:
    return re.findall("'([^']*)'", text)


def _among_valid_tables(data: Mapping[str, Any]) -> Iterator[str]:
    """Misplacements among individually valid tables in a scene."""
    film, numerics = (data.get(name) for name in ("film", "numerics"))
    radius = {k: v for k, v in film.items() if k == "radius_mm"} if isinstance(film, dict) else {}
    valid = _valid(Film, radius)
    electrodes, probe = data.get("electrodes", {}), data.get("probe")
    single = _valid(Probe, probe)
    observable = numerics.get("observable") if isinstance(numerics, dict) else ""
    yield from find_placement_errors(
        valid.radius_mm if valid else None,
        _valid_entries("electrodes", Electrode, electrodes) or _valid(Electrodes, electrodes) or {},
        {"probe": single} if single else _valid_entries("probe", PressingProbe, probe),
        _valid(Load, data.get("load", {})),
        observable if isinstance(observable, str) else "",
    )


def _valid_entries(name: str, model: Any, tables: Any) -> dict[str, Any]:
    """The models of a list's valid tables by their keys; none of what is no list."""
    first = tables[:MAX_ERRORS] if isinstance(tables, list) else []
    models = {f"{name}[{i}]": _valid(model, table) for i, table in enumerate(first)}
    return {key: model for key, model in models.items() if model is not None}


def _valid(model: Any, value: Any) -> Any:
    """The model of a value, or None where it has mistakes."""
    try:
        return TypeAdapter(model).validate_python(value)
    except ValidationError:
        return None
