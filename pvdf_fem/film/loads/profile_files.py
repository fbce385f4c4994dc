"""Files of pressure profiles: tables of a pressure on a rectangular grid, in CSV or NetCDF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError, read_bytes
from pvdf_fem.readings.columns import parse_heading
from pvdf_fem.readings.netcdf import NetcdfError, find_format, read_groups
from pvdf_fem.readings.units import UNITS, convert_factor, parse_unit
from pvdf_fem.scene.registry import DIGEST_MARK
from pvdf_fem.scene.scene import SceneError
from pvdf_fem.scene.scene_file import format_error

if TYPE_CHECKING:
    import xarray

#: A pressure at points of shape (..., 2) in mm in the probe's own axes, shape (...).
GridFunction: TypeAlias = Callable[[Array], Array]


class ProfileFile(NamedTuple):
    """The content of a profile file."""

    digest: str  #: SHA-256 of the bytes.
    pressure: GridFunction  #: Interpolates the table in the file.


class GridTable(NamedTuple):
    """A table of a pressure on a rectangular grid."""

    x_mm: Array  #: Increasing, shape (n,).
    y_mm: Array  #: Increasing, shape (m,).
    pressure: Array  #: In any unit, NaN where it is missing, shape (n, m).


def read_profile(profile: str, max_bytes: int = 20_000_000) -> ProfileFile:
    """Read a profile file, and check its content against the digest in its name, if any.

    Parameters
    ----------
    profile : str
        Path of the file, which may end with ``#sha256=`` and a digest.
    max_bytes : int
        Maximum size of the file.

    Returns
    -------
    ProfileFile

    Raises
    ------
    SceneError
        If the file cannot be used, or has another digest.
    """
    name, _, wanted_digest = profile.partition(DIGEST_MARK)
    try:
        content = read_bytes(Path(name), max_bytes, "a pressure profile")
        digest = sha256(content).hexdigest()
        if wanted_digest not in ("", digest):
            reason = "has changed since the scene was made (its digest differs)"
            raise FileError(f"{name}: {reason}; restore the file, or name it without {DIGEST_MARK}")
        return ProfileFile(digest, _interpolate_table(name, content))
    except NetcdfError as error:
        raise SceneError([format_error("load.profile", profile, str(error))]) from None
    except (FileError, KeyError, OSError, ValueError) as error:
        reason = f"cannot be used ({error}); give x_mm, y_mm and pressure on a grid"
        raise SceneError([format_error("load.profile", profile, reason)]) from None


@lru_cache(maxsize=8)
def _interpolate_table(name: str, content: bytes) -> GridFunction:
    """Return a function that interpolates the table in a file, and is zero outside the grid.

    `content` is read as NetCDF if it begins like such a file or if `name` ends with .nc, otherwise
    as CSV.
    """
    from scipy.interpolate import RegularGridInterpolator  # slow to import

    is_netcdf = name.endswith(".nc") or find_format(content) is not None
    table = _read_netcdf(content) if is_netcdf else _read_csv(name, content)
    axes = table.x_mm, table.y_mm
    return RegularGridInterpolator(axes, table.pressure, bounds_error=False, fill_value=0.0)


# ------------------------------------------------------------------------------------------ NetCDF


def _read_netcdf(content: bytes) -> GridTable:
    """Read the pressure on a grid from the content of a NetCDF file.

    The pressure is the variable ``pressure``, whose name may end with a unit. Its coordinates are
    ``x_mm`` and ``y_mm``, or variables such as ``x`` or ``x_m`` with another unit of length. They
    may decrease. Further dimensions must have the length one. Raises `NetcdfError`.
    """
    variables = _select_group(content)
    stored = variables[_find_name(variables, "pressure")]
    pressure = stored.isel({name: 0 for name, size in stored.sizes.items() if size == 1})
    x_dimension, x_mm = _read_coordinate(variables, "x_mm")
    y_dimension, y_mm = _read_coordinate(variables, "y_mm")
    _reject_dimensions(pressure, {x_dimension, y_dimension})
    if x_dimension == y_dimension:
        try:
            return _arrange_points(x_mm, y_mm, pressure.values)
        except ValueError as error:
            raise NetcdfError(f"{error}; give x_mm and y_mm a dimension each") from None
    grid_x_mm, x_order = np.unique(x_mm, return_index=True)
    grid_y_mm, y_order = np.unique(y_mm, return_index=True)
    if len(grid_x_mm) < len(x_mm) or len(grid_y_mm) < len(y_mm):
        raise NetcdfError("has repeated values of x_mm or y_mm; write each of them once")
    values = pressure.transpose(x_dimension, y_dimension).values
    return GridTable(grid_x_mm, grid_y_mm, values[np.ix_(x_order, y_order)])


def _select_group(content: bytes) -> dict[str, xarray.Variable]:
    """Return the variables of the group of a NetCDF file that has a pressure.

    Raises `NetcdfError` if no group or several of them have one.
    """
    groups = read_groups(content)
    if _list_names(groups["/"], "pressure"):
        return groups["/"]
    matching = [group for group in groups if _list_names(groups[group], "pressure")]
    if len(matching) == 1:
        return groups[matching[0]]
    if matching:
        advice = f"write one to a file, as by: nccopy -G {matching[0]} OLD NEW"
        raise NetcdfError(f"has a pressure in the groups {', '.join(matching)}; {advice}")
    names = set(chain.from_iterable(groups.values()))
    listed = ", ".join(sorted(names)) or "nothing"
    raise NetcdfError(f'has no variable "pressure" but {listed}; rename the one with the pressure')


def _list_names(variables: Mapping[str, xarray.Variable], wanted: str) -> list[str]:
    """List the names of variables that have the wanted name, apart from unit and case."""
    if wanted in variables:
        return [wanted]
    quantity = parse_heading(wanted).name
    return [name for name in variables if parse_heading(name).name.casefold() == quantity]


def _find_name(variables: Mapping[str, xarray.Variable], wanted: str) -> str:
    """Return the name of the only variable that has the wanted name, apart from unit and case.

    Raises `NetcdfError` if no variable or several of them have the name, or if its values are not
    real numbers.
    """
    names = _list_names(variables, wanted)
    if not names:
        listed = ", ".join(variables)
        advice = "write the positions as a variable of this name along a dimension of the pressure"
        raise NetcdfError(f'has no variable "{wanted}" but {listed}; {advice}')
    if len(names) > 1:
        reason = f'has several variables for "{wanted}", {", ".join(names)}'
        raise NetcdfError(f"{reason}; rename all but one of them")
    if variables[names[0]].dtype.kind not in "iuf":
        reason = f"has {names[0]} of type {variables[names[0]].dtype}"
        raise NetcdfError(f"{reason}; write it as real numbers")
    return names[0]


def _read_coordinate(variables: Mapping[str, xarray.Variable], wanted: str) -> tuple[str, Array]:
    """Return the dimension of a coordinate and its values in mm.

    Raises `NetcdfError` if the variable is not along a single dimension, if its values are missing
    or repeated, or if its unit is unknown.
    """
    name = _find_name(variables, wanted)
    variable = variables[name]
    if variable.ndim != 1:
        advice = "give each column and each row of the grid one coordinate"
        raise NetcdfError(f"has {name} with {variable.ndim} dimensions; {advice}")
    values_mm = variable.values * _find_mm(name, variable)
    if not np.isfinite(values_mm).all():
        raise NetcdfError(f"has missing or infinite values of {name}; write all of them")
    return str(variable.dims[0]), values_mm


def _find_mm(name: str, variable: xarray.Variable) -> float:
    """Return the unit of a coordinate in mm, by its name and its attribute ``units``.

    Raises `NetcdfError` if neither states a unit of length, or if they differ.
    """
    by_name = parse_heading(name).unit
    text = str(variable.attrs.get("units", "")).strip()
    stated = parse_unit(text) if text else by_name
    if stated is None or stated.quantity != "length":
        reason = f'has {name} with units = "{text}"'
        raise NetcdfError(f"{reason}; give a unit of length, as by: ncatted -a units,{name},o,c,mm")
    if by_name is not None and by_name != stated:
        reason = f'has {name} with units = "{text}", which differs from its name'
        raise NetcdfError(f"{reason}; rename it, or correct the units")
    return convert_factor(stated, UNITS["mm"])


def _reject_dimensions(pressure: xarray.Variable, dimensions: set[str]) -> None:
    """Raise `NetcdfError` unless a pressure has the dimensions of its coordinates and no others."""
    sizes = ", ".join(f"{name} = {size}" for name, size in pressure.sizes.items())
    if any(str(name).startswith("phony_dim") for name in pressure.dims):
        advice = "write it by xarray or netCDF4, or as CSV"
        raise NetcdfError(f"is HDF5 without named dimensions, not NetCDF4; {advice}")
    additional = [str(name) for name in pressure.dims if name not in dimensions]
    if additional:
        advice = f"select one value, as by: data.isel({additional[0]}=0).to_netcdf(NEW)"
        raise NetcdfError(f"has a pressure with the dimensions {sizes}; {advice}")
    missing = dimensions - {str(name) for name in pressure.dims}
    if missing:
        reason = f"has a pressure with the dimensions {sizes or 'none'}"
        raise NetcdfError(f"{reason}; give it at least two values along {sorted(missing)[0]}")


# --------------------------------------------------------------------------------------------- CSV


def _read_csv(name: str, content: bytes) -> GridTable:
    """Read the columns x_mm, y_mm and pressure; the rows may be in any order.

    Raises `ValueError` unless the rows have one finite pressure for every point of a grid.
    """
    # Few scenes have a profile in a file.
    from pvdf_fem.readings.formats import parse_csv
    from pvdf_fem.readings.selection import NumberColumns, choose_column, choose_quantity
    from pvdf_fem.readings.text.header import make_name_test

    table = parse_csv(content, name, make_name_test(["x_mm", "y_mm", "pressure"]))
    columns = [choose_quantity(table, "x_mm"), choose_quantity(table, "y_mm")]
    columns.append(choose_column(table, "pressure"))
    chosen = [column for column in columns if column is not None]
    if len(chosen) < len(columns):
        raise ValueError("x_mm, y_mm or pressure is missing from the columns")
    numbers = NumberColumns(table, chosen)
    rows = [numbers.read(row) for row in chain.from_iterable(table.batches)]
    x_mm, y_mm, pressure = np.array(rows).reshape(len(rows), len(chosen)).T
    return _arrange_points(x_mm, y_mm, pressure)


def _arrange_points(x_mm: Array, y_mm: Array, values: Array) -> GridTable:
    """Arrange points in any order on their grid.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (points,)
        Coordinates.
    values : ndarray, shape (points,)
        Pressures.

    Raises
    ------
    ValueError
        Unless the points are those of a grid, with one finite pressure at each.
    """
    grid_x_mm, row_i = np.unique(x_mm, return_inverse=True)
    grid_y_mm, row_j = np.unique(y_mm, return_inverse=True)
    pressure = np.full((len(grid_x_mm), len(grid_y_mm)), np.nan)
    pressure[row_i, row_j] = values
    if not np.isfinite(pressure).all() or pressure.size != len(values):
        raise ValueError("the points do not form a grid with one finite pressure at each")
    return GridTable(grid_x_mm, grid_y_mm, pressure)
