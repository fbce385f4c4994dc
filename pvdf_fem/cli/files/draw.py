"""The command ``pvdf-fem draw``: a drawing of a scene at scale 1:1."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import add_scene_command, read_scene
from pvdf_fem.cli.output import find_output_errors
from pvdf_fem.cli.program import ExitCode

_DESCRIPTION = """\
Draw the rim, electrodes and patches at scale 1:1, for a laser cutter, a
screen printer or a mask shop. The extension chooses the format:
  .dxf                R2010 in mm, with real circles and arcs (requires
                      pvdf-fem[drawings])
  .svg                one user unit is 1 mm, with real circles and arcs
  .pdf                a page of the drawing's size: print it at 100 %
The layers RIM, ELECTRODES, PATCHES and PROBE have outlines only; texts are on
NAMES and DIMENSIONS. In .svg they are groups with these ids and classes."""

_EPILOG = """\
example:
  pvdf-fem draw scene.toml pads.dxf

A drawing comes back by [electrodes] drawing = "pads.dxf", layer = "ELECTRODES".

exit codes: 0 written, 2 bad input"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem draw`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "draw",
        run,
        summary="draw a scene at scale 1:1 as DXF, SVG or PDF",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        json_help="",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="drawing to write")
    parser.add_argument("--probe", action="store_true", help="draw the probes, too")
    parser.add_argument(
        "--no-dimensions", action="store_true", help="leave out the layer DIMENSIONS"
    )
    parser.add_argument(
        "--r12", action="store_true", help="write DXF R12 for old machines: no unit, no ellipses"
    )


def run(options: argparse.Namespace) -> int:
    """Write the drawing of a scene, and print its layers.

    Returns
    -------
    int
        `ExitCode.CONVERGED`.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    FileError
        If the file cannot be written.
    """
    from pvdf_fem.view.drawings.draw import FORMATS, draw
    from pvdf_fem.view.drawings.sheet import describe_rim

    errors = find_output_errors(options.file, FORMATS, options.scene)
    if options.r12 and options.file.suffix.lower() != ".dxf":
        errors.append(f"--r12: is for .dxf files, not for {options.file}; remove it")
    scene = read_scene(options, *errors)
    draw(
        scene,
        options.file,
        probe=options.probe,
        dimensions=not options.no_dimensions,
        dxf_version="R12" if options.r12 else "R2010",
    )
    names = ", ".join(electrode.name for electrode in scene.electrode_list)
    print(f"{options.file}: scale 1:1, {describe_rim(scene.film)} mm, electrodes {names}")
    return ExitCode.CONVERGED
