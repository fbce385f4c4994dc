"""The command ``pvdf-fem report``: a page of figures and tables about a sensor."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pvdf_fem.cli.options import add_command, add_progress
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.cli.studies.processes import add_processes_option, find_process_errors

_DESCRIPTION = """\
A page with figures and tables about a sensor, as a report script describes it:
charges against distance, isocharge maps, curves, and measured data beside computed
charges. DIR/index.html is written at once, and again with each figure; beside it
are data/ (CSV files), figures/ and scenes/. Solved scenes are stored in
DIR/solved.db: after an interruption of any kind the command continues from there."""

_EPILOG = """\
report scripts are TOML. `title` heads the page. `scene` is the path of a scene
file, relative to the script, or a table [scene], or example = "triangle". Measured
data are tables [data.NAME]: `file`, a CSV file, or `table`, its text. Their
columns are keys of a scene (x_mm, force_N, film.thickness_um, ...) and
electrodes; unit = "pC" or "V", reading = "total" or "change". Each [[section]]
has a `title`, a `text`, and below it:
  [[section.figure]]  kind = "sensor", "charge-vs-distance", "isocharge", "curve"
  [[section.table]]   kind = "comparison", "positions"
The guide has all their keys; `pvdf-fem example report` is a script to begin with.

examples:
  pvdf-fem example report > report.toml
  pvdf-fem report report.toml --out report --quick
  pvdf-fem report report.toml --kinds own.py --full

exit codes: 0 all figures and tables are complete, 2 bad input, 3 some lack charges
(the page gives the reason instead of them), 130 interrupted"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem report`` to `commands`, the result of `add_subparsers`."""
    parser = add_command(
        commands,
        "report",
        run,
        summary="a page of figures and tables about a sensor",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("script", metavar="REPORT.toml", type=Path, help="report script")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="directory to write (default: the script's name without .toml, in this directory)",
    )
    parser.add_argument(
        "--kinds",
        metavar="FILE.py",
        type=Path,
        help="Python file to run, whose subclasses of Kind are additional kinds of figures",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument(
        "--quick",
        action="store_true",
        help="solve few scenes to a coarse tolerance, for a preview of the page",
    )
    size.add_argument(
        "--full",
        action="store_true",
        help="use the keys in `full` of each figure: more scenes and tasks",
    )
    add_processes_option(parser)
    add_progress(parser)


def run(options: argparse.Namespace) -> int:
    """Write the page of a report script, and print how many scenes were solved for it.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if all figures and tables are complete, else `ExitCode.NOT_CONVERGED`.

    Raises
    ------
    InputError
        If an option or the script is invalid. The exception lists all errors.
    """
    from pvdf_fem.report.registry import load_kinds
    from pvdf_fem.report.report import Report
    from pvdf_fem.scene.scene_file import SceneError

    errors = find_process_errors(options)
    try:
        kinds = load_kinds(options.kinds) if options.kinds else None
        report = Report.load(options.script, kinds)
    except SceneError as error:
        raise InputError(*errors, *error.problems) from error
    if errors:
        raise InputError(*errors)
    made = report.make(
        options.out or Path(options.script.stem),
        processes=options.processes,
        quick=options.quick,
        full=options.full,
        progress=options.progress,
    )
    line = f"{made.page}: {made.scenes} scenes, of which {made.solved} were solved now"
    if made.tasks:
        line += f"; {made.tasks} tasks, of which {made.ran} ran now"
    print(line)
    for failure in made.failures:
        print(failure, file=sys.stderr)
    return ExitCode.CONVERGED if made.complete else ExitCode.NOT_CONVERGED
