"""What a scene costs in a sweep, beside the same scenes solved one by one.

200 scenes of the triangle: places along a line, forces, and rings of electrodes. The rings share
the solves, and so do places that are mirror images of each other.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from typing import Any

from pvdf_fem import Scene, solve
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.grid import Grid
from pvdf_fem.sweeps.sweep import planned, records


@dataclass(frozen=True)
class SweepCost:
    """Cost of a scene in a sweep.

    Attributes
    ----------
    tolerance : float
    scenes, solves, failed : int
        Numbers of scenes, of distinct solves, and of scenes without charges.
    seconds : float
        Seconds of a scene in the sweep.
    alone : float
        Median seconds of the same scenes solved one by one.
    """

    tolerance: float
    scenes: int
    solves: int
    failed: int
    seconds: float
    alone: float


def sweep_cost(tolerance: float, places: int = 8, alone: int = 10) -> SweepCost:
    """Sweep ``25 places`` scenes in this process, and solve about `alone` of them one by one."""
    scene = Scene().with_(**{"probe.shape": "triangle", "numerics.tolerance": tolerance})
    axes: list[dict[str, Any]] = [
        {"probe.x_mm": {"start": -12.0, "stop": 12.0, "count": places}},
        {"load.force_N": [0.25, 0.5, 1.0, 2.0, 5.0]},
        {"electrodes.ring_radius_mm": [6.0, 8.0, 10.0, 12.0, 14.0]},
    ]
    scenes = list(Grid.of(scene, axes).scenes())
    plan = planned(scenes)
    start = time.perf_counter()
    swept = [record for _, record in records(plan, processes=1)]
    seconds = (time.perf_counter() - start) / len(scenes)
    single_seconds = []
    for single in scenes[:: max(len(scenes) // alone, 1)]:
        start = time.perf_counter()
        solve(single)
        single_seconds.append(time.perf_counter() - start)
    failed = sum(record.status != Status.CONVERGED for record in swept)
    return SweepCost(
        tolerance, len(scenes), len(plan.blocks), failed, seconds, statistics.median(single_seconds)
    )
