"""The command ``pvdf-fem locate``: from readings to the touch."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli import response_model
from pvdf_fem.cli.response_model import ModelChoice, model_of, number_of, positive

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.touch.location import Location
    from pvdf_fem.touch.probes import ProbeMatch
    from pvdf_fem.touch.touch import Touch

DESCRIPTION = """\
The touch that gave some charges: position, force and rotation of the scene's
probe, and all other touches that may have given them. The true touch is within
the ± of each with a probability of 68 %, so that an unlikely touch has a large
one. What is not sought is known: probe.x_mm, probe.y_mm,
probe.rotation_deg and load.force_N of the scene.

Charges are total ones, or changes as an amplifier sees them that was zeroed
before the touch. Gains and offsets are those of the scene's [readout], also for
readings in pC, and places and rotations are in the frame of its [stage].

A model of the charges is needed, over all places within --reach and forces in
--force-range. It is built on the first call, which takes a minute or two and is
shown on standard error, and kept beside the scene file; later calls take a
moment. A call that was stopped goes on where it was.

With --csv every row of a file is located. Its header has names of electrodes,
and may have rotation_deg and force_N, which are then known. Other columns are
passed through; columns x_mm, y_mm, rotation_deg, force_N, their deviations,
chi_square, p_value, alternatives (other touches with 1 % of the likelihood or
more), status and remark follow. Files that end in .json or .jsonl have a list
of objects, or an object on each line."""

EPILOG = """\
examples:
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9 \\
      --unknown x,y,force,rotation --sigma 0.005 --polish --json
  pvdf-fem locate sensor.toml --changes A=0.857,B=0.683,C=0.552,D=0.593 --unit V
  pvdf-fem locate sensor.toml --csv readings.csv --output touches.csv
  read-amplifier | pvdf-fem locate sensor.toml --csv - --quick | show-touches
  pvdf-fem locate triangle.toml --or rectangle.toml --charges A=905,B=731,C=600,D=641

exit codes: 0 located (look at the remarks; with --csv all rows that can be
used), 2 bad input, 3 no touch found, or a solve failed"""

#: What may be sought, as on the command line.
NAMES = {"x": "x_mm", "y": "y_mm", "force": "force_N", "rotation": "rotation_deg"}
_UNITS = {"x": "mm", "y": "mm", "force": "N", "rotation": "°"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    given = parser.add_mutually_exclusive_group(required=True)
    given.add_argument(
        "--charges",
        metavar="A=PC,B=PC,...",
        help="total charges in pC of some or all electrodes, the stretched film's included",
    )
    given.add_argument(
        "--changes",
        metavar="A=PC,B=PC,...",
        dest="readings_of_change",
        help="what the touch added to them: readings of amplifiers that were zeroed before it",
    )
    given.add_argument(
        "--csv",
        metavar="FILE",
        help="a table of readings; - reads standard input, as CSV unless --json is given",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        default="-",
        help="where touches of a table are written: .csv, .json or .jsonl (default: - for "
        "standard output, as CSV unless --json is given)",
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
    parser.add_argument(
        "--sigma",
        metavar="SHARE",
        default="0.01",
        help="standard deviation over the charge or change that is given (default: 0.01)",
    )
    parser.add_argument(
        "--noise",
        metavar="PC",
        help="standard deviation that every reading has besides (default: readout.noise_V, or 0)",
    )
    parser.add_argument(
        "--unknown",
        metavar="NAMES",
        default="x,y,force",
        help="what is sought, of x, y, force, rotation (default: x,y,force)",
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
    response_model.add_options(parser)
    parser.add_argument(
        "--polish",
        action="store_true",
        help="improve the touches with finite-element solves, which takes seconds",
    )


@dataclass(frozen=True)
class Request:
    """What was asked for, read from the options."""

    #: By electrode in the unit; none for a table.
    readings: dict[str, float]
    #: ``pC`` or ``V``.
    unit: str
    #: Of `pvdf_fem.touch.measurement.READINGS`; None is the scene's.
    reading: str | None
    sigma: float
    #: In the unit; None is the scene's.
    noise: float | None
    #: Of the quantities of a touch.
    unknown: tuple[str, ...]
    #: The model that is wanted.
    model: ModelChoice
    #: What is wrong with the options; the other values count only if nothing is.
    mistakes: tuple[str, ...]

    @classmethod
    def of(cls, options: argparse.Namespace) -> Request:
        """The request of a command line."""
        readings, reading, wrong = {}, options.reading, _misplaced(options)
        if options.charges is not None:
            readings, reading = _charges("--charges", options.charges, wrong), "total"
        elif options.readings_of_change is not None:
            readings, reading = _charges("--changes", options.readings_of_change, wrong), "change"
        sigma, noise = positive("--sigma", options.sigma, wrong, zero=True), options.noise
        if noise is not None:
            noise = positive("--noise", noise, wrong, zero=True)
        unknown = sought(options.unknown, wrong)
        model = ModelChoice.of(options, wrong)
        if options.model and options.others:
            wrong.append("--model: is of one scene; leave it out with --or")
        return cls(readings, options.unit, reading, sigma, noise, unknown, model, tuple(wrong))

    def unit_pC(self, scene: Scene) -> dict[str, float]:
        """The unit of readings in nominal pC, by electrode."""
        from pvdf_fem.readout.channel import channels

        return {
            channel.name: 1e12 * channel.capacitance if self.unit == "V" else 1.0
            for channel in channels(scene)
        }

    def readings_pC(self, scene: Scene) -> dict[str, float]:
        """The readings in nominal pC, by electrode."""
        units = self.unit_pC(scene)
        return {name: units.get(name, 1.0) * value for name, value in self.readings.items()}

    def noise_pC(self, scene: Scene) -> dict[str, float] | None:
        """The noise in nominal pC, by electrode; None is that of the readout."""
        if self.noise is None:
            return None
        return {name: unit * self.noise for name, unit in self.unit_pC(scene).items()}


def _misplaced(options: argparse.Namespace) -> list[str]:
    """Options that are not for what was given."""
    table, single = options.csv is not None, "is of a table; leave it out, or give --csv"
    wrong = [f"--{name}: {single}" for name in ("quick", "reading") if getattr(options, name)]
    if options.output != "-":
        wrong.append(f"--output: {single}")
    if not table:
        return wrong
    each = {"--or": options.others, "--polish": options.polish}
    return [f"{name}: is for single touches; leave it out" for name, used in each.items() if used]


def _charges(option: str, text: str, mistakes: list[str]) -> dict[str, float]:
    charges: dict[str, float] = {}
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        number = number_of(value)
        if not (name and equals) or number is None:
            mistakes.append(f"{option} {item.strip()}: write NAME=CHARGE, such as A=905.1")
        elif name in charges:
            mistakes.append(f"{option} {name}: given twice; remove one")
        else:
            charges[name] = number
    return charges


def sought(text: str, mistakes: list[str]) -> tuple[str, ...]:
    """The quantities that are named as sought; what is wrong is added to `mistakes`."""
    items = [item.strip() for item in text.split(",")]
    mistakes += [f"--unknown {i}: choose from {', '.join(NAMES)}" for i in items if i not in NAMES]
    return tuple(NAMES[item] for item in dict.fromkeys(items) if item in NAMES)


def located(
    scenes: Mapping[str, Scene], request: Request, polishing: bool
) -> tuple[ProbeMatch, ...]:
    """Locations with the probe of each scene, the likeliest first.

    What is not sought is known from the first. Raises `ValueError` with all mistakes.
    """
    from pvdf_fem.touch.locate import staged_touch
    from pvdf_fem.touch.polish import polish
    from pvdf_fem.touch.probes import match, weigh

    sensor = next(iter(scenes.values()))
    touch = staged_touch(sensor)
    known = {name: value for name, value in touch.items() if name not in request.unknown}
    require(scenes, request, request.readings_pC(sensor), known)
    # files that are there come first, so that a damaged one is told before any model is built
    order = sorted(scenes, key=lambda name: not request.model.path(scenes[name], name).exists())
    models = {name: model_of(scenes[name], name, request.model) for name in order}
    readings = request.readings_pC(sensor)
    errors: dict[str, Any] = {"sigma": request.sigma, "noise_pC": request.noise_pC(sensor)}
    asked: dict[str, Any] = {"unknown": request.unknown, "known": known, "reading": request.reading}
    matches = weigh(models, readings, **asked, **errors)
    if not polishing:
        return matches
    return match({m.name: polish(models[m.name], m.location, readings, **errors) for m in matches})


def require(
    scenes: Mapping[str, Scene],
    request: Request,
    readings_pC: Mapping[str, float],
    known: Mapping[str, float],
) -> None:
    """Refuse before anything is built what cannot be located with the scenes."""
    from pvdf_fem.touch.measurement import centre_mm
    from pvdf_fem.touch.mistakes import charge_mistakes, known_mistakes

    mistakes: list[str] = []
    for name, scene in scenes.items():
        mistakes += charge_mistakes(scene, readings_pC, request.sigma, request.noise_pC(scene))
        if request.unit == "V" and scene.readout is None:
            mistakes.append(f"--unit V: {name} has no [readout]; add one, or give pC")
    for name, scene in scenes.items():
        mistakes += request.model.mistakes(scene, name)
    if not (request.model.file and request.model.file.exists()):
        centre = centre_mm(next(iter(scenes.values())))
        mistakes += known_mistakes(request.model.domain, request.unknown, {}, known, centre)
    if mistakes:
        raise ValueError("\n".join(dict.fromkeys(mistakes)))


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
        print(*location_lines(probe.location), sep="\n")


def location_lines(found: Location) -> list[str]:
    """A location as lines."""
    from pvdf_fem.touch.measurement import READINGS, electrode_columns

    lines = [f"reading     {READINGS[found.reading]}"]
    if found.reading == "total":
        rest = max(abs(pC) for *_, pC in electrode_columns(found.problem.model.scene).values())
        lines[0] += f", up to {rest:.3g} pC of them without a touch"
    for number, touch in enumerate(found.touches, start=1):
        several = f" {number} of {len(found.touches)}" if len(found.touches) > 1 else ""
        lines += [f"touch{several}", *_touch_lines(touch, found)]
    if found.touches:
        errors = [
            f"{short} {found.deviations[name]:.2g} {_UNITS[short]}"
            for short, name in NAMES.items()
            if name in found.unknown
        ]
        first = "of touch 1" if len(found.touches) > 1 else "of it"
        lines.append(f"within      {', '.join(errors)} {first}: each with a probability of 68 %")
    return lines + [f"remark      {text}" for text in found.remarks]


def _touch_lines(touch: Touch, found: Location) -> list[str]:
    lines, deviations = [], found.deviations_of(touch)
    freedom = found.degrees_of_freedom
    for short, name in NAMES.items():
        value = getattr(touch, name)
        if name in touch.unknown:
            deviation = deviations[name]
            sharp = min(deviation, touch.deviations[name])
            digits = max(0, 1 - math.floor(math.log10(sharp))) if sharp > 0 else 9
            lines.append(
                f"  {short:<8}  {value:>12.{min(digits, 9)}f} ± {deviation:.2g} {_UNITS[short]}"
            )
        else:
            lines.append(f"  {short:<8}  {value:>12.6g} (known) {_UNITS[short]}")
    fit = f"chi-square {touch.chi_square:.3g}"
    if freedom > 0:
        fit += f" with {freedom} degrees of freedom, p-value {touch.p_value:.2g}"
    return [*lines, f"  {'fit':<8}  {fit}, share of likelihood {touch.weight:.3g}"]
