"""The command ``pvdf-fem design``: how well electrode layouts and films determine touches."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.options import (
    add_noise_options,
    add_scene_command,
    add_text_option,
    parse_noise_options,
    parse_optional_number,
    read_scene,
)
from pvdf_fem.cli.output import add_plot, find_output_errors, find_plot_errors, save_plot
from pvdf_fem.cli.program import ExitCode, InputError, convert_value_errors
from pvdf_fem.cli.response_choice import (
    ResponseChoice,
    add_response_options,
    load_or_build_response,
)
from pvdf_fem.files import replace_file
from pvdf_fem.scene.scene_file import SceneError, parse_change

if TYPE_CHECKING:
    import xarray

    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.surrogate.response import Response

_DESCRIPTION = """\
How well each of several designs determines touches within the reach: the smallest
standard deviation of position and force that noisy readings allow (the Cramér-Rao
bound), and the fraction of ambiguous positions, whose readings another touch explains
equally well. Position and force are unknown, the probe's rotation is known.

Each design is computed from a response, in a second or a few. A key that changes the
film or the probe needs a response of its own, which is built and stored as for
`locate`; the number of responses is printed first."""

_EPILOG = """\
examples:
  pvdf-fem design ring.toml --vary electrodes.count=4,6,8 \\
      --vary electrodes.ring_radius_mm=6,9,12 --plot design.png
  pvdf-fem design ring.toml --vary 'film.thickness_um={start=9, stop=40, count=4}'
  pvdf-fem design triangle.toml --vary load.force_N=0.1,1 --noise-pC 1 --output design.nc

The values of --vary are those of an axis of a sweep: values, in brackets or not, or a
table of start, stop, count and spacing.

exit codes: 0 done, 2 bad input, 3 a film without a response"""

#: Headings of the printed columns, by their names in the result of `make_table`.
_HEADINGS = {
    "place_deviation_median_mm": "place (mm)",
    "place_deviation_worst_mm": "worst",
    "force_deviation_median": "force",
    "force_deviation_worst": "worst",
    "ambiguous_share": "ambiguous",
}
#: Keys of the JSON object, with the attributes of the dataset that contain their values.
_JSON_KEYS = {
    "noise": "sigma",
    "noise_pC": "noise_pC",
    "reach_mm": "reach_mm",
    "step_mm": "step_mm",
}


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem design`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "design",
        run,
        summary="how well designs determine touches",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--vary",
        metavar="KEY=VALUES",
        action="append",
        default=[],
        help="a key with its values, such as electrodes.count=4,6,8. May be repeated",
    )
    add_noise_options(parser, "--noise-pC", unit="in pC")
    add_text_option(
        parser,
        "--step",
        "MM",
        about="distance between neighbouring positions (default: a twelfth of the reach)",
    )
    parser.add_argument(
        "--output", metavar="FILE", type=Path, help="file to write: .nc, or .csv without the maps"
    )
    add_response_options(parser, tolerance="1e-2")
    add_plot(parser, "the deviations, and the map of the best design")


def run(options: argparse.Namespace) -> int:
    """Print how well each design determines touches, and write the files of the options.

    The responses that the designs need are loaded from their files, or built first.

    Returns
    -------
    int
        The exit code.

    Raises
    ------
    InputError
        If an option or the scene is invalid. The exception lists the errors that were found.
    """
    errors: list[str] = []
    vary = _parse_variations(options.vary, errors)
    sigma, noise_pC = parse_noise_options(options, errors, "--noise-pC")
    step_mm = parse_optional_number("--step", options.step, errors, allow_zero=True)
    choice = ResponseChoice.from_options(options, errors)
    errors += find_output_errors(options.output, [".nc", ".csv"], options.scene)
    errors += find_plot_errors(options, options.scene, options.output)
    scene = read_scene(options, *errors)
    from pvdf_fem.studies.design import design
    from pvdf_fem.studies.design_study import DesignStudy

    reach_mm = choice.reach_mm
    if reach_mm is None and scene.model is not None:
        reach_mm = scene.model.reach_mm
    with convert_value_errors():
        study = DesignStudy.from_scene(scene, vary)
        domain, _ = choice.resolve_settings(scene)
        films = [group.scene for group in study.groups]
        _check_film_responses(films, choice, options)

        def provide_response(film: Scene) -> Response:
            # design() checks its arguments before it asks for the first response
            if film == films[0]:
                print(study, file=sys.stderr)
            return load_or_build_response(film, options.scene, choice, as_stored=True)

        data = design(
            scene,
            vary,
            sigma=sigma,
            noise_pC=noise_pC,
            step_mm=step_mm,
            reach_mm=reach_mm,
            force_range_N=domain.force_N,
            response=provide_response,
            progress=options.progress,
        )
    _write_designs(data, options)
    return ExitCode.CONVERGED


def _check_film_responses(
    films: list[Scene], choice: ResponseChoice, options: argparse.Namespace
) -> None:
    """Raise an error if the response of a film could not be built or written.

    Parameters
    ----------
    films : list of Scene
        One scene for each response that the designs need.
    choice : ResponseChoice
        Options that describe the responses.
    options : argparse.Namespace
        Options with `scene`, the path, and `model`, the file of ``--model`` or None.

    Raises
    ------
    InputError
        If a response has to be built and ``--reach`` is beyond the rim, or if ``--model`` names
        one file for several films.
    FileError
        If the file of a response cannot be written.
    """
    errors: list[str] = []
    for film in films:
        errors += choice.find_errors(film, options.scene)
    if options.model and len(films) > 1:
        errors.append(f"--model: is the response of one film, not of {len(films)}; remove it")
    if errors:
        raise InputError(*dict.fromkeys(errors))


def _write_designs(data: xarray.Dataset, options: argparse.Namespace) -> None:
    """Print the designs as a table or as JSON, and write the files of ``--plot`` and ``--output``.

    Without these options, nothing is written.
    """
    from pvdf_fem.studies.design import find_best_design, make_table
    from pvdf_fem.view.charts.design import draw_designs
    from pvdf_fem.view.files.netcdf import write_netcdf

    table = make_table(data)
    if options.json:
        settings = {key: data.attrs[name] for key, name in _JSON_KEYS.items() if name in data.attrs}
        print(json.dumps({**settings, "designs": table.to_dict("records")}))
    else:
        columns = table.drop(columns="model_error_bound").rename(columns=_HEADINGS)
        print(columns.to_string(index=False, float_format="{:.3g}".format))
    if options.plot:
        save_plot(draw_designs(data, find_best_design(data)), options)
    if options.output is None:
        return
    if options.output.suffix.lower() == ".nc":
        write_netcdf(data, options.output)
    else:
        with replace_file(options.output) as temporary:
            table.to_csv(temporary, index=False)


def _parse_variations(texts: list[str], errors: list[str]) -> dict[str, Any]:
    """Parse the texts ``KEY=VALUES`` of ``--vary``, and return the values by key.

    Messages about invalid texts and repeated keys are added to `errors`. The values of an invalid
    text are an empty list.
    """
    vary: dict[str, Any] = {}
    for text in texts:
        key, values = _parse_variation(text, errors)
        if key in vary:
            errors.append(f"--vary {key}: is given twice; give all its values at once")
        vary[key] = values
    return vary


def _parse_variation(text: str, errors: list[str]) -> tuple[str, Any]:
    """Parse the key and the values of ``KEY=VALUES``.

    Parameters
    ----------
    text : str
        A key with values: separated by commas, a list in brackets, or a table in braces.
    errors : list of str
        Error messages, to which those about an invalid text are appended.

    Returns
    -------
    key : str
        The dotted key.
    values : list or dict
        A list of values, or the table (such as start, stop and count) that describes a range.
        An empty list if the text is invalid.
    """
    key, _, values = text.partition("=")
    is_list_or_table = values.lstrip()[:1] in ("[", "{")
    parts = [values] if is_list_or_table else values.split(",")
    parsed = []
    try:
        for part in parts:
            _, value = parse_change(f"{key}={part}")
            parsed.append(value)
    except SceneError as error:
        errors += [f"--vary {problem}" for problem in error.problems]
        return key.strip(), []
    if is_list_or_table and isinstance(parsed[0], list | dict):
        return key.strip(), parsed[0]
    return key.strip(), parsed
