"""The command ``pvdf-fem modes``: frequencies of the stretched film."""

from __future__ import annotations

import argparse
import re
from typing import Any

from pvdf_fem.cli.options import MAX_QUOTED, add_scene_command, add_text_option, read_scene
from pvdf_fem.cli.output import add_plot, find_plot_errors, print_result, save_plot
from pvdf_fem.cli.program import ExitCode

_DESCRIPTION = """\
Lowest frequencies of the stretched film in Hz, each with its estimated
discretisation error; pairs of equal frequency are listed twice."""

_EPILOG = """\
examples:
  pvdf-fem modes scene.toml --plot modes.png
  pvdf-fem modes scene.toml --count 12 --loaded --set load.force_N=0.5 --json

exit codes: 0 converged, 2 bad input, 3 no frequencies (a film without tension,
or no equilibrium under the load)"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem modes`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "modes",
        run,
        summary="frequencies of the stretched film",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--loaded",
        action="store_true",
        help="linearise about the loaded equilibrium instead of the flat film",
    )
    add_text_option(parser, "--count", "N", about="number of frequencies", default="6")
    add_plot(parser, "the shapes of the modes")


def run(options: argparse.Namespace) -> int:
    """Print the lowest frequencies of a film, and draw the modes if ``--plot`` is used.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if there are frequencies, else `ExitCode.NOT_CONVERGED`, and then
        nothing is drawn.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    """
    from pvdf_fem.dynamics.modes import MAX_MODES, modes
    from pvdf_fem.solver.nonlinear.status import Status

    errors = []
    is_count = re.fullmatch("[0-9]{1,9}", options.count) is not None
    if not is_count or not 1 <= int(options.count) <= MAX_MODES:
        value = options.count[:MAX_QUOTED]
        errors.append(f"--count {value}: must be an integer from 1 to {MAX_MODES}")
    errors += find_plot_errors(options, options.scene)
    scene = read_scene(options, *errors)
    result = modes(scene, int(options.count), options.loaded)
    converged = result.status is Status.CONVERGED
    try:
        if options.plot and converged:
            save_plot(result.plot(), options)
    finally:  # print the frequencies even if the figure cannot be written
        print_result(result, options.json)
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED
