"""Coercion of function arguments to the types that the functions need.

Arguments are checked for type and limits. As with keys of a scene, the messages name the argument,
its value and what to give instead.
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
    """A result that stores its scene, such as `Solution`, `Modes` or `Response`."""

    @property
    def scene(self) -> Scene:
        """The scene from which the result was computed."""
        ...


SceneLike: TypeAlias = Scene | str | Path | Mapping[str, Any] | HasScene


def _wrap_name_in_tuple(names: Any) -> Any:
    """Return a tuple of a single name; return anything else as it is."""
    return (names,) if isinstance(names, str) else names


#: One or more names; a single name may be given without a tuple.
Names = Annotated[tuple[str, ...], Field(min_length=1), BeforeValidator(_wrap_name_in_tuple)]


class ValuesByName(dict[str, Value]):
    """Values by name; the `KeyError` for an unknown name suggests known names."""

    def __missing__(self, name: Any) -> Value:
        raise KeyError(f"{name!r:.60} is not a valid name; {suggest(name, list(self))}")


def as_scene(scene: SceneLike) -> Scene:
    """Convert an argument to a scene.

    Parameters
    ----------
    scene : Scene, str, Path, mapping or HasScene
        A scene; the path of a scene file; a dict of tables, which change the default scene; or a
        result with the attribute ``scene``.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        If the file or the tables have errors.
    TypeError
        If the argument is not one of these types.
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
    reason = "is not a scene; give a Scene, the path of a scene file or a dict of tables"
    raise TypeError(f"scene = {scene!r:.60}: {reason}")


def as_response(response: T) -> T:
    """Return the argument if it is a response, and raise `TypeError` otherwise.

    Anything with the attribute ``evaluate`` counts as a response.
    """
    if hasattr(response, "evaluate"):
        return response
    reason = "is not a response; give build_response(scene)"
    raise TypeError(format_error("response", response, reason))


def coerce(
    name: str, value: Any, kind: Any, limits: tuple[float, float] | None = None, unit: str = ""
) -> Any:
    """Convert an argument to a type, or raise an error that names the argument.

    Parameters
    ----------
    name : str
        Name of the argument in error messages.
    value : object
        The argument.
    kind : type
        Type of the result. For a class other than numbers, texts and paths, the value must already
        be an instance; for any other type or annotation, pydantic converts the value.
    limits : pair of float, optional
        Minimum and maximum, both allowed; used only with the kinds ``int`` and ``float``.
    unit : str
        Unit of the limits in error messages.

    Returns
    -------
    object
        The value in the type `kind`.

    Raises
    ------
    ValueError
        If the value is invalid. The message has a line for each error.
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
    """Return the cached validator of pydantic that converts values to a type.

    It is cached, because making one takes longer than locating a touch.
    """
    return TypeAdapter(kind)


def coerce_array(
    name: str, value: Any, limits: tuple[float, float] | None = None, unit: str = ""
) -> Array:
    """Convert an argument to an array of numbers, or raise an error that names the argument.

    Parameters
    ----------
    name : str
        Name of the argument in error messages.
    value : array_like
        A number or an array of any shape.
    limits : pair of float, optional
        Minimum and maximum, both allowed. With limits, the array must not be empty; without them,
        infinite numbers and NaN are valid.
    unit : str
        Unit of the limits in error messages.

    Returns
    -------
    ndarray of float
        A copy with the shape of `value`.

    Raises
    ------
    ValueError
        If the value does not consist of integer or real numbers, or one is outside of the limits.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unequal lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iuf":
        reason = "must be a number or an array of numbers; give one of them"
        raise ValueError(format_error(name, value, reason))
    if limits is not None:
        low, high = limits
        is_inside = (low <= array) & (array <= high)
        if not (array.size and np.all(is_inside)):
            advice = f"give numbers from {low:g} to {high:g} {unit}".rstrip()
            raise ValueError(format_error(name, value, f"is out of range; {advice}"))
    return array.astype(float)
