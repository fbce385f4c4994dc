"""Fields of a solution on a square grid, as an xarray dataset."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import xarray

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.point_values import COMPONENT_NAMES, PointValues
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.view.files.netcdf import make_attributes, make_dataset


class _ComponentField(NamedTuple):
    """How the dataset describes a vector or a tensor."""

    dimension: str  # dimension of the components
    label_name: str  # long name of this dimension
    long_name: str  # long name of the field
    unit: str


_COMPONENT_FIELDS = {
    "displacement_mm": _ComponentField("direction", "direction", "displacement", "mm"),
    "slopes": _ComponentField("slope_component", "derivative", "slopes of the deflection", "1"),
    "strain": _ComponentField("strain_component", "component", "Green-Lagrange strain", "1"),
    "stress_MPa": _ComponentField(
        "stress_component", "component", "second Piola-Kirchhoff stress", "MPa"
    ),
}
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
    density = make_attributes("charge density, also outside electrodes", "pC/mm²")
    variables: dict[str, Any] = {
        "deflection_mm": (grid, values.deflection_mm, make_attributes("deflection", "mm")),
        "charge_density_pC_mm2": (grid, values.charge_density_pC_mm2, density),
    }
    about_x = make_attributes("x in the undeformed film", "mm")
    about_y = make_attributes("y in the undeformed film", "mm")
    coordinates: dict[str, Any] = {
        "x_mm": ("x_mm", values.x_mm[0], about_x),
        "y_mm": ("y_mm", values.y_mm[:, 0], about_y),
    }
    for name, field in _COMPONENT_FIELDS.items():
        dimension = field.dimension
        about = make_attributes(field.long_name, field.unit)
        variables[name] = ((*grid, dimension), getattr(values, name), about)
        labels = list(COMPONENT_NAMES[name])
        coordinates[dimension] = (dimension, labels, make_attributes(field.label_name))
    return make_dataset(variables, coordinates, "fields of a PVDF membrane", {"scene": scene})
