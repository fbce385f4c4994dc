"""Messages for the validation errors of a scene, by the keys of the scene file."""

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
from pvdf_fem.scene.placed.placed_shape import PLACEMENT_KEYS, SIZE_KEYS, ShapedTable
from pvdf_fem.scene.placed.probe import ListedProbe, Probe
from pvdf_fem.scene.scene_file import format_error, quote, suggest
from pvdf_fem.scene.validation.placement import find_placement_errors
from pvdf_fem.scene.validation.table_forms import TABLES, TableForm, list_forms

MAX_ERRORS = 100  #: Maximum number of errors that are described for one scene.

#: Reasons why a scene does not have a key: keys of other files, and effects that are neglected.
UNSUPPORTED_KEYS = {
    "axes": "is a key of sweep files, not of scenes; use `pvdf-fem sweep` or sweep(scene, axes)",
    "section": "is a key of report scripts, not of scenes; use `pvdf-fem report` or Report.load",
    "friction": "is not part of the model: the film slides on tips without friction. Under a 6 mm"
    " sphere and 1 N, a coefficient of 0.23 changes a charge beside the contact by 0.03 %, and"
    " sticking changes it by 0.3 %; only an electrode under the tip changes more, by 3 % and up to"
    " 80 %; remove it",
}
#: Reason and advice for each of pydantic's error types.
REASONS = {
    "bool_type": "must be true or false; write one of them without quotes",
    "dict_type": "must be a table; give its keys with their values",
    "finite_number": "must be finite; give a number",
    "float_type": "must be a number; write digits without quotes",
    "int_type": "must be a whole number; write digits without a point or quotes",
    "missing": "is required; add it",
    "model_attributes_type": "must be a table; put its keys below a heading in brackets",
    "model_type": "must be a table; put its keys below a heading in brackets",
    "nameless": "is given without a name; use Scene.from_file(path) or Scene().with_({...})",
    "path_type": "must be a path; give the name of a file",
    "string_unicode": "is not Unicode text; write it with other characters",
    "string_type": "must be text; put it in quotes",
    "tuple_type": "must be a list; put it in brackets",
    "union_tag_not_found": "must be a table; put its keys below a heading in brackets",
}


def describe_scene_errors(
    error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]
) -> list[str]:
    """Describe the errors of a scene, within its tables and between its valid tables.

    pydantic compares the tables of a scene with each other only if every table is valid by itself.
    Here the valid tables are compared even if others are invalid, so that users see the errors
    within tables and the errors between tables together.

    Parameters
    ----------
    error : ValidationError
        Raised by the validation of `data`.
    data : mapping
        The tables of the scene, as they were passed to `model`.
    model : type of BaseModel
        The class `Scene`, which names the known keys.

    Returns
    -------
    list of str
        ``key = value: reason; advice`` for each error. After `MAX_ERRORS` of them, a last line says
        that there are more.
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
    """Describe the errors that pydantic found within a table.

    A list that is too short only because its invalid entries are left out has no line of its own.

    Parameters
    ----------
    error : ValidationError
        Raised by the validation of the table.
    where : str
        Key of the table, which precedes the keys in the lines; empty for a whole scene.
    model : type of BaseModel
        Model of the table, which names the known keys.

    Yields
    ------
    str
        ``key = value: reason; advice`` for each error.
    """
    for details in error.errors(include_url=False):
        if not _is_list_with_invalid_entries(details):
            yield _describe_error(details, where, model)


def join_key(where: str, steps: Sequence[int | str]) -> str:
    """Return the key `where` extended by names and indices, such as ``section[0].title``."""
    key = where
    for step in steps:
        if isinstance(step, int):
            key += f"[{step}]"
        else:
            key += f".{_quote_unusual_key(step)}"
    return key.removeprefix(".")


def _quote_unusual_key(key: str) -> str:
    """Return a key, in quotes if it is long or has other characters than a bare key of TOML."""
    return key if re.fullmatch(r"[\w-]{1,60}", key) else quote(key)


def _is_list_with_invalid_entries(details: ErrorDetails) -> bool:
    """Return whether a list has enough entries, but pydantic counts only the valid ones."""
    is_short = details["type"] == "too_short"
    return is_short and len(details["input"]) >= details["ctx"]["min_length"]


def _describe_error(details: ErrorDetails, where: str, model: type[BaseModel]) -> str:
    """Describe one of pydantic's errors as ``key = value: reason; advice``.

    Parameters
    ----------
    details : ErrorDetails
        The error.
    where : str
        Key of the validated table; empty for the whole scene.
    model : type of BaseModel
        The model that was validated.
    """
    kind = details["type"]
    location = details["loc"]
    value = details["input"]
    context = details.get("ctx", {})
    if "key" in context:  # the error of a whole table, which names one of its keys
        location = (*location, context["key"])
        value = context["value"]
    steps = _convert_to_file_steps(location, is_last_step_a_key=kind == "extra_forbidden")
    key = join_key(where, steps)
    reason = REASONS.get(kind, f"{details['msg'][:120]}; change it")
    if kind == "missing":
        return f"{key}: {reason}"
    if kind == "scene":
        reason = context["reason"]
    elif kind == "extra_forbidden":
        unsupported = UNSUPPORTED_KEYS.get(str(location[-1]))
        table = join_key(where, steps[:-1])
        place = f"of {table}" if table else "at the top level"
        reason = unsupported or f"is not a key {place}; {_advise_on_key(location, model)}"
    elif kind == "tuple_type" and steps and isinstance(steps[-1], int):
        reason = "must be a point; give its coordinates [x, y] in brackets"
    elif kind == "tuple_type" and isinstance(value, Mapping):
        reason = f"must be a list of tables; begin each with [[{key}]]"
    elif kind == "model_type" and isinstance(value, list):
        reason = f"must be one table, not a list; begin it with [{key}], not [[{key}]]"
    elif kind == "literal_error":
        reason = f"is not a valid value; {suggest(value, _find_quoted_words(context['expected']))}"
    elif kind == "union_tag_invalid":
        value = value["shape"]
        reason = (
            f"is not a valid shape; {suggest(value, _find_quoted_words(context['expected_tags']))}"
        )
    elif kind == "float_type" and isinstance(value, bool):
        reason = "must be a number, not true or false; write digits"
    elif kind == "float_type" and isinstance(value, int):
        reason = "is too large; give a smaller number"
    elif kind == "too_short":
        reason = f"has too few entries; give at least {context['min_length']}"
    elif kind == "too_long":
        reason = f"has too many entries; give at most {context['max_length']}"
    return format_error(key, value, reason)


def _convert_to_file_steps(
    location: tuple[int | str, ...], is_last_step_a_key: bool
) -> list[int | str]:
    """Convert pydantic's location of an error to the names and indices of a key in the scene file.

    Two sorts of steps are dropped. Tags of unions begin with ``<`` and are not keys, unless the
    last step is an unknown key that looks like a tag. Keys of a shape stand beside the key
    ``shape`` in the file, while in the model they are below ``shape`` and the shape's name.

    Parameters
    ----------
    location : tuple of int and str
        Location from pydantic's error.
    is_last_step_a_key : bool
        Whether the last step is a key that the user wrote.

    Returns
    -------
    list of int and str
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


def _advise_on_key(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Return advice on the unknown key at the end of a location.

    The advice is to choose a shape that has the key, a similar key or any known key, or to remove
    the key. A key of listed electrodes in a layout has advice of its own.
    """
    unknown = location[-1]
    form = _find_shaped_table(location[:-1])
    if form is None:
        known = _find_keys(location[:-1], model)
        return suggest(unknown, known) if known else "remove it"
    if form.table is TABLES["electrodes"] and unknown in ("name", *PLACEMENT_KEYS):
        return "it is a key of listed electrodes; begin each with [[electrodes]]"
    known = list(form.fields)
    shapes = [other for other in list_forms(form.table) if unknown in other.fields]
    if shapes:
        names = [other.fields["shape"].default for other in shapes]
        return f"give shape = {' or '.join(names)}, or choose from {', '.join(known)}"
    return suggest(unknown, known)


def _find_shaped_table(location: tuple[int | str, ...]) -> TableForm | None:
    """Find the scene's table whose shape pydantic was validating at a location.

    Such a location ends with ``shape`` and the name of the shape. For all others, and for shapes
    that the table cannot have, return None.
    """
    steps = [str(step) for step in location if not isinstance(step, int)]
    if len(steps) < 2 or steps[-2] != "shape":
        return None
    is_list = len(location) != len(steps)
    key = ".".join(step for step in steps[:-2] if not step.startswith("<"))
    table = TABLES.get(f"{key}[0]" if is_list else key)
    if table is None or not issubclass(table, ShapedTable) or steps[-1] not in table.shapes:
        return None
    return TableForm(table, table.shapes[steps[-1]])


def _find_keys(location: tuple[int | str, ...], model: type[BaseModel]) -> list[str]:
    """Return the names of all keys of the table at a location in a model.

    The location may be that of the model itself (it is then empty), of one of its tables or of the
    load of a listed probe. For any other location the list is empty.
    """
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


def _find_quoted_words(text: str) -> list[str]:
    """Return the words that a message has in single quotes, without the quotes."""
    return re.findall("'([^']*)'", text)


def _find_errors_between_valid_tables(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield placement errors between those tables of a scene that are valid by themselves.

    The film takes part if its shape is valid, even if other keys of it are not.
    """
    film = data.get("film")
    shape_keys = {}
    if isinstance(film, dict):
        shape_keys = {key: film[key] for key in film if key == "shape" or key in SIZE_KEYS}
    valid_film = _validate_value(Film, shape_keys)
    numerics = data.get("numerics")
    observable = numerics.get("observable") if isinstance(numerics, dict) else ""
    electrodes = data.get("electrodes", {})
    valid_electrodes = _validate_entries("electrodes", Electrode, electrodes)
    probe = data.get("probe")
    valid_probe = _validate_value(Probe, probe)
    if valid_probe is not None:
        probes = {"probe": valid_probe}
    else:
        probes = _validate_entries("probe", ListedProbe, probe)
    yield from find_placement_errors(
        film_shape=valid_film.geometry if valid_film else None,
        electrodes=valid_electrodes or _validate_value(Electrodes, electrodes) or {},
        probes=probes,
        load=_validate_value(Load, data.get("load", {})),
        observable=observable if isinstance(observable, str) else "",
    )


def _validate_entries(name: str, model: type[Section], tables: Any) -> dict[str, Any]:
    """Validate the tables of a list, and return the valid ones by their keys.

    Parameters
    ----------
    name : str
        Key of the list.
    model : type of Section
        Model of its tables.
    tables : object
        The list of tables. For anything else, the result is empty.

    Returns
    -------
    dict of str to Section
        Models of the valid tables by keys such as ``probe[0]``. Tables after the first `MAX_ERRORS`
        are ignored.
    """
    if not isinstance(tables, list):
        return {}
    models = {}
    for number, table in enumerate(tables[:MAX_ERRORS]):
        valid = _validate_value(model, table)
        if valid is not None:
            models[f"{name}[{number}]"] = valid
    return models


def _validate_value(model: Any, value: Any) -> Any:
    """Return the value as `model`, a model or another type; None if the value is invalid."""
    try:
        return TypeAdapter(model).validate_python(value)
    except ValidationError:
        return None
