"""Changes to the tables of a scene by dotted key."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from pydantic import BaseModel

from pvdf_fem.scene.scene_file import problem

# Keys that a shape keeps when it becomes another one.
_PLACE = {"name", "shape", "x_mm", "y_mm", "rotation_deg"}
_KEY = re.compile(r"[^.[\]]+(?:\.[^.[\]]+|\[[0-9]{1,9}\])*")
_INDEX = re.compile("[0-9]{1,9}")
_BY_INDEX = "electrodes are addressed by index in a list [[electrodes]], as in electrodes[0].x_mm"


@lru_cache(maxsize=1024)
def steps_of(key: str) -> tuple[str, ...]:
    """The names and indices that a dotted key consists of; none if it is no key."""
    if not _KEY.fullmatch(key):
        return ()
    steps = re.findall(r"[^.[\]]+", key)
    return tuple(str(int(step)) if _INDEX.fullmatch(step) else step for step in steps)


def spelled(key: str) -> str:
    """The one spelling of a key: ``electrodes.0.x_mm`` becomes ``electrodes[0].x_mm``."""
    steps = steps_of(key)
    if not steps:
        return key
    rest = (f"[{step}]" if _INDEX.fullmatch(step) else f".{step}" for step in steps[1:])
    return steps[0] + "".join(rest)


def change(tables: dict[str, Any], changes: Mapping[str, Any]) -> list[str]:
    """Replace values of the tables in place.

    Parameters
    ----------
    tables : dict
        Tables, lists and scalars.
    changes : mapping
        New values by key, such as ``load.force_N``, ``electrodes[0].x_mm``,
        ``electrodes.0.x_mm`` or ``probe``; tables on the way are made.

    Returns
    -------
    list of str
        A complaint for each key that leads through a scalar or past the end of a list, and for
        each that another one spells otherwise.
    """
    changes = {_encodable(key): value for key, value in changes.items()}
    keys: dict[tuple[str, ...], str] = {}
    problems = []
    for key, value in changes.items():
        steps = steps_of(key)
        if not steps:
            reason = "is no key; write one such as film.radius_mm or electrodes[0].x_mm"
            problems.append(problem(key[:80], value, reason))
        elif keys.setdefault(steps, key) != key:
            reason = f"is the same key as {keys[steps]}; remove one"
            problems.append(problem(key[:80], value, reason))
    # whole sections first, then the keys that decide which other keys there are
    for steps in sorted(keys, key=lambda steps: (len(steps), steps[-1] not in ("shape", "kind"))):
        key = keys[steps]
        try:
            _put(tables, steps, plain(changes[key]))
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            by_index = _BY_INDEX in error.args
            reason = _BY_INDEX if by_index else "leads nowhere; use a key of this scene"
            problems.append(problem(key[:80], changes[key], reason))
    return problems


def _put(tables: dict[str, Any], steps: tuple[str, ...], value: Any) -> None:
    node: Any = tables
    by_index = isinstance(node.get("electrodes"), list) and _INDEX.fullmatch("".join(steps[1:2]))
    if steps[0] == "electrodes" and len(steps) > 2 and not by_index:
        raise ValueError(_BY_INDEX)
    for step in steps[:-1]:
        node = node[_index(step)] if isinstance(node, list) else node.setdefault(step, {})
    last = steps[-1]
    if isinstance(node, list):
        node[_index(last)] = value
        return
    if last == "shape" and node.get("shape") != value:
        for size in node.keys() - _PLACE:
            del node[size]
    if last == "kind" and value != "rigid":
        node.pop("contact", None)
    node[last] = value


def _index(step: str) -> int:
    if not _INDEX.fullmatch(step):
        raise ValueError(step)
    return int(step)


def _encodable(key: Any) -> Any:
    """A key without unpaired surrogates, which pydantic would not name in its complaint."""
    return key.encode("utf-8", "backslashreplace").decode() if isinstance(key, str) else key


def plain(value: Any) -> Any:
    """A value as a TOML parser would give it."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {_encodable(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
