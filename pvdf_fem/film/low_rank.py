"""Low-rank updates of sparse matrices, A + B Bᵀ, and their factors by those of A."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU

from pvdf_fem.arrays import Array


class LowRankUpdate(LinearOperator):  # type: ignore[misc]
    """The matrix A + B Bᵀ.

    Parameters
    ----------
    sparse : sparse matrix, shape (n, n)
        A.
    columns : ndarray, shape (n, m)
        B, with few columns.
    """

    def __init__(self, sparse: sp.csc_matrix, columns: Array) -> None:
        super().__init__(sparse.dtype, sparse.shape)
        self.sparse = sparse
        self.columns = columns
        self._nonzero = np.flatnonzero(columns.any(axis=1))
        self._nonzero_rows = columns[self._nonzero]

    def _matmat(self, x: Array) -> Array:
        if np.iscomplexobj(x):  # the product would make a complex copy of B
            return self._matmat(x.real) + 1j * self._matmat(x.imag)
        total = np.asarray(self.sparse @ x)
        total[self._nonzero] += self._nonzero_rows @ (self._nonzero_rows.T @ x[self._nonzero])
        return total


class LowRankFactors:
    """Solves with A + B Bᵀ by the factors of A.

    Parameters
    ----------
    matrix : LowRankUpdate
        A + B Bᵀ.
    factors : SuperLU
        Factors of A.

    Notes
    -----
    Woodbury's identity: (A + B Bᵀ)⁻¹ = A⁻¹ - A⁻¹ B (I + Bᵀ A⁻¹ B)⁻¹ Bᵀ A⁻¹.
    """

    def __init__(self, matrix: LowRankUpdate, factors: SuperLU) -> None:
        self.factors = factors
        self.columns = matrix.columns
        #: A⁻¹ B and A⁻ᵀ B.
        self._solved_columns = {trans: factors.solve(self.columns, trans) for trans in "NT"}
        #: I + Bᵀ A⁻¹ B, (m, m). Its negative eigenvalues count those that A has in addition to
        #: A + B Bᵀ.
        self.small = np.eye(self.columns.shape[1]) + self.columns.T @ self._solved_columns["N"]

    def solve(self, right: Array, trans: str = "N") -> Array:
        """Solve with the matrix, as `SuperLU.solve` does.

        Parameters
        ----------
        right : ndarray, shape (n,) or (n, m)
            Right-hand sides.
        trans : str
            "N", or "T" for the transposed matrix.

        Returns
        -------
        ndarray, shape (n,) or (n, m)
            The solutions.
        """
        x = self.factors.solve(right, trans)
        small = self.small if trans == "N" else self.small.T
        correction = np.linalg.solve(small, self.columns.T @ x)
        return np.asarray(x - self._solved_columns[trans] @ correction)
