"""The commands ``pvdf-fem sweep`` and ``pvdf-fem report``, which solve many scenes."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli import program
from pvdf_fem.cli.program import ExitCode, InputError, add_command, find_output_errors
from pvdf_fem.files import require_distinct

if TYPE_CHECKING:
    from pvdf_fem.batch.plan import SweepPlan
    from pvdf_fem.batch.store import Store
    from pvdf_fem.studies.scene_grid import SceneGrid

_DESCRIPTION = """\
Charges over a grid of scenes, as a NetCDF file with a dimension for each axis.
Scenes whose films deform alike are solved together: electrodes and d31, d32
only read the stress, a turned or mirrored film deforms alike, and so does a
thicker film under a force in proportion. Solved scenes are kept in a store: after
an interruption of any kind the command goes on with the remaining scenes."""

_EPILOG = """\
sweep files are TOML. `scene` is the path of a scene file, seen from the sweep
file, or a table of its keys. Each [[axes]] is a dimension: the keys in it vary
together, over a list or over `count` numbers from `start` to `stop`:
  scene = "four_electrodes.toml"
  [[axes]]
  film.thickness_um = [9, 25, 110]
  [[axes]]
  load.force_N = { start = 0.1, stop = 10, count = 5, spacing = "log" }
  [[axes]]
  name = "place"
  probe.x_mm = { start = 0, stop = 10, count = 41 }
  probe.y_mm = { start = 0, stop = 5, count = 41 }
or the places of the thesis's mapping scheme, lines from an electrode's centre:
  [[axes]]
  mapping = { electrode = "A", angles_deg = [0, 45], distances_mm = [0, 4, 8] }
Optional there: name, reach_mm (from the film's centre).

examples:
  pvdf-fem sweep thickness_spacing.toml --plan
  pvdf-fem sweep sweep.toml --output charges.nc --plot charges.png
  dask scheduler & dask worker tcp://localhost:8786 --nworkers 8 --nthreads 1 &
  pvdf-fem sweep sweep.toml --scheduler tcp://localhost:8786

Several sweeps may use one store; what one has solved the others take from it.

exit codes: 0 all converged, 2 bad input, 3 some scenes have no charges (their
`status` in the file says why) or the Dask scheduler stopped, 130 interrupted"""


_REPORT = """\
A page with figures and tables about a sensor, as a report script says: charges
against distance, isocharge maps, curves, and data of others beside computed
charges. DIR/index.html is written at once, and anew with each figure; beside it
are data/ (CSV files), figures/ and scenes/. What is solved is kept in
DIR/solved.db: after an interruption of any kind the command goes on."""

_REPORT_EPILOG = """\
report scripts are TOML. `title` heads the page. `scene` is the path of a scene
file, seen from the script, or a table [scene], or example = "triangle". Data of
others are tables [data.NAME]: `file`, a CSV file, or `table`, its text. Their
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

exit codes: 0 all figures and tables are made, 2 bad input, 3 some lack charges
(the page says why in their places), 130 interrupted"""


def add_to(commands: Any) -> None:
    """Add the commands to the commands of an argument parser."""
    summary = "charges over a grid of scenes"
    parser = add_command(commands, "sweep", _sweep, summary, _DESCRIPTION, _EPILOG)
    parser.add_argument("sweep", metavar="SWEEP.toml", type=Path, help="sweep file")
    parser.add_argument(
        "--output",
        metavar="FILE.nc",
        type=Path,
        help="NetCDF file to write (default: the sweep file's name here, ending in .nc)",
    )
    parser.add_argument(
        "--store",
        metavar="FILE",
        type=Path,
        help="where solved scenes are kept (default: the output's name, ending in .db)",
    )
    where = parser.add_mutually_exclusive_group()
    _add_processes(where)
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster that solves (see below)"
    )
    program.add_plot(parser, "the charges over one or two axes")
    program.add_progress(parser)
    parser.add_argument("--plan", action="store_true", help="only print what there is to solve")
    parser.add_argument("--quiet", action="store_true", help="print complaints only")
    summary = "a page of figures and tables about a sensor"
    parser = add_command(commands, "report", _report, summary, _REPORT, _REPORT_EPILOG)
    parser.add_argument("script", metavar="REPORT.toml", type=Path, help="report script")
    about = "directory to write (default: the script's name here, without .toml)"
    parser.add_argument("--out", metavar="DIR", type=Path, help=about)
    about = "Python file that is run for further kinds of figures: its classes of Kind"
    parser.add_argument("--kinds", metavar="FILE.py", type=Path, help=about)
    about = "few scenes to a coarse tolerance, to see what the page looks like"
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help=about)
    about = "take the keys in `full` of each figure: more scenes and tasks"
    size.add_argument("--full", action="store_true", help=about)
    _add_processes(parser)
    program.add_progress(parser)


def _add_processes(parser: Any) -> None:
    about = "processes (default: all cores)"
    parser.add_argument("--processes", metavar="N", type=int, default=-1, help=about)


def _process_mistakes(options: argparse.Namespace) -> list[str]:
    count: int = options.processes
    wrong = count == 0 or count < -1
    return [f"--processes {count}: give 1 or more, or -1 for all cores"] * wrong


def _sweep(options: argparse.Namespace) -> int:
    from pvdf_fem.scene.scene_file import SceneError

    output = options.output or Path(f"{options.sweep.stem}.nc")
    unused = options.plan and not options.output
    mistakes = [] if unused else find_output_errors(output, [".nc"], options.sweep)
    mistakes += program.find_plot_errors(options, options.sweep, output)
    mistakes += _process_mistakes(options)
    from pvdf_fem.studies.scene_grid import SceneGrid

    try:
        grid = SceneGrid.from_file(options.sweep)
        scenes = grid.scenes()
    except SceneError as error:
        raise InputError(*mistakes, *error.problems) from error
    if options.plot and (count := sum(size > 1 for size in grid.shape)) not in (1, 2):
        mistakes.append(f"--plot: draws one or two axes, not {count}; leave it out")
    if mistakes:
        raise InputError(*mistakes)
    from pvdf_fem.batch.batch import plan_scenes
    from pvdf_fem.batch.store import Store, StoreError
    from pvdf_fem.batch.workers import ClusterError, ClusterLostError

    path = options.store or output.with_suffix(".db")
    require_distinct(path, output, *grid.files)
    require_distinct(output, *grid.files)
    try:
        if options.plan and not path.exists():
            print(plan_scenes(scenes))
            return ExitCode.CONVERGED
        with Store(path) as store:
            plan = plan_scenes(scenes, store)
            if options.plan or not options.quiet:
                print(plan, flush=True)
            if options.plan:
                return ExitCode.CONVERGED
            return _run(grid, plan, store, output, options)
    except ClusterLostError as error:
        print(error, file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    except (StoreError, ClusterError) as error:
        raise InputError(str(error)) from error


def _run(
    grid: SceneGrid, plan: SweepPlan, store: Store, output: Path, options: argparse.Namespace
) -> int:
    from pvdf_fem.batch.batch import solve_planned
    from pvdf_fem.progress import show_progress
    from pvdf_fem.studies.sweep_dataset import make_sweep_dataset, write_netcdf

    where: dict[str, Any] = {"processes": options.processes, "scheduler": options.scheduler}
    with show_progress("scenes", False if options.quiet else options.progress) as progress:
        solved = solve_planned(plan, store, **where, progress=progress)
        data = make_sweep_dataset(grid, plan, solved)
    write_netcdf(data, output)
    if options.plot:
        from pvdf_fem.view.charts import draw_sweep

        program.save_plot(draw_sweep(data), options)
    if not options.quiet:
        sizes = ", ".join(f"{count} {name}" for name, count in data.sizes.items())
        print(f"{output}: {sizes}")
    failed = Counter(status for status in data.status.values.ravel() if status != "converged")
    for status, count in failed.items():
        print(f"no charges in {count} scenes: {status}", file=sys.stderr)
    return ExitCode.NOT_CONVERGED if failed else ExitCode.CONVERGED


def _report(options: argparse.Namespace) -> int:
    from pvdf_fem.report.registry import load_kinds
    from pvdf_fem.report.report import Report
    from pvdf_fem.scene.scene_file import SceneError

    mistakes = _process_mistakes(options)
    try:
        report = Report.load(options.script, load_kinds(options.kinds) if options.kinds else None)
    except SceneError as error:
        raise InputError(*mistakes, *error.problems) from error
    if mistakes:
        raise InputError(*mistakes)
    out, how = options.out or Path(options.script.stem), {"processes": options.processes}
    how |= {"quick": options.quick, "full": options.full, "progress": options.progress}
    made = report.make(out, **how)
    tasks = f"; {made.tasks} tasks, of which {made.ran} ran now" * bool(made.tasks)
    print(f"{made.page}: {made.scenes} scenes, of which {made.solved} were solved now{tasks}")
    for failure in made.failures:
        print(failure, file=sys.stderr)
    return ExitCode.CONVERGED if made.complete else ExitCode.NOT_CONVERGED
