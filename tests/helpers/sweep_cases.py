"""A sweep with made-up solves, for tests that interrupt it; in a module for other processes."""

from __future__ import annotations

import time
from pathlib import Path

import xarray

from pvdf_fem import Scene
from pvdf_fem.sweeps import sweep
from pvdf_fem.sweeps.store import Record, Store, key

BASE = Scene().with_(**{"probe.shape": "triangle", "numerics.tolerance": 0.05})
AXES = [
    {"load.force_N": [0.5, 1.0, 2.0]},
    {"probe.x_mm": {"start": 0.0, "stop": 9.0, "count": 8}},
    {"electrodes.ring_radius_mm": [8.0, 12.0]},
]


def made_up(scenes, frames):
    """Records that tell their scenes apart."""
    found = []
    for scene in scenes:
        value = scene.load.force_N * (1.0 + scene.probe.x_mm) / scene.electrodes.ring_radius_mm
        forces = {"material": [[value, 2.0 * value]] * 4}
        found.append(Record("converged", "", tuple("ABCD"), forces, forces, value, 1, 1, (), 0.0))
    return found


def run(store: Path, log: Path | None = None, pause: float = 0.0) -> xarray.Dataset:
    """The sweep; each solve adds a line with its scenes to the log."""

    def solved(scenes, frames):
        time.sleep(pause)
        if log is not None:
            with log.open("a") as file:
                file.write(" ".join(map(key, scenes)) + "\n")
        return made_up(scenes, frames)

    sweep.records_of = solved
    with Store(store) as kept:
        return sweep.sweep(BASE, AXES, kept, processes=1)
