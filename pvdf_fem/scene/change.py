"""Changes to the tables of a scene by dotted key."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from pydantic import BaseModel

from pvdf_fem.scene.outlines.shape import HEAT
from pvdf_fem.scene.scene_file import problem
from pvdf_fem.scene.shapes import Bonded

# Keys that a shape keeps when it becomes another one, alone or all around a ring.
_PLACE = {"name", "shape", "x_mm", "y_mm", "rotation_deg"}
_PLACE |= {"layout", "count", "ring_radius_mm", "first_angle_deg", "centre"}
_PLACE |= {"force_N", "tangential_N", "load", *HEAT, *Bonded.model_fields}
# Keys that electrodes keep when their layout becomes another one.
_OF_ALL_LAYOUTS = {"layout", "ring_radius_mm", "side_mm"}
# Keys that decide which other keys there are, in the order in which they are changed.
_FIRST = ("layout", "shape", "kind")
# Keys of which one takes the place of the other.
_RIVALS = {"temperature_change_K": "pretension_N_m", "pretension_N_m": "temperature_change_K"}
_KEY = re.compile(r"[^.[\]]+(?:\.[^.[\]]+|\[[0-9]{1,9}\])*")
#: What a key is told that addresses an entry of a table, or a key of a list.
_BY_INDEX = {
    name: f"{them} are addressed by index in a list [[{name}]], as in {name}[0].x_mm"
    for name, them in {"electrodes": "electrodes", "probe": "probes"}.items()
}


@lru_cache(maxsize=1024)
def steps_of(key: str) -> tuple[Any, ...]:
    """The names and the indices, as int, that a dotted key consists of; none if it is no key."""
    steps = re.findall(r"[^.[\]]+", key) if _KEY.fullmatch(key) else []
    return tuple(int(step) if re.fullmatch("[0-9]{1,9}", step) else step for step in steps)


def number_at(scene: Any, key: str) -> float:
    """The number that a scene has by a key."""
    value = scene
    for step in steps_of(key):
        value = value[step] if isinstance(step, int) else getattr(value, step)
    return float(value)


def spelled(key: str) -> str:
    """The one spelling of a key: ``electrodes.0.x_mm`` becomes ``electrodes[0].x_mm``."""
    rest = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps_of(key))
    return "".join(rest).removeprefix(".") or key


def change(tables: dict[str, Any], changes: Mapping[str, Any]) -> list[str]:
    """Replace values of tables in place, by key such as ``load.force_N``, ``probe[0].x_mm``. Tables
    on the way are made. It returns a complaint for each key that leads nowhere, or that another one
    spells otherwise."""
    changes = {_encodable(key): value for key, value in changes.items()}
    keys: dict[tuple[Any, ...], str] = {}
    problems = []
    for key, value in changes.items():
        steps = steps_of(key)
        if not steps:
            reason = "is no key; write one such as film.radius_mm or electrodes[0].x_mm"
            problems.append(problem(key[:80] or '""', value, reason))
        elif keys.setdefault(steps, key) != key:
            reason = f"is the same key as {keys[steps]}; remove one"
            problems.append(problem(key[:80], value, reason))
    # whole sections first, then the keys that decide which other keys there are
    for steps in sorted(keys, key=lambda s: (len(s), [*_FIRST, s[-1]].index(s[-1]))):
        key = keys[steps]
        try:
            _put(tables, steps, value := plain(changes[key]))
            rival = _RIVALS.get(steps[-1])
            if rival and value is not None and ("film", rival) not in keys:
                tables["film"].pop(rival, None)
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            told = [text for text in _BY_INDEX.values() if text in error.args]
            reason = told[0] if told else "leads nowhere; use a key of this scene"
            problems.append(problem(key[:80], changes[key], reason))
    return problems


def _put(tables: dict[str, Any], steps: tuple[Any, ...], value: Any) -> None:
    node: Any = tables
    if steps[0] in _BY_INDEX and len(steps) > 2:
        entries = node.get(steps[0]) or {}
        listed = isinstance(entries, list)
        if not (isinstance(steps[1], int) if listed else steps[1] in entries):
            raise ValueError(_BY_INDEX[steps[0]])
    for step in steps[:-1]:
        node = node[step] if isinstance(node, list) else node.setdefault(str(step), {})
    last = steps[-1] if isinstance(node, list) else str(steps[-1])
    if last == "shape" and node.get("shape") != value:
        for size in node.keys() - _PLACE:
            del node[size]
    if steps == ("electrodes", "layout") and node.get("layout") != value:
        for key in node.keys() - _OF_ALL_LAYOUTS:
            del node[key]
    if last == "kind" and value != "rigid":
        node.pop("contact", None)
        node.pop("tilt", None)
    if last == "kind" and value != "contact":
        node.pop("depth_mm", None)
        node.pop("friction", None)
    if last == "depth_mm" and value is not None:
        node.pop("force_N", None)
    if last == "force_N":
        node.pop("depth_mm", None)
    node[last] = value


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
