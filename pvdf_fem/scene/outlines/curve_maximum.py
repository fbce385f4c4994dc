"""The maximum of a function along a curve."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pvdf_fem.arrays import Array

#: Spacing in radians at which maxima along ellipses and arcs are resolved.
FINEST_ANGLE = 1e-8


def find_curve_maximum(
    function: Callable[[Array], Array],
    parameters: Array,
    *,
    finest_step: float,
    is_closed: bool,
) -> float:
    """Find the maximum of a function along a curve.

    Parameters
    ----------
    function : callable
        Maps parameters of the curve, an ndarray of shape (n,), to values of shape (n,).
    parameters : ndarray, shape (m,)
        Evenly spaced parameters along the whole curve, increasing from zero.
    finest_step : float
        The grid is refined while its spacing is larger than this.
    is_closed : bool
        Whether the first parameter follows the last one. Otherwise they are the ends of the curve.

    Returns
    -------
    float
        Maximum in the unit of the function.

    Notes
    -----
    The grid is refined around each local maximum. The error of the maximum is quadratic in the
    spacing.
    """
    values = function(parameters)
    maximum = float(values.max())
    if is_closed:
        padded = np.pad(values, 1, mode="wrap")
    else:
        padded = np.pad(values, 1, constant_values=-np.inf)
    is_peak = (values >= padded[:-2]) & (values >= padded[2:])
    peaks = parameters[is_peak]
    step = parameters[1]
    while step / 16.0 > finest_step:
        grid = peaks[:, None] + step * np.linspace(-1.0, 1.0, 33)
        if not is_closed:
            grid = np.clip(grid, parameters[0], parameters[-1])
        step /= 16.0
        values = function(grid.ravel()).reshape(grid.shape)
        maximum = max(maximum, float(values.max()))
        columns = values.argmax(axis=1)[:, None]
        peaks = np.take_along_axis(grid, columns, axis=1)[:, 0]
    return maximum
