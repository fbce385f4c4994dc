"""The wheel runs the examples of README and the guide, and the archive of sources is complete."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: A snippet of README, and the reason in a comment before it if it is not run here.
SNIPPET = re.compile(r"^(<!-- not run: [^\n]+ -->\n)?```(python|sh)\n(.*?)^```", re.M | re.S)
#: A cell of a page of the guide, and the comment of pages whose cells read the checkout.
CELL = re.compile(r"^```\{code-cell\} ipython3\n(.*?)^```$", re.M | re.S)
NEEDS_CHECKOUT = "% needs the checkout"
NOT_COPIED = (".git", ".venv", ".*cache", ".hypothesis", "__pycache__", "out", "build", "dist")

#: Runs the cells of pages, each page in an empty folder of its own, as a notebook does.
NOTEBOOK = """
import json, os, subprocess, sys, tempfile
import pvdf_fem
for name, cells in json.load(sys.stdin).items():
    names = {"__name__": name}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for cell in cells:
            first, _, rest = cell.partition(chr(10))
            if first == "%%sh":
                subprocess.run(["sh", "-euc", rest], check=True, capture_output=True, text=True)
            elif first.startswith("%%writefile "):
                with open(first.split()[1], "w") as file:
                    file.write(rest)
            else:
                exec(compile(cell, f"{name}: {first}", "exec"), names)
        os.chdir("/")
print(pvdf_fem.__file__)
"""


def run(*command: object, folder: Path, path: Path | None = None, stdin: str = "") -> str:
    """Return the output of a command in a folder, with `path` before other folders of programs.

    Python imports installed packages only.
    """
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    environment["LOKY_MAX_CPU_COUNT"] = "1"  # a few solves need no further processes
    environment["MPLBACKEND"] = "agg"
    if path is not None:
        environment["PATH"] = f"{path}{os.pathsep}{environment['PATH']}"
    arguments = [str(part) for part in command]
    options = {"cwd": folder, "env": environment, "input": stdin, "timeout": 1200}
    done = subprocess.run(arguments, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build the wheel and the archive of sources in a folder, from a copy of the checkout."""
    pytest.importorskip("setuptools", "77")
    folder = tmp_path_factory.mktemp("built")
    ignored = shutil.ignore_patterns(*NOT_COPIED, "*.egg-info")
    copy = shutil.copytree(ROOT, folder / "checkout", symlinks=True, ignore=ignored)
    code = "import setuptools.build_meta as b; b.build_sdist('..'); b.build_wheel('..')"
    run(sys.executable, "-c", code, folder=copy)
    return folder


@pytest.fixture(scope="module")
def programs(built):
    """The programs of a clean environment with the wheel and the packages that are here."""
    root = built / "venv"
    venv.create(root)
    [wheel] = built.glob("*.whl")
    pip = (sys.executable, "-m", "pip", "-q", "--python", root)
    run(*pip, "install", "--no-index", "--no-deps", wheel, folder=built)
    place = Path(sysconfig.get_path("purelib", vars={"base": str(root)}))
    # as a line of this file a folder is searched, but not for editable installations
    place.joinpath("here.pth").write_text(sysconfig.get_path("purelib"))
    return Path(sysconfig.get_path("scripts", vars={"base": str(root)}))


#: Pages that take seconds; the others are slow.
QUICK = ("README", "verify", "extend")


def read_cells() -> dict[str, list[str]]:
    """Return the cells of README and of the guide's pages that need no checkout."""
    texts = {path.stem: path.read_text("utf-8") for path in ROOT.glob("reports/guide/*.md")}
    cells = {}
    for page, text in texts.items():
        if NEEDS_CHECKOUT not in text:
            cells[page] = CELL.findall(text)
    snippets = SNIPPET.findall(ROOT.joinpath("README.md").read_text("utf-8"))
    marks = {"sh": "%%sh\n", "python": ""}
    cells["README"] = [marks[name] + code for not_run, name, code in snippets if not not_run]
    return {page: code for page, code in cells.items() if code}


@pytest.mark.parametrize("names", [QUICK, pytest.param(None, marks=pytest.mark.slow)])
def test_pages_run_from_the_wheel(programs, tmp_path, names):
    cells = {page: code for page, code in read_cells().items() if names is None or page in names}
    assert cells.keys() >= set(QUICK)
    # plt.show() has no window here
    warn = "-W", "error", "-W", "ignore:FigureCanvasAgg"
    code = programs / "python", *warn, "-c", NOTEBOOK
    printed = run(*code, folder=tmp_path, path=programs, stdin=json.dumps(cells)).splitlines()
    assert Path(printed[-1]).is_relative_to(programs.parent)


def test_the_archive_of_sources_has_every_file(built):
    if not ROOT.joinpath(".git").exists() or shutil.which("git") is None:
        pytest.skip("only git knows the files of the sources")
    listed = run("git", "ls-files", folder=ROOT).splitlines()
    expected = {path for path in listed if ROOT.joinpath(path).is_file()}
    examples = {f"pvdf_fem/examples/{path.name}" for path in ROOT.glob("geometry/*.toml")}
    [archive] = built.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        packed = {member.name.partition("/")[2] for member in files if member.isfile()}
    assert packed >= expected | examples


#: Tests that need every package of users, and the packages that only developers need.
NEED_PACKAGES = ["scene", "mesh", "view", "report", "solver/test_solve.py"]
NEED_PACKAGES += ["film/test_terms.py", "surrogate/test_response_file.py"]
NEED_PACKAGES += ["batch/test_sweep.py", "explore/test_state.py"]
FOR_DEVELOPERS = ("mypy", "ngsolve", "playwright", "ruff", "furo", "myst-nb", "sphinx")


def lowest_versions() -> list[str]:
    """Return the lower bounds of `pyproject.toml` as exact versions."""
    project = tomllib.loads(ROOT.joinpath("pyproject.toml").read_text("utf-8"))["project"]
    lists = project["dependencies"], *project["optional-dependencies"].values()
    bounds = {bound for listed in lists for bound in listed if ">=" in bound}
    return sorted(b.replace(">=", "==") for b in bounds if b.split(">=")[0] not in FOR_DEVELOPERS)


@pytest.mark.slow
def test_the_lowest_allowed_versions_work(tmp_path):
    """Warnings of old packages about new ones are no errors."""
    venv.create(tmp_path / "venv")
    install = [sys.executable, "-m", "pip", "-q", "--python", tmp_path / "venv", "install"]
    install += ["--only-binary", ":all:"]
    bounds = lowest_versions()
    [numpy] = (bound for bound in bounds if bound.startswith("numpy=="))
    probe = subprocess.run([*install, "--no-deps", numpy], capture_output=True, text=True)
    if probe.returncode:
        pytest.skip(f"no index with a wheel of {numpy} for this Python can be reached")
    run(*install, *bounds, folder=tmp_path)
    tests = [f"tests/{name}" for name in NEED_PACKAGES]
    warn = "-o", "filterwarnings=default", "-p", "no:cacheprovider"
    run(tmp_path / "venv/bin/python", "-m", "pytest", "-q", "-n", 0, *warn, *tests, folder=ROOT)
