"""A discrete solution: its fields, the electrodes' forces, and where a field is largest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem import Basis

from pvdf_fem.charges.forces import Goal, goal_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Array, MembraneState
from pvdf_fem.solution.unfold import unfolded, unfolded_dofs

# The largest deflection is sought on this many points around the best one, on ever smaller scales.
ZOOM, ROUNDS = 8, 5


@dataclass(frozen=True, eq=False)
class Fields:
    """A discrete solution: equations, unknowns, and the electrodes' forces with their errors.

    Attributes
    ----------
    solved : Equilibrium
        The equations that were solved, which may be those of a part of the film.
    q : (unknowns,)
        Their unknowns.
    forces, force_errors : (goals, 2)
    """

    solved: Equilibrium
    q: Array
    forces: Array
    force_errors: Array

    @cached_property
    def solved_dofs(self) -> Array:
        """Dofs of `solved`."""
        return self.solved.unknowns.expand(self.q)

    @cached_property
    def solved_state(self) -> MembraneState:
        """State of `solved`."""
        return self.solved.state(self.q)

    def forces_of(self, goals: Sequence[Goal]) -> Array:
        """The forces of other goals, (goals, 2)."""
        return goal_forces(goals, self.solved.membrane, self.solved_dofs, self.solved.part)

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The equations of the whole film."""
        return unfolded(self.solved)

    @cached_property
    def displacement(self) -> Array:
        """Dofs of the whole film."""
        if self.equilibrium is self.solved:
            return self.solved_dofs
        return unfolded_dofs(self.solved, self.solved_dofs, self.equilibrium)

    @cached_property
    def state(self) -> MembraneState:
        """State of the whole film."""
        if self.equilibrium is self.solved:
            return self.solved_state
        return self.equilibrium.membrane.state(self.displacement)


def largest(basis: Basis, values: Array) -> float:
    """Largest absolute value of a field with the nodal `values`, also between the nodes."""
    s = np.arange(-ZOOM, ZOOM + 1) / ZOOM
    offsets, width = np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2), 0.5
    dofs = basis.element_dofs[:, np.abs(values)[basis.element_dofs].max(axis=0).argsort()[-ZOOM:]]
    best, places = 0.0, np.full((dofs.shape[1], 2), 0.5)
    for _ in range(ROUNDS):
        points = np.clip(places[:, None] + width * offsets, 0.0, 1.0)
        points /= np.maximum(points.sum(axis=-1, keepdims=True), 1.0)
        functions = [basis.elem.lbasis(points.reshape(-1, 2).T, i)[0] for i in range(basis.Nbfun)]
        found = np.einsum(
            "fep,fe->ep", np.reshape(functions, (-1, *points.shape[:2])), values[dofs]
        )
        places = points[np.arange(len(points)), np.abs(found).argmax(axis=1)]
        best, width = max(best, float(np.abs(found).max())), width / ZOOM * 2.0
    return best
