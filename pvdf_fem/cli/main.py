"""The command ``pvdf-fem``.

Slow modules are imported where they are used, so that help and most complaints come at once.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from pvdf_fem import __version__
from pvdf_fem.cli import explore, respond, response_choice
from pvdf_fem.cli.inverse import calibrate, locate, track
from pvdf_fem.cli.program import (
    ArgumentParser,
    ExitCode,
    InputError,
    add_command,
    add_plot,
    add_scene_command,
    add_text_options,
    describe_unknown_argument,
    find_output_errors,
    find_plot_errors,
    read_scene,
    run_program,
    save_plot,
)
from pvdf_fem.cli.studies import dataset, design, sweep
from pvdf_fem.scene.scene_file import get_example_text, read_examples, read_key_texts, suggest

if TYPE_CHECKING:
    from pvdf_fem.summary import Result

_DESCRIPTION = """\
A model of a membrane PVDF tactile sensor: charges of its electrodes when a
probe presses on the stretched film, by nonlinear finite elements."""

_EPILOG = """\
example:
  pvdf-fem example triangle > scene.toml
  pvdf-fem solve scene.toml --set load.force_N=2 --plot scene.png

scene files are TOML. Their keys, each with a default, which `pvdf-fem keys`
explains:
{keys}
`[[electrodes]]` stands in place of a layout, each with its name, and `[[probe]]`
for several probes, each with what differs from [load].

`pvdf-fem COMMAND --help` tells more about a command, and for `sweep` about sweep
files.

exit codes: 0 converged, 2 bad input or an output that cannot be written,
3 not converged, 130 interrupted"""

_EXAMPLE = """\
Print a scene file, sweep file or report script that comes with the package, or
without a name the list of them."""

_EXAMPLE_EPILOG = """\
example:
  pvdf-fem example triangle > triangle.toml

exit codes: 0 printed, 2 no example of this name"""

_KEYS = """\
Print a scene file with every key: its meaning, its range, and its default or an
example. With words, print the keys whose names or meanings have words that begin so."""

_KEYS_EPILOG = """\
examples:
  pvdf-fem keys > scene.toml
  pvdf-fem keys force tension

exit codes: 0 printed, 2 no key has a word"""

_SOLVE = """\
Charges of the electrodes in pC, each with its estimated discretisation error,
and the largest deflection in mm; with `uncertain` in the scene also the
standard deviations that uncertain values of film, force and place make.
Meshes are refined until every charge is within numerics.tolerance of the scene."""

_SOLVE_EPILOG = """\
examples:
  pvdf-fem solve scene.toml
  pvdf-fem solve scene.toml --set probe.x_mm=5 --set load.kind=follower --json
  pvdf-fem solve scene.toml --vtu scene.vtu --plot scene.png
  pvdf-fem solve scene.toml --plot stress.svg --quantity stress
  pvdf-fem solve scene.toml --mesh scene.msh

exit codes: 0 converged, 2 bad input, 3 not converged (there are no charges
then, and nothing is written to the files)"""

_MESH = """\
Write the mesh that `solve` starts with: six-node triangles in metres, with
the patches `electrode NAME` and `probe`.
The extension chooses the format:
  .msh                physical groups; where patches overlap, their combination
                      is a group of its own, such as `electrode A + probe`
  .inp                element sets, and the node set `rim`
  .vtu .vtk .xdmf     a 0/1 array for each patch"""

_MESH_EPILOG = """\
example:
  pvdf-fem mesh scene.toml scene.msh --set numerics.tolerance=1e-4

exit codes: 0 written, 2 bad input, 3 gmsh failed"""

_MODES = """\
Lowest frequencies of the stretched film in Hz, each with its estimated
discretisation error; pairs of equal frequency are listed twice."""

_MODES_EPILOG = """\
examples:
  pvdf-fem modes scene.toml --plot modes.png
  pvdf-fem modes scene.toml --count 12 --loaded --set load.force_N=0.5 --json

exit codes: 0 converged, 2 bad input, 3 no frequencies (a film without tension,
or no equilibrium under the load)"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    return run_program("pvdf-fem", lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    parser = make_parser()
    options, further = parser.parse_known_args(arguments)
    if further:
        raise InputError(
            describe_unknown_argument(further, options.parser if "run" in options else parser)
        )
    if "run" not in options:
        parser.print_help()
        return ExitCode.BAD_INPUT
    command: Callable[[argparse.Namespace], int] = options.run
    return command(options)


def _key_names() -> str:
    """The names of all keys of a scene file, by table."""
    names: dict[str, dict[str, None]] = {}
    for table, name, _ in read_key_texts():
        names.setdefault(table, {})[name] = None
    lines = (f"{table:<18}{', '.join(keys)}" for table, keys in names.items())
    wrapper = textwrap.TextWrapper(79, initial_indent=2 * " ", subsequent_indent=20 * " ")
    return "\n".join(map(wrapper.fill, lines))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser, _ = _make_parsers()
    return parser


def make_command_parsers() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command, by the command's name."""
    _, parsers = _make_parsers()
    return parsers


def _make_parsers() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """Return the parser of the whole command line, and those of its commands by name."""
    parser = ArgumentParser(
        "pvdf-fem",
        description=_DESCRIPTION,
        epilog=_EPILOG.format(keys=_key_names()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"pvdf-fem {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")

    summary = "files to begin with"
    example = add_command(commands, "example", _example, summary, _EXAMPLE, _EXAMPLE_EPILOG)
    example.add_argument("name", metavar="NAME", nargs="?", help="without it the names are listed")
    about = "what the keys of a scene file mean"
    keys = add_command(commands, "keys", _keys, about, _KEYS, _KEYS_EPILOG)
    keys.add_argument("words", metavar="WORD", nargs="*", help="what names or meanings have")
    solve = add_scene_command(
        commands, "solve", _solve, "charges of a scene", _SOLVE, _SOLVE_EPILOG
    )
    for name, about in (
        ("--mesh", "solve on this mesh: of `pvdf-fem mesh`, or your own in mm or m (.msh ...)"),
        ("--vtu", "write deflection, stresses, patches for ParaView"),
    ):
        solve.add_argument(name, metavar="FILE", type=Path, help=about)
    shown = "stress, charge density, principal directions, mesh, error or contact"
    add_plot(solve, "a map of the film")
    add_text_options(
        solve, ("--quantity", "NAME", None, f"what --plot shows, if not deflection: {shown}")
    )
    summary = "write the mesh of a scene"
    mesh = add_scene_command(commands, "mesh", _mesh, summary, _MESH, _MESH_EPILOG, as_json="")
    mesh.add_argument("file", metavar="FILE", type=Path, help="mesh file to write")
    summary = "frequencies of the stretched film"
    modes = add_scene_command(commands, "modes", _modes, summary, _MODES, _MODES_EPILOG)
    modes.add_argument(
        "--loaded", action="store_true", help="about the film under its load, not the flat film"
    )
    add_text_options(modes, ("--count", "N", "6", "how many frequencies"))
    add_plot(modes, "the shapes of the modes")
    touching = response_choice, locate, track, calibrate, design, dataset
    for command in (respond, sweep, *touching, explore):
        command.add_to(commands)
    return parser, dict(commands.choices)


def _example(options: argparse.Namespace) -> int:
    files = read_examples()
    if options.name is not None:
        print(get_example_text(options.name, files), end="")
        return ExitCode.CONVERGED
    for name, text in files.items():
        print(f"{name:<{max(map(len, files))}}  {text.splitlines()[0].lstrip('# ')}")
    return ExitCode.CONVERGED


def _keys(options: argparse.Namespace) -> int:
    if not options.words:
        print(read_examples()["four_electrodes"], end="")
        return ExitCode.CONVERGED
    keys, words = list(read_key_texts()), [word.casefold() for word in options.words]
    texts = [f"{key.table} {key.text}".casefold() for key in keys]
    # words, and parts of names between underscores, that begin so
    begins = re.compile("|".join(rf"(?<![^\W_]){re.escape(word)}" for word in words))
    found = [key for key, text in zip(keys, texts, strict=True) if begins.search(text)]
    if not found:
        near = suggest(words[0], list(dict.fromkeys(key.name for key in keys)))
        raise InputError(f"{options.words[0][:60]}: is in no key and its meaning; {near}")
    for table, group in groupby(found, lambda key: key.table):
        print("\n".join([table, *(key.text for key in group)]), end="\n\n")
    return ExitCode.CONVERGED


def _solve(options: argparse.Namespace) -> int:
    mistakes = find_output_errors(options.vtu, [".vtu"], options.scene, options.mesh)
    mistakes += find_plot_errors(options, options.scene, options.mesh, options.vtu)
    quantity = "deflection" if options.quantity is None else options.quantity
    if options.quantity is not None and not options.plot:
        mistakes.append("--quantity: is what --plot shows; give --plot FILE, or leave it out")
    scene = read_scene(options, *mistakes)
    if options.plot:
        from pvdf_fem.view.film_map import resolve_map

        try:
            resolve_map(quantity, scene)
        except ValueError as error:
            raise InputError(f"--quantity: {error}") from error
    from pvdf_fem.solver.nonlinear.status import Status
    from pvdf_fem.solver.solve import solve

    solution = solve(scene, mesh=options.mesh)
    converged = solution.status is Status.CONVERGED
    try:
        if converged and options.vtu:
            solution.to_vtu(options.vtu)
        if converged and options.plot:
            save_plot(solution.plot(quantity), options)
    finally:  # a full disk does not take the charges with it
        _print(solution, options.json)
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED


def _mesh(options: argparse.Namespace) -> int:
    from pvdf_fem.view.export import FORMATS, write_mesh

    scene = read_scene(options, *find_output_errors(options.file, list(FORMATS), options.scene))
    from pvdf_fem.film.loads.contact_estimate import estimate_tip_outlines
    from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.solver.first_sizes import ORDER, choose_first_sizes

    try:
        problem = Problem.from_scene(scene)
        sizes = choose_first_sizes(problem, ORDER)
        contacts = estimate_tip_outlines(scene)
        mesh = mesh_scene(
            scene, sizes, least_jacobian=problem.film.least_jacobian, contacts=contacts
        )
        write_mesh(mesh, options.file)
    except MeshError as error:
        print(f"not meshed: {error}; move or resize the probe slightly", file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    patches = ", ".join(name for name in mesh.subdomains if name != "film")
    nodes = mesh.doflocs.shape[1]
    print(f"{options.file}: {mesh.nelements} triangles, {nodes} nodes, patches {patches}")
    return ExitCode.CONVERGED


def _modes(options: argparse.Namespace) -> int:
    from pvdf_fem.dynamics.modes import MAX_MODES, modes
    from pvdf_fem.solver.nonlinear.status import Status

    count, mistakes = options.count, []
    if not re.fullmatch("[0-9]{1,9}", count) or not 1 <= int(count) <= MAX_MODES:
        mistakes = [f"--count {count[:60]}: is out of range; give 1 to {MAX_MODES}"]
    mistakes += find_plot_errors(options, options.scene)
    result = modes(read_scene(options, *mistakes), int(count), options.loaded)
    converged = result.status is Status.CONVERGED
    try:
        if options.plot and converged:
            save_plot(result.plot(), options)
    finally:
        _print(result, options.json)
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED


def _print(result: Result, as_json: bool) -> None:
    """Print a result as JSON, or as text; the reason why there is none goes to standard error."""
    told = result.to_json()
    if as_json:
        print(json.dumps(told, allow_nan=False))
    elif "reason" in told:
        print(f"not converged: {told['status']}: {told['reason']}", file=sys.stderr)
        for text in told.get("warnings", ()):
            print(f"warning: {text}", file=sys.stderr)
    else:
        print(result)
