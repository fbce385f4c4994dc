"""The command ``pvdf-fem``.

Slow modules are imported where they are used, so that help and most error messages come at once.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Sequence

from pvdf_fem import __version__
from pvdf_fem.cli import explore, mesh, model, modes, respond, solve, texts
from pvdf_fem.cli.inverse import calibrate, locate, track
from pvdf_fem.cli.options import ArgumentParser, add_verbosity, describe_unknown_argument
from pvdf_fem.cli.program import ExitCode, InputError, log_to_stderr, run_program
from pvdf_fem.cli.studies import dataset, design, report, sweep
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

#: The modules of commands, in the order of the help.
_COMMANDS: tuple[Callable[[argparse._SubParsersAction[ArgumentParser]], None], ...] = (
    texts.add_parsers,
    solve.add_parser,
    mesh.add_parser,
    modes.add_parser,
    respond.add_parser,
    sweep.add_parser,
    report.add_parser,
    model.add_parser,
    locate.add_parser,
    track.add_parser,
    calibrate.add_parser,
    design.add_parser,
    dataset.add_parser,
    explore.add_parser,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command ``pvdf-fem``.

    Parameters
    ----------
    arguments : sequence of str, optional
        The command line without the name of the program; by default that of this process.

    Returns
    -------
    int
        The exit code, one of `pvdf_fem.cli.program.ExitCode`.
    """
    return run_program("pvdf-fem", lambda: _run(arguments))


def make_parser() -> ArgumentParser:
    """Return the parser of the whole command line."""
    parser, _ = _make_parsers()
    return parser


def make_command_parsers() -> dict[str, ArgumentParser]:
    """Return the parser of each command, by the command's name."""
    _, parsers = _make_parsers()
    return parsers


def _make_parsers() -> tuple[ArgumentParser, dict[str, ArgumentParser]]:
    """Return the parser of the whole command line, and those of its commands by name."""
    parser = ArgumentParser(
        "pvdf-fem", description=_DESCRIPTION, epilog=_EPILOG.format(keys=_list_keys())
    )
    parser.add_argument("--version", action="version", version=f"pvdf-fem {__version__}")
    add_verbosity(parser)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for add_parser in _COMMANDS:
        add_parser(commands)
    return parser, dict(commands.choices)


def _run(arguments: Sequence[str] | None) -> int:
    """Parse the command line, run the command, and return its exit code."""
    parser = make_parser()
    options, unknown = parser.parse_known_args(arguments)
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


def _list_keys() -> str:
    """Return the names of all keys of a scene file, in lines by table."""
    names: dict[str, list[str]] = {}
    for key in read_key_texts():
        of_table = names.setdefault(key.table, [])
        if key.name not in of_table:
            of_table.append(key.name)
    wrapper = textwrap.TextWrapper(79, initial_indent=2 * " ", subsequent_indent=20 * " ")
    lines = [wrapper.fill(f"{table:<18}{', '.join(keys)}") for table, keys in names.items()]
    return "\n".join(lines)
