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
from pvdf_fem.solvers.status import Status
from reports.speed.cases import BenchmarkCase, Reference, worst_error

OURS = "pvdf_fem"
UNIFORM = "uniform"
GOAL = "tolerance"
CONVERGED = "converged"


@dataclass(frozen=True)
class Outcome:
    """Result of one run.

    Attributes
    ----------
    status, reason : str
        ``converged``, or why there are no charges.
    charges_pC, errors_pC : dict
        Charges, and the code's own estimates of their errors, empty if it has none.
    unknowns : int
    seconds : dict
        Seconds by stage, with ``total``; imports are left out.
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
    case : BenchmarkCase
    code, method : str
        ``pvdf_fem`` or a peer; ``order 3, uniform`` and the like.
    setting : float
        Factor of the element sizes, or the tolerance.
    run : callable
    """

    case: BenchmarkCase
    code: str
    method: str
    setting: float
    run: Callable[[], Outcome]


@dataclass(frozen=True)
class TimedRun:
    """A timed job.

    Attributes
    ----------
    job : Job
    outcome : Outcome
        Outcome of the run with the median seconds.
    seconds : float
        Median seconds of all stages.
    solving : float
        Median seconds without error estimates that the method does not need: those on uniform
        meshes are left out, while those that meshes for a tolerance follow are counted.
    repeats : int
    error : float
        Relative error of the worst charge against the reference; NaN for a failed run.
    """

    job: Job
    outcome: Outcome
    seconds: float
    solving: float
    repeats: int
    error: float

    @property
    def converged(self) -> bool:
        """Whether the run gave charges."""
        return self.outcome.status == CONVERGED


def outcome_of(solution: Solution, seconds: dict[str, float]) -> Outcome:
    """The outcome of a solution of this code, with the seconds that it took."""
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


def solve_uniform(scene: Scene, order: int, factor: float, base_tolerance: float = 1e-5) -> Outcome:
    """Solve on a mesh of the family ``first_sizes(...).scaled(factor)``, the same for all orders.

    `base_tolerance` is the tolerance by which circles are resolved, fine enough for the finest
    members of the family.
    """
    start = time.perf_counter()
    based = scene.with_(**{"numerics.tolerance": base_tolerance})
    mesh = mesh_scene(
        based, first_sizes(based.with_(**{"numerics.tolerance": 1e-3}), 2).scaled(factor)
    )
    meshed = time.perf_counter() - start
    solution = solve(based, mesh=mesh, order=order)
    stages = {**solution.seconds, "mesh": meshed}
    return outcome_of(solution, {**stages, "total": meshed + solution.seconds["total"]})


def solve_to_tolerance(scene: Scene, order: int, tolerance: float) -> Outcome:
    """Solve on meshes that follow the error of the charges until it is within `tolerance`."""
    solution = solve(scene.with_(**{"numerics.tolerance": tolerance}), order=order)
    return outcome_of(solution, solution.seconds)


def our_jobs(
    case: BenchmarkCase,
    factors: Mapping[int, Sequence[float]],
    tolerances: Mapping[int, Sequence[float]],
) -> list[Job]:
    """Jobs of a case on uniform families and on goal-oriented meshes, by order."""
    jobs = []
    for order, sizes in factors.items():
        for factor in sizes:
            run = partial(solve_uniform, case.scene, order, factor)
            jobs.append(Job(case, OURS, f"order {order}, {UNIFORM}", factor, run))
    for order, order_tolerances in tolerances.items():
        for tolerance in order_tolerances:
            if case.exact is None and tolerance < 2.0 * case.tolerances[0]:
                continue  # the reference is not finer
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
) -> list[TimedRun]:
    """Run the jobs of one case in rounds.

    Parameters
    ----------
    jobs : sequence of Job
    reference : Reference
    rounds : int
        Largest number of runs of a job.
    budget : float
        Seconds that the runs of a job may take together; the first run may take longer.
    tick : callable
        Called after each job has been run for the first time.
    """
    outcomes: list[list[Outcome]] = [[] for _ in jobs]
    for number in range(rounds):
        for job, job_outcomes in zip(jobs, outcomes, strict=True):
            if number == 0:
                job_outcomes.append(attempt(job))
                tick()
            elif (
                job_outcomes[0].status == CONVERGED
                and (number + 1) * _total(job_outcomes[0]) <= budget
            ):
                job_outcomes.append(attempt(job))
    return [
        _run(job, job_outcomes, reference) for job, job_outcomes in zip(jobs, outcomes, strict=True)
    ]


def _total(outcome: Outcome) -> float:
    return outcome.seconds.get("total", math.nan)


def _run(job: Job, outcomes: Sequence[Outcome], reference: Reference) -> TimedRun:
    converged = [outcome for outcome in outcomes if outcome.status == CONVERGED]
    if len(converged) < len(outcomes):
        failed = next(outcome for outcome in outcomes if outcome.status != CONVERGED)
        return TimedRun(job, failed, math.nan, math.nan, len(outcomes), math.nan)
    middle = sorted(converged, key=_total)[len(converged) // 2]
    idle = "estimate" if UNIFORM in job.method else ""
    solving = statistics.median(
        _total(outcome) - outcome.seconds.get(idle, 0.0) for outcome in converged
    )
    error = worst_error(middle.charges_pC, reference.charges_pC)
    return TimedRun(
        job, middle, statistics.median(map(_total, converged)), solving, len(converged), error
    )


def effectivities(
    runs: Iterable[TimedRun], references: dict[str, Reference]
) -> dict[str, list[float]]:
    """Estimated over true error of every charge, by method.

    Charges whose true error is below ten times the doubt about the reference are left out.
    """
    ratios: dict[str, list[float]] = {}
    for run in runs:
        outcome, truth = run.outcome, references[run.job.case.name]
        for name, estimate in outcome.errors_pC.items():
            value = truth.charges_pC[name]
            error = abs(outcome.charges_pC[name] - value)
            if error > 10.0 * truth.doubt * abs(value):
                ratios.setdefault(run.job.method, []).append(estimate / error)
    return ratios


def fastest(
    runs: Iterable[TimedRun],
    error: float,
    *,
    case: str | None = None,
    code: str | None = None,
    method: str = "",
    solving: bool = False,
) -> TimedRun | None:
    """The run that takes least time among those within an error.

    Parameters
    ----------
    runs : iterable of TimedRun
    error : float
        Largest relative error of the worst charge.
    case, code : str, optional
        Name of the case and of the code; by default all of them.
    method : str
        A part of the method's name.
    solving : bool
        Whether `TimedRun.solving` is compared rather than `TimedRun.seconds`.

    Returns
    -------
    TimedRun or None
        None if no run is within the error.
    """
    within = [
        run
        for run in runs
        if run.error <= error
        and case in (None, run.job.case.name)
        and code in (None, run.job.code)
        and method in run.job.method
    ]
    return min(within, key=lambda run: run.solving if solving else run.seconds, default=None)
