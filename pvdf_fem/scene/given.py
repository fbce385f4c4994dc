"""What is given to functions, as they need it, or refused with name, value and what to give.

A scene may be given as a scene, its file, its tables or a result; numbers as anything that numpy
takes for them, but no texts; a single text where texts are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import choose

T = TypeVar("T")
Value = TypeVar("Value")


class HasScene(Protocol):
    """A result of a scene: `Solution`, `Modes`, `Response`."""

    @property
    def scene(self) -> Scene: ...


SceneLike: TypeAlias = Scene | str | Path | Mapping[str, Any] | HasScene


class Named(dict[str, Value]):
    """Values by name; a name that is none is refused with the names that there are."""

    def __missing__(self, name: Any) -> Value:
        raise KeyError(f"{name!r:.60} is not there; {choose(name, list(self))}")


def scene_of(given: SceneLike) -> Scene:
    """The scene that is meant: of a path its file's, of a dict the default scene with the dict's
    tables, of a result the result's own.

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
        return Scene.load(given)
    if isinstance(given, Mapping):
        return Scene().with_(given)
    if isinstance(found := getattr(given, "scene", None), Scene):
        return found
    wanted = "a Scene, the path of a scene file, a dict of its tables, or a result"
    raise TypeError(refused("scene", given, "is no scene", wanted))


def refused(name: str, given: Any, reason: str, wanted: str) -> str:
    """The sentence about what is given and cannot be used."""
    return f"{name} = {given!r:.60}: {reason}; give {wanted}"


def instance(name: str, given: Any, kind: type[T], wanted: str) -> T:
    """An object of a kind; TypeError for others, which says what is `wanted`."""
    if isinstance(given, kind):
        return given
    raise TypeError(refused(name, given, f"is no {kind.__name__}", wanted))


def numbers(
    name: str, given: Any, least: float = -math.inf, most: float = math.inf, unit: str = ""
) -> Array:
    """Numbers as an array of any shape, within limits where there are any; TypeError for texts,
    None and ragged lists, ValueError for numbers out of range."""
    span = f" from {least:g} to {most:g}" if math.isfinite(most) else f" of at least {least:g}"
    bounded = math.isfinite(least) or math.isfinite(most)
    wanted = f"numbers{span if bounded else ''} {unit}".rstrip()
    try:
        found = np.asarray(given)
    except ValueError:  # lists of unequal lengths
        found = np.asarray(None)
    if found.dtype.kind not in "iuf":
        raise TypeError(refused(name, given, "is no number and no array of numbers", wanted))
    values = found.astype(float)
    if bounded and not np.all((least <= values) & (values <= most)):
        raise ValueError(refused(name, given, "is out of range", wanted))
    return values


def number(
    name: str, given: Any, least: float = -math.inf, most: float = math.inf, unit: str = ""
) -> float:
    """A single one of `numbers`."""
    if np.shape(values := numbers(name, given, least, most, unit)):
        raise TypeError(refused(name, given, "is no single number", f"one {unit}".rstrip()))
    return float(values)


def whole(name: str, given: Any, least: int, most: int) -> int:
    """A whole number within limits."""
    value = number(name, given, least, most)
    if value != int(value):
        raise ValueError(refused(name, given, "is no whole number", f"{least} to {most}"))
    return int(value)


def texts(name: str, given: Any) -> tuple[str, ...]:
    """Texts, of which a single one may be given by itself."""
    found = (given,) if isinstance(given, str) else given
    found = tuple(found) if isinstance(found, Iterable) else (None,)
    if all(isinstance(text, str) for text in found):
        return found
    raise TypeError(refused(name, given, "is no list of names", f'["{name}", ...]'))


def path_of(name: str, given: Any) -> Path:
    """The path of a file."""
    if isinstance(given, str | Path):
        return Path(given)
    raise TypeError(refused(name, given, "is no path", "the name of a file"))
