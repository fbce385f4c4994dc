"""A session of gmsh that the caller has begun stays as it was; a missing library is told."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest

from pvdf_fem import solve
from pvdf_fem.mesh.gmsh_mesh import MeshError
from tests.helpers.discs import RECTANGLE, graded_mesh

ROOT = Path(__file__).parents[2]

# Most of them change our mesh if they are left as the caller has set them.
CALLERS: dict[str, Any] = {
    "Mesh.MeshSizeFactor": 0.1 + 0.2,  # no number of 16 digits
    "Mesh.MeshSizeMax": 0.3,
    "Mesh.MeshSizeMin": 0.01,
    "Mesh.MeshSizeFromPoints": 1,
    "Mesh.MeshSizeExtendFromBoundary": 1,
    "Mesh.Algorithm": 1,
    "Mesh.ElementOrder": 2,
    "Mesh.SecondOrderLinear": 1,
    "Mesh.RandomFactor": 1e-3,
    "Mesh.RandomSeed": 7,
    "Mesh.RecombineAll": 1,
    "Mesh.SubdivisionAlgorithm": 1,
    "Mesh.Smoothing": 10,
    "Mesh.MeshOnlyVisible": 1,
    "Geometry.Tolerance": 1e-3,
    "Geometry.OCCParallel": 1,
    "General.NumThreads": 2,
    "General.AbortOnError": 0,
    "General.Terminal": 0,
    "General.Verbosity": 3,
    "General.GraphicsFont": "Helvetica-Bold",
    "View[0].IntervalsType": 3,
    "View[0].NumberFormat": "%g",
}


def set_option(name: str, value: Any) -> None:
    (gmsh.option.setString if isinstance(value, str) else gmsh.option.setNumber)(name, value)


def option(name: str, value: Any) -> Any:
    return (gmsh.option.getString if isinstance(value, str) else gmsh.option.getNumber)(name)


@pytest.fixture
def session() -> Iterator[None]:
    """A session with two models, the first of them current, a mesh, a view and options."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("first")
        gmsh.model.occ.addDisk(0.0, 0.0, 0.0, 1.0, 1.0)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="disc")
        gmsh.model.mesh.generate(2)
        gmsh.model.add("second")
        gmsh.model.occ.addPoint(1.0, 2.0, 3.0)  # not yet synchronized
        gmsh.model.setCurrent("first")
        view = gmsh.view.add("a point")
        gmsh.view.addListData(view, "SP", 1, [0.0, 0.0, 0.0, 5.0])
        for name, value in CALLERS.items():
            set_option(name, value)
        gmsh.option.setColor("Mesh.Color.Nodes", 1, 2, 3, 200)
        yield
    finally:
        gmsh.finalize()


def state(folder: Path) -> dict[str, Any]:
    """What a caller sees of a session."""
    numbers = {name: option(name, value) for name, value in CALLERS.items()}
    gmsh.option.setNumber("General.Verbosity", 0)  # it tells of the file
    gmsh.write(str(folder / "all.opt"))
    gmsh.option.setNumber("General.Verbosity", numbers["General.Verbosity"])
    options = (folder / "all.opt").read_text().splitlines()
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    return {
        "models": (gmsh.model.list(), gmsh.model.getCurrent()),
        "entities": gmsh.model.getEntities(),
        "groups": [
            (group, gmsh.model.getPhysicalName(*group)) for group in gmsh.model.getPhysicalGroups()
        ],
        "nodes": (tags.tolist(), coordinates.tolist()),
        "views": gmsh.view.getTags().tolist(),
        "numbers": numbers,
        "options": [line for line in options if "(read-only)" not in line],
        "colour": gmsh.option.getColor("Mesh.Color.Nodes"),
    }


def test_a_callers_session_stays_as_it_was(session: None, tmp_path: Path) -> None:
    gmsh.logger.start()
    before = state(tmp_path)
    assert before["numbers"] == CALLERS
    solve(RECTANGLE)  # on meshes of both kinds of sizes
    assert state(tmp_path) == before
    assert list(gmsh.logger.get()) == []
    gmsh.model.setCurrent("second")
    gmsh.model.occ.synchronize()
    assert gmsh.model.getEntities() == [(0, 1)]


def test_a_callers_session_changes_no_result(session: None) -> None:
    beside, mesh = solve(RECTANGLE), graded_mesh(RECTANGLE, 1.0, 6.0)
    gmsh.finalize()
    alone, same_mesh = solve(RECTANGLE), graded_mesh(RECTANGLE, 1.0, 6.0)
    gmsh.initialize(readConfigFiles=False, interruptible=False)  # the fixture finalizes it
    assert np.array_equal(mesh.doflocs, same_mesh.doflocs)
    assert beside.charges_pC == alone.charges_pC
    assert beside.charge_errors_pC == alone.charge_errors_pC


def test_a_callers_session_stays_after_a_failure(
    session: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: int) -> None:
        raise Exception("no elements in surface 7")

    before = state(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(gmsh.model.mesh, "generate", fail)
        with pytest.raises(MeshError, match="no elements in surface 7"):
            graded_mesh(RECTANGLE, 1.0, 6.0)
    assert state(tmp_path) == before


def test_threads_mesh_beside_a_callers_session(session: None, tmp_path: Path) -> None:
    before, made = state(tmp_path), []
    threads = [
        threading.Thread(target=lambda: made.append(graded_mesh(RECTANGLE, 1.0, 6.0)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({mesh.doflocs.tobytes() for mesh in made}) == 1
    assert len(made) == 3
    assert state(tmp_path) == before


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
TOLD = (
    "gmsh, which makes the meshes, cannot be loaded (libGLU.so.1: cannot open shared object file: "
    "No such file or directory); install what it misses: apt-get install libglu1-mesa"
)
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
        "modes scene.toml",
        "mesh scene.toml scene.msh",
        "locate scene.toml --charges A=1,B=2,C=3",
    ],
)
def test_a_command_names_the_missing_package_in_a_line(without_glu: Run, command: str) -> None:
    done = without_glu("-m", "pvdf_fem", *command.split())
    # before it, `locate` says which model it builds
    assert (done.returncode, done.stdout, done.stderr.splitlines()[-1]) == (2, "", TOLD)


@pytest.mark.parametrize("processes", ["1", "2"])
def test_a_sweep_names_the_missing_package_once(without_glu: Run, processes: str) -> None:
    done = without_glu("-m", "pvdf_fem", "sweep", "sweep.toml", "--processes", processes)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == TOLD
    assert done.stderr.count("gmsh") == 1


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
    assert (done.returncode, done.stdout, done.stderr) == (0, TOLD + "\n", "")
    assert without_glu("-m", "pvdf_fem", "--version").returncode == 0
