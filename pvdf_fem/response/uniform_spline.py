"""Cubic splines on uniform grids of any dimension, with gradients, for many points at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import spline_filter1d

Array = NDArray[np.float64]

# Powers 1, u, u^2, u^3 of the place in a cell times this are the four B-splines that live there.
_CUBIC = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
# The same for their derivatives.
_SLOPE = np.array([[-3, 0, 3, 0], [6, -12, 6, 0], [-3, 9, -9, 3], [0, 0, 0, 0]]) / 6.0
_ORDERS = np.arange(4.0)
# Cells after which the end of a grid is forgotten, 0.27 to this power.
MEMORY = 10
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

    Beyond the ends of an axis that is not periodic the values are taken to go on as parabolas, so
    that there the error is of third order; its influence falls by 0.27 per cell. Outside of the
    grid the outermost cells go on.

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
            along = np.moveaxis(coefficients, i, 0)
            along = _periodic(along) if axis.periodic else _continued(along)
            coefficients = np.moveaxis(along, 0, i)
        return cls(tuple(axes), np.ascontiguousarray(coefficients, dtype))

    def __call__(self, points: Array) -> Array:
        """Values at points (n, axes), (n, values)."""
        return self._in_chunks(points, self._grid.value)[:, 0]

    def with_gradient(self, points: Array) -> Array:
        """Values and derivatives by each coordinate at points (n, axes), (n, 1 + axes, values)."""
        return self._in_chunks(points, self._grid.value_and_gradient)

    def sums(self, points: Array, factors: Array) -> Array:
        """Sums (n, values) of the values at points (n, m, axes) times factors (n, m)."""
        n, m = factors.shape
        weights, index = self._stencils(points.reshape(n * m, -1), self._grid.value)
        table = self._grid.table
        products = (weights[:, 0] * factors.reshape(-1, 1)).astype(table.dtype)
        rows = index.shape[1] * m * np.arange(n + 1)
        matrix = sp.csr_matrix((products.ravel(), index.ravel(), rows), (n, len(table)))
        return matrix @ table

    def _in_chunks(self, points: Array, basis: Array) -> Array:
        if len(points) <= CHUNK:
            return self._evaluate(points, basis)
        parts = range(0, len(points), CHUNK)
        return np.concatenate([self._evaluate(points[i : i + CHUNK], basis) for i in parts])

    def _evaluate(self, points: Array, basis: Array) -> Array:
        weights, index = self._stencils(points, basis)
        return np.matmul(weights, self._grid.table.take(index, axis=0))

    def _stencils(self, points: Array, basis: Array) -> tuple[Array, NDArray[np.int64]]:
        """Weights (n, rows, 4^axes) of the table's rows (n, 4^axes) at points (n, axes).

        `basis` (axes, 4, rows 4): the B-splines of each row of the result, or their derivatives,
        by powers of the place in a cell.
        """
        grid, n, axes = self._grid, len(points), len(self.axes)
        place = (points - grid.start) * grid.per_step
        for i, count in grid.periods:
            place[:, i] %= count
        cell = np.minimum(np.maximum(place.astype(np.int64), 0), grid.last)
        # (axes, n, powers)
        powers = (place - cell).T[:, :, None] ** _ORDERS
        factors = np.matmul(powers, basis).astype(grid.table.dtype, copy=False)
        factors = factors.reshape(axes, n, -1, 4)
        weights = factors[0]
        for i in range(1, axes):
            weights = weights[..., None] * factors[i, :, :, None]
            weights = weights.reshape(n, -1, 4 ** (i + 1))
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
    value, value_and_gradient : ndarray, shape (axes, 4, rows 4)
        B-splines, or their derivatives in rows of the gradient, by powers of the place in a cell.
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
    value: Array
    value_and_gradient: Array
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
        # (axes, powers, rows, splines)
        rows = np.repeat(_CUBIC[None, :, None], 1 + len(axes), axis=2)
        rows = np.repeat(rows, len(axes), axis=0)
        for i, inverse in enumerate(per_step):
            rows[i, :, 1 + i] = inverse * _SLOPE
        rows = rows.reshape(len(axes), 4, -1)
        return cls(
            start=np.array([axis.start for axis in axes]),
            per_step=per_step,
            value=rows[:, :, :4],
            value_and_gradient=rows,
            periods=tuple((i, axis.count) for i, axis in enumerate(axes) if axis.periodic),
            last=sizes - 4,
            stride=stride,
            stencil=stencil,
            table=coefficients.reshape(-1, coefficients.shape[-1]),
        )


def _periodic(values: Array) -> Array:
    """Coefficients along the first axis, one before the first value and two after the last."""
    found = spline_filter1d(values, 3, axis=0, mode="grid-wrap")
    return np.concatenate([found[-1:], found, found[:2]])


def _continued(values: Array) -> Array:
    """Coefficients along the first axis, one before the first value and one after the last."""
    # weights of the outermost three values in those of a parabola beyond them
    k = np.arange(1.0, MEMORY + 1.0)
    parabola = np.stack([(k + 1) * (k + 2) / 2, -k * (k + 2), k * (k + 1) / 2], axis=1)
    before = np.tensordot(parabola[::-1], values[:3], axes=1)
    after = np.tensordot(parabola, values[:-4:-1], axes=1)
    found = spline_filter1d(np.concatenate([before, values, after]), 3, axis=0, mode="mirror")
    return found[MEMORY - 1 : 1 - MEMORY]
