"""Discretisation error: the solution corrected in a richer space.

The displacement of order p is corrected by Newton steps in the space of order p + 1 on the same
mesh (hierarchical error estimate: Bank and Smith, SIAM J. Numer. Anal. 30, 1993, 921-935; for
quantities of interest, Becker and Rannacher, Acta Numerica 10, 2001, section 3). The observable
of the corrected solution less that of the solution is the estimate, for all charges at once.

The linear correction needs no factorisation of its own: conjugate gradients with a two-level
preconditioner (the factorised tangent of order p, plus the diagonal) take 5 to 10 iterations.

It is not enough: a film resists stretching so much more than turning that the square of the error's
slope, which a linear correction leaves out, shifts the tension as much as the error itself does.
That shift is smooth, so two more steps in the space of order p alone bring it in; the estimate is
then mostly within a tenth, at worst a third, of the fully converged correction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import ELEMENTS, Array, MembraneState

# Conjugate gradients end when an iteration lowers the energy by less than this part of what all
# have done; bending and wrinkles, which the diagonal meets less well, need more of them.
ENERGY_PART, ENERGY_PART_ROUGH = 0.02, 1e-3
MAX_ITERATIONS = 40
SMOOTH_STEPS = 2
# Of values of shape functions at nodes where they vanish.
ROUNDING = 1e-13


@dataclass(frozen=True)
class Correction:
    """A solution corrected in a richer space, and what the error is made of.

    Attributes
    ----------
    rich : Equilibrium
        The richer equations.
    start, q : (rich unknowns,)
        The given solution written in the richer space, and the corrected one.
    state : MembraneState
        Fields of `start`, where the correction took its tangent.
    prolong : sparse matrix (rich unknowns, coarse unknowns)
    iterations : int
        Newton's in the richer space, if a linear correction was not enough.
    """

    rich: Equilibrium
    start: Array
    q: Array
    state: MembraneState
    prolong: sp.csr_matrix
    iterations: int = 0


def correct(
    coarse: Equilibrium, q: Array, factors: SuperLU, rich: Equilibrium
) -> Correction | None:
    """A Newton step in the space of `rich` from the solution `q` of `coarse`, and smooth steps.

    None where the smooth steps grow: `rich` is too far from linear, or not stable, between the two.

    Parameters
    ----------
    coarse, rich : Equilibrium
        The same scene on the same mesh in a space and in one that contains it.
    q : (coarse unknowns,)
        Solution of `coarse`.
    factors : SuperLU
        Factorised tangent of `coarse` near the solution.
    """
    prolong = prolongation(coarse, rich)
    start = prolong @ q
    state = rich.state(start)
    better = start - _solve(rich, state, rich.residual(state), prolong, factors)
    last = np.inf
    for _ in range(SMOOTH_STEPS):
        residual = prolong.T @ rich.residual(rich.state(better))
        step = factors.solve(residual)
        size = abs(float(step @ residual))
        if not size <= last:
            return None
        better, last = better - prolong @ step, size
    return Correction(rich, start, better, state, prolong)


def _solve(
    rich: Equilibrium, state: MembraneState, right: Array, prolong: sp.csr_matrix, factors: SuperLU
) -> Array:
    """Preconditioned conjugate gradients."""
    diagonal = _diagonal(rich, state)

    def precondition(residual: Array) -> Array:
        return prolong @ factors.solve(prolong.T @ residual) + residual / diagonal

    smooth = rich.bending is None and rich.film.compression == "refuse"
    enough = ENERGY_PART if smooth else ENERGY_PART_ROUGH
    x, residual, energy = np.zeros_like(right), right.copy(), 0.0
    direction = precondition(residual)
    product = residual @ direction
    for _ in range(MAX_ITERATIONS):
        force = _times(rich, state, direction)
        curvature = float(direction @ force)
        if curvature <= 0.0:  # no minimum along it: what is left is up to the smooth steps
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


def _action(rich: Equilibrium, state: MembraneState, q: Array) -> Array:
    """The membrane's element forces of a step, without the follower load's, not symmetric."""
    return rich.membrane.tangent_action(state, rich.unknowns.expand(q))


def _times(rich: Equilibrium, state: MembraneState, step: Array) -> Array:
    """The tangent times a step."""
    product = rich.assembly.vector(_action(rich, state, step))
    return product if rich.bending is None else product + rich.bending.matrix @ step


def _diagonal(rich: Equilibrium, state: MembraneState) -> Array:
    diagonal = rich.assembly.vector(rich.membrane.tangent_diagonal(state))
    return diagonal if rich.bending is None else diagonal + rich.bending.matrix.diagonal()


def _local(equilibrium: Equilibrium, q: Array) -> Array:
    """Values of the unknowns at each element's dofs, (elements, dofs of an element)."""
    return equilibrium.unknowns.expand(q)[equilibrium.membrane.element_dofs]


def indicators(correction: Correction, factors: SuperLU, goals: Array) -> Array:
    """Share of each element in the error of each goal, (elements, goals).

    Dual-weighted: the error's element energy against the part of the dual solution that the
    coarse space lacks, the latter from one Jacobi step on the dual residual.

    Parameters
    ----------
    correction : Correction
    factors : SuperLU
        Factorised coarse tangent.
    goals : (rich dofs, goals)
        Derivative of the goals with respect to the dofs of ``correction.rich``.
    """
    rich, state, prolong = correction.rich, correction.state, correction.prolong
    step = correction.q - correction.start
    error = _action(rich, state, step)
    if rich.bending is not None:
        # forces across edges belong to no element: each node's is shared among its elements
        nodes = rich.membrane.basis.element_dofs.T
        forces = rich.bending.forces(rich.unknowns.expand(step))
        error[:, 2::3] += (forces / np.bincount(nodes.ravel()))[nodes]
    diagonal = _diagonal(rich, state)
    shares = []
    for goal in (rich.unknowns.expansion.T @ goals).T:
        dual = prolong @ factors.solve(prolong.T @ goal, "T")
        missing = goal - _times(rich, state, dual)
        shares.append(np.abs((error * _local(rich, missing / diagonal)).sum(axis=1)))
    return np.stack(shares, axis=-1)


def prolongation(coarse: Equilibrium, rich: Equilibrium) -> sp.csr_matrix:
    """Matrix (rich unknowns, coarse unknowns) that writes a function of `coarse` in `rich`."""
    points = ELEMENTS[rich.membrane.order].doflocs.T
    element = ELEMENTS[coarse.membrane.order]()
    functions = len(element.doflocs)
    values = np.stack([element.lbasis(points, i)[0] for i in range(functions)], axis=-1)

    rich_nodes, coarse_nodes = (e.membrane.basis.element_dofs for e in (rich, coarse))
    node, component = np.divmod(_first(rich.unknowns.of_dof, rich.unknowns.count), 3)
    place = _first(rich_nodes.T.ravel(), rich.membrane.basis.N)[node]
    element, local = np.divmod(place, len(rich_nodes))
    columns = coarse.unknowns.of_dof[3 * coarse_nodes[:, element].T + component[:, None]]
    used = (columns >= 0) & (np.abs(values) > ROUNDING)[local]
    ends = np.append(0, np.cumsum(used.sum(axis=1)))
    shape = (rich.unknowns.count, coarse.unknowns.count)
    return sp.csr_matrix((values[local][used], columns[used], ends), shape=shape)


def _first(labels: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Where each of the labels 0 ... count - 1 stands first, (count,); others are negative."""
    place = np.empty(count + 1, dtype=np.int64)
    place[labels[::-1]] = np.arange(len(labels))[::-1]
    return place[:count]
