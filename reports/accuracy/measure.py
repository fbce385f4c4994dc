"""Measurements of the report: solves with their processor seconds, and the cost of a sweep."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from typing import Any

from pvdf_fem import Scene, solve
from pvdf_fem.batch.batch import plan_scenes, solve_planned
from pvdf_fem.problem.problem import Problem
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.solver.first_sizes import choose_first_sizes
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.studies.scene_grid import SceneGrid
from reports.accuracy.cases import compute_known_charges

MAX_SECONDS = 2.0  #: Processor seconds after which a solve is not repeated.
STAGES = ("mesh", "solve", "estimate")


@dataclass(frozen=True)
class TimedSolve(Task):
    """A scene solved up to `rounds` times.

    A row for each electrode has the medians of the processor seconds, in total and by stage. A
    solve without charges has one row.
    """

    scene: Scene
    rounds: int = 1

    def run(self) -> Rows:
        """Solve until the rounds or `MAX_SECONDS` are over."""
        solve(WARM_UP_SCENE)  # the first solve of a process takes the time of imports
        seconds: list[float] = []
        stages: list[dict[str, float]] = []
        while len(seconds) < self.rounds and sum(seconds) <= MAX_SECONDS:
            start = time.process_time()
            solution = solve(self.scene)
            seconds.append(time.process_time() - start)
            # the stages are in wall time, which includes waiting
            busy_share = seconds[-1] / solution.seconds["total"]
            stages.append({name: busy_share * value for name, value in solution.seconds.items()})
        run: dict[str, Any] = {
            "status": str(solution.status),
            "seconds": statistics.median(seconds),
            "unknowns": solution.unknowns,
        }
        for name in STAGES:
            run[name] = statistics.median([values.get(name, 0.0) for values in stages])
        if solution.status is not Status.CONVERGED:
            return [run]
        rows = []
        for name, charge in solution.charges_pC.items():
            stated = solution.charge_errors_pC[name]
            rows.append({**run, "electrode": name, "charge_pC": charge, "stated_pC": stated})
        return rows


#: The scene that is solved first, for imports and caches.
WARM_UP_SCENE = Scene().with_(**{"probe.shape": "circle", "numerics.tolerance": 1e-2})


@dataclass(frozen=True)
class KnownCharges(Task):
    """Charges of a scene from a closed form or a one-dimensional problem."""

    scene: Scene
    truth: str

    def run(self) -> Rows:
        """Return a row for each electrode."""
        charges = compute_known_charges(self.truth, self.scene)
        return [{"electrode": name, "charge_pC": charge} for name, charge in charges.items()]


@dataclass(frozen=True)
class NGSolveRuns(Task):
    """A scene solved by NGSolve in `orders`, on meshes with this package's sizes times `factors`.

    NGSolve runs in a process of its own: gmsh and NGSolve each bring their own OpenCASCADE.
    """

    scene: Scene
    orders: tuple[int, ...]
    factors: tuple[float, ...]
    rounds: int = 1

    def run(self) -> Rows:
        """Return a row for each order, factor and electrode."""
        sizes = choose_first_sizes(
            Problem.from_scene(self.scene.with_(**{"numerics.tolerance": 1e-3})), 2
        )
        job = {
            "scene": self.scene.to_toml(),
            "orders": self.orders,
            "rounds": self.rounds,
            "meshes": [asdict(sizes.scale(factor)) for factor in self.factors],
        }
        ended = subprocess.run(
            [sys.executable, "-m", "reports.accuracy.ngsolve_peer"],
            input=json.dumps(job),
            capture_output=True,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1", "NGS_NUM_THREADS": "1"},
            check=False,
        )
        if ended.returncode != 0:
            last = ended.stderr.strip().splitlines()[-1:] or [f"exit code {ended.returncode}"]
            raise RuntimeError(f"NGSolve: {last[0]}")
        # NGSolve may print other lines before the answer
        rows: Rows = json.loads(ended.stdout.strip().splitlines()[-1])
        return rows


@dataclass(frozen=True)
class SweepTimes(Task):
    """The times of a sweep over places of the probe on a line, forces, and rings of electrodes.

    There are 25 scenes for each place. Mirrored places share solves, and so do all rings.
    """

    scene: Scene
    places: int
    alone: int = 10  #: Approximate number of scenes that are solved one by one.

    def run(self) -> Rows:
        """Return one row.

        It has the numbers of scenes and solves, the processor seconds of a scene in the sweep, and
        their median alone.
        """
        axes: list[dict[str, Any]] = [
            {"probe.x_mm": {"start": -12.0, "stop": 12.0, "count": self.places}},
            {"load.force_N": [0.25, 0.5, 1.0, 2.0, 5.0]},
            {"electrodes.ring_radius_mm": [6.0, 8.0, 10.0, 12.0, 14.0]},
        ]
        scenes = list(SceneGrid.from_tables(self.scene, axes).scenes())
        start = time.process_time()
        plan = plan_scenes(scenes)
        records = [record for _, record in solve_planned(plan, processes=1)]
        seconds = (time.process_time() - start) / len(scenes)
        step = max(len(scenes) // self.alone, 1)
        alone = [_measure_solve(scene) for scene in scenes[::step]]
        row = {
            "scenes": len(scenes),
            "solves": len(plan.blocks),
            "failed": sum(not record.converged for record in records),
            "seconds": seconds,
            "alone": statistics.median(alone),
        }
        return [row]


def _measure_solve(scene: Scene) -> float:
    """Return the processor seconds of a solve."""
    start = time.process_time()
    solve(scene)
    return time.process_time() - start
