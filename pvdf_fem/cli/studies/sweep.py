"""The command ``pvdf-fem sweep``: charges over a grid of scenes."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.options import add_command, add_progress
from pvdf_fem.cli.output import add_plot, find_output_errors, find_plot_errors, save_plot
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.cli.studies.processes import add_processes_option, find_process_errors
from pvdf_fem.files import require_distinct

if TYPE_CHECKING:
    from pvdf_fem.batch.plan import SweepPlan
    from pvdf_fem.batch.store import Store
    from pvdf_fem.studies.scene_grid import SceneGrid

_DESCRIPTION = """\
Charges over a grid of scenes, as a NetCDF file with a dimension for each axis.
Scenes with the same deformation are solved together: electrodes and d31, d32 only
read the stress, a rotated or reflected film deforms in the same way, and so does a
thicker film under a proportional force. Solved scenes are saved in a store: after an
interruption of any kind the command continues with the remaining scenes."""

_EPILOG = """\
sweep files are TOML. `scene` is the path of a scene file, relative to the sweep
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
or the positions of the thesis's mapping scheme, lines from the centre of an electrode:
  [[axes]]
  mapping = { electrode = "A", angles_deg = [0, 45], distances_mm = [0, 4, 8] }
Optional there: name, reach_mm (from the film's centre).

examples:
  pvdf-fem sweep thickness_spacing.toml --plan
  pvdf-fem sweep sweep.toml --output charges.nc --plot charges.png
  dask scheduler & dask worker tcp://localhost:8786 --nworkers 8 --nthreads 1 &
  pvdf-fem sweep sweep.toml --scheduler tcp://localhost:8786

Several sweeps may share a store; each uses the scenes that another has solved.

exit codes: 0 all converged, 2 bad input, 3 some scenes have no charges (their
`status` in the file says why) or the Dask scheduler stopped, 130 interrupted"""


def add_parser(commands: Any) -> None:
    """Add the parser of ``pvdf-fem sweep`` to `commands`, the result of `add_subparsers`."""
    parser = add_command(
        commands,
        "sweep",
        run,
        summary="charges over a grid of scenes",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument("sweep", metavar="SWEEP.toml", type=Path, help="sweep file")
    parser.add_argument(
        "--output",
        metavar="FILE.nc",
        type=Path,
        help="NetCDF file to write (default: the sweep file's name with .nc, in this directory)",
    )
    parser.add_argument(
        "--store",
        metavar="FILE",
        type=Path,
        help="file in which solved scenes are saved (default: the output's name with .db)",
    )
    where = parser.add_mutually_exclusive_group()
    add_processes_option(where)
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="solve the scenes on the Dask cluster at this address (see below)",
    )
    add_plot(parser, "the charges over one or two axes")
    add_progress(parser)
    parser.add_argument(
        "--plan", action="store_true", help="only print which scenes are to be solved"
    )
    parser.add_argument("--quiet", action="store_true", help="print errors only")


def run(options: argparse.Namespace) -> int:
    """Solve the scenes of a sweep file that are not in the store, and write all charges to a file.

    With ``--plan`` the scenes to be solved are printed instead, and no output is written.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if all scenes have charges, or with ``--plan``. Otherwise, or if the
        connection to the Dask scheduler is lost, `ExitCode.NOT_CONVERGED`.

    Raises
    ------
    InputError
        If an option, the sweep file or the store is invalid, or if the Dask cluster cannot be used.
    """
    from pvdf_fem.batch.workers import ClusterError, ClusterLostError

    output = options.output or Path(f"{options.sweep.stem}.nc")
    grid = _read_grid(options, output)
    scenes = grid.scenes()
    from pvdf_fem.batch.batch import plan_scenes
    from pvdf_fem.batch.store import Store, StoreError

    store_file = options.store or output.with_suffix(".db")
    require_distinct(store_file, output, *grid.files)
    require_distinct(output, *grid.files)
    if options.plan and not store_file.exists():
        print(plan_scenes(scenes))
        return ExitCode.CONVERGED
    try:
        with Store(store_file) as store:
            plan = plan_scenes(scenes, store)
            if options.plan or not options.quiet:
                print(plan, flush=True)
            if options.plan:
                return ExitCode.CONVERGED
            return _solve_planned_scenes(grid, plan, store, output, options)
    except ClusterLostError as error:
        print(error, file=sys.stderr)
        return ExitCode.NOT_CONVERGED
    except (StoreError, ClusterError) as error:
        raise InputError(str(error)) from error


def _read_grid(options: argparse.Namespace, output: Path) -> SceneGrid:
    """Read the sweep file, and validate it with ``--output``, ``--plot`` and ``--processes``.

    Parameters
    ----------
    options : argparse.Namespace
        Options of ``pvdf-fem sweep``.
    output : Path
        The NetCDF file to write. With ``--plan`` it is checked only if ``--output`` is used.

    Raises
    ------
    InputError
        If one of these options, the grid or its scenes are invalid. The exception lists the errors
        that were found.
    """
    from pvdf_fem.scene.scene_file import SceneError
    from pvdf_fem.studies.scene_grid import SceneGrid

    errors = []
    is_written = options.output is not None or not options.plan
    if is_written:
        errors += find_output_errors(output, [".nc"], options.sweep)
    errors += find_plot_errors(options, options.sweep, output)
    errors += find_process_errors(options)
    try:
        grid = SceneGrid.from_file(options.sweep)
        grid.scenes()
    except SceneError as error:
        raise InputError(*errors, *error.problems) from error
    varying = sum(size > 1 for size in grid.shape)
    if options.plot and varying not in (1, 2):
        errors.append(f"--plot: draws one or two axes, not {varying}; remove the option")
    if errors:
        raise InputError(*errors)
    return grid


def _solve_planned_scenes(
    grid: SceneGrid, plan: SweepPlan, store: Store, output: Path, options: argparse.Namespace
) -> int:
    """Solve the planned scenes, and write the charges of all scenes and their plot.

    The size of the dataset is printed unless ``--quiet`` is used. Scenes without charges are
    always counted by status on standard error.

    Parameters
    ----------
    grid : SceneGrid
        All scenes, also those that are already in the store.
    plan : SweepPlan
        The scenes of the grid that are not yet in the store, in blocks that are solved together.
    store : Store
        Store in which solved scenes are saved.
    output : Path
        The NetCDF file to write.
    options : argparse.Namespace
        Options of ``pvdf-fem sweep``.

    Returns
    -------
    int
        `ExitCode.CONVERGED` if all scenes have charges, else `ExitCode.NOT_CONVERGED`.
    """
    from pvdf_fem.batch.batch import solve_planned
    from pvdf_fem.progress import show_progress
    from pvdf_fem.studies.sweep_dataset import make_sweep_dataset
    from pvdf_fem.view.files.netcdf import write_netcdf

    with show_progress("scenes", False if options.quiet else options.progress) as progress:
        records = solve_planned(
            plan,
            store,
            processes=options.processes,
            scheduler=options.scheduler,
            progress=progress,
        )
        data = make_sweep_dataset(grid, plan, records)
    write_netcdf(data, output)
    if options.plot:
        from pvdf_fem.view.charts.sweep import draw_sweep

        save_plot(draw_sweep(data), options)
    if not options.quiet:
        sizes = ", ".join(f"{size} {name}" for name, size in data.sizes.items())
        print(f"{output}: {sizes}")
    statuses = Counter(data.status.values.ravel().tolist())
    statuses.pop("converged", None)
    for status, count in statuses.items():
        print(f"no charges in {count} scenes: {status}", file=sys.stderr)
    return ExitCode.NOT_CONVERGED if statuses else ExitCode.CONVERGED
