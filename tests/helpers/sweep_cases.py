"""A sweep with made-up solves, for tests that interrupt it in processes of their own."""

from __future__ import annotations

import time
from pathlib import Path
from unittest import mock

import xarray

from pvdf_fem import Scene
from pvdf_fem.batch import batch
from pvdf_fem.batch.keys import make_record_key
from pvdf_fem.batch.store import Record
from pvdf_fem.studies.sweep import sweep

BASE = Scene().with_(**{"probe.shape": "triangle", "numerics.tolerance": 0.05})
AXES = [
    {"load.force_N": [0.5, 1.0, 2.0]},
    {"probe.x_mm": {"start": 0.0, "stop": 9.0, "count": 8}},
    {"electrodes.ring_radius_mm": [8.0, 12.0]},
]


def made_up(scenes, frames):
    """Records with charges that differ from scene to scene."""
    records = []
    for scene in scenes:
        value = scene.load.force_N * (1.0 + scene.probe.x_mm) / scene.electrodes.ring_radius_mm
        forces = {"material": [[value, 2.0 * value]] * 4}
        records.append(Record("converged", "", tuple("ABCD"), forces, forces, value))
    return records


def run(store: Path, log: Path | None = None, pause: float = 0.0) -> xarray.Dataset:
    """The sweep; each solve adds a line with the keys of its scenes to the log."""

    def solved(scenes, frames):
        time.sleep(pause)
        if log is not None:
            with log.open("a") as file:
                file.write(" ".join(map(make_record_key, scenes)) + "\n")
        return made_up(scenes, frames)

    with mock.patch.object(batch, "make_records", solved):
        return sweep(BASE, AXES, store, processes=1)
