"""Changes to the tables of a scene by dotted key."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from pvdf_fem.scene.drawings.drawing import Drawing
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.load import FORCE_KEYS
from pvdf_fem.scene.materials.catalogue import get_film_values
from pvdf_fem.scene.materials.material import MATERIAL_KEYS
from pvdf_fem.scene.placed.electrode import Electrode, Layout
from pvdf_fem.scene.placed.placed_shape import SIZE_KEYS
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.scene.validation.dependent_keys import ALTERNATIVE_KEYS, set_key

#: The names (str) and indices (int) of a parsed key, such as ``("electrodes", 0, "x_mm")``.
Steps = tuple[Any, ...]

# Keys on which the existence of other keys depends, in the order in which they must be changed.
_DECISIVE_KEYS = ("drawing", "material", "layout", "shape", "kind", "profile")
# Value of a change that creates a table if there is none; the values in the table are changes of
# their own.
_TABLE = object()
_KEY = re.compile(r"[^.[\]]+(?:\.[^.[\]]+|\[[0-9]{1,9}\])*")
# Keys that are removed when the shape changes.
_KEYS_OF_ONE_SHAPE = SIZE_KEYS | {"edge_radius_mm"}
_KEYS_OF_EVERY_LAYOUT = Layout.list_common_keys()
# Keys of a drawing of electrodes that electrodes do not have.
_DRAWING_KEYS = frozenset(Drawing.model_fields) - frozenset(Electrode.model_fields)
# Tables of a scene of which there may also be a list.
_TABLES_OR_LISTS = ("electrodes", "probe")


class Replaced(dict[str, Any]):
    """A table that replaces a whole table of the scene instead of being merged into it.

    Keys that it does not have get their defaults.

    Examples
    --------
    >>> scene = Scene.example("triangle").with_(film=Replaced(thickness_um=12.0))
    """


class _Change(NamedTuple):
    """A change of one key."""

    key: str  #: The key as the user wrote it, for error messages.
    value: Any  #: The new value, or `_TABLE`.


class _IndexError(ValueError):
    """A key without the index of a list, or with an index although there is no list."""


@lru_cache(maxsize=1024)
def parse_key(key: str) -> Steps:
    """Parse a dotted key to names and indices, moving a listed probe's force out of ``load``.

    Return an empty tuple if the text is not a key. Whether a scene has the key is not checked.
    """
    if not _KEY.fullmatch(key):
        return ()
    steps = re.findall(r"[^.[\]]+", key)
    is_index = [re.fullmatch("[0-9]{1,9}", step) for step in steps]
    return _move_steps_out_of_load(
        tuple(int(s) if index else s for s, index in zip(steps, is_index, strict=True))
    )


def _move_steps_out_of_load(steps: Steps) -> Steps:
    """Convert ``probe[0].load.force_N`` to ``probe[0].force_N``, where the force is stored.

    All `FORCE_KEYS` of listed probes are converted; other keys are returned unchanged.
    """
    match steps:
        case ("probe", int() as number, "load", key, *further) if key in FORCE_KEYS:
            return ("probe", number, key, *further)
    return steps


def get_number(scene: Any, key: str) -> float:
    """Return the number that a scene has under a dotted key.

    Parameters
    ----------
    scene : Scene
        The scene.
    key : str
        Such as ``load.force_N`` or ``electrodes[0].x_mm``.

    Returns
    -------
    float

    Raises
    ------
    AttributeError, IndexError, TypeError
        If the scene does not have this key, or has no number under it.
    ValueError
        If the value is a text.
    """
    value = scene
    for step in parse_key(key):
        value = value[step] if isinstance(step, int) else getattr(value, step)
    return float(value)


def normalize_key(key: str) -> str:
    """Return the standard spelling of a key: ``electrodes[0].x_mm`` for ``electrodes.0.x_mm``.

    The forces and the depth of a listed probe are moved out of its ``load``, as by `parse_key`. A
    text that is not a key is returned unchanged.
    """
    spelling = ""
    for step in parse_key(key):
        spelling += f"[{step}]" if isinstance(step, int) else f".{step}"
    return spelling.removeprefix(".") or key


def apply_changes(
    tables: dict[str, Any], new_values: Any, keywords: Mapping[str, Any]
) -> list[str]:
    """Change values in the tables of a scene in place, and remove keys that do not go with them.

    The new values are not validated. For the removed keys, see the notes of `Scene.with_`.

    Parameters
    ----------
    tables : dict
        The tables of a scene, which are changed.
    new_values : mapping or None
        New values by dotted key, such as ``load.force_N`` or ``probe[0].x_mm``. Tables among the
        values are merged into those of the scene, unless they are `Replaced` or models. Missing
        tables are created.
    keywords : mapping
        Further values by dotted key. If a key is also in `new_values`, the keyword counts.

    Returns
    -------
    list of str
        ``key = value: reason; advice`` for each key that is invalid, does not lead to a table of
        the scene, or is given twice in different forms; these changes are skipped. If `new_values`
        is neither a mapping nor None, its error is the only one and nothing is changed.
    """
    if not isinstance(new_values, Mapping | None):
        reason = 'must be a dict of keys with their values; give {"load.force_N": 2}'
        return [format_error("changes", new_values, reason)]
    changes, problems = _collect_changes({**(new_values or {}), **keywords})

    # whole tables first, and decisive keys before the keys that depend on them
    for steps in sorted(changes, key=_rank_change):
        change = changes[steps]
        alternative = changes.get((*steps[:-1], ALTERNATIVE_KEYS.get(steps[-1])))
        alternative_value = None if alternative is None else alternative.value
        try:
            _apply_change(tables, steps, value=change.value, alternative=alternative_value)
        except _IndexError as error:
            value = {} if change.value is _TABLE else change.value
            problems.append(format_error(change.key, value, str(error)))
        except (AttributeError, LookupError, TypeError, ValueError):
            value = {} if change.value is _TABLE else change.value
            reason = "is not a key of this scene; give one that it has"
            problems.append(format_error(change.key, value, reason))
    return list(dict.fromkeys(problems))


def _collect_changes(values: Mapping[Any, Any]) -> tuple[dict[Steps, _Change], list[str]]:
    """Split changes into changes of single keys, and find invalid and repeated keys.

    Parameters
    ----------
    values : mapping
        Values or tables by dotted key.

    Returns
    -------
    changes : dict of tuple to _Change
        Changes by the parsed key; of a repeated key, the first change.
    problems : list of str
        ``key = value: reason; advice`` for each invalid or repeated key.
    """
    changes: dict[Steps, _Change] = {}
    problems = []
    for name, table_or_value in values.items():
        key = _escape_surrogates(name)
        first_steps = parse_key(key) if isinstance(key, str) else ()
        if not first_steps:
            reason = "is not a key; write one such as film.radius_mm or electrodes[0].x_mm"
            problems.append(format_error(str(key)[:80] or '""', table_or_value, reason))
            continue
        for steps, value in iterate_values(first_steps, table_or_value):
            further = map(str, steps[len(first_steps) :])
            spelling = ".".join([key, *further])[:80]
            if steps in changes:
                reason = f"is the same key as {changes[steps].key}; remove one"
                problems.append(format_error(spelling, table_or_value, reason))
            else:
                changes[steps] = _Change(spelling, value)
    return changes, problems


def _rank_change(steps: Steps) -> tuple[int, int]:
    """Return the sort key by which changes are ordered before they are applied.

    Keys with fewer steps come first, and among them `_DECISIVE_KEYS` in their order.
    """
    name = steps[-1]
    rank = _DECISIVE_KEYS.index(name) if name in _DECISIVE_KEYS else len(_DECISIVE_KEYS)
    return len(steps), rank


def iterate_values(steps: Steps, value: Any) -> Iterator[tuple[Steps, Any]]:
    """Split the change of a table into changes of its keys, recursively.

    Parameters
    ----------
    steps : tuple of str and int
        The parsed key that is changed.
    value : object
        The new value. A mapping is split, unless it is `Replaced`; any other value is not.

    Yields
    ------
    steps : tuple of str and int
        The parsed key of a table or a value; a table comes before its keys.
    value : object
        `_TABLE` for a table that is split, otherwise the value in plain types.
    """
    if isinstance(value, Mapping) and not isinstance(value, Replaced):
        yield steps, _TABLE
        for key, item in value.items():
            inner_steps = _move_steps_out_of_load((*steps, _escape_surrogates(key)))
            yield from iterate_values(inner_steps, item)
    else:
        yield steps, to_plain_value(value)


def find_changed_keys(changes: Mapping[str, Any]) -> set[str]:
    """Find the keys that changes set, abbreviated to table and key.

    Parameters
    ----------
    changes : mapping of str to object
        Changes as in `apply_changes`.

    Returns
    -------
    set of str
        The first two names of each changed key without indices, such as ``load.force_N``. If a
        whole table is replaced, only the name of the table.
    """
    keys = set()
    for key, change in changes.items():
        for steps, value in iterate_values(parse_key(key), change):
            if value is not _TABLE:
                names = [step for step in steps if isinstance(step, str)]
                keys.add(".".join(names[:2]))
    return keys


def _apply_change(tables: dict[str, Any], steps: Steps, value: Any, alternative: Any) -> None:
    """Set one key in the tables of a scene in place, and remove keys that do not go with it.

    Missing tables around the key are created. A new shape removes the size keys of all shapes, a
    new layout removes the keys that only some layouts have, a new material removes the values of
    the old one, and `set_key` removes further keys.

    Parameters
    ----------
    tables : dict
        The tables of the scene, which are changed.
    steps : tuple of str and int
        The parsed key.
    value : object
        The new value. For `_TABLE`, an existing table is left as it is, and anything else is
        replaced by an empty table.
    alternative : object
        The value that is set at the same time for the key's alternative, or None; see `set_key`.

    Raises
    ------
    _IndexError
        If the key does not have the index of a list, or has one although there is no list.
    AttributeError, LookupError, TypeError, ValueError
        If the key leads to a value that is not a table, or to an entry that a list does not have.
    """
    if steps == ("electrodes", "drawing"):
        _replace_electrodes(tables)
    _require_index_of_list(tables, steps)
    node: Any = tables
    for step in steps[:-1]:
        node = node[step] if isinstance(node, list) else node.setdefault(str(step), {})
    last: Any = steps[-1] if isinstance(node, list) else str(steps[-1])
    if value is _TABLE:
        old = node[last] if isinstance(node, list) else node.get(last)
        value = old if isinstance(old, dict) else {}
    if isinstance(node, list):
        node[last] = value
        return
    if last == "shape" and node.get("shape") != value:
        for size in node.keys() & _KEYS_OF_ONE_SHAPE:
            del node[size]
    if steps == ("electrodes", "layout") and node.get("layout") != value:
        for key in node.keys() - _KEYS_OF_EVERY_LAYOUT:
            del node[key]
    if steps == ("film", "material"):
        _remove_values_of_material(node)
    set_key(node, last, value, alternative=alternative)


def _remove_values_of_material(film: dict[str, Any]) -> None:
    """Remove the values of the material from the table of a film, so that another one sets them.

    Without a material, and for properties that it does not have, these are the defaults.
    """
    values = get_film_values(film.get("material"))
    for key in MATERIAL_KEYS:
        default = Film.model_fields[key].default
        if key in film and film[key] == values.get(key, default):
            del film[key]


def _replace_electrodes(tables: dict[str, Any]) -> None:
    """Replace a layout or a list of electrodes by a table for the keys of a drawing."""
    electrodes = tables.get("electrodes")
    if not (isinstance(electrodes, dict) and "drawing" in electrodes):
        tables["electrodes"] = {}


def _require_index_of_list(tables: dict[str, Any], steps: Steps) -> None:
    """Raise `_IndexError` if the index of a key below electrodes or probes does not fit the scene.

    A list requires an index, a single table must have none, and an inner table that the single
    table does not have, such as ``probe.load``, requires a list.
    """
    section = steps[0]
    entries = tables.get(section) or {}
    is_drawing_key = section == "electrodes" and steps[-1] in _DRAWING_KEYS - {"drawing"}
    if is_drawing_key and not (isinstance(entries, dict) and "drawing" in entries):
        reason = "is a key of a drawing, which the scene has read or does not have"
        raise _IndexError(f"{reason}; give electrodes.drawing with it")
    if section not in _TABLES_OR_LISTS or len(steps) <= 2:
        return
    has_index = isinstance(steps[1], int)
    example = f"{section}[0].x_mm"
    if isinstance(entries, list):
        if not has_index:
            reason = f"requires an index, since the scene has a list [[{section}]]"
            raise _IndexError(f"{reason}; write it as in {example}")
    elif steps[1] not in entries:
        if has_index:
            reason = f"has an index, but the scene has no list [[{section}]]"
            raise _IndexError(f"{reason}; remove the index or give a list")
        reason = f"requires a list [[{section}]]"
        raise _IndexError(f"{reason}; give a list, and an index as in {example}")


def _escape_surrogates(key: Any) -> Any:
    """Escape unpaired surrogates in a key, since pydantic cannot report errors of such keys.

    Anything but a text is returned unchanged.
    """
    return key.encode("utf-8", "backslashreplace").decode() if isinstance(key, str) else key


def to_plain_value(value: Any) -> Any:
    """Convert a value to the types that a TOML parser returns, recursively.

    Models and mappings become dicts, tuples and arrays become lists, and NumPy scalars become
    Python scalars. Keys of models with the value None are omitted. Other types are returned
    unchanged.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {_escape_surrogates(key): to_plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain_value(item) for item in value]
    return value
