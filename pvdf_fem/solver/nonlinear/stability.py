"""Whether a state is an equilibrium, and whether it is a stable one."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import count_negative_pivots


def is_compressed(state: State) -> bool:
    """Return whether a principal stress is compressive anywhere."""
    s11, s22, s12 = np.moveaxis(state.stress, -1, 0)
    return bool(np.any((s11 + s22 < 0.0) | (s11 * s22 < s12**2)))


def is_stable(equilibrium: Equilibrium, factors: SuperLU) -> bool:
    """Return whether an equilibrium in compression may be a minimum of the energy.

    Its tangent decides in a plate. It cannot decide without an energy, nor in a membrane, where
    every compressed equilibrium is unstable on a fine enough mesh; both count as stable here.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations.
    factors : SuperLU
        Factors of their tangent at the equilibrium.
    """
    if not equilibrium.conservative or not equilibrium.model.bends:
        return True
    return count_negative_pivots(factors) == 0


def is_balanced(equilibrium: Equilibrium, state: State, factors: SuperLU, allowed: float) -> bool:
    """Return whether the forces balance.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations.
    state : State
        The state in question.
    factors : SuperLU
        Factors of a tangent near the state.
    allowed : float
        Largest relative imbalance.

    Notes
    -----
    Two measures must be within `allowed`. By the residual R and the tangent K, the distance from
    the solution in the energy norm is sqrt(R · K⁻¹ R), relative to the root of the loads' work. The
    reaction of the rim shows load that the film does not transfer, relative to the whole load.
    """
    residual = equilibrium.residual(state)
    squared_distance = abs(float(residual @ factors.solve(residual)))
    work = equilibrium.work(state, equilibrium.restrict(state.dofs))
    is_rim_balanced = equilibrium.imbalance(state) <= allowed * equilibrium.force
    return squared_distance <= allowed**2 * work and is_rim_balanced
