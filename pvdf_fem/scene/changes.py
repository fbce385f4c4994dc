"""Changes to the tables of a scene by dotted key."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from pydantic import BaseModel

from pvdf_fem.scene.registry import ALTERNATIVE_KEYS, FORCE_KEYS, set_key
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.scene.shapes import LAYOUTS, RING, SIZES

# Keys that decide which further keys exist, in order of change.
_FIRST = ("layout", "shape", "kind", "profile")
# The change of a table key; the table's keys are changes themselves.
_TABLE = object()
_KEY = re.compile(r"[^.[\]]+(?:\.[^.[\]]+|\[[0-9]{1,9}\])*")
#: Complaint about a key that addresses a table's entry, or a list's key.
_BY_INDEX = {
    name: f"{them} are addressed by index in a list [[{name}]], as in {name}[0].x_mm"
    for name, them in {"electrodes": "electrodes", "probe": "probes"}.items()
}


class Replaced(dict[str, Any]):
    """A table that replaces a whole table in the scene. Missing keys get their defaults. Other
    tables are merged.

    Examples
    --------
    >>> scene = Scene.example("triangle").with_(film=Replaced(thickness_um=12.0))
    """


@lru_cache(maxsize=1024)
def parse_key(key: str) -> tuple[Any, ...]:
    """Names and indices (int) in a dotted key; none if it is no key."""
    steps = re.findall(r"[^.[\]]+", key) if _KEY.fullmatch(key) else []
    return _beside(int(step) if re.fullmatch("[0-9]{1,9}", step) else step for step in steps)


def _beside(steps: Iterable[Any]) -> tuple[Any, ...]:
    """The steps to a key; steps to the force of a listed probe lead beside the probe's shape."""
    match steps := tuple(steps):
        case ("probe", int(), "load", key, *_) if key in FORCE_KEYS:
            return steps[:2] + steps[3:]
    return steps


def get_number(scene: Any, key: str) -> float:
    """The number that a scene has by a key."""
    value = scene
    for step in parse_key(key):
        value = value[step] if isinstance(step, int) else getattr(value, step)
    return float(value)


def normalize_key(key: str) -> str:
    """The canonical spelling of a key: ``electrodes.0.x_mm`` becomes ``electrodes[0].x_mm``."""
    rest = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in parse_key(key))
    return "".join(rest).removeprefix(".") or key


def apply_changes(tables: dict[str, Any], given: Any, named: Mapping[str, Any]) -> list[str]:
    """Change values in tables in place, by keys like ``load.force_N`` or ``probe[0].x_mm``, with a
    dict or None, and with keywords. Tables among the values are merged, and tables on the way are
    made. Returns complaints about keys that lead nowhere or are changed twice."""
    if not isinstance(given, Mapping | None):
        reason = 'must be a dict of keys with their values; give {"load.force_N": 2}'
        return [format_error("changes", given, reason)]
    changes = {**(given or {}), **named}
    found: dict[tuple[Any, ...], tuple[str, Any]] = {}
    problems = []
    for name, given in changes.items():
        key = _encodable(name)
        if not (whole := parse_key(key) if isinstance(key, str) else ()):
            reason = "is no key; write one such as film.radius_mm or electrodes[0].x_mm"
            problems.append(format_error(str(key)[:80] or '""', given, reason))
        for steps, value in iterate_values(whole, given) if whole else ():
            told = ".".join([key, *map(str, steps[len(whole) :])])[:80]
            if steps in found:
                reason = f"is the same key as {found[steps][0]}; remove one"
                problems.append(format_error(told, given, reason))
            found.setdefault(steps, (told, value))
    # whole sections first, then keys that decide which further keys exist
    for steps in sorted(found, key=lambda s: (len(s), [*_FIRST, s[-1]].index(s[-1]))):
        told, value = found[steps]
        _, rival = found.get((*steps[:-1], ALTERNATIVE_KEYS.get(steps[-1])), ("", None))
        try:
            _put(tables, steps, value, rival)
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            indexed = [text for text in _BY_INDEX.values() if text in error.args]
            reason = indexed[0] if indexed else "leads nowhere; use a key of this scene"
            problems.append(format_error(told, {} if value is _TABLE else value, reason))
    return list(dict.fromkeys(problems))


def iterate_values(steps: tuple[Any, ...], value: Any) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Steps and value of a change; a merged table is followed by the changes of its keys."""
    if isinstance(value, Mapping) and not isinstance(value, Replaced):
        yield steps, _TABLE
        for key, item in value.items():
            yield from iterate_values(_beside((*steps, _encodable(key))), item)
    else:
        yield steps, to_plain_value(value)


def find_changed_keys(changes: Mapping[str, Any]) -> set[str]:
    """Keys named by changes, ``load.force_N``, and replaced sections."""
    every = (
        leaf for key, value in changes.items() for leaf in iterate_values(parse_key(key), value)
    )
    found = (steps for steps, value in every if value is not _TABLE)
    return {".".join([step for step in steps if isinstance(step, str)][:2]) for steps in found}


def _put(tables: dict[str, Any], steps: tuple[Any, ...], value: Any, rival: Any) -> None:
    """Change a value; `rival` is the new value of the key's rival, or None."""
    node: Any = tables
    if steps[0] in _BY_INDEX and len(steps) > 2:
        entries = node.get(steps[0]) or {}
        listed = isinstance(entries, list)
        if not (isinstance(steps[1], int) if listed else steps[1] in entries):
            raise ValueError(_BY_INDEX[steps[0]])
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
        for size in node.keys() & SIZES:
            del node[size]
    if steps == ("electrodes", "layout") and node.get("layout") != value:
        for key in node.keys() - (LAYOUTS["square"].model_fields.keys() - RING):
            del node[key]
    set_key(node, last, value, rival)


def _encodable(key: Any) -> Any:
    """A key without unpaired surrogates, which pydantic would not name in its complaint."""
    return key.encode("utf-8", "backslashreplace").decode() if isinstance(key, str) else key


def to_plain_value(value: Any) -> Any:
    """A value in the form from a TOML parser."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {_encodable(key): to_plain_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain_value(item) for item in value]
    return value
