"""The command ``pvdf-fem explore``: a page to play with a scene."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_scene_command,
    add_text_options,
    read_scene,
)
from pvdf_fem.cli.response_choice import read_number

DESCRIPTION = """\
A page in the browser, served on this machine only (127.0.0.1): drag, turn and press
the probe, change film and electrodes, and see deflection or stress, charges,
readings, and how well noisy readings tell the touch. Every picture is a full solve.
A file as load.profile must be named by the scene file: the page reads no other."""
EPILOG = """\
examples:
  pvdf-fem explore scene.toml
  pvdf-fem explore scene.toml --port 8000 --no-browser

The address in the browser is the state of the page: keep or send it. Ctrl-C ends it.

exit codes: 0 ended by Ctrl-C, 2 bad input, or a port that is taken"""


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    summary = "a page to play with a scene"
    parser = add_scene_command(commands, "explore", run, summary, DESCRIPTION, EPILOG, as_json="")
    add_text_options(parser, ("--port", "PORT", "0", "port of the page; 0 is any free one"))
    parser.add_argument("--no-browser", action="store_true", help="only print the address")


def run(options: argparse.Namespace) -> int:
    """Run the command until it is interrupted."""
    port, taken = read_number(options.port), f"--port {options.port[:60]}"
    mistakes = [] if port in range(65536) else [f"{taken}: is no port; give 0 to 65535"]
    scene = read_scene(options, *mistakes)
    from pvdf_fem.explore.server import serve

    try:
        serve(scene, Path(options.scene), int(port or 0), not options.no_browser)
    except OSError as error:
        raise InputError(f"{taken}: {error.strerror}; give another") from error
    return ExitCode.CONVERGED
