"""Datasets and NetCDF files that follow the CF conventions.

http://cfconventions.org/Data/cf-conventions/cf-conventions-1.11/cf-conventions.html
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from pvdf_fem import __version__
from pvdf_fem.files import replace_file
from pvdf_fem.scene.keys import split_unit

CONVENTIONS = "CF-1.11"
MAX_INTEGER = 2**31 - 1  #: Maximum whole number in an attribute of a NetCDF3 file.
#: Replacements in units, which udunits then knows and which are ASCII.
_UDUNITS = {"µ": "u", "Ω": "ohm", "²": "2", "³": "3", "degrees": "degree"}


def describe_key(key: str) -> dict[str, str]:
    """Make the CF attributes of a scene key.

    Parameters
    ----------
    key : str
        Such as ``thickness_um``.

    Returns
    -------
    dict of str to str
        The words of the key as the long name, and its unit.
    """
    words, unit = split_unit(key)
    return make_attributes(words, unit)


def make_attributes(long_name: str, unit: str = "", **others: Any) -> dict[str, Any]:
    """Make the CF attributes of a variable.

    Parameters
    ----------
    long_name : str
        Words for the variable.
    unit : str
        Unit, which is translated to a spelling of udunits. An empty one is left out.
    **others
        Further attributes, such as ``standard_name``.

    Returns
    -------
    dict

    Examples
    --------
    >>> make_attributes("thickness", "µm")
    {'long_name': 'thickness', 'units': 'um'}
    """
    for sign, replacement in _UDUNITS.items():
        unit = unit.replace(sign, replacement)
    units = {"units": unit} if unit else {}
    return {"long_name": long_name, **units, **others}


def make_dataset(
    variables: Mapping[str, Any],
    coordinates: Mapping[str, Any],
    title: str,
    attributes: Mapping[str, Any],
) -> xarray.Dataset:
    """Make a dataset whose ``to_netcdf`` writes a file that follows the CF conventions.

    Parameters
    ----------
    variables, coordinates : mapping
        Variables by name, as `xarray.Dataset` takes them, with their attributes.
    title : str
        What the dataset contains.
    attributes : mapping
        Further attributes of the dataset, such as ``scene``.

    Returns
    -------
    xarray.Dataset
    """
    about = {"Conventions": CONVENTIONS, "title": title}
    origin = {
        "source": f"pvdf_fem {__version__}",
        "history": f"computed by pvdf_fem {__version__}",
    }
    data = xarray.Dataset(variables, coordinates, {**about, **attributes, **origin})
    leave_out_fill_values(data)
    return data


def leave_out_fill_values(data: xarray.Dataset) -> None:
    """Let xarray write the coordinates of a dataset without ``_FillValue``, as CF requires.

    xarray writes this attribute by default. Coordinates have none, since they are never missing.

    Parameters
    ----------
    data : xarray.Dataset
        The dataset, whose encoding is changed.
    """
    for name in data.coords:
        data.variables[name].encoding["_FillValue"] = None


def write_netcdf(data: xarray.Dataset, path: Path) -> None:
    """Write a dataset to a NetCDF file with 64-bit offsets, from which xarray reads it again.

    Parameters
    ----------
    data : xarray.Dataset
        Dataset of `make_dataset`.
    path : Path
        File to create or replace. Numbers along a dimension that neither increase nor decrease are
        sorted, and repeated ones are left out, as CF requires. Whole numbers of more than 32 bits,
        which the format lacks, are written as text in attributes.
    """
    sorted_data = _sort_coordinates(data)
    leave_out_fill_values(sorted_data)
    for name, value in data.attrs.items():
        if isinstance(value, int) and abs(value) > MAX_INTEGER:
            sorted_data.attrs[name] = str(value)
    with replace_file(path) as part:
        sorted_data.to_netcdf(part, format="NETCDF3_64BIT", engine="scipy")


def _sort_coordinates(data: xarray.Dataset) -> xarray.Dataset:
    """Return a dataset in which the numbers along every dimension increase or decrease."""
    order = {}
    for name in data.dims:
        if name in data.coords and data[name].dtype.kind in "iuf":
            steps = np.diff(data[name])
            if not ((steps > 0.0).all() or (steps < 0.0).all()):
                order[name] = np.unique(data[name], return_index=True)[1]
    return data.isel(order)
