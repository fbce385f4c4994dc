"""Tables and sentences of the report on error against run time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from reports.common.page import Cell, Column, Table
from reports.speed.cases import Case, Reference
from reports.speed.growth import Size
from reports.speed.runs import GOAL, OURS, Run, fastest
from reports.speed.sweep_cost import SweepCost

TARGETS = (1e-3, 1e-4, 1e-5)


def share_of(flags: Sequence[bool]) -> str:
    """``7 of 9``."""
    return f"{sum(flags)} of {len(flags)}"


def run_table(runs: Sequence[Run]) -> Table:
    """Every run, in the CSV with all charges."""
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


def _run_row(run: Run) -> list[Cell]:
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
    cases: Sequence[Case], references: dict[str, Reference], runs: Sequence[Run]
) -> Table:
    """What the errors are counted from, and how well it is known."""
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
        known = references[case.name]
        theirs = [r.error for r in runs if r.job.case.name == case.name and r.job.code == "NGSolve"]
        nearest = min((e for e in theirs if math.isfinite(e)), default=math.nan)
        charges = " ".join(f"{name} {value:.5g}" for name, value in known.charges_pC.items())
        numbers = [float(f"{x:.1e}") for x in (known.doubt, known.independent, nearest)]
        rows.append([case.name, case.title, known.source, *numbers, charges])
    caption = "References: charges that errors are counted from (relative differences)."
    return Table("references", caption, columns, rows)


def peer_table(cases: Sequence[Case], runs: Sequence[Run], peers: Sequence[str]) -> Table:
    """Seconds of the fastest run of each code within an error, and ratios."""
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


def _peer_rows(case: Case, runs: Sequence[Run], peers: Sequence[str]) -> list[list[Cell]]:
    mine = [run for run in runs if run.job.case.name == case.name]
    ours = [run for run in mine if run.job.code == OURS]
    rows: list[list[Cell]] = []
    for target in TARGETS:
        full = fastest((run for run in ours if GOAL in run.job.method), target)
        bare = fastest(ours, target, solving=True)
        row: list[Cell] = [case.name, target]
        row += [full.seconds if full else None, bare.solving if bare else None]
        for peer in peers:
            best = fastest((run for run in mine if run.job.code == peer), target)
            row += [best.job.method if best else None, best.seconds if best else None]
            row.append(best.seconds / bare.solving if best and bare else None)
        rows.append(row)
    return rows


def peer_sentences(cases: Sequence[Case], runs: Sequence[Run], absent: dict[str, str]) -> list[str]:
    """Who is faster where, in numbers; absent peers are told."""
    told = [f"{peer} is absent: {reason}." for peer, reason in absent.items()]
    for peer in dict.fromkeys(run.job.code for run in runs if run.job.code != OURS):
        parts = []
        for target in TARGETS:
            bare, full = _ratios(cases, runs, peer, target)
            if not bare:
                parts.append(f"within {target:g} it has no run to compare")
                continue
            with_estimate = f" ({np.median(full):.2g} times a solve to a tolerance)" if full else ""
            parts.append(
                f"within {target:g} this code is faster in {share_of([r > 1 for r in bare])} "
                f"scenes, {peer} in {share_of([r < 1 for r in bare])}; {peer} takes "
                f"{np.median(bare):.2g} times as long in the median, {min(bare):.2g} to "
                f"{max(bare):.2g} times{with_estimate}"
            )
        told.append(f"{peer}: {'; '.join(parts)}.")
        lost = [r for r in runs if r.job.code == peer and not r.converged]
        if lost:
            told.append(f"{len(lost)} runs of {peer} failed; the last table has the reasons.")
    return told


def _ratios(
    cases: Sequence[Case], runs: Sequence[Run], peer: str, target: float
) -> tuple[list[float], list[float]]:
    """The peer's seconds over ours: on any mesh, and of solves to a tolerance."""
    bare, full = [], []
    for case in cases:
        mine = [run for run in runs if run.job.case.name == case.name]
        ours = [run for run in mine if run.job.code == OURS]
        theirs = fastest((run for run in mine if run.job.code == peer), target)
        best = fastest(ours, target, solving=True)
        if theirs and best:
            bare.append(theirs.seconds / best.solving)
        to_tolerance = fastest((run for run in ours if GOAL in run.job.method), target)
        if theirs and to_tolerance:
            full.append(theirs.seconds / to_tolerance.seconds)
    return bare, full


def sweep_table(sweeps: Sequence[SweepCost]) -> Table:
    """Seconds of a scene in a sweep and alone."""
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


def sweep_sentences(sweeps: Sequence[SweepCost], runs: Sequence[Run]) -> list[str]:
    """How much longer a peer takes for the triangle alone than a scene of the sweep takes."""
    told = []
    for sweep in sweeps:
        mine = [run for run in runs if run.job.case.name == "triangle"]
        for peer in dict.fromkeys(run.job.code for run in mine if run.job.code != OURS):
            best = fastest((run for run in mine if run.job.code == peer), sweep.tolerance)
            if best:
                told.append(
                    f"{peer} takes {best.seconds / sweep.seconds:.2g} times as long for the "
                    f"triangle, once, as a scene of the sweep within {sweep.tolerance:g} takes."
                )
    return told


def goal_sentences(runs: Sequence[Run]) -> list[str]:
    """Whether meshes for the tolerance pay, against uniform ones of the same order."""
    told = []
    for target in TARGETS:
        ratios = []
        for name in dict.fromkeys(run.job.case.name for run in runs):
            mine = [r for r in runs if r.job.case.name == name and r.job.code == OURS]
            goal = fastest((r for r in mine if GOAL in r.job.method), target)
            flat = fastest((r for r in mine if GOAL not in r.job.method), target, solving=True)
            if goal and flat:
                ratios.append(flat.solving / goal.seconds)
        if ratios:
            told.append(
                f"within {target:g} the best uniform mesh (found afterwards, no estimate) takes "
                f"{np.median(ratios):.2g} times as long as a solve to a tolerance (estimate "
                f"included) in the median, {min(ratios):.2g} to {max(ratios):.2g} times"
            )
    return [f"{'; '.join(told).capitalize()}."] if told else []


def tolerance_table(runs: Sequence[Run]) -> Table:
    """Seconds and true errors by tolerance."""
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
        some = [run for run in runs if run.job.setting == tolerance]
        good = [run for run in some if run.converged]
        if good:
            seconds = [run.seconds for run in good]
            worst = max(run.error for run in good)
            within = sum(run.error <= tolerance for run in good)
            row: list[Cell] = [tolerance, len(some), within, len(some) - len(good)]
            rows.append([*row, worst / tolerance, float(np.median(seconds)), max(seconds)])
    return Table("tolerances", "Solves to a tolerance, this code's default order.", columns, rows)


def effectivity_sentences(found: dict[str, list[float]]) -> list[str]:
    """Shares of estimates between 0.3 and 3 times the true error."""
    told = []
    for method, values in sorted(found.items()):
        inside = [0.3 <= value <= 3.0 for value in values]
        told.append(f"{method}: {share_of(inside)} (median {np.median(values):.2f})")
    return [f"Between 0.3 and 3: {'; '.join(told)}."] if told else []


def growth_table(sizes: Iterable[Size]) -> Table:
    """Seconds and memory by unknowns."""
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
    """Seconds by stage."""
    columns = [Column("case", "case, tolerance")]
    columns += [Column(f"{name}_seconds", f"{name} (s)", 3) for name in (*names, "total")]
    rows: list[list[Cell]] = [
        [key, *(seconds.get(name) for name in (*names, "total"))] for key, seconds in shares.items()
    ]
    return Table("stages", "Seconds by stage, one run each.", columns, rows)


def exponent(sizes: Sequence[Size]) -> float:
    """Slope of log seconds over log unknowns; NaN from fewer than two solves."""
    good = [size for size in sizes if size.seconds]
    if len(good) < 2:
        return math.nan
    x = np.log([size.unknowns for size in good])
    y = np.log([(size.seconds or {})["total"] for size in good])
    return float(np.polyfit(x, y, 1)[0])
