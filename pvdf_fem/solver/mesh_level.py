"""A solve on a mesh: equilibrium, charges, their errors, and sizes for the next mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import SuperLU
from skfem import MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.outputs import Output, piezo_coefficients
from pvdf_fem.electrodes.stress_integrals import (
    StressIntegrals,
    combine_charges,
    compute_charge_scales,
    compute_stress_integrals,
    differentiate_charges,
    distribute_charge_errors,
    measure_area_defects,
    select_larger_errors,
)
from pvdf_fem.film.bending.layers import BendingLayers, estimate_missing_fraction
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.load_classes import find_rigid_elements
from pvdf_fem.film.loads.load_spec import DEFAULT_OPTIONS, SolveOptions
from pvdf_fem.film.space import transfer_dofs
from pvdf_fem.film.unknowns import make_prolongation
from pvdf_fem.mesh.size_field import SizeField, compute_refined_sizes
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.estimate import (
    Correction,
    compute_indicators,
    correct_in_richer_space,
    solve_duals,
)
from pvdf_fem.solver.history import StageTimer
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import FailedAttempt, NewtonResult
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import is_barely_loaded

#: Unknowns per element, by order of the displacement.
UNKNOWNS_PER_ELEMENT = {1: 1.5, 2: 6.0, 3: 13.5}
#: Part of the sum over element shares, without cancellation, that the error of a charge is at
#: least. Shares at the singular edge of a rigid probe cancel by chance. Measured on 100 solves of
#: rigid scenes, true errors are 0.02 to 1.5 times the sum, in the median a quarter.
UNCANCELLED = 0.3
#: A charge is accepted if this factor times its estimated error is within the tolerance. Measured
#: on 36 pressures at 1e-3 and at 1e-4, errors beyond 0.4 of the tolerance are up to 1.5 times the
#: estimate, one in ten beyond 1.4 times. What rigid scenes have by `UNCANCELLED` is large enough.
SAFETY = 1.4


@dataclass(frozen=True, eq=False)
class Problem:
    """The problem on every mesh: scene, goals, order, budget, and posed loads."""

    scene: Scene
    outputs: Sequence[Output]
    order: int
    budget: Budget
    clock: StageTimer
    options: SolveOptions = DEFAULT_OPTIONS


@dataclass(frozen=True, eq=False)
class MeshLevel:
    """A solve on one mesh."""

    problem: Problem
    equilibrium: Equilibrium
    result: NewtonResult
    discrete: DiscreteSolution
    #: The solution in a richer space, if there is a solution.
    correction: Correction | None = None
    #: Bending layers that the elements do not resolve.
    layers: BendingLayers | None = None

    @property
    def status(self) -> Status:
        """How Newton's method ended, in either space."""
        return self.result.status

    @property
    def unknowns(self) -> int:
        """Number of equations."""
        return self.equilibrium.unknowns.count

    @property
    def iterations(self) -> int:
        """Newton iterations that led to the result."""
        return len(self.result.iterations)

    @property
    def failed_attempts(self) -> tuple[FailedAttempt, ...]:
        """Solvers that failed before."""
        return self.result.failed_attempts

    @property
    def worst(self) -> float:
        """Largest of the `charge_errors`."""
        return float(np.max(self.charge_errors, initial=0.0))

    @property
    def bound(self) -> float:
        """Largest likely error: `worst` times a safety factor."""
        rigid = len(find_rigid_elements(self.equilibrium.terms)) > 0
        return self.worst * (1.0 if rigid else SAFETY)

    @property
    def charge_errors(self) -> Array:
        """Estimated charge errors, relative to `compute_charge_scales`, (goals,)."""
        errors = self.discrete.stress_integrals.charge_errors(
            piezo_coefficients(self.problem.outputs)
        )
        return errors / self.charge_sizes

    @cached_property
    def charge_sizes(self) -> Array:
        """`compute_charge_scales` of the goals, (goals,)."""
        fields, space = self.discrete, self.equilibrium.space
        return compute_charge_scales(
            self.problem.outputs, fields.solved_state, fields.stress_integrals.values, space
        )


def solve_on_mesh(
    problem: Problem, part: SymmetrySector, mesh: MeshTri2, coarser: MeshLevel | None = None
) -> MeshLevel:
    """Solve on the mesh of a part of the film, from the solution on a coarser mesh if present."""
    with problem.clock("solve"):
        equilibrium = Equilibrium(problem.scene, mesh, problem.order, part, problem.options)
        result = _equilibrated(problem, equilibrium, coarser)
        problem.budget.spend(equilibrium, result.fresh_count)
        forces = _forces(problem, equilibrium, result.q)
    attempt = MeshLevel(
        problem,
        equilibrium,
        result,
        DiscreteSolution(equilibrium, result.q, StressIntegrals(forces, np.zeros_like(forces))),
    )
    if not result.converged or result.factors is None:
        return attempt
    with problem.clock("estimate"):
        return _with_errors(attempt)


def _forces(problem: Problem, equilibrium: Equilibrium, q: Array) -> Array:
    x = equilibrium.dofs(q)
    return compute_stress_integrals(problem.outputs, equilibrium.membrane, x, equilibrium.part)


def _with_errors(attempt: MeshLevel, iterations: int = 4) -> MeshLevel:
    """The attempt with estimated errors, or with the status of a failed solve in the richer space.
    Cost of an estimate without a solve in the richer space, in Newton `iterations`."""
    problem, equilibrium, result = attempt.problem, attempt.equilibrium, attempt.result
    assert result.factors is not None
    rich = equilibrium.with_(order=equilibrium.space.order + 1)
    correction = correct_in_richer_space(
        equilibrium, result.q, result.factors, rich, problem.budget
    )
    if isinstance(correction, NewtonResult):
        problem.budget.spend(rich, correction.fresh_count)
        tried = (*result.failed_attempts, *correction.as_failed_attempts("order above"))
        return replace(
            attempt, result=replace(result, status=correction.status, failed_attempts=tried)
        )
    if correction.result is None:
        problem.budget.spend(equilibrium, iterations)
    else:
        problem.budget.spend(rich, correction.result.fresh_count)

    forces, model = attempt.discrete.stress_integrals.values, equilibrium.model
    errors = model.saturation * (_forces(problem, rich, correction.q) - forces)
    state = attempt.discrete.solved_state
    layers = model.layers(equilibrium.terms, equilibrium.unknowns.expansion, state)
    if layers is not None:
        changed = result.q + layers.change(result.factors)
        # the next order sees a part of the layers only: both errors may have one sign
        by_layers = np.abs(_forces(problem, equilibrium, changed) - forces)
        errors += np.where(errors < 0.0, -by_layers, by_layers)
    if len(find_rigid_elements(equilibrium.terms)):
        _, shares = compute_error_indicators(correction, result.factors, problem.outputs)
        least = distribute_charge_errors(UNCANCELLED * shares.sum(axis=0), forces, problem.outputs)
        errors = select_larger_errors(errors, least, problem.outputs)
    # both orders share the elements, and the elements' missing area in a round electrode
    lacking = measure_area_defects(problem.outputs, equilibrium.space, equilibrium.part)
    defects = lacking[:, None] * forces
    charges, lost = (combine_charges(problem.outputs, some) for some in (errors, defects))
    errors += np.where(charges * lost < 0.0, -1.0, 1.0)[:, None] * defects
    fields = replace(attempt.discrete, stress_integrals=StressIntegrals(forces, errors))
    return replace(attempt, discrete=fields, correction=correction, layers=layers)


def compute_error_indicators(
    correction: Correction, factors: SuperLU, outputs: Sequence[Output], sizes: Array | float = 1.0
) -> tuple[Array, Array]:
    """Duals (unknowns, goals) and elements' shares (elements, goals) in the errors over `sizes`."""
    rich = correction.rich
    x = rich.dofs(correction.start)
    gradients = differentiate_charges(outputs, rich.membrane, x, rich.part) / sizes
    dual = solve_duals(correction, factors, gradients)
    return dual, compute_indicators(correction, dual, gradients)


def _equilibrated(
    problem: Problem, equilibrium: Equilibrium, coarser: MeshLevel | None
) -> NewtonResult:
    """The equilibrium, from the coarser mesh's solution or from solutions with lower orders."""
    budget = problem.budget
    # stress from the coarser mesh leads nowhere in compressed film, and in film that
    # wrinkles takes longer than a start on the same mesh
    slack = equilibrium.film.prestress[:2].min() < 0.0 or equilibrium.model.wrinkles
    if coarser is not None and not slack:
        x = transfer_dofs(
            coarser.equilibrium.space, coarser.discrete.solved_dofs, equilibrium.space
        )
        return find_equilibrium(equilibrium, equilibrium.restrict(x), budget=budget)
    start = _from_below(equilibrium, budget)
    if isinstance(start, Status):
        return NewtonResult(np.zeros(equilibrium.unknowns.count), start, (), None)
    return find_equilibrium(equilibrium, start, budget=budget)


def _from_below(
    equilibrium: Equilibrium, budget: Budget, tolerance: float = 3e-2
) -> Array | Status | None:
    """The solution at the order below: a start cheaper than the saved iterations.
    Newton's last step there has the relative size `tolerance`, less than the error by the mesh.

    None where a start would not help or was not found. A status where the order below is unstable
    in a bending film: this order's displacements contain them and are unstable, too.
    """
    order = equilibrium.space.order
    if order == equilibrium.model.lowest_order:
        return None
    if equilibrium.model.wrinkles and is_barely_loaded(equilibrium.scene):
        return None  # the solution of another order is far away
    lower = equilibrium.with_(order=order - 1).map_terms(lambda term: term.relaxed())
    start = _from_below(lower, budget)
    if isinstance(start, Status):
        return start
    result = find_equilibrium(lower, start, tolerance, budget=budget)
    budget.spend(lower, result.fresh_count)
    if result.status is Status.UNSTABLE and lower.model.bends:
        return result.status
    if not result.converged:
        return None
    return equilibrium.complete_initial_guess(
        equilibrium.dofs(make_prolongation(lower, equilibrium) @ result.q)
    )


def choose_next_sizes(
    attempt: MeshLevel, tolerance: float, most_unknowns: float, most_duals: int = 32
) -> SizeField:
    """Element sizes at which the worst error would be `tolerance`, or coarser sizes. They follow
    the `most_duals` charges with the largest errors."""
    correction, factors = attempt.correction, attempt.result.factors
    if correction is None or factors is None:
        raise ValueError("only a converged attempt can be refined")
    mesh, flat = attempt.equilibrium.space.mesh, find_rigid_elements(attempt.equilibrium.terms)
    worst = np.argsort(attempt.charge_errors)[-most_duals:]
    outputs = [attempt.problem.outputs[i] for i in worst]
    dual, by_goal = compute_error_indicators(
        correction, factors, outputs, attempt.charge_sizes[worst]
    )
    shares = by_goal.max(axis=1)
    reduction = tolerance / attempt.worst
    most: Array | float = np.inf
    if layers := attempt.layers:
        effects = layers.effects(dual).max(axis=1)
        total = float((effects * estimate_missing_fraction(layers.widths)).sum())
        most = layers.sizes(effects, max(reduction * total, tolerance))
    sizes = compute_refined_sizes(mesh, shares, reduction, most, flat)
    return sizes.coarsen(most_unknowns / UNKNOWNS_PER_ELEMENT[attempt.problem.order])
