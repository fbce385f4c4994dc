"""Running a program: exit codes, error messages on standard error, and logging."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum

from pvdf_fem.files import FileError, escape_unprintable
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solver.nonlinear.status import NotConvergedError

MAX_LINE_LENGTH = 400  #: Maximum number of characters of an error message.
MAX_LINES = 120  #: Maximum number of error messages that are printed, one on each line.


class ExitCode(IntEnum):
    """The exit codes of programs. Programs that solve nothing also end with `CONVERGED`."""

    CONVERGED = 0
    BAD_INPUT = 2
    NOT_CONVERGED = 3
    INTERRUPTED = 130
    BROKEN_PIPE = 141


class InputError(Exception):
    """Invalid input of a program. Each argument of the exception is the message of one error."""


@contextmanager
def convert_value_errors() -> Iterator[None]:
    """Convert a `ValueError` in this context to an `InputError` with a message for each line.

    Raises
    ------
    InputError
        If the context raises a `ValueError`. The messages of a `SceneError` are its `problems`.
    """
    try:
        yield
    except SceneError as error:
        raise InputError(*error.problems) from error
    except ValueError as error:
        raise InputError(*str(error).splitlines()) from error


def run_program(name: str, job: Callable[[], int]) -> int:
    """Run a job, and return its exit code or the exit code of the exception that stopped it.

    The messages of an exception go to standard error. `InputError`, `FileError`, `SceneError`,
    `GmshMissingError` and `OSError` give `ExitCode.BAD_INPUT`, `NotConvergedError` gives
    `ExitCode.NOT_CONVERGED`, and Ctrl-C gives `ExitCode.INTERRUPTED`. A closed pipe gives
    `ExitCode.BROKEN_PIPE` without a message. Other exceptions are not caught.

    Parameters
    ----------
    name : str
        Name of the program, for the message after Ctrl-C.
    job : callable
        Function that does the work of the program and returns its exit code.

    Returns
    -------
    int
        The exit code of the program.
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
        warnings.simplefilter("ignore")  # the interrupted code may have left resources open
        # CPython remembers an interrupt during an import, and would then exit by the signal
        # instead of with our exit code; executing any other code resets this
        exec("")
        print_errors(f"{name}: interrupted")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        _discard_output()
        return ExitCode.BROKEN_PIPE
    except NotConvergedError as error:
        print_errors(f"not converged: {error}")
        return ExitCode.NOT_CONVERGED
    except SceneError as error:  # such as a valid scene that this job does not support
        print_errors(*error.problems)
        return ExitCode.BAD_INPUT
    except (InputError, FileError, GmshMissingError) as error:
        print_errors(*map(str, error.args))
        return ExitCode.BAD_INPUT
    except OSError as error:  # an error without a file name is about standard output
        _discard_output()
        print_errors(f"{error.filename or 'standard output'}: {error.strerror or error}")
        return ExitCode.BAD_INPUT


def print_errors(*messages: str) -> None:
    """Print at most `MAX_LINES` shortened messages on standard error, one on each line.

    If standard error cannot be written, it is redirected to the null device.
    """
    lines = [shorten(message) for message in messages[:MAX_LINES]]
    if len(messages) > MAX_LINES:
        lines.append("there are more errors; correct these first")
    try:
        print(*lines, sep="\n", file=sys.stderr, flush=True)
    except OSError:  # standard error is closed or full; the exit code remains
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def shorten(message: str) -> str:
    """Return a message as one line of at most `MAX_LINE_LENGTH` printable characters.

    A longer message is cut, and then ends with three dots.
    """
    line = escape_unprintable(message)
    if len(line) <= MAX_LINE_LENGTH:
        return line
    return line[: MAX_LINE_LENGTH - 3] + "..."


@contextmanager
def log_to_stderr(verbosity: int) -> Iterator[None]:
    """Print the log messages of the package on standard error within this context.

    Parameters
    ----------
    verbosity : int
        Count of ``-v`` on the command line: 0 prints no messages, 1 prints INFO, 2 also DEBUG.
    """
    if verbosity == 0:
        yield
        return
    import logging

    from pvdf_fem.log import logger

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("[{relativeCreated:8.0f} ms] {message}", style="{"))
    level_before = logger.level
    logger.setLevel(logging.INFO if verbosity == 1 else logging.DEBUG)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level_before)


def _prepare_streams() -> None:
    """Let standard output and standard error accept characters that they cannot encode.

    If there is no standard error, the null device takes its place.
    """
    if sys.stderr is None:  # print() would write to standard output instead
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without ± must not stop a run
            stream.reconfigure(errors="backslashreplace")


def _discard_output() -> None:
    """Redirect standard output to the null device, so that flushing it at exit does not fail.

    A stream that has replaced `sys.stdout`, as in tests, is not changed.
    """
    if sys.stdout is sys.__stdout__ and sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
