"""How programs end, and that their files appear whole or not at all."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from pvdf_fem.cli.program import InputError, log_to_stderr, run_program
from pvdf_fem.files import FileError, replace_file
from pvdf_fem.log import logger
from pvdf_fem.solver.nonlinear.status import NotConvergedError

ROOT = Path(__file__).parents[2]


@contextmanager
def small_disk():
    """Files hold 500 bytes. Not a fixture: the tests' own output may go to a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


# ------------------------------------------------------------------------------------------ files


@pytest.mark.parametrize(
    "line",
    [
        "mesh scene.toml a.msh",
        "solve scene.toml --json --plot a.png",
        "locate scene.toml --quick --csv many.csv --output a.csv",
        "dataset disc.toml --touches 20 --output a.csv",
        "design disc.toml --step 12 --output a.nc",
    ],
)
def test_a_full_disk_leaves_the_old_file_and_prints_the_result(
    line, folder, made_up_responses, command
):
    folder.joinpath("many.csv").write_text("A,B,C,D\n" + 9 * "905,731,600,640\n")
    path = Path(line.split()[-1])
    path.write_text("old")
    before = {*folder.iterdir()}
    with small_disk():
        run = command(*line.split())
    assert (run.code, run.stderr_keys[-1]) == (2, str(path))
    assert ({*folder.iterdir()}, path.read_text()) == (before, "old")
    assert "--json" not in line or run.json["status"] == "converged"


@pytest.mark.parametrize("mode", [0o600, 0o664])
def test_a_file_is_replaced_where_a_link_leads_with_its_permissions_and_owner(tmp_path, mode):
    target, link = tmp_path / "far" / "target.txt", tmp_path / "link.txt"
    target.parent.mkdir()
    target.write_text("old")
    link.symlink_to(target)
    owner = os.geteuid() or 65534  # root may give it away
    os.chown(target, owner, -1)
    target.chmod(mode)
    with suppress(KeyboardInterrupt), replace_file(link) as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert target.read_text() == "old"
    with replace_file(link) as part:
        part.write_text("new")
    status = target.stat()
    assert (status.st_mode & 0o777, status.st_uid, target.read_text()) == (mode, owner, "new")
    assert (link.is_symlink(), len(list(tmp_path.rglob("*")))) == (True, 3)


# ------------------------------------------------------------------------------------------- ends


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (InputError("a = 1: bad", "b\n\x9b = 2: bad"), 2, "a = 1: bad\nb\\n\\x9b = 2: bad\n"),
        (FileError("a.vtu: full"), 2, "a.vtu: full\n"),
        (OSError(28, "No space left on device", "a.svg"), 2, "a.svg: No space left on device\n"),
        (InputError(*"x" * 130), 2, "x\n" * 120 + "there are more errors; correct these first\n"),
        (InputError(400 * "x", 401 * "y"), 2, 400 * "x" + "\n" + 397 * "y" + "...\n"),
        (NotConvergedError("slack"), 3, "not converged: slack\n"),
        (KeyboardInterrupt(), 130, "test: interrupted\n"),
        (BrokenPipeError(), 141, ""),
    ],
)
def test_exceptions_give_an_exit_code_and_messages(capsys, error, code, message):
    def job():
        raise error

    assert run_program("test", job) == code
    assert capsys.readouterr() == ("", message)


def process(*command, cwd=ROOT):
    how = {"cwd": cwd, "timeout": 60, "check": False, "capture_output": True, "text": True}
    return subprocess.run(command, **how)


@pytest.mark.parametrize(
    ("rest", "keys"),
    [
        ("keys >/dev/full", ["standard output"]),
        ("keys >&-", ["standard output"]),
        # an error message that cannot be printed keeps the exit code
        ("example none 2>/dev/full", []),
        ("example none 2>&-", []),
    ],
)
def test_a_result_that_cannot_be_printed_is_an_error(rest, keys):
    run = process("sh", "-c", f"{sys.executable} -m pvdf_fem {rest}")
    assert (run.returncode, run.stdout) == (2, "")
    assert [line.partition(": ")[0] for line in run.stderr.splitlines()] == keys


#: Interrupts itself at the first import of a module, by the program or by another one.
INTERRUPTED = """
import importlib.abc
class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.modules.pop("argparse", None)
"""


@pytest.mark.parametrize("module", ["argparse", "gmsh", "meshio"])
def test_an_interrupted_solve_prints_one_line_and_leaves_the_old_files(module, folder):
    """At the start, in the solve and in writing; by the place in the code, so without a race."""
    folder.joinpath("a.vtu").write_text("old")
    before = {*folder.iterdir()}
    arguments = ["solve", "scene.toml", "--vtu", "a.vtu", "--plot", "a.png"]
    code = (
        "import os, runpy, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"{INTERRUPTED.format(module=module)}\n"
        f"sys.argv[:] = ['pvdf-fem', *{arguments!r}]\n"
        "runpy.run_module('pvdf_fem', run_name='__main__')\n"
    )
    run = process(sys.executable, "-c", code, cwd=folder)
    assert (run.returncode, run.stderr.count("\n")) == (130, 1)
    assert ("converged" in run.stdout) == (module == "meshio")  # finished results are printed
    assert {*folder.iterdir()} == before
    assert folder.joinpath("a.vtu").read_text() == "old"


# ------------------------------------------------------------------------------------ log messages


def log_messages(*_, **__):
    logger.info("mesh 1")
    logger.debug("Newton step 1")


@pytest.mark.parametrize(
    ("verbosity", "messages"), [(0, []), (1, ["mesh 1"]), (2, ["mesh 1", "Newton step 1"])]
)
def test_log_messages_are_printed_on_request(capsys, verbosity, messages):
    with log_to_stderr(verbosity):
        log_messages()
    log_messages()  # the handler is gone
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.partition("] ")[2] for line in err.splitlines()] == messages


@pytest.mark.parametrize(
    ("line", "lines"),
    [
        ("modes scene.toml", 0),
        ("-v modes scene.toml", 1),
        ("modes scene.toml -v", 1),
        ("modes -vv scene.toml", 2),
        ("--verbose --verbose modes scene.toml", 2),
    ],
)
def test_the_option_stands_before_or_behind_the_command(folder, command, monkeypatch, line, lines):
    def solve(*_):
        log_messages()
        raise NotConvergedError("slack")

    monkeypatch.setattr("pvdf_fem.dynamics.modes.modes", solve)
    run = command(*line.split())
    assert (run.code, run.out) == (3, "")
    assert len(run.err.splitlines()) == lines + 1


def test_the_package_is_silent_by_default():
    code = "from pvdf_fem.log import logger; logger.warning('a warning')"
    run = process(sys.executable, "-c", code)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
