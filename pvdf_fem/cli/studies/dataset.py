"""The command ``pvdf-fem dataset``: random touches with readings, for estimators to learn from."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import (
    add_noise_options,
    add_scene_command,
    add_text_option,
    parse_noise_options,
    read_scene,
)
from pvdf_fem.cli.output import find_output_errors
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.cli.response_choice import (
    ResponseChoice,
    add_response_options,
    load_or_build_response,
)

_DESCRIPTION = """\
Random touches of a sensor, with the charges of its electrodes, a bound on the error
of each charge, and readings with noise: to train and to test estimators of touches.
Touches are uniformly distributed in position, rotation and the logarithm of the force,
within the reach and the forces of the scene's [model].

Readings are total charges or changes due to the touch, with the gains, offsets and
noise of the scene's [readout], in nominal pC. Positions and rotations are in the frame
of its [stage]. The response is built and stored as for `locate`; after that,
100,000 touches take a few seconds.

The file contains the scene, the seed and the noise: NetCDF (.nc) as attributes,
which xarray reads; Parquet (.parquet, needs pyarrow) as metadata, which pandas reads
as attrs; CSV (.csv) as comments with # before its header."""

_EPILOG = """\
examples:
  pvdf-fem dataset sensor.toml --touches 100000 --seed 1 --output touches.nc
  pvdf-fem dataset sensor.toml --sigma 0 --noise 0.5 --output touches.csv

exit codes: 0 written, 2 bad input, 3 a film without a response"""

_EXTENSIONS = [".nc", ".parquet", ".csv"]


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem dataset`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "dataset",
        run,
        summary="random touches with readings",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        json_help="",
    )
    add_text_option(parser, "--touches", "N", about="number of touches", default="100000")
    add_text_option(
        parser,
        "--seed",
        "N",
        about="seed of the random numbers; the same seed reproduces the data",
        default="0",
    )
    add_noise_options(parser, unit="in pC")
    parser.add_argument(
        "--reading",
        choices=("change", "total"),
        help="kind of the readings (default: readout.reading, or total without [readout])",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        required=True,
        help=f"file to write: {', '.join(_EXTENSIONS)}",
    )
    add_response_options(parser)


def run(options: argparse.Namespace) -> int:
    """Write random touches with their readings to the file of ``--output``.

    The response is loaded from its file, or built first.

    Returns
    -------
    int
        The exit code.

    Raises
    ------
    InputError
        If an option or the scene is invalid. The exception lists the errors that were found.
    """
    errors: list[str] = []
    sigma, noise_pC = parse_noise_options(options, errors)
    choice = ResponseChoice.from_options(options, errors)
    inputs = Path(options.scene), options.model
    errors += find_output_errors(options.output, _EXTENSIONS, *inputs)
    if options.output.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        errors.append(f"{options.output}: needs pyarrow; install pvdf-fem[parquet], or give .nc")
    scene = read_scene(options, *errors)
    from pvdf_fem.studies.touch_dataset import dataset, find_request_errors, write_dataset

    count = _convert_digits(options.touches)
    seed = _convert_digits(options.seed)
    errors = list(find_request_errors(scene, count, seed, sigma, noise_pC, options.reading))
    errors += choice.find_errors(scene, options.scene)
    if errors:
        raise InputError(*dict.fromkeys(errors))
    response = load_or_build_response(scene, options.scene, choice)
    data = dataset(
        scene,
        count,
        seed,
        sigma,
        noise_pC=noise_pC,
        reading=options.reading,
        response=response,
    )
    write_dataset(data, options.output)
    print(f"{options.output}: {count} touches, readings of {', '.join(response.names)}")
    return ExitCode.CONVERGED


def _convert_digits(text: str) -> Any:
    """Convert a text of digits to an integer, and return any other text unchanged.

    `find_request_errors` reports a number of touches or a seed that is still a text.
    """
    return int(text) if text.isdecimal() else text
