"""Axes of a sweep: keys that vary together with their values, and parsing of their tables."""

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

MAX_SCENES = 1_000_000  #: Maximum number of scenes in a grid.
#: Maximum number of axes; NumPy arrays have at most 64 dimensions, one of which is `electrode`.
MAX_AXES = 63
#: Names of variables of the dataset and of its dimension `electrode`, which axes cannot have.
RESERVED_NAMES = {
    "charge_pC",
    "charge_error_pC",
    "rest_charge_pC",
    "rest_charge_error_pC",
    "charge_change_pC",
    "charge_change_error_pC",
    "deflection_max_mm",
    "status",
    "status_flag",
    "reading_V",
    "electrode",
}
_TOO_MANY = f"at most {MAX_SCENES} are allowed, give fewer values"
# NetCDF reserves the names of its types; the dimension of texts has a name such as `string4`.
_NETCDF_TYPES = r"(byte|char|u?short|u?int(64)?|float|real|double|bool|string\d*)"
_NETCDF_NAME = re.compile(rf"(?!{_NETCDF_TYPES}$)\w[^/']{{0,59}}(?<! )")


class ValueRange(Section):
    """Range of `count` numbers from `start` to `stop`, both included.

    Neighbouring numbers have equal differences (``linear``) or equal ratios (``log``).
    """

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
    """Table of an axis of probe positions: the arguments of `MappingScheme` except the scene."""

    electrode: str
    angles_deg: tuple[Number, ...] = Field(min_length=1)
    distances_mm: tuple[Annotated[Finite, Field(ge=0.0)], ...] = tuple(4.0 * i for i in range(8))
    reach_mm: Length = 20.0


@dataclass(frozen=True)
class SweepAxis:
    """A dimension of a grid of scenes: keys that vary together."""

    name: str  #: Name of the dimension in the dataset of a sweep.
    values: Mapping[str, tuple[Any, ...]]  #: Values along the axis for each scene key.
    #: Additional coordinates along the axis that are not keys of a scene.
    extra_coordinates: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Return the changes to the base scene at an index along the axis."""
        return {key: values[index] for key, values in self.values.items()}


def parse_axes(
    tables: Sequence[Mapping[str, Any]], scene: Scene | None, source: str = ""
) -> tuple[SweepAxis, ...]:
    """Parse and validate the tables of axes.

    Parameters
    ----------
    tables : sequence of mapping
        Table of each axis, see `SceneGrid.from_tables`.
    scene : Scene, optional
        Base scene. None if it has errors itself; axes with a ``mapping`` are then left out of the
        result, which only serves to find errors of the tables.
    source : str
        Name of the sweep file for error messages; empty if there is none.

    Returns
    -------
    tuple of SweepAxis
        An axis for each table, in which ranges are expanded to their numbers.

    Raises
    ------
    SceneError
        If tables have errors; the exception lists up to `MAX_ERRORS` of them.
    """
    is_list = isinstance(tables, list | tuple)
    if not is_list or not all(isinstance(table, Mapping) for table in tables):
        reason = 'must be a list of tables; give one per axis, as in [{"load.force_N": [1, 2]}]'
        raise SceneError([format_error("axes", tables, reason)], source)
    if not tables:
        raise SceneError(["axes: is required; add a table [[axes]]"], source)
    if len(tables) > MAX_AXES:
        reason = f"too many tables; give at most {MAX_AXES}, or several keys in one axis"
        raise SceneError([format_error("axes", len(tables), reason)], source)
    errors: list[str] = []
    axes = []
    for index, table in enumerate(tables):
        axis = _parse_axis(f"axes[{index}]", table, scene, errors)
        if axis is not None:
            axes.append(axis)
    if not errors:
        errors += _find_axis_conflicts(axes)
    if not errors:
        errors += _find_overridden_keys(axes)
    if errors:
        raise SceneError(errors[:MAX_ERRORS], source)
    return tuple(_expand_ranges(axis) for axis in axes)


def _expand_ranges(axis: SweepAxis) -> SweepAxis:
    """Return a copy of the axis in which each `ValueRange` is replaced by its numbers."""
    values = {key: tuple(along) for key, along in axis.values.items()}
    return SweepAxis(axis.name, values, axis.extra_coordinates)


def _parse_axis(
    where: str, table: Mapping[str, Any], scene: Scene | None, errors: list[str]
) -> SweepAxis | None:
    """Parse the table of an axis, and append its errors to a list.

    Parameters
    ----------
    where : str
        Key of the table, for error messages.
    table : mapping of str to values
        Scene keys that vary together with their values, or a ``mapping``.
    scene : Scene, optional
        Base scene, which a ``mapping`` needs.
    errors : list of str
        List to which errors are appended.

    Returns
    -------
    SweepAxis or None
        None if the table has errors, or has a ``mapping`` and there is no scene.
    """
    count_before = len(errors)
    varied = dict(table)
    name = varied.pop("name", None)
    if name is not None and not _is_netcdf_name(name):
        reason = "is not a valid name in NetCDF; use only letters, digits and _, at most 60"
        if re.fullmatch(_NETCDF_TYPES, str(name)):
            reason = "is the name of a type in NetCDF files; choose another name"
        errors.append(format_error(f"{where}.name", name, reason))
    if "mapping" in varied:
        lines = varied.pop("mapping")
        for key, value in _flatten_nested_tables(varied):
            reason = "cannot vary together with a mapping; give it an axis of its own"
            errors.append(format_error(f"{where}.{key}", value, reason))
        if name is None:
            name = "place"
        return _parse_mapping_axis(f"{where}.mapping", lines, scene, name, errors)
    values: dict[str, Any] = {}
    for key, value in _flatten_nested_tables(varied):
        normal_key = normalize_key(key)
        if normal_key in values:
            reason = "is the same key as a previous one; remove one of them"
            errors.append(format_error(f"{where}.{key}", value, reason))
        values[normal_key] = _parse_values(f"{where}.{key}", value, errors)
    if not values:
        errors.append(f"{where}: has no scene key; add one with its values")
    elif len(errors) == count_before:
        lengths = {key: len(along) for key, along in values.items()}
        if len(set(lengths.values())) > 1:
            text = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            errors.append(f"{where}: {text} values; give all keys of an axis the same number")
    if len(errors) > count_before:
        return None
    if name is None:
        first_key = next(iter(values))
        name = first_key.split(".")[-1]
    return SweepAxis(name, values)


def make_full_name(key: str) -> str:
    """Return a whole scene key as a name of CF, without dots: ``probe.x_mm`` as ``probe_x_mm``."""
    return key.replace(".", "_")


def _is_netcdf_name(name: Any) -> bool:
    """Return whether a value is a valid name of a dimension and a variable in NetCDF files."""
    if not isinstance(name, str) or not unicodedata.is_normalized("NFC", name):
        return False
    return name.isprintable() and _NETCDF_NAME.fullmatch(name) is not None


def _flatten_nested_tables(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys of nested tables, each with the list or range of its values.

    Parameters
    ----------
    table : mapping
        Nested tables. A table with ``start``, ``stop`` or ``count`` is a range, that is a value.
    prefix : str
        Dotted key of the table, followed by a dot.
    """
    for key, value in table.items():
        is_table = isinstance(value, Mapping)
        if is_table and not {"start", "stop", "count"} & value.keys():
            yield from _flatten_nested_tables(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _parse_values(where: str, value: Any, errors: list[str]) -> tuple[Any, ...] | ValueRange:
    """Parse the values of a key along an axis, and append errors to a list.

    Parameters
    ----------
    where : str
        Key, for error messages.
    value : list, tuple, ndarray or mapping
        Values, or a table with the keys of `ValueRange`.
    errors : list of str
        List to which errors are appended.

    Returns
    -------
    tuple or ValueRange
        Values; empty if there are errors.
    """
    if isinstance(value, Mapping):
        return _parse_range(where, value, errors)
    if not isinstance(value, list | tuple | np.ndarray) or not len(value):
        reason = "must be a list, or a table of start, stop and count; put values in brackets"
        errors.append(format_error(where, value, reason))
        return ()
    return tuple(to_plain_value(value))


def _parse_range(
    where: str, table: Mapping[str, Any], errors: list[str]
) -> tuple[Any, ...] | ValueRange:
    """Parse a table with the keys of `ValueRange`, and append errors to a list.

    An empty tuple is returned if there are errors. See `_parse_values` for the parameters.

    Parameters
    ----------
    where : str
        Key of the table, for messages.
    table : mapping
        The table.
    errors : list of str
        Receives the messages.
    """
    try:
        numbers = ValueRange.model_validate(table)
    except ValidationError as error:
        errors += describe_errors(error, where, ValueRange)
        return ()
    if numbers.spacing == "log" and not numbers.start * numbers.stop > 0.0:
        reason = (
            'start and stop must have the same sign and not be 0 if spacing = "log"; change one'
        )
        errors.append(format_error(f"{where}.start", numbers.start, reason))
        return ()
    return numbers


def _parse_mapping_axis(
    where: str, table: Any, scene: Scene | None, name: str, errors: list[str]
) -> SweepAxis | None:
    """Parse the table of an axis of probe positions on lines, and append errors to a list.

    Parameters
    ----------
    where : str
        Key of the table, for error messages.
    table : mapping
        Table with the keys of `MappingLines`.
    scene : Scene, optional
        Base scene with the electrode and the probe.
    name : str
        Name of the axis.
    errors : list of str
        List to which errors are appended.

    Returns
    -------
    SweepAxis or None
        Axis over the positions of all lines, one line after the other. None if the table has
        errors or there is no scene.
    """
    try:
        lines = MappingLines.model_validate(table)
    except ValidationError as error:
        errors += describe_errors(error, where, MappingLines)
        return None
    count = len(lines.angles_deg) * len(lines.distances_mm)
    if count > MAX_SCENES:
        errors.append(f"{where}.angles_deg: make {count} positions; {_TOO_MANY}")
        return None
    if scene is None:
        return None
    try:
        scheme = MappingScheme(scene, **lines.model_dump())
    except ValueError as error:
        errors.append(f"{where}.{error}")
        return None
    positions_mm = np.concatenate(scheme.positions_mm)
    distances_mm = np.linalg.norm(positions_mm - scheme.centre_mm, axis=1)
    lengths = [len(line) for line in scheme.positions_mm]
    angles_deg = np.repeat(lines.angles_deg, lengths)
    values = {
        "probe.x_mm": tuple(positions_mm[:, 0].tolist()),
        "probe.y_mm": tuple(positions_mm[:, 1].tolist()),
    }
    extra_coordinates = {
        "angle_deg": tuple(angles_deg.tolist()),
        "distance_mm": tuple(distances_mm.tolist()),
    }
    return SweepAxis(name, values, extra_coordinates)


def _find_axis_conflicts(axes: Sequence[SweepAxis]) -> Iterator[str]:
    """Yield an error message for each conflict between axes.

    Conflicts are equal names, equal keys, names that are reserved or the key of another axis, and
    too many scenes in the grid.
    """
    names = set[str]()
    keys = set[str]()
    coordinates = set[str]()
    for axis in axes:
        coordinates |= {*axis.values, *axis.extra_coordinates}
        coordinates |= {make_full_name(key) for key in axis.values}
    for index, axis in enumerate(axes):
        where = f"axes[{index}]"
        if axis.name in names:
            reason = "a previous axis has this name; give the axis another name"
            yield format_error(where, axis.name, reason)
        for key in axis.values:
            if key in keys:
                reason = "a previous axis has this key; remove it from one of them"
                yield format_error(where, key, reason)
        names.add(axis.name)
        keys |= axis.values.keys()
        if axis.name in RESERVED_NAMES or axis.name in coordinates - axis.values.keys():
            reason = "is the name of a result or of a varied key; choose another name"
            yield format_error(f"{where}.name", axis.name, reason)
    count = math.prod(len(axis) for axis in axes)
    if count > MAX_SCENES:
        yield format_error("axes", count, f"too many scenes; {_TOO_MANY}")


def _find_overridden_keys(axes: Sequence[SweepAxis]) -> Iterator[str]:
    """Yield an error message for each key that is also in a table that varies as a whole.

    For example, ``film.radius_mm`` and ``film`` may not both vary if a value of ``film`` has a
    ``radius_mm``, since one of the two radii would be overridden.
    """
    values_by_path: dict[tuple[Any, ...], tuple[Any, ...]] = {}
    for axis in axes:
        for key, values in axis.values.items():
            values_by_path[parse_key(key)] = values
    for index, axis in enumerate(axes):
        for key in axis.values:
            path = parse_key(key)
            for depth in range(1, len(path)):
                tables = values_by_path.get(path[:depth], ())
                if any(_has_value_at_path(table, path[depth:]) for table in tables):
                    reason = "a table that varies contains this key; remove it from one of them"
                    yield format_error(f"axes[{index}]", key, reason)


def _has_value_at_path(table: Any, path: Sequence[Any]) -> bool:
    """Return whether nested tables and lists have a value at a path of keys and indices."""
    value = table
    try:
        for step in path:
            value = value[step]
    except (LookupError, TypeError):
        return False
    return True
