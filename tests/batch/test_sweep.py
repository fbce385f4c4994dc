"""Sweeps: datasets, and what survives kills, deaths of workers and failures."""

from __future__ import annotations

import math
import multiprocessing
import random
import subprocess
import sys
import time
from pathlib import Path

import joblib
import numpy as np
import pytest
import xarray

from pvdf_fem import solve
from pvdf_fem.batch import batch
from pvdf_fem.batch.keys import make_record_key
from pvdf_fem.batch.store import Record, Store
from pvdf_fem.batch.workers import ClusterLostError, WorkerDied, run_on_processes
from pvdf_fem.studies.scene_grid import SceneGrid
from pvdf_fem.studies.sweep import sweep
from pvdf_fem.studies.sweep_axis import RESERVED_NAMES
from pvdf_fem.view.files.netcdf import write_netcdf
from tests.conftest import Run
from tests.helpers import deaths
from tests.helpers.sweep_cases import AXES, BASE, made_up, run

ROOT = Path(__file__).parents[2]
PATIENCE_S = 120.0  #: Time in which processes end on any machine.
AGAIN = multiprocessing.get_context("forkserver")
AGAIN.set_forkserver_preload(["tests.helpers.sweep_cases", "pvdf_fem.studies.sweep_dataset"])


@pytest.fixture
def invented(monkeypatch):
    monkeypatch.setattr(batch, "make_records", made_up)


def test_every_key_along_an_axis_is_a_coordinate(invented, tmp_path):
    """By its last part, or in full where that is the name of another axis."""
    expected = {"x_mm": "probe.x_mm", "probe_y_mm": "probe.y_mm", "y_mm": "load.force_N"}
    axes = [{"probe.x_mm": [0.0, 1.0], "probe.y_mm": [2.0, 3.0], "name": "place"}]
    axes += [{"load.force_N": [1.0, 2.0], "name": "y_mm"}]
    varied = {key: values for axis in axes for key, values in axis.items()}
    for given in (axes, axes[::-1]):
        data = sweep(BASE, given, processes=1)
        assert {*data.coords} == {*expected, "electrode"}
        for name, scene_key in expected.items():
            text, _, unit = scene_key.rpartition("_")
            attributes = {"key": scene_key, "long_name": text.replace(".", " "), "units": unit}
            assert data[name].attrs == attributes
            assert data[name].values.tolist() == varied[scene_key]
        write_netcdf(data, tmp_path / "data.nc")
        with xarray.open_dataset(tmp_path / "data.nc") as read:
            assert read.identical(data)


def test_the_dataset_s_own_names_are_those_that_axes_may_not_have(invented):
    data = sweep(BASE.with_(readout={}), [{"load.force_N": [1.0]}], processes=1)
    assert {*data.variables, *data.dims} - {"force_N"} == RESERVED_NAMES


def test_a_dataset_has_the_charges_of_each_scene_in_its_place():
    """Real solves: charges as those of a scene solved alone, by name and in its place."""
    axes = [
        {"film.thickness_um": [25, 50], "load.force_N": [1, 2], "name": "pressed"},
        {"electrodes.layout": ["four", "three"]},
    ]
    data = sweep(BASE, axes, processes=1)
    assert dict(data.sizes) == {"pressed": 2, "layout": 2, "electrode": 4}
    assert set(data.status.values.ravel()) == {"converged"}
    assert np.isnan(data.charge_pC.sel(layout="three", electrode="D")).all()
    assert data.charge_pC.sel(layout="four").notnull().all()
    assert all("long_name" in variable.attrs for variable in data.variables.values())
    assert set(data.charge_pC.attrs["ancillary_variables"].split()) <= set(data.variables)
    scene = BASE.with_(**{"electrodes.layout": "three", "film.thickness_um": 50, "load.force_N": 2})
    alone = solve(scene)
    for name, charge in alone.charges_pC.items():
        swept = data.sel(layout="three", electrode=name).isel(pressed=1)
        assert float(swept.charge_pC) == pytest.approx(charge, rel=0.05)
        assert 0.0 < float(swept.charge_error_pC) < 0.05 * charge
        assert float(swept.rest_charge_pC) == pytest.approx(alone.rest_charges_pC[name])
        change = float(swept.charge_pC - swept.rest_charge_pC)
        assert float(swept.charge_change_pC) == pytest.approx(change)
    depth = float(data.deflection_max_mm.sel(layout="three")[1])
    assert depth == pytest.approx(alone.deflection_max_mm, rel=1e-2)


def test_a_scene_that_fails_is_stored_and_one_that_crashes_is_tried_again(tmp_path, monkeypatch):
    """The rest goes on; a store may be a path."""
    axes = [{"film.temperature_change_K": [-1.0, 10.0, -2.0], "load.force_N": [1.0, 0.0, 2.0]}]
    make_records = batch.make_records

    def broken(scenes, frames):
        if scenes[0].load.force_N == 2.0:
            raise MemoryError
        return make_records(scenes, frames)

    monkeypatch.setattr(batch, "make_records", broken)
    path = tmp_path / "s.db"
    data = sweep(BASE, axes, str(path), processes=1)
    assert data.status.values.tolist() == ["converged", "unstable", "crashed"]
    assert data.charge_pC.notnull().all(axis=1).values.tolist() == [True, False, False]
    with Store(path) as store:
        assert [scene in store for scene in SceneGrid.from_tables(BASE, axes).scenes()] == [
            True,
            True,
            0,
        ]
    monkeypatch.setattr(batch, "make_records", lambda scenes, frames: made_up(scenes, frames))
    again = sweep(BASE, axes, path, processes=1)
    assert again.status.values.tolist() == ["converged", "unstable", "converged"]
    assert again.charge_pC[0].identical(data.charge_pC[0])


def test_killed_at_any_moment_it_goes_on_where_it_was(tmp_path):
    """Twenty kills: no scene that was stored is solved again, and the dataset is the same."""
    store, log = tmp_path / "s.db", tmp_path / "log"
    moments = random.Random(5)
    for _ in range(20):
        log.write_text("")
        before = _stored(store)
        process = AGAIN.Process(target=run, args=(store, log, 0.02))
        process.start()
        time.sleep(moments.uniform(0.0, 0.15))
        process.kill()  # if it has not ended by itself
        process.join()
        assert not before & set(log.read_text().split())
    done = _stored(store)
    log.write_text("")
    data = run(store, log)
    solved = log.read_text().split()
    assert len(solved) == len(set(solved)) == 48 - len(done)
    assert data.identical(run(tmp_path / "undisturbed.db"))


def _stored(path):
    with Store(path) as store:
        return {
            make_record_key(scene)
            for scene in SceneGrid.from_tables(BASE, AXES).scenes()
            if scene in store
        }


def test_what_another_program_has_solved_meanwhile_is_not_solved_again(tmp_path, monkeypatch):
    """The other one begins and ends while this one is at its second solve."""
    path, solves = tmp_path / "s.db", []

    def watched(scenes, frames):
        solves.append(scenes)
        if len(solves) == 2:
            run(path)
        return made_up(scenes, frames)

    monkeypatch.setattr(batch, "make_records", watched)
    data = sweep(BASE, AXES, path, processes=1)
    assert len(solves) == 2
    assert data.identical(run(tmp_path / "alone.db"))


def test_processes_end_with_a_parent_that_is_killed(tmp_path):
    """Though a task would take ten minutes."""
    code = (
        "from pvdf_fem.batch.workers import run_on_processes\n"
        "from tests.helpers.deaths import wait\n"
        f"list(run_on_processes(wait, enumerate([{str(tmp_path)!r}] * 2), 2))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT)
    while len(list(tmp_path.iterdir())) < 2:
        assert parent.poll() is None
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    given_up = time.monotonic() + PATIENCE_S
    while any(Path(f"/proc/{file.name}").exists() for file in tmp_path.iterdir()):
        assert time.monotonic() < given_up
        time.sleep(0.1)


def test_a_process_that_dies_is_replaced(tmp_path):
    """A task that always kills its process has no result; a caller may use joblib meanwhile."""
    tasks = [(number, (tmp_path / "died", number)) for number in range(6)]
    results = dict(run_on_processes(deaths.die, tasks, 2))
    assert results == {number: 10 * number for number in range(6)}
    assert joblib.Parallel(2)(joblib.delayed(math.sqrt)(x) for x in (4.0, 16.0)) == [2.0, 4.0]
    results = dict(run_on_processes(deaths.die, enumerate((None, n) for n in range(5)), 2))
    assert isinstance(results.pop(3), WorkerDied)
    assert results == {number: 10 * number for number in (0, 1, 2, 4)}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.slow
def test_a_cluster_gives_the_same_dataset_until_it_stops(monkeypatch, tmp_path):
    """A scheduler with a worker, in threads. What was solved before it stops is in the store."""
    distributed = pytest.importorskip("distributed")
    inside = {"n_workers": 1, "threads_per_worker": 1, "processes": False}
    solves, path = [], tmp_path / "s.db"

    def stopping(scenes, frames):
        solves.append(scenes)
        if len(solves) == 5:
            cluster.loop.add_callback(cluster.scheduler.close)
        return made_up(scenes, frames)

    with distributed.LocalCluster(**inside, dashboard_address=None) as cluster:
        where = {"scheduler": cluster.scheduler_address}
        monkeypatch.setattr(batch, "make_records", made_up)
        assert sweep(BASE, AXES, **where).identical(run(tmp_path / "here.db"))
        monkeypatch.setattr(batch, "make_records", stopping)
        with pytest.raises(ClusterLostError):
            sweep(BASE, AXES, path, **where)
    assert len(_stored(path)) >= 2


def test_the_command_prints_its_plan_and_writes_the_dataset(
    tmp_path, monkeypatch, command, invented
):
    monkeypatch.chdir(tmp_path)
    text = "[scene.probe]\n[[axes]]\nload.force_N = [1.0, 2.0]\n"
    (tmp_path / "s.toml").write_text(f"{text}[[axes]]\nelectrodes.ring_radius_mm = [8, 12]\n")
    line = ["sweep", "s.toml", "--processes", "1"]
    assert command(*line, "--plan").out.split()[:2] == ["4", "scenes"]
    assert not list(tmp_path.glob("s.[nd]*"))
    assert command(*line, "--quiet", "--plot", "s.svg") == Run(0, "", "")
    assert "<svg" in (tmp_path / "s.svg").read_text()
    with xarray.open_dataset("s.nc") as data:
        assert data.charge_pC.sel(force_N=2.0, ring_radius_mm=8.0, electrode="A") == 6.0
    failed = Record("unstable", "no", tuple("ABCD"))
    monkeypatch.setattr(batch, "make_records", lambda scenes, frames: [failed] * len(scenes))
    done = command(*line, "--store", "other.db")
    assert (done.code, done.stderr_keys) == (3, ["no charges in 4 scenes"])
    (tmp_path / "s.toml").write_text(
        f"{text}[[axes]]\nfilm.radius_mm = [40, 45]\n[[axes]]\nfilm.thickness_um = [9, 25]\n"
    )
    assert command(*line, "--plot", "s.png").error_keys == ["--plot"]
    nowhere = ["--scheduler", "nonsense://x"]
    assert command(*line[:2], "--quiet", *nowhere).error_keys == [" ".join(nowhere)]
