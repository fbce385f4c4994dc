"""A solve on one mesh: equilibrium, charges, error estimates, and sizes for the next mesh.

The stress integrals of an output are X = ∫ S11 dA and Y = ∫ S22 dA in N; its charge is
d31 X + d32 Y (see `pvdf_fem.electrodes.stress_integrals`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import SuperLU

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
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import Output, get_piezo_coefficients
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
#: With a rigid probe, the error of a charge is at least this fraction of the sum of the elements'
#: absolute contributions, because contributions along its singular edge cancel by chance. In 100
#: solves of rigid scenes the true errors are 0.02 to 1.5 times the sum, with a median of 0.25.
MIN_UNCANCELLED_FRACTION = 0.3
#: A charge is accepted if this factor times its estimated error is within the tolerance. In 36
#: scenes with pressures, at tolerances of 1e-3 and 1e-4, true errors above 0.4 of the tolerance are
#: up to 1.5 times the estimate, and above 1.4 times in one of ten. With a rigid probe
#: `MIN_UNCANCELLED_FRACTION` takes the place of this factor.
SAFETY = 1.4
#: Cost of an error estimate without a solve in the richer space, in Newton iterations.
ESTIMATE_ITERATIONS = 4
#: Relative size of Newton's last step at lower orders, below the discretisation error there.
LOWER_ORDER_TOLERANCE = 3e-2
#: Maximum number of charges whose error indicators determine the sizes of the next mesh.
MAX_DUALS = 32


@dataclass(frozen=True, eq=False)
class SolveRun:
    """The problem, budget and timer that the solves on all meshes have in common."""

    problem: Problem
    budget: Budget
    timer: StageTimer


@dataclass(frozen=True, eq=False)
class MeshLevel:
    """The solve on one mesh, with error estimates if it converged."""

    run: SolveRun
    equilibrium: Equilibrium  #: The equations on the meshed sector.
    result: NewtonResult
    discrete: DiscreteSolution  #: The solution, with stress integrals and their errors.
    #: The solution corrected in the space of the next order; None without a solution.
    correction: Correction | None = None
    #: Estimator of errors by unresolved bending layers; None without bending or a solution.
    layers: BendingLayers | None = None
    #: Inputs of `combine_error_contributions`; empty without a solution.
    error_contributions: Mapping[str, Array] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """The problem that is solved."""
        return self.run.problem

    @property
    def status(self) -> Status:
        """How Newton's method ended, on this order or else in the richer space."""
        return self.result.status

    @property
    def unknowns(self) -> int:
        """Number of equations."""
        return self.equilibrium.unknowns.count

    @property
    def iterations(self) -> int:
        """Number of Newton iterations that led to the result, without failed attempts."""
        return len(self.result.iterations)

    @property
    def failed_attempts(self) -> tuple[FailedAttempt, ...]:
        """Solvers that failed on this mesh."""
        return self.result.failed_attempts

    @property
    def worst(self) -> float:
        """Largest relative charge error; 0 without outputs or without a solution."""
        return float(np.max(self.charge_errors, initial=0.0))

    @property
    def bound(self) -> float:
        """The error that is compared with the tolerance: `worst` times `SAFETY`.

        With rigid elements it is `worst` itself, whose estimate is already cautious.
        """
        is_rigid = len(find_rigid_elements(self.equilibrium.terms)) > 0
        return self.worst * (1.0 if is_rigid else SAFETY)

    @property
    def charge_errors(self) -> Array:
        """Estimated charge errors divided by `charge_scales`, shape (outputs,)."""
        coefficients = get_piezo_coefficients(self.problem.outputs)
        return self.discrete.stress_integrals.charge_errors(coefficients) / self.charge_scales

    @cached_property
    def charge_scales(self) -> Array:
        """Charges in C that relative errors refer to, shape (outputs,)."""
        discrete = self.discrete
        return compute_charge_scales(
            self.problem.outputs,
            discrete.solved_state,
            integrals=discrete.stress_integrals.values,
            space=self.equilibrium.space,
        )


def solve_on_mesh(
    run: SolveRun, equilibrium: Equilibrium, coarser: MeshLevel | None = None
) -> MeshLevel:
    """Find the equilibrium on a mesh and, if it converges, estimate the errors of the charges.

    Parameters
    ----------
    run : SolveRun
        The problem; the work is added to its budget and the time to its timer.
    equilibrium : Equilibrium
        The equations of the problem on the mesh.
    coarser : MeshLevel, optional
        The solve on a coarser mesh, for the initial guess; ignored if the film wrinkles or is
        compressed.

    Returns
    -------
    MeshLevel
        The status says whether it converged. If it did not, or if the flat film is the solution,
        the errors are zero and there is no correction.
    """
    with run.timer("solve"):
        result = _find_equilibrium_on_mesh(run, equilibrium, coarser)
        run.budget.spend(equilibrium, result.tangent_count)
        values = _evaluate_stress_integrals(run.problem.outputs, equilibrium, result.q)
    integrals = StressIntegrals(values, np.zeros_like(values))
    discrete = DiscreteSolution(equilibrium, result.q, integrals)
    level = MeshLevel(run, equilibrium, result=result, discrete=discrete)
    if not result.converged or result.factors is None:
        return level
    with run.timer("estimate"):
        return _estimate_errors(level)


def _evaluate_stress_integrals(
    outputs: Sequence[Output], equilibrium: Equilibrium, q: Array
) -> Array:
    """Compute the stress integrals X and Y in N at the unknowns `q`, shape (outputs, 2)."""
    x = equilibrium.dofs(q)
    return compute_stress_integrals(outputs, equilibrium.membrane, x, sector=equilibrium.sector)


def _estimate_errors(level: MeshLevel) -> MeshLevel:
    """Return a copy of a converged level with error estimates from the next order.

    If the equations of the next order had to be solved and the solve failed, the copy has the
    status of that solve, and no errors. The work is added to the budget in either case.
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
    """Estimate the errors of X and Y separately by source; see `combine_error_contributions`."""
    outputs = level.problem.outputs
    equilibrium = level.equilibrium
    values = level.discrete.stress_integrals.values

    corrected = _evaluate_stress_integrals(outputs, correction.rich, correction.q)
    contributions = {
        "order_enrichment": equilibrium.model.mesh_policy.saturation * (corrected - values)
    }
    if level.layers is not None:
        changed = level.result.q + level.layers.compute_change_of_unknowns(factors)
        unresolved = _evaluate_stress_integrals(outputs, equilibrium, changed) - values
        contributions["bending_layers"] = np.abs(unresolved)
    if len(find_rigid_elements(equilibrium.terms)):
        _, by_element = compute_error_indicators(correction, factors, outputs)
        min_errors = MIN_UNCANCELLED_FRACTION * by_element.sum(axis=0)
        contributions["edge_singularity"] = distribute_charge_errors(min_errors, values, outputs)
    defects = measure_area_defects(outputs, equilibrium.space, sector=equilibrium.sector)
    contributions["area_defect"] = defects[:, None] * values
    return contributions


def combine_error_contributions(
    contributions: Mapping[str, Array], outputs: Sequence[Output]
) -> Array:
    """Combine the error estimates of the stress integrals X and Y from several sources.

    The charge of an output is d31 X + d32 Y, with X = ∫ S11 dA and Y = ∫ S22 dA over its area.

    Parameters
    ----------
    contributions : mapping of str to ndarray, shape (outputs, 2)
        Estimated errors of X and Y in N, by source. Two are required: ``order_enrichment``, the
        signed change in elements of the next order, and ``area_defect``, the error due to the
        wrong area of elements along curved outlines, whose sign is unknown. Two are optional:
        ``bending_layers``, magnitudes due to unresolved bending layers, and ``edge_singularity``,
        errors that make the minimum charge error near the edge of a rigid probe.
    outputs : sequence of Output
        The outputs, for their d31 and d32.

    Returns
    -------
    ndarray, shape (outputs, 2)
        Signed errors of X and Y in N. The bending layers and the area defect are added so that
        they do not cancel the other errors.
    """
    errors = contributions["order_enrichment"]
    if "bending_layers" in contributions:
        # The next order resolves only a part of the layers, so that the rest may have the same
        # sign: add it away from zero.
        layer_errors = contributions["bending_layers"]
        errors = errors + np.where(errors < 0.0, -layer_errors, layer_errors)
    if "edge_singularity" in contributions:
        errors = select_larger_errors(errors, contributions["edge_singularity"], outputs)
    # The next order uses the same elements and so does not show the defect of their area: add this
    # error with the sign that makes the error of the charge larger.
    defects = contributions["area_defect"]
    charge_errors = combine_charges(outputs, errors)
    defect_charges = combine_charges(outputs, defects)
    signs = np.where(charge_errors * defect_charges < 0.0, -1.0, 1.0)
    return errors + signs[:, None] * defects


def compute_error_indicators(
    correction: Correction,
    factors: SuperLU,
    outputs: Sequence[Output],
    scales: Array | float = 1.0,
) -> tuple[Array, Array]:
    """Compute the dual-weighted contribution of each element to the errors of charges.

    Parameters
    ----------
    correction : Correction
        The coarse solution and its correction in the space of the next order.
    factors : SuperLU
        Factors of the tangent of the coarse equations.
    outputs : sequence of Output
        The outputs whose charges are considered.
    scales : ndarray, shape (outputs,), or float, optional
        Charges in C by which the contributions are divided; by default they are in C.

    Returns
    -------
    duals : ndarray, shape (unknowns, outputs)
        Dual (adjoint) solutions of the charges in the coarse space, divided by `scales`.
    by_element : ndarray, shape (elements, outputs)
        Absolute contributions of the elements, divided by `scales`.
    """
    rich = correction.rich
    x = rich.dofs(correction.start)
    gradients = differentiate_charges(outputs, rich.membrane, x, sector=rich.sector) / scales
    duals = solve_duals(correction, factors, gradients)
    return duals, compute_indicators(correction, duals, gradients)


def _find_equilibrium_on_mesh(
    run: SolveRun, equilibrium: Equilibrium, coarser: MeshLevel | None
) -> NewtonResult:
    """Find the equilibrium, with an initial guess from a coarser mesh or from lower orders.

    Parameters
    ----------
    run : SolveRun
        The budget, to which the work at lower orders is added.
    equilibrium : Equilibrium
        The equations on the mesh.
    coarser : MeshLevel or None
        The solve on a coarser mesh; ignored if the film wrinkles or its prestress is compressive.

    Returns
    -------
    NewtonResult
        If a lower order is already unstable, the flat film with `Status.UNSTABLE`.
    """
    # From a coarser mesh Newton's method rarely converges if there is compressive stress, and if
    # the film wrinkles it takes longer than from a lower order on the same mesh.
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
    """Solve on all lower orders of the same mesh for an initial guess.

    In these solves tips are soft (see `Term.relaxed`). They are cheap; their work is added to the
    budget.

    Returns
    -------
    ndarray, shape (unknowns,)
        Unknowns near the solution.
    None
        If this is the lowest order, if the guess would be far from the solution, or if the order
        below did not converge.
    Status
        `Status.UNSTABLE` if a bending film is unstable at a lower order. It is then unstable here
        too, because this space contains the displacements of the lower order.
    """
    order = equilibrium.space.order
    if order == equilibrium.model.kinematics.lowest_order:
        return None
    if equilibrium.model.wrinkles and is_barely_loaded(equilibrium.scene):
        return None  # solutions of different orders are far from each other
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


def choose_next_sizes(level: MeshLevel, tolerance: float, max_unknowns: float) -> SizeField:
    """Choose the element sizes of the next mesh from the error indicators of a solve.

    Parameters
    ----------
    level : MeshLevel
        A converged solve with a correction.
    tolerance : float
        Requested largest relative charge error.
    max_unknowns : float
        Maximum number of unknowns of the next mesh; sizes are scaled up to meet it.

    Returns
    -------
    SizeField
        Element sizes in m.

    Raises
    ------
    ValueError
        If the level has no correction, since it did not converge or the film is flat.
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
    indicators = by_output.max(axis=1)
    reduction = tolerance / level.worst
    max_sizes: Array | float = np.inf
    if level.layers is not None:
        layers = level.layers
        effects = layers.compute_effects(duals).max(axis=1)
        total = float((effects * estimate_missing_fraction(layers.widths)).sum())
        max_sizes = layers.choose_sizes(effects, max(reduction * total, tolerance))
    mesh = level.equilibrium.space.mesh
    rigid = find_rigid_elements(level.equilibrium.terms)
    sizes = compute_refined_sizes(mesh, indicators, reduction, max_sizes, rigid)
    return sizes.coarsen(max_unknowns / UNKNOWNS_PER_ELEMENT[level.equilibrium.space.order])
