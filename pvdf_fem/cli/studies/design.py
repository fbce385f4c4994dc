"""The command ``pvdf-fem design``: which electrodes, and which film, tell touches best."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli import program, response_choice
from pvdf_fem.cli.program import (
    ExitCode,
    InputError,
    add_scene_command,
    add_text_options,
    read_scene,
)
from pvdf_fem.cli.response_choice import ResponseChoice, load_or_build_response, parse_number
from pvdf_fem.files import replace_file
from pvdf_fem.scene.scene_file import SceneError, parse_change

if TYPE_CHECKING:
    import xarray

_DESCRIPTION = """\
How well each of some designs tells touches all over the reach: the least standard
deviation of place and force that readings with noise allow (the Cramér-Rao
bound), and the share of ambiguous places, whose readings another touch explains
as well. Place and force are sought, the probe's rotation is known.

Each design is made from a model of the charges, in a second or a few. A key that
changes the film or the probe takes a model of its own, which is built and kept as
for `locate`; how many there are is said first."""

_EPILOG = """\
examples:
  pvdf-fem design ring.toml --vary electrodes.count=4,6,8 \\
      --vary electrodes.ring_radius_mm=6,9,12 --plot design.png
  pvdf-fem design ring.toml --vary 'film.thickness_um={start=9, stop=40, count=4}'
  pvdf-fem design triangle.toml --vary load.force_N=0.1,1 --noise-pC 1 --output design.nc

--vary takes what an axis of a sweep takes: values, in brackets or not, or a table
of start, stop, count and spacing.

exit codes: 0 made, 2 bad input, 3 a film without a model"""

#: Heads of the printed columns.
_HEADS = {
    "place_deviation_median_mm": "place (mm)",
    "place_deviation_worst_mm": "worst",
    "force_deviation_median": "force",
    "force_deviation_worst": "worst",
    "ambiguous_share": "ambiguous",
}
#: Keys of the JSON object, and the attributes of the dataset that they are.
_ASKED = {"noise": "sigma", "noise_pC": "noise_pC", "reach_mm": "reach_mm", "step_mm": "step_mm"}


def add_to(commands: Any) -> None:
    """Add the command to the commands of an argument parser."""
    about = "how well designs tell touches", _DESCRIPTION, _EPILOG
    parser = add_scene_command(commands, "design", run, *about)
    parser.add_argument(
        "--vary",
        metavar="KEY=VALUES",
        action="append",
        default=[],
        help="a key with its values, such as electrodes.count=4,6,8; may be given several times",
    )
    add_text_options(
        parser,
        ("--noise", "SHARE", "0.01", "standard deviation of a reading over the charge"),
        ("--noise-pC", "PC", None, "another one besides (default: readout.noise_V, or 0)"),
        ("--step", "MM", None, "step of the lattice of places (default: a twelfth of the reach)"),
    )
    output = "file to write: .nc, or .csv without the maps"
    parser.add_argument("--output", metavar="FILE", type=Path, help=output)
    response_choice.add_options(parser, tolerance="1e-2")
    program.add_plot(parser, "the deviations, and the map of the best design")


def run(options: argparse.Namespace) -> int:
    """Run the command; returns its exit code."""
    wrong: list[str] = []
    varied = [_varied(text, wrong) for text in options.vary]
    vary = dict(varied)
    if len(vary) < len(varied):
        wrong.append("--vary: has a key twice; give all its values at once")
    asked: dict[str, Any] = {"sigma": parse_number("--noise", options.noise, wrong, zero=True)}
    for name, text in (("noise_pC", options.noise_pC), ("step_mm", options.step)):
        option = f"--{name.replace('_', '-').removesuffix('-mm')}"
        asked[name] = None if text is None else parse_number(option, text, wrong, zero=True)
    choice = ResponseChoice.of(options, wrong)
    wrong += program.find_output_errors(options.output, [".nc", ".csv"], options.scene)
    wrong += program.find_plot_errors(options, options.scene, options.output)
    scene = read_scene(options, *wrong)
    from pvdf_fem.studies.design import DesignStudy, design

    with program.convert_value_errors():
        designs = DesignStudy.from_scene(scene, vary)
        asked["reach_mm"] = choice.reach_mm or (scene.model and scene.model.reach_mm)
        asked["force_range_N"] = choice.wanted(scene)[0].force_N
        films = [first for first, _ in designs.models]
        wrong = [text for film in films for text in choice.mistakes(film, options.scene)]
        if options.model and len(films) > 1:
            wrong.append(f"--model: is of one film, and there are {len(films)}; leave it out")
        if wrong:
            raise InputError(*dict.fromkeys(wrong))

        def models(film: Any) -> Any:
            if film == films[0]:  # whatever is wrong has been told
                print(designs, file=sys.stderr)
            return load_or_build_response(film, options.scene, choice, as_kept=True)

        asked["response"] = models
        data = design(scene, vary, progress=options.progress, **asked)
    _write(data, options)
    return ExitCode.CONVERGED


def _write(data: xarray.Dataset, options: argparse.Namespace) -> None:
    """Print the designs, and write the files that are asked for."""
    from pvdf_fem.studies.design import find_best_design, make_table
    from pvdf_fem.studies.sweep_dataset import write_netcdf
    from pvdf_fem.view.charts import draw_designs

    rows = make_table(data)
    if options.json:
        asked = {key: data.attrs[name] for key, name in _ASKED.items() if name in data.attrs}
        print(json.dumps({**asked, "designs": rows.to_dict("records")}))
    else:
        shown = rows.drop(columns="model_error_bound").rename(columns=_HEADS)
        print(shown.to_string(index=False, float_format="{:.3g}".format))
    if options.plot:
        program.save_plot(draw_designs(data, find_best_design(data)), options)
    if options.output and options.output.suffix.lower() == ".nc":
        write_netcdf(data, options.output)
    elif options.output:
        with replace_file(options.output) as unfinished:
            rows.to_csv(unfinished, index=False)


def _varied(text: str, mistakes: list[str]) -> tuple[str, Any]:
    """Key and values of ``KEY=VALUES``; what is wrong with it is added to `mistakes`."""
    key, _, values = text.partition("=")
    parts = [values] if values.lstrip()[:1] in ("[", "{") else values.split(",")
    try:
        read = [parse_change(f"{key}={part}")[1] for part in parts]
    except SceneError as error:
        mistakes += [f"--vary {told}" for told in error.problems]
        return key, []
    return key.strip(), read[0] if len(parts) == 1 and isinstance(read[0], list | dict) else read
