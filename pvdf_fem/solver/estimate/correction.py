"""Discretisation error: the solution corrected in a richer space.

Newton steps correct the displacement of order p in the space of order p + 1 on the same mesh. The
estimate of the error of an observable is its value at the corrected solution less its value at the
solution, for every charge at once. Such estimates are hierarchical (Bank and Smith, SIAM J. Numer.
Anal. 30, 1993, 921-935); for quantities of interest see Becker and Rannacher, Acta Numerica 10,
2001, section 3.

The linear correction needs no factorisation of its own: conjugate gradients with a two-level
preconditioner, the factorised tangent of order p plus the diagonal, take 5 to 10 iterations.

A linear correction is not enough, since the strain also has the square of the error's slope. A film
resists stretching far more than turning, so that this square changes the tension as much as the
error itself does. The change in tension is smooth: two more steps with order p include it. The
estimate is then mostly within a tenth, at worst a third, of the fully converged correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.film.term import State
from pvdf_fem.film.unknowns import make_prolongation
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import NewtonResult


@dataclass(frozen=True)
class CorrectionOptions:
    """How far the solution is corrected in the richer space."""

    #: Conjugate gradients end when an iteration lowers the energy by less than this share of the
    #: decrease so far.
    energy_share: float = 0.02
    #: The same for bending and wrinkles, for which the diagonal is a worse preconditioner.
    energy_share_rough: float = 1e-3
    max_iterations: int = 40  #: Of conjugate gradients.
    smooth_steps: int = 2  #: Newton steps in the space of order p after the linear correction.
    #: Residual over the initial residual that is small enough in a film that wrinkles.
    largest_remainder: float = 0.2
    #: Size of Newton's last step where the richer equations are solved, over the tolerance of the
    #: charges.
    last_step: float = 0.1


@dataclass(frozen=True)
class Correction:
    """A solution and its correction in a richer space."""

    #: The richer equations.
    rich: Equilibrium
    #: The solution of the coarse equations as an element of the richer space, (rich unknowns,).
    start: Array
    #: The corrected solution, (rich unknowns,).
    q: Array
    #: State of `start`, where the correction took its tangent.
    state: State
    #: Matrix from coarse to rich unknowns, (rich unknowns, coarse unknowns).
    prolongation: sp.csr_matrix
    #: The solve of the richer equations, where a linear correction was not enough.
    result: NewtonResult | None = None


def correct_in_richer_space(
    coarse: Equilibrium,
    q: Array,
    *,
    factors: SuperLU,
    rich: Equilibrium,
    budget: Budget,
    options: CorrectionOptions = CorrectionOptions(),
) -> Correction | NewtonResult:
    """Correct a solution in a richer space.

    Usually some conjugate gradients and two smooth steps are enough. The richer equations are
    solved where these steps do not converge: in a film that is too far from linear, or that is too
    stiff where it wrinkles.

    Parameters
    ----------
    coarse : Equilibrium
        The solved equations.
    q : ndarray, shape (coarse unknowns,)
        Their solution.
    factors : SuperLU
        Factors of the tangent of `coarse` near `q`.
    rich : Equilibrium
        The equations of the same problem and mesh in a space that contains that of `coarse`.
    budget : Budget
        What the solve of the richer equations may cost.
    options : CorrectionOptions, optional
        How far the solution is corrected.

    Returns
    -------
    Correction or NewtonResult
        The correction, or the failed solve of the richer equations.
    """
    prolongation = make_prolongation(coarse, rich)
    start = prolongation @ q
    state = rich.state(start)
    correction = Correction(rich, start, q=start, state=state, prolongation=prolongation)
    corrected = _correct_by_few_steps(correction, factors, options)
    if corrected is not None:
        return replace(correction, q=corrected)
    tolerance = options.last_step * rich.scene.numerics.tolerance
    result = find_equilibrium(rich, start, tolerance=tolerance, budget=budget)
    if not result.converged:
        return result
    return replace(correction, q=result.q, result=result)


def _correct_by_few_steps(
    correction: Correction, factors: SuperLU, options: CorrectionOptions
) -> Array | None:
    """Correct by a Newton step in the richer space, and smooth steps in the coarse space.

    Parameters
    ----------
    correction : Correction
        The solution that is to be corrected.
    factors : SuperLU
        Factors of the coarse tangent.
    options : CorrectionOptions
        How far the solution is corrected.

    Returns
    -------
    ndarray, shape (rich unknowns,), or None
        None where smooth steps grow, since the equations are not linear enough between the two
        spaces, or not stable. None, too, where a film that wrinkles is still far from balance.
    """
    rich = correction.rich
    prolongation = correction.prolongation
    initial_residual = rich.residual(correction.state)
    q = correction.start - _solve_linearised(correction, initial_residual, factors, options=options)
    last_size = np.inf
    for _ in range(options.smooth_steps):
        coarse_residual = prolongation.T @ rich.residual(rich.state(q))
        step = factors.solve(coarse_residual)
        size = abs(float(step @ coarse_residual))
        if not size <= last_size:
            return None
        q = q - prolongation @ step
        last_size = size
    if rich.model.wrinkles:
        remainder = np.linalg.norm(rich.residual(rich.state(q)))
        if not remainder <= options.largest_remainder * np.linalg.norm(initial_residual):
            return None
    return q


def _solve_linearised(
    correction: Correction, b: Array, factors: SuperLU, *, options: CorrectionOptions
) -> Array:
    """Solve A x = b with the tangent A of the richer space by preconditioned conjugate gradients.

    Parameters
    ----------
    correction : Correction
        The richer equations, and the state of their tangent.
    b : ndarray, shape (rich unknowns,)
        Right-hand side in N.
    factors : SuperLU
        Factors of the coarse tangent, for the preconditioner.
    options : CorrectionOptions
        When the iteration ends.

    Returns
    -------
    ndarray, shape (rich unknowns,)
        The approximate solution. Where the curvature along a direction is not positive it is the
        last iterate, since there is no minimum along that direction; smooth steps do the rest.
    """
    rich = correction.rich
    state = correction.state
    prolongation = correction.prolongation
    diagonal = rich.diagonal(state)
    small_share = options.energy_share_rough
    if rich.model.mesh_policy.has_smooth_correction:
        small_share = options.energy_share

    def precondition(residual: Array) -> Array:
        coarse = factors.solve(prolongation.T @ residual)
        return prolongation @ coarse + residual / diagonal

    x = np.zeros_like(b)
    r = b.copy()
    z = precondition(r)
    p = z
    rz = r @ z
    total_decrease = 0.0
    for _ in range(options.max_iterations):
        Ap = rich.action(state, p)
        curvature = float(p @ Ap)
        if curvature <= 0.0:
            break
        alpha = rz / curvature
        x = x + alpha * p
        r = r - alpha * Ap
        decrease = float(alpha * rz)  # twice that of the energy
        total_decrease += decrease
        if decrease <= small_share * total_decrease:
            break
        z = precondition(r)
        last_rz = rz
        rz = r @ z
        beta = rz / last_rz
        p = z + beta * p
    return x


def solve_duals(correction: Correction, factors: SuperLU, gradients: Array) -> Array:
    """Solve for the dual solutions of outputs in the coarse space.

    Parameters
    ----------
    correction : Correction
        The richer equations, and the prolongation to them.
    factors : SuperLU
        Factors of the coarse tangent K.
    gradients : ndarray, shape (rich dofs, outputs)
        Derivatives of the outputs J by the dofs of the richer space.

    Returns
    -------
    ndarray, shape (coarse unknowns, outputs)
        Solutions λ of Kᵀ λ = ∂J/∂q.
    """
    rich_gradients = correction.rich.unknowns.fold(gradients)
    return factors.solve(correction.prolongation.T @ rich_gradients, "T")


def compute_indicators(correction: Correction, duals: Array, gradients: Array) -> Array:
    """Compute how much each element contributes to the errors of outputs.

    Parameters
    ----------
    correction : Correction
        The solution, and its correction in the richer space.
    duals : ndarray, shape (coarse unknowns, outputs)
        Dual solutions from `solve_duals`.
    gradients : ndarray, shape (rich dofs, outputs)
        Derivatives of the outputs by the dofs of the richer space.

    Returns
    -------
    ndarray, shape (elements, outputs)
        Absolute contributions, in the units of the outputs.

    Notes
    -----
    They are dual-weighted: the forces of an element by the error of the solution, times the part of
    the dual solution that the coarse space lacks. One Jacobi step on the dual residual estimates
    that part.
    """
    rich = correction.rich
    state = correction.state
    error_forces = rich.element_action(state, correction.q - correction.start)
    diagonal = rich.diagonal(state)
    rich_gradients = rich.unknowns.fold(gradients)
    indicators = []
    for gradient, dual in zip(rich_gradients.T, duals.T, strict=True):
        dual_residual = gradient - rich.action(state, correction.prolongation @ dual)
        missing_dual = rich.unknowns.expand(dual_residual / diagonal)
        in_elements = missing_dual[rich.space.element_dofs]
        indicators.append(np.abs((error_forces * in_elements).sum(axis=1)))
    return np.stack(indicators, axis=-1)
