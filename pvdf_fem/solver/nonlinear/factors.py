"""Factorised tangent matrices: their inertia, and quasi-Newton steps with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from pvdf_fem.arrays import Array
from pvdf_fem.film.low_rank import LowRankFactors, LowRankUpdate


def factorise(matrix: sp.csc_matrix | LowRankUpdate) -> SuperLU:
    """Factorise a matrix with a symmetric sparsity pattern, without numerical pivoting.

    Parameters
    ----------
    matrix : csc_matrix or LowRankUpdate, shape (n, n)
        The matrix, which need not be positive definite.

    Returns
    -------
    SuperLU or LowRankFactors
        Factors with a ``solve`` method; `LowRankFactors` for a low-rank update. Diagonal pivots are
        taken, so that the signs on the diagonal of U give the inertia of a symmetric matrix, see
        `count_negative_pivots`.

    Raises
    ------
    RuntimeError
        If the matrix is exactly singular.
    """
    if isinstance(matrix, LowRankUpdate):
        return LowRankFactors(matrix, factorise(matrix.sparse))
    return splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


def count_negative_pivots(factors: SuperLU) -> int:
    """Count the negative eigenvalues of a factorised symmetric matrix.

    Notes
    -----
    By Sylvester's law of inertia their number equals the number of negative pivots in U. A low-rank
    update A + B Bᵀ has fewer negative eigenvalues than A, by the number of negative eigenvalues of
    I + Bᵀ A⁻¹ B.
    """
    if isinstance(factors, LowRankFactors):
        removed = int((np.linalg.eigvalsh(factors.small) < 0.0).sum())
        return count_negative_pivots(factors.factors) - removed
    return int((factors.U.diagonal() < 0).sum())


def has_negative_determinant(factors: SuperLU | None) -> bool:
    """Return whether the factorised tangent has a negative determinant; False for None."""
    return factors is not None and count_negative_pivots(factors) % 2 == 1


@dataclass(frozen=True)
class FactorisedTangent:
    """A factorised tangent, and the history of the steps that were made with it.

    Attributes
    ----------
    factors : SuperLU
        Factors of the tangent.
    is_convex : bool
        Whether the tangent lacks the geometric stiffness of compressive stress.
    residuals : list of ndarray, shape (unknowns,)
        Residuals in N before each step; `remember` appends to the list.
    steps : list of ndarray, shape (unknowns,)
        Changes of the unknowns in each step; `remember` appends to the list.
    """

    factors: SuperLU
    is_convex: bool = False
    residuals: list[Array] = field(default_factory=list)
    steps: list[Array] = field(default_factory=list)

    @property
    def is_new(self) -> bool:
        """Whether no step has been made with the tangent yet."""
        return not self.steps

    def compute_step(self, residual: Array) -> Array:
        """Compute the full step at a residual: Newton's if the tangent is new, otherwise L-BFGS.

        Parameters
        ----------
        residual : ndarray, shape (unknowns,)
            Residual in N at the present unknowns.

        Returns
        -------
        ndarray, shape (unknowns,)
            Change of the unknowns. Nothing is stored; see `remember`.

        Notes
        -----
        The two-loop recursion of L-BFGS (Nocedal, Math. Comp. 35, 1980, 773-782), with the
        factorised tangent as the initial approximation of the Hessian. The stored steps s and the
        changes y of the residual in them update an older tangent in the few modes whose stiffness
        changes most.
        """
        differences = [after - before for before, after in pairwise([*self.residuals, residual])]
        pairs = list(zip(self.steps, differences, strict=True))
        remainder = residual
        alphas = []
        for s, y in reversed(pairs):
            alpha = (s @ remainder) / (s @ y)
            remainder = remainder - alpha * y
            alphas.append(alpha)
        alphas.reverse()
        inverse_product = self.factors.solve(remainder)
        for (s, y), alpha in zip(pairs, alphas, strict=True):
            beta = (y @ inverse_product) / (s @ y)
            inverse_product = inverse_product + (alpha - beta) * s
        return -inverse_product

    def remember(self, residual: Array, step: Array) -> None:
        """Append a residual and the step that was made there to the history."""
        self.residuals.append(residual)
        self.steps.append(step)
