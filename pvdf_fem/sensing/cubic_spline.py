"""Cubic splines on uniform grids of any dimension, with gradients, for many points at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import spline_filter1d

Array = NDArray[np.float64]

# Powers 1, u, u^2, u^3 of the place in a cell times this are the four B-splines that live there.
_CUBIC = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
# The same for their derivatives.
_SLOPE = np.array([[-3, 0, 3, 0], [6, -12, 6, 0], [-3, 9, -9, 3], [0, 0, 0, 0]]) / 6.0
_BASIS = np.concatenate([_CUBIC, _SLOPE], axis=1)
_ORDERS = np.arange(4.0)
# Points at a time, so that what they gather stays in the cache.
CHUNK = 512


@dataclass(frozen=True)
class Axis:
    """A uniform grid along one coordinate.

    Attributes
    ----------
    start, step : float
    count : int
    periodic : bool
        Whether the value after the last is the first.
    """

    start: float
    step: float
    count: int
    periodic: bool = False

    @property
    def values(self) -> Array:
        """The grid's values."""
        return self.start + self.step * np.arange(self.count, dtype=float)


@dataclass(frozen=True, eq=False)
class CubicSpline:
    """The tensor product of cubic splines through values on a grid.

    At the ends of an axis that is not periodic the spline's slope is zero: the grid should begin
    some cells before what is wanted, as the influence of the end falls by 0.27 per cell. Beyond
    the grid the outermost cells go on.

    Attributes
    ----------
    axes : tuple of Axis
        Each with four values at least.
    coefficients : ndarray, shape (axes..., values)
        Of the B-splines, continued by one, and at the end of periodic axes by two.
    """

    axes: tuple[Axis, ...]
    coefficients: NDArray[np.floating]

    @classmethod
    def through(
        cls, axes: Sequence[Axis], values: ArrayLike, dtype: type[np.floating] = np.float64
    ) -> CubicSpline:
        """The spline through `values`, (axes..., values), with its coefficients kept as `dtype`."""
        coefficients = np.asarray(values, dtype=float)
        for i, axis in enumerate(axes):
            mode = "grid-wrap" if axis.periodic else "mirror"
            coefficients = spline_filter1d(coefficients, 3, axis=i, mode=mode)
            before = [(0, 0)] * coefficients.ndim
            before[i] = (1, 2) if axis.periodic else (1, 1)
            coefficients = np.pad(coefficients, before, "wrap" if axis.periodic else "reflect")
        return cls(tuple(axes), coefficients.astype(dtype))

    def __call__(self, points: Array) -> Array:
        """Values at points (n, axes), (n, values)."""
        return self._in_chunks(points, _rows(len(self.axes))[:1])[:, 0]

    def with_gradient(self, points: Array) -> Array:
        """Values and derivatives by each coordinate at points (n, axes), (n, 1 + axes, values)."""
        return self._in_chunks(points, _rows(len(self.axes)))

    def sums(self, points: Array, factors: Array) -> Array:
        """Sums (n, values) of the values at points (n, m, axes) times factors (n, m)."""
        n, m = factors.shape
        weights, index = self._stencils(points.reshape(n * m, -1), _rows(len(self.axes))[:1])
        table = self._grid.table
        products = (weights[:, 0] * factors.reshape(-1, 1)).astype(table.dtype)
        rows = index.shape[1] * m * np.arange(n + 1)
        matrix = sp.csr_matrix((products.ravel(), index.ravel(), rows), (n, len(table)))
        return matrix @ table

    def _in_chunks(self, points: Array, slopes: NDArray[np.int64]) -> Array:
        if len(points) <= CHUNK:
            return self._evaluate(points, slopes)
        parts = range(0, len(points), CHUNK)
        return np.concatenate([self._evaluate(points[i : i + CHUNK], slopes) for i in parts])

    def _evaluate(self, points: Array, slopes: NDArray[np.int64]) -> Array:
        weights, index = self._stencils(points, slopes)
        table = self._grid.table
        return np.matmul(weights, table.take(index, axis=0))

    def _stencils(
        self, points: Array, slopes: NDArray[np.int64]
    ) -> tuple[Array, NDArray[np.int64]]:
        """Weights (n, rows, 4^axes) of the table's rows (n, 4^axes) at points (n, axes).

        `slopes` (rows, axes): 1 where a row of the result has an axis's derivative, else 0.
        """
        grid, n = self._grid, len(points)
        place = (points - grid.start) * grid.per_step
        for i, count in grid.periods:
            place[:, i] %= count
        cell = np.minimum(np.maximum(place.astype(np.int64), 0), grid.last)
        powers = (place - cell)[:, :, None] ** _ORDERS
        basis = (powers @ _BASIS).reshape(n, -1, 2, 4) * grid.scale
        factors = basis.astype(grid.table.dtype, copy=False)[:, grid.axes, slopes]
        weights = factors[:, :, 0]
        for i in range(1, len(self.axes)):
            weights = weights[..., None] * factors[:, :, i, None]
            weights = weights.reshape(n, len(slopes), -1)
        return weights, (cell @ grid.stride)[:, None] + grid.stencil

    @cached_property
    def _grid(self) -> _Grid:
        return _Grid.of(self.axes, self.coefficients)


@dataclass(frozen=True, eq=False)
class _Grid:
    """What an evaluation needs of the axes, all (axes,), and of the coefficients.

    Attributes
    ----------
    start, per_step : ndarray
        Of the grid's first values, and the inverse of its steps.
    scale : ndarray, shape (axes, 2, 1)
        1, and the inverse of the step, of the B-splines and of their derivatives.
    axes : ndarray of int
        0, 1, ...
    periods : tuple of (int, int)
        Axes that repeat, each with its number of cells.
    last : ndarray of int
        The last cell.
    stride : ndarray of int
    stencil : ndarray of int, shape (4^axes,)
        Rows of the table about a cell, from its first.
    table : ndarray, shape (coefficients, values)
    """

    start: Array
    per_step: Array
    scale: Array
    axes: NDArray[np.int64]
    periods: tuple[tuple[int, int], ...]
    last: NDArray[np.int64]
    stride: NDArray[np.int64]
    stencil: NDArray[np.int64]
    table: NDArray[np.floating]

    @classmethod
    def of(cls, axes: Sequence[Axis], coefficients: NDArray[np.floating]) -> _Grid:
        sizes = np.array(coefficients.shape[:-1])
        stride = np.append(np.cumprod(sizes[:0:-1])[::-1], 1)
        stencil = np.zeros(1, dtype=np.int64)
        for each in stride:
            stencil = (stencil[:, None] + each * np.arange(4)).ravel()
        per_step = 1.0 / np.array([axis.step for axis in axes])
        return cls(
            start=np.array([axis.start for axis in axes]),
            per_step=per_step,
            scale=np.stack([np.ones(len(axes)), per_step], axis=1)[:, :, None],
            axes=np.arange(len(axes)),
            periods=tuple((i, axis.count) for i, axis in enumerate(axes) if axis.periodic),
            last=sizes - 4,
            stride=stride,
            stencil=stencil,
            table=coefficients.reshape(-1, coefficients.shape[-1]),
        )


@cache
def _rows(axes: int) -> NDArray[np.int64]:
    """1 for the axis that is differentiated in a row of value and gradient, (1 + axes, axes)."""
    return np.eye(1 + axes, axes, -1, dtype=np.int64)
