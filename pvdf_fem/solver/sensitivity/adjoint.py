"""Adjoint solutions of the charges.

The displacement x solves the equilibrium equations R(x, θ) = 0 with a parameter θ. A charge Q(x, θ)
has the total derivative::

    dQ/dθ = ∂Q/∂θ - λ · ∂R/∂θ,    K^T λ = ∂Q/∂x

with the tangent K = ∂R/∂x. One adjoint solution λ per charge is enough for all parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.stress_integrals import (
    combine_charges,
    compute_stress_integrals,
    differentiate_charges,
)
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import Output
from pvdf_fem.solver.estimate.next_order import (
    FactorisedSolution,
    factorise_tangent,
    solve_next_order,
)
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.solution import Solution


@dataclass(frozen=True, eq=False)
class Adjoint:
    """A solution on the whole film, and the adjoint solutions λ of its charges."""

    equilibrium: Equilibrium  #: Equations on the whole film.
    outputs: Sequence[Output]  #: Outputs whose charges are differentiated.
    q: Array  #: Unknowns of the solution, shape (unknowns,).
    state: State  #: Deformation gradient, strain and stress at `q`.
    stress_integrals: Array  #: X = ∫ S11 dA and Y = ∫ S22 dA in N, shape (outputs, 2).
    unknowns: Array  #: λ at the unknowns, shape (unknowns, outputs).

    @classmethod
    def solve(
        cls,
        equilibrium: Equilibrium,
        outputs: Sequence[Output],
        q: Array,
        factors: SuperLU,
    ) -> Adjoint:
        """Solve the adjoint equations at a solution, with one right-hand side per output.

        Parameters
        ----------
        equilibrium : Equilibrium
            Equations on the whole film.
        outputs : sequence of Output
            Outputs whose charges are differentiated.
        q : ndarray, shape (unknowns,)
            Solution of `equilibrium`.
        factors : SuperLU
            Factors of the tangent at `q`.
        """
        membrane = equilibrium.membrane
        state = equilibrium.state(q)
        derivatives = differentiate_charges(outputs, membrane, state.dofs)
        unknowns = factors.solve(equilibrium.unknowns.fold(derivatives), "T")
        integrals = compute_stress_integrals(outputs, membrane, state.dofs)
        return cls(
            equilibrium,
            outputs,
            q=q,
            state=state,
            stress_integrals=integrals,
            unknowns=unknowns,
        )

    @classmethod
    def of_solution(cls, solution: FactorisedSolution, outputs: Sequence[Output]) -> Adjoint:
        """Solve the adjoint equations at a solution whose tangent is already factorised."""
        equilibrium, q, factors = solution
        return cls.solve(equilibrium, outputs, q=q, factors=factors)

    @cached_property
    def dofs(self) -> Array:
        """λ at the dofs, shape (dofs, outputs)."""
        columns = [self.equilibrium.dofs(column) for column in self.unknowns.T]
        return np.stack(columns, axis=-1)

    def evaluate_lagrangian(self, other: Equilibrium) -> Array:
        """Evaluate Q - λ · R of a changed problem at the unknowns and λ of this solution.

        The derivative of Q - λ · R with respect to a parameter is dQ/dθ of the charges.

        Parameters
        ----------
        other : Equilibrium
            Equations with a changed parameter, on the same mesh.

        Returns
        -------
        ndarray, shape (outputs,)
            Values in C.
        """
        integrals = compute_stress_integrals(self.outputs, other.membrane, other.dofs(self.q))
        charges = combine_charges(self.outputs, integrals)
        return charges - other.residual(other.state(self.q)) @ self.unknowns


def solve_adjoints(solution: Solution) -> tuple[Adjoint, Adjoint]:
    """Solve the adjoint equations of a solution and of its correction in the next order.

    Both are on the whole film and on the mesh of the solution.

    Raises
    ------
    NotConvergedError
        If the solution has not converged, or if there is no solution of the next order.
    """
    outputs = solution.problem.outputs
    factorised = factorise_tangent(solution.discrete)
    correction = solve_next_order(factorised)
    rich = correction.rich
    rich_factors = factorise(rich.tangent(rich.state(correction.q)))
    coarse_adjoint = Adjoint.of_solution(factorised, outputs)
    rich_adjoint = Adjoint.solve(rich, outputs, q=correction.q, factors=rich_factors)
    return coarse_adjoint, rich_adjoint
