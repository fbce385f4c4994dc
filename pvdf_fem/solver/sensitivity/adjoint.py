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
from pvdf_fem.electrodes.outputs import Output, make_outputs
from pvdf_fem.electrodes.stress_integrals import (
    combine_charges,
    compute_stress_integrals,
    differentiate_charges,
)
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.term import State
from pvdf_fem.solver.next_order import factorise_tangent, solve_next_order
from pvdf_fem.solver.nonlinear.newton import factorise
from pvdf_fem.solver.solution import Solution


@dataclass(frozen=True, eq=False)
class Adjoint:
    """A displacement with the adjoint solutions of its charges."""

    equilibrium: Equilibrium
    outputs: Sequence[Output]
    #: q, state: Unknowns of the displacement, and its fields.
    q: Array
    state: State
    #: X and Y in N, (electrodes, 2).
    forces: Array
    #: λ of the charges, (unknowns, electrodes).
    unknowns: Array

    @classmethod
    def of(
        cls, equilibrium: Equilibrium, outputs: Sequence[Output], q: Array, factors: SuperLU
    ) -> Adjoint:
        """One solve per electrode with the tangent's `factors` at the unknowns `q`."""
        membrane, state = equilibrium.membrane, equilibrium.state(q)
        rates = differentiate_charges(outputs, membrane, state.dofs)
        unknowns = factors.solve(equilibrium.unknowns.fold(rates), "T")
        forces = compute_stress_integrals(outputs, membrane, state.dofs)
        return cls(equilibrium, outputs, q, state, forces, unknowns)

    @cached_property
    def dofs(self) -> Array:
        """λ at the dofs, (dofs, electrodes)."""
        columns = (self.equilibrium.dofs(column) for column in self.unknowns.T)
        return np.stack(list(columns), axis=-1)

    def in_other(self, other: Equilibrium) -> Array:
        """Q - λ · R of other equations on the mesh, (electrodes,), at the unknowns."""
        x = other.dofs(self.q)
        explicit = combine_charges(
            self.outputs, compute_stress_integrals(self.outputs, other.membrane, x)
        )
        return explicit - other.residual(other.state(self.q)) @ self.unknowns


def solve_adjoints(solution: Solution) -> tuple[Adjoint, Adjoint]:
    """Adjoint solutions for a solution, and for the order above on the same mesh."""
    solved, q, factors = factorise_tangent(solution.discrete)
    outputs = make_outputs(solution.scene)
    correction = solve_next_order(solved, q, factors)
    rich, rich_q = correction.rich, correction.q
    rich_factors = factorise(rich.tangent(rich.state(rich_q)))
    coarse = Adjoint.of(solved, outputs, q, factors)
    return coarse, Adjoint.of(rich, outputs, rich_q, rich_factors)
