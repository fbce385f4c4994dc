"""The command ``pvdf-fem deck``: a scene as an input deck of CalculiX or Abaqus."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import add_scene_command, add_text_option, parse_number, read_scene
from pvdf_fem.cli.output import find_output_errors, print_result
from pvdf_fem.cli.program import ExitCode, InputError

_DESCRIPTION = """\
Write a scene as an input deck, with which CalculiX or Abaqus checks the charges:
mesh, material, clamped rim, tension by cooling, the load, and output at the
electrodes. The mesh is refined until charges with its elements (M3D3) are within
the tolerance. With --read, compare the results of CalculiX with the charges of
this package instead."""

_EPILOG = """\
examples:
  pvdf-fem deck scene.toml film.inp
  ccx film
  pvdf-fem deck scene.toml --read film.dat
  pvdf-fem deck scene.toml film.inp --for abaqus --tolerance 1e-3

exit codes: 0 written or compared, 2 bad input, 3 not converged"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem deck`` to `commands`, the result of `add_subparsers`."""
    parser = add_scene_command(
        commands,
        "deck",
        run,
        summary="a scene as an input deck of CalculiX or Abaqus",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "file",
        metavar="FILE.inp",
        type=Path,
        nargs="?",
        help="deck to write; with --read the deck of the results, by default beside them",
    )
    parser.add_argument(
        "--for",
        metavar="PROGRAM",
        dest="program",
        choices=("calculix", "abaqus"),
        default="calculix",
        help="calculix (the default) or abaqus",
    )
    add_text_option(
        parser,
        "--tolerance",
        "FRACTION",
        about="maximum relative error of charges and deflection due to the deck's mesh",
        default="0.003",
    )
    parser.add_argument(
        "--read", metavar="FILE.dat", type=Path, help="results of CalculiX to compare"
    )


def run(options: argparse.Namespace) -> int:
    """Write a deck, or compare the results of one with the charges of this package.

    Returns
    -------
    int
        `ExitCode.CONVERGED`; if the scene has no solution an exception gives another code.

    Raises
    ------
    InputError
        If an option or the scene is invalid.
    FileError
        If a file cannot be read or written.
    NotConvergedError
        If the scene has no solution.
    """
    errors: list[str] = []
    tolerance = parse_number("--tolerance", options.tolerance, errors)
    if options.read is None:
        errors += find_output_errors(options.file, [".inp"], options.scene)
        if options.file is None:
            errors.append("FILE.inp: is required; add the name of the deck to write")
    scene = read_scene(options, *errors)
    if options.read is not None:
        from pvdf_fem.studies.decks.compare_deck import compare_deck

        print_result(compare_deck(scene, options.read, deck=options.file), options.json)
        return ExitCode.CONVERGED
    from pvdf_fem.studies.decks.write_deck import write_deck

    try:
        deck = write_deck(scene, options.file, program=options.program, tolerance=tolerance)
    except ValueError as error:
        messages = getattr(error, "problems", [str(error)])
        renamed = [message.replace("tolerance = ", "--tolerance ", 1) for message in messages]
        raise InputError(*renamed) from error
    print_result(deck, options.json)
    return ExitCode.CONVERGED
