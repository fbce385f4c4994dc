"""Tests of a solution: compressive stress, stability and balance of forces."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import count_negative_pivots


def is_compressed(state: State) -> bool:
    """Return whether a principal stress is compressive at any quadrature point."""
    s11, s22, s12 = np.moveaxis(state.stress, -1, 0)
    # both principal stresses are non-negative if and only if trace and determinant are
    has_negative_trace = s11 + s22 < 0.0
    has_negative_determinant = s11 * s22 < s12**2
    return bool(np.any(has_negative_trace | has_negative_determinant))


def may_be_stable(equilibrium: Equilibrium, factors: SuperLU) -> bool:
    """Return False if the tangent proves that a compressed equilibrium is unstable.

    This is decided only for plates under conservative loads, by the negative pivots of the tangent.
    In all other cases the result is True, without a test: nonconservative loads have no energy to
    minimise, and for a membrane in compression the signs of the pivots depend on the mesh.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations, for the film model and the kind of the loads.
    factors : SuperLU
        Factors of the tangent at the equilibrium; ignored if the film is not such a plate.
    """
    if not equilibrium.conservative or not equilibrium.model.bends:
        return True
    return count_negative_pivots(factors) == 0


def is_balanced(equilibrium: Equilibrium, state: State, factors: SuperLU, allowed: float) -> bool:
    """Return whether both the residual and the reaction of the rim are small enough.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations, for the residual and the loads.
    state : State
        The state that is tested.
    factors : SuperLU
        Factors of a tangent near the state.
    allowed : float
        Maximum relative imbalance, for both measures.

    Notes
    -----
    With the residual R and the tangent K, sqrt(|R · K⁻¹ R|) is the distance from the solution in
    the energy norm; it is compared with the square root of the loads' work. The reaction of the rim
    along the applied force must differ from that force by at most `allowed` times the sum of the
    loads' magnitudes.
    """
    residual = equilibrium.residual(state)
    squared_distance = abs(float(residual @ factors.solve(residual)))
    work = equilibrium.work(state, equilibrium.restrict(state.dofs))
    is_rim_balanced = equilibrium.imbalance(state) <= allowed * equilibrium.force
    return squared_distance <= allowed**2 * work and is_rim_balanced
