"""The command ``pvdf-fem locate``: from charges to the touch."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

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

A model of the charges is needed, over all places within --reach and forces in
--force-range. It is built on the first call, which takes a minute or two and is
shown on standard error, and kept beside the scene file; later calls take a
moment. A call that was stopped goes on where it was."""

EPILOG = """\
examples:
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9
  pvdf-fem locate scene.toml --charges A=905.1,B=731.4,C=600.2,D=640.9 \\
      --unknown x,y,force,rotation --sigma 0.005 --polish --json
  pvdf-fem locate triangle.toml --or rectangle.toml --charges A=905,B=731,C=600,D=641

exit codes: 0 located (look at the remarks), 2 bad input, 3 no touch found, or a
solve failed"""

#: What may be sought, as on the command line.
NAMES = {"x": "x_mm", "y": "y_mm", "force": "force_N", "rotation": "rotation_deg"}
_UNITS = {"x": "mm", "y": "mm", "force": "N", "rotation": "°"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "--charges",
        metavar="A=PC,B=PC,...",
        required=True,
        help="measured charges in pC, of some or all electrodes",
    )
    parser.add_argument(
        "--sigma",
        metavar="SHARE",
        default="0.01",
        help="standard deviation of each charge, relative to it (default: 0.01)",
    )
    parser.add_argument(
        "--noise",
        metavar="PC",
        default="0",
        help="standard deviation in pC that every charge has besides (default: 0)",
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

    charges_pC: dict[str, float]
    sigma: float
    noise_pC: float
    #: Of the quantities of a touch.
    unknown: tuple[str, ...]
    #: The model that is wanted.
    model: ModelChoice
    #: What is wrong with the options; the other values count only if nothing is.
    mistakes: tuple[str, ...]

    @classmethod
    def of(cls, options: argparse.Namespace) -> Request:
        """The request of a command line."""
        charges, wrong = _charges(options.charges)
        sigma = positive("--sigma", options.sigma, wrong, zero=True)
        noise = positive("--noise", options.noise, wrong, zero=True)
        unknown = _unknown(options.unknown, wrong)
        model = ModelChoice.of(options, wrong)
        if options.model and options.others:
            wrong.append("--model: is of one scene; leave it out with --or")
        return cls(charges, sigma, noise, unknown, model, tuple(wrong))


def _charges(text: str) -> tuple[dict[str, float], list[str]]:
    charges: dict[str, float] = {}
    mistakes = []
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        number = number_of(value)
        if not (name and equals) or number is None:
            mistakes.append(f"--charges {item.strip()}: write NAME=CHARGE, such as A=905.1")
        elif name in charges:
            mistakes.append(f"--charges {name}: given twice; remove one")
        else:
            charges[name] = number
    return charges, mistakes


def _unknown(text: str, mistakes: list[str]) -> tuple[str, ...]:
    items = [item.strip() for item in text.split(",")]
    mistakes += [f"--unknown {i}: choose from {', '.join(NAMES)}" for i in items if i not in NAMES]
    return tuple(NAMES[item] for item in dict.fromkeys(items) if item in NAMES)


def located(
    scenes: Mapping[str, Scene], request: Request, polishing: bool
) -> tuple[ProbeMatch, ...]:
    """Locations with the probe of each scene, the likeliest first.

    What is not sought is known from the first scene.

    Raises
    ------
    ValueError
        With all mistakes in what was asked for.
    """
    from pvdf_fem.response.model import touch_of
    from pvdf_fem.touch.polish import polish
    from pvdf_fem.touch.probes import match, weigh

    touch = touch_of(next(iter(scenes.values())))
    known = {name: value for name, value in touch.items() if name not in request.unknown}
    _require(scenes, request, known)
    # files that are there come first, so that a damaged one is told before any model is built
    order = sorted(scenes, key=lambda name: not request.model.path(scenes[name], name).exists())
    models = {name: model_of(scenes[name], name, request.model) for name in order}
    matches = weigh(
        models,
        request.charges_pC,
        request.sigma,
        unknown=request.unknown,
        known=known,
        noise_pC=request.noise_pC,
    )
    if not polishing:
        return matches
    polished = {
        probe.name: polish(
            models[probe.name],
            probe.location,
            request.charges_pC,
            request.sigma,
            noise_pC=request.noise_pC,
        )
        for probe in matches
    }
    return match(polished)


def _require(scenes: Mapping[str, Scene], request: Request, known: Mapping[str, float]) -> None:
    """Refuse before anything is built what cannot be located with the scenes."""
    from pvdf_fem.touch.mistakes import charge_mistakes, known_mistakes

    mistakes: list[str] = []
    for scene in scenes.values():
        names = [electrode.name for electrode in scene.electrode_list]
        mistakes += charge_mistakes(names, request.charges_pC, request.sigma, request.noise_pC)
    for name, scene in scenes.items():
        mistakes += request.model.mistakes(scene, name)
    if not (request.model.file and request.model.file.exists()):
        mistakes += known_mistakes(request.model.domain, request.unknown, {}, known)
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
    lines = []
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
