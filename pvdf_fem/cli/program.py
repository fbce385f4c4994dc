"""How a program of this package ends: exit codes, and a line for what stopped it."""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from enum import IntEnum
from pathlib import Path
from typing import Any, NoReturn

from pvdf_fem.files import FileError, printable, require_writable
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError

#: Largest number of characters in a line of complaint; longer lines are cut.
LONGEST_LINE = 400
#: Largest number of mistakes that are told, a line each.
MOST_LINES = 120


class ExitCode(IntEnum):
    """How a program ended."""

    CONVERGED = 0
    BAD_INPUT = 2
    NOT_CONVERGED = 3
    INTERRUPTED = 130
    BROKEN_PIPE = 141


class InputError(Exception):
    """The input cannot be used; each argument of the exception is a line about a mistake."""


class ArgumentParser(argparse.ArgumentParser):
    """A parser whose complaints repeat arguments escaped, and shortened if they are long."""

    def error(self, message: str) -> NoReturn:
        super().error(_line(message))


def add_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], int],
    summary: str,
    description: str,
    epilog: str,
) -> argparse.ArgumentParser:
    """Add a command to those of a parser; `run` returns its exit code."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    return parser


def output_mistakes(
    path: Path | None, extensions: Sequence[str], *others: Path | None
) -> list[str]:
    """Reasons for which a file could not be written.

    `extensions` are those of known formats, and `others` are files that it must not overwrite.
    """
    if path is None:
        return []
    if path.suffix.lower() not in extensions:
        return [f"{path}: has no extension of a known format; choose from {' '.join(extensions)}"]
    try:
        require_writable(path, *others)
    except FileError as error:
        return [str(error)]
    return []


def run_program(name: str, job: Callable[[], int]) -> int:
    """Run a job and return its exit code, or that of the exception that stopped it.

    The exception is told on standard error: `InputError`, `FileError`, `GmshMissingError` and
    `OSError`, which give `ExitCode.BAD_INPUT`, and an interrupt of the program `name`.
    """
    _prepare_streams()
    try:
        if sys.stdout is None:
            raise InputError("standard output: is closed; redirect it to a file instead")
        try:
            return job()
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        warnings.simplefilter("ignore")  # resources that nobody closed
        # an interrupted import leaves a note for which Python would end by the signal; running any
        # other code, even none, removes the note
        exec("")
        _tell(f"{name}: interrupted")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        _drop_output()
        return ExitCode.BROKEN_PIPE
    except (InputError, FileError, GmshMissingError) as error:
        _tell(*map(str, error.args))
        return ExitCode.BAD_INPUT
    except OSError as error:
        # the file is one that nothing else guards, or standard output if it has no name
        _drop_output()
        _tell(f"{error.filename or 'standard output'}: {error.strerror or error}")
        return ExitCode.BAD_INPUT


def _prepare_streams() -> None:
    """Make standard output and error safe to print any text to."""
    if sys.stderr is None:  # print() would take standard output instead
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without ± must not end a run
            stream.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """Discard standard output, so that Python's last flush of it does not complain again."""
    if sys.stdout is sys.__stdout__ and sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(*lines: str) -> None:
    """Print lines on standard error, shortened, and no more than `MOST_LINES`."""
    shown = [_line(line) for line in lines[:MOST_LINES]]
    if len(lines) > MOST_LINES:
        shown.append("there are more mistakes; correct these first")
    try:
        print(*shown, sep="\n", file=sys.stderr, flush=True)
    except OSError:  # nobody listens; the exit code still tells
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def _line(text: str) -> str:
    line = printable(text)
    return line if len(line) <= LONGEST_LINE else line[: LONGEST_LINE - 3] + "..."
