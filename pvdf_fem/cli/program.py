"""What commands share: options of a scene, exit codes, and a line for what stopped a program."""

from __future__ import annotations

import argparse
import io
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from pvdf_fem.files import FileError, escape_unprintable, require_writable
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.scene.scene_file import SceneError, parse_change, quote, read_key_texts, suggest
from pvdf_fem.solver.nonlinear.status import NotConvergedError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pvdf_fem.scene.scene import Scene

MAX_LINE_LENGTH = 400  #: Largest number of characters in a line of complaint; longer lines are cut.
MAX_LINES = 120  #: Largest number of mistakes that are told, a line each.


class ExitCode(IntEnum):
    """How a program ended."""

    CONVERGED = 0
    BAD_INPUT = 2
    NOT_CONVERGED = 3
    INTERRUPTED = 130
    BROKEN_PIPE = 141


class InputError(Exception):
    """The input cannot be used; each argument of the exception is a line about a mistake."""


@contextmanager
def convert_value_errors() -> Iterator[None]:
    """A context in which a `ValueError` is about the input, a line for each mistake."""
    try:
        yield
    except ValueError as error:
        raise InputError(*getattr(error, "problems", str(error).splitlines())) from error


class ArgumentParser(argparse.ArgumentParser):
    """A parser whose complaints repeat arguments escaped, and shortened if they are long, and that
    offer the command that is nearest to an unknown one."""

    def error(self, message: str) -> NoReturn:
        command = r"argument COMMAND: invalid choice: '(.*)' \(choose from (.*)\)"
        if found := re.fullmatch(command, message):
            known = re.findall(r"\w+", found[2])
            message = f"{found[1]} is no command; {suggest(found[1], known)}"
        super().error(_line(message))


def add_command(
    commands: Any,
    name: str,
    run: Callable[[argparse.Namespace], int],
    summary: str,
    description: str,
    epilog: str,
) -> argparse.ArgumentParser:
    """Add a command to the commands of a parser; `run` returns its exit code."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run, parser=parser)
    return parser


def describe_unknown_argument(words: Sequence[str], parser: argparse.ArgumentParser) -> str:
    """What is wrong with words on the command line that no option of a command takes."""
    name, _, value = (words[0] if "=" in words[0] else "=".join(words[:2])).partition("=")
    if not name.startswith("-"):
        return f"{words[0]}: is one argument too many; remove it, or write --set KEY=VALUE"
    named = re.compile(rf"{re.escape(name.strip('-').replace('-', '_'))}(_\w+)?")  # a unit
    found = (k for k in read_key_texts() if "[[" not in k.table and named.fullmatch(k.name))
    options = [text for action in parser._actions for text in action.option_strings]
    meant = (f"write --set {key.table.strip('[]')}.{key.name}={value}" for key in found)
    return f"{words[0]}: is no option here; {next(meant, suggest(name, options))}"


def add_scene_command(
    commands: Any, *about: Any, as_json: str = "print one JSON object and nothing else"
) -> argparse.ArgumentParser:
    """A command about a scene; `about` are the arguments of `add_command`, as_json its help."""
    parser = add_command(commands, *about)
    parser.add_argument("scene", metavar="SCENE.toml", help="scene file")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="settings",
        help="change a value of the scene, such as load.force_N=2 or electrodes[0].x_mm=9; VALUE "
        "is TOML, and a bare word is text; a table, as in 'film={thickness_um=12}', changes the "
        "keys that it has; may be given several times, the last counts",
    )
    if as_json:
        parser.add_argument("--json", action="store_true", help=as_json)
    return parser


def read_scene(options: argparse.Namespace, *mistakes: str) -> Scene:
    """The scene with its changes; raises `InputError` with the given mistakes and its own."""
    from pvdf_fem.scene.changes import normalize_key
    from pvdf_fem.scene.scene import Scene

    problems = list(mistakes)
    changes: dict[str, Any] = {}
    for text in options.settings:
        try:
            key, value = parse_change(text)
            before = changes.get(key := normalize_key(key))
            if isinstance(value, dict) and isinstance(before, dict):
                value = before | value
            changes[key] = value
        except SceneError as error:
            problems += [f"--set {told}" for told in error.problems]
    try:
        given: Scene = Scene.from_file(options.scene)
        scene = given.with_(**changes) if changes else given
    except SceneError as error:
        problems += error.problems
    if problems:
        raise InputError(*problems)
    for lost in _lost(given, scene, changes) if changes else ():
        _tell(f"--set: leaves out {lost}, a key that the changed scene does not have")
    return scene


def _lost(given: Scene, scene: Scene, changes: Mapping[str, Any]) -> Iterator[str]:
    """What a scene file has and the changed scene has not, though no change names it."""
    from pvdf_fem.scene.changes import find_changed_keys

    set_before = given.model_dump(mode="json", exclude_unset=True, exclude_none=True)
    after, known = scene.model_dump(mode="json", exclude_none=True), find_changed_keys(changes)
    for name, section in set_before.items():
        tables = (s if isinstance(s, list) else [s] for s in (section, after.get(name, {})))
        for old, new in zip(*tables, strict=False):
            for key in (f"{name}.{key}" for key in old if key not in new):
                if not known & {name, key}:
                    yield f"{key} = {quote(old[key.rpartition('.')[2]])}"


def add_text_options(parser: Any, *options: tuple[str, str, str | None, str]) -> None:
    """Add options with a text for a value: name, stand-in of the value, default, help."""
    for name, metavar, default, about in options:
        about = about if default is None else f"{about} (default: {default})"
        parser.add_argument(name, metavar=metavar, default=default, help=about)


def add_progress(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--progress`` of commands that take long."""
    about = "tell what is done and how long the rest takes, on a terminal or not"
    parser.add_argument("--progress", action="store_true", default=None, help=about)


def find_output_errors(
    path: Path | None, extensions: Sequence[str], *others: Path | None
) -> list[str]:
    """Reasons for which a file could not be written. `extensions` are the extensions of known
    formats, and `others` are files not to be overwritten."""
    if path is None:
        return []
    if path.suffix.lower() not in extensions:
        return [f"{path}: has no extension of a known format; choose from {' '.join(extensions)}"]
    try:
        require_writable(path, *others)
    except FileError as error:
        return [str(error)]
    return []


def add_plot(parser: argparse.ArgumentParser, about: str) -> None:
    """Add the option ``--plot``; `about` is what it draws."""
    about = f"draw {about} (.png, .svg, .pdf, ...)"
    parser.add_argument("--plot", metavar="FILE", type=Path, help=about)


def save_plot(figure: Figure, options: argparse.Namespace) -> None:
    """Write what ``--plot`` draws."""
    from pvdf_fem.view.figures import save_figure

    save_figure(figure, options.plot)


def find_plot_errors(options: argparse.Namespace, *others: Path | None) -> list[str]:
    """Reasons for which the file of ``--plot``, if it is given, could not be written."""
    if options.plot is None:
        return []
    from matplotlib.backend_bases import FigureCanvasBase

    extensions = [f".{extension}" for extension in FigureCanvasBase.get_supported_filetypes()]
    return find_output_errors(options.plot, extensions, *others)


def run_program(name: str, job: Callable[[], int]) -> int:
    """Run a job and return its exit code, or the exit code of the exception that stopped the job.
    Exceptions are told on standard error: `InputError`, `FileError`, `GmshMissingError`,
    `SceneError` and `OSError`, which give `ExitCode.BAD_INPUT`, `NotConvergedError`, and an
    interrupt of the program `name`."""
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
    except NotConvergedError as error:
        _tell(f"not converged: {error}")
        return ExitCode.NOT_CONVERGED
    except (InputError, FileError, GmshMissingError) as error:
        _tell(*map(str, error.args))
        return ExitCode.BAD_INPUT
    except SceneError as error:  # of a scene that is valid, but not for this job
        _tell(*error.problems)
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
    """Print lines on standard error, shortened, and no more than `MAX_LINES`."""
    shown = [_line(line) for line in lines[:MAX_LINES]]
    if len(lines) > MAX_LINES:
        shown.append("there are more mistakes; correct these first")
    try:
        print(*shown, sep="\n", file=sys.stderr, flush=True)
    except OSError:  # nobody listens; the exit code still tells
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def _line(text: str) -> str:
    line = escape_unprintable(text)
    return line if len(line) <= MAX_LINE_LENGTH else line[: MAX_LINE_LENGTH - 3] + "..."
