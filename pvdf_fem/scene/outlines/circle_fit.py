"""The circle nearest to some points."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.circle import Circle


def fit_circle(points: Array) -> Circle:
    """Fit a circle to points by linear least squares.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Points in any unit of length, not all equal.

    Returns
    -------
    Circle
        In the unit of the points.

    Notes
    -----
    The circle minimizes the sum of (|p - c|² - r²)², which is linear in the centre c and in
    r² - |c|² (I. Kåsa, IEEE Transactions on Instrumentation and Measurement 25, 1976).

    Examples
    --------
    >>> fit_circle(np.array([[3.0, 0.0], [1.0, 2.0], [-1.0, 0.0]])).radius
    2.0
    """
    origin = points.mean(axis=0)
    scale = float(np.abs(points - origin).max())
    local = (points - origin) / scale
    columns = np.column_stack([2.0 * local, np.ones(len(local))])
    solution, *_ = np.linalg.lstsq(columns, np.square(local).sum(axis=1))
    x, y, constant = solution
    radius = scale * float(np.sqrt(max(constant + x**2 + y**2, 0.0)))
    return Circle(origin + scale * np.array([x, y]), radius)
