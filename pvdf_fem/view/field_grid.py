"""Fields on a square grid, as an xarray dataset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.point_values import COMPONENTS, PointValues
from pvdf_fem.scene.arguments import coerce


def make_grid_coordinates(radius_mm: float, step_mm: float, most: int = 2001) -> Array:
    """Coordinates of a grid about the film's centre, (n,); ValueError for more than `most`."""
    step_mm = coerce("step_mm", step_mm, float, (2.0 * radius_mm / most, radius_mm), "mm")
    count = math.floor(radius_mm / step_mm + 1e-9)
    return step_mm * np.arange(-count, count + 1, dtype=np.float64)


def make_field_dataset(values: PointValues, scene: str) -> xarray.Dataset:
    """Values at a grid's points (a row has constant y), with the scene's text."""
    grid = ("y_mm", "x_mm")
    about = {"long_name": "deflection", "units": "mm"}
    variables: dict[str, Any] = {"deflection_mm": (grid, values.deflection_mm, about)}
    about = {"long_name": "charge density", "units": "pC/mm2"}
    variables["charge_density_pC_mm2"] = (grid, values.charge_density_pC_mm2, about)
    coordinates: dict[str, Any] = {"x_mm": values.x_mm[0], "y_mm": values.y_mm[:, 0]}
    dimensions = "direction", "slope_component", "strain_component", "stress_component"
    for dimension, (name, components) in zip(dimensions, COMPONENTS.items(), strict=True):
        variables[name] = ((*grid, dimension), getattr(values, name))
        coordinates[dimension] = [*components]
    return xarray.Dataset(variables, coordinates, {"scene": scene})
