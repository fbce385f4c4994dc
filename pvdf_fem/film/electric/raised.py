"""A sparse matrix that few dense columns raise: A + B Bᵀ, and its factors by those of A."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU

from pvdf_fem.arrays import Array


class Raised(LinearOperator):  # type: ignore[misc]
    """A + B Bᵀ of a sparse A (n, n) and columns B (n, m)."""

    def __init__(self, sparse: sp.csc_matrix, columns: Array) -> None:
        super().__init__(sparse.dtype, sparse.shape)
        self.sparse, self.columns = sparse, columns

    def _matmat(self, x: Array) -> Array:
        return np.asarray(self.sparse @ x + self.columns @ (self.columns.T @ x))


class RaisedFactors:
    """Solves with A + B Bᵀ by the factors of A and Woodbury's identity."""

    def __init__(self, matrix: Raised, factors: SuperLU) -> None:
        self.factors, self.columns = factors, matrix.columns
        self._raising = factors.solve(self.columns)
        self._small = np.eye(self.columns.shape[1]) + self.columns.T @ self._raising

    def solve(self, right: Array, trans: str = "N") -> Array:
        """The solution for right-hand sides (n,) or (n, m), like SuperLU's."""
        turned = trans == "T"
        raising = self.factors.solve(self.columns, "T") if turned else self._raising
        x = self.factors.solve(right, trans)
        shares = np.linalg.solve(self._small.T if turned else self._small, self.columns.T @ x)
        return np.asarray(x - raising @ shares)

    @property
    def lifted(self) -> int:
        """How many negative eigenvalues a symmetric A has beyond those of A + B Bᵀ."""
        return int((np.linalg.eigvalsh(self._small) < 0.0).sum())
