"""Many scenes: equally deforming scenes share a solve, on local cores or a cluster, kept in a
file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from pvdf_fem.arrays import Array
from pvdf_fem.batch.plan import SweepPlan, plan_solves
from pvdf_fem.batch.records import add_unloaded_integrals, make_records
from pvdf_fem.batch.store import Record, Store
from pvdf_fem.batch.workers import WorkerDied, run_on_cluster, run_on_processes
from pvdf_fem.electrodes.unloaded import find_uniform_integrals, unload
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.progress import Progress, ignore_progress
from pvdf_fem.scene.scene import Scene

#: Status of a scene after an exception or a dead process in its solve. Such
#: records are not stored: the next run tries the scenes again.
CRASHED = "crashed"

Task = tuple[list[Scene], Array]
Run = Callable[..., Iterator[tuple[int, Any]]]
Films = dict[Scene, Record]  #: Records of untouched films.


def solve_scenes(scenes: Sequence[Scene], store: Store | None = None, **how: Any) -> list[Record]:
    """Records of scenes, in their order; `how` they are solved is as in `sweep`."""
    todo = plan_scenes(scenes, store)
    by_index = dict(solve_planned(todo, store, **how))
    return [by_index[first] for first in todo.first.tolist()]


def plan_scenes(scenes: Sequence[Scene], store: Store | None = None) -> SweepPlan:
    """The plan for scenes; stored scenes need no solve."""
    scenes = pin_profile_files(scenes)
    return plan_solves(scenes, None if store is None else [scene in store for scene in scenes])


def solve_planned(
    todo: SweepPlan,
    store: Store | None = None,
    *,
    processes: int = -1,
    scheduler: str | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[tuple[int, Record]]:
    """Indices of a plan's distinct scenes with their records, in order of completion; see
    `sweep`."""
    if store is not None:
        for index in todo.stored:
            record = store.get(todo.scenes[index])
            assert record is not None  # rows are never removed
            yield index, record
    run: Run = partial(run_on_processes, processes=processes)
    if scheduler:
        run = partial(run_on_cluster, scheduler=scheduler)
    films = _moving(todo)
    at_rest = solve_scenes(films, store, processes=processes, scheduler=scheduler) if films else []
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
    scenes: list[Scene], result: list[Record] | WorkerDied, store: Store | None, films: Films
) -> list[Record]:
    """The records of scenes with charges at rest, which join the store unless scenes crashed."""
    records = _crashed(scenes, result.reason) if isinstance(result, WorkerDied) else result
    at_rest = [films.get(unload(scene)) for scene in scenes]
    records = [*map(add_unloaded_integrals, records, scenes, at_rest)]
    if store is not None:
        pairs = zip(scenes, records, strict=True)
        store.put((scene, record) for scene, record in pairs if record.status != CRASHED)
    return records


def _moving(todo: SweepPlan) -> list[Scene]:
    """A plan's distinct untouched films that need a solve for charges at rest and have no solve of
    their own."""
    missing = (scene for number in range(len(todo.blocks)) for scene in todo.scenes_of(number))
    films = dict.fromkeys(film for scene in missing if (film := unload(scene)) != scene)
    return [film for film in films if find_uniform_integrals(film) is None]


def _solved(task: Task) -> list[Record]:
    try:
        return make_records(*task)
    except GmshMissingError:  # no scene can be solved
        raise
    except Exception as error:  # must not end the solves of the other scenes
        return _crashed(task[0], f"{type(error).__name__}: {error}")


def _crashed(scenes: Sequence[Scene], reason: str) -> list[Record]:
    names = [tuple(electrode.name for electrode in scene.electrode_list) for scene in scenes]
    return [Record(CRASHED, reason, electrodes) for electrodes in names]
