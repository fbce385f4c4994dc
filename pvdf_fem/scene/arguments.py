"""Coercion of arguments to the types that functions need.

Arguments are checked by type and limits, and refused with name, value and advice, as keys of a
scene are.
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
    def scene(self) -> Scene:
        """The scene of the result."""
        ...


SceneLike: TypeAlias = Scene | str | Path | Mapping[str, Any] | HasScene


def _as_tuple(names: Any) -> Any:
    """Put a single name into a tuple."""
    return (names,) if isinstance(names, str) else names


#: One name or more; a single name may stand alone.
Names = Annotated[tuple[str, ...], Field(min_length=1), BeforeValidator(_as_tuple)]


class ValuesByName(dict[str, Value]):
    """Values by name; an unknown name raises `KeyError` with the known names."""

    def __missing__(self, name: Any) -> Value:
        raise KeyError(f"{name!r:.60} is not there; {suggest(name, list(self))}")


def as_scene(scene: SceneLike) -> Scene:
    """Return the scene that an argument stands for.

    Parameters
    ----------
    scene : Scene, str, path, mapping or result
        A scene, the path of a scene file, tables of a scene, which change the default scene, or a
        result with a scene.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        For a file or tables with errors.
    TypeError
        For anything else; the text says what to give.
    """
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, str | Path):
        return Scene.from_file(scene)
    if isinstance(scene, Mapping):
        return Scene().with_(scene)
    scene_of_result = getattr(scene, "scene", None)
    if isinstance(scene_of_result, Scene):
        return scene_of_result
    reason = "is not a scene; give a Scene, the path of a scene file, a dict of its tables"
    raise TypeError(f"scene = {scene!r:.60}: {reason}")


def as_response(response: T) -> T:
    """Return a response from `build_response`; raise `TypeError` for anything else."""
    if hasattr(response, "evaluate"):
        return response
    reason = "is not a response; give build_response(scene)"
    raise TypeError(format_error("response", response, reason))


def coerce(
    name: str, value: Any, kind: Any, limits: tuple[float, float] | None = None, unit: str = ""
) -> Any:
    """Coerce an argument to a type.

    Parameters
    ----------
    name : str
        Name of the argument in errors.
    value : object
        The value.
    kind : type
        A type that pydantic validates, or any class of which the value has to be an instance.
    limits : pair of float, optional
        Least and largest number.
    unit : str
        Unit of the limits in errors.

    Returns
    -------
    object

    Raises
    ------
    ValueError
        With a line for each error.
    """
    if kind in (bool, int, float):
        kind = Annotated[kind, Key(unit, limits)]
    elif isinstance(kind, type) and not issubclass(kind, int | float | str | Path):
        if isinstance(value, kind):
            return value
        raise ValueError(format_error(name, value, f"must be a {kind.__name__}; give one"))
    try:
        return _make_validator(kind).validate_python(to_plain_value(value))
    except ValidationError as error:
        raise ValueError("\n".join(describe_errors(error, name, Scene))) from None


@lru_cache(maxsize=128)
def _make_validator(kind: Any) -> TypeAdapter[Any]:
    """Make pydantic's validator of a type, which takes longer than `locate` does otherwise."""
    return TypeAdapter(kind)


def coerce_array(
    name: str, value: Any, limits: tuple[float, float] | None = None, unit: str = ""
) -> Array:
    """Coerce an argument to an array of numbers.

    Parameters
    ----------
    name : str
        Name of the argument in errors.
    value : number or array of any shape
        The value.
    limits : pair of float, optional
        Least and largest number; then the array must not be empty.
    unit : str
        Unit of the limits in errors.

    Returns
    -------
    array of float

    Raises
    ------
    ValueError
        For anything else than numbers within the limits.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unequal lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iuf":
        reason = "is neither a number nor an array of numbers; give one"
        raise ValueError(format_error(name, value, reason))
    if limits is not None:
        low, high = limits
        is_inside = (low <= array) & (array <= high)
        if not (array.size and np.all(is_inside)):
            advice = f"give numbers from {low:g} to {high:g} {unit}".rstrip()
            raise ValueError(format_error(name, value, f"is out of range; {advice}"))
    return array.astype(float)
