"""The command ``pvdf-fem calibrate``: from known touches to the sensor."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pvdf_fem.cli.program import ExitCode, InputError, output_mistakes
from pvdf_fem.files import replacing

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene

DESCRIPTION = """\
Parameters of a sensor from touches with known place, rotation and force: what
of film, channels and place under the stage explains the readings best. The ±
are standard deviations. Touches that do not fit are left out and named; files
with swapped channels, mirrored axes, wrong units and the like are recognised."""

EPILOG = """\
TOUCHES.csv has the columns x_mm, y_mm, rotation_deg (of the scene's probe on
the stage), force_N, and one for each electrode (A, B, ...) with its reading.

unknowns:
  film.KEY      pretension_N_m, d31_pC_N, d32_pC_N, thickness_um, ...
  gains         gain.A, gain.B, ...         offsets       offset.A, ... in V
  shift         stage.x_mm, stage.y_mm      turn          stage.rotation_deg
What the readings cannot tell is decided by priors about the scene's values:
gains 10 %, d31 and d32 20 %, pretension 30 %, other keys of the film 20 %,
shift 1 mm, turn 3 degrees, offsets 0.1 V. The answer names it.

examples:
  pvdf-fem calibrate scene.toml touches.csv --place-sd 0.3 --output sensor.toml
  pvdf-fem calibrate scene.toml touches.csv --unknown gains,shift,turn --unit V

exit codes: 0 calibrated, 2 bad input, 3 not calibrated (the status says why)"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("touches", metavar="TOUCHES.csv", help="touches with readings")
    parser.add_argument(
        "--unknown",
        metavar="NAMES",
        default="film.pretension_N_m,gains",
        help="what is sought (default: film.pretension_N_m,gains)",
    )
    parser.add_argument("--unit", default="pC", help="of the readings: pC or V (default: pC)")
    parser.add_argument(
        "--reading",
        help="change: of the charge since the untouched film; total: of the charge (default: what "
        "the scene's [readout] says, else change)",
    )
    for option, metavar, default, text in (
        ("--sigma", "SHARE", "0.01", "standard deviation of each reading, relative to it"),
        ("--noise", "VALUE", "0", "standard deviation of each reading besides, in its unit"),
        ("--place-sd", "MM", "0", "standard deviation of x and y of the touches' places"),
    ):
        help_text = f"{text} (default: {default})"
        parser.add_argument(option, metavar=metavar, default=default, help=help_text)
    parser.add_argument(
        "--prior",
        metavar="NAME=SD",
        action="append",
        default=[],
        help="another deviation of a prior, relative but for shift, turn and offsets, such as "
        "gains=0.05 or shift=2; may be given several times",
    )
    parser.add_argument("--output", metavar="FILE.toml", type=Path, help="write the sensor's scene")
    parser.add_argument("--page", metavar="FILE.html", type=Path, help="write a page with pictures")


def mistakes_of(options: argparse.Namespace) -> list[str]:
    """Reasons for which the files could not be written."""
    inputs = Path(options.scene), Path(options.touches)
    mistakes = output_mistakes(options.output, [".toml"], *inputs)
    return mistakes + output_mistakes(options.page, [".html"], *inputs, options.output)


def run(options: argparse.Namespace, scene: Scene) -> int:
    """Calibrate a scene as the options say."""
    mistakes: list[str] = []
    sigma, noise, place_sd = (
        _number(f"--{name}", getattr(options, name.replace("-", "_")), mistakes)
        for name in ("sigma", "noise", "place-sd")
    )
    priors = {}
    for text in options.prior:
        name, _, value = (part.strip() for part in text.partition("="))
        priors[name] = _number(f"--prior {name}", value, mistakes)
    if mistakes:
        raise InputError(*mistakes)
    from pvdf_fem.calibration.calibrate import calibrate
    from pvdf_fem.calibration.diagnosis import CalibrationStatus

    words = [word.strip() for word in options.unknown.split(",") if word.strip()]
    try:
        found = calibrate(
            scene,
            options.touches,
            words,
            reading=options.reading,
            unit=options.unit,
            sigma=sigma,
            noise=noise,
            place_sd=place_sd,
            priors=priors,
        )
    except ValueError as error:
        raise InputError(*(line for text in error.args for line in str(text).split("\n"))) from None
    calibrated = found.status is CalibrationStatus.CALIBRATED
    try:
        if calibrated and options.output:
            with replacing(options.output) as unfinished:
                unfinished.write_text(found.scene.to_toml(), encoding="utf-8")
        if options.page:
            from pvdf_fem.output.calibration_page import write_page

            write_page(found, options.page)
    finally:  # a full disk does not take the result with it
        if options.json:
            print(json.dumps(found.to_json(), allow_nan=False))
        else:
            print(found, file=sys.stdout if calibrated else sys.stderr)
    return ExitCode.CONVERGED if calibrated else ExitCode.NOT_CONVERGED


def _number(option: str, text: str, mistakes: list[str]) -> float:
    try:
        return float(text)
    except ValueError:
        mistakes.append(f"{option} {text[:60]}: give a number")
        return 0.0
