"""Fields on a square grid, as an xarray dataset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.point_values import COMPONENT_NAMES, PointValues
from pvdf_fem.scene.arguments import coerce

#: Largest number of coordinates of a grid.
MAX_COORDINATES = 2001


def make_grid_coordinates(
    radius_mm: float, step_mm: float, max_coordinates: int = MAX_COORDINATES
) -> Array:
    """Return the coordinates of a square grid about the film's centre.

    Parameters
    ----------
    radius_mm : float
        Radius of the film in mm.
    step_mm : float
        Distance of neighbouring coordinates in mm.
    max_coordinates : int
        Largest number of coordinates.

    Returns
    -------
    ndarray, shape (n,)
        In mm, within the radius.

    Raises
    ------
    ValueError
        For too many coordinates, or a step beyond the radius.
    """
    least_mm = 2.0 * radius_mm / max_coordinates
    step_mm = coerce("step_mm", step_mm, float, (least_mm, radius_mm), "mm")
    count = math.floor(radius_mm / step_mm + 1e-9)
    return step_mm * np.arange(-count, count + 1, dtype=np.float64)


def make_field_dataset(values: PointValues, scene: str) -> xarray.Dataset:
    """Return the fields on a grid as a dataset.

    Parameters
    ----------
    values : PointValues
        Values at the points (n, n) of a grid, with constant y along a row.
    scene : str
        Text of the scene, for the attributes.

    Returns
    -------
    xarray.Dataset
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
