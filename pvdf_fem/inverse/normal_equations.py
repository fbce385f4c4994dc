"""Normal equations of linearised least-squares problems.

Arrays named `system` are the augmented matrices [r J] of the whitened residuals r and their
derivatives J, of shape (n, residuals, 1 + k). Their products [r J]ᵀ[r J], of shape
(n, 1 + k, 1 + k), hold χ² = |r|² in the corner [0, 0], the gradient Jᵀr beside it, and JᵀJ in the
rest. n problems are solved at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from pvdf_fem.arrays import Array, Indices


def append_prior_rows(system: Array, residuals: Array, inverse_deviations: Array) -> Array:
    """Append residuals for normal priors, one for each of the k coordinates.

    Parameters
    ----------
    system : ndarray, shape (n, residuals, 1 + k)
        Augmented matrices [r J].
    residuals : ndarray, shape (k,) or (n, k)
        Differences of the coordinates from their prior means, divided by the standard deviations of
        the priors.
    inverse_deviations : ndarray, shape (k,)
        Reciprocal standard deviations of the priors: the derivatives of the new residuals.

    Returns
    -------
    ndarray, shape (n, residuals + k, 1 + k)
        New augmented matrices, with the rows of the priors at the end.
    """
    count = len(inverse_deviations)
    prior_rows = np.zeros((len(system), count, 1 + count))
    prior_rows[:, :, 0] = residuals
    prior_rows[:, :, 1:] = np.diag(inverse_deviations)
    return np.concatenate([system, prior_rows], axis=1)


def apply_robust_loss(system: Array, limits: Array) -> Array:
    """Reduce the weights of groups of residuals whose squared norm exceeds a limit.

    Parameters
    ----------
    system : ndarray, shape (groups, residuals, 1 + k)
        Augmented matrices [r J] of the groups of residuals of one search.
    limits : ndarray, shape (groups,)
        Squared norms c up to which groups keep their full weight; infinite for no reduction.

    Returns
    -------
    ndarray, shape (1, groups * (residuals + 1), 1 + k)
        The augmented matrix of the search: for each group its residuals, then a further one.

    Notes
    -----
    A group with the squared norm s and the limit c has the loss ρ(s) = s for s ≤ c, and
    ρ(s) = c (1 + ln(s/c)) for s > c. Residuals and derivatives are multiplied by the square root of
    the weight ρ'(s), which is 1 for s ≤ c and c/s for s > c (iteratively reweighted least squares:
    Huber, Robust Statistics, 1981, chapter 7). The further residual √(ρ(s) - s ρ'(s)) has zero
    derivatives and makes the sum of squares equal to the loss.
    """
    excess = np.maximum(np.square(system[:, :, 0]).sum(axis=1) / limits, 1.0)  # max(s/c, 1)
    remainder = np.zeros((len(system), 1, system.shape[2]))
    # An infinite limit times ln 1 = 0 would be NaN.
    finite_limits = np.where(excess > 1.0, limits, 0.0)
    remainder[:, 0, 0] = np.sqrt(finite_limits * np.log(excess))
    weighted = system / np.sqrt(excess)[:, None, None]
    return np.concatenate([weighted, remainder], axis=1).reshape(1, -1, system.shape[2])


def apply_one_sided_likelihood(system: Array, sides: Indices) -> None:
    """Replace the residuals of limits, in place, by those of a one-sided likelihood.

    Parameters
    ----------
    system : ndarray, shape (n, residuals, 1 + k)
        Augmented matrices [r J], with r the difference between model and measurement, divided by
        its standard deviation.
    sides : ndarray of int, shape (n, residuals) or (1, residuals)
        1 where the true value is known to be above the measured one, -1 where it is known to be
        below, and 0 where the measurement is a value, whose residual is not changed.

    Notes
    -----
    With z = side · r, the probability of a reading beyond the limit is Φ(z) of the standard normal
    distribution (the censored normal model: Tobin, Econometrica 26 (1958) 24-36). Residuals become
    -side √(-2 ln Φ(z)), whose square is minus twice the logarithm of this probability. They vanish
    far beyond the limit, and approach r far on the wrong side of it.
    """
    selected = np.nonzero(np.broadcast_to(sides, system.shape[:2]))
    if not len(selected[0]):
        return
    side = np.broadcast_to(sides, system.shape[:2])[selected]
    z = side * system[..., 0][selected]
    log_probability = log_ndtr(z)
    # Far beyond the limit the probability rounds to 1; the slope is then zero, not 0/0.
    root = np.maximum(np.sqrt(-2.0 * log_probability), np.finfo(float).tiny)
    log_density = -0.5 * (np.square(z) + math.log(2.0 * math.pi))
    slope = np.exp(log_density - log_probability - np.log(root))
    # A limit at infinity has an infinite residual, which is not to be multiplied by 0.
    derivatives = slope[:, None] * system[selected][:, 1:]
    system[selected] = np.column_stack([-side * root, derivatives])


def compute_normal_matrices(system: Array) -> Array:
    """Compute the products [r J]ᵀ[r J] of augmented matrices.

    Parameters
    ----------
    system : ndarray, shape (n, residuals, 1 + k)
        Augmented matrices [r J] of n searches.

    Returns
    -------
    ndarray, shape (n, 1 + k, 1 + k)
        Symmetric matrices with χ² = |r|² in the corner [0, 0], the gradient Jᵀr in the rest of the
        first row and column, and JᵀJ in the rows and columns from 1 on.
    """
    return np.matmul(system.swapaxes(1, 2), system)


class DampedSteps(NamedTuple):
    """Damped Gauss-Newton steps of n searches."""

    step: Array  #: Changes of the coordinates; shape (n, k).
    predicted_decrease: Array  #: Predicted decrease of chi-square by the step; shape (n,).


def compute_damped_steps(normal: Array, damping: Array | float) -> DampedSteps:
    """Solve the damped normal equations of several searches.

    Parameters
    ----------
    normal : ndarray, shape (n, 1 + k, 1 + k)
        Products [r J]ᵀ[r J] by `compute_normal_matrices`.
    damping : float or ndarray, shape (n, 1)
        Damping λ, for all searches or for each of them.

    Returns
    -------
    DampedSteps
        Steps s = -(JᵀJ + λ diag(JᵀJ))⁻¹ Jᵀr, zero along coordinates on which no residual depends,
        and the decreases of chi-square that are predicted for the steps.

    Notes
    -----
    The predicted decrease is -sᵀJᵀr. If the residuals are linear, the actual decrease is larger by
    λ sᵀdiag(JᵀJ)s.
    """
    damped = normal[:, 1:, 1:].copy()
    diagonal = np.einsum("nii->ni", damped)  # a view: changes of it change `damped`
    diagonal *= 1.0 + damping
    # Coordinates that the residuals do not depend on keep their values.
    diagonal += diagonal == 0.0
    gradient = normal[:, 1:, :1]
    opposite_step = np.asarray(np.linalg.solve(damped, gradient), dtype=float)
    decrease = np.matmul(gradient.swapaxes(1, 2), opposite_step)[:, 0, 0]
    return DampedSteps(step=-opposite_step[:, :, 0], predicted_decrease=decrease)
