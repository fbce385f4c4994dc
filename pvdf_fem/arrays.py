"""Types of arrays, and basic operations on arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
Selection = slice | Indices

#: Selects everything along an axis.
ALL = slice(None)

#: Imaginary step of complex-step derivatives, which are exact up to round-off (Squire and Trapp,
#: SIAM Rev. 40 (1998) 110-112).
COMPLEX_STEP = 1e-30


def finite_or_none(value: float) -> float | None:
    """Return a finite number as a float; return None for NaN and infinity, which JSON lacks."""
    return float(value) if np.isfinite(value) else None


def compute_unit_gauss_rule(count: int) -> tuple[Array, Array]:
    """Return the `count` points and weights of Gauss-Legendre quadrature on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return (points + 1.0) / 2.0, weights / 2.0


def make_polar_grid(radius: float, radii: int, angles: int) -> Array:
    """Return the Cartesian coordinates of a polar grid on a disc around the origin.

    Parameters
    ----------
    radius : float
        Radius of the disc, in any unit.
    radii, angles : int
        Numbers of equally spaced radii and angles. The radii begin at 0. The angles go from 0 to
        2π, so that the first direction is repeated.

    Returns
    -------
    ndarray, shape (radii, angles, 2)
        Coordinates x and y in the unit of the radius.
    """
    r = np.linspace(0.0, radius, radii)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, angles)
    return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)


def move_components_first(values: Array, axes: int) -> Array:
    """Return a view of an array with the last `axes` axes moved to the front."""
    return _rotate_axes(values, values.ndim - axes)


def move_components_last(values: Array, axes: int) -> Array:
    """Return a view of an array with the first `axes` axes moved to the end.

    The memory layout does not change, so that the values of each component stay contiguous. Sums
    and products over points are then several times faster.
    """
    return _rotate_axes(values, axes)


def _rotate_axes(values: Array, axes: int) -> Array:
    """Return a view with the first `axes` axes moved to the end; `numpy.moveaxis` is slower."""
    order = range(values.ndim)
    return values.transpose(*order[axes:], *order[:axes])


def apply_matrix(matrix: Array, vector: Array) -> Array:
    """Multiply vectors by a matrix.

    Parameters
    ----------
    matrix : ndarray, shape (n, n) or (..., n, n)
        One matrix for all vectors, or a matrix for each vector.
    vector : ndarray, shape (..., n)
        The vectors.

    Returns
    -------
    ndarray, shape (..., n)
        The products. With one matrix, the values of each component are contiguous in memory, see
        `move_components_last`.
    """
    if matrix.ndim > 2:
        return np.matmul(matrix, vector[..., None])[..., 0]
    components = move_components_first(vector, 1)
    return move_components_last(np.tensordot(matrix, components, 1), 1)
