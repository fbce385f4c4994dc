"""A grid of scenes: a base scene, and axes along which keys vary.

An axis varies one key, or several together. In a sweep file and in Python an axis is a table with
keys of the scene and their values: a list, or numbers from `start` to `stop`.
"""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError

from pvdf_fem.scene.changes import find_changed_keys, normalize_key, parse_key, to_plain_value
from pvdf_fem.scene.keys import Finite, Length, Number, Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import (
    SceneError,
    format_error,
    parse_toml,
    quote,
    read_scene_text,
    suggest,
)
from pvdf_fem.scene.validation.errors import MAX_ERRORS, describe_errors
from pvdf_fem.studies.mapping_scheme import MappingScheme

MOST_SCENES = 1_000_000  #: Largest number of scenes in a grid.
#: Largest number of axes; numpy's arrays have at most 64 dimensions, including `electrode`.
MOST_AXES = 63
#: Names of the dataset's own variables, and of its dimension of electrodes.
RESERVED_NAMES = {"charge_pC", "charge_error_pC", "deflection_max_mm", "status"}
RESERVED_NAMES |= {
    f"{of}{end}_pC" for of in ("rest_charge", "charge_change") for end in ("", "_error")
}
RESERVED_NAMES |= {"reading_V", "electrode"}
_TOO_MANY = f"at most {MOST_SCENES} are allowed, give fewer values"
_SECTIONS = tuple(Scene.model_fields)
# NetCDF keeps some names for itself; texts have a dimension such as `string4`.
_RESERVED = r"(byte|char|u?short|u?int(64)?|float|real|double|bool|string\d*)"
_NAME = re.compile(rf"(?!{_RESERVED}$)\w[^/']{{0,59}}(?<! )")


class ValueRange(Section):
    """`count` numbers from `start` to `stop`, both included, with equal steps or equal ratios."""

    start: Finite
    stop: Finite
    count: Annotated[int, Field(strict=True, ge=2, le=MOST_SCENES)]
    spacing: Literal["linear", "log"] = "linear"

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[float]:  # type: ignore[override]
        space = np.linspace if self.spacing == "linear" else np.geomspace
        return iter(space(self.start, self.stop, self.count).tolist())


class MappingLines(Section):
    """The places of `pvdf_fem.studies.mapping_scheme.MappingScheme`, on the base scene."""

    electrode: str
    angles_deg: tuple[Number, ...] = Field(min_length=1)
    distances_mm: tuple[Annotated[Finite, Field(ge=0.0)], ...] = tuple(4.0 * i for i in range(8))
    reach_mm: Length = 20.0


@dataclass(frozen=True)
class SweepAxis:
    """A dimension of a grid."""

    name: str
    values: Mapping[str, tuple[Any, ...]]  #: For each key of the scene its values along the axis.
    #: Further coordinates along the axis, without scene keys.
    beside: Mapping[str, tuple[float, ...]]

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    @property
    def expanded(self) -> SweepAxis:
        """The axis with the numbers of its ranges."""
        return replace(self, values={key: tuple(along) for key, along in self.values.items()})

    def __getitem__(self, index: int) -> dict[str, Any]:
        """The changes to the base scene at an index of the axis."""
        return {key: values[index] for key, values in self.values.items()}


@dataclass(frozen=True)
class SceneGrid:
    """A base scene, its axes, and their files; see `SceneGrid.from_tables`."""

    scene: Scene
    axes: tuple[SweepAxis, ...]
    files: tuple[Path, ...] = ()

    @classmethod
    def from_tables(cls, scene: Scene, axes: Sequence[Mapping[str, Any]], source: str = "") -> Self:
        """A grid from tables by axis.

        A table has the keys that vary together, such as ``{"film.thickness_um": [9, 25, 110]}`` or
        ``{"load.force_N": {"start": 0.1, "stop": 10, "count": 5, "spacing": "log"}}``; several keys
        take lists of one length. Keys may be nested tables too. ``name`` is the name of the axis,
        by default the last part of its first key. ``{"mapping": {"electrode": "A", "angles_deg":
        [0, 45]}}`` puts the probe on lines from an electrode of the base scene, with
        ``distances_mm`` and ``reach_mm`` as in `MappingScheme`. Raises `SceneError` with every
        mistake and `source` as file name.
        """
        return cls(scene, _axes(axes, scene, source))

    @classmethod
    def from_file(cls, path: Path | str) -> Self:
        """The grid of a sweep file.

        Its key `scene` is the path of a scene file, relative to the sweep file, or a table; its
        key `axes` holds tables as in `of`. Raises `SceneError` with every mistake in both files.
        """
        table, path = parse_toml(read_scene_text(path), str(path)), Path(path)
        given, axes = table.pop("scene", None), table.pop("axes", [])
        problems = [
            format_error(
                key, value, f"is no key of a sweep file; {suggest(key, ['scene', 'axes'])}"
            )
            for key, value in table.items()
        ]
        scene: Scene | None = None
        files = [path]
        try:
            if isinstance(given, str):
                files.append(path.parent / given)
                scene = Scene.from_file(files[-1])
            elif isinstance(given, Mapping):
                scene = Scene().with_(**given)
            else:
                reason = "must be the path of a scene file or a table; give one"
                problems.append(
                    format_error("scene", "(nothing)" if given is None else given, reason)
                )
        except SceneError as error:
            problems += error.problems
        try:
            read = _axes(axes, scene, str(path))
        except SceneError as error:
            problems += error.problems
        if problems or scene is None:
            raise SceneError(problems[:MAX_ERRORS], str(path))
        return cls(scene, read, tuple(files))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(axis) for axis in self.axes)

    def scenes(self) -> list[Scene]:
        """The scenes, in the order of an array of `shape`: the last axis varies fastest.

        Scenes share objects for equal films and further equal parts, to save memory. Raises
        `SceneError` with the distinct mistakes in the first `MAX_ERRORS` wrong scenes.
        """
        known: dict[Any, Any] = {}
        scenes, problems, refused = [], dict[str, str](), 0
        for indices in itertools.product(*map(range, self.shape)):
            changes: dict[str, Any] = {}
            for axis, index in zip(self.axes, indices, strict=True):
                changes |= axis[index]
            try:
                scene = self.scene.with_(**changes)
                if find_unused_load_keys := scene.find_unused_load_keys(find_changed_keys(changes)):
                    reason = "varies, and each probe says its own; remove one of the two"
                    raise SceneError(f"{key}: {reason}" for key in find_unused_load_keys)
            except SceneError as error:
                where = ", ".join(f"{key} = {quote(value)}" for key, value in changes.items())
                for text in error.problems:
                    # the varied key is named beside the key that does not fit
                    own = text.partition(" = ")[0] in changes
                    problems.setdefault(text, text if own else f"{text} (with {where})")
                refused += 1
                if refused == MAX_ERRORS:
                    break
                continue
            sections = ((name, getattr(scene, name)) for name in _SECTIONS)
            shared = {name: known.setdefault((name, value), value) for name, value in sections}
            scenes.append(Scene.model_construct(**shared))
        if problems:
            raise SceneError([*problems.values()][:MAX_ERRORS])
        return scenes


def _axes(
    axes: Sequence[Mapping[str, Any]], scene: Scene | None, source: str
) -> tuple[SweepAxis, ...]:
    """The axes described by tables. Without a scene, whose own mistakes are told, the lines of a
    mapping are not placed."""
    if not isinstance(axes, list | tuple) or not all(isinstance(a, Mapping) for a in axes):
        reason = 'must be a list of tables, [{"load.force_N": [1, 2]}]; in a file of [[axes]]'
        raise SceneError([format_error("axes", axes, reason)], source)
    if not axes:
        raise SceneError(["axes = (nothing): is required; add a table [[axes]]"], source)
    if len(axes) > MOST_AXES:
        reason = f"is the number of axes; at most {MOST_AXES} are allowed, put keys together"
        raise SceneError([format_error("axes", len(axes), reason)], source)
    problems: list[str] = []
    read = [_axis(f"axes[{i}]", table, scene, problems) for i, table in enumerate(axes)]
    valid = [axis for axis in read if axis]
    if not problems:
        problems += list(_clashes(valid)) or _overridden(valid)
    if problems:
        raise SceneError(problems[:MAX_ERRORS], source)
    return tuple(axis.expanded for axis in valid)


def _axis(
    where: str, table: Mapping[str, Any], scene: Scene | None, problems: list[str]
) -> SweepAxis | None:
    """The axis described by a table; None after mistakes, which join `problems`."""
    count = len(problems)
    varied = dict(table)
    name = varied.pop("name", None)
    if name is not None and not _is_name(name):
        reason = "is no name that NetCDF can hold; give at most 60 letters, digits and _"
        problems.append(format_error(f"{where}.name", name, reason))
    if "mapping" in varied:
        lines = varied.pop("mapping")
        if varied:
            reason = "cannot vary together with a mapping; give it an axis of its own"
            problems += [
                format_error(f"{where}.{key}", value, reason) for key, value in _flat(varied)
            ]
        return _mapping_axis(f"{where}.mapping", lines, scene, name or "place", problems)
    values: dict[str, Any] = {}
    for key, value in _flat(varied):
        if normalize_key(key) in values:
            again = "is the same key as one before; remove one"
            problems.append(format_error(f"{where}.{key}", value, again))
        values[normalize_key(key)] = _values(f"{where}.{key}", value, problems)
    lengths = {key: len(along) for key, along in values.items()}
    if not values:
        problems.append(f"{where} = (nothing): has no key of a scene; add one, with its values")
    elif len(problems) == count and len(set(lengths.values())) > 1:
        text = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        problems.append(f"{where}: {text} values; give keys that vary together equally many")
    if len(problems) > count:
        return None
    return SweepAxis(name or next(iter(values)).split(".")[-1], values, {})


def _is_name(name: Any) -> bool:
    """Whether a dimension and a variable of a NetCDF file can have a name."""
    if not isinstance(name, str) or not unicodedata.is_normalized("NFC", name):
        return False
    return name.isprintable() and _NAME.fullmatch(name) is not None


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The dotted keys of nested tables, down to lists and ranges."""
    for key, value in table.items():
        if isinstance(value, Mapping) and not {"start", "stop", "count"} & value.keys():
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _values(where: str, value: Any, problems: list[str]) -> tuple[Any, ...] | ValueRange:
    """The values of a key along an axis; empty after mistakes, which join `problems`."""
    if isinstance(value, Mapping):
        try:
            numbers = ValueRange.model_validate(value)
        except ValidationError as error:
            problems += describe_errors(error, where, ValueRange)
            return ()
        if numbers.spacing == "log" and not numbers.start * numbers.stop > 0.0:
            reason = "both ends of equal ratios need one sign, and not 0; change them or spacing"
            problems.append(format_error(f"{where}.start", numbers.start, reason))
            return ()
        return numbers
    if not isinstance(value, list | tuple | np.ndarray) or not len(value):
        reason = "must be a list, or a table of start, stop and count; put it in brackets"
        problems.append(format_error(where, value, reason))
        return ()
    return tuple(to_plain_value(value))


def _mapping_axis(
    where: str, value: Any, scene: Scene | None, name: str, problems: list[str]
) -> SweepAxis | None:
    try:
        lines = MappingLines.model_validate(value)
        if (count := len(lines.angles_deg) * len(lines.distances_mm)) > MOST_SCENES:
            raise ValueError(f"angles_deg: make {count} places; {_TOO_MANY}")
        if scene is None:
            return None
        scheme = MappingScheme(scene, **lines.model_dump())
    except ValidationError as error:
        problems += describe_errors(error, where, MappingLines)
        return None
    except ValueError as error:
        problems.append(f"{where}.{error}")
        return None
    places = np.concatenate(scheme.positions_mm)
    lengths = [len(line) for line in scheme.positions_mm]
    distances = np.linalg.norm(places - scheme.centre_mm, axis=1)
    keys = {"probe.x_mm": tuple(places[:, 0].tolist()), "probe.y_mm": tuple(places[:, 1].tolist())}
    beside = {
        "angle_deg": tuple(np.repeat(lines.angles_deg, lengths).tolist()),
        "distance_mm": tuple(distances.tolist()),
    }
    return SweepAxis(name, keys, beside)


def _clashes(axes: Sequence[SweepAxis]) -> Iterator[str]:
    """Complaints about names and keys that two axes have, and about a grid that is too large."""
    names, keys = set[str](), set[str]()
    coordinates = {name for axis in axes for name in (*axis.values, *axis.beside)}
    for i, axis in enumerate(axes):
        if axis.name in names:
            reason = "an axis before has this name; name the axis"
            yield format_error(f"axes[{i}]", axis.name, reason)
        for key in filter(keys.__contains__, axis.values):
            yield format_error(f"axes[{i}]", key, "an axis before has this key; remove it from one")
        names.add(axis.name)
        keys |= axis.values.keys()
        if axis.name in RESERVED_NAMES or axis.name in coordinates - axis.values.keys():
            reason = "is the dataset's own name or that of another key; choose another"
            yield format_error(f"axes[{i}].name", axis.name, reason)
    if (count := math.prod(map(len, axes))) > MOST_SCENES:
        yield format_error("axes", count, f"is the number of their scenes; {_TOO_MANY}")


def _overridden(axes: Sequence[SweepAxis]) -> Iterator[str]:
    """Complaints about keys within varied tables: the keys would not have the tables' values."""
    tables = {parse_key(key): values for axis in axes for key, values in axis.values.items()}
    for i, axis in enumerate(axes):
        for key in axis.values:
            steps = parse_key(key)
            for depth in range(1, len(steps)):
                if any(_has(value, steps[depth:]) for value in tables.get(steps[:depth], ())):
                    reason = "a table that varies has this key; remove it from one"
                    yield format_error(f"axes[{i}]", key, reason)


def _has(value: Any, steps: Sequence[Any]) -> bool:
    try:
        for step in steps:
            value = value[step]
    except (LookupError, TypeError):
        return False
    return True
