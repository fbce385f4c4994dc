"""The command ``pvdf-fem calibrate``: from known touches to the sensor."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from datetime import date
from pathlib import Path
from typing import Any

from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_progress,
    add_scene_command,
    add_text_options,
    find_output_errors,
    read_scene,
)
from pvdf_fem.cli.response_choice import parse_number
from pvdf_fem.files import replace_file
from pvdf_fem.scene.scene_file import SceneError

DESCRIPTION = """\
Parameters of a sensor from touches with known place, rotation and force: film,
channels and place under the stage that explain the readings best. The ±
are standard deviations. Touches that do not fit are left out and named; files
with swapped channels, mirrored axes, wrong units and the like are recognised."""

EPILOG = """\
TOUCHES.csv has the columns x_mm, y_mm, rotation_deg (of the scene's probe on
the stage), force_N, and one for each electrode (A, B, ...) with its reading.

unknowns: film.pretension_N_m and other keys of the film; gain.A, ... or gains;
offset.A, ... (V) or offsets; stage.x_mm and stage.y_mm or shift;
stage.rotation_deg or turn. Parameters that the readings cannot tell are decided by
priors about the scene's values, and named: gains 10 %, d31 and d32 20 %, pretension
30 %, other keys of the film 20 %, shift 1 mm, turn 3 degrees, offsets 0.1 V.

examples:
  pvdf-fem calibrate scene.toml touches.csv --place-sd 0.3 --output sensor.toml
  pvdf-fem calibrate scene.toml touches.csv --unknown gains,shift,turn --unit V

exit codes: 0 calibrated, 2 bad input, 3 not calibrated (the status says why)"""
DEVIATIONS = ("sigma", "noise", "place-sd")


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    summary = "the sensor from known touches"
    parser = add_scene_command(commands, "calibrate", run, summary, DESCRIPTION, EPILOG)
    parser.add_argument("touches", metavar="TOUCHES.csv", help="touches with readings")
    add_text_options(
        parser,
        ("--unknown", "NAMES", "film.pretension_N_m,gains", "what is sought"),
        ("--unit", "UNIT", "pC", "of the readings: pC or V"),
        ("--sigma", "SHARE", "0.01", "standard deviation of each reading, relative to it"),
        (
            "--noise",
            "VALUE",
            None,
            "standard deviation of each reading besides, in its unit (default: readout.noise_V, "
            "or 0)",
        ),
        ("--place-sd", "MM", "0", "standard deviation of x and y of the touches' places"),
    )
    parser.add_argument(
        "--reading",
        help="change: of the charge since the untouched film; total: of the charge (default: what "
        "the scene's [readout] says, else change)",
    )
    parser.add_argument(
        "--prior",
        metavar="NAME=SD",
        action="append",
        default=[],
        help="another deviation of a prior, relative but for shift, turn and offsets, such as "
        "gains=0.05 or shift=2; may be given several times",
    )
    parser.add_argument("--output", metavar="FILE.toml", type=Path, help="write the sensor's scene")
    add_progress(parser)
    parser.add_argument("--page", metavar="FILE.html", type=Path, help="write a page with pictures")


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    inputs = Path(options.scene), Path(options.touches)
    mistakes = find_output_errors(options.output, [".toml"], *inputs)
    mistakes += find_output_errors(options.page, [".html"], *inputs, options.output)
    scene = read_scene(options, *mistakes)
    given = {f"--{name}": getattr(options, name.replace("-", "_")) for name in DEVIATIONS}
    given = {option: text for option, text in given.items() if text is not None}
    given |= {f"--prior {n.strip()}": v for n, _, v in (t.partition("=") for t in options.prior)}
    values = {
        option: parse_number(option, text, mistakes, zero=True) for option, text in given.items()
    }
    if mistakes:
        raise InputError(*mistakes)
    from pvdf_fem.inverse.calibration.calibrate import calibrate
    from pvdf_fem.inverse.calibration.diagnosis import CalibrationStatus
    from pvdf_fem.inverse.touch.measurement import get_units_pC

    deviations: dict[str, Any] = {
        n.replace("-", "_"): values[f"--{n}"] for n in DEVIATIONS if f"--{n}" in values
    }
    if "noise" in deviations:  # in the unit of the readings
        noise = deviations.pop("noise")
        units_pC = get_units_pC(scene, options.unit)
        deviations["noise_pC"] = {name: noise * unit_pC for name, unit_pC in units_pC.items()}
    try:
        found = calibrate(
            scene,
            options.touches,
            [word.strip() for word in options.unknown.split(",") if word.strip()],
            reading=options.reading,
            unit=options.unit,
            priors={o[len("--prior ") :]: v for o, v in values.items() if o.startswith("--prior ")},
            progress=options.progress,
            **deviations,
        )
    except SceneError:  # told as it is
        raise
    except ValueError as error:
        raise InputError(*(line for text in error.args for line in str(text).split("\n"))) from None
    calibrated = found.status is CalibrationStatus.CALIBRATED
    try:
        if calibrated and options.output:
            with replace_file(options.output) as unfinished:
                unfinished.write_text(found.scene.to_toml(), encoding="utf-8")
        if options.page:
            about = {
                "sensor": options.scene,
                "touches": options.touches,
                "unknown": options.unknown,
            }
            about |= {"command": shlex.join(["pvdf-fem", *sys.argv[1:]]), "date": f"{date.today()}"}
            found.write_page(options.page, about)
    finally:  # a full disk does not take the result with it
        if options.json:
            print(json.dumps(found.to_json(), allow_nan=False))
        else:
            print(found, file=sys.stdout if calibrated else sys.stderr)
    return ExitCode.CONVERGED if calibrated else ExitCode.NOT_CONVERGED
