"""The command ``pvdf-fem materials``: real films, with the sources of their values."""

from __future__ import annotations

import argparse
from typing import Any

from pvdf_fem.cli.options import add_command
from pvdf_fem.cli.output import print_result
from pvdf_fem.cli.program import ExitCode, InputError, convert_value_errors

_DESCRIPTION = """\
List real films, the values of film.material in a scene file, and layers on films such
as ink. With a name, print every value of this material with its sources, and what
no source gives."""

_EPILOG = """\
examples:
  pvdf-fem materials
  pvdf-fem materials te-uniaxial
  pvdf-fem materials te-uniaxial --scene >> scene.toml

exit codes: 0 printed, 2 no material of this name"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem materials`` to `commands`."""
    parser = add_command(
        commands,
        "materials",
        run,
        summary="real films with the sources of their values",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("name", metavar="NAME", nargs="?", help="material; without it, a table")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one JSON object")
    form.add_argument(
        "--scene", action="store_true", help="print [film] and [uncertain] of a scene file"
    )
    form.add_argument("--patch", action="store_true", help="print [[film.patches]] of a scene file")


def run(options: argparse.Namespace) -> int:
    """Print the table of all materials, or one material.

    Returns
    -------
    int
        `ExitCode.CONVERGED`.

    Raises
    ------
    InputError
        If there is no such material, or an option does not go with it.
    """
    from pvdf_fem.scene.materials.catalogue import materials

    if options.name is None:
        if options.scene or options.patch:
            option = "--scene" if options.scene else "--patch"
            raise InputError(f"{option}: requires NAME; give a material")
        print_result(materials(), options.json)
        return ExitCode.CONVERGED
    with convert_value_errors():
        material = materials(options.name)
        if options.scene:
            print(material.to_scene(), end="")
        elif options.patch:
            print(material.to_patch(), end="")
        else:
            print_result(material, options.json)
    return ExitCode.CONVERGED
