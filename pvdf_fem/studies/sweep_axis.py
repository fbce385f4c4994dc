"""Axes of a sweep: keys that vary together, with their values, and how tables describe them."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from pvdf_fem.scene.changes import normalize_key, parse_key, to_plain_value
from pvdf_fem.scene.keys import Finite, Length, Number, Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.scene.validation.errors import MAX_ERRORS, describe_errors
from pvdf_fem.studies.mapping_scheme import MappingScheme

MAX_SCENES = 1_000_000  #: Largest number of scenes in a grid.
#: Largest number of axes; numpy's arrays have at most 64 dimensions, including `electrode`.
MAX_AXES = 63
#: Names of the dataset's own variables, and of its dimension of electrodes.
RESERVED_NAMES = {
    "charge_pC",
    "charge_error_pC",
    "rest_charge_pC",
    "rest_charge_error_pC",
    "charge_change_pC",
    "charge_change_error_pC",
    "deflection_max_mm",
    "status",
    "reading_V",
    "electrode",
}
_TOO_MANY = f"at most {MAX_SCENES} are allowed, give fewer values"
# NetCDF keeps some names for itself; texts have a dimension such as `string4`.
_NETCDF_TYPES = r"(byte|char|u?short|u?int(64)?|float|real|double|bool|string\d*)"
_NETCDF_NAME = re.compile(rf"(?!{_NETCDF_TYPES}$)\w[^/']{{0,59}}(?<! )")


class ValueRange(Section):
    """`count` numbers from `start` to `stop`, both included, with equal steps or equal ratios."""

    start: Finite
    stop: Finite
    count: Annotated[int, Field(strict=True, ge=2, le=MAX_SCENES)]
    spacing: Literal["linear", "log"] = "linear"

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[float]:  # type: ignore[override]
        make_numbers = np.linspace if self.spacing == "linear" else np.geomspace
        return iter(make_numbers(self.start, self.stop, self.count).tolist())


class MappingLines(Section):
    """The table of an axis of places: arguments of `MappingScheme`, on the base scene."""

    electrode: str
    angles_deg: tuple[Number, ...] = Field(min_length=1)
    distances_mm: tuple[Annotated[Finite, Field(ge=0.0)], ...] = tuple(4.0 * i for i in range(8))
    reach_mm: Length = 20.0


@dataclass(frozen=True)
class SweepAxis:
    """A dimension of a grid of scenes."""

    name: str
    values: Mapping[str, tuple[Any, ...]]  #: For each key of the scene its values along the axis.
    #: Further coordinates along the axis, without scene keys.
    beside: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Return the changes to the base scene at an index of the axis."""
        return {key: values[index] for key, values in self.values.items()}


def parse_axes(
    tables: Sequence[Mapping[str, Any]], scene: Scene | None, source: str = ""
) -> tuple[SweepAxis, ...]:
    """Parse the tables of axes.

    Parameters
    ----------
    tables : sequence of mapping
        A table for each axis, see `SceneGrid.from_tables`.
    scene : Scene, optional
        The base scene; without one, because it has errors itself, the lines of a mapping are not
        placed.
    source : str
        Name of the file for error messages.

    Raises
    ------
    SceneError
        If tables have errors, with all of them.
    """
    is_list = isinstance(tables, list | tuple)
    if not is_list or not all(isinstance(table, Mapping) for table in tables):
        reason = 'must be a list of tables, [{"load.force_N": [1, 2]}]; in a file of [[axes]]'
        raise SceneError([format_error("axes", tables, reason)], source)
    if not tables:
        raise SceneError(["axes: is required; add a table [[axes]]"], source)
    if len(tables) > MAX_AXES:
        reason = f"is the number of axes; at most {MAX_AXES} are allowed, put keys together"
        raise SceneError([format_error("axes", len(tables), reason)], source)
    errors: list[str] = []
    axes = []
    for index, table in enumerate(tables):
        axis = _parse_axis(f"axes[{index}]", table, scene, errors)
        if axis is not None:
            axes.append(axis)
    if not errors:
        errors += _find_conflicts(axes)
    if not errors:
        errors += _find_overridden_keys(axes)
    if errors:
        raise SceneError(errors[:MAX_ERRORS], source)
    return tuple(_expand_ranges(axis) for axis in axes)


def _expand_ranges(axis: SweepAxis) -> SweepAxis:
    """Return the axis with the numbers of its ranges."""
    values = {key: tuple(along) for key, along in axis.values.items()}
    return SweepAxis(axis.name, values, axis.beside)


def _parse_axis(
    where: str, table: Mapping[str, Any], scene: Scene | None, errors: list[str]
) -> SweepAxis | None:
    """Parse the table of an axis.

    Parameters
    ----------
    where : str
        Key of the table for error messages.
    table : mapping of str to values
        Keys of the scene that vary together, or a mapping.
    scene : Scene, optional
        The base scene.
    errors : list of str
        Errors are appended.

    Returns
    -------
    SweepAxis or None
        None if the table has errors.
    """
    count_before = len(errors)
    varied = dict(table)
    name = varied.pop("name", None)
    if name is not None and not _is_netcdf_name(name):
        reason = "is no name that NetCDF can hold; give at most 60 letters, digits and _"
        errors.append(format_error(f"{where}.name", name, reason))
    if "mapping" in varied:
        lines = varied.pop("mapping")
        for key, value in _flatten(varied):
            reason = "cannot vary together with a mapping; give it an axis of its own"
            errors.append(format_error(f"{where}.{key}", value, reason))
        if name is None:
            name = "place"
        return _parse_mapping_axis(f"{where}.mapping", lines, scene, name, errors)
    values: dict[str, Any] = {}
    for key, value in _flatten(varied):
        normal_key = normalize_key(key)
        if normal_key in values:
            reason = "is the same key as one before; remove one"
            errors.append(format_error(f"{where}.{key}", value, reason))
        values[normal_key] = _parse_values(f"{where}.{key}", value, errors)
    if not values:
        errors.append(f"{where}: has no key of a scene; add one, with its values")
    elif len(errors) == count_before:
        lengths = {key: len(along) for key, along in values.items()}
        if len(set(lengths.values())) > 1:
            text = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            errors.append(f"{where}: {text} values; give keys that vary together equally many")
    if len(errors) > count_before:
        return None
    if name is None:
        first_key = next(iter(values))
        name = first_key.split(".")[-1]
    return SweepAxis(name, values)


def _is_netcdf_name(name: Any) -> bool:
    """Whether a dimension and a variable of a NetCDF file can have a name."""
    if not isinstance(name, str) or not unicodedata.is_normalized("NFC", name):
        return False
    return name.isprintable() and _NETCDF_NAME.fullmatch(name) is not None


def _flatten(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Iterate over the dotted keys of nested tables, down to lists and ranges."""
    for key, value in table.items():
        is_table = isinstance(value, Mapping)
        if is_table and not {"start", "stop", "count"} & value.keys():
            yield from _flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _parse_values(where: str, value: Any, errors: list[str]) -> tuple[Any, ...] | ValueRange:
    """Parse the values of a key along an axis.

    Parameters
    ----------
    where : str
        The key for error messages.
    value : list, tuple, array or mapping
        Values, or a table with the keys of `ValueRange`.
    errors : list of str
        Errors are appended; the values are empty then.
    """
    if isinstance(value, Mapping):
        return _parse_range(where, value, errors)
    if not isinstance(value, list | tuple | np.ndarray) or not len(value):
        reason = "must be a list, or a table of start, stop and count; put it in brackets"
        errors.append(format_error(where, value, reason))
        return ()
    return tuple(to_plain_value(value))


def _parse_range(
    where: str, table: Mapping[str, Any], errors: list[str]
) -> tuple[Any, ...] | ValueRange:
    """Parse a table of start, stop and count; see `_parse_values` for the parameters."""
    try:
        numbers = ValueRange.model_validate(table)
    except ValidationError as error:
        errors += describe_errors(error, where, ValueRange)
        return ()
    if numbers.spacing == "log" and not numbers.start * numbers.stop > 0.0:
        reason = "both ends of equal ratios need one sign, and not 0; change them or spacing"
        errors.append(format_error(f"{where}.start", numbers.start, reason))
        return ()
    return numbers


def _parse_mapping_axis(
    where: str, table: Any, scene: Scene | None, name: str, errors: list[str]
) -> SweepAxis | None:
    """Parse the table of an axis of places on lines.

    Parameters
    ----------
    where : str
        Key of the table for error messages.
    table : mapping
        Keys of `MappingLines`.
    scene : Scene, optional
        The base scene.
    name : str
        Name of the axis.
    errors : list of str
        Errors are appended.

    Returns
    -------
    SweepAxis or None
        None if the table has errors, or without a scene.
    """
    try:
        lines = MappingLines.model_validate(table)
    except ValidationError as error:
        errors += describe_errors(error, where, MappingLines)
        return None
    count = len(lines.angles_deg) * len(lines.distances_mm)
    if count > MAX_SCENES:
        errors.append(f"{where}.angles_deg: make {count} places; {_TOO_MANY}")
        return None
    if scene is None:
        return None
    try:
        scheme = MappingScheme(scene, **lines.model_dump())
    except ValueError as error:
        errors.append(f"{where}.{error}")
        return None
    places_mm = np.concatenate(scheme.positions_mm)
    distances_mm = np.linalg.norm(places_mm - scheme.centre_mm, axis=1)
    lengths = [len(line) for line in scheme.positions_mm]
    angles_deg = np.repeat(lines.angles_deg, lengths)
    values = {
        "probe.x_mm": tuple(places_mm[:, 0].tolist()),
        "probe.y_mm": tuple(places_mm[:, 1].tolist()),
    }
    beside = {
        "angle_deg": tuple(angles_deg.tolist()),
        "distance_mm": tuple(distances_mm.tolist()),
    }
    return SweepAxis(name, values, beside)


def _find_conflicts(axes: Sequence[SweepAxis]) -> Iterator[str]:
    """Find names and keys that two axes have, and a grid that is too large."""
    names = set[str]()
    keys = set[str]()
    coordinates = set[str]()
    for axis in axes:
        coordinates |= {*axis.values, *axis.beside}
    for index, axis in enumerate(axes):
        where = f"axes[{index}]"
        if axis.name in names:
            yield format_error(where, axis.name, "an axis before has this name; name the axis")
        for key in axis.values:
            if key in keys:
                yield format_error(where, key, "an axis before has this key; remove it from one")
        names.add(axis.name)
        keys |= axis.values.keys()
        if axis.name in RESERVED_NAMES or axis.name in coordinates - axis.values.keys():
            reason = "is the dataset's own name or that of another key; choose another"
            yield format_error(f"{where}.name", axis.name, reason)
    count = math.prod(len(axis) for axis in axes)
    if count > MAX_SCENES:
        yield format_error("axes", count, f"is the number of their scenes; {_TOO_MANY}")


def _find_overridden_keys(axes: Sequence[SweepAxis]) -> Iterator[str]:
    """Find keys within tables that vary too: the keys would not have the tables' values."""
    tables: dict[tuple[Any, ...], tuple[Any, ...]] = {}
    for axis in axes:
        for key, values in axis.values.items():
            tables[parse_key(key)] = values
    for index, axis in enumerate(axes):
        for key in axis.values:
            steps = parse_key(key)
            for depth in range(1, len(steps)):
                varied = tables.get(steps[:depth], ())
                if any(_has_value(value, steps[depth:]) for value in varied):
                    reason = "a table that varies has this key; remove it from one"
                    yield format_error(f"axes[{index}]", key, reason)


def _has_value(value: Any, steps: Sequence[Any]) -> bool:
    """Whether nested tables and lists have a value at some steps."""
    try:
        for step in steps:
            value = value[step]
    except (LookupError, TypeError):
        return False
    return True
