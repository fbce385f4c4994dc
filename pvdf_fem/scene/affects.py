"""What the keys of a scene affect, which tells the scenes that share a solve."""

from __future__ import annotations

from functools import cache
from typing import Any

from pvdf_fem.scene.quantity import Affects, Section

__all__ = ["Affects", "affecting"]


def affecting(table: Section, *effects: Affects) -> dict[str, Any]:
    """The values of a table's keys that affect some of `effects`; lists of such for tables in it.

    Equal dictionaries have equal texts by `repr`.
    """
    found: dict[str, Any] = {}
    for name, effect in _effects(type(table)).items():
        value = getattr(table, name)
        inner = value if isinstance(value, tuple) else (value,)
        if effect is None and inner and isinstance(inner[0], Section):
            found[name] = [affecting(one, *effects) for one in inner]
        elif (effect or Affects.MECHANICS) in effects:
            found[name] = value
    return found


@cache
def _effects(model: type[Section]) -> dict[str, Affects | None]:
    """What a model's keys say that they affect."""
    return {name: model.key_of(name).affects for name in model.model_fields}
