"""Sweeps: datasets, and what survives kills, deaths of workers and failures."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import joblib
import numpy as np
import pytest
import xarray

from pvdf_fem import Scene, solve
from pvdf_fem.cli import main as cli
from pvdf_fem.sweeps import sweep
from pvdf_fem.sweeps.dataset import write_netcdf
from pvdf_fem.sweeps.grid import OWN_NAMES
from pvdf_fem.sweeps.store import Record, Store, key
from pvdf_fem.sweeps.workers import Died, on_processes
from tests.helpers import deaths
from tests.helpers.sweep_cases import AXES, BASE, made_up, run

GEOMETRY = Path(__file__).parents[2] / "geometry"
AGAIN = multiprocessing.get_context("forkserver")
AGAIN.set_forkserver_preload(["tests.helpers.sweep_cases", "pvdf_fem.sweeps.dataset"])


@pytest.fixture(autouse=True)
def real_solves():
    """`run` replaces them in its process."""
    real = sweep.records_of
    yield
    sweep.records_of = real


@pytest.fixture
def invented(monkeypatch):
    monkeypatch.setattr(sweep, "records_of", made_up)


PLACES = {"probe.x_mm": [0.0, 1.0], "probe.y_mm": [2.0, 3.0]}
FORCES = {"load.force_N": [1.0, 2.0], "name": "y_mm"}


@pytest.mark.parametrize(
    ("axes", "expected"),
    [
        (
            [{**PLACES, "name": "place"}, {"probe.side_mm": [6.0, 7.0]}],
            {"x_mm": "probe.x_mm", "y_mm": "probe.y_mm", "side_mm": "probe.side_mm"},
        ),
        (
            [{"probe.side_mm": [6.0]}, {"electrodes.side_mm": [2.0, 3.0], "name": "square"}],
            {"side_mm": "probe.side_mm", "square": "electrodes.side_mm"},
        ),
        ([{**PLACES, "name": "x_mm"}], {"probe.x_mm": "probe.x_mm", "y_mm": "probe.y_mm"}),
        (
            [{**PLACES, "name": "place"}, FORCES],
            {"x_mm": "probe.x_mm", "probe.y_mm": "probe.y_mm", "y_mm": "load.force_N"},
        ),
    ],
)
def test_every_key_along_an_axis_is_a_coordinate(axes, expected, invented, tmp_path):
    for given in (axes, axes[::-1]):
        data = sweep.sweep(BASE, given, processes=1)
        assert {*data.coords} == {*expected, "electrode"}
        varied = {key: values for axis in axes for key, values in axis.items()}
        for name, scene_key in expected.items():
            text, _, unit = scene_key.rpartition("_")
            attributes = {"key": scene_key, "long_name": text.replace(".", " "), "units": unit}
            assert data[name].attrs == attributes
            assert data[name].values.tolist() == varied[scene_key]
        write_netcdf(data, tmp_path / "data.nc")
        with xarray.open_dataset(tmp_path / "data.nc") as read:
            assert read.identical(data)


def test_tables_along_an_axis_are_labelled_in_full(invented):
    corners = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.25]]
    probes = [{"shape": "circle"}, {"shape": "polygon", "vertices_mm": corners}]
    data = sweep.sweep(BASE, [{"probe": probes}], processes=1)
    assert [json.loads(label) for label in data.probe.values] == probes


def test_the_dataset_s_own_names_are_those_that_axes_may_not_have(invented):
    data = sweep.sweep(BASE.with_(readout={}), [{"load.force_N": [1.0]}], processes=1)
    assert {*data.variables, *data.dims} - {"force_N"} == OWN_NAMES


def test_a_dataset_has_the_charges_of_each_scene_in_its_place():
    """Real solves: charges as those of a scene solved alone, by name and in its place."""
    axes = [
        {"film.thickness_um": [25, 50], "load.force_N": [1, 2], "name": "pressed"},
        {"electrodes.layout": ["four", "three"]},
    ]
    data = sweep.sweep(BASE, axes, processes=1)
    assert dict(data.sizes) == {"pressed": 2, "layout": 2, "electrode": 4}
    assert set(data.status.values.ravel()) == {"converged"}
    assert np.isnan(data.charge_pC.sel(layout="three", electrode="D")).all()
    assert data.charge_pC.sel(layout="four").notnull().all()
    assert data.charge_pC.attrs["units"] == "pC"
    assert data.attrs["Conventions"].startswith("CF-")
    assert all("long_name" in variable.attrs for variable in data.variables.values())
    assert set(data.charge_pC.attrs["ancillary_variables"].split()) <= set(data.variables)
    scene = BASE.with_(**{"electrodes.layout": "three", "film.thickness_um": 50, "load.force_N": 2})
    alone = solve(scene)
    for name, charge in alone.charges_pC.items():
        swept = data.sel(layout="three", electrode=name).isel(pressed=1)
        assert float(swept.charge_pC) == pytest.approx(charge, rel=0.05)
        assert 0.0 < float(swept.charge_error_pC) < 0.05 * charge
        rest = float(swept.rest_charge_pC)
        assert rest == pytest.approx(alone.rest_charges_pC[name])
    depth = float(data.deflection_max_mm.sel(layout="three")[1])
    assert depth == pytest.approx(alone.deflection_max_mm, rel=1e-2)


def test_a_sweep_over_the_number_of_electrodes():
    ring = BASE.with_(**{"electrodes.layout": "ring", "electrodes.centre": True})
    data = sweep.sweep(ring, [{"electrodes.count": [2, 4]}], processes=1)
    assert data.electrode.values.tolist() == list("ABCDE")
    assert data.charge_pC.notnull().sum("electrode").values.tolist() == [3, 5]
    # A stays where it is; the centre is the last one of each
    for few, more in (("A", "A"), ("B", "C"), ("C", "E")):
        expected = float(data.charge_pC.sel(count=4.0, electrode=more))
        found = float(data.charge_pC.sel(count=2.0, electrode=few))
        assert found == pytest.approx(expected, rel=1e-9)


def test_a_scene_that_fails_is_stored_and_one_that_crashes_is_tried_again(tmp_path, monkeypatch):
    """The rest goes on; a store may be a path."""
    axes = [{"film.temperature_change_K": [-1.0, 10.0, -2.0], "load.force_N": [1.0, 0.0, 2.0]}]
    records_of = sweep.records_of

    def broken(scenes, frames):
        if scenes[0].load.force_N == 2.0:
            raise MemoryError
        return records_of(scenes, frames)

    monkeypatch.setattr(sweep, "records_of", broken)
    path = tmp_path / "s.db"
    data = sweep.sweep(BASE, axes, str(path), processes=1)
    assert data.status.values.tolist() == ["converged", "unstable", "crashed"]
    assert data.charge_pC.notnull().all(axis=1).values.tolist() == [True, False, False]
    with Store(path) as store:
        assert [scene in store for scene in sweep.Grid.of(BASE, axes).scenes()] == [True, True, 0]
    monkeypatch.setattr(sweep, "records_of", lambda scenes, frames: made_up(scenes, frames))
    again = sweep.sweep(BASE, axes, path, processes=1)
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
        return {key(scene) for scene in sweep.Grid.of(BASE, AXES).scenes() if scene in store}


def test_what_another_program_has_solved_meanwhile_is_not_solved_again(tmp_path, monkeypatch):
    """The other one begins and ends while this one is at its second solve."""
    path, log, solves = tmp_path / "s.db", tmp_path / "log", []

    def watched(scenes, frames):
        solves.append(scenes)
        if len(solves) == 2:
            other = AGAIN.Process(target=run, args=(path, log))
            other.start()
            other.join()
        return made_up(scenes, frames)

    monkeypatch.setattr(sweep, "records_of", watched)
    with Store(path) as store:
        data = sweep.sweep(BASE, AXES, store, processes=1)
    assert len(solves) == 2
    assert len(log.read_text().splitlines()) == 23
    assert data.identical(run(tmp_path / "alone.db"))


def test_processes_end_with_a_parent_that_is_killed(tmp_path):
    """Though a task would take ten minutes."""
    code = (
        "from pvdf_fem.sweeps.workers import on_processes\n"
        "from tests.helpers.deaths import wait\n"
        f"list(on_processes(wait, enumerate([{str(tmp_path)!r}] * 2), 2))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=GEOMETRY.parent)
    while len(list(tmp_path.iterdir())) < 2:
        assert parent.poll() is None
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 10.0
    while workers := [file for file in tmp_path.iterdir() if Path(f"/proc/{file.name}").exists()]:
        assert time.monotonic() < deadline, workers
        time.sleep(0.1)


def test_a_process_that_dies_is_replaced(tmp_path):
    """A task that always kills its process has no result; a caller may use joblib meanwhile."""
    tasks = [(number, (tmp_path / "died", number)) for number in range(6)]
    results = dict(on_processes(deaths.die_once, tasks, 2))
    assert results == {number: 10 * number for number in range(6)}
    assert joblib.Parallel(2)(joblib.delayed(math.sqrt)(x) for x in (4.0, 16.0)) == [2.0, 4.0]
    results = dict(on_processes(deaths.die, enumerate(range(5)), 2))
    assert isinstance(results.pop(3), Died)
    assert results == {number: 10 * number for number in (0, 1, 2, 4)}
    assert dict(on_processes(math.sqrt, enumerate([1.0, 4.0]), 2)) == {0: 1.0, 1: 2.0}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.slow
def test_a_cluster_gives_the_same_dataset_even_if_a_worker_dies():
    distributed = pytest.importorskip("distributed")
    axes = [{"load.force_N": [0.5, 1.0, 2.0]}, {"probe.x_mm": [0.0, 3.0]}, AXES[-1]]
    expected = sweep.sweep(BASE, axes, processes=1)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            processes = client.run(os.getpid)
        calls = []

        def kill_one(done, total):
            calls.append(done)
            if len(calls) == 2:
                os.kill(next(iter(processes.values())), signal.SIGKILL)

        address = cluster.scheduler_address
        data = sweep.sweep(BASE, axes, scheduler=address, progress=kill_one)
    assert len(calls) == 7
    assert data.identical(expected)


def test_a_scheduler_that_is_not_there_is_bad_input(tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text("[scene.probe]\n[[axes]]\nload.force_N = [1.0]\n")
    assert cli.main(["sweep", "s.toml", "--scheduler", "nonsense://x"]) == 2
    assert "--scheduler nonsense://x: " in capsys.readouterr().err
    assert not (tmp_path / "s.nc").exists()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.slow
def test_a_scheduler_that_stops_is_told_in_a_line(tmp_path):
    pytest.importorskip("distributed")
    where, command = tmp_path / "scheduler.json", [sys.executable, "-m"]
    (tmp_path / "s.toml").write_text(
        "[scene.probe]\n[scene.numerics]\ntolerance = 1e-5\n"
        "[[axes]]\nprobe.x_mm = { start = 0, stop = 9, count = 1000 }\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(GEOMETRY.parent)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    dask = [*command, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    scheduler = subprocess.Popen([*dask, "--no-dashboard", "--scheduler-file", where], **quiet)
    while not (where.exists() and where.read_text().endswith("}")):
        assert scheduler.poll() is None
        time.sleep(0.05)
    address = json.loads(where.read_text())["address"]
    dask = [*command, "distributed.cli.dask_worker", address, "--no-nanny", "--no-dashboard"]
    worker = subprocess.Popen(dask, cwd=tmp_path, **quiet)
    swept = subprocess.Popen(
        [*command, "pvdf_fem", "sweep", "s.toml", "--scheduler", address, "--quiet"],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        rows = tmp_path / "s.db"
        while not (rows.exists() and rows.stat().st_size > 16_000):  # some solves are stored
            assert swept.poll() is None, swept.communicate()
            time.sleep(0.1)
        scheduler.kill()
        out, err = swept.communicate(timeout=60)
    finally:
        for process in (scheduler, worker, swept):
            process.kill()
            process.wait()
    assert (swept.returncode, out, err.count("\n")) == (3, "", 1)
    assert err.startswith(f"--scheduler {address}: ")


def test_the_command_prints_its_plan_and_writes_the_dataset(
    tmp_path, monkeypatch, capsys, invented
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(
        "[scene.probe]\n[[axes]]\nload.force_N = [1.0, 2.0]\n"
        "[[axes]]\nelectrodes.ring_radius_mm = [8, 12]\n"
    )
    command = ["sweep", "s.toml", "--processes", "1"]
    assert cli.main([*command, "--plan"]) == 0
    assert capsys.readouterr().out.split("\n")[0].split() == ["4", "scenes"]
    assert not list(tmp_path.glob("s.[nd]*"))
    assert cli.main([*command, "--quiet", "--plot", "s.svg"]) == 0
    assert capsys.readouterr() == ("", "")
    assert "<svg" in (tmp_path / "s.svg").read_text()
    with xarray.open_dataset("s.nc") as data:
        assert data.charge_pC.sel(force_N=2.0, ring_radius_mm=8.0, electrode="A") == 6.0


def test_failures_change_the_exit_code_and_what_cannot_be_drawn_is_refused(
    tmp_path, monkeypatch, command
):
    failed = Record("unstable", "no", tuple("ABCD"))
    monkeypatch.setattr(sweep, "records_of", lambda scenes, frames: [failed] * len(scenes))
    monkeypatch.chdir(tmp_path)
    text = "scene = {}\n[[axes]]\nload.force_N = [1.0, 2.0]\n"
    (tmp_path / "s.toml").write_text(text)
    done = command("sweep", "s.toml", "--processes", "1", "--plot", "s.png")
    assert done.code == 3
    assert "unstable" in done.err
    assert (tmp_path / "s.png").stat().st_size > 1000
    text += "[[axes]]\nfilm.radius_mm = [40, 45]\n[[axes]]\nfilm.thickness_um = [9, 25]\n"
    (tmp_path / "s.toml").write_text(text)
    assert command("sweep", "s.toml", "--plot", "s.png").mistakes == ["--plot"]


def test_many_scenes_cost_little_memory(invented):
    """1,000 of the 100,000 that must stay below 500 MB."""
    axes = [
        {"load.force_N": {"start": 1.0, "stop": 2.0, "count": 10}},
        {"probe.x_mm": {"start": 0.0, "stop": 9.0, "count": 10}},
        {"film.d31_pC_N": {"start": 1.0, "stop": 9.0, "count": 10}},
    ]
    tracemalloc.start()
    try:
        scenes = sweep.Grid.of(BASE, axes).scenes()
        assert len(sweep.planned(scenes).blocks) == 100
        assert tracemalloc.get_traced_memory()[1] < 1000 * 4e3
    finally:
        tracemalloc.stop()


def test_a_scene_without_a_probe_can_be_swept():
    data = sweep.sweep(Scene(), [{"film.temperature_change_K": [-1.0, -2.0]}], processes=1)
    assert set(data.status.values) == {"converged"}
    ratio = data.charge_pC[1] / data.charge_pC[0]
    assert ratio.values == pytest.approx(np.full(4, 2.0), rel=1e-3)
