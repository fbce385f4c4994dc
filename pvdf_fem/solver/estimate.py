"""Discretisation error: the solution corrected in a richer space.

The displacement of order p is corrected by Newton steps in the space of order p + 1 on the same
mesh (hierarchical error estimate: Bank and Smith, SIAM J. Numer. Anal. 30, 1993, 921-935; for
quantities of interest, Becker and Rannacher, Acta Numerica 10, 2001, section 3). The observable at
the corrected solution minus the observable at the solution is the estimate, for every charge at
once.

The linear correction needs no factorisation of its own: conjugate gradients with a two-level
preconditioner (the factorised tangent of order p, plus the diagonal) take 5 to 10 iterations.

A linear correction is not enough: the strain also has the square of the error's slope. A film
resists stretching far more than turning, and this square changes the tension equally to the error
itself. The change in tension is smooth: two more steps with order p bring it in. The estimate is
then mostly within a tenth, at worst a third, of the fully converged correction.
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

    #: Conjugate gradients end when an iteration lowers the energy by less than this part of the
    #: decrease all have done.
    energy_part: float = 0.02
    #: The same part for bending and wrinkles, which the diagonal meets less well.
    energy_part_rough: float = 1e-3
    max_iterations: int = 40  #: Of conjugate gradients.
    smooth_steps: int = 2  #: Newton steps in the space of order p after the linear correction.
    #: Residual over the initial residual that suffices for corrections in a wrinkling film.
    remainder: float = 0.2
    #: Size of Newton's last step where the richer equations are solved, over the tolerance of the
    #: charges.
    last_step: float = 0.1


@dataclass(frozen=True)
class Correction:
    """A solution corrected in a richer space, and what the error is made of."""

    #: The richer equations.
    rich: Equilibrium
    #: start, q: The given solution written in the richer space, and the corrected one, (rich
    #: unknowns,).
    start: Array
    q: Array
    #: Fields of `start`, where the correction took its tangent.
    state: State
    #: (rich unknowns, coarse unknowns)
    prolong: sp.csr_matrix
    #: The solve in the richer space, if a linear correction was not enough.
    result: NewtonResult | None = None


def correct_in_richer_space(
    coarse: Equilibrium,
    q: Array,
    factors: SuperLU,
    rich: Equilibrium,
    budget: Budget,
    options: CorrectionOptions = CorrectionOptions(),
) -> Correction | NewtonResult:
    """The solution `q` of `coarse` in the space of `rich`, or the failed solve there.

    Usually a few conjugate gradients and two smooth steps give it. Where the film is too far from
    linear for them, or too stiff as it wrinkles, the richer equations are solved.
    `rich` has the scene and mesh of `coarse` in a space that contains the coarse space; `factors`
    is the factorised tangent of `coarse` near `q`.
    """
    prolong = make_prolongation(coarse, rich)
    start = prolong @ q
    state = rich.state(start)
    correction = Correction(rich, start, start, state, prolong)
    better = _few_steps(correction, factors, options)
    if better is not None:
        return replace(correction, q=better)
    tolerance = options.last_step * rich.scene.numerics.tolerance
    result = find_equilibrium(rich, start, tolerance, budget=budget)
    if not result.converged:
        return result
    return replace(correction, q=result.q, result=result)


def _few_steps(
    correction: Correction, factors: SuperLU, options: CorrectionOptions
) -> Array | None:
    """A Newton step in the richer space, and smooth steps in the space below.

    None where the smooth steps grow: between the two spaces the equations are not linear enough, or
    not stable. None, too, where a wrinkling film is still far from balance.
    """
    rich, prolong, residual = correction.rich, correction.prolong, correction.rich.residual
    unbalanced = residual(correction.state)
    better = correction.start - _solve(correction, unbalanced, factors, options)
    last = np.inf
    for _ in range(options.smooth_steps):
        smooth = prolong.T @ residual(rich.state(better))
        step = factors.solve(smooth)
        size = abs(float(step @ smooth))
        if not size <= last:
            return None
        better, last = better - prolong @ step, size
    if rich.model.wrinkles:
        left = np.linalg.norm(residual(rich.state(better)))
        return better if left <= options.remainder * np.linalg.norm(unbalanced) else None
    return better


def _solve(
    correction: Correction, right: Array, factors: SuperLU, options: CorrectionOptions
) -> Array:
    """Preconditioned conjugate gradients with the tangent of the richer space."""
    rich, state, prolong = correction.rich, correction.state, correction.prolong
    diagonal = rich.diagonal(state)

    def precondition(residual: Array) -> Array:
        return prolong @ factors.solve(prolong.T @ residual) + residual / diagonal

    enough = (
        options.energy_part
        if rich.model.mesh_policy.has_smooth_correction
        else options.energy_part_rough
    )
    x, residual, energy = np.zeros_like(right), right.copy(), 0.0
    direction = precondition(residual)
    product = residual @ direction
    for _ in range(options.max_iterations):
        force = rich.action(state, direction)
        curvature = float(direction @ force)
        if curvature <= 0.0:  # no minimum along it: the smooth steps take the remainder
            break
        length = product / curvature
        x, residual = x + length * direction, residual - length * force
        energy += float(length * product)
        if length * product <= enough * energy:
            break
        preconditioned = precondition(residual)
        product, last = residual @ preconditioned, product
        direction = preconditioned + product / last * direction
    return x


def solve_duals(correction: Correction, factors: SuperLU, outputs: Array) -> Array:
    """Dual solutions in the coarse space, (coarse unknowns, goals).

    `outputs` (rich dofs, goals) are the derivatives of the goals; `factors` is the coarse tangent.
    """
    rich = correction.rich.unknowns.fold(outputs)
    return factors.solve(correction.prolong.T @ rich, "T")


def compute_indicators(correction: Correction, dual: Array, outputs: Array) -> Array:
    """Absolute contributions by elements to the goals' errors, (elements, goals).

    Dual-weighted: the error's element energy against the part of the dual solution that the
    coarse space lacks, the latter from one Jacobi step on the dual residual.
    `dual` (coarse unknowns, goals) is from `solve_duals`, and `outputs` (rich dofs, goals) are the
    derivatives of the goals by the dofs of ``correction.rich``.
    """
    rich, state = correction.rich, correction.state
    error = rich.element_action(state, correction.q - correction.start)
    diagonal = rich.diagonal(state)
    shares = []
    for output, solution in zip(rich.unknowns.fold(outputs).T, dual.T, strict=True):
        missing = (output - rich.action(state, correction.prolong @ solution)) / diagonal
        local = rich.unknowns.expand(missing)[rich.space.element_dofs]
        shares.append(np.abs((error * local).sum(axis=1)))
    return np.stack(shares, axis=-1)
