"""What may be given where a scene is asked for: a scene, its file, its tables, or a result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from pvdf_fem.scene.scene import Scene


class HasScene(Protocol):
    """A result of a scene: `Solution`, `Modes`, `Response`."""

    @property
    def scene(self) -> Scene: ...


SceneLike: TypeAlias = Scene | str | Path | Mapping[str, Any] | HasScene


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
        return Scene().with_(**given)
    if isinstance(found := getattr(given, "scene", None), Scene):
        return found
    told = f"scene = {given!r:.60}: is no scene"
    raise TypeError(f"{told}; give a Scene, the path of a scene file, a dict of its tables")
