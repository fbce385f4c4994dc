"""The entry script `run` on machines that lack something, without root and without installing."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import gmsh
import pytest

from pvdf_fem.mesh.gmsh_libraries import PACKAGES

ROOT = Path(__file__).resolve().parents[2]

# Imported by Python at start: plays an interpreter on a machine where something is missing.
NO_GLU_AND_GOMP = (
    f"NAMES = {list(PACKAGES)}"
    + """
import ctypes
load = ctypes.CDLL
def refuse(name, *args, **kwargs):
    if name in ("libGLU.so.1", "libgomp.so.1"):
        raise OSError(name + ": cannot open shared object file")
    if name in NAMES:
        return None
    return load(name, *args, **kwargs)
ctypes.CDLL = refuse
"""
)
NO_ENSUREPIP = "import sys; sys.modules['ensurepip'] = None"
OLD_PYTHON = "import sys; sys.version_info = (3, 9, 2, 'final', 0)"

Run = Callable[..., subprocess.CompletedProcess[str]]


def executable(path: Path, text: str) -> None:
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with a space in its path that holds the scripts and nothing to install."""
    folder = tmp_path / "a checkout"
    libraries = Path("pvdf_fem", "mesh", "gmsh_libraries.py")
    (folder / libraries).parent.mkdir(parents=True)
    shutil.copy(ROOT / "run", folder)
    shutil.copy(ROOT / libraries, folder / libraries)
    return folder


@pytest.fixture
def run(checkout: Path, tmp_path: Path) -> Run:
    """Call `run` as a user without root on a Debian machine with the given Python defect."""
    tools = tmp_path / "bin"
    tools.mkdir()
    executable(tools / "id", "echo 1000\n")
    executable(tools / "sudo", "echo called sudo; exit 1\n")
    executable(tools / "apt-get", "echo called apt-get; exit 1\n")
    executable(tools / "uname", "echo Linux\n")
    executable(tools / "python3", f'exec "{sys.executable}" "$@"\n')

    def call(*arguments: str, defect: str = "") -> subprocess.CompletedProcess[str]:
        (tmp_path / "sitecustomize.py").write_text(defect)
        environment = {"PATH": f"{tools}:{os.environ['PATH']}", "PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [str(checkout / "run"), *arguments],
            cwd=tmp_path,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
        )

    return call


@pytest.mark.parametrize(
    ("command", "defect", "code", "told"),
    [
        (
            "report",
            NO_GLU_AND_GOMP,
            1,
            "^ *sudo apt-get update && "
            "sudo apt-get install -y --no-install-recommends libglu1-mesa libgomp1$",
        ),
        ("setup", NO_ENSUREPIP, 1, "install -y --no-install-recommends python3-venv$"),
        ("test", OLD_PYTHON, 1, r"PYTHON=python3\.11 \./run test$"),
        ("reprot", "", 2, "'reprot'.*\nusage:"),
    ],
)
def test_what_is_missing_is_told_and_nothing_is_installed(
    run: Run, checkout: Path, command: str, defect: str, code: int, told: str
) -> None:
    """By the line to type, where there is one."""
    done = run(command, defect=defect)
    assert done.returncode == code
    assert re.search(told, done.stderr, re.MULTILINE)
    assert "called" not in done.stdout + done.stderr
    assert not (checkout / ".venv").exists()


@pytest.fixture
def environment(checkout: Path) -> Path:
    """The `.venv` of a checkout where reports run, with a Python that prints its arguments."""
    for name in ("pyproject.toml", "constraints.txt"):
        (checkout / name).touch()
    (checkout / ".venv" / "bin").mkdir(parents=True)
    executable(checkout / ".venv" / "bin" / "python", 'echo "$@"\n')
    version = subprocess.run([sys.executable, "-VV"], capture_output=True, text=True).stdout
    (checkout / ".venv" / "made-from").write_text(f"{checkout}\n{version}")
    return checkout / ".venv"


@pytest.mark.usefixtures("environment")
def test_a_report_installs_no_tests_and_tests_only_add_to_it(run: Run) -> None:
    assert run("report", "--quick").stdout == "-m reports --quick\n"
    first, second = (run("check").stdout for _ in range(2))
    assert "--editable .[test]\n" in first
    assert "-m mypy\n" in second
    assert "install" not in second
    assert run("setup", "guide").stdout.count("--editable .[guide]\n") == 1
    assert run("setup", "tests").returncode == 2


@pytest.mark.parametrize("installed", ["chromium", ""])
def test_root_installs_what_the_tests_need(
    run: Run, environment: Path, tmp_path: Path, installed: str
) -> None:
    """And goes on without where that fails."""
    tools = tmp_path / "bin"
    executable(tools / "id", "echo 0\n")
    executable(tools / "apt-get", 'echo "$@" >&2; exit 1\n')
    executable(tools / "dpkg-query", f'[ "$4" != "{installed}" ] || echo installed\n')
    environment.joinpath("has-test").touch()
    done = run("test", "tests/cli")
    assert done.returncode == 0
    assert done.stdout == "-m pytest -n auto --dist worksteal tests/cli\n"
    packages = ["chromium", "libatomic1", "libegl1"]
    wanted = " ".join(package for package in packages if package != installed)
    assert f"-qq install -y --no-install-recommends {wanted}\n" in done.stderr


def test_table_of_libraries_covers_what_gmsh_loads() -> None:
    """A new gmsh wheel that needs another library must not surprise a bare machine."""
    # The names that the dynamic loader reads stand in the file as null-terminated strings.
    named = re.findall(rb"\0(lib[\w+-]+\.so\.\d+)(?=\0)", Path(gmsh.libpath).read_bytes())
    loaded = {name.decode() for name in named}
    python_has = {"libc.so.6", "libdl.so.2", "libm.so.6", "libpthread.so.0", "librt.so.1"}
    with_libstdc = {"libgcc_s.so.1"}
    only_for_windows_on_screen = {"libgtk-3.so.0", "libXrandr.so.2"}  # opened late, if there
    assert loaded - python_has - with_libstdc - only_for_windows_on_screen == set(PACKAGES)
