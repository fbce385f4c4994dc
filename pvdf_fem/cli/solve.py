"""The command ``pvdf-fem solve``: charges of a scene."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import add_scene_command, read_scene
from pvdf_fem.cli.output import (
    add_plot,
    find_output_errors,
    find_plot_errors,
    print_result,
    save_plot,
)
from pvdf_fem.cli.program import ExitCode, InputError

_DESCRIPTION = """\
Charges of the electrodes in pC, each with its estimated discretisation error,
and the largest deflection in mm. With `uncertain` in the scene there are also the
standard deviations due to uncertain values of film, force and position.
Meshes are refined until the relative error of every charge is at most
numerics.tolerance of the scene."""

_EPILOG = """\
examples:
  pvdf-fem solve scene.toml
  pvdf-fem solve scene.toml --set probe.x_mm=5 --set load.kind=follower --json
  pvdf-fem solve scene.toml --vtu scene.vtu --plot scene.png
  pvdf-fem solve scene.toml --plot stress.svg --quantity stress
  pvdf-fem solve scene.toml --mesh scene.msh
  pvdf-fem solve scene.toml --plan
  pvdf-fem -v solve scene.toml

exit codes: 0 converged, 2 bad input, 3 not converged (there are no charges
then, and no file is written)"""

_DEFAULT_QUANTITY = "deflection"


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem solve`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "solve",
        run,
        summary="charges of a scene",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--mesh",
        metavar="FILE",
        type=Path,
        help="solve only on this mesh, from `pvdf-fem mesh` or your own: triangles of three or six "
        "nodes that follow the outlines (.msh .inp .unv .bdf .med .mesh .stl .vtk .vtu .vtp "
        ".xdmf ...)",
    )
    parser.add_argument(
        "--vtu",
        metavar="FILE",
        type=Path,
        help="write deflection, stresses, charge densities and patches for ParaView and pyvista",
    )
    parser.add_argument(
        "--vtu-cells",
        choices=["linear", "six-node"],
        help="cells of --vtu: linear triangles (the default), or the curved six-node elements "
        "themselves, which ParaView shows and integrates only roughly",
    )
    parser.add_argument(
        "--plan",
        action="store_true",
        help="print the resolved problem with its film model, loads and outputs, and do not solve",
    )
    add_plot(parser, "a map of the film")
    parser.add_argument(
        "--quantity",
        metavar="NAME",
        help="quantity of --plot: deflection (the default), stress, charge density, principal "
        "directions, mesh, error or contact",
    )


def run(options: argparse.Namespace) -> int:
    """Solve a scene, print its charges, and write the files of ``--vtu`` and ``--plot``.

    With ``--plan`` the resolved problem is printed instead, and nothing is solved.

    Returns
    -------
    int
        `ExitCode.CONVERGED`, or `ExitCode.NOT_CONVERGED` if there are no charges. No file is
        written in the latter case.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    FileError
        If a file cannot be written. The charges have been printed nevertheless.
    """
    errors = find_output_errors(options.vtu, [".vtu"], options.scene, options.mesh)
    errors += find_plot_errors(options, options.scene, options.mesh, options.vtu)
    if options.vtu_cells is not None and not options.vtu:
        errors.append("--vtu-cells: requires --vtu; add --vtu FILE, or remove it")
    if options.quantity is not None and not options.plot:
        errors.append("--quantity: requires --plot; add --plot FILE, or remove it")
    if options.plan:
        outputs = {"--plot": options.plot, "--vtu": options.vtu}
        for option, path in outputs.items():
            if path is not None:
                errors.append(f"--plan: cannot be combined with {option}; remove one of the two")
    scene = read_scene(options, *errors)
    quantity = options.quantity or _DEFAULT_QUANTITY
    if options.plan:
        from pvdf_fem.problem.problem import Problem

        print_result(Problem.from_scene(scene), options.json)
        return ExitCode.CONVERGED
    if options.plot:
        from pvdf_fem.view.film_quantities import resolve_map

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
            solution.to_vtu(options.vtu, options.vtu_cells or "linear")
        if converged and options.plot:
            save_plot(solution.plot(quantity), options)
    finally:  # print the charges even if a file cannot be written
        print_result(solution, options.json)
    return ExitCode.CONVERGED if converged else ExitCode.NOT_CONVERGED
