"""One solve on one mesh: equilibrium, charges, their errors, and the sizes of the next mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.spatial import cKDTree
from skfem import MeshTri2

from pvdf_fem.charges.forces import (
    Goal,
    area_defects,
    charge_sizes,
    charges_of,
    goal_forces,
    goal_gradients,
)
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.layers import Layers, left
from pvdf_fem.film.membrane import Array
from pvdf_fem.film.plate import LOWEST_ORDER
from pvdf_fem.mesh.gmsh_mesh import SizeField, element_sizes
from pvdf_fem.mesh.symmetry import Part
from pvdf_fem.scene.outline import Polygon
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.clock import Clock
from pvdf_fem.solution.estimate import Correction, indicators, prolongation
from pvdf_fem.solution.fields import Fields
from pvdf_fem.solution.refine import refined_sizes, transferred
from pvdf_fem.solvers.newton import NewtonResult, Status
from pvdf_fem.solvers.settled import Settled
from pvdf_fem.solvers.wrinkling import barely_loaded, corrected, equilibrate

# Newton's last step in the orders below, whose discretisation errors are larger.
START_TOLERANCE = 3e-2
# Charges that a refined mesh follows, those with the largest errors.
MOST_DUALS = 32
# The next order takes away only half of the error that the singular edge of a rigid probe makes,
# and 0.55 to 0.8 of that of the kinks of a film that wrinkles (measured on refined meshes);
# estimates are raised by this.
EDGE_FACTOR, KINK_FACTOR = 2.0, 1.6
# The same of a film that bends: 0.85 to 1.1, unless its layers leave more (`layers`).
BENT_FACTOR = 1.2
# The part of an error that elements at a punch's corners may make together, and by how much they
# become smaller at the most.
CORNERS, SHARPEST = 0.5, 0.01


@dataclass(frozen=True, eq=False)
class Attempt:
    """A solve on one mesh: Newton's result, its correction, layers of bending, what starts cost."""

    scene: Scene
    goals: Sequence[Goal]
    result: NewtonResult
    fields: Fields
    correction: Correction | None
    layers: Layers | None
    lower_work: float

    @property
    def worst(self) -> float:
        """Largest of the `charge_errors`."""
        return float(np.max(self.charge_errors, initial=0.0))

    @property
    def charge_errors(self) -> Array:
        """Estimated error of each charge over the sizes of its two contributions, (goals,)."""
        return np.abs(charges_of(self.goals, self.fields.force_errors)) / self.charge_sizes

    @cached_property
    def charge_sizes(self) -> Array:
        """`charge.charge_sizes` of the goals, (goals,)."""
        fields = self.fields
        weights = fields.solved.membrane.weights
        return charge_sizes(self.goals, fields.solved_state, fields.forces, weights)


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
        lower = _LowerOrders()
        result = _equilibrated(equilibrium, Settled(goals, equilibrium), lower, coarser)
        x = equilibrium.unknowns.expand(result.q)
        forces = goal_forces(goals, equilibrium.membrane, x, part)
    correction, layers, errors = None, None, np.zeros_like(forces)
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
            if layers := Layers.of(equilibrium, result.q):
                x = equilibrium.unknowns.expand(result.q + layers.change(result.factors))
                more = goal_forces(goals, equilibrium.membrane, x, part) - forces
                errors = _larger(BENT_FACTOR * errors, more, goals)
            elif scene.load.kind == "rigid":
                errors *= EDGE_FACTOR
            elif scene.film.compression == "tension-field":
                errors *= KINK_FACTOR
            # both orders share the elements, and what these lack of a round electrode
            defects = area_defects(goals, equilibrium.membrane, part)[:, None] * np.abs(forces)
            errors += np.where(errors < 0.0, -defects, defects)
    fields = Fields(equilibrium, result.q, forces, errors)
    return Attempt(scene, goals, result, fields, correction, layers, lower.work)


def _equilibrated(
    equilibrium: Equilibrium, settled: Settled, lower: _LowerOrders, coarser: Attempt | None
) -> NewtonResult:
    # what a change of mesh leaves of a heated film's stress leads nowhere
    if coarser is not None and not equilibrium.film.thermal_strain > 0.0:
        start, other = _carried_over(coarser, equilibrium), partial(lower.start, equilibrium)
        return equilibrate(equilibrium, start, near=True, settled=settled, other=other)
    from_below = lower.start(equilibrium)
    if lower.refusal:
        return replace(lower.refusal, q=np.zeros(equilibrium.unknowns.count))
    near = from_below is not None
    return equilibrate(equilibrium, from_below, near=near, settled=settled)


def _larger(errors: Array, others: Array, goals: Sequence[Goal]) -> Array:
    """Of two estimates of the force errors (goals, 2), for each charge that which is larger."""
    own, other = (np.abs(charges_of(goals, each)) for each in (errors, others))
    return np.where((own >= other)[:, None], errors, others)


class _LowerOrders:
    """Starts that cost less than the iterations that they save, and how much work they were.

    Attributes
    ----------
    work : float
        Sum of the work of their iterations.
    refusal : NewtonResult or None
        Of a film that bends, that which is no minimum of the energy, or met a limit point. So would
        the order above, whose displacements contain these.
    """

    def __init__(self) -> None:
        self.work = 0.0
        self.refusal: NewtonResult | None = None

    def start(self, equilibrium: Equilibrium) -> Array | None:
        """The solution of the order below, or None where that would not help."""
        order = equilibrium.membrane.order
        if order == (1 if equilibrium.bending is None else LOWEST_ORDER):
            return None
        if barely_loaded(equilibrium.scene):  # whose solution of another order is far away
            return None
        mesh = equilibrium.membrane.mesh
        lower = Equilibrium(equilibrium.scene, mesh, order - 1, equilibrium.part)
        start = self.start(lower)
        result = equilibrate(lower, start, START_TOLERANCE, near=start is not None)
        self.work += result.iteration_count * lower.iteration_work
        if result.status in (Status.UNSTABLE, Status.LIMIT) and lower.bending is not None:
            self.refusal = result
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
    shares = indicators(correction, factors, gradients).max(axis=1)
    load, reduction = attempt.fields.solved.load, tolerance / attempt.worst
    most: Array | float = np.inf
    if layers := attempt.layers:
        right = correction.prolong.T @ (rich.unknowns.expansion.T @ gradients)
        effects = layers.effects(factors.solve(right, "T")).max(axis=1)
        total = float((effects * left(layers.widths)).sum())
        most = layers.sizes(effects, max(reduction * total, tolerance))
        if load.kind == "rigid":
            most = np.minimum(
                most, _at_corners(attempt.scene, rich.membrane.mesh, shares, reduction)
            )
    stiff = load.patch if load.kind == "rigid" else None
    return refined_sizes(rich.membrane.mesh, shares, reduction, most, stiff)


def _at_corners(scene: Scene, mesh: MeshTri2, shares: Array, reduction: float) -> Array:
    """Sizes of the elements at a punch's corners, m, and infinite ones of all others.

    A plate clamped along the edges of a corner has moments that grow to it as the root of the
    distance falls, so that an element's share is but proportional to its size.
    """
    sizes = np.full(mesh.nelements, np.inf)
    outline = scene.probe.outline if scene.probe else None
    if isinstance(outline, Polygon):
        near = cKDTree(mesh.p.T).query(outline.vertices)[1]
        corners = np.isin(mesh.t, near).any(axis=0)
        wanted = max(CORNERS * reduction * shares.sum() / corners.sum(), np.finfo(float).tiny)
        factor = wanted / np.maximum(shares[corners], wanted)
        sizes[corners] = element_sizes(mesh)[corners] * np.maximum(factor, SHARPEST)
    return sizes
