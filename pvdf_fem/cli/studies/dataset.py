"""The command ``pvdf-fem dataset``: random touches with readings, for estimators to learn from."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pvdf_fem.cli import program, response_choice
from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_scene_command,
    add_text_options,
    read_scene,
)
from pvdf_fem.cli.response_choice import ResponseChoice, load_or_build_response, parse_number

_DESCRIPTION = """\
Random touches of a sensor, with the charges of its electrodes, a bound on the
model's error of each charge, and readings with noise: to train and to test
estimators of touches. Touches are even by place, by rotation and by the logarithm
of the force, over the reach and the forces of the scene's [model].

Readings are total charges or changes by the touch, with the gains, offsets and
noise of the scene's [readout], in nominal pC. Places and rotations are in the frame
of its [stage]. The model of the charges is built and kept as for `locate`; after
that, 100,000 touches take a few seconds.

The file has the scene, the seed and the noise: NetCDF (.nc) as attributes, which
xarray reads; Parquet (.parquet, needs pyarrow) as metadata, which pandas reads as
attrs; CSV (.csv) as comments with # before its header."""

_EPILOG = """\
examples:
  pvdf-fem dataset sensor.toml --touches 100000 --seed 1 --output touches.nc
  pvdf-fem dataset sensor.toml --sigma 0 --noise 0.5 --output touches.csv

exit codes: 0 written, 2 bad input, 3 a film without a model"""


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    about = "random touches with readings", _DESCRIPTION, _EPILOG
    parser = add_scene_command(commands, "dataset", run, *about, as_json="")
    add_text_options(
        parser,
        ("--touches", "N", "100000", "how many touches"),
        ("--seed", "N", "0", "equal seeds draw equal touches and equal noise"),
        ("--sigma", "SHARE", "0.01", "standard deviation of a reading over the charge or change"),
        ("--noise", "PC", None, "another one, of every reading (default: readout.noise_V, or 0)"),
    )
    parser.add_argument(
        "--reading",
        choices=("change", "total"),
        help="what is read (default: readout.reading, or total without [readout])",
    )
    output = "file to write: .nc, .parquet or .csv"
    parser.add_argument("--output", metavar="FILE", type=Path, required=True, help=output)
    response_choice.add_options(parser)


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    wrong: list[str] = []
    sigma, noise = parse_number("--sigma", options.sigma, wrong, zero=True), options.noise
    noise = None if noise is None else parse_number("--noise", noise, wrong, zero=True)
    choice = ResponseChoice.of(options, wrong)
    wrong += program.find_output_errors(
        options.output, [".nc", ".parquet", ".csv"], Path(options.scene), options.model
    )
    if options.output.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        wrong.append(f"{options.output}: needs pyarrow; install pvdf-fem[parquet], or give .nc")
    scene = read_scene(options, *wrong)
    from pvdf_fem.studies.touch_dataset import dataset, find_request_errors, write_dataset

    count, seed = (int(n) if n.isdecimal() else n for n in (options.touches, options.seed))
    wrong = [*find_request_errors(scene, count, seed, sigma, noise, options.reading)]
    if wrong := [*wrong, *choice.mistakes(scene, options.scene)]:
        raise InputError(*wrong)
    model = load_or_build_response(scene, options.scene, choice)
    how: dict[str, Any] = {"noise_pC": noise, "reading": options.reading, "response": model}
    write_dataset(dataset(scene, count, seed, sigma, **how), options.output)
    print(f"{options.output}: {count} touches, readings of {', '.join(model.names)}")
    return ExitCode.CONVERGED
