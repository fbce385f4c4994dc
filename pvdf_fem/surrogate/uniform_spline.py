"""Cubic splines on uniform grids of any dimension, with gradients, for many points at once.

One evaluation gives values and gradients of several functions 1.7 to 3 times faster than
`scipy.interpolate.NdBSpline` does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import spline_filter1d

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.surrogate.response_file import FileArray

#: Steps by which a grid goes on where the spline is not asked for: nobody then feels how it ends.
PADDING_STEPS = 6

# Powers 1, u, u^2, u^3 of the place u in a cell, times these matrices, are the four cubic B-splines
# that overlap the cell, and their derivatives by u.
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
        """The grid's values, (count,)."""
        return self.start + self.step * np.arange(self.count, dtype=float)


@dataclass(frozen=True, eq=False)
class UniformSpline:
    """The tensor product of cubic splines through values on a uniform grid.

    At the ends of an axis without a period the spline is level. The error of that falls to 0.27 of
    itself from each cell to the next. Outside of the grid the polynomials of the outermost cells
    are evaluated.
    """

    #: Each with four values at least, or a period.
    axes: tuple[UniformAxis, ...]
    #: Coefficients of the B-splines. Along an axis they begin one step before the first value and
    #: end one step after the last, two after the last of a periodic axis, (axes..., functions).
    coefficients: FileArray

    @classmethod
    def through(
        cls, axes: Sequence[UniformAxis], values: ArrayLike, dtype: type[np.floating] = np.float64
    ) -> UniformSpline:
        """The spline through `values` (axes..., functions), with coefficients of type `dtype`."""
        coefficients = np.asarray(values, dtype=float)
        for i, axis in enumerate(axes):
            wraps, beyond = axis.periodic, [(0, 0)] * coefficients.ndim
            beyond[i] = 1, 1 + wraps
            mode = "grid-wrap" if wraps else "mirror"
            inner = spline_filter1d(coefficients, 3, axis=i, mode=mode)
            coefficients = np.pad(inner, beyond, "wrap" if wraps else "reflect")
        return cls(tuple(axes), np.ascontiguousarray(coefficients, dtype))

    def with_gradient(self, points: Array, at_once: int = 512) -> Array:
        """Values, then derivatives by each coordinate, (n, 1 + axes, functions).

        The coefficients of the points that are evaluated `at_once` stay in the cache.
        """
        if len(points) > at_once:
            firsts = range(0, len(points), at_once)
            return np.concatenate([self.with_gradient(points[i : i + at_once]) for i in firsts])
        weights, rows = self._weights(points, self._polynomials)
        return np.matmul(weights, self._flat.take(rows, axis=0))

    def sums(self, points: Array, factors: Array) -> Array:
        """Sums (n, functions) over m of the values at points (n, m, axes) times factors (n, m)."""
        n, m = factors.shape
        weights, rows = self._weights(points.reshape(n * m, -1), self._polynomials[:, :, :4])
        products = (weights[:, 0] * factors.reshape(-1, 1)).astype(self._flat.dtype)
        starts = rows.shape[1] * m * np.arange(n + 1)
        shape = (n, len(self._flat))
        return sp.csr_matrix((products.ravel(), rows.ravel(), starts), shape) @ self._flat

    def _weights(self, points: Array, polynomials: Array) -> tuple[Array, Indices]:
        """Weights (n, results, 4^axes) of coefficients in rows (n, 4^axes), at points (n, axes)."""
        (start, per_step, last_cell), n, axes = self._grid, len(points), len(self.axes)
        place = (points - start) * per_step
        for i, axis in enumerate(self.axes):
            if axis.periodic:
                place[:, i] %= axis.count
        cell = np.minimum(np.maximum(place.astype(np.int64), 0), last_cell)
        # (axes, n, powers)
        powers = (place - cell).T[:, :, None] ** _POWERS
        factors = np.matmul(powers, polynomials).astype(self._flat.dtype, copy=False)
        factors = factors.reshape(axes, n, -1, 4)
        weights = factors[0]
        for i in range(1, axes):
            weights = weights[..., None] * factors[i, :, :, None]
            weights = weights.reshape(n, -1, 4 ** (i + 1))
        stride, offsets = self._rows
        return weights, (cell @ stride)[:, None] + offsets

    @cached_property
    def _flat(self) -> NDArray[np.floating]:
        """Coefficients, (rows, functions)."""
        return self.coefficients.reshape(-1, self.coefficients.shape[-1])

    @cached_property
    def _grid(self) -> tuple[Array, Array, Indices]:
        """First values of the axes, inverses of their steps, and their last cells, (axes,)."""
        start, step = np.array([(axis.start, axis.step) for axis in self.axes]).T
        return start, 1.0 / step, np.array(self.coefficients.shape[:-1]) - 4

    @cached_property
    def _polynomials(self) -> Array:
        """B-splines for value and derivatives, by powers of the place, (axes, 4, results 4)."""
        axes = len(self.axes)
        # (axes, powers, results, splines): derivatives by coordinate i differ in the factor of i
        polynomials = np.tile(_CUBIC[:, None], (axes, 1, 1 + axes, 1))
        for i, axis in enumerate(self.axes):
            polynomials[i, :, 1 + i] = _SLOPE / axis.step
        return polynomials.reshape(axes, 4, -1)

    @cached_property
    def _rows(self) -> tuple[Indices, Indices]:
        """Rows from one coefficient to the next along each axis, and those that count in a cell."""
        stride = np.append(np.cumprod(self.coefficients.shape[-2:0:-1])[::-1], 1).astype(np.int64)
        corners = np.indices((4,) * len(self.axes)).reshape(len(self.axes), -1)
        return stride, stride @ corners
