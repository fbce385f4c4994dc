"""Variables of NetCDF files of every format, read by the engine of xarray that knows the format."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError

if TYPE_CHECKING:
    import xarray


class NetcdfFormat(NamedTuple):
    """A format of NetCDF files."""

    title: str  #: Name for messages.
    signature: bytes  #: First bytes of a file.
    engines: tuple[str, ...]  #: Engines of xarray that read the format, the preferred one first.


FORMATS = (
    NetcdfFormat("NetCDF classic", b"CDF\x01", ("scipy",)),
    NetcdfFormat("NetCDF with 64-bit offsets", b"CDF\x02", ("scipy",)),
    NetcdfFormat("NetCDF of format CDF-5", b"CDF\x05", ("netcdf4",)),
    NetcdfFormat("NetCDF4", b"\x89HDF\r\n\x1a\n", ("netcdf4", "h5netcdf")),
)
#: Importable modules of the engines of xarray.
ENGINE_MODULES = {"scipy": "scipy", "netcdf4": "netCDF4", "h5netcdf": "h5netcdf"}
#: Values of cells that have never been written, by the type of the variable; a ``_FillValue``
#: replaces them. They are defined in netcdf.h. Bytes have none.
DEFAULT_FILL_VALUES = {
    "i2": -32767,
    "i4": -2147483647,
    "i8": -9223372036854775806,
    "u2": 65535,
    "u4": 4294967295,
    "u8": 18446744073709551614,
    "f4": np.float32(9.9692099683868690e36),
    "f8": 9.9692099683868690e36,
}


class NetcdfError(FileError):
    """A NetCDF file that cannot be used; the message is the reason with advice, without a path."""


def find_format(content: bytes) -> NetcdfFormat | None:
    """Find the format of a NetCDF file by its first bytes.

    Parameters
    ----------
    content : bytes
        The content of the file, or its beginning.

    Returns
    -------
    NetcdfFormat or None
        None if the content is that of another file.
    """
    for known in FORMATS:
        if content.startswith(known.signature):
            return known
    return None


def read_groups(content: bytes) -> dict[str, dict[str, xarray.Variable]]:
    """Read all variables of a NetCDF file.

    Parameters
    ----------
    content : bytes
        The content of the file.

    Returns
    -------
    dict of str to dict of str to xarray.Variable
        Variables by name for each group. The path of the main group is ``/``. A group also has the
        variables of the groups that contain it. Packed numbers are scaled, and missing ones are
        NaN, as the CF conventions define.

    Raises
    ------
    NetcdfError
        If the content is not NetCDF or damaged, or if no installed package reads its format.
    """
    found = find_format(content)
    if found is None:
        raise NetcdfError("is not a NetCDF file; write it by xarray, netCDF4 or ncgen")
    engine = _choose_engine(found)
    try:
        datasets = _load_datasets(content, engine)
    except Exception as error:  # Engines raise errors of many kinds for damaged files.
        reason = " ".join(str(error).split()[:20])
        message = f"cannot be read as {found.title} ({reason}); write or copy the file again"
        raise NetcdfError(message) from None
    groups: dict[str, dict[str, xarray.Variable]] = {}
    for group in sorted(datasets, key=lambda path: path.count("/")):
        parent = group.rpartition("/")[0] or "/"
        variables = _decode_variables(datasets[group])
        groups[group] = {**groups.get(parent, {}), **variables}
    return groups


def _choose_engine(wanted: NetcdfFormat) -> str:
    """Return the first installed engine that reads a format, or raise `NetcdfError`."""
    for engine in wanted.engines:
        if find_spec(ENGINE_MODULES[engine]) is not None:
            return engine
    packages = " or ".join(ENGINE_MODULES[engine] for engine in wanted.engines)
    reason = f"is {wanted.title}, which is read by {packages}, which is not installed"
    advice = 'run: pip install "pvdf-fem[netcdf]", or convert it, as by: nccopy -k classic OLD NEW'
    raise NetcdfError(f"{reason}; {advice}")


def _load_datasets(content: bytes, engine: str) -> dict[str, xarray.Dataset]:
    """Load the datasets of all groups as they are stored, by the path of the group."""
    import xarray  # slow to import

    # `open_groups` of xarray 2026.9 ignores `decode_cf=False`.
    decoders = ("mask_and_scale", "decode_times", "decode_timedelta", "concat_characters")
    options: dict[str, Any] = dict.fromkeys(decoders, False)
    options |= {"decode_coords": False, "engine": engine}
    if engine == "scipy":  # It reads formats without groups.
        with xarray.open_dataset(BytesIO(content), **options) as data:
            return {"/": data.load()}
    if engine == "h5netcdf":
        options["phony_dims"] = "access"
    with TemporaryDirectory() as folder:  # netCDF4 reads no bytes.
        path = Path(folder) / "copy.nc"
        path.write_bytes(content)
        datasets = xarray.open_groups(path, **options)
        try:
            return {group: data.load() for group, data in datasets.items()}
        finally:
            for data in datasets.values():
                data.close()


def _decode_variables(stored: xarray.Dataset) -> dict[str, xarray.Variable]:
    """Scale the packed numbers of a dataset, and replace the missing ones by NaN."""
    import xarray

    with warnings.catch_warnings():
        # A variable may have several values that mean missing; all of them become NaN.
        warnings.simplefilter("ignore", xarray.SerializationWarning)
        decoded = xarray.decode_cf(stored, decode_times=False, decode_timedelta=False)
    variables: dict[str, xarray.Variable] = {}
    for name, variable in decoded.variables.items():
        if variable.dtype.kind in "iuf":
            original = stored.variables.get(name, variable)
            is_missing = _find_missing(original.values, original.attrs)
            values = np.where(is_missing, np.nan, variable.values.astype(float))
            variable = xarray.Variable(variable.dims, values, variable.attrs)
        variables[str(name)] = variable
    return variables


def _find_missing(values: Array, attributes: Mapping[str, Any]) -> Array:
    """Find stored numbers that are missing by rules of NetCDF that xarray does not apply.

    They are the cells that have never been written, and those outside the valid range.
    """
    is_missing = np.zeros(values.shape, bool)
    default = DEFAULT_FILL_VALUES.get(values.dtype.str[1:])
    if default is not None and "_FillValue" not in attributes:
        is_missing |= values == default
    lowest, highest = attributes.get("valid_range", (-np.inf, np.inf))
    is_missing |= values < attributes.get("valid_min", lowest)
    is_missing |= values > attributes.get("valid_max", highest)
    return is_missing
