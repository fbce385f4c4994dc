"""A sparse matrix raised by dense columns: A + B Bᵀ, and its factors by those of A."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU

from pvdf_fem.arrays import Array


class LowRankUpdate(LinearOperator):  # type: ignore[misc]
    """A + B Bᵀ of a sparse A (n, n) and columns B (n, m)."""

    def __init__(self, sparse: sp.csc_matrix, columns: Array) -> None:
        super().__init__(sparse.dtype, sparse.shape)
        self.sparse, self.columns = sparse, columns
        self._where = np.flatnonzero(columns.any(axis=1))
        self._rows = columns[self._where]

    def _matmat(self, x: Array) -> Array:
        if np.iscomplexobj(x):  # or a complex copy of B would be made
            return self._matmat(x.real) + 1j * self._matmat(x.imag)
        total = np.asarray(self.sparse @ x)
        total[self._where] += self._rows @ (self._rows.T @ x[self._where])
        return total


class LowRankFactors:
    """Solves with A + B Bᵀ by the factors of A and Woodbury's identity."""

    def __init__(self, matrix: LowRankUpdate, factors: SuperLU) -> None:
        self.factors, self.columns = factors, matrix.columns
        self._spread = {trans: factors.solve(self.columns, trans) for trans in "NT"}
        #: I + Bᵀ A⁻¹ B: the negative eigenvalues here count those that A has in addition.
        self.small = np.eye(self.columns.shape[1]) + self.columns.T @ self._spread["N"]

    def solve(self, right: Array, trans: str = "N") -> Array:
        """The solution for right-hand sides (n,) or (n, m), like SuperLU's."""
        x, small = self.factors.solve(right, trans), self.small if trans == "N" else self.small.T
        return np.asarray(x - self._spread[trans] @ np.linalg.solve(small, self.columns.T @ x))
