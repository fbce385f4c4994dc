"""The command ``pvdf-fem mesh``: the first mesh of a scene, as a file."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import add_scene_command, read_scene
from pvdf_fem.cli.output import find_output_errors
from pvdf_fem.cli.program import ExitCode

_DESCRIPTION = """\
Write the mesh that `solve` starts with: triangles in metres, with the patches
`electrode NAME` and `probe`.
The extension chooses the format:
  .msh        physical groups; where patches overlap, their combination is a
              group of its own, such as `electrode A + probe`; version 4.1,
              or 2.2 by --format msh22
  .inp        Abaqus and CalculiX: element sets, and the node set `rim`
  .vtu .vtk   a 0/1 array for each patch
sfepy and FreeFEM read meshes of order 1 only, NGSolve and FreeFEM msh22 only."""

_EPILOG = """\
examples:
  pvdf-fem mesh scene.toml scene.msh --set numerics.tolerance=1e-4
  pvdf-fem mesh scene.toml freefem.msh --format msh22 --order 1
  pvdf-fem mesh scene.toml abaqus.inp --element M3D6

exit codes: 0 written, 2 bad input, 3 gmsh failed"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem mesh`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "mesh",
        run,
        summary="write the mesh of a scene",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        json_help="",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="mesh file to write")
    parser.add_argument(
        "--format",
        metavar="NAME",
        help="format, where an extension has several: msh (4.1, the default of .msh) or msh22",
    )
    parser.add_argument(
        "--order",
        type=int,
        choices=(1, 2),
        help="2: curved triangles of six nodes (the default); 1: straight ones of three nodes",
    )
    parser.add_argument(
        "--element",
        metavar="TYPE",
        help="type of elements in .inp files: S6 (the default), M3D6, STRI65, CPS6, or of order 1 "
        "M3D3, S3, CPS3",
    )


def run(options: argparse.Namespace) -> int:
    """Write the mesh with which `solve` starts to a file, and print its size and its patches.

    Returns
    -------
    int
        `ExitCode.CONVERGED`, or `ExitCode.NOT_CONVERGED` if gmsh fails.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    FileError
        If the file cannot be written.
    """
    from pvdf_fem.view.files.export_error import ExportError
    from pvdf_fem.view.files.mesh_files import resolve_mesh_style, write_mesh

    choices = {
        "file_format": options.format,
        "order": options.order,
        "element": options.element,
    }
    try:
        style = resolve_mesh_style(options.file, **choices)
    except ExportError as error:
        # the value of a parameter comes from the option of the same name
        errors = [re.sub(r"^(format|element) = ([^:]*):", r"--\1 \2:", str(error))]
    else:
        extensions = [style.file_format.extension]
        errors = find_output_errors(options.file, extensions, options.scene)
    scene = read_scene(options, *errors)
    from pvdf_fem.film.loads.contact_estimate import estimate_tip_outlines
    from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.solver.first_sizes import ORDER, choose_first_sizes

    problem = Problem.from_scene(scene)
    try:
        mesh = mesh_scene(
            scene,
            choose_first_sizes(problem, ORDER),
            min_jacobian_ratio=problem.film.mesh_policy.min_jacobian_ratio,
            contacts=estimate_tip_outlines(scene),
        )
        write_mesh(mesh, options.file, **choices)
    except MeshError as error:
        print(f"not meshed: {error}; move or resize the probe slightly", file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    patches = ", ".join(name for name in mesh.subdomains if name != "film")
    nodes = mesh.t.max() + 1 if style.order == 1 else mesh.doflocs.shape[1]
    print(f"{options.file}: {mesh.nelements} triangles, {nodes} nodes, patches {patches}")
    return ExitCode.CONVERGED
