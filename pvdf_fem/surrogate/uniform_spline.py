"""Cubic splines on uniform grids of any dimension, with gradients, for many points at once.

Values and gradients of several functions are evaluated together, 1.7 to 3 times faster than with
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

#: Number of steps by which a grid extends beyond the region of interest, so that the end conditions
#: of the spline have no effect there.
PADDING_STEPS = 6

# The row vector (1, u, u^2, u^3) of the position u in a cell, from 0 to 1, times these matrices
# gives the four cubic B-splines that overlap the cell, and their derivatives with respect to u.
_CUBIC = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
_SLOPE = np.array([[-3, 0, 3, 0], [6, -12, 6, 0], [-3, 9, -9, 3], [0, 0, 0, 0]]) / 6.0
_POWERS = np.arange(4.0)


@dataclass(frozen=True)
class UniformAxis:
    """A uniform grid along one coordinate."""

    start: float  #: First value.
    step: float  #: Distance between neighbouring values.
    count: int  #: Number of values.
    #: Whether the coordinate is periodic: the first value follows the last one.
    periodic: bool = False

    @property
    def values(self) -> Array:
        """Values of the grid.

        Returns
        -------
        ndarray, shape (count,)
        """
        return self.start + self.step * np.arange(self.count, dtype=float)


class _Grid(NamedTuple):
    """Properties of all axes, as arrays of shape (axes,)."""

    starts: Array  #: Coordinates of the first values.
    cells_per_unit: Array  #: Inverse steps.
    last_cells: Indices  #: Indices of the last cells.


class _CellRows(NamedTuple):
    """Rows of `UniformSpline._coefficient_matrix` with the coefficients that a cell needs."""

    #: Number of rows from one coefficient to the next along each axis, shape (axes,).
    strides: Indices
    #: Offsets from the first row of a cell to each of its rows, shape (4^axes,).
    offsets: Indices


class _Weights(NamedTuple):
    """Weights of the coefficients in the values and derivatives at n points."""

    values: Array  #: Weights, shape (n, results, 4^axes).
    rows: Indices  #: Rows of `UniformSpline._coefficient_matrix`, shape (n, 4^axes).


@dataclass(frozen=True, eq=False)
class UniformSpline:
    """Tensor product of cubic splines that interpolates several functions on a uniform grid.

    The slope is zero at the ends of an axis that is not periodic. The error due to this condition
    decreases by the factor 0.27 from each cell to the next. Outside of the grid, the spline is the
    polynomial of the outermost cell.
    """

    #: Axes of the grid; those that are not periodic have at least four values.
    axes: tuple[UniformAxis, ...]
    #: Coefficients of the B-splines, with one dimension per axis and the functions last. Along an
    #: axis they start one step before the first value and end one step after the last value (two
    #: steps for a periodic axis).
    coefficients: FileArray

    @classmethod
    def interpolate(
        cls, axes: Sequence[UniformAxis], values: ArrayLike, dtype: type[np.floating] = np.float64
    ) -> UniformSpline:
        """Make the spline through values on a grid.

        Parameters
        ----------
        axes : sequence of UniformAxis
            Axes of the grid.
        values : array_like, shape (n1, n2, ..., functions)
            Values of the functions at the nodes of the grid.
        dtype : type, optional
            Data type of the coefficients and of the values that the spline returns.
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
        """Evaluate the functions and their gradients at points.

        Parameters
        ----------
        points : ndarray, shape (n, axes)
            Coordinates of the points.
        at_once : int, optional
            Number of points to evaluate together, so few that their coefficients fit into the cache
            of the processor.

        Returns
        -------
        ndarray, shape (n, 1 + axes, functions)
            Values, then derivatives with respect to each coordinate.
        """
        if len(points) > at_once:
            chunks = []
            for start in range(0, len(points), at_once):
                chunks.append(self.evaluate_with_gradient(points[start : start + at_once]))
            return np.concatenate(chunks)
        weights = self._compute_weights(points, self._polynomials)
        return np.matmul(weights.values, self._coefficient_matrix.take(weights.rows, axis=0))

    def sum_weighted(self, points: Array, factors: Array) -> Array:
        """Compute weighted sums of the functions over sets of points.

        A single sparse product sums over the points and over the coefficients of each point.

        Parameters
        ----------
        points : ndarray, shape (n, m, axes)
            Coordinates of n sets of m points.
        factors : ndarray, shape (n, m)
            Weights of the points.

        Returns
        -------
        ndarray, shape (n, functions)
            Sum over each set of the functions times the weights.
        """
        n, m = factors.shape
        values_only = self._polynomials[:, :, :4]
        weights = self._compute_weights(points.reshape(n * m, -1), values_only)
        products = (weights.values[:, 0] * factors.reshape(-1, 1)).astype(
            self._coefficient_matrix.dtype
        )
        # Row i of the matrix has the weights of all coefficients of all points of set i.
        weights_per_set = weights.rows.shape[1] * m
        starts = weights_per_set * np.arange(n + 1)
        shape = (n, len(self._coefficient_matrix))
        matrix = sp.csr_matrix((products.ravel(), weights.rows.ravel(), starts), shape)
        return matrix @ self._coefficient_matrix

    def _compute_weights(self, points: Array, polynomials: Array) -> _Weights:
        """Compute the weights of the coefficients in values or derivatives at several points.

        Parameters
        ----------
        points : ndarray, shape (n, axes)
            Coordinates of the points.
        polynomials : ndarray, shape (axes, 4, 4 results)
            Columns of `_polynomials` for the results to compute: the value, or also derivatives.
        """
        grid = self._axis_arrays
        n, axes = points.shape
        position = (points - grid.starts) * grid.cells_per_unit
        for i, axis in enumerate(self.axes):
            if axis.periodic:
                position[:, i] %= axis.count
        cell = np.minimum(np.maximum(position.astype(np.int64), 0), grid.last_cells)
        # shape (axes, n, powers)
        powers = (position - cell).T[:, :, None] ** _POWERS
        factors = np.matmul(powers, polynomials).astype(self._coefficient_matrix.dtype, copy=False)
        factors = factors.reshape(axes, n, -1, 4)
        # The weights are outer products of the B-splines of all axes.
        weights = factors[0]
        for i in range(1, axes):
            weights = weights[..., None] * factors[i, :, :, None]
            weights = weights.reshape(n, -1, 4 ** (i + 1))
        first_rows = cell @ self._cell_rows.strides
        return _Weights(weights, first_rows[:, None] + self._cell_rows.offsets)

    @cached_property
    def _coefficient_matrix(self) -> NDArray[np.floating]:
        """Coefficients as a matrix with a row for each coefficient of the tensor product.

        Returns
        -------
        ndarray, shape (rows, functions)
        """
        return self.coefficients.reshape(-1, self.coefficients.shape[-1])

    @cached_property
    def _axis_arrays(self) -> _Grid:
        """First values, inverse steps and last cells of all axes as arrays."""
        starts = np.array([axis.start for axis in self.axes])
        steps = np.array([axis.step for axis in self.axes])
        return _Grid(starts, 1.0 / steps, np.array(self.coefficients.shape[:-1]) - 4)

    @cached_property
    def _polynomials(self) -> Array:
        """Polynomial coefficients of the B-splines for the value and the derivatives.

        An array of shape (axes, 4, 4 (1 + axes)): for each axis, the powers in the rows; in the
        columns the four B-splines for the value, then for the derivative with respect to each
        coordinate. In the derivative with respect to coordinate i, only the factor of axis i is
        differentiated.
        """
        axes = len(self.axes)
        # shape (axes, powers, results, splines)
        polynomials = np.tile(_CUBIC[:, None], (axes, 1, 1 + axes, 1))
        for i, axis in enumerate(self.axes):
            polynomials[i, :, 1 + i] = _SLOPE / axis.step
        return polynomials.reshape(axes, 4, -1)

    @cached_property
    def _cell_rows(self) -> _CellRows:
        """Strides and offsets of the rows of a cell in `_coefficient_matrix`."""
        axes = len(self.axes)
        # The stride of an axis is the product of the counts of the axes after it.
        counts_from_last = self.coefficients.shape[-2:0:-1]
        strides = np.append(np.cumprod(counts_from_last)[::-1], 1).astype(np.int64)
        # The indices from 0 to 3 along each axis, for all coefficients of a cell.
        indices_in_cell = np.indices((4,) * axes).reshape(axes, -1)
        return _CellRows(strides, strides @ indices_in_cell)
