"""The command ``pvdf-fem model``: build the response of a sensor, or list those that exist."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.options import add_scene_command, read_scene
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.cli.response_choice import (
    ResponseChoice,
    add_response_options,
    load_or_build_response,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

_DESCRIPTION = """\
The response of a sensor: the model of the charges as a function of the touch that
`locate`, `track`, `design` and `dataset` need. It is built unless a file beside the
scene file can be used, and printed with its error. The scene says where and how hard
the film is touched:

  [model]
  reach_mm = 12             # largest distance of the probe from the centre
  force_range_N = [0.1, 5]
  tolerance = "auto"        # a tenth of the noise of readings, or a number

A response for a larger reach and a wider range of forces can be used, too, also for
other electrodes and other values of d31 and d32."""

_EPILOG = """\
examples:
  pvdf-fem model sensor.toml
  pvdf-fem model sensor.toml --list
  pvdf-fem model sensor.toml --set model.reach_mm=8 --json

exit codes: 0 there is a response, 2 bad input, 3 there is none, or its error bound is
above the tolerance"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem model`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "model",
        run,
        summary="the response of a sensor, which locates touches",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--list", action="store_true", help="list the files of responses, and do not build one"
    )
    add_response_options(parser)


def run(options: argparse.Namespace) -> int:
    """Load or build the response of a sensor, and print it with its file.

    With ``--list`` the existing files are printed instead, and nothing is built.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if the error bound of the response is within the tolerance, or with
        ``--list`` if a file can be used. Otherwise `ExitCode.NOT_CONVERGED`.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    """
    scene = read_scene(options)
    errors: list[str] = []
    choice = ResponseChoice.from_options(options, errors)
    if scene.single_probe is None:
        errors.append(f"{options.scene}: has no [probe]; add one")
    if not errors:
        errors += choice.find_errors(scene, options.scene)
    if errors:
        raise InputError(*errors)
    if options.list:
        return _print_response_file_checks(list(choice.list_files(scene, options.scene)), options)
    response = load_or_build_response(scene, options.scene, choice)
    file = str(choice.find_path(scene, options.scene))
    if options.json:
        print(json.dumps({"file": file, **response.to_json()}))
    else:
        print(f"{file}: {response}")
    _, tolerance = choice.resolve_settings(scene)
    is_accurate = response.error_bound <= tolerance
    return ExitCode.CONVERGED if is_accurate else ExitCode.NOT_CONVERGED


def _print_response_file_checks(
    files: Sequence[tuple[Path, str]], options: argparse.Namespace
) -> int:
    """Print for each response file whether it can be used, as text or as JSON.

    Parameters
    ----------
    files : sequence of tuple of Path and str
        Each file with the reason why it cannot be used, or an empty text if it can.
    options : argparse.Namespace
        Options with `scene`, the path, and `json`, whether to print JSON.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if at least one file can be used, else `ExitCode.NOT_CONVERGED`.
    """
    if options.json:
        rows = [
            {"file": str(path), "serves": not reason, "reason": reason} for path, reason in files
        ]
        print(json.dumps({"models": rows}))
    else:
        for path, reason in files:
            print(f"{path}: {reason or 'can be used'}")
        if not files:
            print(f"{options.scene}: has no response yet; leave out --list to build one")
    can_be_used = any(not reason for _, reason in files)
    return ExitCode.CONVERGED if can_be_used else ExitCode.NOT_CONVERGED
