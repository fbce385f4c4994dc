"""How programs end, and that their files appear whole or not at all."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.cli.program import InputError, run_program
from pvdf_fem.files import FileError, replacing, require_writable
from pvdf_fem.output.export import write_mesh
from pvdf_fem.output.figures import new_figure, save
from pvdf_fem.sweeps.records import record_of
from pvdf_fem.sweeps.store import Store, StoreError
from reports.__main__ import main as make_report

ROOT = Path(__file__).parents[2]
SCENE = '[probe]\nshape = "circle"\nradius_mm = 2.0\n[numerics]\ntolerance = 0.05\n'


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(Scene.parse(SCENE))


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


@contextmanager
def small_disk(most: int = 500) -> Iterator[None]:
    """Files hold `most` bytes, whatever comes after them is refused by the system.

    Not a fixture: the tests' own output may go to a file.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


# --------------------------------------------------------------------------------------- writers


def _figure(path: Path, _: Solution) -> None:
    figure = new_figure(50, 50)
    figure.subplots().plot([0, 1])
    save(figure, path)


def _mesh(path: Path, solution: Solution) -> None:
    write_mesh(solution.mesh, path)


WRITERS: dict[str, Callable[[Path, Solution], None]] = {
    "a.vtu": lambda path, solution: solution.to_vtu(path),
    **dict.fromkeys(("b.vtu", "a.msh", "a.inp"), _mesh),
    **dict.fromkeys(("a.png", "a.svg", "a.pdf"), _figure),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_old_file(solution: Solution, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("old")
    with small_disk(), pytest.raises(FileError) as caught:
        WRITERS[name](path, solution)
    assert str(caught.value).startswith(f"{path}: ")
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert path.read_text() == "old"


def test_a_full_disk_loses_no_record(solution: Solution, tmp_path: Path) -> None:
    record = record_of(solution)
    with Store(tmp_path / "results.db") as store:
        store.put([(solution.scene, record)])
        with small_disk(100), pytest.raises(StoreError):
            store.put([(Scene(), record)])
    with Store(tmp_path / "results.db") as store:
        assert (store.get(solution.scene), store.get(Scene())) == (record, None)


def test_replacing_keeps_a_link_and_follows_it(tmp_path: Path) -> None:
    target, link = tmp_path / "far" / "target.txt", tmp_path / "link.txt"
    target.parent.mkdir()
    link.symlink_to(target)
    for text in ("new", "newer"):
        with replacing(link) as part:
            part.write_text(text)
        assert link.is_symlink()
        assert target.read_text() == text
    assert len(list(tmp_path.rglob("*"))) == 3


@pytest.mark.parametrize("mode", [0o600, 0o644, 0o664])
def test_a_new_version_of_a_file_keeps_its_permissions_and_owner(tmp_path: Path, mode: int) -> None:
    path, other = tmp_path / "a.txt", 65534 if os.geteuid() == 0 else os.geteuid()
    path.write_text("old")
    os.chown(path, other, -1)
    path.chmod(mode)
    with replacing(path) as part:
        part.write_text("new")
    status = path.stat()
    assert (status.st_mode & 0o777, status.st_uid, path.read_text()) == (mode, other, "new")


def test_a_new_file_has_the_usual_permissions_and_may_have_a_long_name(tmp_path: Path) -> None:
    path, before = tmp_path / f"{250 * 'a'}.txt", os.umask(0o027)
    try:
        require_writable(path)
        with replacing(path) as part:
            part.write_text("new")
    finally:
        os.umask(before)
    assert (path.stat().st_mode & 0o777, path.read_text()) == (0o640, "new")


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, SystemExit])
def test_replacing_removes_what_an_exception_leaves(
    tmp_path: Path, error: type[BaseException]
) -> None:
    def write() -> None:
        with replacing(tmp_path / "a.txt") as part:
            part.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("out", ["file", "file/below", "page"])
def test_reports_refuse_an_impossible_directory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "page" / "index.html").mkdir(parents=True)
    assert make_report(["accuracy", "--quick", "--out", str(tmp_path / out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / out) in line


# ------------------------------------------------------------------------------------------- ends


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (InputError("a = 1: bad", "b\n\x9b = 2: bad"), 2, "a = 1: bad\nb\\n\\x9b = 2: bad\n"),
        (FileError("a.vtu: full"), 2, "a.vtu: full\n"),
        (OSError(28, "No space left on device", "a.svg"), 2, "a.svg: No space left on device\n"),
        (InputError(*"x" * 130), 2, "x\n" * 120 + "there are more mistakes; correct these first\n"),
        (InputError("x" * 10_000), 2, "x" * 397 + "...\n"),
        (KeyboardInterrupt(), 130, "test: interrupted\n"),
        (BrokenPipeError(), 141, ""),
    ],
)
def test_ends_have_a_code_and_lines(
    capsys: pytest.CaptureFixture[str], error: BaseException, code: int, told: str
) -> None:
    def job() -> int:
        raise error

    assert run_program("test", job) == code
    assert capsys.readouterr() == ("", told)


def process(*command: object) -> subprocess.CompletedProcess[str]:
    arguments = [str(word) for word in command]
    how = {"cwd": ROOT, "timeout": 60, "check": False, "capture_output": True, "text": True}
    return subprocess.run(arguments, **how)


@pytest.mark.parametrize(
    ("rest", "told"),
    [
        ("--json >/dev/full", ["standard output"]),
        (">&-", ["standard output"]),
        # complaints that nobody can read keep the exit code
        ("--json --set load.force_N=-1 2>/dev/full", []),
    ],
)
def test_a_result_that_cannot_be_told_is_no_success(
    scene: Path, rest: str, told: list[str]
) -> None:
    run = process("sh", "-c", f"{sys.executable} -m pvdf_fem solve {scene} {rest}")
    assert (run.returncode, run.stdout) == (2, "")
    assert [line.partition(": ")[0] for line in run.stderr.splitlines()] == told


def test_charges_are_told_though_a_file_cannot_be_written(scene: Path) -> None:
    line = f"ulimit -f 1; exec {sys.executable} -m pvdf_fem solve {scene} --json --vtu {scene}.vtu"
    run = process("sh", "-c", line)
    assert (run.returncode, json.loads(run.stdout)["status"]) == (2, "converged")
    assert run.stderr.startswith(f"{scene}.vtu: ")
    assert [file.name for file in scene.parent.iterdir()] == [scene.name]


#: Interrupts itself when the third tangent is assembled: no clock, so no race with the solve.
IN_A_SOLVE = """
from pvdf_fem.film.equilibrium import Equilibrium
assembled, tangent = [], Equilibrium.tangent
def counted(*arguments):
    assembled.append(1)
    if len(assembled) == 3:
        os.kill(os.getpid(), signal.SIGINT)
    return tangent(*arguments)
Equilibrium.tangent = counted
"""
#: Interrupts itself at the first import of a module, by the program or by another one.
IN_AN_IMPORT = """
import importlib.abc
class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.modules.pop("argparse", None)
"""


@pytest.mark.parametrize(
    "begin", [IN_A_SOLVE, *(IN_AN_IMPORT.format(module=name) for name in ("argparse", "gmsh"))]
)
def test_an_interrupted_solve_is_told_in_a_line_and_leaves_the_old_files(begin, scene):
    old = scene.with_name("a.vtu")
    old.write_text("old")
    arguments = ["solve", *map(str, (scene, "--vtu", old, "--plot", scene.with_name("a.png")))]
    code = (
        "import os, runpy, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"{begin}\n"
        f"sys.argv[:] = ['pvdf-fem', *{arguments!r}]\n"
        "runpy.run_module('pvdf_fem', run_name='__main__')\n"
    )
    run = process(sys.executable, "-c", code)
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (130, "", 1)
    assert {file.name for file in scene.parent.iterdir()} == {scene.name, old.name}
    assert old.read_text() == "old"
