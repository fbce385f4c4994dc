"""Options and fixtures of the whole suite.

Slow tests run by `./run test --all` only, the variable CPU_TIMES names a file for CPU times of
tests, and a fixture runs commands in this process.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import settings

from pvdf_fem.cli import main as cli

#: Examples of a property in `./run test --all`, drawn anew at each run.
EXAMPLES_OF_ALL = "2000"


def pytest_addoption(parser):
    parser.addoption("--all", action="store_true", help="slow tests too, and random examples")


def pytest_configure(config):
    """Choose the examples of properties, before the modules with properties are imported."""
    if config.getoption("--all"):
        os.environ.setdefault("PVDF_FEM_EXAMPLES", EXAMPLES_OF_ALL)
    examples = os.environ.get("PVDF_FEM_EXAMPLES")
    chosen = {"derandomize": examples is None, "max_examples": int(examples or 100)}
    settings.register_profile("suite", deadline=None, **chosen)
    settings.load_profile("suite")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--all"):  # the longest first, so that no process waits for another
        items.sort(key=lambda item: not {"slow", "hypothesis"} & {*item.keywords})
        return
    if slow := [item for item in items if "slow" in item.keywords]:
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in slow]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Append a test's CPU seconds, those of its processes included, to the file CPU_TIMES."""
    began = sum(os.times()[:4])
    result = yield
    if path := os.environ.get("CPU_TIMES"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"{sum(os.times()[:4]) - began:.2f} {item.nodeid}\n")
    return result


@dataclass(frozen=True)
class Run:
    """Exit code, standard output and standard error of a command."""

    code: int
    out: str
    err: str

    @classmethod
    def of(cls, arguments: tuple[object, ...], capsys: Any) -> Run:
        """Run a command."""
        try:
            code = cli.main([str(argument) for argument in arguments])
        except SystemExit as exit_:  # of argparse
            code = exit_.code
        return cls(code, *capsys.readouterr())

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    @property
    def stderr_keys(self) -> list[str]:
        """Keys with values, options or files at the beginning of each line of standard error."""
        lines = [line.removeprefix("warning: ") for line in self.err.splitlines()]
        return [line.partition(": ")[0] for line in lines]

    @property
    def error_keys(self) -> list[str]:
        """The same of a run that rejected its input."""
        assert (self.code, self.out) == (2, "")
        return self.stderr_keys


@pytest.fixture
def command(capsys):
    """Runs a command of the program in this process, and returns exit code and output."""
    return lambda *arguments: Run.of(arguments, capsys)
