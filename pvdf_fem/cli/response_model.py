"""The model of the charges that commands need: from its file, or built and kept."""

from __future__ import annotations

import argparse
import math
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pvdf_fem.cli.program import add_texts
from pvdf_fem.files import FileError, require_writable

if TYPE_CHECKING:
    from pvdf_fem.response.model import Domain
    from pvdf_fem.response.response import Response
    from pvdf_fem.scene.scene import Scene


def add_options(parser: argparse.ArgumentParser, tolerance: str = "1e-3") -> None:
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
        help="a new model's largest distance of the centroid from the centre (default: 12, at "
        "most 0.6 of the film's radius and the probe's width away from the rim)",
    )
    add_texts(
        parser,
        ("--force-range", "LEAST,LARGEST", "0.1,5", "a new model's forces in N"),
        ("--tolerance", "SHARE", tolerance, "its largest error bound, relative to a charge"),
    )


@dataclass(frozen=True)
class ModelChoice:
    """Which model is wanted, as the options say."""

    file: Path | None
    #: Of a new model: the largest distance from the centre in mm, None for the default, and forces.
    reach_mm: float | None
    force_N: tuple[float, float]
    tolerance: float  #: Largest error bound of a new model.

    @classmethod
    def of(cls, options: argparse.Namespace, mistakes: list[str]) -> ModelChoice:
        """The choice of a command line; what is wrong with it is added to `mistakes`."""
        reach = None if options.reach is None else positive("--reach", options.reach, mistakes)
        forces = _range(options.force_range, mistakes)
        tolerance = positive("--tolerance", options.tolerance, mistakes)
        return cls(options.model, reach, forces, tolerance)

    def domain(self, scene: Scene) -> Domain:
        """Touches that a new model of a scene holds for."""
        from pvdf_fem.response.model import Domain, default_reach_mm

        reach_mm = default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        return Domain(reach_mm, self.force_N)

    def path(self, scene: Scene, scene_file: str) -> Path:
        """The file of a scene's model: the one that was named, or the default one."""
        from pvdf_fem.response.response_file import response_key

        if self.file:
            return self.file
        name = response_key(scene, self.domain(scene), self.tolerance)[:16]
        return Path(scene_file).with_name(f"{Path(scene_file).stem}-{name}.response")

    def mistakes(self, scene: Scene, scene_file: str) -> list[str]:
        """What keeps a new model from being built; `FileError` if it could not be written."""
        path = self.path(scene, scene_file)
        if path.is_file():  # the domain is the file's
            return []
        require_writable(path)
        reach, rim = self.reach_mm or 0.0, scene.film.radius_mm
        beyond = f"--reach {reach:g}: is beyond the rim at film.radius_mm = {rim:g}; give less"
        return [beyond] if reach > rim else []


def model_of(scene: Scene, scene_file: str, choice: ModelChoice) -> Response:
    """The model of a scene, from its file or built and written there. Raises `ValueError` for a
    file of a film or a probe that deforms otherwise, and `FileError`."""
    from pvdf_fem.response.build import build_response
    from pvdf_fem.response.model import centred
    from pvdf_fem.response.response import Response, reads_alike, refuse_other_mechanics
    from pvdf_fem.solution.solution import NotConvergedError
    from pvdf_fem.sweeps.sweep import shown

    path = choice.path(scene, scene_file)
    if not path.exists():
        print(f"building the model of {scene_file}, to be kept as {path}", file=sys.stderr)
        domain, alone = choice.domain(scene), centred(scene)
        try:
            wanted = domain.reach_mm, domain.force_N, choice.tolerance
            with shown("solve") as progress:
                model = build_response(alone, *wanted, file=path, progress=progress)
        except NotConvergedError as error:
            low, high = domain.force_N
            now = f"now {domain.reach_mm:g} mm, {low:g} to {high:g} N"
            advice = f"or give a smaller --reach or --force-range ({now})"
            raise NotConvergedError(f"{error}; {advice}") from error
        print(*model.remarks, sep="\n", end="\n" if model.remarks else "", file=sys.stderr)
        return model.for_scene(scene)
    kept = Response.load(path)
    try:
        refuse_other_mechanics(kept.scene, scene)
        if not reads_alike(kept.scene, scene):
            print(f"reading {path} anew for other electrodes, d31 or d32", file=sys.stderr)
        model = kept.for_scene(scene)
    except ValueError as error:
        raise ValueError(f"--model {path}: {error}, or name another file") from error
    if model.spline is not kept.spline and not choice.file:
        with suppress(FileError):  # a model that cannot be kept is read anew next time
            model.for_scene(centred(scene)).save(path)
    return model


def _range(text: str, mistakes: list[str]) -> tuple[float, float]:
    values = [number_of(part) for part in text.split(",")]
    if len(values) == 2 and values[0] and values[1] and 0.0 < values[0] < values[1]:
        return values[0], values[1]
    mistakes.append(f"--force-range {text}: give two forces in N, such as 0.1,5")
    return 0.0, 0.0


def positive(option: str, text: str, mistakes: list[str], zero: bool = False) -> float:
    """The positive number of an option; what is wrong with it is added to `mistakes`."""
    value = number_of(text)
    if value is None or value < 0.0 or (value == 0.0 and not zero):
        wanted = "a number that is not negative" if zero else "a positive number"
        mistakes.append(f"{option} {text}: give {wanted}")
        return 0.0
    return value


def number_of(text: str) -> float | None:
    """A finite number, or None."""
    # float() also takes 1_000, and digits of other scripts
    if not re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text):
        return None
    return value if math.isfinite(value := float(text)) else None
