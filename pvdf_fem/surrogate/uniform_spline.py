"""Cubic splines on uniform grids of any dimension, with gradients, for many points at once.

Values and gradients of several functions are evaluated together, 1.7 to 3 times faster than by
`scipy.interpolate.NdBSpline`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import spline_filter1d

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.surrogate.response_file import FileArray

#: Steps by which a grid extends beyond the points of interest, so that the ends of the spline do
#: not matter there.
PADDING_STEPS = 6

# Powers 1, u, u^2, u^3 of the position u in a cell, times these matrices, are the four cubic
# B-splines that overlap the cell, and their derivatives by u.
_CUBIC = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
_SLOPE = np.array([[-3, 0, 3, 0], [6, -12, 6, 0], [-3, 9, -9, 3], [0, 0, 0, 0]]) / 6.0
_POWERS = np.arange(4.0)


@dataclass(frozen=True)
class UniformAxis:
    """A uniform grid along one coordinate."""

    start: float
    step: float
    count: int
    #: Whether the value after the last is the first.
    periodic: bool = False

    @property
    def values(self) -> Array:
        """Values of the grid, (count,)."""
        return self.start + self.step * np.arange(self.count, dtype=float)


class _Grid(NamedTuple):
    """The grids of all axes as arrays, (axes,)."""

    starts: Array
    cells_per_unit: Array
    last_cells: Indices


class _Rows(NamedTuple):
    """Rows of the flat coefficients that overlap a cell."""

    strides: Indices  #: Rows from one coefficient to the next along each axis, (axes,).
    offsets: Indices  #: From the first row of a cell to all of its rows, (4^axes,).


class _Weights(NamedTuple):
    """Weights of the flat coefficients in results at n points."""

    values: Array  #: (n, results, 4^axes).
    rows: Indices  #: Rows of the coefficients, (n, 4^axes).


@dataclass(frozen=True, eq=False)
class UniformSpline:
    """The tensor product of cubic splines through values on a uniform grid.

    At the ends of an axis that is not periodic the spline has slope zero. The error of that falls
    to 0.27 of itself from each cell to the next. Outside of the grid the polynomials of the
    outermost cells are evaluated.
    """

    #: Each with at least four values, or periodic.
    axes: tuple[UniformAxis, ...]
    #: Coefficients of the B-splines, (axes..., functions). Along an axis they begin one step before
    #: the first value and end one step after the last; two steps after the last of a periodic axis.
    coefficients: FileArray

    @classmethod
    def interpolate(
        cls, axes: Sequence[UniformAxis], values: ArrayLike, dtype: type[np.floating] = np.float64
    ) -> UniformSpline:
        """Make the spline through values.

        Parameters
        ----------
        axes : sequence of UniformAxis
            Grids of the coordinates.
        values : array_like, shape (axes..., functions)
            Values at the nodes of the grid.
        dtype : type, optional
            Type of the coefficients.
        """
        coefficients = np.asarray(values, dtype=float)
        for i, axis in enumerate(axes):
            padding = [(0, 0)] * coefficients.ndim
            if axis.periodic:
                padding[i] = (1, 2)
                inner = spline_filter1d(coefficients, 3, axis=i, mode="grid-wrap")
                coefficients = np.pad(inner, padding, "wrap")
            else:
                padding[i] = (1, 1)
                inner = spline_filter1d(coefficients, 3, axis=i, mode="mirror")
                coefficients = np.pad(inner, padding, "reflect")
        return cls(tuple(axes), np.ascontiguousarray(coefficients, dtype))

    def evaluate_with_gradient(self, points: Array, at_once: int = 512) -> Array:
        """Evaluate the functions and their gradients.

        Parameters
        ----------
        points : ndarray, shape (n, axes)
            Coordinates of the points.
        at_once : int, optional
            Number of points evaluated together; their coefficients then fit into the cache.

        Returns
        -------
        ndarray, shape (n, 1 + axes, functions)
            Values, then derivatives by each coordinate.
        """
        if len(points) > at_once:
            starts = range(0, len(points), at_once)
            return np.concatenate(
                [self.evaluate_with_gradient(points[i : i + at_once]) for i in starts]
            )
        weights = self._compute_weights(points, self._polynomials)
        return np.matmul(weights.values, self._flat.take(weights.rows, axis=0))

    def sum_weighted(self, points: Array, factors: Array) -> Array:
        """Sum the functions over sets of points, with a factor for each point.

        Parameters
        ----------
        points : ndarray, shape (n, m, axes)
            n sets of m points.
        factors : ndarray, shape (n, m)
            Factors of the points.

        Returns
        -------
        ndarray, shape (n, functions)
        """
        n, m = factors.shape
        values_only = self._polynomials[:, :, :4]
        weights = self._compute_weights(points.reshape(n * m, -1), values_only)
        products = (weights.values[:, 0] * factors.reshape(-1, 1)).astype(self._flat.dtype)
        starts = weights.rows.shape[1] * m * np.arange(n + 1)
        shape = (n, len(self._flat))
        matrix = sp.csr_matrix((products.ravel(), weights.rows.ravel(), starts), shape)
        return matrix @ self._flat

    def _compute_weights(self, points: Array, polynomials: Array) -> _Weights:
        """Compute the weights of the coefficients at points (n, axes) for some of the results."""
        grid = self._grid
        n, axes = points.shape
        position = (points - grid.starts) * grid.cells_per_unit
        for i, axis in enumerate(self.axes):
            if axis.periodic:
                position[:, i] %= axis.count
        cell = np.minimum(np.maximum(position.astype(np.int64), 0), grid.last_cells)
        # (axes, n, powers)
        powers = (position - cell).T[:, :, None] ** _POWERS
        factors = np.matmul(powers, polynomials).astype(self._flat.dtype, copy=False)
        factors = factors.reshape(axes, n, -1, 4)
        weights = factors[0]
        for i in range(1, axes):
            weights = weights[..., None] * factors[i, :, :, None]
            weights = weights.reshape(n, -1, 4 ** (i + 1))
        first_rows = cell @ self._rows.strides
        return _Weights(weights, first_rows[:, None] + self._rows.offsets)

    @cached_property
    def _flat(self) -> NDArray[np.floating]:
        """Coefficients as a matrix, (rows, functions)."""
        return self.coefficients.reshape(-1, self.coefficients.shape[-1])

    @cached_property
    def _grid(self) -> _Grid:
        """The grids of all axes as arrays."""
        starts = np.array([axis.start for axis in self.axes])
        steps = np.array([axis.step for axis in self.axes])
        return _Grid(starts, 1.0 / steps, np.array(self.coefficients.shape[:-1]) - 4)

    @cached_property
    def _polynomials(self) -> Array:
        """Coefficients of B-splines for the value and the derivatives, (axes, 4, results 4)."""
        axes = len(self.axes)
        # (axes, powers, results, splines): derivatives by coordinate i differ in the factor of i
        polynomials = np.tile(_CUBIC[:, None], (axes, 1, 1 + axes, 1))
        for i, axis in enumerate(self.axes):
            polynomials[i, :, 1 + i] = _SLOPE / axis.step
        return polynomials.reshape(axes, 4, -1)

    @cached_property
    def _rows(self) -> _Rows:
        """Rows of the flat coefficients that overlap a cell."""
        counts = self.coefficients.shape[-2:0:-1]
        strides = np.append(np.cumprod(counts)[::-1], 1).astype(np.int64)
        corners = np.indices((4,) * len(self.axes)).reshape(len(self.axes), -1)
        return _Rows(strides, strides @ corners)
