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

# Powers 1, u, u^2, u^3 of the place u in a cell, times these matrices, are the four cubic B-splines
# that overlap the cell, and their derivatives by u.
_CUBIC = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
_SLOPE = np.array([[-3, 0, 3, 0], [6, -12, 6, 0], [-3, 9, -9, 3], [0, 0, 0, 0]]) / 6.0
_POWERS = np.arange(4.0)
#: Cells by which values are continued at an end: the influence of the last falls to 0.27^10 = 2e-6.
CONTINUED_CELLS = 10
#: Points that are evaluated at a time, so that the coefficients they need stay in the cache.
CHUNK = 512


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

    At the ends of an axis that is not periodic, the values are continued by parabolas. The error
    there is of third order in the step, and of fourth order a few cells further in. Outside of the
    grid the polynomials of the outermost cells are evaluated.
    """

    #: Each with four values at least.
    axes: tuple[UniformAxis, ...]
    #: Coefficients of the B-splines. Along an axis they begin one step before the first value and
    #: end one step after the last, two after the last of a periodic axis, (axes..., functions).
    coefficients: NDArray[np.floating]

    @classmethod
    def through(
        cls, axes: Sequence[UniformAxis], values: ArrayLike, dtype: type[np.floating] = np.float64
    ) -> UniformSpline:
        """The spline through `values` (axes..., functions), with coefficients of type `dtype`."""
        coefficients = np.asarray(values, dtype=float)
        for i, axis in enumerate(axes):
            along = np.moveaxis(coefficients, i, 0)
            along = _periodic(along) if axis.periodic else _continued(along)
            coefficients = np.moveaxis(along, 0, i)
        return cls(tuple(axes), np.ascontiguousarray(coefficients, dtype))

    def with_gradient(self, points: Array) -> Array:
        """Values, then derivatives by each coordinate, (n, 1 + axes, functions)."""
        if len(points) > CHUNK:
            firsts = range(0, len(points), CHUNK)
            return np.concatenate([self.with_gradient(points[i : i + CHUNK]) for i in firsts])
        weights, rows = self._weights(points, self._stencil.value_and_gradient)
        return np.matmul(weights, self._stencil.coefficients.take(rows, axis=0))

    def sums(self, points: Array, factors: Array) -> Array:
        """Sums (n, functions) over m of the values at points (n, m, axes) times factors (n, m)."""
        n, m = factors.shape
        weights, rows = self._weights(points.reshape(n * m, -1), self._stencil.value)
        coefficients = self._stencil.coefficients
        products = (weights[:, 0] * factors.reshape(-1, 1)).astype(coefficients.dtype)
        starts = rows.shape[1] * m * np.arange(n + 1)
        shape = (n, len(coefficients))
        return sp.csr_matrix((products.ravel(), rows.ravel(), starts), shape) @ coefficients

    def _weights(self, points: Array, polynomials: Array) -> tuple[Array, Indices]:
        """Weights (n, results, 4^axes) of coefficients in rows (n, 4^axes), at points (n, axes)."""
        stencil, n, axes = self._stencil, len(points), len(self.axes)
        place = (points - stencil.start) * stencil.per_step
        for i, count in stencil.periods:
            place[:, i] %= count
        cell = np.minimum(np.maximum(place.astype(np.int64), 0), stencil.last_cell)
        # (axes, n, powers)
        powers = (place - cell).T[:, :, None] ** _POWERS
        factors = np.matmul(powers, polynomials).astype(stencil.coefficients.dtype, copy=False)
        factors = factors.reshape(axes, n, -1, 4)
        weights = factors[0]
        for i in range(1, axes):
            weights = weights[..., None] * factors[i, :, :, None]
            weights = weights.reshape(n, -1, 4 ** (i + 1))
        return weights, (cell @ stencil.stride)[:, None] + stencil.offsets

    @cached_property
    def _stencil(self) -> _Stencil:
        return _Stencil.of(self.axes, self.coefficients)


@dataclass(frozen=True, eq=False)
class _Stencil:
    """What an evaluation needs of the axes and the coefficients, prepared once."""

    start: Array  # first values of the axes
    per_step: Array  # inverses of the steps
    value: Array  # B-splines by powers of the place in a cell, (axes, 4, 4)
    value_and_gradient: Array  # for value and derivatives, (axes, 4, results 4)
    periods: tuple[tuple[int, int], ...]  # index and number of cells of periodic axes
    last_cell: Indices  # (axes,)
    stride: Indices  # rows from one coefficient to the next along each axis, (axes,)
    offsets: Indices  # rows that count in a cell, relative to the first, (4^axes,)
    coefficients: NDArray[np.floating]  # (rows, functions)

    @classmethod
    def of(cls, axes: Sequence[UniformAxis], coefficients: NDArray[np.floating]) -> _Stencil:
        sizes = np.array(coefficients.shape[:-1])
        stride = np.append(np.cumprod(sizes[:0:-1])[::-1], 1)
        offsets = np.zeros(1, dtype=np.int64)
        for rows_per_step in stride:
            offsets = (offsets[:, None] + rows_per_step * np.arange(4)).ravel()
        per_step = 1.0 / np.array([axis.step for axis in axes])
        # (axes, powers, results, splines): derivatives by coordinate i differ in the factor of i
        polynomials = np.tile(_CUBIC[:, None], (len(axes), 1, 1 + len(axes), 1))
        for i, inverse in enumerate(per_step):
            polynomials[i, :, 1 + i] = inverse * _SLOPE
        polynomials = polynomials.reshape(len(axes), 4, -1)
        return cls(
            start=np.array([axis.start for axis in axes]),
            per_step=per_step,
            value=polynomials[:, :, :4],
            value_and_gradient=polynomials,
            periods=tuple((i, axis.count) for i, axis in enumerate(axes) if axis.periodic),
            last_cell=sizes - 4,
            stride=stride,
            offsets=offsets,
            coefficients=coefficients.reshape(-1, coefficients.shape[-1]),
        )


def _periodic(values: Array) -> Array:
    """Coefficients along the first axis, one before the first value and two after the last."""
    coefficients = spline_filter1d(values, 3, axis=0, mode="grid-wrap")
    return np.concatenate([coefficients[-1:], coefficients, coefficients[:2]])


def _continued(values: Array) -> Array:
    """Coefficients along the first axis, one before the first value and one after the last."""
    # weights of the outermost three values in the k-th value of their parabola beyond the end
    k = np.arange(1.0, CONTINUED_CELLS + 1.0)
    parabola = np.stack([(k + 1) * (k + 2) / 2, -k * (k + 2), k * (k + 1) / 2], axis=1)
    before = np.tensordot(parabola[::-1], values[:3], axes=1)
    after = np.tensordot(parabola, values[:-4:-1], axes=1)
    coefficients = spline_filter1d(
        np.concatenate([before, values, after]), 3, axis=0, mode="mirror"
    )
    return coefficients[CONTINUED_CELLS - 1 : 1 - CONTINUED_CELLS]
