"""Cramér-Rao bounds of touches over a grid of positions, for several designs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.measurement import Measurement
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.touch_domain import TouchColumn, extract_touch


class TouchBound(NamedTuple):
    """Cramér-Rao bound of a touch; all values are NaN if `locate` does not find the touch."""

    place_deviation_mm: float = math.nan  #: Standard deviation of the position.
    force_deviation: float = math.nan  #: Standard deviation of the force, relative to the force.
    ambiguous: float = math.nan  #: 1 if another touch is likely, too, else 0.


#: Variables of the dataset over the positions (fields of `TouchBound`): description and unit.
MAPS = {
    "place_deviation_mm": ("standard deviation of the position", "mm"),
    "force_deviation": ("standard deviation of the force, relative to the force", "1"),
    "ambiguous": ("whether another touch is likely", "1"),
}


class PositionGrid:
    """A square grid of positions about the film's centre; only those in the reach are assessed.

    Parameters
    ----------
    reach_mm : float
        Maximum distance of a touch from the centre.
    step_mm : float
        Distance between neighbouring positions.
    """

    def __init__(self, reach_mm: float, step_mm: float) -> None:
        steps = int(reach_mm / step_mm + 1e-9)
        self.coordinates_mm: Array = np.asarray(step_mm * np.arange(-steps, steps + 1), dtype=float)
        x_mm, y_mm = np.meshgrid(self.coordinates_mm, self.coordinates_mm)
        #: Mask of the positions within the reach, shape (y, x).
        self.is_inside: Mask = np.hypot(x_mm, y_mm) <= reach_mm
        #: Positions within the reach, shape (n, 2).
        self.positions_mm: Array = np.column_stack([x_mm[self.is_inside], y_mm[self.is_inside]])


class DesignColumns:
    """Cramér-Rao bounds at all positions, and error bounds of the responses, for several designs.

    Parameters
    ----------
    count : int
        Number of designs.
    grid : PositionGrid
        Positions at which the designs are assessed.
    """

    def __init__(self, count: int, grid: PositionGrid) -> None:
        self.grid = grid
        shape = (count, *grid.is_inside.shape)
        #: Values of the variables in `MAPS`, shape (designs, y, x), NaN outside of the reach.
        self.maps: dict[str, Array] = {name: np.full(shape, np.nan) for name in MAPS}
        self.response_error_bounds: Array = np.empty(count)

    def assess_design(
        self, index: int, response: Response, sigma: float, noise_pC: float | None
    ) -> None:
        """Compute the bounds of a design at all positions within the reach, and store them.

        Parameters
        ----------
        index : int
            Index of the design along the first axis of the arrays.
        response : Response
            Response of the design.
        sigma : float
            Relative standard deviation of the readings.
        noise_pC : float, optional
            Absolute standard deviation of the readings in pC. None: that of the readout.
        """
        bounds = compute_bounds(response, self.grid.positions_mm, sigma, noise_pC)
        for name, values in self.maps.items():
            values[index, self.grid.is_inside] = [getattr(bound, name) for bound in bounds]
        self.response_error_bounds[index] = response.error_bound


def compute_bounds(
    response: Response, positions_mm: Array, sigma: float, noise_pC: float | None
) -> list[TouchBound]:
    """Compute the Cramér-Rao bounds of touches at several positions.

    The noise-free charges of a touch at each position are located. Rotation and force of the
    touches are those of the scene of the response.

    Parameters
    ----------
    response : Response
        Response of the design with a single probe. Its error bound is ignored.
    positions_mm : ndarray, shape (n, 2)
        Positions of the probe.
    sigma : float
        Relative standard deviation of the readings.
    noise_pC : float, optional
        Absolute standard deviation of the readings in pC. None: that of the readout.
    """
    exact = replace(response, error_bound=0.0)
    touch = list(extract_touch(response.scene).values())
    touches = np.tile(touch, (len(positions_mm), 1))
    touches[:, : TouchColumn.ROTATION] = positions_mm
    measurement = Measurement.from_response(exact, exact.names, sigma, noise_pC, None)
    readings = measurement.to_readings(exact.evaluate(touches)[0])
    bounds = []
    for row, touch_row in zip(readings, touches, strict=True):
        by_electrode = dict(zip(exact.names, row, strict=True))
        location = locate(
            exact, by_electrode, sigma, noise_pC=noise_pC, unit="pC", include_calibration=False
        )
        bounds.append(_extract_bound(location, touch_row))
    return bounds


def _extract_bound(location: Location, touch: Array) -> TouchBound:
    """Extract the bound of a touch from the location of its charges.

    Parameters
    ----------
    location : Location
        Touches that are found from the charges of the true touch.
    touch : ndarray, shape (4,)
        True touch. The bound is NaN unless the position of the nearest located touch is closer to
        that of the true touch than the standard deviation of the position.
    """
    if not location.touches:
        return TouchBound()
    place_mm = touch[: TouchColumn.ROTATION]
    distances_mm = []
    for other in location.touches:
        distances_mm.append(math.dist(other.values[: TouchColumn.ROTATION], place_mm))
    nearest = int(np.argmin(distances_mm))
    covariance = location.touches[nearest].covariance  # The covariance of x, y and the force.
    place_deviation_mm = math.sqrt(covariance[0, 0] + covariance[1, 1])
    if distances_mm[nearest] >= place_deviation_mm:
        return TouchBound()
    return TouchBound(
        place_deviation_mm,
        force_deviation=math.sqrt(covariance[2, 2]) / touch[TouchColumn.FORCE],
        ambiguous=float(location.ambiguous),
    )
