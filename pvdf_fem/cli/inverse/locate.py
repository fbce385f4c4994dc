"""The command ``pvdf-fem locate``: the most likely touch for given readings."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.inverse.calibration_option import add_calibration_option
from pvdf_fem.cli.inverse.locate_request import UNKNOWN_HELP, Request, require_locatable
from pvdf_fem.cli.inverse.recording_options import add_recording_options
from pvdf_fem.cli.inverse.unit_choice import choose_unit
from pvdf_fem.cli.inverse.unit_option import add_unit_option
from pvdf_fem.cli.options import (
    add_noise_options,
    add_scene_command,
    add_text_option,
    read_scene,
)
from pvdf_fem.cli.output import add_plot, save_plot
from pvdf_fem.cli.program import ExitCode, InputError, convert_value_errors
from pvdf_fem.cli.response_choice import add_response_options, load_or_build_response

if TYPE_CHECKING:
    from pvdf_fem.inverse.touch.locate import ProbeMatch
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.surrogate.charge_function import ChargeFunction

_DESCRIPTION = """\
Locate the touch that gave some charges: position, force and rotation of the scene's
probe, and all other touches that explain the charges. The true touch is within
the ± of each with a probability of 68 %, so that an unlikely touch has a large
±. Quantities that are not named by --unknown are known: probe.x_mm, probe.y_mm,
probe.rotation_deg and load.force_N of the scene.

Charges are totals, or changes by the touch, as an amplifier reads them that was
zeroed before the touch. They are in V if the scene has a [readout], and in pC if not,
unless readout.unit or --unit says otherwise. If readings in V are impossible and they
fit in pC, they are located in pC, and the command says so. Gains and offsets come from
[readout], also for readings in pC; places and rotations are in the frame of [stage].

A response is needed, the model of the charges for all places within --reach and all
forces in --force-range. The first call builds it, says how long that takes, and
stores it beside the scene file; later calls take a moment.

Two touches at once (--touches 2), tangential forces and temperatures (--unknown
with tangential or temperature) are found by full solves over this reach and these
forces, without a response, in up to a minute. The two probes are those of the
scene, or its single probe twice.

With --csv every row of a file is located. Its header has names of electrodes, and
may have rotation_deg and force_N, which are then known. Separators, decimal commas,
header blocks and units are recognised; a cell such as 1.041 that may be a fraction or
a thousand is refused. Other columns are copied, x_mm as given_x_mm and so on.
The columns x_mm, y_mm, rotation_deg, force_N, their deviations, chi_square, p_value,
alternatives (touches with another place or force and 1 % of the likelihood or more),
status, remark and clipped (channels whose readings are limits, not values) follow.
Files that end in .json or .jsonl have a list of objects, or an object on each line; - is
CSV, or such a list with --json.

The status is `located`, `ambiguous` (touches with another place or force are
likely), `at edge` (the touch may lie beyond the response), `clipped` (too many readings
are at the end of readout.range_V, or at plateaus of a table) or `unexplained`: no touch
explains the charges, the numbers are those of the nearest touch, and the remark
names the unit, sign or exchanged channels with which a touch would explain them."""

_EPILOG = """\
examples:
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9 \\
      --unknown x,y,force,rotation --sigma 0.005 --json
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9 --plot touch.png
  pvdf-fem locate ring.toml --touches 2 \\
      --charges A=1443,B=1559,C=1993,D=1471,E=1433,F=1514,G=2076
  pvdf-fem locate sensor.toml --changes A=0.857,B=0.683,C=0.552,D=0.593
  pvdf-fem locate sensor.toml --csv readings.csv --output touches.csv
  read-amplifier | pvdf-fem locate sensor.toml --csv - --quick | show-touches
  pvdf-fem locate triangle.toml --or rectangle.toml --charges A=905,B=731,C=600,D=641

exit codes: 0 a touch explains the charges (with --csv in one row or more, and
no mistake such as exchanged channels explains more rows), 2 bad input, 3 no
touch explains them, or a solve failed"""


def add_parser(commands: Any) -> None:
    """Add the `locate` subcommand with its options to the parser of commands."""
    parser = add_scene_command(
        commands,
        "locate",
        run,
        summary="the touch that gave some charges",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    source = parser.add_mutually_exclusive_group(required=True)
    values = "A=VALUE,B=VALUE,..."
    add_text_option(
        source,
        "--charges",
        values,
        about="total charges of electrodes, including those of the stretched film",
    )
    add_text_option(
        source,
        "--changes",
        values,
        about="readings of amplifiers that were zeroed before the touch",
    )
    add_text_option(
        source,
        "--csv",
        "FILE",
        about="a table of readings or a file of a logger, or - for standard input (see --json)",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="locate tens of thousands of rows of a table a second instead of a hundred: with "
        "deviations by the curvature of the likelihood, and without alternatives",
    )
    parser.add_argument(
        "--reading",
        choices=("change", "total"),
        help="kind of a table's readings (default: readout.reading, or total without [readout])",
    )
    add_unit_option(parser, is_tested=True)
    add_text_option(
        parser,
        "--output",
        "FILE",
        about="file for the touches of a table, - for standard output",
        default="-",
    )
    add_noise_options(parser)
    add_text_option(parser, "--unknown", "NAMES", about=UNKNOWN_HELP, default="x,y,force")
    parser.add_argument(
        "--touches",
        type=int,
        choices=(1, 2),
        default=1,
        help="number of probes that touch at once (default: 1)",
    )
    parser.add_argument(
        "--or",
        metavar="SCENE.toml",
        action="append",
        default=[],
        dest="others",
        help="another scene, with another probe, that may have given the charges; all are "
        "compared by likelihood. May be repeated",
    )
    add_calibration_option(parser)
    add_recording_options(parser)
    add_response_options(parser)
    add_plot(parser, "the likelihood of the touch by position")


def run(options: argparse.Namespace) -> int:
    """Locate a touch or, with ``--csv``, the rows of a table, and return the exit code.

    A single touch is printed, and plotted with ``--plot`` if any touch is found.

    Raises
    ------
    InputError
        If options or scenes are invalid. The exception lists the errors.
    """
    request = Request.from_options(options)
    scenes = _read_scenes(options, request)
    from pvdf_fem.cli.inverse.locate_table import locate_table

    with convert_value_errors():
        if options.csv is not None:
            return locate_table(scenes[options.scene], request, options)
        matches = _rank_probe_matches(scenes, request)
    best = matches[0].location
    try:
        if options.plot and best.touches:
            save_plot(best.plot(), options)
    finally:  # print the touch even if the figure cannot be written
        _print_matches(matches, options.json)
    return ExitCode.CONVERGED if best.explained else ExitCode.NOT_CONVERGED


def _read_scenes(options: argparse.Namespace, request: Request) -> dict[str, Scene]:
    """Read the sensor's scene and the scenes of ``--or``, and return them by file in this order.

    Raises
    ------
    InputError
        If the request has errors, or a scene is invalid or has no suitable probe. The exception
        lists the errors of the request and of all scenes.
    """
    errors = list(request.errors)
    scenes: dict[str, Scene] = {}
    for file in dict.fromkeys([options.scene, *options.others]):
        try:
            scene = read_scene(argparse.Namespace(scene=file, settings=options.settings))
        except InputError as error:
            errors += error.args
            continue
        scenes[file] = scene
        has_probe = bool(scene.loaded_probes) if request.needs_solves else scene.single_probe
        if not has_probe:
            errors.append(f"{file}: has no [probe]; add one")
    if errors:
        raise InputError(*errors)
    return scenes


def _rank_probe_matches(scenes: Mapping[str, Scene], request: Request) -> tuple[ProbeMatch, ...]:
    """Locate the touch with the probe of each scene, and rank the probes by likelihood.

    Missing responses are built, and stored in files.

    Parameters
    ----------
    scenes : mapping of str to Scene
        Scenes by file. Quantities of the touch that are not unknown have the values of the first
        scene. If full solves are needed instead of a response, only the first scene is used.
    request : Request
        Validated options with the readings and the unknown quantities.

    Returns
    -------
    tuple of ProbeMatch
        A location for each scene that is used, the most likely first.

    Raises
    ------
    ValueError
        If the request is invalid. The message has a line for each error.
    """
    from pvdf_fem.inverse.touch.locate import get_scene_quantities, locate, rank_probes

    file, sensor = next(iter(scenes.items()))
    arguments: dict[str, Any] = {
        "sigma": request.sigma,
        "noise_pC": request.convert_noise_to_pC(sensor),
        "unknown": request.unknown,
        "reading": request.reading,
        "include_calibration": request.include_calibration,
    }
    if request.needs_solves:
        location = locate(
            _apply_response_options(sensor, request),
            request.readings,
            touches=request.touches,
            unit=request.unit,
            progress=request.response.progress,
            **arguments,
        )
        return rank_probes({file: location})
    known = {
        name: value
        for name, value in get_scene_quantities(sensor).items()
        if name not in request.unknown
    }
    require_locatable(scenes, request, request.convert_readings_to_pC(sensor), known)
    # build all responses first, so that no build can fail after a search
    responses = {
        name: load_or_build_response(
            scene, name, request.response, with_sensitivities=request.include_calibration
        )
        for name, scene in scenes.items()
    }
    request = _settle_unit(request, responses[file], known)
    arguments |= {"unit": request.unit, "noise_pC": request.convert_noise_to_pC(sensor)}
    locations = {
        name: locate(response, request.readings, known=known, **arguments)
        for name, response in responses.items()
    }
    return rank_probes(locations)


def _settle_unit(request: Request, response: ChargeFunction, known: Mapping[str, float]) -> Request:
    """Return the request with the unit of its readings, after the test whether they can be in it.

    Parameters
    ----------
    request : Request
        Validated options with the readings.
    response : ChargeFunction
        The response of the sensor.
    known : mapping of str to float
        Known quantities of the touch.

    Raises
    ------
    InputError
        If the readings are not in the unit that was given.
    """
    import numpy as np

    arguments = {"rotation_deg": "rotations_deg", "force_N": "forces_N"}
    known_rows = {}
    for name, argument in arguments.items():
        if name in known:
            known_rows[argument] = np.array([known[name]])
    unit = choose_unit(
        response,
        {name: np.array([value]) for name, value in request.readings.items()},
        request.unit,
        "readings",
        request=request,
        known=known_rows,
    )
    return replace(request, unit=unit)


def _apply_response_options(sensor: Scene, request: Request) -> Scene:
    """Return a copy of the scene with the reach and the force range of the options in [model].

    If neither option is given, the scene itself is returned.
    """
    changes: dict[str, Any] = {}
    if request.response.reach_mm is not None:
        changes["reach_mm"] = request.response.reach_mm
    if request.response.force_range_N is not None:
        changes["force_range_N"] = request.response.force_range_N
    changed: Scene = sensor.with_(model=changes) if changes else sensor
    return changed


def _print_matches(matches: Sequence[ProbeMatch], as_json: bool) -> None:
    """Print locations in order, as texts or as one JSON object.

    JSON always has the probability of each scene as ``weight``, texts only for several scenes.
    """
    if as_json:
        objects = [
            {"scene": match.name, "weight": match.weight, **match.location.to_json()}
            for match in matches
        ]
        result = objects[0] if len(objects) == 1 else {"scenes": objects}
        print(json.dumps(result, allow_nan=False))
        return
    for match in matches:
        if len(matches) > 1:
            print(f"{match.name}: probability {match.weight:.3g}")
        print(match.location)
