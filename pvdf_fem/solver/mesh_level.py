"""A solve on one mesh: equilibrium, charges, their errors, and sizes for the next mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import SuperLU
from skfem import MeshTri2

from pvdf_fem.arrays import Array
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
from pvdf_fem.film.loads.load_classes import find_rigid_elements
from pvdf_fem.film.space import transfer_dofs
from pvdf_fem.film.unknowns import make_prolongation
from pvdf_fem.mesh.size_field import SizeField, compute_refined_sizes
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import Output, piezo_coefficients
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.estimate.correction import (
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
#: estimate, one in ten beyond 1.4 times. Rigid scenes are covered by `UNCANCELLED`.
SAFETY = 1.4
#: Cost of an estimate without a solve in the richer space, in Newton iterations.
ESTIMATE_ITERATIONS = 4
#: Relative size of Newton's last step at lower orders, less than the error by the mesh there.
LOWER_ORDER_TOLERANCE = 3e-2
#: Largest number of charges that the sizes of the next mesh follow.
MAX_DUALS = 32


@dataclass(frozen=True, eq=False)
class SolveRun:
    """Problem, order, budget and timer, which the solves on all meshes share."""

    problem: Problem
    order: int  #: Polynomial order of the displacement.
    budget: Budget
    timer: StageTimer


@dataclass(frozen=True, eq=False)
class MeshLevel:
    """The solve on one mesh."""

    run: SolveRun
    equilibrium: Equilibrium
    result: NewtonResult
    discrete: DiscreteSolution
    #: The solution in a richer space, if there is a solution.
    correction: Correction | None = None
    #: Bending layers that the elements do not resolve.
    layers: BendingLayers | None = None
    #: Contributions to the errors of `discrete`: errors of X and Y in N by name, (outputs, 2).
    error_contributions: Mapping[str, Array] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """The problem that is solved."""
        return self.run.problem

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
        is_rigid = len(find_rigid_elements(self.equilibrium.terms)) > 0
        return self.worst * (1.0 if is_rigid else SAFETY)

    @property
    def charge_errors(self) -> Array:
        """Estimated charge errors, relative to `charge_scales`, (outputs,)."""
        coefficients = piezo_coefficients(self.problem.outputs)
        return self.discrete.stress_integrals.charge_errors(coefficients) / self.charge_scales

    @cached_property
    def charge_scales(self) -> Array:
        """Charges in C that relative errors refer to, (outputs,)."""
        discrete = self.discrete
        return compute_charge_scales(
            self.problem.outputs,
            discrete.solved_state,
            integrals=discrete.stress_integrals.values,
            space=self.equilibrium.space,
        )


def solve_on_mesh(
    run: SolveRun,
    mesh: MeshTri2,
    *,
    sector: SymmetrySector = WHOLE_FILM,
    coarser: MeshLevel | None = None,
) -> MeshLevel:
    """Solve on a mesh, and estimate the errors of the charges.

    Parameters
    ----------
    run : SolveRun
        Problem, order, budget and timer.
    mesh : MeshTri2
        Mesh of the sector in m.
    sector : SymmetrySector, optional
        The sector that is meshed.
    coarser : MeshLevel, optional
        The solve on a coarser mesh, which gives the initial guess.

    Returns
    -------
    MeshLevel
        Its status says whether there is a result.
    """
    problem = run.problem
    with run.timer("solve"):
        equilibrium = Equilibrium(problem, mesh, run.order, sector=sector)
        result = _find_equilibrium_on_mesh(run, equilibrium, coarser)
        run.budget.spend(equilibrium, result.tangent_count)
        values = _integrate(problem.outputs, equilibrium, result.q)
    integrals = StressIntegrals(values, np.zeros_like(values))
    discrete = DiscreteSolution(equilibrium, result.q, integrals)
    level = MeshLevel(run, equilibrium, result=result, discrete=discrete)
    if not result.converged or result.factors is None:
        return level
    with run.timer("estimate"):
        return _estimate_errors(level)


def _integrate(outputs: Sequence[Output], equilibrium: Equilibrium, q: Array) -> Array:
    """Compute the stress integrals of outputs at unknowns `q` in N, (outputs, 2)."""
    x = equilibrium.dofs(q)
    return compute_stress_integrals(outputs, equilibrium.membrane, x, sector=equilibrium.sector)


def _estimate_errors(level: MeshLevel) -> MeshLevel:
    """Estimate the errors of a converged level by a solve in the order above.

    Returns the level with its errors, or with the status of a failed solve in the richer space.
    """
    budget = level.run.budget
    equilibrium = level.equilibrium
    result = level.result
    assert result.factors is not None
    rich = equilibrium.at_order(equilibrium.space.order + 1)
    correction = correct_in_richer_space(
        equilibrium, result.q, factors=result.factors, rich=rich, budget=budget
    )
    if isinstance(correction, NewtonResult):
        budget.spend(rich, correction.tangent_count)
        failed = (*result.failed_attempts, *correction.as_failed_attempts("order above"))
        failure = replace(result, status=correction.status, failed_attempts=failed)
        return replace(level, result=failure)
    if correction.result is None:
        budget.spend(equilibrium, ESTIMATE_ITERATIONS)
    else:
        budget.spend(rich, correction.result.tangent_count)

    layers = equilibrium.model.make_bending_layers(
        equilibrium.terms, equilibrium.unknowns.expansion, level.discrete.solved_state
    )
    level = replace(level, correction=correction, layers=layers)
    contributions = _compute_error_contributions(level, correction, result.factors)
    errors = combine_error_contributions(contributions, level.problem.outputs)
    integrals = StressIntegrals(level.discrete.stress_integrals.values, errors)
    discrete = replace(level.discrete, stress_integrals=integrals)
    return replace(level, discrete=discrete, error_contributions=contributions)


def _compute_error_contributions(
    level: MeshLevel, correction: Correction, factors: SuperLU
) -> dict[str, Array]:
    """Compute the errors of the stress integrals by their sources, in N, (outputs, 2) each."""
    outputs = level.problem.outputs
    equilibrium = level.equilibrium
    values = level.discrete.stress_integrals.values

    corrected = _integrate(outputs, correction.rich, correction.q)
    contributions = {
        "order_enrichment": equilibrium.model.mesh_policy.saturation * (corrected - values)
    }
    if level.layers is not None:
        changed = level.result.q + level.layers.compute_change_of_unknowns(factors)
        unresolved = _integrate(outputs, equilibrium, changed) - values
        contributions["bending_layers"] = np.abs(unresolved)
    if len(find_rigid_elements(equilibrium.terms)):
        _, shares = compute_error_indicators(correction, factors, outputs)
        least_errors = UNCANCELLED * shares.sum(axis=0)
        contributions["edge_singularity"] = distribute_charge_errors(least_errors, values, outputs)
    defects = measure_area_defects(outputs, equilibrium.space, sector=equilibrium.sector)
    contributions["area_defect"] = defects[:, None] * values
    return contributions


def combine_error_contributions(
    contributions: Mapping[str, Array], outputs: Sequence[Output]
) -> Array:
    """Combine the contributions to the errors of stress integrals.

    Parameters
    ----------
    contributions : mapping of str to ndarray, shape (outputs, 2)
        Errors of X and Y in N: ``order_enrichment`` by elements of the order above;
        ``bending_layers`` that the elements do not resolve; ``edge_singularity``, a lower bound at
        the edge of a rigid probe; ``area_defect`` by the area that curved elements lack.
    outputs : sequence of Output
        The electrodes.

    Returns
    -------
    ndarray, shape (outputs, 2)
        Errors of X and Y in N, with signs.
    """
    errors = contributions["order_enrichment"]
    if "bending_layers" in contributions:
        # the order above sees a part of the layers only: both errors may have one sign
        by_layers = contributions["bending_layers"]
        errors = errors + np.where(errors < 0.0, -by_layers, by_layers)
    if "edge_singularity" in contributions:
        errors = select_larger_errors(errors, contributions["edge_singularity"], outputs)
    # both orders share the elements, and the elements' missing area in a round electrode
    defects = contributions["area_defect"]
    charge_errors = combine_charges(outputs, errors)
    lost_charges = combine_charges(outputs, defects)
    signs = np.where(charge_errors * lost_charges < 0.0, -1.0, 1.0)
    return errors + signs[:, None] * defects


def compute_error_indicators(
    correction: Correction,
    factors: SuperLU,
    outputs: Sequence[Output],
    scales: Array | float = 1.0,
) -> tuple[Array, Array]:
    """Compute dual solutions and the shares of the elements in the errors of charges.

    Parameters
    ----------
    correction : Correction
        The solution in the richer space.
    factors : SuperLU
        Factors of the coarse tangent.
    outputs : sequence of Output
        The charges.
    scales : ndarray, shape (outputs,), or float
        Charges in C that the errors are divided by.

    Returns
    -------
    duals : ndarray, shape (unknowns, outputs)
        Dual solutions in the coarse space.
    shares : ndarray, shape (elements, outputs)
        Absolute contributions of the elements.
    """
    rich = correction.rich
    x = rich.dofs(correction.start)
    gradients = differentiate_charges(outputs, rich.membrane, x, sector=rich.sector) / scales
    duals = solve_duals(correction, factors, gradients)
    return duals, compute_indicators(correction, duals, gradients)


def _find_equilibrium_on_mesh(
    run: SolveRun, equilibrium: Equilibrium, coarser: MeshLevel | None
) -> NewtonResult:
    """Find the equilibrium, from the coarser mesh's solution or from solutions of lower orders.

    Parameters
    ----------
    run : SolveRun
        The budget.
    equilibrium : Equilibrium
        The equations on the mesh.
    coarser : MeshLevel or None
        The solve on a coarser mesh.
    """
    # Newton's method rarely converges from a coarser mesh's compressive stress. In a film that
    # wrinkles it takes longer from there than from a lower order on the same mesh.
    has_compression = equilibrium.film.prestress[:2].min() < 0.0
    if coarser is not None and not (has_compression or equilibrium.model.wrinkles):
        x = transfer_dofs(
            coarser.equilibrium.space, coarser.discrete.solved_dofs, equilibrium.space
        )
        return find_equilibrium(equilibrium, equilibrium.restrict(x), budget=run.budget)
    initial_guess = _solve_lower_orders(equilibrium, run.budget)
    if isinstance(initial_guess, Status):
        flat = np.zeros(equilibrium.unknowns.count)
        return NewtonResult(flat, status=initial_guess, iterations=(), factors=None)
    return find_equilibrium(equilibrium, initial_guess, budget=run.budget)


def _solve_lower_orders(equilibrium: Equilibrium, budget: Budget) -> Array | Status | None:
    """Solve at the order below for an initial guess, which costs less than it saves.

    Returns
    -------
    ndarray, shape (unknowns,)
        The initial guess.
    None
        Where a guess would not help or was not found.
    Status
        Where the order below is unstable in a bending film: this order's displacements contain
        those, and are unstable, too.
    """
    order = equilibrium.space.order
    if order == equilibrium.model.kinematics.lowest_order:
        return None
    if equilibrium.model.wrinkles and is_barely_loaded(equilibrium.scene):
        return None  # the solution of another order is far away
    lower = equilibrium.at_order(order - 1).map_terms(lambda term: term.relaxed())
    initial_guess = _solve_lower_orders(lower, budget)
    if isinstance(initial_guess, Status):
        return initial_guess
    result = find_equilibrium(lower, initial_guess, tolerance=LOWER_ORDER_TOLERANCE, budget=budget)
    budget.spend(lower, result.tangent_count)
    if result.status is Status.UNSTABLE and lower.model.bends:
        return result.status
    if not result.converged:
        return None
    q = make_prolongation(lower, equilibrium) @ result.q
    return equilibrium.complete_initial_guess(equilibrium.dofs(q))


def choose_next_sizes(level: MeshLevel, tolerance: float, most_unknowns: float) -> SizeField:
    """Choose the element sizes of the next mesh from the errors on this one.

    Parameters
    ----------
    level : MeshLevel
        A converged solve.
    tolerance : float
        The worst relative charge error that the sizes aim at.
    most_unknowns : float
        Largest number of unknowns; it makes the sizes larger where necessary.

    Returns
    -------
    SizeField
    """
    correction = level.correction
    factors = level.result.factors
    if correction is None or factors is None:
        raise ValueError("only a converged solve can be refined")
    worst = np.argsort(level.charge_errors)[-MAX_DUALS:]
    outputs = [level.problem.outputs[i] for i in worst]
    duals, by_output = compute_error_indicators(
        correction, factors, outputs, scales=level.charge_scales[worst]
    )
    shares = by_output.max(axis=1)
    reduction = tolerance / level.worst
    largest: Array | float = np.inf
    if level.layers is not None:
        layers = level.layers
        effects = layers.compute_effects(duals).max(axis=1)
        total = float((effects * estimate_missing_fraction(layers.widths)).sum())
        largest = layers.choose_sizes(effects, max(reduction * total, tolerance))
    mesh = level.equilibrium.space.mesh
    rigid = find_rigid_elements(level.equilibrium.terms)
    sizes = compute_refined_sizes(mesh, shares, reduction, largest, rigid)
    return sizes.coarsen(most_unknowns / UNKNOWNS_PER_ELEMENT[level.run.order])
