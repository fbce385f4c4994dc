"""The command ``pvdf-fem``.

Slow modules are imported inside functions, so that help and most error messages appear at once.
Only the module of the command that runs is imported.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable, Sequence
from importlib import import_module

from pvdf_fem import __version__
from pvdf_fem.cli.options import ArgumentParser, add_verbosity, describe_unknown_argument
from pvdf_fem.cli.program import ExitCode, InputError, log_to_stderr, run_program
from pvdf_fem.scene.scene_file import read_key_texts

_DESCRIPTION = """\
A model of a membrane PVDF tactile sensor: charges of its electrodes when a
probe presses on the stretched film, by nonlinear finite elements."""

_EPILOG = """\
examples:
  pvdf-fem example triangle > scene.toml
  pvdf-fem solve scene.toml --set load.force_N=2 --plot scene.png

scene files are TOML. These are their keys; each has a default, and `pvdf-fem keys`
explains them:
{keys}
`[[electrodes]]` replaces a layout by a list of electrodes with names, and `[[probe]]`
is a list of several probes, each with the keys in which it differs from [load].

`pvdf-fem COMMAND --help` explains a command, and for `sweep` also sweep files.

exit codes: 0 converged, 2 bad input or an output that cannot be written,
3 not converged, 130 interrupted"""

#: Modules of the commands, in the order of the help. Each has a function `add_parser`.
_MODULES = {
    "example": "pvdf_fem.cli.texts",
    "keys": "pvdf_fem.cli.texts",
    "materials": "pvdf_fem.cli.materials",
    "solve": "pvdf_fem.cli.solve",
    "mesh": "pvdf_fem.cli.files.mesh",
    "deck": "pvdf_fem.cli.files.deck",
    "draw": "pvdf_fem.cli.files.draw",
    "modes": "pvdf_fem.cli.modes",
    "respond": "pvdf_fem.cli.respond",
    "sweep": "pvdf_fem.cli.studies.sweep",
    "report": "pvdf_fem.cli.studies.report",
    "model": "pvdf_fem.cli.model",
    "locate": "pvdf_fem.cli.inverse.locate",
    "track": "pvdf_fem.cli.inverse.track",
    "calibrate": "pvdf_fem.cli.inverse.calibrate",
    "design": "pvdf_fem.cli.studies.design",
    "dataset": "pvdf_fem.cli.studies.dataset",
    "explore": "pvdf_fem.cli.explore",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the subcommand of a command line, and print errors on standard error.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command-line arguments without the name of the program. Default: those of this process.

    Returns
    -------
    int
        The exit code, one of `pvdf_fem.cli.program.ExitCode`.

    Raises
    ------
    SystemExit
        After ``--help`` or ``--version``, and if `argparse` finds an error.
    """
    return run_program("pvdf-fem", lambda: _run_command(arguments))


def make_parser() -> ArgumentParser:
    """Make the parser of the command line, which has all subcommands."""
    parser, _ = _make_parsers(_MODULES)
    return parser


def make_command_parsers() -> dict[str, ArgumentParser]:
    """Make the parser of each subcommand, and return these parsers by name of the subcommand."""
    _, parsers = _make_parsers(_MODULES)
    return parsers


def _make_parsers(names: Iterable[str]) -> tuple[ArgumentParser, dict[str, ArgumentParser]]:
    """Make the parser of the command line, and import only the modules of some subcommands.

    Parameters
    ----------
    names : iterable of str
        Names of the subcommands, keys of `_MODULES`.

    Returns
    -------
    parser : ArgumentParser
        The parser of the command line, which knows these subcommands only.
    parsers : dict of str to ArgumentParser
        The parsers of the subcommands by name. These are all subcommands of the imported modules,
        which may be more than `names`.
    """
    parser = ArgumentParser(
        "pvdf-fem", description=_DESCRIPTION, epilog=_EPILOG.format(keys=_list_keys())
    )
    parser.add_argument("--version", action="version", version=f"pvdf-fem {__version__}")
    add_verbosity(parser)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for module in dict.fromkeys(_MODULES[name] for name in names):
        import_module(module).add_parser(commands)
    return parser, dict(commands.choices)


def _run_command(arguments: Sequence[str] | None) -> int:
    """Parse command-line arguments, run the subcommand, and return the exit code.

    Without a subcommand, the help is printed and the exit code is `ExitCode.BAD_INPUT`.

    Parameters
    ----------
    arguments : sequence of str or None
        Arguments without the name of the program. None for those of this process.

    Raises
    ------
    InputError
        If there is an argument that the subcommand does not have.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    command = _find_command(words)
    parser, _ = _make_parsers([command] if command else _MODULES)
    options, unknown = parser.parse_known_args(words)
    has_command = "run" in options
    if unknown:
        message = describe_unknown_argument(unknown, options.parser if has_command else parser)
        raise InputError(message)
    if not has_command:
        parser.print_help()
        return ExitCode.BAD_INPUT
    with log_to_stderr(options.verbose):
        code: int = options.run(options)
    return code


def _find_command(words: Sequence[str]) -> str | None:
    """Return the first word if it is a subcommand, otherwise None.

    Options ``-v`` in front of it are skipped. The result is None if any other option, such as
    ``--help``, or an unknown word comes first.
    """
    for word in words:
        if word in _MODULES:
            return word
        is_verbosity = word == "--verbose" or re.fullmatch("-v+", word)
        if not is_verbosity:
            return None
    return None


def _list_keys() -> str:
    """Return a text with the names of all keys of a scene file, a wrapped line for each table."""
    names: dict[str, list[str]] = {}
    for key in read_key_texts():
        table_names = names.setdefault(key.table, [])
        if key.name not in table_names:
            table_names.append(key.name)
    wrapper = textwrap.TextWrapper(79, initial_indent=2 * " ", subsequent_indent=20 * " ")
    lines = [wrapper.fill(f"{table:<18}{', '.join(keys)}") for table, keys in names.items()]
    return "\n".join(lines)
