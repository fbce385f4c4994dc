"""Changes to the tables of a scene by dotted key."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

from pvdf_fem.scene.scene_file import problem

# Keys that a shape keeps when it becomes another one.
_PLACE = {"name", "shape", "x_mm", "y_mm", "rotation_deg"}


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
        A complaint for each key that leads through a scalar or past the end of a list.
    """
    changes = {_encodable(key): value for key, value in changes.items()}
    paths = {key: re.split(r"[.[]", key.replace("]", "")) for key in changes}
    problems = []
    # whole sections first, then the keys that decide which other keys there are
    for key in sorted(paths, key=lambda k: (len(paths[k]), paths[k][-1] not in ("shape", "kind"))):
        value = _plain(changes[key])
        try:
            _put(tables, paths[key], value)
        except (AttributeError, LookupError, TypeError, ValueError):
            problems.append(problem(key[:80], value, "leads nowhere; use a key of this scene"))
    return problems


def _put(tables: dict[str, Any], path: list[str], value: Any) -> None:
    node: Any = tables
    for step in path[:-1]:
        node = node[_index(step)] if isinstance(node, list) else node.setdefault(step, {})
    last = path[-1]
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
    if not step.isdecimal():
        raise ValueError(step)
    return int(step)


def _encodable(key: Any) -> Any:
    """A key without unpaired surrogates, which pydantic would not name in its complaint."""
    return key.encode("utf-8", "backslashreplace").decode() if isinstance(key, str) else key


def _plain(value: Any) -> Any:
    """A value as a TOML parser would give it."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {_encodable(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
