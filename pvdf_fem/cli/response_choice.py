"""The response that a subcommand needs: its options, and how it is loaded or built."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pvdf_fem.cli.options import (
    MAX_QUOTED,
    add_progress,
    add_text_option,
    parse_number,
    parse_optional_number,
    read_number,
)
from pvdf_fem.cli.program import convert_value_errors
from pvdf_fem.files import FileError, require_writable
from pvdf_fem.progress import Progress, format_remaining_time, show_progress
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solver.nonlinear.status import NotConvergedError

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.surrogate.response import Response
    from pvdf_fem.surrogate.touch_domain import Domain

_DEFAULT_SIGMA = "0.01"


def add_response_options(parser: argparse.ArgumentParser, tolerance: str | None = None) -> None:
    """Add the options that choose the file of a response or describe the response to be built.

    These are the options that `ResponseChoice.from_options` reads, without ``--sigma``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a subcommand, to which the options are added.
    tolerance : str, optional
        Default of ``--tolerance``. By default the option is None, and the tolerance is that of the
        scene or follows from the noise of the readings.
    """
    parser.add_argument(
        "--model",
        metavar="FILE",
        type=Path,
        help="file of the response, built and written if it does not exist (default: "
        "SCENE-HASH.response beside the scene file, where the hash depends on film, probe, reach, "
        "forces, tolerance and code); for other electrodes, d31 and d32 it is evaluated again",
    )
    parser.add_argument(
        "--reach",
        metavar="MM",
        help="maximum distance of the probe's centroid from the centre of the film (default: "
        "model.reach_mm, or 12, but at most 0.6 of the film's radius, and the probe's width away "
        "from the rim)",
    )
    add_progress(parser)
    add_text_option(
        parser,
        "--force-range",
        "MIN,MAX",
        about="range of forces in N (default: model.force_range_N, or 0.1,5)",
    )
    error = "maximum error of a charge, relative to the charge"
    if tolerance is None:
        error += " (default: model.tolerance, or 0.1 of the noise of readings)"
    add_text_option(parser, "--tolerance", "FRACTION", about=error, default=tolerance)


@dataclass(frozen=True)
class ResponseChoice:
    """The response that a subcommand needs, as its options describe it.

    Parameters
    ----------
    file : Path or None
        The file of ``--model``, or None without this option.
    reach_mm : float or None
        Maximum distance of the probe from the film's centre in mm. None for the value in the
        scene's table [model], or its default.
    force_range_N : tuple of float, length 2, or None
        Minimum and maximum force in N. None for the values in [model], or their defaults.
    tolerance : float or None
        Maximum error of a charge, relative to the charge. None for the value in [model], or its
        default.
    sigma : float
        Standard deviation of a reading, relative to its value, from which the default tolerance is
        computed.
    progress : bool or None
        Whether builds show their progress. None shows it on a terminal only.
    """

    file: Path | None
    reach_mm: float | None
    force_range_N: tuple[float, float] | None
    tolerance: float | None
    sigma: float
    progress: bool | None = None

    @classmethod
    def from_options(cls, options: argparse.Namespace, errors: list[str]) -> ResponseChoice:
        """Parse the texts of the options that `add_response_options` has added.

        Parameters
        ----------
        options : argparse.Namespace
            These options, and `sigma` if the subcommand has this option.
        errors : list of str
            Error messages, to which those about invalid values are appended. The subcommand itself
            reports an invalid ``--sigma``.

        Returns
        -------
        ResponseChoice
            Its `sigma` is 0.01 if ``--sigma`` does not exist, is zero or is invalid. If messages
            were appended, it must not be used.
        """
        reach_mm = parse_optional_number("--reach", options.reach, errors)
        force_range_N = _parse_force_range(options.force_range, errors)
        tolerance = parse_optional_number("--tolerance", options.tolerance, errors)
        sigma_text = getattr(options, "sigma", _DEFAULT_SIGMA)
        sigma = parse_number("--sigma", sigma_text, [], allow_zero=True)
        return cls(
            file=options.model,
            reach_mm=reach_mm,
            force_range_N=force_range_N,
            tolerance=tolerance,
            sigma=sigma or float(_DEFAULT_SIGMA),
            progress=options.progress,
        )

    def resolve_settings(self, scene: Scene) -> tuple[Domain, float]:
        """Return the reach and the forces that the response must cover, and its tolerance.

        Options take precedence over the scene's table [model], and this table over the defaults.
        """
        from pvdf_fem.surrogate.touch_domain import resolve_response_settings

        domain, tolerance = resolve_response_settings(scene, self.sigma)
        if self.reach_mm is not None:
            domain = replace(domain, reach_mm=self.reach_mm)
        if self.force_range_N is not None:
            domain = replace(domain, force_N=self.force_range_N)
        return domain, tolerance if self.tolerance is None else self.tolerance

    def find_path(self, scene: Scene, scene_file: str) -> Path:
        """Return the path of the response file to load, or to write if it does not exist.

        Parameters
        ----------
        scene : Scene
            The sensor of which the response is needed.
        scene_file : str
            Path of its scene file.

        Returns
        -------
        Path
            The file of ``--model``. Without this option, the file that would be written for exactly
            these settings, if it exists; else the first file beside the scene file whose response
            can be used; else the file that would be written.
        """
        from pvdf_fem.surrogate.response_key import make_response_key

        if self.file:
            return self.file
        domain, tolerance = self.resolve_settings(scene)
        own = _make_default_path(scene_file, make_response_key(scene, domain, tolerance))
        if own.exists():
            return own
        for path, reason in self.list_files(scene, scene_file):
            if not reason:
                return path
        return own

    def list_files(self, scene: Scene, scene_file: str) -> Iterator[tuple[Path, str]]:
        """Yield the response files beside a scene file that have its name, sorted by path.

        Parameters
        ----------
        scene : Scene
            The sensor of which the response is needed.
        scene_file : str
            Path of its scene file.

        Yields
        ------
        path : Path
            A response file, ``SCENE-*.response``.
        reason : str
            Reason why its response cannot be used, or an empty text if it can.
        """
        stem = Path(scene_file).stem
        for path in sorted(Path(scene_file).parent.glob(f"{stem}-*.response")):
            yield path, self._explain_rejection(path, scene, scene_file)

    def _explain_rejection(self, path: Path, scene: Scene, scene_file: str) -> str:
        """Return the reason why a response file cannot be used for a scene, or an empty text.

        The reason continues a sentence that begins with the file, such as "is of another film".

        Parameters
        ----------
        path : Path
            The response file.
        scene : Scene
            The sensor of which the response is needed.
        scene_file : str
            Path of its scene file.
        """
        from pvdf_fem.surrogate.response import Response
        from pvdf_fem.surrogate.response_key import make_mechanical_key, make_response_key

        try:
            response = Response.load(path)
        except FileError as error:
            return str(error).removeprefix(f"{path}: ")
        domain, tolerance = self.resolve_settings(scene)
        if make_mechanical_key(response.scene) != make_mechanical_key(scene):
            return "is of another film or probe"
        if not response.domain.covers(domain):
            return f"holds for {response.domain} only"
        if response.error_bound > tolerance:
            return f"has an error bound of {response.error_bound:.2g}"
        key_today = make_response_key(response.scene, response.domain, response.tolerance)
        if path != _make_default_path(scene_file, key_today):
            return "was built by another version"
        return ""

    def find_errors(self, scene: Scene, scene_file: str) -> list[str]:
        """Return error messages if there can be no response, or if it would exceed the rim.

        The parameters are those of `find_path`. If the response file exists, its reach is used.

        Raises
        ------
        FileError
            If the response file does not exist and cannot be written.
        """
        from pvdf_fem.surrogate.response_key import make_mechanical_key

        try:
            make_mechanical_key(scene)
        except SceneError:  # a ValueError, too, but `run_program` prints the problems that it lists
            raise
        except ValueError as error:
            return str(error).splitlines()
        path = self.find_path(scene, scene_file)
        if path.is_file():
            return []
        require_writable(path)
        rim_mm = 1e3 * scene.film.reach
        if self.reach_mm is None or self.reach_mm <= rim_mm:
            return []
        return [
            f"--reach {self.reach_mm:g}: is beyond the rim, at most {rim_mm:g} mm from the centre; "
            "give a smaller reach"
        ]


@convert_value_errors()
def load_or_build_response(
    scene: Scene,
    scene_file: str,
    choice: ResponseChoice,
    *,
    as_stored: bool = False,
    with_sensitivities: bool = False,
) -> Response:
    """Load the response of a scene from its file, or build it and write the file.

    A stored response with other electrodes, d31 or d32 is evaluated for those of the scene, and
    the result replaces the file, unless ``--model`` is used or the file cannot be written.

    Parameters
    ----------
    scene : Scene
        The sensor of which the response is needed.
    scene_file : str
        Path of its scene file.
    choice : ResponseChoice
        Options that describe the response.
    as_stored : bool
        Whether to return a stored response unchanged, even if it has other electrodes.
    with_sensitivities : bool
        Whether the response needs the derivatives for the parameters in the scene's
        ``[calibration]``. If a stored response lacks them, they are solved, and it is stored again.

    Returns
    -------
    Response
        Response for the electrodes of the scene, or with `as_stored` perhaps for others.

    Raises
    ------
    InputError
        If the response in the file is for another film or probe, if the file cannot be read or
        written, or if the arguments of a build are invalid.
    NotConvergedError
        If the response has to be built, or evaluated for other electrodes, and solves fail.
    """
    from pvdf_fem.log import logger
    from pvdf_fem.surrogate.response import Response
    from pvdf_fem.surrogate.response_key import gives_same_charges, require_same_mechanics
    from pvdf_fem.surrogate.touch_domain import centre_probe

    path = choice.find_path(scene, scene_file)
    if not path.exists():
        return _build_response(scene, scene_file, choice, path)
    logger.info("using the response %s", path)
    stored = Response.load(path)
    try:
        require_same_mechanics(stored.scene, scene)
        if as_stored:
            return stored
        if not gives_same_charges(stored.scene, scene):
            print(f"evaluating {path} for other electrodes, d31 or d32", file=sys.stderr)
        response = stored.for_scene(scene, progress=choice.progress)
    except ValueError as error:
        raise ValueError(f"--model {path}: {error}, or name another file") from error
    if with_sensitivities:
        response = response.with_sensitivities(progress=choice.progress)
    # for_scene() computes another spline only for other electrodes, d31 or d32
    is_new = response.spline is not stored.spline
    is_new |= response.sensitivities is not stored.sensitivities
    if is_new and not choice.file:
        with suppress(FileError):  # if it cannot be written, it is evaluated again next time
            response.for_scene(centre_probe(scene)).save(path)
    return response


def _build_response(scene: Scene, scene_file: str, choice: ResponseChoice, path: Path) -> Response:
    """Build the response of a scene, and write it to `path`.

    Standard error gets the settings, the reasons why existing files cannot be used, the progress,
    and the notes of the response.

    Parameters
    ----------
    scene : Scene
        The sensor of which the response is needed.
    scene_file : str
        Path of its scene file.
    choice : ResponseChoice
        Options that describe the response.
    path : Path
        The response file to write.

    Returns
    -------
    Response
        The response with the probe, readout and stage of the scene. The response in the file has
        its probe in the centre of the film.

    Raises
    ------
    NotConvergedError
        If solves fail. The message asks for a smaller ``--reach`` or ``--force-range``.
    """
    from pvdf_fem.surrogate.response_builder import build_response
    from pvdf_fem.surrogate.touch_domain import centre_probe

    domain, tolerance = choice.resolve_settings(scene)
    print(f"building the response of {scene_file}, to be stored as {path}", file=sys.stderr)
    print(f"  for {domain}, with errors up to {tolerance:g} of a charge", file=sys.stderr)
    if not choice.file:
        for other, reason in choice.list_files(scene, scene_file):
            print(f"  {other.name} cannot be used: it {reason}", file=sys.stderr)
    try:
        with show_progress("CPU seconds", choice.progress) as show:
            response = build_response(
                centre_probe(scene),
                domain.reach_mm,
                domain.force_N,
                tolerance,
                file=path,
                progress=_EstimatedProgress(show),
            )
    except NotConvergedError as error:
        least, largest = domain.force_N
        now = f"now {domain.reach_mm:g} mm, {least:g} to {largest:g} N"
        raise NotConvergedError(
            f"{error}; or give a smaller --reach or --force-range ({now})"
        ) from error
    for note in response.notes:
        print(note, file=sys.stderr)
    return response.for_scene(scene)


class _EstimatedProgress:
    """A `Progress` that also prints the expected CPU time of a build, at its first call.

    Parameters
    ----------
    show : callable
        The `Progress` to which all calls are passed on.
    """

    def __init__(self, show: Progress) -> None:
        self.show = show
        self.has_estimate = False

    def __call__(self, done: float, total: float) -> None:
        """Print the expected CPU time if this is the first call, and show the progress.

        Parameters
        ----------
        done, total : float
            CPU time of the finished work, and expected CPU time of the whole build, in s.
        """
        if not self.has_estimate:
            duration = format_remaining_time(total)
            print(f"  this takes {duration} of CPU time, by the first solves", file=sys.stderr)
            self.has_estimate = True
        self.show(done, total)


def _make_default_path(scene_file: str, key: str) -> Path:
    """Return the default path of a response file: beside the scene file, with its name.

    The beginning of `key`, a hash of all that determines the response, makes the path unique.
    """
    return Path(scene_file).with_name(f"{Path(scene_file).stem}-{key[:16]}.response")


def _parse_force_range(text: str | None, errors: list[str]) -> tuple[float, float] | None:
    """Parse the minimum and maximum force in N of ``--force-range``.

    Returns None if the option is not used, or if its value is invalid. A message about an invalid
    value is added to `errors`.
    """
    if text is None:
        return None
    numbers = [read_number(part) for part in text.split(",")]
    if len(numbers) == 2:
        least, largest = numbers
        if least is not None and largest is not None and 0.0 < least < largest:
            return least, largest
    value = text[:MAX_QUOTED]
    errors.append(f"--force-range {value}: must be two increasing forces in N, such as 0.1,5")
    return None
