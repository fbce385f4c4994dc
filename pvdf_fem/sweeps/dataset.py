"""The charges of a grid as an xarray dataset, and as a NetCDF file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from pvdf_fem import __version__
from pvdf_fem.scene.scene_file import quote
from pvdf_fem.sweeps.grid import Grid
from pvdf_fem.sweeps.plan import Plan
from pvdf_fem.sweeps.store import Record

# What the end of a key says about the unit.
_UNITS = {
    "pC_N": "pC/N",
    "kg_m3": "kg/m3",
    "per_K": "1/K",
    "mm": "mm",
    "um": "um",
    "GPa": "GPa",
    "deg": "degree",
    "pC": "pC",
    "K": "K",
    "N": "N",
}


def dataset(grid: Grid, plan: Plan, records: Iterable[tuple[int, Record]]) -> xarray.Dataset:
    """The records of a grid's scenes.

    Parameters
    ----------
    grid : Grid
    plan : Plan
        That of the grid's scenes.
    records : iterable of (int, Record)
        Of every first of equal scenes, in any order.

    Returns
    -------
    xarray.Dataset
        A dimension for each axis, and `electrode`. Variables `charge_pC` and `charge_error_pC` over
        all of them, NaN where there is none; `status` and `deflection_max_mm` over the axes.
        Numbers have the attribute `units`, coordinates the `key` of the scene they stand for.
    """
    scenes = plan.scenes
    layouts = {scene.electrodes: scene for scene in scenes}
    every = (electrode.name for scene in layouts.values() for electrode in scene.electrode_list)
    names = list(dict.fromkeys(every))
    count = len(scenes)
    charge, error = np.full((2, count, len(names)), np.nan)
    deflection, status = np.full(count, np.nan), np.full(count, "", dtype="U32")
    for index, record in records:
        status[index] = record.status
        if not record.converged:
            continue
        film, observable = scenes[index].film, scenes[index].numerics.observable
        d = film.d31_pC_N, film.d32_pC_N
        columns = [names.index(name) for name in record.electrodes]
        charge[index, columns] = list(record.charges_pC(*d, observable).values())
        error[index, columns] = list(record.charge_errors_pC(*d, observable).values())
        deflection[index] = record.deflection_max_mm
    dims, first = [axis.name for axis in grid.axes], plan.first

    def over_grid(values: Any) -> Any:
        return values[first].reshape(*grid.shape, *values.shape[1:])

    return xarray.Dataset(
        {
            "charge_pC": ([*dims, "electrode"], over_grid(charge), {"units": "pC"}),
            "charge_error_pC": ([*dims, "electrode"], over_grid(error), {"units": "pC"}),
            "deflection_max_mm": (dims, over_grid(deflection), {"units": "mm"}),
            "status": (dims, over_grid(status)),
        },
        {**_coordinates(grid), "electrode": names},
        {"scene": grid.scene.to_toml(), "source": f"pvdf_fem {__version__}"},
    )


def _coordinates(grid: Grid) -> dict[str, Any]:
    keys = [key for axis in grid.axes for key in axis.values]
    last = [key.split(".")[-1] for key in keys]
    names = {key: one if last.count(one) == 1 else key for key, one in zip(keys, last, strict=True)}
    found: dict[str, Any] = {}
    for axis in grid.axes:
        for key, values in axis.values.items():
            # a coordinate with the name of its dimension is the index, which one key can be
            name = axis.name if len(axis.values) == 1 else names[key]
            name = key if name == axis.name and len(axis.values) > 1 else name
            found[name] = (axis.name, _plain(values), {"key": key, **_unit(key)})
        for name, along in axis.beside.items():
            found[name] = (axis.name, list(along), _unit(name))
    return found


def _plain(values: tuple[Any, ...]) -> list[Any]:
    """Numbers, or texts; what is neither as a scene file shows it."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(value) for value in values]
    return [value if isinstance(value, str) else quote(value) for value in values]


def _unit(key: str) -> dict[str, str]:
    ends = "|".join(_UNITS)
    match = re.search(rf"_({ends})$", key)
    return {"units": _UNITS[match[1]]} if match else {}


def write_netcdf(data: xarray.Dataset, path: Path) -> None:
    """Write a dataset as NetCDF 3, which xarray reads back equal."""
    from pvdf_fem.files import replacing

    with replacing(path) as part:
        data.to_netcdf(part, format="NETCDF3_64BIT", engine="scipy")
