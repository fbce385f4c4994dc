"""One solve on one mesh: equilibrium, charges, their errors, and the sizes of the next mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from skfem import MeshTri2

from pvdf_fem.bending import LOWEST_ORDER
from pvdf_fem.charge import Goal, charge_sizes, goal_forces, goal_gradients
from pvdf_fem.clock import Clock
from pvdf_fem.equilibrium import Equilibrium
from pvdf_fem.estimate import Correction, indicators, prolongation
from pvdf_fem.fields import Fields
from pvdf_fem.membrane import Array
from pvdf_fem.mesh import SizeField
from pvdf_fem.newton import NewtonResult, Status
from pvdf_fem.refine import refined_sizes, transferred
from pvdf_fem.scene import Scene
from pvdf_fem.settled import Settled
from pvdf_fem.symmetry import Part
from pvdf_fem.tension_newton import barely_loaded, corrected, equilibrate

# Newton's last step in the orders below, whose discretisation errors are larger.
START_TOLERANCE = 3e-2
# Charges that a refined mesh follows, those with the largest errors.
MOST_DUALS = 32
# The next order takes away only half of the error that the singular edge of a rigid probe makes,
# and 0.55 to 0.8 of that of the kinks of a film that wrinkles (measured on refined meshes);
# estimates are raised by this.
EDGE_FACTOR, KINK_FACTOR = 2.0, 1.6
# The same where bending acts within less than an element of an edge: 0.65 to 1.1.
LAYER_FACTOR = 1.5


@dataclass(frozen=True, eq=False)
class Attempt:
    """A solve on one mesh: Newton's result, the correction and the worst charge's error."""

    scene: Scene
    goals: Sequence[Goal]
    result: NewtonResult
    fields: Fields
    correction: Correction | None

    @property
    def worst(self) -> float:
        """Largest of the `charge_errors`."""
        return float(np.max(self.charge_errors, initial=0.0))

    @property
    def charge_errors(self) -> Array:
        """Estimated error of each charge over the sizes of its two contributions, (goals,)."""
        return np.abs((self.fields.force_errors * self._d).sum(axis=1)) / self.charge_sizes

    @cached_property
    def charge_sizes(self) -> Array:
        """`charge.charge_sizes` of the goals, (goals,)."""
        fields = self.fields
        weights = fields.solved.membrane.weights
        return charge_sizes(self.goals, fields.solved_state, fields.forces, weights)

    @property
    def _d(self) -> Array:
        return np.reshape([goal.d for goal in self.goals], (-1, 2))


def solve_on(
    scene: Scene,
    goals: Sequence[Goal],
    mesh: MeshTri2,
    part: Part,
    order: int,
    clock: Clock,
    coarser: Attempt | None = None,
) -> Attempt:
    """Solve on the mesh of a part of the film, from the solution on a coarser one if there is."""
    with clock("solve"):
        equilibrium = Equilibrium(scene, mesh, order, part)
        settled = Settled(goals, equilibrium)
        # what a change of mesh leaves of a heated film's stress leads nowhere
        if coarser is None or scene.film.thermal_strain > 0.0:
            start = _start(equilibrium)
            result = equilibrate(equilibrium, start, near=start is not None, settled=settled)
        else:
            start, lower = _carried_over(coarser, equilibrium), partial(_start, equilibrium)
            result = equilibrate(equilibrium, start, near=True, settled=settled, other=lower)
        x = equilibrium.unknowns.expand(result.q)
        forces = goal_forces(goals, equilibrium.membrane, x, part)
    correction, errors = None, np.zeros_like(forces)
    if result.status is Status.CONVERGED and result.factors is not None:
        with clock("estimate"):
            rich = Equilibrium(scene, mesh, order + 1, part)
            found = corrected(equilibrium, result.q, result.factors, rich, Settled(goals, rich))
        if isinstance(found, Status):
            result = replace(result, status=found)
        else:
            correction = found
            x = rich.unknowns.expand(correction.q)
            errors = goal_forces(goals, rich.membrane, x, part) - forces
            if equilibrium.bending is not None:
                errors *= LAYER_FACTOR
            elif scene.load.kind == "rigid":
                errors *= EDGE_FACTOR
            elif scene.film.compression == "tension-field":
                errors *= KINK_FACTOR
    return Attempt(scene, goals, result, Fields(equilibrium, result.q, forces, errors), correction)


def _start(equilibrium: Equilibrium) -> Array | None:
    """The solution of the order below, which costs less than the iterations that it saves."""
    order = equilibrium.membrane.order
    if order == (1 if equilibrium.bending is None else LOWEST_ORDER):
        return None
    if barely_loaded(equilibrium.scene):  # whose solution of another order is far away
        return None
    mesh = equilibrium.membrane.mesh
    lower = Equilibrium(equilibrium.scene, mesh, order - 1, equilibrium.part)
    start = _start(lower)
    result = equilibrate(lower, start, START_TOLERANCE, near=start is not None)
    if result.status is not Status.CONVERGED:
        return None
    return prolongation(lower, equilibrium) @ result.q


def _carried_over(coarser: Attempt, equilibrium: Equilibrium) -> Array:
    known = coarser.fields.solved.membrane.basis
    x = transferred(known, coarser.fields.solved_dofs, equilibrium.membrane.basis)
    return equilibrium.unknowns.restrict(x)


def refined(attempt: Attempt, tolerance: float) -> SizeField:
    """Element sizes at which the worst error would be `tolerance`."""
    correction, factors = attempt.correction, attempt.result.factors
    if correction is None or factors is None:
        raise ValueError("only a converged attempt can be refined")
    rich = correction.rich
    x = rich.unknowns.expand(correction.start)
    worst = np.argsort(attempt.charge_errors)[-MOST_DUALS:]
    goals = [attempt.goals[i] for i in worst]
    gradients = goal_gradients(goals, rich.membrane, x, rich.part) / attempt.charge_sizes[worst]
    shares = indicators(correction, factors, gradients)
    return refined_sizes(rich.membrane.mesh, shares.max(axis=1), tolerance / attempt.worst)
