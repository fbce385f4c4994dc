"""Discretisation error: the solution corrected in a richer space.

The displacement of order p is corrected by Newton steps in the space of order p + 1 on the same
mesh (hierarchical error estimate: Bank and Smith, SIAM J. Numer. Anal. 30, 1993, 921-935; for
quantities of interest, Becker and Rannacher, Acta Numerica 10, 2001, section 3). The observable
of the corrected solution less that of the solution is the estimate, for all charges at once.

The linear correction needs no factorisation of its own: conjugate gradients with a two-level
preconditioner (the factorised tangent of order p, plus the diagonal) take 5 to 10 iterations.

It is not enough: the strain has the square of the error's slope, which a linear correction leaves
out. A film resists stretching far more than turning, so that this square changes the tension as
much as the error itself does. That change is smooth, so two more steps of order p alone
bring it in. The estimate is then mostly within a tenth, at worst a third, of the fully converged
correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.term import State
from pvdf_fem.film.unknowns import prolongation
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.newton import FullSteps, NewtonResult, compressed, is_stable, newton
from pvdf_fem.solvers.settled import Settled
from pvdf_fem.solvers.status import Status

#: Conjugate gradients end when an iteration lowers the energy by less than this part of what all
#: have done.
ENERGY_PART = 0.02
#: The same for bending and wrinkles, which the diagonal meets less well.
ENERGY_PART_ROUGH = 1e-3
#: Largest number of conjugate gradients' iterations.
MAX_ITERATIONS = 40
#: Newton steps in the space of order p after the linear correction.
SMOOTH_STEPS = 2
#: Residual over that of the start below which a correction of a film that wrinkles will do.
REMAINDER = 0.2
#: Relative size of Newton's last step where the richer equations are solved.
RICH_TOLERANCE = 1e-3
#: A richer space is solved only where the budget pays for this number of iterations.
RICH_ITERATIONS = 10


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


def corrected(
    coarse: Equilibrium,
    q: Array,
    factors: SuperLU,
    rich: Equilibrium,
    budget: Budget,
    settled: Settled | None = None,
) -> Correction | NewtonResult:
    """The solution `q` of `coarse` in the space of `rich`, or the solve there that failed.

    Usually a few conjugate gradients and two smooth steps give it. Where the film is too far from
    linear for them, or too stiff as it wrinkles, the richer equations are solved.
    `rich` is the scene of `coarse` on the same mesh in a space that contains the other, `factors`
    the factorised tangent of `coarse` near `q`, and `settled` has charges that the last steps must
    leave as they are.
    """
    prolong = prolongation(coarse, rich)
    start = prolong @ q
    state = rich.state(start)
    correction = Correction(rich, start, start, state, prolong)
    better = _few_steps(correction, factors)
    if better is not None and not _lacks_balance(rich, start, better):
        return replace(correction, q=better)
    last = settled and replace(settled, start=start)
    affordable = budget.iterations(rich)
    if rich.model.wrinkles or affordable >= RICH_ITERATIONS:
        result = equilibrate(rich, start, RICH_TOLERANCE, budget=budget, settled=last)
    else:
        result = _undamped(rich, start)
    if not result.converged:
        return result
    return replace(correction, q=result.q, result=result)


def _few_steps(correction: Correction, factors: SuperLU) -> Array | None:
    """A Newton step in the richer space, and smooth steps in the space below.

    None where the smooth steps grow: between the two spaces the equations are not linear enough, or
    not stable.
    """
    rich, prolong = correction.rich, correction.prolong
    better = correction.start - _solve(correction, rich.residual(correction.state), factors)
    last = np.inf
    for _ in range(SMOOTH_STEPS):
        residual = prolong.T @ rich.residual(rich.state(better))
        step = factors.solve(residual)
        size = abs(float(step @ residual))
        if not size <= last:
            return None
        better, last = better - prolong @ step, size
    return better


def _solve(correction: Correction, right: Array, factors: SuperLU) -> Array:
    """Preconditioned conjugate gradients with the tangent of the richer space."""
    rich, state, prolong = correction.rich, correction.state, correction.prolong
    diagonal = rich.diagonal(state)

    def precondition(residual: Array) -> Array:
        return prolong @ factors.solve(prolong.T @ residual) + residual / diagonal

    enough = ENERGY_PART if rich.model.smooth else ENERGY_PART_ROUGH
    x, residual, energy = np.zeros_like(right), right.copy(), 0.0
    direction = precondition(residual)
    product = residual @ direction
    for _ in range(MAX_ITERATIONS):
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


def _lacks_balance(rich: Equilibrium, start: Array, better: Array) -> bool:
    """Whether a film that wrinkles is still far from balance."""
    if not rich.model.wrinkles:
        return False
    left, before = (float(np.linalg.norm(rich.residual(rich.state(q)))) for q in (better, start))
    return not left <= REMAINDER * before


def _undamped(rich: Equilibrium, start: Array) -> NewtonResult:
    """Undamped Newton in a large space.

    Where it leads nowhere, the film is in compression and buckles into waves that its mesh is too
    coarse for, and Newton's method from afar would take minutes to say no more.
    """
    result = newton(FullSteps(rich, RICH_TOLERANCE), start)
    unsure = rich.conservative and compressed(rich.state(start))
    if unsure and result.factors is not None and not is_stable(rich, result.factors):
        return replace(result, status=Status.UNSTABLE)
    return result


def duals(correction: Correction, factors: SuperLU, goals: Array) -> Array:
    """Dual solutions in the coarse space, (coarse unknowns, goals).

    `goals` (rich dofs, goals) are the derivatives of the goals; `factors` is the coarse tangent.
    """
    rich = correction.rich.unknowns.fold(goals)
    return factors.solve(correction.prolong.T @ rich, "T")


def indicators(correction: Correction, dual: Array, goals: Array) -> Array:
    """Absolute contributions of elements to the errors of the goals, (elements, goals).

    Dual-weighted: the error's element energy against the part of the dual solution that the
    coarse space lacks, the latter from one Jacobi step on the dual residual.
    `dual` (coarse unknowns, goals) is from `duals`, and `goals` (rich dofs, goals) are the
    derivatives of the goals by the dofs of ``correction.rich``.
    """
    rich, state = correction.rich, correction.state
    error = rich.element_action(state, correction.q - correction.start)
    diagonal = rich.diagonal(state)
    shares = []
    for goal, solution in zip(rich.unknowns.fold(goals).T, dual.T, strict=True):
        missing = (goal - rich.action(state, correction.prolong @ solution)) / diagonal
        local = rich.unknowns.expand(missing)[rich.space.element_dofs]
        shares.append(np.abs((error * local).sum(axis=1)))
    return np.stack(shares, axis=-1)
