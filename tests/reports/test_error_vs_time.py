"""The report on error against run time: its references, its bookkeeping, and a quick run."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.solution.first_sizes import first_sizes
from reports import benchmark
from reports.speed import peer_calculix, peer_ngsolve, peers, stages
from reports.speed.cases import (
    CASES,
    INDEPENDENT,
    ROUND_CASES,
    BenchmarkCase,
    Reference,
    worst_error,
)
from reports.speed.peer_calculix import solve_calculix
from reports.speed.runs import Job, Outcome, TimedRun, effectivities, fastest, solve_uniform, timed
from reports.speed.sweep_cost import sweep_cost
from reports.speed.workload import QUICK
from tests.reports.test_page import assert_links_work

TRIANGLE = next(case for case in CASES if case.name == "triangle")


def test_there_are_enough_cases_and_both_observables() -> None:
    assert len(CASES) >= 8
    assert {case.scene.numerics.observable for case in CASES} == {"material", "thesis-edge"}
    assert {case.scene.load.kind for case in CASES} == {"dead", "follower", "rigid"}


@pytest.mark.parametrize("case", ROUND_CASES, ids=lambda case: case.name)
def test_closed_forms_and_finite_elements_agree(case: BenchmarkCase) -> None:
    assert case.exact is not None
    charges = solve(case.scene.with_(**{"numerics.tolerance": 1e-5})).charges_pC
    assert worst_error(charges, case.exact(case.scene)) < 3e-5


def _job(method: str, outcomes: list[Outcome], case: BenchmarkCase = TRIANGLE) -> Job:
    return Job(case, "code", method, 1.0, iter(outcomes).__next__)


def _outcome(seconds: float, charge: float = 101.0) -> Outcome:
    stages = {"mesh": 0.0, "estimate": 0.25 * seconds, "total": seconds}
    return Outcome("converged", "", {"A": charge}, {"A": 2.0}, 10, stages)


REFERENCE = Reference({"A": 100.0}, 1e-6, "made up")


def test_jobs_are_interleaved_and_medians_kept() -> None:
    order: list[str] = []

    def job(name: str, seconds: list[float]) -> Job:
        remaining = iter(seconds)

        def run() -> Outcome:
            order.append(name)
            return _outcome(next(remaining))

        return Job(TRIANGLE, "code", name, 1.0, run)

    jobs = [job("uniform", [0.1, 0.3, 0.2]), job("slow", [2.0]), job("tolerance", [0.4, 0.4])]
    fast, slow, goal = timed(jobs, REFERENCE, rounds=3, budget=1.0, tick=lambda: None)
    assert order == ["uniform", "slow", "tolerance", "uniform", "tolerance", "uniform"]
    assert (fast.seconds, fast.repeats) == (0.2, 3)
    assert fast.solving == pytest.approx(0.15)
    assert goal.solving == goal.seconds == 0.4
    assert (slow.seconds, slow.repeats) == (2.0, 1)
    assert slow.error == pytest.approx(0.01)


def test_a_run_that_raises_or_fails_keeps_its_reason() -> None:
    def broken() -> Outcome:
        raise ValueError("no such luck")

    jobs = [
        Job(TRIANGLE, "code", "raises", 1.0, broken),
        _job("fails", [Outcome("max_iterations", "too hard")]),
        _job("fails later", [_outcome(0.1), Outcome("unstable", "odd")]),
    ]
    runs = timed(jobs, REFERENCE, rounds=2, budget=1.0, tick=lambda: None)
    assert [run.outcome.status for run in runs] == ["crashed", "max_iterations", "unstable"]
    assert "no such luck" in runs[0].outcome.reason
    assert all(math.isnan(run.error) and not run.converged for run in runs)
    assert fastest(runs, 1.0) is None


def test_the_fastest_is_chosen_among_those_within_the_error() -> None:
    def run(name: str, seconds: float, error: float) -> TimedRun:
        return TimedRun(_job(name, []), _outcome(seconds), seconds, seconds, 1, error)

    runs = [run("rough", 0.1, 1e-2), run("good", 0.5, 1e-4), run("best", 2.0, 1e-6)]
    assert fastest(runs, 1e-3) is runs[1]
    assert fastest(runs, 1e-7) is None
    assert fastest(runs, 1e-3, method="best") is runs[2]
    assert fastest(runs, 1e-3, case="triangle", code="code", solving=True) is runs[1]
    assert fastest(runs, 1e-3, case="rectangle") is None
    assert fastest(runs, 1e-3, code="another") is None


def test_effectivity_leaves_out_what_the_reference_cannot_tell() -> None:
    def run(charge: float) -> TimedRun:
        return TimedRun(_job("m", []), _outcome(1.0, charge), 1.0, 1.0, 1, 0.0)

    references = {"triangle": REFERENCE}
    assert effectivities([run(101.0), run(100.0005)], references) == {"m": [2.0]}


def test_uniform_families_share_their_meshes() -> None:
    coarse, fine = (solve_uniform(TRIANGLE.scene, 1, factor) for factor in (2.0, 1.0))
    assert coarse.unknowns < fine.unknowns
    truth = INDEPENDENT["triangle"]
    assert worst_error(fine.charges_pC, truth) < worst_error(coarse.charges_pC, truth)
    assert fine.seconds["total"] >= fine.seconds["mesh"] + fine.seconds["solve"]


def test_stages_add_up() -> None:
    seconds = stages.stages(TRIANGLE.scene.with_(**{"numerics.tolerance": 1e-2}))
    assert sum(seconds[name] for name in stages.STAGES) == pytest.approx(seconds["total"])
    assert min(seconds.values()) > 0.0


def test_absent_peers_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses() -> None:
        raise RuntimeError("not there")

    monkeypatch.setattr(peer_ngsolve, "Worker", refuses)
    monkeypatch.setattr(peer_calculix, "PROGRAM", "no such program")
    present = peers.Peers()
    assert present.versions == {}
    assert present.absent["NGSolve"] == "not there"
    assert "calculix-ccx" in present.absent["CalculiX"]
    assert present.jobs(TRIANGLE, {2: (1.0,)}, QUICK.calculix, close=True) == []
    present.close()


@pytest.mark.skipif(find_spec("ngsolve") is not None, reason="NGSolve is installed")
def test_the_worker_says_that_ngsolve_is_missing() -> None:
    with pytest.raises(RuntimeError, match="NGSolve is not installed"):
        peer_ngsolve.Worker()


@pytest.mark.skipif(find_spec("ngsolve") is None, reason="NGSolve is not installed")
def test_ngsolve_agrees_and_survives_a_scene_that_it_cannot_solve() -> None:
    sizes = first_sizes(TRIANGLE.scene, 2)
    stuck = TRIANGLE.scene.with_(**{"load.kind": "rigid", "load.contact": "stuck"})
    worker = peer_ngsolve.Worker()
    try:
        refused = worker.solve(stuck, 3, sizes.patches, sizes.film)
        answer = worker.solve(TRIANGLE.scene, 3, sizes.patches, sizes.film)
    finally:
        worker.close()
    assert refused["status"] == "crashed"
    assert "sticking punch" in refused["reason"]
    assert worst_error(answer["charges_pC"], INDEPENDENT["triangle"]) < 1e-4


def test_calculix_refuses_what_it_cannot_do() -> None:
    outcome = solve_calculix(Scene.parse('[load]\nkind = "rigid"'), "S6", 1.0, 1.0)
    assert outcome.status == "not done"
    assert "not rigid" in outcome.reason


def test_calculix_results_are_read_only_from_a_finished_step() -> None:
    head = "\n displacements (vx,vy,vz) for set ALL and time  {}\n\n"
    rows = "         1  1.0E+00  2.0E+00  3.0E+00\n         2  4.0E+00  5.0E+00  6.0E+00\n"
    finished = head.format("0.1E+01") + rows.replace("1.0E", "9.0E") + head.format("0.2E+01") + rows
    moved = peer_calculix._last_displacements(finished, 2)
    assert moved is not None
    assert moved.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert peer_calculix._last_displacements(head.format("0.15E+01") + rows, 2) is None
    assert peer_calculix._last_displacements("", 2) is None


def test_the_quick_report_end_to_end(tmp_path: Path) -> None:
    """As a user runs it."""
    command = [
        sys.executable,
        "-m",
        "reports.error_vs_time",
        "--quick",
        "--quiet",
        "--out",
        str(tmp_path),
    ]
    ended = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    page = assert_links_work(tmp_path / "index.html")
    assert "This section failed" not in page.text
    for name in ("NGSolve", "CalculiX"):
        assert name in page.text
    with (tmp_path / "runs.csv").open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["code"] == "pvdf_fem"]
    assert rows
    assert all(row["status"] == "converged" for row in rows)
    assert all(0.0 < float(row["worst_error_percent"]) < 1.0 for row in rows)


def test_the_benchmark_compares_with_an_earlier_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "medians.json"
    arguments = ["--rounds", "1", "--case", "rectangle"]
    assert benchmark.main([*arguments, "--save", str(file)]) == 0
    saved = json.loads(file.read_text())
    saved["medians"] = {name: 1e-9 for name in saved["medians"]}
    file.write_text(json.dumps(saved))
    capsys.readouterr()
    assert benchmark.main([*arguments, "--against", str(file)]) == 0
    assert "times the earlier" in capsys.readouterr().out


def test_a_sweep_costs_less_than_its_scenes() -> None:
    cost = sweep_cost(2e-2, places=2)
    assert (cost.scenes, cost.solves, cost.failed) == (50, 5, 0)
    assert cost.seconds < cost.alone
