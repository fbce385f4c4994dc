"""A grid of scenes: a base scene, and axes along which keys vary.

An axis varies one key, or several keys together. In a sweep file and in Python, an axis is a table
of scene keys with their values: a list, or a range of numbers from `start` to `stop`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pvdf_fem.scene.changes import find_changed_keys
from pvdf_fem.scene.drawings.expansion import locate_drawing
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import (
    SceneError,
    format_error,
    parse_toml,
    quote,
    read_scene_text,
    suggest,
)
from pvdf_fem.scene.validation.errors import MAX_ERRORS
from pvdf_fem.studies.sweep_axis import SweepAxis, parse_axes

_SECTIONS = tuple(Scene.model_fields)


@dataclass(frozen=True)
class SceneGrid:
    """All combinations of the values of some keys, as changes to a base scene."""

    scene: Scene  #: Base scene.
    axes: tuple[SweepAxis, ...]  #: Keys that vary, and their values.
    files: tuple[Path, ...] = ()  #: Sweep file and scene file that the grid is read from.

    @classmethod
    def from_tables(cls, scene: Scene, tables: Sequence[Mapping[str, Any]]) -> Self:
        """Make a grid from a table for each axis.

        Parameters
        ----------
        scene : Scene
            Base scene.
        tables : sequence of mapping
            Tables of the keys that vary together along an axis, such as
            ``{"film.thickness_um": [9, 25, 110]}`` or
            ``{"load.force_N": {"start": 0.1, "stop": 10, "count": 5, "spacing": "log"}}``. Keys of
            one axis have equally many values. Instead of dotted keys there may be nested tables.
            ``name`` is the name of the axis; default: the last part of its first key.
            ``{"mapping": {"electrode": "A", "angles_deg": [0, 45]}}`` puts the probe on lines from
            an electrode of the base scene, with ``distances_mm`` and ``reach_mm`` as in
            `MappingScheme`.

        Raises
        ------
        SceneError
            If tables have errors; the exception lists up to `MAX_ERRORS` of them.
        """
        return cls(scene, parse_axes(tables, scene))

    @classmethod
    def from_file(cls, path: Path | str) -> Self:
        """Read a grid from a sweep file.

        Parameters
        ----------
        path : path
            Path of a TOML file. Its key ``scene`` is the path of a scene file, relative to the
            sweep file, or a table with the keys of a scene. Its key ``axes`` is a list of tables as
            in `from_tables`.

        Raises
        ------
        SceneError
            If the sweep file or the scene file has errors; the exception lists up to `MAX_ERRORS`
            of them.
        """
        table = parse_toml(read_scene_text(path), str(path))
        path = Path(path)
        source = table.pop("scene", None)
        tables = table.pop("axes", [])
        errors = []
        for key, value in table.items():
            reason = f"is not a key of a sweep file; {suggest(key, ['scene', 'axes'])}"
            errors.append(format_error(key, value, reason))
        files = [path]
        if isinstance(source, str):
            files.append(path.parent / source)
        scene: Scene | None = None
        try:
            scene = _read_base_scene(source, path.parent)
        except SceneError as error:
            errors += error.problems
        axes: tuple[SweepAxis, ...] = ()
        try:
            axes = parse_axes(tables, scene, str(path))
        except SceneError as error:
            errors += error.problems
        if errors or scene is None:
            raise SceneError(errors[:MAX_ERRORS], str(path))
        return cls(scene, axes, tuple(files))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(axis) for axis in self.axes)

    def scenes(self) -> list[Scene]:
        """Return the scenes in the order of an array with this `shape`: the last axis is fastest.

        To save memory, equal parts of different scenes, such as films, are the same object.

        Raises
        ------
        SceneError
            If scenes have errors. The exception lists up to `MAX_ERRORS` distinct errors of the
            first `MAX_ERRORS` scenes that have errors.
        """
        shared_parts: dict[Any, Any] = {}
        scenes = []
        errors = dict[str, str]()
        wrong_count = 0
        for indices in itertools.product(*map(range, self.shape)):
            changes = self._get_changes(indices)
            try:
                scene = _change_scene(self.scene, changes)
            except SceneError as error:
                for text in error.problems:
                    errors.setdefault(text, _append_changes_to_message(text, changes))
                wrong_count += 1
                if wrong_count == MAX_ERRORS:
                    break
                continue
            scenes.append(_share_scene_parts(scene, shared_parts))
        if errors:
            raise SceneError([*errors.values()][:MAX_ERRORS])
        return scenes

    def _get_changes(self, indices: Sequence[int]) -> dict[str, Any]:
        """Return the changes to the base scene as values by key, for an index along each axis."""
        changes: dict[str, Any] = {}
        for axis, index in zip(self.axes, indices, strict=True):
            changes |= axis[index]
        return changes


def _read_base_scene(source: Any, folder: Path) -> Scene:
    """Read the base scene of a sweep file.

    Parameters
    ----------
    source : str or mapping
        Path of a scene file relative to the folder, or a table with the keys of a scene.
    folder : Path
        Folder of the sweep file.

    Raises
    ------
    SceneError
        If the source is neither a path nor a table, or the scene has errors.
    """
    if isinstance(source, str):
        return Scene.from_file(folder / source)
    if isinstance(source, Mapping):
        return Scene().with_(**locate_drawing(dict(source), folder))
    if source is None:
        raise SceneError(["scene: is required; give the path of a scene file or a table"])
    reason = "must be the path of a scene file or a table; give one of them"
    raise SceneError([format_error("scene", source, reason)])


def _change_scene(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """Return a copy of the scene with changed values, and check that each change has an effect.

    Raises `SceneError` if the changed scene has errors, or if a changed key of the load has no
    effect because each probe has a value of its own.
    """
    changed = scene.with_(**changes)
    unused = changed.find_unused_load_keys(find_changed_keys(changes))
    if unused:
        reason = "varies without effect, since each probe has its own value; remove one of the two"
        raise SceneError(f"{key}: {reason}" for key in unused)
    return changed


def _append_changes_to_message(error: str, changes: Mapping[str, Any]) -> str:
    """Append the changed keys and values to an error message, unless it begins with such a key."""
    if error.partition(" = ")[0] in changes:
        return error
    values = ", ".join(f"{key} = {quote(value)}" for key, value in changes.items())
    return f"{error} (with {values})"


def _share_scene_parts(scene: Scene, shared_parts: dict[Any, Any]) -> Scene:
    """Return an equal scene whose parts are the objects of previous scenes if these are equal.

    Parameters
    ----------
    scene : Scene
        Scene to copy.
    shared_parts : dict
        Parts of previous scenes by name and value. New parts of this scene are added in place.
    """
    parts = {}
    for name in _SECTIONS:
        part = getattr(scene, name)
        parts[name] = shared_parts.setdefault((name, part), part)
    return Scene.model_construct(**parts)
