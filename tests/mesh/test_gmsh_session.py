"""Sessions of gmsh are ours alone, and are closed; a missing library is told."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import gmsh
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.mesh.gmsh_mesh import GmshInUseError, MeshError
from tests.helpers.discs import RECTANGLE, graded_mesh

ROOT = Path(__file__).parents[2]


def test_a_session_that_is_open_is_refused_and_left_alone() -> None:
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


def test_threads_mesh_alike_one_after_another_and_leave_no_session() -> None:
    """Whatever was meshed before."""
    made: list[bytes] = []
    graded_mesh(Scene(), 1.0, 6.0)
    threads = [
        threading.Thread(target=lambda: made.append(graded_mesh(RECTANGLE, 1.0, 6.0).p.tobytes()))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(made), {*made}) == (3, {graded_mesh(RECTANGLE, 1.0, 6.0).p.tobytes()})
    assert not gmsh.isInitialized()


def test_no_session_is_left_by_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: int) -> None:
        raise Exception("no elements in surface 7")

    monkeypatch.setattr(gmsh.model.mesh, "generate", fail)
    with pytest.raises(MeshError, match="no elements in surface 7"):
        graded_mesh(RECTANGLE, 1.0, 6.0)
    assert not gmsh.isInitialized()


# ------------------------------------------------------------------------- gmsh cannot be loaded

# Imported by Python at start: plays a machine on which a library that gmsh loads is missing.
NO_GLU = """
import ctypes
class Library(ctypes.CDLL):
    def __init__(self, name, *args, **kwargs):
        if "libgmsh" in str(name) or name == "libGLU.so.1":
            text = "libGLU.so.1: cannot open shared object file: No such file or directory"
            raise OSError(text)
        super().__init__(name, *args, **kwargs)
ctypes.CDLL = Library
"""
SCENE = '[probe]\nshape = "circle"\n'
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def without_glu(tmp_path: Path) -> Run:
    """Runs Python without libGLU, in a folder with a scene and a sweep of it."""
    (tmp_path / "sitecustomize.py").write_text(NO_GLU)
    (tmp_path / "scene.toml").write_text(SCENE)
    sweep = 'scene = "scene.toml"\n[[axes]]\nload.force_N = [1, 2]\n[[axes]]\nprobe.x_mm = [0, 1]\n'
    (tmp_path / "sweep.toml").write_text(sweep)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"},
            capture_output=True,
            text=True,
            timeout=100,
        )

    return run


@pytest.mark.parametrize(
    "command",
    [
        "solve scene.toml --json",
        "locate scene.toml --charges A=1,B=2,C=3",
        "sweep sweep.toml --processes 2",
    ],
)
def test_a_command_names_the_missing_package_once(without_glu: Run, command: str) -> None:
    done = without_glu("-m", "pvdf_fem", *command.split())
    assert done.returncode == 2
    # before it, `locate` says which model it builds
    assert done.stderr.splitlines()[-1].endswith("apt-get install libglu1-mesa")
    assert done.stderr.count("libglu1-mesa") == 1


def test_only_meshing_needs_gmsh(without_glu: Run) -> None:
    script = f"""
from pvdf_fem import *
scene = Scene.parse({SCENE!r})
try:
    solve(scene)
except ImportError as error:
    print(error)
"""
    done = without_glu("-c", script)
    assert (done.returncode, done.stderr) == (0, "")
    assert "libGLU.so.1" in done.stdout
