"""The command ``pvdf-fem explore``: an interactive page about a scene."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import MAX_QUOTED, add_scene_command, add_text_option, read_scene
from pvdf_fem.cli.program import ExitCode, InputError

_DESCRIPTION = """\
A page in the browser, served on this machine only (127.0.0.1): drag, turn and press
the probe, change film and electrodes, and see deflection or stress, charges,
readings, and how well noisy readings determine the touch. Every plot is a full
solve. A file for load.profile must be named in the scene file: the page does not
open other files."""

_EPILOG = """\
examples:
  pvdf-fem explore scene.toml
  pvdf-fem explore scene.toml --port 8000 --no-browser

The address in the browser is the state of the page: keep it or send it. Ctrl-C ends
the command.

exit codes: 0 ended by Ctrl-C, 2 bad input, or a port that is in use"""

_MAX_PORT = 65535


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem explore`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "explore",
        run,
        summary="an interactive page about a scene",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        json_help="",
    )
    add_text_option(
        parser, "--port", "PORT", about="port of the page; 0 is any free one", default="0"
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the address")


def run(options: argparse.Namespace) -> int:
    """Serve the interactive page about a scene until Ctrl-C, and return the exit code.

    Raises
    ------
    InputError
        If an option or the scene is invalid, or if the port cannot be used.
    """
    errors = []
    option = f"--port {options.port[:MAX_QUOTED]}"
    is_number = options.port.isascii() and options.port.isdecimal()
    if not is_number or int(options.port[:9]) > _MAX_PORT:
        errors.append(f"{option}: must be an integer from 0 to {_MAX_PORT}")
    scene = read_scene(options, *errors)
    from pvdf_fem.explore.server import serve

    try:
        serve(scene, Path(options.scene), int(options.port), not options.no_browser)
    except OSError as error:
        raise InputError(f"{option}: {error.strerror}; give another port") from error
    return ExitCode.CONVERGED
