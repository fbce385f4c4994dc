"""The command ``pvdf-fem calibrate``: parameters of a sensor from known touches."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.inverse.unit_option import add_unit_option, parse_unit_option
from pvdf_fem.cli.options import (
    add_noise_options,
    add_progress,
    add_scene_command,
    add_text_option,
    parse_noise_options,
    parse_number,
    read_scene,
)
from pvdf_fem.cli.output import find_output_errors
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.files import replace_file
from pvdf_fem.scene.scene_file import SceneError

if TYPE_CHECKING:
    from pvdf_fem.inverse.calibration.calibration import Calibration

_DESCRIPTION = """\
Fit the parameters of a sensor to touches with known position, rotation and force: the
film, the channels and the position on the stage that explain the readings best. The ±
are standard deviations. Touches that do not fit are rejected and named; readings at
the end of readout.range_V, at plateaus, or marked by words such as OVER are clipped
and left out; files with exchanged channels, mirrored axes, wrong units and the like
are recognised."""

_EPILOG = """\
TOUCHES.csv has the columns x_mm, y_mm, rotation_deg (of the scene's probe on
the stage), force_N, and one for each electrode (A, B, ...) with its reading: in V if
the scene has a [readout], and in pC if not, unless readout.unit, --unit or the file
says otherwise. Units in headings, as x (m) or A (mV), are converted. Parquet, HDF5
and other files with these columns are read, too, but not recordings of streams.

unknowns: film.pretension_N_m and other keys of the film; gain.A, ... or gains;
offset.A, ... (V) or offsets; stage.x_mm and stage.y_mm or shift;
stage.rotation_deg or turn. Parameters that the readings do not determine are taken
from priors about the scene's values, and named: gains 10 %, d31 and d32 20 %,
pretension 30 %, other keys of the film 20 %, shift 1 mm, turn 3 degrees, offsets
0.1 V.

examples:
  pvdf-fem calibrate scene.toml touches.csv --place-sd 0.3 --output sensor.toml
  pvdf-fem calibrate scene.toml touches.csv --unknown gains,shift,turn --unit nC

exit codes: 0 calibrated, 2 bad input, 3 not calibrated (the status says why)"""


def add_parser(commands: Any) -> None:
    """Add the `calibrate` subcommand with its options to the parser of commands."""
    parser = add_scene_command(
        commands,
        "calibrate",
        run,
        summary="the sensor from known touches",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("touches", metavar="TOUCHES.csv", help="known touches with readings")
    add_text_option(
        parser,
        "--unknown",
        "NAMES",
        about="unknown parameters",
        default="film.pretension_N_m,gains",
    )
    add_unit_option(parser, is_tested=True)
    add_noise_options(parser)
    add_text_option(
        parser,
        "--place-sd",
        "MM",
        about="standard deviation of the coordinates x and y of the touches",
        default="0",
    )
    parser.add_argument(
        "--reading",
        choices=("change", "total"),
        help="change: of the charge since the film was unloaded; total: of the charge (default: "
        "readout.reading, or change without [readout])",
    )
    parser.add_argument(
        "--prior",
        metavar="NAME=SD",
        action="append",
        default=[],
        help="another standard deviation of a prior, such as gains=0.05 or shift=2; relative, "
        "except for shift, turn and offsets. May be repeated",
    )
    parser.add_argument("--output", metavar="FILE.toml", type=Path, help="write the sensor's scene")
    add_progress(parser)
    parser.add_argument("--page", metavar="FILE.html", type=Path, help="write a page with plots")


def run(options: argparse.Namespace) -> int:
    """Calibrate a sensor with touches, and return the exit code of the command.

    The calibration is printed; its text is on standard error if it fails. The scene of ``--output``
    is written only if it succeeds, the page of ``--page`` in either case.

    Raises
    ------
    InputError, SceneError
        If options or files are invalid. The exception lists the errors.
    """
    inputs = Path(options.scene), Path(options.touches)
    errors = find_output_errors(options.output, [".toml"], *inputs)
    errors += find_output_errors(options.page, [".html"], *inputs, options.output)
    scene = read_scene(options, *errors)
    sigma, noise = parse_noise_options(options, errors)
    place_sd = parse_number("--place-sd", options.place_sd, errors, allow_zero=True)
    priors = _parse_priors(options.prior, errors)
    from pvdf_fem.electrodes.channel import find_unit_errors, get_reading_unit

    unit = parse_unit_option(options.unit)
    errors += find_unit_errors(scene, unit, "--unit")
    if errors:
        raise InputError(*errors)
    from pvdf_fem.inverse.calibration.calibrate import calibrate
    from pvdf_fem.inverse.calibration.diagnosis import CalibrationStatus
    from pvdf_fem.inverse.calibration.touch_columns import find_reading_unit
    from pvdf_fem.inverse.touch.measurement import get_units_pC

    unknowns = [name.strip() for name in options.unknown.split(",")]
    noise_pC = None
    try:
        if noise is not None:
            noise_unit = unit or find_reading_unit(options.touches, scene)
            units_pC = get_units_pC(scene, noise_unit or get_reading_unit(scene))
            noise_pC = {name: noise * unit_pC for name, unit_pC in units_pC.items()}
        calibration = calibrate(
            scene,
            options.touches,
            [name for name in unknowns if name],
            reading=options.reading,
            unit=unit,
            priors=priors,
            sigma=sigma,
            noise_pC=noise_pC,
            place_sd=place_sd,
            progress=options.progress,
        )
    except SceneError:  # a ValueError, too, but `run_program` prints the problems that it lists
        raise
    except ValueError as error:
        raise InputError(*_split_messages(error)) from None
    is_calibrated = calibration.status is CalibrationStatus.CALIBRATED
    try:
        if is_calibrated and options.output:
            with replace_file(options.output) as temporary:
                sensor = calibration.scene.with_(**{"calibration.date": str(date.today())})
                temporary.write_text(sensor.to_toml(), encoding="utf-8")
        if options.page:
            _write_page(calibration, options)
    finally:  # print the calibration even if a file cannot be written
        if options.json:
            print(json.dumps(calibration.to_json(), allow_nan=False))
        else:
            print(calibration, file=sys.stdout if is_calibrated else sys.stderr)
    return ExitCode.CONVERGED if is_calibrated else ExitCode.NOT_CONVERGED


def _parse_priors(texts: list[str], errors: list[str]) -> dict[str, float]:
    """Parse the values of ``--prior``, and return standard deviations by the name of the prior.

    Parameters
    ----------
    texts : list of str
        Values in the form ``NAME=SD``. If a name is repeated, its last value counts.
    errors : list of str
        Error messages; one is appended for each standard deviation that is invalid.
    """
    priors: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        name = name.strip()
        priors[name] = parse_number(f"--prior {name}", value, errors, allow_zero=True)
    return priors


def _split_messages(error: ValueError) -> list[str]:
    """Split the text of an exception into its lines, each of which is an error message."""
    messages: list[str] = []
    for argument in error.args:
        messages += str(argument).split("\n")
    return messages


def _write_page(calibration: Calibration, options: argparse.Namespace) -> None:
    """Write the page of ``--page``, which also names the input files, the command and the date."""
    about = {
        "sensor": options.scene,
        "touches": options.touches,
        "unknown": options.unknown,
        "command": shlex.join(["pvdf-fem", *sys.argv[1:]]),
        "date": str(date.today()),
    }
    calibration.write_html_page(options.page, about)
