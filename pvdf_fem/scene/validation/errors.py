"""Validation errors of a scene, described under the keys of the scene file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.placed.electrode import Electrode, Electrodes
from pvdf_fem.scene.placed.placed_shape import PLACEMENT_KEYS, ShapedTable
from pvdf_fem.scene.placed.probe import ListedProbe, Probe
from pvdf_fem.scene.scene_file import format_error, quote, suggest
from pvdf_fem.scene.validation.placement import find_placement_errors
from pvdf_fem.scene.validation.table_forms import TABLES, TableForm, list_forms

MAX_ERRORS = 100  #: The largest number of errors that are described of one scene.

#: Keys of neglected effects, with the size of each effect, and keys of other files.
UNSUPPORTED_KEYS = {
    "axes": "is a key of sweep files, not of scenes; use `pvdf-fem sweep` or sweep(scene, axes)",
    "section": "is a key of report scripts, not of scenes; use `pvdf-fem report` or Report.load",
    "friction": "is not part of the model: film slides freely on tips. Under a 6 mm sphere and 1 N"
    " a coefficient of 0.23 changes a charge beside the contact by 0.03 %, and film that sticks by"
    " 0.3 %; only an electrode under the tip feels more, 3 % and up to 80 %; remove it",
}
#: Reasons by pydantic's types of errors.
REASONS = {
    "bool_type": "must be true or false; write one of them without quotes",
    "dict_type": "must be a table of keys with their values; give one",
    "finite_number": "must be finite; give a number",
    "float_type": "must be a number; write digits without quotes",
    "int_type": "must be a whole number; write digits without a point or quotes",
    "missing": "is required; add it",
    "model_attributes_type": "must be a table; put its keys below a heading in brackets",
    "model_type": "must be a table; put its keys below a heading in brackets",
    "nameless": "is not a table with a name; use Scene.from_file(path) or Scene().with_({...})",
    "path_type": "must be a path; give the name of a file",
    "string_unicode": "is not Unicode text; write it with other characters",
    "string_type": "must be text; put it in quotes",
    "tuple_type": "must be a list; put it in brackets",
    "union_tag_not_found": "must be a table; put its keys below a heading in brackets",
}


def describe_scene_errors(
    error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]
) -> list[str]:
    """Describe all errors of a scene.

    pydantic compares the shapes of a scene only when each table is valid by itself. Here the valid
    tables are compared too, to report both sorts of errors together.

    Parameters
    ----------
    error : ValidationError
        From the validation of `data`.
    data : mapping
        The tables of the scene.
    model : type of Scene
        The model of scenes.

    Returns
    -------
    list of str
        At most `MAX_ERRORS` lines, and then a line that says that there are more.
    """
    errors = error.errors(include_url=False)
    lines: Iterator[str]
    if errors[0]["type"] == "misplaced":
        lines = iter(errors[0]["ctx"]["problems"])
    else:
        lines = chain(describe_errors(error, "", model), _find_errors_between_valid_tables(data))
    shown = list(islice(lines, MAX_ERRORS + 1))
    if len(shown) > MAX_ERRORS:
        shown[MAX_ERRORS:] = ["there are more errors; correct these first"]
    return shown


def describe_errors(error: ValidationError, where: str, model: type[BaseModel]) -> Iterator[str]:
    """Describe the errors of a table.

    Parameters
    ----------
    error : ValidationError
        From the validation of the table.
    where : str
        Key of the table; empty for a whole scene.
    model : type of BaseModel
        Model of the table.

    Yields
    ------
    str
        ``key = value: reason; advice`` for each error.
    """
    for details in error.errors(include_url=False):
        if not _is_list_with_invalid_entries(details):
            yield _describe_error(details, where, model)


def join_key(where: str, steps: Sequence[int | str]) -> str:
    """Return the key some steps below a key: ``data.touches``, ``section[0].title``."""
    key = where
    for step in steps:
        if isinstance(step, int):
            key += f"[{step}]"
        else:
            key += f".{_quote_unusual_key(step)}"
    return key.removeprefix(".")


def _quote_unusual_key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]{1,60}", key) else quote(key)


def _is_list_with_invalid_entries(details: ErrorDetails) -> bool:
    """Return whether a list is called too short only because invalid entries were not counted."""
    is_short = details["type"] == "too_short"
    return is_short and len(details["input"]) >= details["ctx"]["min_length"]


def _describe_error(details: ErrorDetails, where: str, model: type[BaseModel]) -> str:
    """Describe one of pydantic's errors in the words of the scene file."""
    kind = details["type"]
    location = details["loc"]
    value = details["input"]
    context = details.get("ctx", {})
    key = join_key(where, _to_file_steps(location, is_last_step_a_key=kind == "extra_forbidden"))
    reason = REASONS.get(kind, f"{details['msg'][:120]}; change it")
    if kind == "missing":
        return f"{key}: {reason}"
    if kind == "scene":
        reason = context["reason"]
        if "key" in context:
            key = join_key(key, [context["key"]])
            value = context["value"]
    elif kind == "extra_forbidden":
        unsupported = UNSUPPORTED_KEYS.get(str(location[-1]))
        reason = unsupported or f"is not a key there; {_advise_on_key(key, location, model)}"
    elif kind == "tuple_type" and isinstance(value, Mapping):
        reason = f"must be a list of tables; begin each with [[{key}]]"
    elif kind == "model_type" and isinstance(value, list):
        reason = f"must be one table; begin it with [{key}]"
    elif kind == "literal_error":
        reason = f"is not a known value; {suggest(value, _find_quoted(context['expected']))}"
    elif kind == "union_tag_invalid":
        value = value["shape"]
        reason = f"is not a known shape; {suggest(value, _find_quoted(context['expected_tags']))}"
    elif kind == "float_type" and isinstance(value, int) and not isinstance(value, bool):
        reason = "is too large; give a smaller number"
    elif kind == "too_short":
        reason = f"has too few entries; give at least {context['min_length']}"
    elif kind == "too_long":
        reason = f"has too many entries; give at most {context['max_length']}"
    return format_error(key, value, reason)


def _to_file_steps(location: tuple[int | str, ...], is_last_step_a_key: bool) -> list[int | str]:
    """Convert pydantic's location of an error to the steps of a key in the scene file.

    Tags of unions, which begin with ``<``, are no keys. Keys of a shape stand beside the key
    ``shape`` in the file, but two steps below it in the model: ``shape``, the shape's name, the
    key.
    """
    steps: list[int | str] = []
    position = 0
    while position < len(location):
        step = location[position]
        is_last = position == len(location) - 1
        if step == "shape" and position + 2 < len(location):
            position += 2
            continue
        is_tag = str(step).startswith("<")
        if not is_tag or (is_last and is_last_step_a_key):
            steps.append(step)
        position += 1
    return steps


def _advise_on_key(key: str, location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Advise on the last step of a location, a key that its table does not have."""
    unknown = location[-1]
    form = _find_form(location[:-1])
    if form is None:
        known = _find_keys(location[:-1], model)
        return suggest(unknown, known) if known else "remove it"
    if form.table is TABLES["electrodes"] and unknown in ("name", *PLACEMENT_KEYS):
        return "it is a key of an electrode; begin each with [[electrodes]]"
    known = list(form.fields)
    shapes = [other for other in list_forms(form.table) if unknown in other.fields]
    if shapes:
        names = [other.fields["shape"].default for other in shapes]
        return f"give shape = {' or '.join(names)}, or choose from {', '.join(known)}"
    return suggest(unknown, known)


def _find_form(location: tuple[int | str, ...]) -> TableForm | None:
    """Find the table of a scene at a location, with its shape; None if it has no shape."""
    steps = [str(step) for step in location if not isinstance(step, int)]
    if len(steps) < 2 or steps[-2] != "shape":
        return None
    is_list = len(location) != len(steps)
    place = ".".join(step for step in steps[:-2] if not step.startswith("<"))
    table = TABLES.get(f"{place}[0]" if is_list else place)
    if table is None or not issubclass(table, ShapedTable) or steps[-1] not in table.shapes:
        return None
    return TableForm(table, table.shapes[steps[-1]])


def _find_keys(location: tuple[int | str, ...], model: type[BaseModel]) -> list[str]:
    """Find the keys of the table at a location below a model; none where that is not known."""
    if not location:
        return list(model.model_fields)
    names = [step for step in location if isinstance(step, str) and not step.startswith("<")]
    if names == ["probe", "load"]:
        return list(TABLES["probe[0].load"].model_fields)
    field = model.model_fields.get(names[0]) if len(names) == 1 else None
    if field is None:
        return []
    for annotation in (field.annotation, *get_args(field.annotation)):
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return list(annotation.model_fields)
    return []


def _find_quoted(text: str) -> list[str]:
    """Find the words in single quotes."""
    return re.findall("'([^']*)'", text)


def _find_errors_between_valid_tables(data: Mapping[str, Any]) -> Iterator[str]:
    """Find placement errors between the tables of a scene that are valid by themselves."""
    film = data.get("film")
    radius = {}
    if isinstance(film, dict) and "radius_mm" in film:
        radius = {"radius_mm": film["radius_mm"]}
    valid_film = _validate(Film, radius)
    numerics = data.get("numerics")
    observable = numerics.get("observable") if isinstance(numerics, dict) else ""
    electrodes = data.get("electrodes", {})
    valid_electrodes = _validate_entries("electrodes", Electrode, electrodes)
    probe = data.get("probe")
    valid_probe = _validate(Probe, probe)
    if valid_probe is not None:
        probes = {"probe": valid_probe}
    else:
        probes = _validate_entries("probe", ListedProbe, probe)
    yield from find_placement_errors(
        radius_mm=valid_film.radius_mm if valid_film else None,
        electrodes=valid_electrodes or _validate(Electrodes, electrodes) or {},
        probes=probes,
        load=_validate(Load, data.get("load", {})),
        observable=observable if isinstance(observable, str) else "",
    )


def _validate_entries(name: str, model: type[Section], tables: Any) -> dict[str, Any]:
    """Return the models of the valid tables of a list, by their keys."""
    if not isinstance(tables, list):
        return {}
    models = {}
    for number, table in enumerate(tables[:MAX_ERRORS]):
        valid = _validate(model, table)
        if valid is not None:
            models[f"{name}[{number}]"] = valid
    return models


def _validate(model: Any, value: Any) -> Any:
    """Return the model of a value; None where it is not valid."""
    try:
        return TypeAdapter(model).validate_python(value)
    except ValidationError:
        return None
