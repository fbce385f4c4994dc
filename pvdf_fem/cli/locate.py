"""The command ``pvdf-fem locate``: from charges to the touch."""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pvdf_fem.files import require_writable

if TYPE_CHECKING:
    from pvdf_fem.response.model import Domain
    from pvdf_fem.response.response import Response
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
--force-range. It is built on the first call, which takes minutes and is shown
on standard error, and kept beside the scene file; later calls take a moment."""

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
    add_model_options(parser)
    parser.add_argument(
        "--polish",
        action="store_true",
        help="improve the touches with finite-element solves, which takes seconds",
    )


def add_model_options(parser: argparse.ArgumentParser) -> None:
    """The options that say which model is used."""
    parser.add_argument(
        "--model",
        metavar="FILE",
        type=Path,
        help="the scene's model, built and written there if the file does not exist (default: "
        "SCENE-HASH.response beside the scene file, the hash being of scene, domain and code)",
    )
    parser.add_argument(
        "--reach",
        metavar="MM",
        default="12",
        help="a new model's largest distance of the centroid from the centre (default: 12)",
    )
    parser.add_argument(
        "--force-range",
        metavar="LEAST,LARGEST",
        default="0.1,5",
        help="a new model's forces in N (default: 0.1,5)",
    )


@dataclass(frozen=True)
class Request:
    """What was asked for, read from the options."""

    charges_pC: dict[str, float]
    sigma: float
    noise_pC: float
    #: Of the quantities of a touch.
    unknown: tuple[str, ...]
    #: The domain of a model that is to be built.
    domain: Domain
    #: What is wrong with the options; the other values count only if nothing is.
    mistakes: tuple[str, ...]

    @classmethod
    def of(cls, options: argparse.Namespace) -> Request:
        """The request of a command line."""
        from pvdf_fem.response.model import Domain

        charges, wrong = _charges(options.charges)
        sigma = _positive("--sigma", options.sigma, wrong, zero=True)
        noise = _positive("--noise", options.noise, wrong, zero=True)
        unknown = _unknown(options.unknown, wrong)
        reach = _positive("--reach", options.reach, wrong)
        domain = Domain(reach, _range(options.force_range, wrong))
        if options.model and options.others:
            wrong.append("--model: is of one scene; leave it out with --or")
        return cls(charges, sigma, noise, unknown, domain, tuple(wrong))


def _charges(text: str) -> tuple[dict[str, float], list[str]]:
    charges: dict[str, float] = {}
    mistakes = []
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        number = _number(value)
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


def _range(text: str, mistakes: list[str]) -> tuple[float, float]:
    values = [_number(part) for part in text.split(",")]
    if len(values) == 2 and values[0] and values[1] and 0.0 < values[0] < values[1]:
        return values[0], values[1]
    mistakes.append(f"--force-range {text}: give two forces in N, such as 0.1,5")
    return 0.0, 0.0


def _positive(option: str, text: str, mistakes: list[str], zero: bool = False) -> float:
    value = _number(text)
    if value is None or value < 0.0 or (value == 0.0 and not zero):
        wanted = "a number that is not negative" if zero else "a positive number"
        mistakes.append(f"{option} {text}: give {wanted}")
        return 0.0
    return value


def _number(text: str) -> float | None:
    # float() also takes 1_000, and digits of other scripts
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        return None
    return value if math.isfinite(value := float(text)) else None


def model_of(scene: Scene, scene_file: str, file: Path | None, request: Request) -> Response:
    """The model of a scene, from its file or built and written there.

    Raises
    ------
    ValueError
        For a file that holds no sound model, or that of another scene.
    """
    from tqdm import tqdm

    from pvdf_fem.response.build import build_response
    from pvdf_fem.response.response import Response

    alone = _alone(scene)
    path = _path(scene, scene_file, file, request)
    if path.exists():
        model = Response.load(path)
        if _alone(model.scene) != alone:
            raise ValueError(
                f"--model {path}: is of another film, probe or electrodes than {scene_file}; "
                "name another file"
            )
        return model
    print(f"building the model of {scene_file}, to be kept as {path}", file=sys.stderr)
    with tqdm(unit="solve", file=sys.stderr, disable=None) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        domain = request.domain
        model = build_response(
            alone, reach_mm=domain.reach_mm, force_N=domain.force_N, progress=progress
        )
    model.save(path)
    return model


def _alone(scene: Scene) -> Scene:
    """The scene with the probe unturned at the centre under 1 N: what its model depends on."""
    place = {"probe.x_mm": 0.0, "probe.y_mm": 0.0, "probe.rotation_deg": 0.0}
    return scene.with_(**place, **{"load.force_N": 1.0})


def _path(scene: Scene, scene_file: str, file: Path | None, request: Request) -> Path:
    """The file of a scene's model: the one that was named, or the default one."""
    from pvdf_fem.response.response_file import response_key

    if file:
        return file
    name = response_key(_alone(scene), request.domain)[:16]
    return Path(scene_file).with_name(f"{Path(scene_file).stem}-{name}.response")


def located(
    scenes: Mapping[str, Scene], file: Path | None, request: Request, polishing: bool
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
    _require(scenes, request, known, file)
    # files that are there come first, so that a damaged one is told before any model is built
    order = sorted(scenes, key=lambda name: not _path(scenes[name], name, file, request).exists())
    models = {name: model_of(scenes[name], name, file, request) for name in order}
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


def _require(
    scenes: Mapping[str, Scene], request: Request, known: Mapping[str, float], file: Path | None
) -> None:
    """Refuse before anything is built what cannot be located with the scenes."""
    from pvdf_fem.touch.mistakes import charge_mistakes, known_mistakes

    mistakes: list[str] = []
    for scene in scenes.values():
        names = [electrode.name for electrode in scene.electrode_list]
        mistakes += charge_mistakes(names, request.charges_pC, request.sigma, request.noise_pC)
    for name, scene in scenes.items():
        path = _path(scene, name, file, request)
        if path.is_file():  # the domain is the file's
            continue
        require_writable(path)
        if request.domain.reach_mm > scene.film.radius_mm:
            reason = f"is beyond the rim at film.radius_mm = {scene.film.radius_mm:g}; give less"
            mistakes.append(f"--reach {request.domain.reach_mm:g}: {reason}")
    if not (file and file.exists()):
        mistakes += known_mistakes(request.domain, request.unknown, {}, known)
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
