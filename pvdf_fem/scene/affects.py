"""What the keys of a scene affect, which tells the scenes that share a solve."""

from __future__ import annotations

from enum import Enum, auto
from functools import cache
from typing import Any

from pvdf_fem.scene.quantity import Section


class Affects(Enum):
    """What a key affects: a mark in the type of its field, ``Annotated[float, Affects.READING]``.

    A key without a mark affects the mechanics. The mark of a table holds for all its keys.
    """

    MECHANICS = auto()  #: The deformation of the film.
    OUTLINE = auto()  #: The mechanics, through nothing but the outline of a shape.
    STRAIN_AT_REST = auto()  #: The mechanics, through the strain at rest of an even film.
    SCALE = auto()  #: The mechanics of a membrane, through nothing but force over thickness.
    READING = auto()  #: The charge that a stress makes.
    DYNAMICS = auto()  #: Motions of the film, and how fast a warm probe heats the film.
    INSTRUMENT = auto()  #: What a charge is read as, and from where places are counted.


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
    """The marks of a model's keys."""
    return {
        name: next((mark for mark in field.metadata if isinstance(mark, Affects)), None)
        for name, field in model.model_fields.items()
    }
