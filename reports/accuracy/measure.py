"""What the report measures: solves with their processor seconds, and what a sweep costs."""

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
from reports.accuracy.cases import known_charges

LONGEST = 2.0  #: Processor seconds after which a solve is not repeated.
STAGES = ("mesh", "solve", "estimate")


@dataclass(frozen=True)
class Timed(Task):
    """A scene solved up to `rounds` times: a row for each electrode, with the medians of processor
    seconds, in total and by stage. A solve without charges is one row."""

    scene: Scene
    rounds: int = 1

    def run(self) -> Rows:
        """Solve until the rounds or `LONGEST` are over. The first solve of a process would have
        imports in its time, so another scene is solved before."""
        solve(WARM)
        seconds: list[float] = []
        stages: list[dict[str, float]] = []
        while len(seconds) < self.rounds and sum(seconds) <= LONGEST:
            start = time.process_time()
            solution = solve(self.scene)
            seconds.append(time.process_time() - start)
            busy = seconds[-1] / solution.seconds["total"]  # of the wall time, which has waits
            stages.append({name: busy * of for name, of in solution.seconds.items()})
        about: dict[str, Any] = {
            "status": str(solution.status),
            "seconds": statistics.median(seconds),
            "unknowns": solution.unknowns,
            **{name: statistics.median(of.get(name, 0.0) for of in stages) for name in STAGES},
        }
        if solution.status is not Status.CONVERGED:
            return [about]
        charges, errors = solution.charges_pC, solution.charge_errors_pC
        return [
            {**about, "electrode": name, "charge_pC": charge, "stated_pC": errors[name]}
            for name, charge in charges.items()
        ]


#: What imports and caches are filled by.
WARM = Scene().with_(**{"probe.shape": "circle", "numerics.tolerance": 1e-2})


@dataclass(frozen=True)
class Known(Task):
    """Charges of a scene that are known by a closed form or in one dimension."""

    scene: Scene
    truth: str

    def run(self) -> Rows:
        """A row for each electrode."""
        charges = known_charges(self.truth, self.scene)
        return [{"electrode": name, "charge_pC": charge} for name, charge in charges.items()]


@dataclass(frozen=True)
class ByNGSolve(Task):
    """A scene solved by NGSolve in orders and on meshes of this package's first sizes times
    factors, in a process of its own: gmsh and NGSolve each bring their own OpenCASCADE."""

    scene: Scene
    orders: tuple[int, ...]
    factors: tuple[float, ...]
    rounds: int = 1

    def run(self) -> Rows:
        """A row for each order, factor and electrode."""
        sizes = choose_first_sizes(
            Problem.from_scene(self.scene.with_(**{"numerics.tolerance": 1e-3})), 2
        )
        job = {
            "scene": self.scene.to_toml(),
            "orders": self.orders,
            "rounds": self.rounds,
            "meshes": [asdict(sizes.scaled(factor)) for factor in self.factors],
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
class Swept(Task):
    """25 scenes for each place of a probe on a line: forces, and rings of electrodes. Places that
    are mirror images, and all rings, share solves."""

    scene: Scene
    places: int
    alone: int = 10  #: About the number of scenes that are solved one by one.

    def run(self) -> Rows:
        """One row: numbers of scenes and solves, and processor seconds of a scene in the sweep, and
        in the median alone."""
        axes: list[dict[str, Any]] = [
            {"probe.x_mm": {"start": -12.0, "stop": 12.0, "count": self.places}},
            {"load.force_N": [0.25, 0.5, 1.0, 2.0, 5.0]},
            {"electrodes.ring_radius_mm": [6.0, 8.0, 10.0, 12.0, 14.0]},
        ]
        scenes = list(SceneGrid.from_tables(self.scene, axes).scenes())
        plan, start = plan_scenes(scenes), time.process_time()
        failed = sum(not record.converged for _, record in solve_planned(plan, processes=1))
        seconds = (time.process_time() - start) / len(scenes)
        singly = [_seconds(scene) for scene in scenes[:: max(len(scenes) // self.alone, 1)]]
        counts = {"scenes": len(scenes), "solves": len(plan.blocks), "failed": failed}
        return [{**counts, "seconds": seconds, "alone": statistics.median(singly)}]


def _seconds(scene: Scene) -> float:
    start = time.process_time()
    solve(scene)
    return time.process_time() - start
