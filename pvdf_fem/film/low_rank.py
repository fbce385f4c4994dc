"""Low-rank updates A + B Bᵀ of sparse matrices, and solves with them by the factors of A."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU

from pvdf_fem.arrays import Array


class LowRankUpdate(LinearOperator):  # type: ignore[misc]
    """The matrix A + B Bᵀ as a linear operator; the sum itself is never formed.

    Parameters
    ----------
    sparse : sparse matrix, shape (n, n)
        The sparse matrix A.
    columns : ndarray, shape (n, m)
        The matrix B of a few columns. Products skip the rows of B that are zero.
    """

    def __init__(self, sparse: sp.csc_matrix, columns: Array) -> None:

        super().__init__(sparse.dtype, sparse.shape)
        self.sparse = sparse
        self.columns = columns
        self._nonzero = np.flatnonzero(columns.any(axis=1))
        self._nonzero_rows = columns[self._nonzero]

    def _matmat(self, x: Array) -> Array:
        if np.iscomplexobj(x):  # a product with complex x would make a complex copy of B
            return self._matmat(x.real) + 1j * self._matmat(x.imag)
        total = np.asarray(self.sparse @ x)
        coefficients = self._nonzero_rows.T @ x[self._nonzero]  # Bᵀ x
        total[self._nonzero] += self._nonzero_rows @ coefficients
        return total


class LowRankFactors:
    """A solver for A + B Bᵀ that needs only the LU factors of A and an m x m matrix.

    Parameters
    ----------
    matrix : LowRankUpdate
        The matrix A + B Bᵀ.
    factors : SuperLU
        LU factors of A.

    Notes
    -----
    Woodbury's identity: (A + B Bᵀ)⁻¹ = A⁻¹ - A⁻¹ B (I + Bᵀ A⁻¹ B)⁻¹ Bᵀ A⁻¹.
    """

    def __init__(self, matrix: LowRankUpdate, factors: SuperLU) -> None:
        self.factors = factors
        self.columns = matrix.columns
        #: A⁻¹ B under the key "N", and A⁻ᵀ B under the key "T".
        self._solved_columns = {trans: factors.solve(self.columns, trans) for trans in "NT"}
        #: I + Bᵀ A⁻¹ B, shape (m, m). For a symmetric A, the number of its negative eigenvalues is
        #: that of A minus that of A + B Bᵀ.
        self.small = np.eye(self.columns.shape[1]) + self.columns.T @ self._solved_columns["N"]

    def solve(self, right: Array, trans: str = "N") -> Array:
        """Solve a linear system with A + B Bᵀ or its transpose, called like `SuperLU.solve`.

        Parameters
        ----------
        right : ndarray, shape (n,) or (n, m)
            Right-hand sides.
        trans : str
            "N" for A + B Bᵀ, "T" for its transpose.

        Returns
        -------
        ndarray, shape (n,) or (n, m)
            The solutions.
        """
        x = self.factors.solve(right, trans)
        small = self.small if trans == "N" else self.small.T
        correction = np.linalg.solve(small, self.columns.T @ x)
        return np.asarray(x - self._solved_columns[trans] @ correction)
