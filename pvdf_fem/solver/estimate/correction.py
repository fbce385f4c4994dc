"""Discretisation error: the solution corrected in a richer space.

Newton steps correct the displacement of order p (coarse) in the space of order p + 1 (rich) on the
same mesh. The estimated error of a charge is its value at the corrected solution minus its value
at the solution. Such error estimates are called hierarchical (Bank and Smith, SIAM J. Numer. Anal.
30, 1993, 921-935); for quantities of interest see Becker and Rannacher, Acta Numerica 10, 2001,
section 3.

The linear correction needs no factorisation of the rich tangent: conjugate gradients with a
two-level preconditioner (factorised coarse tangent plus rich diagonal) take 5 to 10 iterations.

A linear correction is not enough, since the strain also contains the square of the error's slope.
A film resists stretching far more than rotation, so that this square changes the tension as much
as the linear part does. The change in tension is smooth, and two more Newton steps in the coarse
space (the smooth steps) include it. The estimate then mostly differs by less than a tenth, at worst
by a third, from the fully converged correction.
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
    """Accuracy of the correction in the richer space."""

    #: Conjugate gradients end if an iteration lowers the energy by at most this fraction of the
    #: total decrease.
    min_decrease: float = 0.02
    #: Replaces `min_decrease` for film models with bending or wrinkles, for which the diagonal is a
    #: worse preconditioner.
    min_decrease_rough: float = 1e-3
    max_iterations: int = 40  #: Maximum number of conjugate-gradient iterations.
    smooth_steps: int = 2  #: Newton steps in the coarse space after the linear correction.
    #: Maximum norm of the residual after the correction divided by that before; only for films that
    #: wrinkle.
    max_residual_ratio: float = 0.2
    #: If the richer equations are solved: relative size of Newton's last step divided by the
    #: tolerance of the charges.
    last_step: float = 0.1


@dataclass(frozen=True)
class Correction:
    """A solution of the coarse equations, and its correction in a richer space."""

    #: The equations in the richer space.
    rich: Equilibrium
    #: The coarse solution as a function of the richer space, shape (rich unknowns,).
    start: Array
    #: The corrected solution, shape (rich unknowns,).
    q: Array
    #: State at `start`, at which the richer equations are linearised.
    state: State
    #: Maps coarse to rich unknowns, shape (rich unknowns, coarse unknowns).
    prolongation: sp.csr_matrix
    #: The solve of the richer equations; None if a few steps were enough.
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
    """Correct a solution by a few steps in a richer space, or by a solve there if these fail.

    The steps are a linear correction by conjugate gradients and two smooth steps (Newton steps in
    the coarse space). They fail if the equations are too nonlinear, or too stiff at wrinkles.

    Parameters
    ----------
    coarse : Equilibrium
        The equations that were solved.
    q : ndarray, shape (coarse unknowns,)
        Solution of `coarse`.
    factors : SuperLU
        Factors of the tangent of `coarse` near `q`.
    rich : Equilibrium
        The equations of the same problem and mesh in a space that contains that of `coarse`.
    budget : Budget
        Limits the iterations if the richer equations of a film that wrinkles are solved. The work
        is not added to it.
    options : CorrectionOptions, optional
        Accuracy of the correction.

    Returns
    -------
    Correction or NewtonResult
        The correction; or, if the richer equations were solved without success, that result.
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
    """Correct by one inexact Newton step in the richer space, then by steps in the coarse space.

    Parameters
    ----------
    correction : Correction
        The solution that is to be corrected.
    factors : SuperLU
        Factors of the coarse tangent.
    options : CorrectionOptions
        Accuracy of the correction.

    Returns
    -------
    ndarray, shape (rich unknowns,), or None
        The corrected unknowns. None if the smooth steps grow, since the equations are too nonlinear
        or unstable, or if the residual of a film that wrinkles is still large.
    """
    rich = correction.rich
    prolongation = correction.prolongation
    initial_residual = rich.residual(correction.state)
    q = correction.start - _solve_linearised_equations(
        correction, initial_residual, factors, options=options
    )
    last_size = np.inf  # sizes are squared energy norms
    for _ in range(options.smooth_steps):
        coarse_residual = prolongation.T @ rich.residual(rich.state(q))
        step = factors.solve(coarse_residual)
        size = abs(float(step @ coarse_residual))
        if not size <= last_size:  # also true for NaN
            return None
        q = q - prolongation @ step
        last_size = size
    if rich.model.wrinkles:
        remainder = np.linalg.norm(rich.residual(rich.state(q)))
        if not remainder <= options.max_residual_ratio * np.linalg.norm(initial_residual):
            return None
    return q


def _solve_linearised_equations(
    correction: Correction, b: Array, factors: SuperLU, *, options: CorrectionOptions
) -> Array:
    """Solve A x = b with the tangent A of the richer space by preconditioned conjugate gradients.

    Parameters
    ----------
    correction : Correction
        The richer equations, the state at which A is taken, and the prolongation.
    b : ndarray, shape (rich unknowns,)
        Right-hand side in N.
    factors : SuperLU
        Factors of the coarse tangent, for the preconditioner.
    options : CorrectionOptions
        Stopping criteria of the iteration.

    Returns
    -------
    ndarray, shape (rich unknowns,)
        The approximate solution x. The iteration stops early at a direction of non-positive
        curvature, along which there is no minimum.
    """
    rich = correction.rich
    state = correction.state
    prolongation = correction.prolongation
    diagonal = rich.diagonal(state)
    min_decrease = options.min_decrease_rough
    if rich.model.mesh_policy.has_smooth_correction:
        min_decrease = options.min_decrease

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
        decrease = float(alpha * rz)  # twice the decrease of the energy x · A x / 2 - b · x
        total_decrease += decrease
        if decrease <= min_decrease * total_decrease:
            break
        z = precondition(r)
        last_rz = rz
        rz = r @ z
        beta = rz / last_rz
        p = z + beta * p
    return x


def solve_duals(correction: Correction, factors: SuperLU, gradients: Array) -> Array:
    """Solve the dual (adjoint) equations of outputs in the coarse space.

    Parameters
    ----------
    correction : Correction
        The richer equations, and the prolongation to their space.
    factors : SuperLU
        Factors of the coarse tangent K.
    gradients : ndarray, shape (rich dofs, outputs)
        Derivatives of the outputs J with respect to the dofs of the richer space.

    Returns
    -------
    ndarray, shape (coarse unknowns, outputs)
        Solutions λ of Kᵀ λ = ∂J/∂q, with the coarse unknowns q.
    """
    rich_gradients = correction.rich.unknowns.fold(gradients)
    return factors.solve(correction.prolongation.T @ rich_gradients, "T")


def compute_indicators(correction: Correction, duals: Array, gradients: Array) -> Array:
    """Compute dual-weighted estimates of how much each element contributes to output errors.

    Parameters
    ----------
    correction : Correction
        The coarse solution, and its correction in the richer space.
    duals : ndarray, shape (coarse unknowns, outputs)
        Dual solutions from `solve_duals`.
    gradients : ndarray, shape (rich dofs, outputs)
        Derivatives of the outputs with respect to the dofs of the richer space.

    Returns
    -------
    ndarray, shape (elements, outputs)
        Absolute contributions, in the units of the outputs.

    Notes
    -----
    A contribution is |f · z|. f are the forces of the element due to the error, which is the
    correction minus the solution, and z is the part of the dual solution that the coarse space
    lacks. z is estimated by one Jacobi step on the dual residual in the richer space.
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
