"""The command ``pvdf-fem respond``: charges under an oscillating force."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from pvdf_fem.cli.program import (
    ExitCode,
    add_plot,
    add_scene_command,
    add_text_options,
    find_plot_errors,
    read_scene,
    save_plot,
)
from pvdf_fem.cli.response_choice import read_number

DESCRIPTION = """\
Charges by a small force of the probe that oscillates about its load, with mass,
film.loss_tangent and [air], as CSV by frequency: for each electrode real and
imaginary part and estimated error in pC/N, and the reading of [readout] in V/N.
With --plot only the first and the last rows are printed, as a table."""
EPILOG = """\
examples:
  pvdf-fem respond scene.toml --frequencies 1:500 --plot response.png
  pvdf-fem respond scene.toml --frequencies 20 --set air.baffle=true --json

exit codes: 0 done, 2 bad input, 3 not converged"""
SPAN = (
    "one in Hz, START:END:N for N evenly spaced in their logarithm, or START:END for 200 "
    "and more about resonances"
)


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    summary = "charges under an oscillating force"
    parser = add_scene_command(commands, "respond", run, summary, DESCRIPTION, EPILOG)
    add_text_options(parser, ("--frequencies", "SPAN", "1:1000", SPAN))
    add_plot(parser, "amplitudes, and phases of a damped film")


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    frequencies = _frequencies(options.frequencies)
    told = f"--frequencies {options.frequencies[:60]}: is out of range; give {SPAN}"
    mistakes = [told] if frequencies is None else []
    scene = read_scene(options, *mistakes, *find_plot_errors(options, options.scene))
    from pvdf_fem.dynamics.frequency_response import respond

    response = respond(scene, frequencies, refined=options.frequencies.count(":") == 1)
    try:
        if options.plot:
            save_plot(response.plot(), options)
    finally:  # a full disk does not take the charges with it
        if options.json:
            print(json.dumps(response.to_json(), allow_nan=False))
        elif options.plot:
            print(response)
        else:
            for text in response.neglected:
                print(f"left out: {text}", file=sys.stderr)
            response.to_dataframe().to_csv(sys.stdout, index=False, lineterminator="\n")
    return ExitCode.CONVERGED


def _frequencies(span: str, most: int = 100_000) -> Any:
    """Frequencies in Hz of a span; None for what is none."""
    import numpy as np

    start, *others = [read_number(text) or 0.0 for text in span.split(":")]
    end, count = [*others, 200.0][:2] if others else (start, 1.0)
    if len(others) > 2 or not (0.0 < start <= end <= 1e6 and count in range(1, most + 1)):
        return None
    return np.geomspace(start, end, int(count))
