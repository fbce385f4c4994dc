"""Fields on a square grid, as an xarray dataset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray

from pvdf_fem.arrays import Array
from pvdf_fem.charges.point_values import PointValues

#: Dimensions and names of components.
_COMPONENTS = {
    "displacement_mm": ("direction", ["u", "v", "w"]),
    "slopes": ("slope_component", ["dw/dx", "dw/dy"]),
    "strain": ("strain_component", ["E11", "E22", "2 E12"]),
    "stress_MPa": ("stress_component", ["S11", "S22", "S12"]),
}


def ticks(radius_mm: float, step_mm: float, most: int = 2001) -> Array:
    """Coordinates of a grid about the film's centre, (n,); ValueError for more than `most`."""
    if not step_mm > 0.0 or radius_mm / step_mm > 0.5 * most:
        least = 2.0 * radius_mm / most
        raise ValueError(f"step_mm = {step_mm!r}: is out of range; give at least {least:.2g} mm")
    count = math.floor(radius_mm / step_mm + 1e-9)
    return step_mm * np.arange(-count, count + 1, dtype=np.float64)


def dataset_of(values: PointValues, scene: str) -> xarray.Dataset:
    """Values at a grid's points (a row has constant y), with the scene's text."""
    grid = ("y_mm", "x_mm")
    about = {"long_name": "deflection", "units": "mm"}
    variables: dict[str, Any] = {"deflection_mm": (grid, values.deflection_mm, about)}
    about = {"long_name": "charge density", "units": "pC/mm2"}
    variables["charge_density_pC_mm2"] = (grid, values.charge_density_pC_mm2, about)
    coordinates: dict[str, Any] = {"x_mm": values.x_mm[0], "y_mm": values.y_mm[:, 0]}
    for name, (dimension, components) in _COMPONENTS.items():
        variables[name] = ((*grid, dimension), getattr(values, name))
        coordinates[dimension] = components
    return xarray.Dataset(variables, coordinates, {"scene": scene})
