"""Sessions of gmsh are ours alone, and are closed; a missing library is messages."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_all_start_methods, get_context
from pathlib import Path

import gmsh
import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.mesh.gmsh_mesh import GmshInUseError
from pvdf_fem.solver.history import Stop
from pvdf_fem.solver.nonlinear.status import Status
from tests.helpers.discs import RECTANGLE, graded_mesh

ROOT = Path(__file__).parents[2]


def test_an_open_session_is_refused_and_not_changed() -> None:
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
        gmsh.model.add("mine")
        with pytest.raises(GmshInUseError, match=r"gmsh\.finalize"):
            solve(RECTANGLE)
        assert gmsh.model.getCurrent() == "mine"
        assert gmsh.option.getNumber("Mesh.RecombineAll") == 1
    finally:
        gmsh.finalize()


def test_threads_mesh_equally_one_after_another_and_close_their_sessions() -> None:
    """Whatever was meshed before."""
    graded_mesh(Scene(), 1.0, 6.0)
    with ThreadPoolExecutor(3) as pool:
        first, *others = pool.map(lambda _: graded_mesh(RECTANGLE, 1.0, 6.0).p, range(4))
    for other in others:
        np.testing.assert_array_equal(other, first)
    assert not gmsh.isInitialized()


def test_a_failure_is_described_and_closes_the_session(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: int) -> None:
        raise Exception("no elements in surface 7")

    monkeypatch.setattr(gmsh.model.mesh, "generate", fail)
    solution = solve(RECTANGLE)
    assert (solution.status, solution.stop) == (Status.MESH_FAILED, Stop.NO_MESH)
    assert "no elements in surface 7" in solution.reason
    assert not gmsh.isInitialized()


@pytest.mark.skipif("fork" not in get_all_start_methods(), reason="the system does not fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_process_forked_during_meshing_can_mesh() -> None:
    meshing = threading.Thread(target=graded_mesh, args=(RECTANGLE, 0.3, 2.0))
    meshing.start()
    time.sleep(0.05)
    child = get_context("fork").Process(target=graded_mesh, args=(RECTANGLE, 3.0, 12.0))
    child.start()
    child.join(100.0)
    ended = child.exitcode
    child.kill()
    meshing.join()
    assert ended == 0


# Imported by Python at start: plays a machine on which a library that gmsh loads is missing.
NO_GLU = """
import ctypes
class Library(ctypes.CDLL):
    def __init__(self, name, *args, **kwargs):
        if "libgmsh" in str(name) or name == "libGLU.so.1":
            raise OSError("libGLU.so.1: cannot open shared object file")
        super().__init__(name, *args, **kwargs)
ctypes.CDLL = Library
"""
SWEEP = """
scene.probe.shape = "circle"
axes = [{ load.force_N = [1, 2] }, { probe.x_mm = [0, 1] }]
"""


def test_a_missing_library_fails_only_meshing_and_names_its_package(tmp_path: Path) -> None:
    """Also where several processes mesh."""
    (tmp_path / "sitecustomize.py").write_text(NO_GLU)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    done = subprocess.run(
        [sys.executable, "-m", "pvdf_fem", "sweep", "sweep.toml", "--processes", "2"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"},
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("apt-get install libglu1-mesa")
    assert done.stderr.count("libglu1-mesa") == 1
