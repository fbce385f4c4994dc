"""Array types, and small shared operations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
Selection = slice | Indices

#: Selects everything along an axis.
ALL = slice(None)

#: Imaginary step of a complex-step derivative, which is exact to rounding (Squire and Trapp, SIAM
#: Rev. 40 (1998) 110-112).
COMPLEX_STEP = 1e-30


def finite_or_none(value: float) -> float | None:
    """The value, or None where JSON has no number."""
    return float(value) if np.isfinite(value) else None


def compute_unit_gauss_rule(count: int) -> tuple[Array, Array]:
    """Gauss's points and weights, (count,), on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return (points + 1.0) / 2.0, weights / 2.0


def make_polar_grid(radius: float, radii: int, angles: int) -> Array:
    """Places (radii, angles, 2) on a disc about the origin, the first angle twice."""
    r, angle = np.linspace(0.0, radius, radii)[:, None], np.linspace(0.0, 2.0 * np.pi, angles)
    return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)


def move_components_first(values: Array, axes: int) -> Array:
    """The last `axes` moved to the front."""
    return _rolled(values, values.ndim - axes)


def move_components_last(values: Array, axes: int) -> Array:
    """The first `axes` moved to the end; in memory they stay first.

    Components are then blocks: sums and products over points are several times faster.
    """
    return _rolled(values, axes)


def _rolled(values: Array, axes: int) -> Array:
    """The first `axes` moved to the end; `numpy.moveaxis` takes four times as long."""
    order = range(values.ndim)
    return values.transpose(*order[axes:], *order[:axes])


def apply_matrix(matrix: Array, vector: Array) -> Array:
    """Vectors (..., n) times a matrix (n, n), or times matrices (..., n, n)."""
    if matrix.ndim > 2:
        return np.matmul(matrix, vector[..., None])[..., 0]
    return move_components_last(np.tensordot(matrix, move_components_first(vector, 1), 1), 1)
