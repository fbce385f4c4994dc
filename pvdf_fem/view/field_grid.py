"""Fields of a solution on a square grid, as an xarray dataset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.point_values import COMPONENT_NAMES, PointValues
from pvdf_fem.scene.arguments import coerce

#: Maximum number of coordinates along an axis of a grid.
MAX_COORDINATES = 2001


def make_grid_coordinates(
    low_mm: float, high_mm: float, step_mm: float, max_coordinates: int = MAX_COORDINATES
) -> Array:
    """Return the coordinates along one axis of a grid that covers the film.

    Parameters
    ----------
    low_mm, high_mm : float
        Minimum and maximum coordinate of the film in mm.
    step_mm : float
        Distance between neighbouring coordinates in mm.
    max_coordinates : int
        Maximum number of coordinates, which limits how small the step may be.

    Returns
    -------
    ndarray, shape (n,)
        The multiples of the step in mm from the minimum to the maximum.

    Raises
    ------
    ValueError
        If the step is larger than half the width of the film, or smaller than the width divided by
        `max_coordinates`.
    """
    width_mm = high_mm - low_mm
    least_mm = width_mm / max_coordinates
    step_mm = coerce("step_mm", step_mm, float, (least_mm, 0.5 * width_mm), "mm")
    first = math.ceil(low_mm / step_mm - 1e-9)
    last = math.floor(high_mm / step_mm + 1e-9)
    return step_mm * np.arange(first, last + 1, dtype=np.float64)


def make_field_dataset(values: PointValues, scene: str) -> xarray.Dataset:
    """Make an xarray dataset from the values of all fields on a square grid.

    Parameters
    ----------
    values : PointValues
        Values at points of a grid. y is constant along a row, and x along a column.
    scene : str
        Text of the scene, which becomes an attribute of the dataset.

    Returns
    -------
    xarray.Dataset
        Fields with the dimensions ``y_mm`` and ``x_mm``. Vectors and tensors have a third
        dimension for their components.
    """
    grid = ("y_mm", "x_mm")
    variables: dict[str, Any] = {
        "deflection_mm": (
            grid,
            values.deflection_mm,
            {"long_name": "deflection", "units": "mm"},
        ),
        "charge_density_pC_mm2": (
            grid,
            values.charge_density_pC_mm2,
            {"long_name": "charge density", "units": "pC/mm2"},
        ),
    }
    coordinates: dict[str, Any] = {"x_mm": values.x_mm[0], "y_mm": values.y_mm[:, 0]}
    dimensions = ("direction", "slope_component", "strain_component", "stress_component")
    for dimension, (name, components) in zip(dimensions, COMPONENT_NAMES.items(), strict=True):
        variables[name] = ((*grid, dimension), getattr(values, name))
        coordinates[dimension] = list(components)
    return xarray.Dataset(variables, coordinates, {"scene": scene})
