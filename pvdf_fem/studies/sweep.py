"""A scene's charges over a grid of parameters, as a labelled dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.batch.batch import planned, records
from pvdf_fem.batch.store import Store
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.given import SceneLike, scene_of, taken
from pvdf_fem.studies.grid import Grid

if TYPE_CHECKING:
    import xarray


def sweep(
    scene: SceneLike,
    axes: Sequence[Mapping[str, Any]],
    store: Store | Path | str | None = None,
    *,
    processes: int = -1,
    scheduler: str | None = None,
    progress: Progress | bool | None = None,
) -> xarray.Dataset:
    """A scene's charges over a grid, as a dataset by `pvdf_fem.studies.grid_dataset.dataset`.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
        The base scene.
    axes : sequence of mapping
        See `pvdf_fem.studies.grid.Grid.of`: ``[{"film.thickness_um": [9, 25, 110]}, ...]``.
    store : Store or path of its file, optional
        Scenes in the store are not solved; new records join the store, but not after a crash.
    processes : int Number of processes, -1 for every core; 1 solves in this one.
    scheduler : str, optional Address of a Dask scheduler with workers that solve instead of local
    processes.
    progress : callable or bool, optional
        Called with the numbers of distinct scenes that are solved and that had to be; or whether
        these are shown, see `pvdf_fem.progress.show_progress`.

    Raises `SceneError` when an axis, or a scene of the grid, has a mistake.

    Examples
    --------
    >>> data = sweep(Scene.example("triangle"), [{"load.force_N": [0.5, 1.0, 2.0]}])
    >>> data.charge_pC.sel(electrode="A").to_pandas()
    """
    from pvdf_fem.studies.grid_dataset import dataset  # xarray is slow to import

    how: dict[str, Any] = {"scheduler": taken("scheduler", scheduler, str | None)}
    how["processes"] = taken("processes", processes, int, (-64, 4096)) or -1
    if not isinstance(store, Store | None):
        with Store(taken("store", store, Path)) as opened:
            return sweep(scene, axes, opened, **how, progress=progress)
    grid = Grid.of(scene_of(scene), axes)
    todo = planned(grid.scenes(), store)
    with show_progress("scenes", progress) as show:
        return dataset(grid, todo, records(todo, store, **how, progress=show))
