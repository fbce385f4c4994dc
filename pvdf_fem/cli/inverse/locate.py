"""The command ``pvdf-fem locate``: from readings to the touch."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli import program, response_choice
from pvdf_fem.cli.inverse.locate_request import SOUGHT, Request, check_request
from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_scene_command,
    add_text_options,
    read_scene,
)
from pvdf_fem.cli.response_choice import load_or_build_response

if TYPE_CHECKING:
    from pvdf_fem.inverse.touch.locate import ProbeMatch
    from pvdf_fem.scene.scene import Scene

DESCRIPTION = """\
The touch that gave some charges: position, force and rotation of the scene's
probe, and all other touches that explain the charges. The true touch is within
the ± of each with a probability of 68 %, so that an unlikely touch has a large
±. Quantities that are not sought are known: probe.x_mm, probe.y_mm,
probe.rotation_deg and load.force_N of the scene.

Charges are totals, or changes by the touch, which an amplifier reads that was
zeroed before the touch. Gains and offsets come from the scene's [readout], also for
readings in pC, and places and rotations are in the frame of its [stage].

A model of the charges is needed, over all places within --reach and forces in
--force-range. The first call builds the model, says how long the build takes, and
keeps the model beside the scene file; later calls take a moment.

Two touches at once (--touches 2), tangential forces and temperatures (--unknown
with tangential or temperature) are found by full solves over this reach and these
forces, without a model, in up to a minute; the scene's list of probes, or its
probe twice, touches the film.

With --csv every row of a file is located. Its header has names of electrodes,
and may have rotation_deg and force_N, which are then known. Other columns are
passed through; columns x_mm, y_mm, rotation_deg, force_N, their deviations,
chi_square, p_value, alternatives (touches with another place or force and 1 % of
the likelihood or more), status and remark follow. Files that end in .json or
.jsonl have a list of objects, or an object on each line; - is CSV, or such a list
with --json.

The status is `locate_with_scenes`, `ambiguous` (touches with another place or force are
likely), `at edge` (the touch may lie beyond the model's domain) or `unexplained`:
no touch of the model explains the charges, the numbers describe the nearest touch,
and the remark names the unit, sign or exchanged channels with which a touch
explains them."""

EPILOG = """\
examples:
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9 \\
      --unknown x,y,force,rotation --sigma 0.005 --json
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9 --plot touch.png
  pvdf-fem locate ring.toml --touches 2 \\
      --charges A=1443,B=1559,C=1993,D=1471,E=1433,F=1514,G=2076
  pvdf-fem locate sensor.toml --changes A=0.857,B=0.683,C=0.552,D=0.593 --unit V
  pvdf-fem locate sensor.toml --csv readings.csv --output touches.csv
  read-amplifier | pvdf-fem locate sensor.toml --csv - --quick | show-touches
  pvdf-fem locate triangle.toml --or rectangle.toml --charges A=905,B=731,C=600,D=641

exit codes: 0 a touch explains the charges (with --csv in one row or more, and
no mistake such as exchanged channels explains more rows), 2 bad input, 3 no
touch explains them, or a solve failed"""


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    summary = "the touch that gave some charges"
    parser = add_scene_command(commands, "locate", run, summary, DESCRIPTION, EPILOG)
    given, values = parser.add_mutually_exclusive_group(required=True), "A=PC,B=PC,..."
    add_text_options(
        given,
        ("--charges", values, None, "total charges of electrodes, the stretched film's included"),
        ("--changes", values, None, "readings of amplifiers that were zeroed before the touch"),
        ("--csv", "FILE", None, "a table of readings, or - for standard input (see --json)"),
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="locate a table by tens of thousands of rows a second rather than a hundred: with "
        "deviations by the likelihood's curvature, without alternatives",
    )
    parser.add_argument(
        "--reading",
        choices=("change", "total"),
        help="what a table has (default: readout.reading, or total without [readout])",
    )
    parser.add_argument(
        "--unit",
        choices=("pC", "V"),
        default="pC",
        help="unit of readings and --noise; V needs a [readout] (default: pC)",
    )
    add_text_options(
        parser,
        ("--output", "FILE", "-", "where a table's touches are written, - for standard output"),
        ("--sigma", "SHARE", "0.01", "standard deviation over the charge or change that is given"),
        ("--noise", "PC", None, "another one, of every reading (default: readout.noise_V, or 0)"),
        ("--unknown", "NAMES", "x,y,force", SOUGHT),
    )
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
        "weighed by likelihood; may be given several times",
    )
    response_choice.add_options(parser)
    program.add_plot(parser, "the likelihood of places of the touch")


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    request = Request.of(options)
    mistakes, scenes = list(request.mistakes), {}
    for file in dict.fromkeys([options.scene, *options.others]):
        try:
            scenes[file] = read_scene(argparse.Namespace(scene=file, settings=options.settings))
        except InputError as error:
            mistakes += error.args
    probes = {
        f: s.loaded_probes if request.by_solves else s.single_probe for f, s in scenes.items()
    }
    mistakes += [f"{file}: has no [probe]; add one" for file, probe in probes.items() if not probe]
    if mistakes:
        raise InputError(*mistakes)
    from pvdf_fem.cli.inverse.locate_table import locate_table

    with program.convert_value_errors():
        if options.csv is not None:
            return locate_table(scenes[options.scene], request, options)
        choices = locate_with_scenes(scenes, request)
    try:
        if options.plot and choices[0].location.touches:
            program.save_plot(choices[0].location.plot(), options)
    finally:  # a full disk does not take the touch with it
        print_matches(choices, options.json)
    return ExitCode.CONVERGED if choices[0].location.explained else ExitCode.NOT_CONVERGED


def locate_with_scenes(scenes: Mapping[str, Scene], request: Request) -> tuple[ProbeMatch, ...]:
    """Locations with the probe of each scene, the likeliest first.

    What is not sought is known from the first. Raises `ValueError` with all mistakes.
    """
    from pvdf_fem.inverse.touch.locate import get_scene_quantities, locate, rank_probes

    file, sensor = next(iter(scenes.items()))
    errors: dict[str, Any] = {"sigma": request.sigma, "noise_pC": request.noise_pC(sensor)}
    asked: dict[str, Any] = {
        "unknown": request.unknown,
        "reading": request.reading,
        "unit": request.unit,
    }
    if request.by_solves:
        asked |= {"touches": request.touches, "progress": request.model.progress}
        domain = {"reach_mm": request.model.reach_mm, "force_range_N": request.model.force_N}
        if given := {key: value for key, value in domain.items() if value}:
            sensor = sensor.with_(model=given)
        return rank_probes({file: locate(sensor, request.readings, **asked, **errors)})
    touch = get_scene_quantities(sensor)
    known = {name: value for name, value in touch.items() if name not in request.unknown}
    check_request(scenes, request, request.readings_pC(sensor), known)
    models = {name: load_or_build_response(scenes[name], name, request.model) for name in scenes}
    asked |= {"known": known, **errors}
    readings = request.readings
    return rank_probes({name: locate(model, readings, **asked) for name, model in models.items()})


def print_matches(matches: Sequence[ProbeMatch], as_json: bool) -> None:
    """Locations by probe, the likeliest first."""
    if as_json:
        by_scene = [
            {"scene": probe.name, "weight": probe.weight, **probe.location.to_json()}
            for probe in matches
        ]
        result = by_scene[0] if len(by_scene) == 1 else {"scenes": by_scene}
        print(json.dumps(result, allow_nan=False))
        return
    for probe in matches:
        if len(matches) > 1:
            print(f"{probe.name}: probability {probe.weight:.3g}")
        print(probe.location)
