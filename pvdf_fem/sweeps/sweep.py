"""Many scenes: equally deforming scenes share a solve, on local cores or a cluster, kept in a
file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pvdf_fem.arrays import Array
from pvdf_fem.charges.rest import known_at_rest, untouched
from pvdf_fem.film.loads.profiles import pinned
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.progress import Progress, shown, silent
from pvdf_fem.scene.given import SceneLike, scene_of, taken
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.grid import Grid
from pvdf_fem.sweeps.plan import SweepPlan, plan
from pvdf_fem.sweeps.records import records_of, with_rest
from pvdf_fem.sweeps.store import Record, Store
from pvdf_fem.sweeps.workers import Died, on_cluster, on_processes

if TYPE_CHECKING:
    import xarray

#: Status of a scene after an exception or a dead process in its solve. Such
#: records are not stored: the next run tries the scenes again.
CRASHED = "crashed"

Task = tuple[list[Scene], Array]
Run = Callable[..., Iterator[tuple[int, Any]]]
Films = dict[Scene, Record]  #: Records of untouched films.


def sweep(
    scene: SceneLike,
    axes: Sequence[Mapping[str, Any]],
    store: Store | Path | str | None = None,
    *,
    processes: int = -1,
    scheduler: str | None = None,
    progress: Progress | bool | None = None,
) -> xarray.Dataset:
    """A scene's charges over a grid, as a dataset by `pvdf_fem.sweeps.dataset.dataset`.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
        The base scene.
    axes : sequence of mapping
        See `pvdf_fem.sweeps.grid.Grid.of`: ``[{"film.thickness_um": [9, 25, 110]}, ...]``.
    store : Store or path of its file, optional
        Scenes in the store are not solved; new records join the store, but not after a crash.
    processes : int Number of processes, -1 for every core; 1 solves in this one.
    scheduler : str, optional Address of a Dask scheduler with workers that solve instead of local
    processes.
    progress : callable or bool, optional
        Called with the numbers of distinct scenes that are solved and that had to be; or whether
        these are shown, see `pvdf_fem.progress.shown`.

    Raises `SceneError` when an axis, or a scene of the grid, has a mistake.

    Examples
    --------
    >>> data = sweep(Scene.example("triangle"), [{"load.force_N": [0.5, 1.0, 2.0]}])
    >>> data.charge_pC.sel(electrode="A").to_pandas()
    """
    from pvdf_fem.sweeps.dataset import dataset  # xarray is slow to import

    how: dict[str, Any] = {"scheduler": taken("scheduler", scheduler, str | None)}
    how["processes"] = taken("processes", processes, int, (-64, 4096)) or -1
    if not isinstance(store, Store | None):
        with Store(taken("store", store, Path)) as opened:
            return sweep(scene, axes, opened, **how, progress=progress)
    grid = Grid.of(scene_of(scene), axes)
    todo = planned(grid.scenes(), store)
    with shown("scenes", progress) as show:
        return dataset(grid, todo, records(todo, store, **how, progress=show))


def solve_all(scenes: Sequence[Scene], store: Store | None = None, **how: Any) -> list[Record]:
    """Records of scenes, in their order; `how` they are solved is as in `sweep`."""
    todo = planned(scenes, store)
    by_index = dict(records(todo, store, **how))
    return [by_index[first] for first in todo.first.tolist()]


def planned(scenes: Sequence[Scene], store: Store | None = None) -> SweepPlan:
    """The plan for scenes; stored scenes need no solve."""
    scenes = pinned(scenes)
    return plan(scenes, None if store is None else [scene in store for scene in scenes])


def records(
    todo: SweepPlan,
    store: Store | None = None,
    *,
    processes: int = -1,
    scheduler: str | None = None,
    progress: Progress = silent,
) -> Iterator[tuple[int, Record]]:
    """Indices of a plan's distinct scenes with their records, in order of completion; see
    `sweep`."""
    if store is not None:
        for index in todo.stored:
            record = store.get(todo.scenes[index])
            assert record is not None  # rows are never removed
            yield index, record
    run: Run = partial(on_processes, processes=processes)
    if scheduler:
        run = partial(on_cluster, scheduler=scheduler)
    films = _moving(todo)
    at_rest = solve_all(films, store, processes=processes, scheduler=scheduler) if films else []
    done, total = 0, todo.missing
    progress(done, total)
    for number, result in _solves(todo, store, run, dict(zip(films, at_rest, strict=True))):
        indices = todo.blocks[number].indices
        done += len(indices)
        progress(done, total)
        yield from zip(indices, result, strict=True)


def _solves(
    todo: SweepPlan, store: Store | None, run: Run, films: Films
) -> Iterator[tuple[int, list[Record]]]:
    """Block numbers with their records, in order of completion; records join the store."""
    if store is not None and todo.blocks:
        store.require_writable()
    elsewhere: dict[int, list[Record]] = {}
    for number, result in run(_solved, _tasks(todo, store, elsewhere)):
        yield number, _kept(todo.scenes_of(number), result, store, films)
    yield from elsewhere.items()


def _tasks(
    todo: SweepPlan, store: Store | None, elsewhere: dict[int, list[Record]]
) -> Iterator[tuple[int, Task]]:
    """The tasks of blocks, but for blocks that another program has solved `elsewhere` by now."""
    for number, block in enumerate(todo.blocks):
        scenes = todo.scenes_of(number)
        stored = [record for scene in scenes if (record := store and store.get(scene))]
        if len(stored) == len(scenes):
            elsewhere[number] = stored
        else:
            yield number, (scenes, block.frames)


def _kept(
    scenes: list[Scene], result: list[Record] | Died, store: Store | None, films: Films
) -> list[Record]:
    """The records of scenes with charges at rest, which join the store unless scenes crashed."""
    records = _crashed(scenes, result.reason) if isinstance(result, Died) else result
    at_rest = [films.get(untouched(scene)) for scene in scenes]
    records = [*map(with_rest, records, scenes, at_rest)]
    if store is not None:
        pairs = zip(scenes, records, strict=True)
        store.put((scene, record) for scene, record in pairs if record.status != CRASHED)
    return records


def _moving(todo: SweepPlan) -> list[Scene]:
    """A plan's distinct untouched films that need a solve for charges at rest and have no solve of
    their own."""
    missing = (scene for number in range(len(todo.blocks)) for scene in todo.scenes_of(number))
    films = dict.fromkeys(film for scene in missing if (film := untouched(scene)) != scene)
    return [film for film in films if known_at_rest(film) is None]


def _solved(task: Task) -> list[Record]:
    try:
        return records_of(*task)
    except GmshMissingError:  # no scene can be solved
        raise
    except Exception as error:  # must not end the solves of the other scenes
        return _crashed(task[0], f"{type(error).__name__}: {error}")


def _crashed(scenes: Sequence[Scene], reason: str) -> list[Record]:
    names = [tuple(electrode.name for electrode in scene.electrode_list) for scene in scenes]
    return [Record(CRASHED, reason, electrodes) for electrodes in names]
