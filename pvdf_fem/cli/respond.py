"""The command ``pvdf-fem respond``: charges under an oscillating force."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.options import (
    MAX_QUOTED,
    add_scene_command,
    add_text_option,
    read_number,
    read_scene,
)
from pvdf_fem.cli.output import add_plot, find_plot_errors, save_plot
from pvdf_fem.cli.program import ExitCode

if TYPE_CHECKING:
    from pvdf_fem.arrays import Array
    from pvdf_fem.dynamics.frequency_response import FrequencyResponse

_DESCRIPTION = """\
Charges under a small force of the probe that oscillates about its load, with mass,
film.loss_tangent and [air], as CSV by frequency: for each electrode the real and the
imaginary part and the estimated error in pC/N, and the reading of [readout] in V/N.
With --plot only the first and the last rows are printed, as a table."""

_EPILOG = """\
examples:
  pvdf-fem respond scene.toml --frequencies 1:500 --plot response.png
  pvdf-fem respond scene.toml --frequencies 20 --set air.baffle=true --json

exit codes: 0 done, 2 bad input, 3 not converged"""

_SPAN = (
    "one frequency in Hz; START:END:N for N logarithmically spaced frequencies; or START:END for "
    "200 frequencies, and more around resonances"
)
_DEFAULT_COUNT = 200  #: Number of frequencies of START:END.
_MAX_COUNT = 100_000
_MAX_FREQUENCY_HZ = 1e6


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem respond`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "respond",
        run,
        summary="charges under an oscillating force",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    add_text_option(parser, "--frequencies", "SPAN", about=_SPAN, default="1:1000")
    add_plot(parser, "amplitudes, and phases of a film with losses")


def run(options: argparse.Namespace) -> int:
    """Print the charges under an oscillating force, and draw them if ``--plot`` is used.

    Returns
    -------
    int
        `ExitCode.CONVERGED`.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    NotConvergedError
        If there is no equilibrium about which the film could oscillate.
    """
    errors = []
    frequencies = _parse_frequencies(options.frequencies)
    if frequencies is None:
        value = options.frequencies[:MAX_QUOTED]
        errors.append(f"--frequencies {value}: is out of range; give {_SPAN}")
    errors += find_plot_errors(options, options.scene)
    scene = read_scene(options, *errors)
    from pvdf_fem.dynamics.frequency_response import respond

    assert frequencies is not None  # else there was an error
    has_default_count = options.frequencies.count(":") == 1
    response = respond(scene, frequencies, refined=has_default_count)
    try:
        if options.plot:
            save_plot(response.plot(), options)
    finally:  # print the charges even if the figure cannot be written
        _print_response(response, options)
    return ExitCode.CONVERGED


def _print_response(response: FrequencyResponse, options: argparse.Namespace) -> None:
    """Print a frequency response as JSON, as a short table if a plot is drawn, or else as CSV.

    With CSV, the neglected effects are printed on standard error.
    """
    if options.json:
        print(json.dumps(response.to_json(), allow_nan=False))
    elif options.plot:
        print(response)
    else:
        for effect in response.neglected:
            print(f"neglected: {effect}", file=sys.stderr)
        response.to_dataframe().to_csv(sys.stdout, index=False, lineterminator="\n")


def _parse_frequencies(span: str) -> Array | None:
    """Parse a frequency, ``START:END`` or ``START:END:N`` to logarithmically spaced frequencies.

    Returns
    -------
    ndarray, shape (n,), or None
        Frequencies in Hz. None if the text has another form or a number is out of range.
    """
    import numpy as np

    parts = span.split(":")
    if len(parts) > 3:
        return None
    start = read_number(parts[0])
    end = read_number(parts[1]) if len(parts) > 1 else start
    count: float | None = 1.0 if len(parts) == 1 else float(_DEFAULT_COUNT)
    if len(parts) == 3:
        count = read_number(parts[2])
    if start is None or end is None or count is None:
        return None
    is_range = 0.0 < start <= end <= _MAX_FREQUENCY_HZ
    is_count = count.is_integer() and 1 <= count <= _MAX_COUNT
    return np.geomspace(start, end, int(count)) if is_range and is_count else None
