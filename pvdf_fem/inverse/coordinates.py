"""Coordinates of searches for touches: their columns, longest steps and extents.

Response and domain decide them. The coordinates themselves are described in
`pvdf_fem.inverse.touch.location_problem`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.changes import parse_key
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    count_probes,
    find_rotation_periods_deg,
)
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: Maximum steps of searches by base quantity: of a position as a fraction of the reach, of a
#: rotation in degrees, of a logarithm of the force, of a tangential force in N, and of a
#: temperature in K. The reach is the maximum distance of a touch from the centre.
LONGEST_STEPS = {
    "x_mm": 0.25,
    "y_mm": 0.25,
    "rotation_deg": 5.0,
    "force_N": 1.0,
    "tangential_N": 1.0,
    "temperature_K": 5.0,
}
#: Extent of the domain of tangential forces and temperatures, as a multiple of the maximum step.
EXTENT = 4.0


def get_base_quantity(quantity: str) -> str:
    """Return a quantity's name without indices: ``x_mm`` for ``probe[1].x_mm``."""
    parts = parse_key(quantity)
    return next(name for name in LONGEST_STEPS if name in parts)


def slice_quantity(response: ChargeFunction, column: int) -> slice:
    """Return the columns of one quantity, such as x, for all probes.

    Parameters
    ----------
    response : ChargeFunction
        The response of one or several probes.
    column : int
        Column of the quantity for one probe, a `TouchColumn`.

    Returns
    -------
    slice
        Columns of the quantity in arrays of touches or coordinates.
    """
    width = len(TOUCH_QUANTITIES)
    return slice(column, width * count_probes(response), width)


@lru_cache(maxsize=8)
def compute_longest_steps(response: ChargeFunction) -> Array:
    """Compute the maximum step of searches along each coordinate.

    Parameters
    ----------
    response : ChargeFunction
        The response with k quantities; results are cached for the last few responses.

    Returns
    -------
    ndarray, shape (k,)
        Maximum steps: `LONGEST_STEPS`, but in mm for positions.
    """
    steps = np.array([LONGEST_STEPS[get_base_quantity(name)] for name in response.quantity_names])
    for column in (TouchColumn.X, TouchColumn.Y):
        steps[slice_quantity(response, column)] *= response.domain.reach_mm
    return steps


@lru_cache(maxsize=8)
def compute_extents(response: ChargeFunction) -> Array:
    """Compute the extent of the response's domain along each coordinate.

    It serves as the prior standard deviation of a coordinate.

    Parameters
    ----------
    response : ChargeFunction
        The response with k quantities; results are cached for the last few responses.

    Returns
    -------
    ndarray, shape (k,)
        Extents: the reach in mm for positions, half a period for rotations, the range of the
        logarithm for forces, and `EXTENT` times the maximum step for further quantities.
    """
    lowest, highest = response.domain.log_force
    sizes = EXTENT * compute_longest_steps(response)
    for column in (TouchColumn.X, TouchColumn.Y):
        sizes[slice_quantity(response, column)] = response.domain.reach_mm
    half_periods = 0.5 * find_rotation_periods_deg(response)
    sizes[slice_quantity(response, TouchColumn.ROTATION)] = half_periods
    sizes[slice_quantity(response, TouchColumn.FORCE)] = highest - lowest
    return sizes
