"""Changes to the tables of a scene by dotted key."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from pvdf_fem.scene.load import FORCE_KEYS
from pvdf_fem.scene.placed.electrode import Layout
from pvdf_fem.scene.placed.placed_shape import SIZE_KEYS
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.scene.validation.dependent_keys import ALTERNATIVE_KEYS, set_key

#: The names (str) and indices (int) of a parsed key, such as ``("electrodes", 0, "x_mm")``.
Steps = tuple[Any, ...]

# Keys on which the existence of other keys depends, in the order in which they must be changed.
_DECISIVE_KEYS = ("layout", "shape", "kind", "profile")
# Value of the change that creates a table; the values in the table are changes of their own.
_TABLE = object()
_KEY = re.compile(r"[^.[\]]+(?:\.[^.[\]]+|\[[0-9]{1,9}\])*")
# Keys that are removed when the shape changes.
_KEYS_OF_A_SHAPE = SIZE_KEYS | {"edge_radius_mm"}
_KEYS_OF_EVERY_LAYOUT = Layout.list_common_keys()
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
    """A change of a single value."""

    key: str  #: The key as the user wrote it.
    value: Any


class _IndexError(ValueError):
    """A list that is addressed by name, or a table that is addressed by index."""


@lru_cache(maxsize=1024)
def parse_key(key: str) -> Steps:
    """Parse a dotted key to names and indices; return an empty tuple if it is not a key."""
    if not _KEY.fullmatch(key):
        return ()
    steps = re.findall(r"[^.[\]]+", key)
    is_index = [re.fullmatch("[0-9]{1,9}", step) for step in steps]
    return _move_beside_shape(
        tuple(int(s) if index else s for s, index in zip(steps, is_index, strict=True))
    )


def _move_beside_shape(steps: Steps) -> Steps:
    """Convert ``probe[0].load.force_N`` to ``probe[0].force_N``, where the force is stored.

    The same holds for all `FORCE_KEYS`; other keys are returned unchanged.
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
        If the scene has no number under this key.
    """
    value = scene
    for step in parse_key(key):
        value = value[step] if isinstance(step, int) else getattr(value, step)
    return float(value)


def normalize_key(key: str) -> str:
    """Return the standard spelling of a key: ``electrodes[0].x_mm`` for ``electrodes.0.x_mm``.

    A text that is not a key is returned unchanged.
    """
    spelling = ""
    for step in parse_key(key):
        spelling += f"[{step}]" if isinstance(step, int) else f".{step}"
    return spelling.removeprefix(".") or key


def apply_changes(
    tables: dict[str, Any], new_values: Any, keywords: Mapping[str, Any]
) -> list[str]:
    """Change values in the tables of a scene in place.

    The new values are not validated.

    Parameters
    ----------
    tables : dict
        The tables of a scene, which are changed.
    new_values : mapping or None
        New values by dotted key, such as ``load.force_N`` or ``probe[0].x_mm``. Tables among the
        values are merged into those of the scene, and tables that a key needs are created.
    keywords : mapping
        Further values in the same form, which take precedence over equal keys of `new_values`.

    Returns
    -------
    list of str
        ``key = value: reason; advice`` for each key that is not a key of the scene or is changed
        twice.
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
    """Collect the changes of single values.

    Parameters
    ----------
    values : mapping
        Values or tables by dotted key.

    Returns
    -------
    changes : dict of tuple to _Change
        Changes by the steps of their keys.
    problems : list of str
        Errors of invalid and repeated keys.
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
    """Return the sort key of a change: by depth, and then decisive keys before others."""
    name = steps[-1]
    rank = _DECISIVE_KEYS.index(name) if name in _DECISIVE_KEYS else len(_DECISIVE_KEYS)
    return len(steps), rank


def iterate_values(steps: Steps, value: Any) -> Iterator[tuple[Steps, Any]]:
    """Split a change into changes of single values.

    Parameters
    ----------
    steps : tuple of str and int
        The parsed key.
    value : object
        The new value. A mapping is split, unless it is `Replaced`.

    Yields
    ------
    steps : tuple of str and int
        The parsed key of a single value.
    value : object
        The value in plain types; a placeholder for a table, before the values in the table.
    """
    if isinstance(value, Mapping) and not isinstance(value, Replaced):
        yield steps, _TABLE
        for key, item in value.items():
            inner_steps = _move_beside_shape((*steps, _escape_surrogates(key)))
            yield from iterate_values(inner_steps, item)
    else:
        yield steps, to_plain_value(value)


def find_changed_keys(changes: Mapping[str, Any]) -> set[str]:
    """Return the keys that changes set.

    Parameters
    ----------
    changes : mapping of str to object
        Changes as in `apply_changes`.

    Returns
    -------
    set of str
        The first two names of each key without indices, such as ``load.force_N``; only the name of
        the table for tables that are replaced.
    """
    keys = set()
    for key, change in changes.items():
        for steps, value in iterate_values(parse_key(key), change):
            if value is not _TABLE:
                names = [step for step in steps if isinstance(step, str)]
                keys.add(".".join(names[:2]))
    return keys


def _apply_change(tables: dict[str, Any], steps: Steps, value: Any, alternative: Any) -> None:
    """Change a single value in the tables of a scene in place.

    Parameters
    ----------
    tables : dict
        The tables of the scene.
    steps : tuple of str and int
        The parsed key.
    value : object
        The new value, or `_TABLE` to make sure that a table is there.
    alternative : object
        New value of the key's alternative (see `set_key`), or None.
    """
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
        for size in node.keys() & _KEYS_OF_A_SHAPE:
            del node[size]
    if steps == ("electrodes", "layout") and node.get("layout") != value:
        for key in node.keys() - _KEYS_OF_EVERY_LAYOUT:
            del node[key]
    set_key(node, last, value, alternative=alternative)


def _require_index_of_list(tables: dict[str, Any], steps: Steps) -> None:
    """Raise if a list of electrodes or probes is addressed by name, or a table by index."""
    section = steps[0]
    if section not in _TABLES_OR_LISTS or len(steps) <= 2:
        return
    entries = tables.get(section) or {}
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
    """Escape unpaired surrogates in a key, since pydantic cannot report errors of such keys."""
    return key.encode("utf-8", "backslashreplace").decode() if isinstance(key, str) else key


def to_plain_value(value: Any) -> Any:
    """Convert models, NumPy values, mappings and tuples to the types that a TOML parser returns."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {_escape_surrogates(key): to_plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain_value(item) for item in value]
    return value
