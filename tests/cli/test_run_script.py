"""The entry script `run` on machines that lack something, without root and without installing."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import gmsh
import pytest

from pvdf_fem.mesh.gmsh_libraries import PACKAGES

ROOT = Path(__file__).resolve().parents[2]

# Imported by Python at start: plays an interpreter on a machine where something is missing.
NO_GLU_AND_GOMP = f"""
import ctypes
load = ctypes.CDLL
def refuse(name, *args, **kwargs):
    if name in ("libGLU.so.1", "libgomp.so.1"):
        raise OSError(name + ": cannot open shared object file")
    return None if name in {list(PACKAGES)} else load(name, *args, **kwargs)
ctypes.CDLL = refuse
"""
NO_ENSUREPIP = "import sys; sys.modules['ensurepip'] = None"
OLD_PYTHON = "import sys; sys.version_info = (3, 9, 2, 'final', 0)"
#: Programs of a Debian machine for a user without root, their names with underscores.
TOOLS = {
    "id": "echo 1000",
    "sudo": "echo called sudo; exit 1",
    "apt_get": "echo called apt-get; exit 1",
    "uname": "echo Linux",
    "python3": f'exec "{sys.executable}" "$@"',
}


def executable(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


@pytest.fixture
def run(tmp_path):
    """Call `run` in a checkout with a space in its path that holds nothing to install."""
    library = Path("pvdf_fem", "mesh", "gmsh_libraries.py")
    (tmp_path / "a checkout" / library).parent.mkdir(parents=True)
    for name in ("run", library):
        shutil.copy(ROOT / name, tmp_path / "a checkout" / name)

    def call(*arguments, defect=""):
        (tmp_path / "bin").mkdir(exist_ok=True)
        for name, text in TOOLS.items():
            executable(tmp_path / "bin" / name.replace("_", "-"), text)
        (tmp_path / "sitecustomize.py").write_text(defect)
        path = f"{tmp_path / 'bin'}:{os.environ['PATH']}"
        how = {"stdin": subprocess.DEVNULL, "capture_output": True, "text": True, "timeout": 60}
        how |= {"cwd": tmp_path, "env": {"PATH": path, "PYTHONPATH": str(tmp_path)}}
        return subprocess.run([str(tmp_path / "a checkout" / "run"), *arguments], **how)

    return call


@pytest.mark.parametrize(
    ("command", "defect", "code", "message"),
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
def test_missing_packages_are_named_and_nothing_is_installed(
    run, tmp_path, command, defect, code, message
):
    """Where a line must be typed to install them, it is printed."""
    done = run(command, defect=defect)
    assert done.returncode == code
    assert re.search(message, done.stderr, re.MULTILINE)
    assert "called" not in done.stdout + done.stderr
    assert not (tmp_path / "a checkout" / ".venv").exists()


@pytest.fixture
def environment(run, tmp_path):
    """The `.venv` of a checkout where reports run, with a Python that prints its arguments."""
    checkout = tmp_path / "a checkout"
    for name in ("pyproject.toml", "constraints.txt"):
        (checkout / name).touch()
    (checkout / ".venv" / "bin").mkdir(parents=True)
    executable(checkout / ".venv" / "bin" / "python", 'echo "$@"')
    version = subprocess.check_output([sys.executable, "-VV"], text=True)
    (checkout / ".venv" / "made-from").write_text(f"{checkout}\n{version}")
    return checkout / ".venv"


@pytest.mark.usefixtures("environment")
def test_a_report_installs_no_tests_and_tests_only_add_to_it(run):
    assert run("report", "--quick").stdout == "-m reports --quick\n"
    first, second = (run("check").stdout for _ in range(2))
    assert "--editable .[test]\n" in first
    assert "-m mypy\n" in second
    assert "install" not in second
    assert run("setup", "guide").stdout.count("--editable .[guide]\n") == 1
    assert run("setup", "tests").returncode == 2


def test_table_of_libraries_covers_what_gmsh_loads():
    """A new gmsh wheel that needs another library must not surprise a bare machine."""
    # The names that the dynamic loader reads stand in the file as null-terminated strings.
    named = re.findall(rb"\0(lib[\w+-]+\.so\.\d+)(?=\0)", Path(gmsh.libpath).read_bytes())
    python_has = {"libc.so.6", "libdl.so.2", "libm.so.6", "libpthread.so.0", "librt.so.1"}
    with_libstdc = {"libgcc_s.so.1"}
    only_for_windows_on_screen = {"libgtk-3.so.0", "libXrandr.so.2"}  # opened late, if there
    others = python_has | with_libstdc | only_for_windows_on_screen
    assert {name.decode() for name in named} - others == set(PACKAGES)
