"""Discretisation error: the solution corrected in a richer space.

The displacement of order p is corrected by Newton steps in the space of order p + 1 on the same
mesh (hierarchical error estimate: Bank and Smith, SIAM J. Numer. Anal. 30, 1993, 921-935; for
quantities of interest, Becker and Rannacher, Acta Numerica 10, 2001, section 3). The observable
of the corrected solution less that of the solution is the estimate, for all charges at once.

One step is not enough: a film resists stretching so much more than turning that the square of the
error's slope, which a linear correction leaves out, shifts the tension as much as the error itself
does. A second or third step brings the estimate to within a few percent of the true error.

A step needs no factorisation of its own: conjugate gradients with a two-level preconditioner (the
factorised tangent of order p, plus the diagonal) take 15 to 30 iterations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU, cg

from pvdf_fem.equilibrium import Equilibrium, Unknowns
from pvdf_fem.membrane import ELEMENTS, Array

# Steps end when one lowers the energy by less than this part of what the first did.
ENERGY_RATIO = 1e-2
NEWTON_STEPS = 5
# The estimate wants a digit or two.
RELATIVE_RESIDUAL = 5e-2
MAX_ITERATIONS = 40


@dataclass(frozen=True)
class Correction:
    """A solution corrected in a richer space, and what the error is made of.

    Attributes
    ----------
    rich : Equilibrium
        The richer equations.
    start, q : (rich unknowns,)
        The given solution written in the richer space, and the corrected one.
    tangent : (elements, dofs, dofs)
        Element tangents of `rich` near `q`.
    prolong : sparse matrix (rich unknowns, coarse unknowns)
    """

    rich: Equilibrium
    start: Array
    q: Array
    tangent: Array
    prolong: sp.csr_matrix


def correct(coarse: Equilibrium, q: Array, factors: SuperLU, rich: Equilibrium) -> Correction:
    """Newton steps in the space of `rich` from the solution `q` of `coarse`.

    Parameters
    ----------
    coarse, rich : Equilibrium
        The same scene on the same mesh in a space and in one that contains it.
    q : (coarse unknowns,)
        Solution of `coarse`.
    factors : SuperLU
        Factorised tangent of `coarse` at the solution.
    """
    prolong = prolongation(coarse, rich)
    start = prolong @ q
    better, first = start, 0.0
    for _ in range(NEWTON_STEPS):
        state = rich.state(better)
        # Without the follower load's stiffness, which is small and not symmetric.
        tangent = rich.membrane.tangent(state)
        residual = rich.residual(state)
        step = _solve(rich, tangent, residual, prolong, factors)
        better = better - step
        drop = abs(float(residual @ step))
        first = first or drop
        if drop <= ENERGY_RATIO * first:
            break
    return Correction(rich, start, better, tangent, prolong)


def _solve(
    rich: Equilibrium, tangent: Array, right: Array, prolong: sp.csr_matrix, factors: SuperLU
) -> Array:
    diagonal = rich.assembly.vector(np.einsum("eii->ei", tangent))

    def apply(step: Array) -> Array:
        return rich.assembly.vector(np.matmul(tangent, local(rich, step)[..., None]))

    def precondition(residual: Array) -> Array:
        return prolong @ factors.solve(prolong.T @ residual) + residual / diagonal

    shape = (len(right), len(right))
    step, _ = cg(
        LinearOperator(shape, matvec=apply, dtype=float),
        right,
        M=LinearOperator(shape, matvec=precondition, dtype=float),
        rtol=RELATIVE_RESIDUAL,
        maxiter=MAX_ITERATIONS,
    )
    return step


def local(equilibrium: Equilibrium, q: Array) -> Array:
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
    rich, tangent, prolong = correction.rich, correction.tangent, correction.prolong
    error = np.matmul(tangent, local(rich, correction.q - correction.start)[..., None])[..., 0]
    diagonal = rich.assembly.vector(np.einsum("eii->ei", tangent))
    shares = []
    for goal in (expansion(rich.unknowns).T @ goals).T:
        dual = prolong @ factors.solve(prolong.T @ goal, "T")
        missing = goal - rich.assembly.vector(np.matmul(tangent, local(rich, dual)[..., None]))
        shares.append(np.abs((error * local(rich, missing / diagonal)).sum(axis=1)))
    return np.stack(shares, axis=-1)


def prolongation(coarse: Equilibrium, rich: Equilibrium) -> sp.csr_matrix:
    """Matrix (rich unknowns, coarse unknowns) that writes a function of `coarse` in `rich`."""
    points = ELEMENTS[rich.membrane.order].doflocs.T
    element = ELEMENTS[coarse.membrane.order]()
    functions = len(element.doflocs)
    values = np.stack([element.lbasis(points, i)[0] for i in range(functions)], axis=-1)

    rich_nodes, coarse_nodes = (e.membrane.basis.element_dofs for e in (rich, coarse))
    nodes, first = np.unique(rich_nodes.T, return_index=True)
    elements, local = np.divmod(first, len(rich_nodes))
    columns = coarse_nodes[:, elements].T
    rows = np.broadcast_to(nodes[:, None], columns.shape)
    scalar = sp.csr_matrix((values[local].ravel(), (rows.ravel(), columns.ravel())))
    dofs = sp.kron(scalar, sp.eye(3), format="csr")
    return (_pick(rich.unknowns) @ dofs @ expansion(coarse.unknowns)).tocsr()


def expansion(unknowns: Unknowns) -> sp.csr_matrix:
    """Matrix form of `Unknowns.expand`; its transpose sums forces on dofs."""
    dofs = np.flatnonzero(unknowns.of_dof >= 0)
    shape = (len(unknowns.of_dof), unknowns.count)
    return sp.csr_matrix((np.ones(len(dofs)), (dofs, unknowns.of_dof[dofs])), shape=shape)


def _pick(unknowns: Unknowns) -> sp.csr_matrix:
    """Matrix that picks one dof of each unknown."""
    values, dofs = np.unique(unknowns.of_dof, return_index=True)
    kept = values >= 0
    shape = (unknowns.count, len(unknowns.of_dof))
    return sp.csr_matrix((np.ones(kept.sum()), (values[kept], dofs[kept])), shape=shape)
