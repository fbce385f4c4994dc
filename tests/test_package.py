"""What is handed out: the wheel runs README's snippets, the archive of sources is complete."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: A snippet of README, and the reason in a comment before it if it is not run here.
SNIPPET = re.compile(r"^(<!-- not run: [^\n]+ -->\n)?```(python|sh)\n(.*?)^```", re.M | re.S)
NOT_COPIED = (".git", ".venv", ".*cache", ".hypothesis", "__pycache__", "out", "build", "dist")


def run(*command: object, folder: Path, path: Path | None = None) -> str:
    """What a command prints in a folder, `path` first among those of programs. Python finds nothing
    but what is installed."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    environment["LOKY_MAX_CPU_COUNT"] = "1"  # three solves need no further processes
    if path is not None:
        environment["PATH"] = f"{path}{os.pathsep}{environment['PATH']}"
    arguments = [str(part) for part in command]
    done = subprocess.run(
        arguments, cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder with the wheel and the archive of sources, made from a copy of the checkout."""
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


def snippets(language: str) -> str:
    """The snippets of README in a language, one after the other, that are run here."""
    text = ROOT.joinpath("README.md").read_text("utf-8")
    found = [code for left, name, code in SNIPPET.findall(text) if name == language and not left]
    assert found
    return "\n".join(found)


def test_readme_s_shell_runs_from_the_wheel(programs, tmp_path):
    run("sh", "-euc", snippets("sh"), folder=tmp_path, path=programs)
    assert tmp_path.joinpath("triangle.png").stat().st_size > 10_000


def test_readme_s_python_runs_from_the_wheel(programs, tmp_path):
    code = snippets("python") + "\nimport pvdf_fem\nprint(pvdf_fem.__file__)"
    printed = run(programs / "python", "-W", "error", "-c", code, folder=tmp_path)
    assert printed.startswith("converged: every result is within the tolerance")
    assert Path(printed.splitlines()[-1]).is_relative_to(programs.parent)


def test_the_archive_of_sources_has_every_file(built):
    if not ROOT.joinpath(".git").exists() or shutil.which("git") is None:
        pytest.skip("what belongs to the sources is known to git only")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    expected = {path for path in listed.stdout.splitlines() if ROOT.joinpath(path).is_file()}
    examples = {f"pvdf_fem/examples/{path.name}" for path in ROOT.glob("geometry/*.toml")}
    [archive] = built.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        packed = {member.name.partition("/")[2] for member in files if member.isfile()}
    assert packed >= expected | examples
