"""Sweeps: the charges of a scene over a grid of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.batch.batch import plan_scenes, solve_planned
from pvdf_fem.batch.store import Store
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.studies.scene_grid import SceneGrid

if TYPE_CHECKING:
    import xarray

MAX_PROCESSES = 4096  #: Maximum number of processes that may be requested.


def sweep(
    scene: SceneLike,
    axes: Sequence[Mapping[str, Any]],
    store: Store | Path | str | None = None,
    *,
    processes: int | None = None,
    scheduler: str | None = None,
    progress: Progress | bool | None = None,
) -> xarray.Dataset:
    """Solve a scene over a grid of parameters, and return the charges as a dataset.

    Scenes whose films deform in the same way share a solve.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
        Base scene.
    axes : sequence of mapping
        Tables of scene keys with their values, one for each axis,
        ``[{"film.thickness_um": [9, 25, 110]}, ...]``; see
        `pvdf_fem.studies.scene_grid.SceneGrid.from_tables`.
    store : Store or path of its file, optional
        Store of solved scenes. Scenes in the store are not solved again; new records are saved to
        it, except those of crashed solves. Default: None, save nothing.
    processes : int, optional
        Number of processes; 1 solves in the calling process. Default: None, one for each core.
    scheduler : str, optional
        Address of a Dask scheduler whose workers solve the scenes. Default: None, local processes.
    progress : callable or bool, optional
        Function that is called with the numbers of finished and of all distinct scenes to solve, or
        whether to show these; see `pvdf_fem.progress.show_progress`.

    Returns
    -------
    xarray.Dataset
        Charges by axis and electrode with their errors, and the status of each scene, see
        `pvdf_fem.studies.sweep_dataset.make_sweep_dataset`.

    Raises
    ------
    SceneError
        If axes or scenes of the grid have errors; the exception lists them.

    Examples
    --------
    >>> data = sweep(Scene.example("triangle"), [{"load.force_N": [0.5, 1.0, 2.0]}])
    >>> data.charge_pC.sel(electrode="A").to_pandas()
    """
    from pvdf_fem.studies.sweep_dataset import make_sweep_dataset  # xarray is slow to import

    scheduler = coerce("scheduler", scheduler, str | None)
    if processes is not None:
        processes = coerce("processes", processes, int, (1, MAX_PROCESSES))
    if not isinstance(store, Store | None):
        with Store(coerce("store", store, Path)) as opened:
            return sweep(
                scene,
                axes,
                opened,
                processes=processes,
                scheduler=scheduler,
                progress=progress,
            )
    grid = SceneGrid.from_tables(as_scene(scene), axes)
    plan = plan_scenes(grid.scenes(), store)
    with show_progress("scenes", progress) as show:
        records = solve_planned(
            plan,
            store,
            processes=processes,
            scheduler=scheduler,
            progress=show,
        )
        return make_sweep_dataset(grid, plan, records)
