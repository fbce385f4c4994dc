"""All mistakes of a scene, told under the keys of the scene file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from typing import Any, cast, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placement import misplacements
from pvdf_fem.scene.registry import Load
from pvdf_fem.scene.scene_file import choose, problem, quote
from pvdf_fem.scene.shapes import (
    MODELS,
    MOST_ELECTRODES,
    MOST_PROBES,
    RINGS,
    Electrode,
    Electrodes,
    PressingProbe,
    Probe,
)

MOST_MISTAKES = 100  #: The largest number of mistakes that are told about one scene.

REASONS = {
    "bool_type": "must be true or false; write one of them without quotes",
    "finite_number": "must be finite; give a number",
    "float_type": "must be a number; write digits without quotes",
    "int_type": "must be a whole number; write digits without a point or quotes",
    "missing": "is required; add it",
    "model_type": "must be a table; put its keys below a heading in brackets",
    "string_unicode": "is not Unicode text; write it with other characters",
    "string_type": "must be text; put it in quotes",
    "tuple_type": "must be a list; put it in brackets",
    "union_tag_not_found": "must be a table; put its keys below a heading in brackets",
}


def mistakes(error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]) -> list[str]:
    """One line for each mistake in `data`, at most `MOST_MISTAKES`, of which pydantic told `error`.
    A scene compares its shapes only when each table is valid by itself. The tables that are valid
    are compared here, so that mistakes of both sorts are told together."""
    errors = [d for d in error.errors(include_url=False) if not _is_shortened(d)]
    lines: Iterator[str]
    if errors[0]["type"] == "misplaced":
        lines = iter(errors[0]["ctx"]["problems"])
    else:
        lines = chain((_line(details, model) for details in errors), _among_valid_tables(data))
    shown = list(islice(lines, MOST_MISTAKES + 1))
    if len(shown) > MOST_MISTAKES:
        shown[MOST_MISTAKES:] = ["there are more mistakes; correct these first"]
    return shown


def told(error: ValidationError, where: str, model: type[BaseModel]) -> list[str]:
    """One line for each mistake in the table at a key, of which pydantic told `error`. Tags of
    unions, which are no keys, begin with ``<``."""
    lines = []
    for details in error.errors(include_url=False):
        loc, kind, value = details["loc"], details["type"], details["input"]
        key = spelled_key(where, [step for step in loc if not str(step).startswith("<")])
        reason = REASONS.get(kind, f"{details['msg'][:120]}; change it")
        if kind == "missing":
            lines.append(f"{key} = (nothing): {reason}")
            continue
        if kind == "scene":
            reason = details["ctx"]["reason"]
        elif kind == "literal_error":
            reason = f"is not known; {choose(value, _quoted(details['ctx']['expected']))}"
        elif kind == "extra_forbidden":
            known = list(model.model_fields) if len(loc) == 1 else []
            reason = f"is no key there; {choose(loc[0], known) if known else 'remove it'}"
        lines.append(problem(key, value, reason))
    return lines


def spelled_key(where: str, steps: Sequence[int | str]) -> str:
    """The key of what is some steps below a key: ``data.touches``, ``section[0].title``."""
    further = (f"[{step}]" if isinstance(step, int) else f".{_bare(step)}" for step in steps)
    return (where + "".join(further)).removeprefix(".")


def _is_shortened(details: ErrorDetails) -> bool:
    """Whether a list is called too short only because its invalid entries were not counted."""
    short = details["type"] == "too_short"
    return short and len(details["input"]) >= details["ctx"]["min_length"]


def _line(details: ErrorDetails, model: type[BaseModel]) -> str:
    """A complaint of pydantic in the words of the scene file."""
    kind, loc, value = details["type"], details["loc"], details["input"]
    context = details.get("ctx", {})
    key = _key(loc)
    reason = REASONS.get(kind, details["msg"])
    if kind == "scene":
        reason = context["reason"]
    elif kind == "missing":
        return f"{key} = (nothing): {reason}"
    elif kind == "extra_forbidden":
        known = list(_owner(loc, model).model_fields)
        reason = f"is no key there; {choose(loc[-1], known)}"
        if loc[:2] == ("electrodes", "layout") and any(
            loc[-1] in ring.model_fields for ring in RINGS.values()
        ):
            reason = 'is a key of a ring; give electrodes.layout = "ring"'
        elif key in {f"electrodes.{k}" for k in ("name", "x_mm", "y_mm", "rotation_deg")}:
            reason = "is no key there, but of one electrode; begin each with [[electrodes]]"
        elif shapes := _shapes_with(loc):
            reason = f"is no key there; give shape = {' or '.join(shapes)}"
            reason += f", or choose from {', '.join(known)}"
    elif kind == "tuple_type" and isinstance(value, Mapping):
        reason = f"must be a list of tables; begin each with [[{key}]]"
    elif kind == "model_type" and isinstance(value, list):
        reason = f"must be one table; begin it with [{key}]"
    elif kind == "literal_error":
        known = _quoted(context["expected"]) + ["ring"] * (key == "electrodes.layout")
        reason = f"is not known; {choose(value, known)}"
    elif kind == "union_tag_invalid":
        shape = value["shape"] if isinstance(value, Mapping) else value.shape
        key, value = f"{key}.shape", shape
        reason = f"is not known; {choose(value, _quoted(context['expected_tags']))}"
    elif kind == "float_type" and isinstance(value, int) and not isinstance(value, bool):
        reason = "is too large; give a smaller number"
    elif kind in ("too_short", "too_long"):
        few, bound = ("few", "at least") if kind == "too_short" else ("many", "at most")
        limit = context["min_length" if kind == "too_short" else "max_length"]
        reason = f"has too {few} entries; give {bound} {limit}"
    return problem(key, value, reason)


def _key(loc: tuple[int | str, ...]) -> str:
    """The key as the scene file has it: pydantic adds the member of a union that it tried."""
    parts = list(loc)
    if parts[0] in ("probe", "electrodes"):
        tag = parts.pop(1) if len(parts) > 1 else ""
        if tag in ("list", "ring", "table"):  # members of a second union
            place = 2 if tag == "list" else 1
            del parts[place : place + 1]
    elif parts[0] in ("film", "readout"):
        place = 3 if parts[1:2] == ["patches"] else 2
        del parts[place : place + 1]
    return spelled_key("", parts)


def _bare(key: str) -> str:
    return key if re.fullmatch(r"[\w-]{1,60}", key) else quote(key)


def _owner(loc: tuple[int | str, ...], model: type[BaseModel]) -> type[BaseModel]:
    """The model that has the key at `loc`, or should have it."""
    where = tuple(step for step in loc[:-1] if not isinstance(step, int))
    if not where or where in MODELS:
        return MODELS.get(where, model)
    section: Any = model.model_fields[str(loc[0])].annotation
    return cast(type[BaseModel], next(iter(get_args(section)), section))


def _shapes_with(loc: tuple[int | str, ...]) -> list[str]:
    """The other shapes that the table at `loc` could have, of which its key is one."""
    section = tuple(step for step in loc if not isinstance(step, int))[:-2]
    return [
        where[-1]
        for where, model in MODELS.items()
        if where[:-1] == section and loc[-1] in model.model_fields
    ]


def _quoted(text: str) -> list[str]:
    return re.findall("'([^']*)'", text)


def _among_valid_tables(data: Mapping[str, Any]) -> Iterator[str]:
    """Misplacements among the tables of a scene that are valid by themselves."""
    sections = {name: table for name, table in data.items() if isinstance(table, Mapping)}
    radius = {key: value for key, value in sections.get("film", {}).items() if key == "radius_mm"}
    film = _valid(Film, radius)
    electrodes, probe = data.get("electrodes", {}), data.get("probe")
    single = _valid(Probe, probe)
    observable = sections.get("numerics", {}).get("observable")
    yield from misplacements(
        film.radius_mm if film else None,
        _valid_entries("electrodes", Electrode, electrodes, MOST_ELECTRODES)
        or _valid(Electrodes, electrodes)
        or {},
        {"probe": single} if single else _valid_entries("probe", PressingProbe, probe, MOST_PROBES),
        _valid(Load, data.get("load", {})),
        observable if isinstance(observable, str) else "",
    )


def _valid_entries(name: str, model: Any, tables: Any, most: int) -> dict[str, Any]:
    """The models of a list's valid tables by their keys; none of what is no list."""
    models = [_valid(model, table) for table in tables[:most]] if isinstance(tables, list) else []
    return {f"{name}[{i}]": model for i, model in enumerate(models) if model is not None}


def _valid(model: Any, value: Any) -> Any:
    """The model of a value, or None where it has mistakes."""
    try:
        return TypeAdapter(model).validate_python(value)
    except ValidationError:
        return None
