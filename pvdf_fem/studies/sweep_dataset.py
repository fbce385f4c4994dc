"""The dataset of a sweep: charges over a grid of scenes as xarray dataset and NetCDF file."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from pvdf_fem import __version__
from pvdf_fem.arrays import Array
from pvdf_fem.batch.plan import SweepPlan
from pvdf_fem.batch.store import Record
from pvdf_fem.electrodes.channel import compute_readings_V
from pvdf_fem.files import replace_file
from pvdf_fem.scene.keys import split_unit
from pvdf_fem.scene.scene import Scene
from pvdf_fem.studies.scene_grid import SceneGrid

#: Signs of units in ASCII, for files.
_ASCII_SIGNS = str.maketrans({"µ": "u", "Ω": "Ohm", "²": "2", "³": "3"})
#: Variables that belong to the charges, as the CF conventions name them.
_ANCILLARY = "charge_error_pC status"
_CHARGE_VARIABLES = {
    "charge_pC": "total charge",
    "charge_error_pC": "estimated error of the total charge",
    "rest_charge_pC": "charge without a touch",
    "rest_charge_error_pC": "estimated error without a touch",
    "charge_change_pC": "change of the charge by the touch",
    "charge_change_error_pC": "its estimated error",
}


class SweepColumns:
    """Results of the distinct scenes of a sweep as arrays, NaN where there is none."""

    def __init__(self, scenes: Sequence[Scene], electrodes: Sequence[str]) -> None:
        """Make empty arrays.

        Parameters
        ----------
        scenes : sequence of Scene
            The scenes.
        electrodes : sequence of str
            Names of all electrodes of the scenes.
        """
        self.scenes = scenes
        self.column_of = {name: column for column, name in enumerate(electrodes)}
        shape = (len(scenes), len(electrodes))
        self.charges_pC = np.full(shape, np.nan)
        self.charge_errors_pC = np.full(shape, np.nan)
        self.unloaded_pC = np.full(shape, np.nan)
        self.unloaded_errors_pC = np.full(shape, np.nan)
        self.readings_V = np.full(shape, np.nan)
        self.deflections_mm = np.full(len(scenes), np.nan)
        self.statuses = np.full(len(scenes), "", dtype="U32")

    def fill(self, index: int, record: Record) -> None:
        """Fill in the record of a scene, by the scene's index."""
        scene = self.scenes[index]
        columns = [self.column_of[electrode.name] for electrode in scene.electrode_list]
        coefficients = (scene.film.d31_pC_N, scene.film.d32_pC_N)
        loaded = record.integrals_by(scene.numerics.observable)
        self.charges_pC[index, columns] = loaded.charges(coefficients)
        self.charge_errors_pC[index, columns] = loaded.charge_errors(coefficients)
        unloaded = record.unloaded
        self.unloaded_pC[index, columns] = unloaded.charges(coefficients)
        self.unloaded_errors_pC[index, columns] = unloaded.charge_errors(coefficients)
        self.statuses[index] = record.status
        if record.converged:
            self.deflections_mm[index] = record.deflection_max_mm
        if scene.readout is not None:
            charges_pC = self.charges_pC[index, columns]
            changes_pC = charges_pC - self.unloaded_pC[index, columns]
            self.readings_V[index, columns] = compute_readings_V(scene, charges_pC, changes_pC)

    def get_charge_columns(self) -> dict[str, Array]:
        """Return the arrays of charges, (scenes, electrodes), by variables of the dataset."""
        return {
            "charge_pC": self.charges_pC,
            "charge_error_pC": self.charge_errors_pC,
            "rest_charge_pC": self.unloaded_pC,
            "rest_charge_error_pC": self.unloaded_errors_pC,
            "charge_change_pC": self.charges_pC - self.unloaded_pC,
            "charge_change_error_pC": self.charge_errors_pC + self.unloaded_errors_pC,
        }


def make_sweep_dataset(
    grid: SceneGrid, plan: SweepPlan, records: Iterable[tuple[int, Record]]
) -> xarray.Dataset:
    """Make the dataset of a sweep.

    Parameters
    ----------
    grid : SceneGrid
        The scenes with their axes.
    plan : SweepPlan
        The distinct scenes among them.
    records : iterable of (int, Record)
        Records of the distinct scenes with their indices in the plan, in any order.

    Returns
    -------
    xarray.Dataset
        With a dimension for each axis, and ``electrode``. ``charge_pC`` and ``charge_error_pC``
        (total charges), ``rest_charge_pC`` and ``rest_charge_error_pC`` (unloaded film),
        ``charge_change_pC`` and ``charge_change_error_pC``, and with ``[readout]`` ``reading_V``
        have all dimensions, and are NaN where there is no charge; ``status`` and
        ``deflection_max_mm`` have those of the axes. Variables have the CF attributes
        ``long_name`` and ``units``, and coordinates an attribute ``key``, the varied scene key.
    """
    electrodes = _list_electrodes(plan.scenes)
    columns = SweepColumns(plan.scenes, electrodes)
    for index, record in records:
        columns.fill(index, record)
    dims = [axis.name for axis in grid.axes]
    by_electrode = [*dims, "electrode"]

    def arrange(values: Any) -> Any:
        """Arrange values of distinct scenes, (scenes, ...), over the grid."""
        return values[plan.first].reshape(*grid.shape, *values.shape[1:])

    variables: dict[str, Any] = {}
    for name, values in columns.get_charge_columns().items():
        attributes = make_attributes(_CHARGE_VARIABLES[name], "pC")
        if name == "charge_pC":
            attributes["ancillary_variables"] = _ANCILLARY
        variables[name] = (by_electrode, arrange(values), attributes)
    attributes = make_attributes("largest deflection", "mm")
    variables["deflection_max_mm"] = (dims, arrange(columns.deflections_mm), attributes)
    attributes = make_attributes("how the solve ended")
    variables["status"] = (dims, arrange(columns.statuses), attributes)
    if any(scene.readout for scene in plan.scenes):
        attributes = make_attributes("reading just after a sudden touch", "V")
        variables["reading_V"] = (by_electrode, arrange(columns.readings_V), attributes)
    coordinates = make_coordinates(grid)
    coordinates["electrode"] = ("electrode", electrodes, make_attributes("electrode"))
    return xarray.Dataset(
        variables,
        coordinates,
        {
            "Conventions": "CF-1.11",
            "title": "charges of the electrodes of a PVDF membrane",
            "scene": grid.scene.to_toml(),
            "source": f"pvdf_fem {__version__}",
        },
    )


def _list_electrodes(scenes: Sequence[Scene]) -> list[str]:
    """Return the distinct names of all electrodes of scenes, in the order of their first scene."""
    layouts = {scene.electrodes: scene.electrode_list for scene in scenes}
    names = []
    for electrodes in layouts.values():
        names += [electrode.name for electrode in electrodes]
    return list(dict.fromkeys(names))


def make_coordinates(grid: SceneGrid) -> dict[str, Any]:
    """Make the coordinates along a grid's axes, with their attributes.

    A coordinate is named by the last part of its key, or by its whole key where another coordinate
    or an axis has that name.
    """
    name_counts = Counter(axis.name for axis in grid.axes)
    for axis in grid.axes:
        name_counts.update(_get_last_part(key) for key in axis.values)
    coordinates: dict[str, Any] = {}
    for axis in grid.axes:
        for key, values in axis.values.items():
            last_part = _get_last_part(key)
            name = last_part if name_counts[last_part] == 1 else key
            if len(axis.values) == 1:
                name = axis.name  # xarray takes it for the index of the dimension
            attributes = {"key": key, **describe_key(key)}
            coordinates[name] = (axis.name, _make_labels(values), attributes)
        for name, numbers in axis.beside.items():
            coordinates[name] = (axis.name, list(numbers), describe_key(name))
    return coordinates


def _get_last_part(key: str) -> str:
    """Return the name of a key without its tables."""
    return key.rpartition(".")[-1]


def _make_labels(values: Sequence[Any]) -> list[Any]:
    """Return values as numbers, or as texts where they are not all numbers."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(value) for value in values]
    labels = []
    for value in values:
        is_text = isinstance(value, str)
        labels.append(value if is_text else json.dumps(value, ensure_ascii=False))
    return labels


def describe_key(key: str) -> dict[str, str]:
    """Return attributes of a variable by its key: of ``film.thickness_um`` film thickness, um."""
    words, unit = split_unit(key)
    return make_attributes(words, unit.translate(_ASCII_SIGNS))


def make_attributes(long_name: str, unit: str = "") -> dict[str, str]:
    """Return the CF attributes of a variable with a description and a unit."""
    if not unit:
        return {"long_name": long_name}
    return {"long_name": long_name, "units": unit}


def write_netcdf(data: xarray.Dataset, path: Path) -> None:
    """Write a dataset as NetCDF 3, which xarray reads back equal."""
    with replace_file(path) as part:
        data.to_netcdf(part, format="NETCDF3_64BIT", engine="scipy")
