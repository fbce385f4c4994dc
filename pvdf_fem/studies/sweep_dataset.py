"""The dataset of a sweep: charges over a grid of scenes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.batch.plan import SweepPlan
from pvdf_fem.batch.store import Record
from pvdf_fem.electrodes.channel import compute_readings_V
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.studies.scene_grid import SceneGrid
from pvdf_fem.studies.sweep_axis import make_full_name
from pvdf_fem.view.files.netcdf import describe_key, make_attributes, make_dataset

#: Names of the ancillary variables (CF conventions) of `charge_pC`.
_ANCILLARY = "charge_error_pC status_flag"
#: Meanings of the values 0, 1, ... of `status_flag`. The first is that of an empty status.
_FLAG_MEANINGS = ("not_solved", *Status)
_CHARGE_VARIABLES = {
    "charge_pC": "total charge",
    "charge_error_pC": "estimated error of the total charge",
    "rest_charge_pC": "charge of the unloaded film",
    "rest_charge_error_pC": "estimated error of the charge of the unloaded film",
    "charge_change_pC": "change of the charge due to the load",
    "charge_change_error_pC": "estimated error of the change of the charge",
}


class SweepColumns:
    """Results of the distinct scenes of a sweep as arrays.

    Numbers without a result are NaN, and statuses without a result are empty.
    """

    def __init__(self, scenes: Sequence[Scene], electrodes: Sequence[str]) -> None:
        """Make arrays for the results, all of which are still missing.

        Parameters
        ----------
        scenes : sequence of Scene
            Distinct scenes of the sweep.
        electrodes : sequence of str
            Distinct names of the electrodes of all scenes; each has a column of the arrays.
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

    def store_record(self, index: int, record: Record) -> None:
        """Store the results of a scene in the arrays.

        The deflection is stored only if the solve converged, the readings only if the scene has a
        readout.

        Parameters
        ----------
        index : int
            Index of the scene in `scenes`.
        record : Record
            Result of the solve of this scene.
        """
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
        """Return the charges and their errors, by the name of the variable in the dataset.

        Returns
        -------
        dict of str to ndarray, shape (scenes, electrodes)
            Values in pC. A change is the difference between the total charge and the charge of the
            unloaded film, its error the sum of their errors.
        """
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
    """Make the dataset of a sweep from the records of its scenes.

    Parameters
    ----------
    grid : SceneGrid
        Grid of scenes with its axes.
    plan : SweepPlan
        Plan with the distinct scenes of the grid.
    records : iterable of (int, Record)
        Records of the distinct scenes with their indices in the plan, in any order.

    Returns
    -------
    xarray.Dataset
        Dataset with a dimension for each axis and the dimension ``electrode``. Variables with all
        dimensions: total charges ``charge_pC``, charges of the unloaded film ``rest_charge_pC``,
        their differences ``charge_change_pC``, their errors ``charge_error_pC``,
        ``rest_charge_error_pC`` and ``charge_change_error_pC``, and with ``[readout]`` the
        ``reading_V``; they are NaN where there is no charge. Variables with the dimensions of the
        axes: ``status``, ``status_flag`` (the same as a number) and ``deflection_max_mm``.
        Variables have the CF attributes ``long_name`` and ``units``; coordinates also have the
        attribute ``key``, the scene key that varies.
    """
    electrodes = _list_electrodes(plan.scenes)
    columns = SweepColumns(plan.scenes, electrodes)
    for index, record in records:
        columns.store_record(index, record)
    dims = [axis.name for axis in grid.axes]
    by_electrode = [*dims, "electrode"]

    def arrange(values: Any) -> Any:
        """Arrange values over the grid; their first axis is that of the distinct scenes."""
        return values[plan.first].reshape(*grid.shape, *values.shape[1:])

    variables: dict[str, Any] = {}
    for name, values in columns.get_charge_columns().items():
        attributes = make_attributes(_CHARGE_VARIABLES[name], "pC")
        if name == "charge_pC":
            attributes["ancillary_variables"] = _ANCILLARY
        variables[name] = (by_electrode, arrange(values), attributes)
    attributes = make_attributes("largest deflection", "mm")
    variables["deflection_max_mm"] = (dims, arrange(columns.deflections_mm), attributes)
    attributes = make_attributes("status of the solve")
    statuses = arrange(columns.statuses)
    variables["status"] = (dims, statuses, attributes)
    variables["status_flag"] = _make_status_flags(dims, statuses)
    if any(scene.readout for scene in plan.scenes):
        attributes = make_attributes("reading just after a sudden touch", "V")
        variables["reading_V"] = (by_electrode, arrange(columns.readings_V), attributes)
    coordinates = make_coordinates(grid)
    coordinates["electrode"] = ("electrode", electrodes, make_attributes("electrode"))
    title = "charges of the electrodes of a PVDF membrane"
    return make_dataset(variables, coordinates, title, {"scene": grid.scene.to_toml()})


def _make_status_flags(dims: Sequence[str], statuses: NDArray[np.str_]) -> xarray.Variable:
    """Make the flag variable of CF for statuses: a number for each, with the list of meanings.

    Parameters
    ----------
    dims : sequence of str
        Dimensions of the statuses.
    statuses : ndarray of str
        Statuses of the solves; empty where there is none.
    """
    flags = np.zeros(statuses.shape, np.int8)
    for value, meaning in enumerate(_FLAG_MEANINGS):
        flags[statuses == meaning] = value
    attributes = make_attributes(
        "status of the solve as a number",
        standard_name="status_flag",
        flag_values=np.arange(len(_FLAG_MEANINGS), dtype=np.int8),
        flag_meanings=" ".join(_FLAG_MEANINGS),
    )
    return xarray.Variable(dims, flags, attributes)


def _list_electrodes(scenes: Sequence[Scene]) -> list[str]:
    """List the distinct names of the electrodes of all scenes, in the order of appearance."""
    layouts = {scene.electrodes: scene.electrode_list for scene in scenes}
    names = []
    for electrodes in layouts.values():
        names += [electrode.name for electrode in electrodes]
    return list(dict.fromkeys(names))


def make_coordinates(grid: SceneGrid) -> dict[str, Any]:
    """Make the coordinates of a dataset along the axes of a grid, with their attributes.

    There is a coordinate for each key that varies. It has the name of its axis if the axis has a
    single key. Otherwise its name is the last part of its key. If this is also that of another key
    or the name of an axis, it is the whole key with underscores: ``probe_x_mm``. The extra
    coordinates of axes are added.
    """
    name_counts = Counter(axis.name for axis in grid.axes)
    for axis in grid.axes:
        name_counts.update(_get_last_key_part(key) for key in axis.values)
    coordinates: dict[str, Any] = {}
    for axis in grid.axes:
        for key, values in axis.values.items():
            last_part = _get_last_key_part(key)
            name = last_part if name_counts[last_part] == 1 else make_full_name(key)
            if len(axis.values) == 1:
                name = axis.name  # A coordinate with the name of its dimension is its index.
            attributes = {"key": key, **describe_key(key)}
            coordinates[name] = (axis.name, _make_coordinate_labels(values), attributes)
        for name, numbers in axis.extra_coordinates.items():
            coordinates[name] = (axis.name, list(numbers), describe_key(name))
    return coordinates


def _get_last_key_part(key: str) -> str:
    """Return the part of a dotted key after the last dot."""
    return key.rpartition(".")[-1]


def _make_coordinate_labels(values: Sequence[Any]) -> list[Any]:
    """Convert the values of a coordinate to floats if all are numbers, otherwise to texts.

    Values that are not texts are then converted to JSON.
    """
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [float(value) for value in values]
    labels = []
    for value in values:
        is_text = isinstance(value, str)
        labels.append(value if is_text else json.dumps(value, ensure_ascii=False))
    return labels
