"""Arguments in the form that functions need, or refusals with name, value and advice.

Arguments are checked by types and ranges, and refused in sentences, as keys of a scene are.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeAlias, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from pvdf_fem.arrays import Array
from pvdf_fem.scene.changes import to_plain_value
from pvdf_fem.scene.keys import Key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.scene.validation.errors import describe_errors

T = TypeVar("T")
Value = TypeVar("Value")


class HasScene(Protocol):
    """A result of a scene: `Solution`, `Modes`, `Response`."""

    @property
    def scene(self) -> Scene: ...


SceneLike: TypeAlias = Scene | str | Path | Mapping[str, Any] | HasScene
#: One name or more; a single name may stand alone.
Names = Annotated[
    tuple[str, ...],
    Field(min_length=1),
    BeforeValidator(lambda v: (v,) if isinstance(v, str) else v),
]


class ValuesByName(dict[str, Value]):
    """Values by name; an unknown name is refused with the known names."""

    def __missing__(self, name: Any) -> Value:
        raise KeyError(f"{name!r:.60} is not there; {suggest(name, list(self))}")


def as_scene(given: SceneLike) -> Scene:
    """The intended scene: from a path's file, from a dict's tables over the default scene, or from
    a result.

    Raises
    ------
    SceneError
        For a file or tables with mistakes.
    TypeError
        For anything else; the text says what to give.
    """
    if isinstance(given, Scene):
        return given
    if isinstance(given, str | Path):
        return Scene.from_file(given)
    if isinstance(given, Mapping):
        return Scene().with_(given)
    if isinstance(found := getattr(given, "scene", None), Scene):
        return found
    reason = "is no scene; give a Scene, the path of a scene file, a dict of its tables"
    raise TypeError(f"scene = {given!r:.60}: {reason}")


def as_response(given: T) -> T:
    """Return a response, such as that of `build_response`; TypeError for anything else."""
    if hasattr(given, "evaluate"):
        return given
    reason = "must be a response; give build_response(scene)"
    raise TypeError(format_error("response", given, reason))


def coerce(
    name: str, given: Any, kind: Any, limits: tuple[float, float] | None = None, unit: str = ""
) -> Any:
    """An argument with a type, within limits; ValueError, a line for each mistake, otherwise."""
    kind = Annotated[kind, Key(unit, limits)] if kind in (bool, int, float) else kind
    if isinstance(kind, type) and not issubclass(kind, int | float | str | Path):
        if isinstance(given, kind):
            return given
        raise ValueError(format_error(name, given, f"must be a {kind.__name__}; give one"))
    try:
        return _make_adapter(kind).validate_python(to_plain_value(given))
    except ValidationError as error:
        raise ValueError("\n".join(describe_errors(error, name, Scene))) from None


@lru_cache(maxsize=128)
def _make_adapter(kind: Any) -> TypeAdapter[Any]:
    """Make pydantic's validator of a type, which takes longer than a validation."""
    return TypeAdapter(kind)


def coerce_array(
    name: str, given: Any, limits: tuple[float, float] | None = None, unit: str = ""
) -> Array:
    """Numbers as an array of any shape; ValueError for anything else, and out of limits."""
    try:
        found = np.asarray(given)
    except ValueError:  # lists of unequal lengths
        found = np.asarray(None)
    if found.dtype.kind not in "iuf":
        raise ValueError(
            format_error(name, given, "is no number and no array of numbers; give some")
        )
    if limits and not (found.size and np.all((limits[0] <= found) & (found <= limits[1]))):
        wanted = f"give numbers from {limits[0]:g} to {limits[1]:g} {unit}".rstrip()
        raise ValueError(format_error(name, given, f"is out of range; {wanted}"))
    return found.astype(float)
