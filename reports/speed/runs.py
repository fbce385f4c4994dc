"""Timed runs: what a code gives for a scene, and after how many seconds.

A job is one way to solve one case. Jobs are timed in rounds, so that a busy moment of the machine
meets all codes; what is kept is the median.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from pvdf_fem import Scene, solve
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.solution.first_sizes import first_sizes
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers.newton import Status
from reports.speed.cases import Case, Reference, worst_error

OURS = "pvdf_fem"
UNIFORM, GOAL = "uniform", "tolerance"
# Where the uniform families come from: their finest members want well resolved circles.
BASE_TOLERANCE = 1e-5
CONVERGED = "converged"


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes
    ----------
    status, reason : str
        ``converged``, or why there are no charges.
    charges_pC, errors_pC : dict
        The second is the code's own estimate, empty if it has none.
    unknowns : int
    seconds : dict
        By stage, with ``total``; imports are left out.
    """

    status: str
    reason: str = ""
    charges_pC: dict[str, float] = field(default_factory=dict)
    errors_pC: dict[str, float] = field(default_factory=dict)
    unknowns: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Job:
    """One way to solve one case.

    Attributes
    ----------
    case : Case
    code, method : str
        ``pvdf_fem`` or a peer; ``order 3, uniform`` and the like.
    setting : float
        Factor of the element sizes, or the tolerance.
    run : callable
    """

    case: Case
    code: str
    method: str
    setting: float
    run: Callable[[], Outcome]


@dataclass(frozen=True)
class Run:
    """A timed job.

    Attributes
    ----------
    job : Job
    outcome : Outcome
        Of the median run.
    seconds, solving : float
        Medians: of all stages, and without error estimates that the method can do without: those
        of a uniform mesh, not those that meshes for a tolerance follow.
    repeats : int
    error : float
        Of the worst charge against the reference, relative; NaN for a failed run.
    """

    job: Job
    outcome: Outcome
    seconds: float
    solving: float
    repeats: int
    error: float

    @property
    def converged(self) -> bool:
        """Whether there are charges."""
        return self.outcome.status == CONVERGED


def outcome_of(solution: Solution, seconds: dict[str, float]) -> Outcome:
    """A solution of ours as an outcome."""
    if solution.status is not Status.CONVERGED:
        return Outcome(str(solution.status), solution.reason, unknowns=solution.unknowns)
    return Outcome(
        CONVERGED,
        "",
        solution.charges_pC,
        solution.charge_errors_pC,
        solution.unknowns,
        seconds,
    )


def solve_uniform(scene: Scene, order: int, factor: float) -> Outcome:
    """On a mesh of the family ``first_sizes(...).scaled(factor)``, the same for all orders."""
    start = time.perf_counter()
    based = scene.with_(**{"numerics.tolerance": BASE_TOLERANCE})
    mesh = mesh_scene(
        based, first_sizes(based.with_(**{"numerics.tolerance": 1e-3}), 2).scaled(factor)
    )
    meshed = time.perf_counter() - start
    solution = solve(based, mesh=mesh, order=order)
    stages = {**solution.seconds, "mesh": meshed}
    return outcome_of(solution, {**stages, "total": meshed + solution.seconds["total"]})


def solve_to_tolerance(scene: Scene, order: int, tolerance: float) -> Outcome:
    """On meshes that follow the error of the charges until it is within `tolerance`."""
    solution = solve(scene.with_(**{"numerics.tolerance": tolerance}), order=order)
    return outcome_of(solution, solution.seconds)


def our_jobs(
    case: Case,
    factors: Mapping[int, Sequence[float]],
    tolerances: Mapping[int, Sequence[float]],
) -> list[Job]:
    """Uniform families and goal-oriented meshes of a case, by order."""
    jobs = []
    for order, sizes in factors.items():
        for factor in sizes:
            run = partial(solve_uniform, case.scene, order, factor)
            jobs.append(Job(case, OURS, f"order {order}, {UNIFORM}", factor, run))
    for order, wanted in tolerances.items():
        for tolerance in wanted:
            if case.exact is None and tolerance < 2.0 * case.tolerances[0]:
                continue  # as fine as the reference
            run = partial(solve_to_tolerance, case.scene, order, tolerance)
            jobs.append(Job(case, OURS, f"order {order}, {GOAL}", tolerance, run))
    return jobs


def attempt(job: Job) -> Outcome:
    """The job's outcome; whatever goes wrong becomes its status."""
    try:
        return job.run()
    except Exception as error:
        return Outcome("crashed", f"{type(error).__name__}: {error}")


def timed(
    jobs: Sequence[Job],
    reference: Reference,
    *,
    rounds: int,
    budget: float,
    tick: Callable[[], object],
) -> list[Run]:
    """Run the jobs of one case in rounds.

    Parameters
    ----------
    jobs : sequence of Job
    reference : Reference
    rounds : int
        Times that each job is run ...
    budget : float
        ... as long as another one keeps its runs within these seconds.
    tick : callable
        Called after each job has been run for the first time.
    """
    outcomes: list[list[Outcome]] = [[] for _ in jobs]
    for number in range(rounds):
        for job, found in zip(jobs, outcomes, strict=True):
            if number == 0:
                found.append(attempt(job))
                tick()
            elif found[0].status == CONVERGED and (number + 1) * _total(found[0]) <= budget:
                found.append(attempt(job))
    return [_run(job, found, reference) for job, found in zip(jobs, outcomes, strict=True)]


def _total(outcome: Outcome) -> float:
    return outcome.seconds.get("total", math.nan)


def _run(job: Job, outcomes: Sequence[Outcome], reference: Reference) -> Run:
    good = [one for one in outcomes if one.status == CONVERGED]
    if len(good) < len(outcomes):
        bad = next(one for one in outcomes if one.status != CONVERGED)
        return Run(job, bad, math.nan, math.nan, len(outcomes), math.nan)
    middle = sorted(good, key=_total)[len(good) // 2]
    idle = "estimate" if UNIFORM in job.method else ""
    solving = statistics.median(_total(one) - one.seconds.get(idle, 0.0) for one in good)
    error = worst_error(middle.charges_pC, reference.charges_pC)
    return Run(job, middle, statistics.median(map(_total, good)), solving, len(good), error)


def effectivities(runs: Iterable[Run], references: dict[str, Reference]) -> dict[str, list[float]]:
    """Estimated over true error of every charge, by method.

    Charges whose true error is below ten times the doubt about the reference are left out.
    """
    found: dict[str, list[float]] = {}
    for run in runs:
        outcome, truth = run.outcome, references[run.job.case.name]
        for name, estimate in outcome.errors_pC.items():
            value = truth.charges_pC[name]
            error = abs(outcome.charges_pC[name] - value)
            if error > 10.0 * truth.doubt * abs(value):
                found.setdefault(run.job.method, []).append(estimate / error)
    return found


def fastest(runs: Iterable[Run], error: float, *, solving: bool = False) -> Run | None:
    """The run that takes least time among those within `error`; None if there is none."""
    within = [run for run in runs if run.error <= error]
    return min(within, key=lambda run: run.solving if solving else run.seconds, default=None)
