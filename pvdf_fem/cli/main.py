"""The command ``pvdf-fem``.

Slow modules are imported where they are used, so that help and most complaints come at once.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem import __version__
from pvdf_fem.cli import calibrate as cli_calibrate
from pvdf_fem.cli import locate as cli_locate
from pvdf_fem.cli import sweep as cli_sweep
from pvdf_fem.cli import track as cli_track
from pvdf_fem.cli.program import (
    ArgumentParser,
    ExitCode,
    InputError,
    add_command,
    output_mistakes,
    run_program,
)

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.solution.solution import Solution

_DESCRIPTION = """\
A model of a membrane PVDF tactile sensor: charges of its electrodes when a
probe presses on the stretched film, by nonlinear finite elements."""

_EPILOG = """\
example:
  printf '[probe]\\nshape = "rectangle"\\nx_mm = 5.0\\n' > scene.toml
  pvdf-fem solve scene.toml --set load.force_N=2 --plot scene.png

scene files are TOML. Their keys, each with a default:
  [film]        radius_mm, thickness_um, youngs_modulus_GPa (or [E1, E2]),
                poisson_ratio, shear_modulus_GPa, density_kg_m3,
                thermal_expansion_per_K, temperature_change_K (below zero
                stretches the film) or pretension_N_m (a number, or [Nx, Ny]),
                d31_pC_N, d32_pC_N, permittivity, bending (true, false, "auto":
                where it matters), compression (refuse, tension-field: the film
                wrinkles)
  [electrodes]  layout (four, three, ring), ring_radius_mm, side_mm; for a ring:
                count, first_angle_deg, centre, shape and its sizes
  [probe]       shape and its sizes, x_mm, y_mm (centroid), rotation_deg
  [load]        force_N, kind (dead, follower, rigid), and for rigid: contact
                (sliding, stuck)
  [numerics]    tolerance (of every charge), observable (material, thesis-edge),
                max_unknowns (of a mesh; default 60000, more for tolerances
                below 1e-3), max_seconds (work of one core, counted by unknowns
                and iterations; default 20, more for tolerances below 1e-3)
  [readout]     kind (charge, voltage), feedback_capacitance_pF,
                feedback_resistance_MOhm, input_resistance_MOhm,
                cable_capacitance_pF, gain, offset_V, noise_V: each for all
                electrodes, or a table by electrode; reading (change, total)
  [stage]       x_mm, y_mm (the film's centre on the stage that positions the
                probe), rotation_deg (of the film's axes there)
Any electrodes instead of a layout, each below a heading [[electrodes]]:
  name, x_mm, y_mm, shape and its sizes, rotation_deg
Shapes: triangle (side_mm; probes only), square (side_mm; electrodes only),
rectangle (width_mm, height_mm), circle (radius_mm), ellipse (semi_axes_mm, a
pair), polygon (vertices_mm).

`pvdf-fem COMMAND --help` tells more about a command, that of `sweep` about sweep
files.

exit codes: 0 converged, 2 bad input or an output that cannot be written,
3 not converged, 130 interrupted"""

_SOLVE = """\
Charges of the electrodes in pC, each with its estimated discretisation error,
and the largest deflection in mm. Meshes are refined until every charge is
within numerics.tolerance of the scene."""

_SOLVE_EPILOG = """\
examples:
  pvdf-fem solve scene.toml
  pvdf-fem solve scene.toml --set probe.x_mm=5 --set load.kind=follower --json
  pvdf-fem solve scene.toml --vtu scene.vtu --plot scene.png

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
  pvdf-fem modes scene.toml
  pvdf-fem modes scene.toml --count 12 --loaded --set load.force_N=0.5 --json

exit codes: 0 converged, 2 bad input, 3 no frequencies (a film without tension,
or no equilibrium under the load)"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    return run_program("pvdf-fem", lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.run
    return command(options)


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(
        "pvdf-fem",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"pvdf-fem {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    _add_solve(commands)
    mesh = _command(commands, "mesh", _mesh, "write the mesh of a scene", _MESH, _MESH_EPILOG)
    mesh.add_argument("file", metavar="FILE", type=Path, help="mesh file to write")
    _add_modes(commands)
    cli_sweep.add_to(commands)
    summary = "the touch that gave some charges"
    about = cli_locate.DESCRIPTION, cli_locate.EPILOG
    locate = _command(commands, "locate", _locate, summary, *about)
    cli_locate.add_options(locate)
    _add_json(locate)
    summary = "touches in a stream of readings"
    about = cli_track.DESCRIPTION, cli_track.EPILOG
    cli_track.add_options(_command(commands, "track", _track, summary, *about))
    summary = "the sensor from known touches"
    about = cli_calibrate.DESCRIPTION, cli_calibrate.EPILOG
    calibrate = _command(commands, "calibrate", _calibrate, summary, *about)
    cli_calibrate.add_options(calibrate)
    _add_json(calibrate)
    return parser


def _add_solve(commands: Any) -> None:
    solve = _command(commands, "solve", _solve, "charges of a scene", _SOLVE, _SOLVE_EPILOG)
    _add_json(solve)
    solve.add_argument(
        "--vtu", metavar="FILE", type=Path, help="write deflection, stresses, patches for ParaView"
    )
    solve.add_argument(
        "--plot", metavar="FILE", type=Path, help="draw the deflection (.png, .svg, .pdf, ...)"
    )


def _add_modes(commands: Any) -> None:
    summary = "frequencies of the stretched film"
    modes = _command(commands, "modes", _modes, summary, _MODES, _MODES_EPILOG)
    modes.add_argument(
        "--count", metavar="N", default="6", help="how many frequencies (default: 6)"
    )
    modes.add_argument(
        "--loaded", action="store_true", help="about the film under its load, not the flat film"
    )
    _add_json(modes)


def _command(commands: Any, *about: Any) -> argparse.ArgumentParser:
    """A command about a scene; `about` are the arguments of `add_command`."""
    parser = add_command(commands, *about)
    parser.add_argument("scene", metavar="SCENE.toml", help="scene file")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="changes",
        help="change a value of the scene, such as load.force_N=2 or electrodes[0].x_mm=9; VALUE "
        "is TOML, and a bare word is text; may be given several times, the last counts",
    )
    return parser


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )


def _scene(options: argparse.Namespace, *mistakes: str) -> Scene:
    """The scene with its changes; raises `InputError` with the given mistakes and its own."""
    from pvdf_fem.scene.change import spelled
    from pvdf_fem.scene.scene import Scene, SceneError

    problems, changes = list(mistakes), {}
    for text in options.changes:
        try:
            key, value = _change(text)
            changes[spelled(key)] = value
        except InputError as error:
            problems += error.args
    try:
        scene: Scene = Scene.load(options.scene)
        scene = scene.with_(**changes) if changes else scene
    except SceneError as error:
        problems += error.problems
    if problems:
        raise InputError(*problems)
    return scene


def _change(text: str) -> tuple[str, Any]:
    from pvdf_fem.scene.scene_file import SceneError, parse_toml

    shown = text if len(text) <= 80 else f"{text[:77]}..."
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        raise InputError(f"--set {shown}: is no change; write KEY=VALUE, such as load.force_N=2")
    try:
        table = parse_toml(f"value = {value}", "--set")
    except SceneError:
        table = {}
    if list(table) == ["value"]:
        return key, table["value"]
    if re.fullmatch(r"[^\W\d][\w -]*", value):
        return key, value
    raise InputError(
        f"--set {shown}: the value is not TOML; write a number, a word, [...] or '\"...\"'"
    )


def _solve(options: argparse.Namespace) -> int:
    mistakes = output_mistakes(options.vtu, [".vtu"], options.scene)
    if options.plot:
        others = options.scene, options.vtu
        mistakes += output_mistakes(options.plot, _plot_extensions(), *others)
    scene = _scene(options, *mistakes)
    from pvdf_fem.solution.solve import solve
    from pvdf_fem.solvers.status import Status

    solution = solve(scene)
    converged = solution.status is Status.CONVERGED
    try:
        if converged:
            _write_files(solution, options.vtu, options.plot)
    finally:  # a full disk does not take the charges with it
        _print(solution.to_json(), options.json, lambda: str(solution))
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED


def _mesh(options: argparse.Namespace) -> int:
    from pvdf_fem.output.export import FORMATS, write_mesh

    scene = _scene(options, *output_mistakes(options.file, list(FORMATS), options.scene))
    from pvdf_fem.film.models import film_model
    from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
    from pvdf_fem.solution.first_sizes import ORDER, first_sizes

    try:
        sizes, jacobian = first_sizes(scene, ORDER), film_model(scene).least_jacobian
        mesh = mesh_scene(scene, sizes, least_jacobian=jacobian)
        write_mesh(mesh, options.file)
    except MeshError as error:
        print(f"not meshed: {error}; move or resize the probe slightly", file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    patches = ", ".join(name for name in mesh.subdomains if name != "film")
    nodes = mesh.doflocs.shape[1]
    print(f"{options.file}: {mesh.nelements} triangles, {nodes} nodes, patches {patches}")
    return ExitCode.CONVERGED


def _modes(options: argparse.Namespace) -> int:
    from pvdf_fem.output.text import modes_text
    from pvdf_fem.solution.modes import MOST_MODES, modes
    from pvdf_fem.solvers.status import Status

    count, mistakes = options.count, []
    if not re.fullmatch("[0-9]{1,9}", count) or not 1 <= int(count) <= MOST_MODES:
        mistakes = [f"--count {count[:60]}: is out of range; give 1 to {MOST_MODES}"]
    result = modes(_scene(options, *mistakes), int(count), options.loaded)
    _print(result.to_json(), options.json, lambda: modes_text(result))
    converged = result.status is Status.CONVERGED
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED


def _locate(options: argparse.Namespace) -> int:
    request, files = cli_locate.Request.of(options), [options.scene, *options.others]
    mistakes, scenes = list(request.mistakes), {}
    for file in dict.fromkeys(files):
        try:
            scenes[file] = _scene(argparse.Namespace(scene=file, changes=options.changes))
        except InputError as error:
            mistakes += error.args
    mistakes += [f"{f}: has no [probe]; add one" for f, s in scenes.items() if s.probe is None]
    if mistakes:
        raise InputError(*mistakes)
    from pvdf_fem.cli.locate_rows import locate_rows
    from pvdf_fem.solution.solution import NotConvergedError
    from pvdf_fem.touch.polish import PolishError

    try:
        if options.csv is not None:
            return locate_rows(scenes[options.scene], request, options)
        choices = cli_locate.located(scenes, request, options.polish)
    except ValueError as error:
        raise InputError(*str(error).splitlines()) from error
    except (PolishError, NotConvergedError) as error:
        print(error, file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    cli_locate.print_matches(choices, options.json)
    located = choices[0].location.touches
    return ExitCode.CONVERGED if located else ExitCode.NOT_CONVERGED


def _track(options: argparse.Namespace) -> int:
    cli_track.track(_scene(options), options)
    return ExitCode.CONVERGED


def _calibrate(options: argparse.Namespace) -> int:
    return cli_calibrate.run(options, _scene(options, *cli_calibrate.mistakes_of(options)))


def _plot_extensions() -> list[str]:
    from matplotlib.backend_bases import FigureCanvasBase

    return [f".{extension}" for extension in FigureCanvasBase.get_supported_filetypes()]


def _write_files(solution: Solution, vtu: Path | None, plot: Path | None) -> None:
    if vtu:
        solution.to_vtu(vtu)
    if plot:
        from pvdf_fem.output import figures

        with figures.style():
            figure = figures.new_figure(120.0, 100.0)
            figures.deflection_map(figure.subplots(), solution)
            figures.save(figure, plot)


def _print(result: dict[str, Any], as_json: bool, text: Callable[[], str]) -> None:
    """Print a result as JSON, or as text; the reason why there is none goes to standard error."""
    if as_json:
        print(json.dumps(result, allow_nan=False))
    elif "reason" in result:
        print(f"not converged: {result['status']}: {result['reason']}", file=sys.stderr)
    else:
        print(text())
