"""Charges over a grid as an xarray dataset, and as a NetCDF file."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from pvdf_fem import __version__
from pvdf_fem.batch.plan import SweepPlan
from pvdf_fem.batch.store import Record
from pvdf_fem.electrodes.channel import compute_readings_V
from pvdf_fem.files import replace_file
from pvdf_fem.scene.keys import split_unit
from pvdf_fem.studies.scene_grid import SceneGrid

#: Unit signs for ASCII in files.
_IN_ASCII = str.maketrans({"µ": "u", "Ω": "Ohm", "²": "2", "³": "3"})
_BESIDE = "charge_error_pC status"  # what CF has beside charges


def make_sweep_dataset(
    grid: SceneGrid, plan: SweepPlan, records: Iterable[tuple[int, Record]]
) -> xarray.Dataset:
    """The charges of a grid's scenes.

    `records` belong to the distinct scenes, with indices in the plan, in arbitrary order. The
    dataset has a dimension for each axis, and `electrode`. The variables `charge_pC` and
    `charge_error_pC` (total charges), `rest_charge_pC` and `rest_charge_error_pC` (the untouched
    film), `charge_change_pC` and `charge_change_error_pC`, and with ``[readout]`` `reading_V` have
    all dimensions, with NaN where there is no charge; `status` and `deflection_max_mm` have those
    of the axes. Variables have the CF attributes `long_name` and `units`, and coordinates an
    attribute `key`, the varied scene key.
    """
    scenes = plan.scenes
    layouts = {scene.electrodes: scene.electrode_list for scene in scenes}
    electrodes = (electrode for layout in layouts.values() for electrode in layout)
    names = list(dict.fromkeys(electrode.name for electrode in electrodes))
    count = len(scenes)
    charge, error, rest, rest_error, reading = np.full((5, count, len(names)), np.nan)
    deflection, status = np.full(count, np.nan), np.full(count, "", dtype="U32")
    for index, record in records:
        status[index] = record.status
        columns = [names.index(e.name) for e in scenes[index].electrode_list]
        film, observable = scenes[index].film, scenes[index].numerics.observable
        d = film.d31_pC_N, film.d32_pC_N
        for values, errors, forces in (
            (charge, error, record.integrals_by(observable)),
            (rest, rest_error, record.unloaded),
        ):
            values[index, columns] = forces.charges(d)
            errors[index, columns] = forces.charge_errors(d)
        if record.converged:
            deflection[index] = record.deflection_max_mm
        if scenes[index].readout is not None:
            both = charge[index, columns], (charge[index] - rest[index])[columns]
            reading[index, columns] = compute_readings_V(scenes[index], *both)
    dims, first = [axis.name for axis in grid.axes], plan.first
    over = {1: dims, 2: [*dims, "electrode"]}

    def over_grid(values: Any) -> Any:
        return values[first].reshape(*grid.shape, *values.shape[1:])

    variables: dict[str, Any] = {
        "charge_pC": (
            charge,
            {**make_attributes("total charge", "pC"), "ancillary_variables": _BESIDE},
        ),
        "charge_error_pC": (error, make_attributes("estimated error of the total charge", "pC")),
        "rest_charge_pC": (rest, make_attributes("charge without a touch", "pC")),
        "rest_charge_error_pC": (
            rest_error,
            make_attributes("estimated error without a touch", "pC"),
        ),
        "charge_change_pC": (
            charge - rest,
            make_attributes("change of the charge by the touch", "pC"),
        ),
        "charge_change_error_pC": (
            error + rest_error,
            make_attributes("its estimated error", "pC"),
        ),
        "deflection_max_mm": (deflection, make_attributes("largest deflection", "mm")),
        "status": (status, {"long_name": "how the solve ended"}),
    }
    if any(scene.readout for scene in scenes):
        variables["reading_V"] = reading, make_attributes("reading just after a sudden touch", "V")
    return xarray.Dataset(
        {
            name: (over[values.ndim], over_grid(values), about)
            for name, (values, about) in variables.items()
        },
        {**make_coordinates(grid), "electrode": ("electrode", names, {"long_name": "electrode"})},
        {
            "Conventions": "CF-1.11",
            "title": "charges of the electrodes of a PVDF membrane",
            "scene": grid.scene.to_toml(),
            "source": f"pvdf_fem {__version__}",
        },
    )


def make_coordinates(grid: SceneGrid) -> dict[str, Any]:
    """Coordinates along a grid's axes, with their meaning."""
    ends = Counter(_end(key) for axis in grid.axes for key in axis.values)
    # xarray takes a coordinate with the name of a dimension for its index
    ends.update(axis.name for axis in grid.axes)
    coordinates: dict[str, Any] = {}
    for axis in grid.axes:
        for key, values in axis.values.items():
            name = _end(key) if ends[_end(key)] == 1 else key
            if len(axis.values) == 1:
                name = axis.name
            coordinates[name] = (axis.name, _labels(values), {"key": key, **describe_key(key)})
        for name, further in axis.beside.items():
            coordinates[name] = (axis.name, list(further), describe_key(name))
    return coordinates


def _end(key: str) -> str:
    return key.rpartition(".")[-1]


def _labels(values: tuple[Any, ...]) -> list[Any]:
    """Values as numbers or as texts; tables and lists in full."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(value) for value in values]
    return [
        value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        for value in values
    ]


def describe_key(key: str) -> dict[str, str]:
    """The attributes of what a key stands for: ``film.thickness_um`` is film thickness in um."""
    words, unit = split_unit(key)
    return make_attributes(words, unit.translate(_IN_ASCII))


def make_attributes(long_name: str, unit: str) -> dict[str, str]:
    """The attributes of a variable."""
    return {"long_name": long_name, "units": unit} if unit else {"long_name": long_name}


def write_netcdf(data: xarray.Dataset, path: Path) -> None:
    """Write a dataset as NetCDF 3, which xarray reads back equal."""
    with replace_file(path) as part:
        data.to_netcdf(part, format="NETCDF3_64BIT", engine="scipy")
