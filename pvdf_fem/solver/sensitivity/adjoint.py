"""Adjoint solutions of the charges.

A charge Q(x, θ) of the displacement x that solves R(x, θ) = 0 has the derivative::

    dQ/dθ = ∂Q/∂θ - λ · ∂R/∂θ,    K^T λ = ∂Q/∂x

with the tangent K, so that one adjoint solve λ per electrode serves all parameters.
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
    """A displacement of the whole film with the adjoint solutions of its charges."""

    equilibrium: Equilibrium
    outputs: Sequence[Output]
    q: Array  #: Unknowns of the displacement, (unknowns,).
    state: State  #: Fields of the displacement.
    stress_integrals: Array  #: X and Y in N, (outputs, 2).
    unknowns: Array  #: λ of the charges, (unknowns, outputs).

    @classmethod
    def solve(
        cls,
        equilibrium: Equilibrium,
        outputs: Sequence[Output],
        q: Array,
        factors: SuperLU,
    ) -> Adjoint:
        """Solve the adjoint equations, once per output.

        Parameters
        ----------
        equilibrium : Equilibrium
            Equations on the whole film.
        outputs : sequence of Output
            The charges.
        q : ndarray, shape (unknowns,)
            The solution of the equations.
        factors : SuperLU
            Factors of the tangent there.
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
        """Solve the adjoint equations of a factorised solution."""
        equilibrium, q, factors = solution
        return cls.solve(equilibrium, outputs, q=q, factors=factors)

    @cached_property
    def dofs(self) -> Array:
        """λ at the dofs, (dofs, outputs)."""
        columns = [self.equilibrium.dofs(column) for column in self.unknowns.T]
        return np.stack(columns, axis=-1)

    def evaluate_lagrangian(self, other: Equilibrium) -> Array:
        """Evaluate Q - λ · R by other equations on the mesh, at the same unknowns.

        Its difference by a parameter is the derivative of the charge.

        Parameters
        ----------
        other : Equilibrium
            Equations of a problem with a changed parameter.

        Returns
        -------
        ndarray, shape (outputs,)
            In C.
        """
        integrals = compute_stress_integrals(self.outputs, other.membrane, other.dofs(self.q))
        charges = combine_charges(self.outputs, integrals)
        return charges - other.residual(other.state(self.q)) @ self.unknowns


def solve_adjoints(solution: Solution) -> tuple[Adjoint, Adjoint]:
    """Solve the adjoint equations of a solution, and those of the order above on the same mesh."""
    outputs = solution.problem.outputs
    factorised = factorise_tangent(solution.discrete)
    correction = solve_next_order(factorised)
    rich = correction.rich
    rich_factors = factorise(rich.tangent(rich.state(correction.q)))
    coarse_adjoint = Adjoint.of_solution(factorised, outputs)
    rich_adjoint = Adjoint.solve(rich, outputs, q=correction.q, factors=rich_factors)
    return coarse_adjoint, rich_adjoint
