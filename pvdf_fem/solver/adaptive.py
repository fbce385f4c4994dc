"""Solve a problem: mesh, solve, estimate, and refine until every charge is within the tolerance.

Sizes of the first mesh are chosen a priori (`choose_first_sizes`). While an estimated charge error
exceeds the tolerance, the mesh is refined by the error indicators of the last solve. If a problem
is symmetric, only a sector is meshed; the fields of the whole film are made on demand.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.stress_integrals import (
    StressIntegrals,
    combine_charges,
    select_larger_errors,
)
from pvdf_fem.electrodes.unloaded import compute_uniform_integrals
from pvdf_fem.film.loads.contact_edge import measure_contact_outlines
from pvdf_fem.film.loads.contact_estimate import estimate_tip_outlines
from pvdf_fem.mesh.gmsh_mesh import MeshError
from pvdf_fem.problem.contact_result import select_tips
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import get_piezo_coefficients
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.acceptance import (
    estimate_wrinkling_changes,
    find_rejection_status,
    is_tip_at_rim,
    list_cancellation_warnings,
    list_warnings,
)
from pvdf_fem.solver.adaptive_loop import AdaptiveLoop, TooManyUnknownsError
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.first_sizes import ORDER, choose_first_sizes
from pvdf_fem.solver.history import MeshRecord, StageTimer, Stop
from pvdf_fem.solver.mesh_level import (
    UNKNOWNS_PER_ELEMENT,
    MeshLevel,
    SolveRun,
    choose_next_sizes,
    solve_on_mesh,
)
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import is_barely_loaded
from pvdf_fem.solver.solution import Solution

logger = logging.getLogger(__name__)

#: Relative charge error above which a barely loaded film is called slack.
UNKNOWN_CHARGE = 0.1
#: Factor by which the tolerance that a message recommends exceeds the error bound, so that rounding
#: to two digits does not make it smaller than the bound.
ROUNDING_MARGIN = 1.05


class UnloadedFilmError(SceneError):
    """The unloaded film has no equilibrium; the text names a key of the film and the reason."""

    @classmethod
    def from_status(cls, scene: Scene, status: str, reason: str) -> UnloadedFilmError:
        """Make the error from the status of the solve of the unloaded film.

        Parameters
        ----------
        scene : Scene
            Scene of the unloaded film, one of whose film keys the text names.
        status : str
            Status of the solve.
        reason : str
            Explanation of the status; replaced by other advice for `Status.UNSTABLE`.
        """
        film = scene.film
        keys = ["gravity_m_s2", "pretension_N_m", "temperature_change_K"]
        if film.has_unbalanced_prestress:
            keys = ["rim_displacement_um", "patches", *keys]
        key = next(key for key in keys if getattr(film, key) is not None)
        if status == Status.UNSTABLE:
            reason = "it is in compression; stretch it more"
            if not film.has_unbalanced_prestress:
                reason += ', or let it wrinkle (film.compression = "tension-field")'
        text = f"the unloaded film has no charges ({status}): {reason}"
        return cls([format_error(f"film.{key}", getattr(film, key), text)])


def solve_problem(
    problem: Problem,
    *,
    mesh: MeshTri2 | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
) -> Solution:
    """Solve a problem and, if it converges, compute the charges of its unloaded film.

    Parameters
    ----------
    problem : Problem
        A problem whose outputs are the electrodes of the scene.
    mesh : MeshTri2, optional
        A mesh of the whole film in m, which is not refined, so that errors may exceed the
        tolerance.
    order : int, optional
        Polynomial order of the displacement.
    budget : Budget, optional
        Limits for both solves together, to which their work is added; by default those of the
        scene's numerics.

    Returns
    -------
    Solution
        The status says whether the loaded film has a result. If the unloaded film has none, there
        is a warning, and ``unloaded_integrals`` are None.
    """
    start = time.perf_counter()
    if budget is None:
        budget = Budget.for_problem(problem)
    solution = solve_outputs(problem, mesh=mesh, order=order, budget=budget)
    warnings = [*problem.scene.warnings, *solution.warnings]
    unloaded = None
    if solution.status is Status.CONVERGED:
        integrals = solution.discrete.stress_integrals
        warnings += list_cancellation_warnings(problem.scene, integrals)
        try:
            unloaded = solve_unloaded(problem, budget=budget)
        except UnloadedFilmError as error:
            warnings += error.problems
    seconds = solution.seconds | {"total": time.perf_counter() - start}
    return replace(solution, warnings=tuple(warnings), unloaded_integrals=unloaded, seconds=seconds)


def solve_unloaded(problem: Problem, *, budget: Budget | None = None) -> StressIntegrals:
    """Compute the stress integrals of the unloaded film, in closed form if its stress is uniform.

    Otherwise the problem of the unloaded film is solved.

    Parameters
    ----------
    problem : Problem
        The problem of the loaded film.
    budget : Budget, optional
        Limits of the solve, to which its work is added; by default those of the scene's numerics.

    Returns
    -------
    StressIntegrals
        Stress integrals of the outputs of the unloaded problem in N, with errors.

    Raises
    ------
    UnloadedFilmError
        If the solve of the unloaded film does not converge.
    """
    integrals = compute_uniform_integrals(problem)
    if integrals is not None:
        return integrals
    assert problem.unloaded is not None
    solution = solve_outputs(problem.unloaded, budget=budget)
    if solution.status is not Status.CONVERGED:
        scene = problem.unloaded.scene
        raise UnloadedFilmError.from_status(scene, solution.status, solution.reason)
    return solution.discrete.stress_integrals


def compute_unloaded_integrals(problem: Problem, *, required: bool = True) -> StressIntegrals:
    """Compute the stress integrals of the unloaded film, or NaN if it has no result.

    Parameters
    ----------
    problem : Problem
        The problem of the loaded film.
    required : bool, optional
        Raise an exception instead of returning NaN.

    Raises
    ------
    UnloadedFilmError
        If `required` and the solve of the unloaded film does not converge.
    """
    try:
        return solve_unloaded(problem)
    except UnloadedFilmError:
        if required:
            raise
        return StressIntegrals.unknown(len(problem.unloaded_outputs))


def compute_unloaded_charges(problem: Problem) -> Array:
    """Compute the charges of the unloaded film in C, shape (outputs,); see `solve_unloaded`."""
    return solve_unloaded(problem).charges(get_piezo_coefficients(problem.unloaded_outputs))


def solve_outputs(
    problem: Problem,
    *,
    mesh: MeshTri2 | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
) -> Solution:
    """Solve a problem for its outputs, but not its unloaded film.

    Parameters
    ----------
    problem, mesh, order, budget
        As in `solve_problem`. The outputs need not be the electrodes of the scene; if they are not,
        the solution's charges by electrode have no meaning.

    Returns
    -------
    Solution
        If it has converged, the charges of all outputs are within the tolerance, unless `mesh` was
        given.

    Raises
    ------
    SceneError
        If a mesh is given and the scene has tips, whose contacts a mesh has to follow.
    """
    problem.resolve()
    if mesh is not None:
        problem.scene.require_no_tips("a mesh that is given")
    if budget is None:
        budget = Budget.for_problem(problem)
    logger.info("solve a %s with %d outputs", problem.film_model_name, len(problem.outputs))
    run = SolveRun(problem, budget, timer=StageTimer())
    loop = _make_adaptive_loop(run, order)
    if mesh is not None:
        start = time.perf_counter()
        with run.timer("solve"):
            equilibrium = Equilibrium(problem, mesh, order)
        level = loop.solve_and_record(equilibrium, coarser=None, start=start)
        return _make_solution(level, Stop.GIVEN_MESH, loop.history)
    try:
        level, stop = loop.run()
    except MeshError as error:
        return Solution(
            problem,
            Status.MESH_FAILED,
            reason=f"{Status.MESH_FAILED.advice} ({error})",
            stop=Stop.NO_MESH,
            seconds=run.timer.seconds(),
        )
    except TooManyUnknownsError as error:
        return Solution(
            problem,
            Status.TOLERANCE,
            reason=str(error),
            stop=error.stop,
            seconds=run.timer.seconds(),
        )
    return _make_solution(level, stop, loop.history)


def _make_adaptive_loop(run: SolveRun, order: int) -> AdaptiveLoop[MeshLevel]:
    """Make the adaptive loop of a solve in elements of an order."""
    problem = run.problem
    return AdaptiveLoop(
        problem,
        order,
        first_sizes=partial(choose_first_sizes, problem, order),
        solve_equations=partial(solve_on_mesh, run),
        next_sizes=choose_next_sizes,
        budget=run.budget,
        timer=run.timer,
        unknowns_per_element=UNKNOWNS_PER_ELEMENT[order],
        sector=problem.sector,
        find_contacts=partial(_find_contact_outlines, problem),
    )


def _find_contact_outlines(problem: Problem, level: MeshLevel | None) -> dict[str, Outline]:
    """Measure the outlines of tip contacts on a level, by patch name; estimate them without one."""
    if level is None:
        return estimate_tip_outlines(problem.scene)
    outlines = {}
    for tip in select_tips(level.equilibrium):
        outlines.update(measure_contact_outlines(tip, level.discrete.solved_state))
    return outlines


@dataclass(frozen=True, eq=False)
class WrinklingEffect:
    """Estimated changes of the results if a membrane in compression could wrinkle."""

    changes: Array  #: Changes of the stress integrals in N, shape (outputs, 2).
    relative: float  #: Largest change of a charge divided by its `MeshLevel.charge_scales`.

    @classmethod
    def estimate(cls, level: MeshLevel) -> WrinklingEffect | None:
        """Estimate the effect at a level; None if `estimate_wrinkling_changes` returns None."""
        changes = estimate_wrinkling_changes(level)
        if changes is None:
            return None
        by_charge = np.abs(combine_charges(level.problem.outputs, changes))
        relative = (by_charge / level.charge_scales).max(initial=0.0)
        return cls(changes, float(relative))


def _make_solution(level: MeshLevel, stop: Stop, history: Sequence[MeshRecord]) -> Solution:
    """Make the solution from the solve on one mesh, with status, effects and warnings.

    If wrinkles would change a charge by more than its error, the change replaces the error.

    Parameters
    ----------
    level : MeshLevel
        The solve on one mesh.
    stop : Stop
        Reason why no further mesh was made.
    history : sequence of MeshRecord
        Records of all meshes.
    """
    problem = level.problem
    discrete = level.discrete
    wrinkling = WrinklingEffect.estimate(level)
    if wrinkling is not None:
        integrals = discrete.stress_integrals
        errors = select_larger_errors(integrals.errors, wrinkling.changes, problem.outputs)
        discrete = replace(discrete, stress_integrals=replace(integrals, errors=errors))
    change = None if wrinkling is None else wrinkling.relative
    status = _decide_status(level, discrete, stop=stop, change=change)
    charges_pC = _compute_charges_by_stress_pC(problem, discrete.stress_integrals)
    effects = problem.describe_effects(charges_pC)
    warnings = [*problem.film.warnings]
    warnings += list_warnings(discrete.solved, discrete.solved_state, change)
    return Solution(
        problem,
        status,
        reason=_explain_status(level, status, stop=stop, change=change),
        stop=stop,
        history=tuple(history),
        iterations=level.result.iterations,
        neglected=effects.neglected,
        included=effects.included,
        warnings=tuple(warnings),
        seconds=level.run.timer.seconds(),
        _discrete=discrete,
    )


def _compute_charges_by_stress_pC(
    problem: Problem, integrals: StressIntegrals
) -> dict[str, float] | None:
    """Compute the charges due to d31 and d32 alone in pC, by electrode.

    Returns None if the outputs are not the electrodes of the scene, so that their numbers differ.
    """
    names = [electrode.name for electrode in problem.scene.electrode_list]
    if len(names) != len(integrals.values):
        return None  # in a sweep the outputs are those of all scenes that are solved together
    film = problem.scene.film
    charges = integrals.charges((film.d31_pC_N, film.d32_pC_N))
    return dict(zip(names, charges.tolist(), strict=True))


def _decide_status(
    level: MeshLevel, discrete: DiscreteSolution, *, stop: Stop, change: float | None
) -> Status:
    """Decide the status of a solution from its convergence, acceptance and errors.

    The errors are ignored if the mesh was given.

    Parameters
    ----------
    level : MeshLevel
        The level of the result.
    discrete : DiscreteSolution
        The discrete solution on this level.
    stop : Stop
        Reason why no further mesh was made.
    change : float or None
        Largest relative change of a charge due to wrinkles; None if it was not estimated.
    """
    scene = level.problem.scene
    status = level.result.status
    if status is Status.CONVERGED:
        rejection = find_rejection_status(discrete, level.result.factors, change)
        status = rejection or status
    if stop is Stop.GIVEN_MESH:
        return status
    if status is Status.CONVERGED and level.bound > scene.numerics.tolerance:
        status = Status.TOLERANCE
    has_no_equilibrium = status in (Status.MAX_ITERATIONS, Status.UNBALANCED)
    if has_no_equilibrium and is_tip_at_rim(discrete):
        return Status.RIM
    is_unknown = status is Status.TOLERANCE and level.worst > UNKNOWN_CHARGE
    is_slack = level.problem.film.wrinkles and is_barely_loaded(scene)
    if is_slack and (has_no_equilibrium or is_unknown):
        return Status.SLACK
    return status


def _explain_status(level: MeshLevel, status: Status, *, stop: Stop, change: float | None) -> str:
    """Return the advice for a status, with the numbers of this solve.

    If the tolerance is not reached, the advice includes the tolerance that can be reached. If the
    solve has converged, but the relative `change` of a charge due to wrinkles exceeds the
    tolerance, it includes this change.

    Parameters
    ----------
    level : MeshLevel
        The level of the result.
    status : Status
        Status of the solution.
    stop : Stop
        Reason why no further mesh was made.
    change : float or None
        Largest relative change of a charge due to wrinkles; None if it was not estimated.
    """
    tolerance = level.problem.scene.numerics.tolerance
    if status is Status.TOLERANCE:
        reachable = ROUNDING_MARGIN * level.bound
        return f"{status.advice}, to at least {reachable:.1e}, which can be reached ({stop.value})"
    if status is Status.CONVERGED and change is not None and change > tolerance:
        return f"{status.advice}, but wrinkles would change a charge by up to {change:.1e} of it"
    return status.advice
