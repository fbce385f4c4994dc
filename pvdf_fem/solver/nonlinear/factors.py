"""Factors of tangents: their inertia, and quasi-Newton steps with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from pvdf_fem.arrays import Array
from pvdf_fem.film.low_rank import LowRankFactors, LowRankUpdate


def factorise(matrix: sp.csc_matrix | LowRankUpdate) -> SuperLU:
    """Factorise a matrix with a symmetric pattern.

    Parameters
    ----------
    matrix : (n, n) csc_matrix or LowRankUpdate
        The matrix.

    Returns
    -------
    SuperLU
        L and U, or `LowRankFactors` of a low-rank update. There is no pivoting, so that the signs
        on the diagonal of U give the inertia, see `count_negative_pivots`.

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
    By Sylvester's law of inertia they are as many as the negative pivots in U. A low-rank update
    A + B Bᵀ has fewer than A by the number of negative eigenvalues of I + Bᵀ A⁻¹ B.
    """
    if isinstance(factors, LowRankFactors):
        removed = int((np.linalg.eigvalsh(factors.small) < 0.0).sum())
        return count_negative_pivots(factors.factors) - removed
    return int((factors.U.diagonal() < 0).sum())


def has_negative_determinant(factors: SuperLU | None) -> bool:
    """Return whether a tangent's determinant is negative; False without a tangent."""
    return factors is not None and count_negative_pivots(factors) % 2 == 1


@dataclass(frozen=True)
class FactorisedTangent:
    """A factorised tangent, with the steps that were made with it.

    Attributes
    ----------
    factors : SuperLU
        Its factors.
    is_convex : bool
        Whether the stiffness of compressive stress is left out of it.
    residuals : list of ndarray, shape (unknowns,)
        Residuals in N at which steps were made with it.
    steps : list of ndarray, shape (unknowns,)
        These steps.
    """

    factors: SuperLU
    is_convex: bool = False
    residuals: list[Array] = field(default_factory=list)
    steps: list[Array] = field(default_factory=list)

    @property
    def is_new(self) -> bool:
        """Whether no step was made with it yet."""
        return not self.steps

    def compute_step(self, residual: Array) -> Array:
        """Compute the quasi-Newton step at a residual.

        Parameters
        ----------
        residual : ndarray, shape (unknowns,)
            The residual in N.

        Returns
        -------
        ndarray, shape (unknowns,)
            The Newton step while the tangent is new.

        Notes
        -----
        The two-loop recursion of L-BFGS (Nocedal, Math. Comp. 35, 1980, 773-782), with the factors
        as the first approximation of the inverse. By it the inverse of an older tangent follows the
        residuals, for the few modes that the tension changes most.
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
        """Keep a residual and the step that was made there."""
        self.residuals.append(residual)
        self.steps.append(step)
