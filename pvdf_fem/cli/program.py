"""How a program of this package ends: exit codes, and a line for what stopped it."""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

from pvdf_fem.files import FileError, printable, require_writable

CONVERGED, BAD_INPUT, NOT_CONVERGED, INTERRUPTED, BROKEN_PIPE = 0, 2, 3, 130, 141
#: Characters of a line of complaint, and lines that are told.
LONGEST_LINE, MOST_LINES = 400, 120


class InputError(Exception):
    """The input cannot be used; the arguments are the mistakes, a line each."""


class ArgumentParser(argparse.ArgumentParser):
    """A parser that repeats arguments in its complaints escaped, and not at any length."""

    def error(self, message: str) -> NoReturn:
        """Tell usage and mistake; exits with 2."""
        super().error(_line(message))


def output_mistakes(path: Path | None, extensions: Sequence[str]) -> list[str]:
    """What would keep a file from being written."""
    if path is None:
        return []
    if path.suffix.lower() not in extensions:
        return [f"{path}: has no extension of a known format; choose from {' '.join(extensions)}"]
    try:
        require_writable(path)
    except FileError as error:
        return [str(error)]
    return []


def run_program(name: str, job: Callable[[], int]) -> int:
    """Run a job; returns its exit code, or that of what stopped it, told on standard error.

    Parameters
    ----------
    name : str
        Of the program.
    job : callable
        Returns an exit code. `InputError`, `FileError` and `OSError` end in `BAD_INPUT`.
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
        warnings.simplefilter("ignore")  # of what was cut short
        # an import that was interrupted has noted that nobody waits for Ctrl-C, for which Python
        # would end by the signal; the next code that runs is what makes it forget
        exec("")
        _tell(f"{name}: interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        _drop_output()
        return BROKEN_PIPE
    except (InputError, FileError) as error:
        _tell(*map(str, error.args))
        return BAD_INPUT
    except OSError as error:
        # of a file that nothing else guards, else of standard output
        _drop_output()
        _tell(f"{error.filename or 'standard output'}: {error.strerror or error}")
        return BAD_INPUT


def _prepare_streams() -> None:
    if sys.stderr is None:  # print() would take standard output instead
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without ± must not end a run
            stream.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """Python flushes standard output once more at its end, which must not complain again."""
    if sys.stdout is sys.__stdout__ and sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(*lines: str) -> None:
    told = [_line(line) for line in lines[:MOST_LINES]]
    if len(lines) > MOST_LINES:
        told.append("there are more mistakes; correct these first")
    try:
        print(*told, sep="\n", file=sys.stderr, flush=True)
    except OSError:  # nobody listens; the exit code still tells
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def _line(text: str) -> str:
    line = printable(text)
    return line if len(line) <= LONGEST_LINE else line[: LONGEST_LINE - 3] + "..."
