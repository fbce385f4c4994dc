"""Tables and sentences of the report on error against run time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from reports.common.page import Cell, Column, Table
from reports.speed.cases import BenchmarkCase, Reference
from reports.speed.growth import Size
from reports.speed.runs import GOAL, OURS, UNIFORM, TimedRun, fastest
from reports.speed.sweep_cost import SweepCost

#: Relative errors of the worst charge at which codes are compared.
TARGETS = (1e-3, 1e-4, 1e-5)


def share_of(flags: Sequence[bool]) -> str:
    """``7 of 9``."""
    return f"{sum(flags)} of {len(flags)}"


def peers_of(runs: Iterable[TimedRun]) -> list[str]:
    """Names of the other codes among the runs, in their order."""
    return list(dict.fromkeys(run.job.code for run in runs if run.job.code != OURS))


def run_table(runs: Sequence[TimedRun]) -> Table:
    """Table of all runs; its CSV file has all charges too."""
    columns = [
        Column("case", "case"),
        Column("code", "code"),
        Column("method", "method"),
        Column("setting", "size factor or tolerance", None),
        Column("status", "status"),
        Column("unknowns", "unknowns", 0),
        Column("seconds", "seconds", 3),
        Column("solving_seconds", "without idle estimate (s)", 3),
        Column("repeats", "runs", 0),
        Column("worst_error_percent", "worst error (%)", 6),
        Column("reason", "reason"),
        Column("charges_pC", "charges (pC)", on_page=False),
        Column("estimates_pC", "estimated errors (pC)", on_page=False),
    ]
    return Table("runs", "All runs.", columns, [_run_row(run) for run in runs])


def _run_row(run: TimedRun) -> list[Cell]:
    job, outcome = run.job, run.outcome
    return [
        job.case.name,
        job.code,
        job.method,
        job.setting,
        outcome.status,
        outcome.unknowns,
        run.seconds,
        run.solving,
        run.repeats,
        100.0 * run.error,
        outcome.reason,
        _listed(outcome.charges_pC),
        _listed(outcome.errors_pC),
    ]


def _listed(values: dict[str, float]) -> str:
    return " ".join(f"{name}={value:.12g}" for name, value in values.items())


def reference_table(
    cases: Sequence[BenchmarkCase], references: dict[str, Reference], runs: Sequence[TimedRun]
) -> Table:
    """Table of the references that errors are counted from, and how well they are known."""
    columns = [
        Column("case", "case"),
        Column("scene", "scene"),
        Column("source", "reference from"),
        Column("doubt", "difference of the two", None),
        Column("independent", "from published digits", None),
        Column("peer", "from NGSolve's nearest", None),
        Column("charges_pC", "charges (pC)"),
    ]
    rows: list[list[Cell]] = []
    for case in cases:
        reference = references[case.name]
        theirs = [r.error for r in runs if r.job.case.name == case.name and r.job.code == "NGSolve"]
        nearest = min((e for e in theirs if math.isfinite(e)), default=math.nan)
        charges = " ".join(f"{name} {value:.5g}" for name, value in reference.charges_pC.items())
        numbers = [float(f"{x:.1e}") for x in (reference.doubt, reference.independent, nearest)]
        rows.append([case.name, case.title, reference.source, *numbers, charges])
    caption = "References: charges that errors are counted from (relative differences)."
    return Table("references", caption, columns, rows)


def peer_table(
    cases: Sequence[BenchmarkCase], runs: Sequence[TimedRun], peers: Sequence[str]
) -> Table:
    """Table of the seconds of each code's fastest run within an error, with ratios."""
    columns = [
        Column("case", "case"),
        Column("error", "error within", None),
        Column("ours_seconds", "tolerance, estimate included", 3, OURS),
        Column("ours_solving_seconds", "any mesh", 3, OURS),
    ]
    for peer in peers:
        columns += [
            Column(f"{peer}_method", "method", group=peer),
            Column(f"{peer}_seconds", "seconds", 3, peer),
            Column(f"{peer}_ratio", "ratio to any mesh", 2, peer),
        ]
    rows = [row for case in cases for row in _peer_rows(case, runs, peers)]
    caption = (
        "Seconds of the fastest run within an error, one thread; a ratio above 1: this code is "
        "faster. Any mesh: also uniform ones, without estimate. No entry: no run was within."
    )
    return Table("peers", caption, columns, rows)


def _peer_rows(
    case: BenchmarkCase, runs: Sequence[TimedRun], peers: Sequence[str]
) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for target in TARGETS:
        to_tolerance = fastest(runs, target, case=case.name, code=OURS, method=GOAL)
        any_mesh = fastest(runs, target, case=case.name, code=OURS, solving=True)
        row: list[Cell] = [case.name, target]
        row += [
            to_tolerance.seconds if to_tolerance else None,
            any_mesh.solving if any_mesh else None,
        ]
        for peer in peers:
            best = fastest(runs, target, case=case.name, code=peer)
            row += [best.job.method if best else None, best.seconds if best else None]
            row.append(best.seconds / any_mesh.solving if best and any_mesh else None)
        rows.append(row)
    return rows


def peer_sentences(
    cases: Sequence[BenchmarkCase], runs: Sequence[TimedRun], absent: dict[str, str]
) -> list[str]:
    """Sentences on which code is faster in how many scenes, and on absent peers."""
    sentences = [f"{peer} is absent: {reason}." for peer, reason in absent.items()]
    for peer in peers_of(runs):
        clauses = []
        for target in TARGETS:
            any_mesh, to_tolerance = _ratios(cases, runs, peer, target)
            if not any_mesh:
                clauses.append(f"within {target:g} it has no run to compare")
                continue
            with_estimate = (
                f" ({np.median(to_tolerance):.2g} times a solve to a tolerance)"
                if to_tolerance
                else ""
            )
            clauses.append(
                f"within {target:g} this code is faster in {share_of([r > 1 for r in any_mesh])} "
                f"scenes, {peer} in {share_of([r < 1 for r in any_mesh])}; {peer} takes "
                f"{np.median(any_mesh):.2g} times as long in the median, {min(any_mesh):.2g} to "
                f"{max(any_mesh):.2g} times{with_estimate}"
            )
        sentences.append(f"{peer}: {'; '.join(clauses)}.")
        failed = [r for r in runs if r.job.code == peer and not r.converged]
        if failed:
            sentences.append(
                f"{len(failed)} runs of {peer} failed; the last table has the reasons."
            )
    return sentences


def _ratios(
    cases: Sequence[BenchmarkCase], runs: Sequence[TimedRun], peer: str, target: float
) -> tuple[list[float], list[float]]:
    """The peer's seconds over ours: on any mesh, and of solves to a tolerance."""
    any_mesh, to_tolerances = [], []
    for case in cases:
        theirs = fastest(runs, target, case=case.name, code=peer)
        best = fastest(runs, target, case=case.name, code=OURS, solving=True)
        if theirs and best:
            any_mesh.append(theirs.seconds / best.solving)
        to_tolerance = fastest(runs, target, case=case.name, code=OURS, method=GOAL)
        if theirs and to_tolerance:
            to_tolerances.append(theirs.seconds / to_tolerance.seconds)
    return any_mesh, to_tolerances


def sweep_table(sweeps: Sequence[SweepCost]) -> Table:
    """Table of the seconds of a scene in a sweep and alone."""
    columns = [
        Column("tolerance", "tolerance", None),
        Column("scenes", "scenes", 0),
        Column("solves", "solves", 0),
        Column("failed", "without charges", 0),
        Column("seconds", "seconds of a scene", 4),
        Column("alone", "alone (s)", 4),
        Column("ratio", "alone over in a sweep", 1),
    ]
    rows: list[list[Cell]] = [
        [s.tolerance, s.scenes, s.solves, s.failed, s.seconds, s.alone, s.alone / s.seconds]
        for s in sweeps
    ]
    return Table("sweeps", "Seconds of a scene.", columns, rows)


def sweep_sentences(sweeps: Sequence[SweepCost], runs: Sequence[TimedRun]) -> list[str]:
    """Sentences on how much longer a peer takes for the triangle than a scene of a sweep takes."""
    sentences = []
    for sweep in sweeps:
        for peer in peers_of(runs):
            best = fastest(runs, sweep.tolerance, case="triangle", code=peer)
            if best:
                sentences.append(
                    f"{peer} takes {best.seconds / sweep.seconds:.2g} times as long for the "
                    f"triangle, once, as a scene of the sweep within {sweep.tolerance:g} takes."
                )
    return sentences


def goal_sentences(runs: Sequence[TimedRun]) -> list[str]:
    """Sentence that compares meshes for a tolerance with the best uniform ones."""
    clauses = []
    for target in TARGETS:
        ratios = []
        for name in dict.fromkeys(run.job.case.name for run in runs):
            goal = fastest(runs, target, case=name, code=OURS, method=GOAL)
            uniform = fastest(runs, target, case=name, code=OURS, method=UNIFORM, solving=True)
            if goal and uniform:
                ratios.append(uniform.solving / goal.seconds)
        if ratios:
            clauses.append(
                f"within {target:g} the best uniform mesh (found afterwards, no estimate) takes "
                f"{np.median(ratios):.2g} times as long as a solve to a tolerance (estimate "
                f"included) in the median, {min(ratios):.2g} to {max(ratios):.2g} times"
            )
    return [f"{'; '.join(clauses).capitalize()}."] if clauses else []


def tolerance_table(runs: Sequence[TimedRun]) -> Table:
    """Table of seconds and true errors by tolerance."""
    columns = [
        Column("tolerance", "tolerance", None),
        Column("scenes", "scenes", 0),
        Column("met", "within", 0),
        Column("failed", "failed", 0),
        Column("worst_over_tolerance", "worst error / tolerance", 2),
        Column("median_seconds", "median seconds", 3),
        Column("worst_seconds", "largest seconds", 3),
    ]
    rows: list[list[Cell]] = []
    for tolerance in sorted({run.job.setting for run in runs}, reverse=True):
        at_tolerance = [run for run in runs if run.job.setting == tolerance]
        converged = [run for run in at_tolerance if run.converged]
        if converged:
            seconds = [run.seconds for run in converged]
            worst = max(run.error for run in converged)
            within = sum(run.error <= tolerance for run in converged)
            row: list[Cell] = [
                tolerance,
                len(at_tolerance),
                within,
                len(at_tolerance) - len(converged),
            ]
            rows.append([*row, worst / tolerance, float(np.median(seconds)), max(seconds)])
    return Table("tolerances", "Solves to a tolerance, this code's default order.", columns, rows)


def effectivity_sentences(ratios: dict[str, list[float]]) -> list[str]:
    """Sentence on the shares of estimates between 0.3 and 3 times the true error."""
    clauses = []
    for method, values in sorted(ratios.items()):
        inside = [0.3 <= value <= 3.0 for value in values]
        clauses.append(f"{method}: {share_of(inside)} (median {np.median(values):.2f})")
    return [f"Between 0.3 and 3: {'; '.join(clauses)}."] if clauses else []


def growth_table(sizes: Iterable[Size]) -> Table:
    """Table of seconds and memory by unknowns."""
    columns = [
        Column("unknowns", "unknowns", 0),
        Column("status", "status"),
        Column("mesh_seconds", "mesh (s)", 2),
        Column("solve_seconds", "solve (s)", 2),
        Column("estimate_seconds", "estimate (s)", 2),
        Column("total_seconds", "total (s)", 2),
        Column("memory_MiB", "memory (MiB)", 0),
    ]
    rows: list[list[Cell]] = []
    for size in sizes:
        seconds = size.seconds or {}
        stages = [seconds.get(stage) for stage in ("mesh", "solve", "estimate", "total")]
        rows.append([size.unknowns, size.status, *stages, size.memory_MiB])
    return Table("growth", "One solve of order 2, off-centre triangle.", columns, rows)


def stage_table(shares: dict[str, dict[str, float]], names: Sequence[str]) -> Table:
    """Table of seconds by stage."""
    columns = [Column("case", "case, tolerance")]
    columns += [Column(f"{name}_seconds", f"{name} (s)", 3) for name in (*names, "total")]
    rows: list[list[Cell]] = [
        [key, *(seconds.get(name) for name in (*names, "total"))] for key, seconds in shares.items()
    ]
    return Table("stages", "Seconds by stage, one run each.", columns, rows)


def exponent(sizes: Sequence[Size]) -> float:
    """Slope of log seconds over log unknowns; NaN from fewer than two solves."""
    solved = [size for size in sizes if size.seconds]
    if len(solved) < 2:
        return math.nan
    x = np.log([size.unknowns for size in solved])
    y = np.log([(size.seconds or {})["total"] for size in solved])
    return float(np.polyfit(x, y, 1)[0])
