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
from typing import Any

from pvdf_fem import __version__
from pvdf_fem.cli import calibrate, explore, locate, respond, response_model, sweep, track
from pvdf_fem.cli.program import (
    ArgumentParser,
    ExitCode,
    InputError,
    add_command,
    add_plot,
    add_scene_command,
    add_texts,
    output_mistakes,
    plot_mistakes,
    run_program,
    save_plot,
    scene_of,
)
from pvdf_fem.cli.studies import design
from pvdf_fem.scene.scene_file import example_text, examples

_DESCRIPTION = """\
A model of a membrane PVDF tactile sensor: charges of its electrodes when a
probe presses on the stretched film, by nonlinear finite elements."""

_EPILOG = """\
example:
  pvdf-fem example triangle > scene.toml
  pvdf-fem solve scene.toml --set load.force_N=2 --plot scene.png

scene files are TOML. Their keys, each with a default:
  [film]        radius_mm, thickness_um, youngs_modulus_GPa (or [E1, E2]),
                poisson_ratio, shear_modulus_GPa, density_kg_m3,
                thermal_expansion_per_K, temperature_change_K (below zero
                stretches the film) or pretension_N_m (a number, or [Nx, Ny]),
                d31_pC_N, d32_pC_N, d33_pC_N, permittivity, loss_tangent,
                bending and coupling (true, false, "auto": where it matters),
                compression (refuse, tension-field: the film wrinkles),
                warming_K (since it was zeroed), pyroelectric_uC_m2K,
                thermal_diffusivity_m2_s,
                rim_displacement_um ([mean, cos, sin, cos 2, sin 2, ...]),
                law (hooke, neo-hookean), pressure_Pa on the whole film (along
                z; with pressure_follows normal to it), gravity_m_s2 (along z)
  [[film.patches]]  layers on the film: shape as of electrodes, thickness_um,
                both_sides, youngs_modulus_GPa, poisson_ratio, density_kg_m3,
                bonded ("at rest", "before stretching"), thermal_expansion_per_K
  [electrodes]  layout (four, three, ring), ring_radius_mm, side_mm; for a ring:
                count, first_angle_deg, centre, shape and its sizes
  [probe]       shape and its sizes, x_mm, y_mm (centroid), rotation_deg,
                edge_radius_mm (for contact), temperature_K, contact_time_s
  [load]        force_N, kind (dead, follower, rigid, contact), tangential_N
                ([Fx, Fy]; dead or stuck); for rigid: contact (sliding, stuck);
                tilt (held, free); for contact: depth_mm, instead of
                force_N; for dead: profile (uniform, hertz, gaussian, or a
                CSV or NetCDF file), profile_width_mm (of gaussian)
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
  [air]         density_kg_m3, baffle (true, false: the rim is in one, or not)
Any electrodes instead of a layout, each below a heading [[electrodes]]:
  name, x_mm, y_mm, shape and its sizes, rotation_deg
Several probes, each below a heading [[probe]]: its keys, and force_N,
  tangential_N and load, a table, for what differs from [load]
Shapes: triangle (side_mm; probes only), sphere (radius_mm; probes of kind
contact), square (side_mm; electrodes only), rectangle (width_mm, height_mm),
circle (radius_mm), ellipse (semi_axes_mm, a pair), polygon (vertices_mm).

`pvdf-fem COMMAND --help` tells more about a command, that of `sweep` about sweep
files.

exit codes: 0 converged, 2 bad input or an output that cannot be written,
3 not converged, 130 interrupted"""

_EXAMPLE = """\
Print a scene file, sweep file or report script that comes with the package, or
without a name the list of them. `four_electrodes` explains every key."""

_EXAMPLE_EPILOG = """\
example:
  pvdf-fem example triangle > triangle.toml

exit codes: 0 printed, 2 no example of this name"""

_SOLVE = """\
Charges of the electrodes in pC, each with its estimated discretisation error,
and the largest deflection in mm. Meshes are refined until every charge is
within numerics.tolerance of the scene."""

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
    parser = _parser()
    options = parser.parse_args(arguments)
    if "run" not in options:
        parser.print_help()
        return ExitCode.BAD_INPUT
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
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")

    summary = "files to begin with"
    example = add_command(commands, "example", _example, summary, _EXAMPLE, _EXAMPLE_EPILOG)
    example.add_argument("name", metavar="NAME", nargs="?", help="without it the names are listed")
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
    add_texts(solve, ("--quantity", "NAME", None, f"what --plot shows, if not deflection: {shown}"))
    summary = "write the mesh of a scene"
    mesh = add_scene_command(commands, "mesh", _mesh, summary, _MESH, _MESH_EPILOG, as_json="")
    mesh.add_argument("file", metavar="FILE", type=Path, help="mesh file to write")
    summary = "frequencies of the stretched film"
    modes = add_scene_command(commands, "modes", _modes, summary, _MODES, _MODES_EPILOG)
    modes.add_argument(
        "--loaded", action="store_true", help="about the film under its load, not the flat film"
    )
    add_texts(modes, ("--count", "N", "6", "how many frequencies"))
    add_plot(modes, "the shapes of the modes")
    for command in (respond, sweep, response_model, locate, track, calibrate, design, explore):
        command.add_to(commands)
    return parser


def _example(options: argparse.Namespace) -> int:
    files = examples()
    if options.name is not None:
        print(example_text(options.name, files), end="")
        return ExitCode.CONVERGED
    for name, text in files.items():
        print(f"{name:<{max(map(len, files))}}  {text.splitlines()[0].lstrip('# ')}")
    return ExitCode.CONVERGED


def _solve(options: argparse.Namespace) -> int:
    mistakes = output_mistakes(options.vtu, [".vtu"], options.scene, options.mesh)
    mistakes += plot_mistakes(options, options.scene, options.mesh, options.vtu)
    quantity = "deflection" if options.quantity is None else options.quantity
    if options.quantity is not None and not options.plot:
        mistakes.append("--quantity: is what --plot shows; give --plot FILE, or leave it out")
    scene = scene_of(options, *mistakes)
    if options.plot:
        from pvdf_fem.output.film_map import require_quantity

        try:
            require_quantity(quantity, scene)
        except ValueError as error:
            raise InputError(f"--quantity: {error}") from error
    from pvdf_fem.solution.solve import solve
    from pvdf_fem.solvers.status import Status

    solution = solve(scene, mesh=options.mesh)
    converged = solution.status is Status.CONVERGED
    try:
        if converged:
            if options.vtu:
                solution.to_vtu(options.vtu)
            if options.plot:
                save_plot(solution.plot(quantity), options)
    finally:  # a full disk does not take the charges with it
        _print(solution.to_json(), options.json, lambda: str(solution))
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED


def _mesh(options: argparse.Namespace) -> int:
    from pvdf_fem.output.export import FORMATS, write_mesh

    scene = scene_of(options, *output_mistakes(options.file, list(FORMATS), options.scene))
    from pvdf_fem.film.loads.contact_guess import tip_outlines
    from pvdf_fem.film.models import film_model
    from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
    from pvdf_fem.solution.first_sizes import ORDER, first_sizes

    try:
        sizes, jacobian = first_sizes(scene, ORDER), film_model(scene).least_jacobian
        contacts = tip_outlines(scene)
        mesh = mesh_scene(scene, sizes, least_jacobian=jacobian, contacts=contacts)
        write_mesh(mesh, options.file)
    except MeshError as error:
        print(f"not meshed: {error}; move or resize the probe slightly", file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    patches = ", ".join(name for name in mesh.subdomains if name != "film")
    nodes = mesh.doflocs.shape[1]
    print(f"{options.file}: {mesh.nelements} triangles, {nodes} nodes, patches {patches}")
    return ExitCode.CONVERGED


def _modes(options: argparse.Namespace) -> int:
    from pvdf_fem.dynamics.modes import MOST_MODES, modes
    from pvdf_fem.output.text import modes_text
    from pvdf_fem.solvers.status import Status

    count, mistakes = options.count, []
    if not re.fullmatch("[0-9]{1,9}", count) or not 1 <= int(count) <= MOST_MODES:
        mistakes = [f"--count {count[:60]}: is out of range; give 1 to {MOST_MODES}"]
    mistakes += plot_mistakes(options, options.scene)
    result = modes(scene_of(options, *mistakes), int(count), options.loaded)
    converged = result.status is Status.CONVERGED
    try:
        if options.plot and converged:
            save_plot(result.plot(), options)
    finally:
        _print(result.to_json(), options.json, lambda: modes_text(result))
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED


def _print(result: dict[str, Any], as_json: bool, text: Callable[[], str]) -> None:
    """Print a result as JSON, or as text; the reason why there is none goes to standard error."""
    if as_json:
        print(json.dumps(result, allow_nan=False))
    elif "reason" in result:
        print(f"not converged: {result['status']}: {result['reason']}", file=sys.stderr)
        for text in result.get("warnings", ()):
            print(f"warning: {text}", file=sys.stderr)
    else:
        print(text())
