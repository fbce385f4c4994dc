"""The model of the charges that commands need: from its file, or built and kept."""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_progress,
    add_scene_command,
    add_text_options,
    convert_value_errors,
    read_scene,
)
from pvdf_fem.files import FileError, require_writable
from pvdf_fem.progress import Progress, format_remaining_time, show_progress
from pvdf_fem.solver.nonlinear.status import NotConvergedError

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.surrogate.response import Response
    from pvdf_fem.surrogate.touch_domain import Domain


DESCRIPTION = """\
The model of the charges by the touch that `locate`, `track` and `explore` use. The
model is built unless a model beside the scene file serves, and told with its error.
The scene says where and how hard the film is touched:

  [model]
  reach_mm = 12             # largest distance of the probe from the centre
  force_range_N = [0.1, 5]
  tolerance = "auto"        # a tenth of the noise of readings, or a number

A model for a larger reach and range of forces serves, also for other electrodes,
d31 and d32."""

EPILOG = """\
examples:
  pvdf-fem model sensor.toml
  pvdf-fem model sensor.toml --list
  pvdf-fem model sensor.toml --set model.reach_mm=8 --json

exit codes: 0 there is a model, 2 bad input, 3 none, or its error bound is above
the tolerance"""


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    summary = "the model of a sensor that locates touches"
    parser = add_scene_command(commands, "model", run, summary, DESCRIPTION, EPILOG)
    parser.add_argument(
        "--list", action="store_true", help="list the models that there are, and build none"
    )
    add_options(parser)


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    scene, mistakes = read_scene(options), list[str]()
    choice = ResponseChoice.of(options, mistakes)
    if scene.single_probe is None:
        mistakes.append(f"{options.scene}: has no [probe]; add one")
    if mistakes := [*mistakes, *([] if mistakes else choice.mistakes(scene, options.scene))]:
        raise InputError(*mistakes)
    if options.list:
        present = [*choice.present(scene, options.scene)]
        rows = [{"file": str(path), "serves": not why, "reason": why} for path, why in present]
        if options.json:
            print(json.dumps({"models": rows}))
        else:
            for path, why in present:
                print(f"{path}: {why or 'serves'}")
            if not present:
                print(f"{options.scene}: no model is there; build one without --list")
        return ExitCode.CONVERGED if any(not why for _, why in present) else ExitCode.NOT_CONVERGED
    model = load_or_build_response(scene, options.scene, choice)
    file = str(choice.path(scene, options.scene))
    print(json.dumps({"file": file, **model.to_json()}) if options.json else f"{file}: {model}")
    within = model.error_bound <= choice.wanted(scene)[1]
    return ExitCode.CONVERGED if within else ExitCode.NOT_CONVERGED


def add_options(parser: argparse.ArgumentParser, tolerance: str | None = None) -> None:
    """The options that say which model a command uses, a new one to a tolerance."""
    parser.add_argument(
        "--model",
        metavar="FILE",
        type=Path,
        help="the scene's model, built and written there if the file does not exist (default: "
        "SCENE-HASH.response beside the scene file, the hash being of film and probe, domain, "
        "tolerance and code); for other electrodes, d31 and d32 it is read anew",
    )
    parser.add_argument(
        "--reach",
        metavar="MM",
        help="the model's largest distance of the centroid from the centre (default: "
        "model.reach_mm, or 12, at most 0.6 of the film's radius and the probe's width away from "
        "the rim)",
    )
    add_progress(parser)
    forces = "model.force_range_N, or 0.1,5"
    error = "" if tolerance else " (default: model.tolerance, or 0.1 of the noise)"
    add_text_options(
        parser,
        ("--force-range", "LEAST,LARGEST", None, f"the model's forces in N (default: {forces})"),
        ("--tolerance", "SHARE", tolerance, f"its largest error bound{error}"),
    )


@dataclass(frozen=True)
class ResponseChoice:
    """Which model is wanted, as the options say."""

    file: Path | None
    #: The largest distance from the centre in mm, forces and largest error bound; None for the
    #: scene's.
    reach_mm: float | None
    force_N: tuple[float, float] | None
    tolerance: float | None
    sigma: float = 0.01  #: Relative noise of readings.
    progress: bool | None = None  #: Whether builds show it; by default on a terminal.

    @classmethod
    def of(cls, options: argparse.Namespace, mistakes: list[str]) -> ResponseChoice:
        """The choice of a command line; what is wrong with it is added to `mistakes`."""
        texts = options.reach, options.force_range, options.tolerance
        reach = texts[0] and parse_number("--reach", texts[0], mistakes)
        forces = texts[1] and _range(texts[1], mistakes)
        tolerance = texts[2] and parse_number("--tolerance", texts[2], mistakes)
        # what is wrong with --sigma is told by its command
        sigma = parse_number("--sigma", getattr(options, "sigma", "0.01"), [], zero=True) or 0.01
        return cls(options.model, reach, forces, tolerance, sigma, options.progress)

    def wanted(self, scene: Scene) -> tuple[Domain, float]:
        """Touches that a scene's model has to hold for, and its tolerance."""
        from pvdf_fem.surrogate.touch_domain import resolve_response_settings

        domain, tolerance = resolve_response_settings(scene, self.sigma)
        reach_mm = domain.reach_mm if self.reach_mm is None else self.reach_mm
        domain = replace(domain, reach_mm=reach_mm, force_N=self.force_N or domain.force_N)
        return domain, tolerance if self.tolerance is None else self.tolerance

    def path(self, scene: Scene, scene_file: str) -> Path:
        """The file of a scene's model: the one that was named, or the default one."""
        from pvdf_fem.surrogate.response_key import make_response_key

        if self.file:
            return self.file
        own = _default_path(scene_file, make_response_key(scene, *self.wanted(scene)))
        if own.exists():
            return own
        serving = (path for path, why in self.present(scene, scene_file) if not why)
        return next(serving, own)

    def present(self, scene: Scene, scene_file: str) -> Iterator[tuple[Path, str]]:
        """The models beside a scene's file, and why each of them does not serve, if it does not."""
        from pvdf_fem.surrogate.response import Response
        from pvdf_fem.surrogate.response_key import make_mechanical_key, make_response_key

        domain, tolerance = self.wanted(scene)
        for path in sorted(Path(scene_file).parent.glob(f"{Path(scene_file).stem}-*.response")):
            try:
                kept = Response.load(path)
            except FileError as error:
                yield path, str(error).removeprefix(f"{path}: ")
                continue
            code = make_response_key(kept.scene, kept.domain, kept.tolerance)
            if make_mechanical_key(kept.scene) != make_mechanical_key(scene):
                yield path, "is of another film or probe"
            elif not kept.domain.covers(domain):
                yield path, f"holds for {kept.domain} only"
            elif kept.error_bound > tolerance:
                yield path, f"has an error bound of {kept.error_bound:.2g}"
            elif path != _default_path(scene_file, code):
                yield path, "was built by another version"
            else:
                yield path, ""

    def mistakes(self, scene: Scene, scene_file: str) -> list[str]:
        """What keeps a new model from being built; `FileError` if it could not be written."""
        path = self.path(scene, scene_file)
        if path.is_file():  # the domain is the file's
            return []
        require_writable(path)
        reach, rim = self.reach_mm or 0.0, scene.film.radius_mm
        beyond = f"--reach {reach:g}: is beyond the rim at film.radius_mm = {rim:g}; give less"
        return [beyond] if reach > rim else []


@convert_value_errors()
def load_or_build_response(
    scene: Scene, scene_file: str, choice: ResponseChoice, *, as_kept: bool = False
) -> Response:
    """The model of a scene, from its file or built and written there; `as_kept` may have other
    electrodes. Raises `InputError` for a file of a film or a probe that deforms otherwise."""
    from pvdf_fem.surrogate.response import Response
    from pvdf_fem.surrogate.response_builder import build_response
    from pvdf_fem.surrogate.response_key import has_same_readout, require_same_mechanics
    from pvdf_fem.surrogate.touch_domain import centre_probe

    path = choice.path(scene, scene_file)
    if not path.exists():
        print(f"building the model of {scene_file}, to be kept as {path}", file=sys.stderr)
        (domain, tolerance), alone = choice.wanted(scene), centre_probe(scene)
        print(f"  for {domain}, with errors up to {tolerance:g} of a charge", file=sys.stderr)
        for other, why in () if choice.file else choice.present(scene, scene_file):
            print(f"  {other.name} does not serve: it {why}", file=sys.stderr)
        try:
            wanted = domain.reach_mm, domain.force_N, tolerance
            with show_progress("s of one core", choice.progress) as show:
                model = build_response(alone, *wanted, file=path, progress=_estimated(show))
        except NotConvergedError as error:
            low, high = domain.force_N
            now = f"now {domain.reach_mm:g} mm, {low:g} to {high:g} N"
            advice = f"or give a smaller --reach or --force-range ({now})"
            raise NotConvergedError(f"{error}; {advice}") from error
        print(*model.remarks, sep="\n", end="\n" if model.remarks else "", file=sys.stderr)
        return model.for_scene(scene)
    kept = Response.load(path)
    try:
        require_same_mechanics(kept.scene, scene)
        if as_kept:
            return kept
        if not has_same_readout(kept.scene, scene):
            print(f"reading {path} anew for other electrodes, d31 or d32", file=sys.stderr)
        model = kept.for_scene(scene, progress=choice.progress)
    except ValueError as error:
        raise ValueError(f"--model {path}: {error}, or name another file") from error
    if model.spline is not kept.spline and not choice.file:
        with suppress(FileError):  # a model that cannot be kept is read anew next time
            model.for_scene(centre_probe(scene)).save(path)
    return model


def _estimated(show: Progress) -> Progress:
    """A progress that first says how long a build takes, by its first solves."""
    told = False

    def tell(done: float, total: float) -> None:
        nonlocal told
        if not told:
            text = (
                f"  that takes {format_remaining_time(total)} of one core, as its first solves tell"
            )
            print(text, file=sys.stderr)
        told = True
        show(done, total)

    return tell


def _default_path(scene_file: str, key: str) -> Path:
    return Path(scene_file).with_name(f"{Path(scene_file).stem}-{key[:16]}.response")


def _range(text: str, mistakes: list[str]) -> tuple[float, float]:
    values = [read_number(part) for part in text.split(",")]
    if len(values) == 2 and values[0] and values[1] and 0.0 < values[0] < values[1]:
        return values[0], values[1]
    mistakes.append(f"--force-range {text}: give two forces in N, such as 0.1,5")
    return 0.0, 0.0


def parse_number(option: str, text: str, mistakes: list[str], zero: bool = False) -> float:
    """The positive number of an option; what is wrong with it is added to `mistakes`."""
    value = read_number(text)
    if value is None or value < 0.0 or (value == 0.0 and not zero):
        wanted = "a number that is not negative" if zero else "a positive number"
        mistakes.append(f"{option} {text}: give {wanted}")
        return 0.0
    return value


def read_number(text: str) -> float | None:
    """A finite number, or None."""
    # float() also takes 1_000, and digits of other scripts
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        return None
    return value if math.isfinite(value := float(text)) else None
