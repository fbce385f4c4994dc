"""A grid of scenes: a base scene, and axes along which some of its keys vary.

An axis varies one key, or several together. In a sweep file and in Python it is the same table, of
keys of the scene and what they become: a list, or numbers from `start` to `stop`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError

from pvdf_fem.maps.mapping import MappingScheme
from pvdf_fem.scene.mistakes import MOST_MISTAKES
from pvdf_fem.scene.quantity import Finite, Length, Number, Part
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, choose, parse_toml, problem, read_scene_text

#: Grids with more scenes are refused.
MOST_SCENES = 1_000_000
_SECTIONS = tuple(Scene.model_fields)


class Range(Part):
    """`count` numbers from `start` to `stop`, both included, with equal steps or equal ratios."""

    start: Finite
    stop: Finite
    count: Annotated[int, Field(strict=True, ge=2, le=MOST_SCENES)]
    spacing: Literal["linear", "log"] = "linear"

    @property
    def values(self) -> list[float]:
        """The numbers; ends are exact."""
        if self.spacing == "linear":
            return np.linspace(self.start, self.stop, self.count).tolist()
        found = np.geomspace(self.start, self.stop, self.count).tolist()
        return [self.start, *found[1:-1], self.stop]


class Lines(Part):
    """The places of `pvdf_fem.maps.mapping.MappingScheme`, on the base scene."""

    electrode: str
    angles_deg: tuple[Number, ...] = Field(min_length=1)
    distances_mm: tuple[Annotated[Finite, Field(ge=0.0)], ...] = tuple(4.0 * i for i in range(8))
    reach_mm: Length = 20.0


@dataclass(frozen=True)
class Axis:
    """A dimension of a grid.

    Attributes
    ----------
    name : str
    values : dict of str to tuple
        For each key of the scene its values along the axis.
    beside : dict of str to tuple
        What else is known along the axis, and no key of the scene.
    """

    name: str
    values: Mapping[str, tuple[Any, ...]]
    beside: Mapping[str, tuple[float, ...]]

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def __getitem__(self, index: int) -> dict[str, Any]:
        """The changes to the base scene at a place of the axis."""
        return {key: values[index] for key, values in self.values.items()}


@dataclass(frozen=True)
class Grid:
    """A base scene and its axes; see `Grid.of`."""

    scene: Scene
    axes: tuple[Axis, ...]

    @classmethod
    def of(cls, scene: Scene, axes: Sequence[Mapping[str, Any]], source: str = "") -> Self:
        """A grid from tables.

        Parameters
        ----------
        scene : Scene
        axes : sequence of mapping
            For each axis the keys that vary together, such as
            ``{"film.thickness_um": [9, 25, 110]}`` or
            ``{"load.force_N": {"start": 0.1, "stop": 10, "count": 5, "spacing": "log"}}``; several
            keys take lists of one length. Keys may be nested tables too. ``name`` names the axis,
            which has otherwise the last part of its first key. ``{"mapping": {"electrode": "A",
            "angles_deg": [0, 45]}}`` puts the probe on lines from an electrode of the base scene,
            with ``distances_mm`` and ``reach_mm`` as in `MappingScheme`.
        source : str
            Names the file in a complaint.

        Raises
        ------
        SceneError
            With all mistakes.
        """
        problems: list[str] = []
        found = [_axis(f"axes[{i}]", table, scene, problems) for i, table in enumerate(axes)]
        if not problems:
            problems += _clashes([axis for axis in found if axis])
        if problems:
            raise SceneError(problems[:MOST_MISTAKES], source)
        return cls(scene, tuple(axis for axis in found if axis))

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """The grid of a sweep file: `scene`, the path of a scene file beside it or a table, and
        `axes`, tables as in `of`.

        Raises
        ------
        SceneError
            With all mistakes of the file and of its scene.
        """
        path = Path(path)
        table = parse_toml(read_scene_text(path), str(path))
        given, axes = table.pop("scene", None), table.pop("axes", [])
        problems = [
            problem(key, value, f"is no key there; {choose(key, ['scene', 'axes'])}")
            for key, value in table.items()
        ]
        scene = Scene()
        try:
            if isinstance(given, str):
                scene = Scene.load(path.parent / given)
            elif isinstance(given, Mapping):
                scene = scene.with_(**given)
            else:
                reason = "must be the path of a scene file or a table; give one"
                problems.append(problem("scene", "(nothing)" if given is None else given, reason))
        except SceneError as error:
            problems += error.problems
        if not isinstance(axes, list) or not all(isinstance(axis, Mapping) for axis in axes):
            problems.append(problem("axes", axes, "must be tables; begin each with [[axes]]"))
        elif not axes:
            problems.append("axes = (nothing): is required; add a table [[axes]] with a key")
        else:
            try:
                grid = cls.of(scene, axes, str(path))
            except SceneError as error:
                problems += error.problems
        if problems:
            raise SceneError(problems[:MOST_MISTAKES], str(path))
        return grid

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of places along each axis."""
        return tuple(len(axis) for axis in self.axes)

    def scenes(self) -> list[Scene]:
        """The scenes, the last axis fastest.

        Equal parts of them are one object, so that many scenes need little memory.

        Raises
        ------
        SceneError
            With the mistakes of all scenes, each once.
        """
        parts: dict[Any, Any] = {}
        found, problems = [], dict[str, None]()
        for place in itertools.product(*(range(len(axis)) for axis in self.axes)):
            changes: dict[str, Any] = {}
            for axis, index in zip(self.axes, place, strict=True):
                changes |= axis[index]
            try:
                scene = self.scene.with_(**changes)
            except SceneError as error:
                problems |= dict.fromkeys(error.problems)
                if len(problems) > MOST_MISTAKES:
                    break
                continue
            shared = {name: getattr(scene, name) for name in _SECTIONS}
            shared = {name: parts.setdefault((name, part), part) for name, part in shared.items()}
            found.append(Scene.model_construct(**shared))
        if problems:
            raise SceneError(list(problems)[:MOST_MISTAKES])
        return found


def _axis(where: str, table: Mapping[str, Any], scene: Scene, problems: list[str]) -> Axis | None:
    """One axis of a table; None, and more problems, if there is a mistake."""
    count = len(problems)
    rest = dict(table)
    name = rest.pop("name", None)
    if name is not None and not (isinstance(name, str) and name.isprintable() and name.strip()):
        problems.append(problem(f"{where}.name", name, "is no name; give printable characters"))
    if "mapping" in rest:
        lines = rest.pop("mapping")
        if rest:
            reason = "cannot vary together with a mapping; give it an axis of its own"
            problems += [problem(f"{where}.{key}", value, reason) for key, value in _flat(rest)]
        return _mapped(f"{where}.mapping", lines, scene, name or "place", problems)
    values = {}
    for key, value in _flat(rest):
        values[key] = _values(f"{where}.{key}", value, problems)
    lengths = {key: len(each) for key, each in values.items()}
    if not values:
        problems.append(f"{where} = (nothing): has no key of a scene; add one, with its values")
    elif len(problems) == count and len(set(lengths.values())) > 1:
        text = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        problems.append(f"{where}: {text} values; give keys that vary together equally many")
    if len(problems) > count:
        return None
    return Axis(name or next(iter(values)).split(".")[-1], values, {})


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The dotted keys of nested tables, down to lists and ranges."""
    for key, value in table.items():
        if isinstance(value, Mapping) and not {"start", "stop", "count"} & value.keys():
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _values(where: str, value: Any, problems: list[str]) -> tuple[Any, ...]:
    if isinstance(value, Mapping):
        try:
            given = Range.model_validate(value)
        except ValidationError as error:
            problems += _told(where, error, Range)
            return ()
        if given.spacing == "log" and not given.start * given.stop > 0.0:
            reason = "both ends of equal ratios need one sign, and not 0; change them or spacing"
            problems.append(problem(f"{where}.start", given.start, reason))
            return ()
        return tuple(given.values)
    if not isinstance(value, list | tuple | np.ndarray) or not len(value):
        reason = "must be a list, or a table of start, stop and count; put it in brackets"
        problems.append(problem(where, value, reason))
        return ()
    return tuple(value.tolist() if isinstance(value, np.ndarray) else value)


def _mapped(where: str, value: Any, scene: Scene, name: str, problems: list[str]) -> Axis | None:
    try:
        lines = Lines.model_validate(value)
        scheme = MappingScheme(scene, **lines.model_dump())
    except ValidationError as error:
        problems += _told(where, error, Lines)
        return None
    except ValueError as error:
        problems.append(f"{where}.{error}")
        return None
    places = np.concatenate(scheme.positions_mm)
    lengths = [len(along) for along in scheme.positions_mm]
    away = np.linalg.norm(places - scheme.centre_mm, axis=1)
    keys = {"probe.x_mm": tuple(places[:, 0].tolist()), "probe.y_mm": tuple(places[:, 1].tolist())}
    beside = {
        "angle_deg": tuple(np.repeat(lines.angles_deg, lengths).tolist()),
        "distance_mm": tuple(away.tolist()),
    }
    return Axis(name, keys, beside)


def _told(where: str, error: ValidationError, model: type[Part]) -> Iterator[str]:
    """The mistakes of a range or of lines."""
    for details in error.errors(include_url=False):
        key = ".".join([where, *map(str, details["loc"])])
        if details["type"] == "missing":
            yield f"{key} = (nothing): is required; add it"
        elif details["type"] == "extra_forbidden":
            known = list(model.model_fields)
            reason = f"is no key there; {choose(details['loc'][-1], known)}"
            yield problem(key, details["input"], reason)
        else:
            yield problem(key, details["input"], f"{details['msg']}; change it")


def _clashes(axes: Sequence[Axis]) -> Iterator[str]:
    """Names and keys that two axes have, and a grid that is too large."""
    for what, of in (("name", lambda axis: [axis.name]), ("key", lambda axis: axis.values)):
        seen: set[str] = set()
        for i, axis in enumerate(axes):
            for word in of(axis):
                if word in seen:
                    change = "name the axis" if what == "name" else "remove it from one"
                    yield problem(f"axes[{i}]", word, f"an axis before has this {what}; {change}")
                seen.add(word)
    for i, axis in enumerate(axes):
        if axis.name == "electrode":
            reason = "is the name of the dataset's own dimension; choose another"
            yield problem(f"axes[{i}].name", axis.name, reason)
    if (count := math.prod(map(len, axes))) > MOST_SCENES:
        yield f"axes: make {count} scenes; at most {MOST_SCENES} are allowed, give fewer values"
