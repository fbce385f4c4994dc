"""Solve many scenes on local cores or a cluster; equivalent ones share a solve.

Records of solved scenes may be stored in a file.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from pvdf_fem.arrays import Array
from pvdf_fem.batch.plan import SweepPlan, plan_solves
from pvdf_fem.batch.records import add_unloaded_integrals, make_records
from pvdf_fem.batch.store import Record, Store
from pvdf_fem.batch.workers import WorkerDied, run_on_cluster, run_on_processes
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import Progress, ignore_progress
from pvdf_fem.scene.scene import Scene

logger = logging.getLogger(__name__)
#: Status of a scene after an exception or a dead process in its solve. Such records are not
#: stored: the next run tries the scenes again.
CRASHED = "crashed"


class SolveTask(NamedTuple):
    """The scenes of a block, as arguments of `make_records` in a worker."""

    scenes: list[Scene]
    #: Orthogonal matrices from the scenes' axes to those of the first scene, (scenes, 2, 2).
    frames: Array


#: Function that runs a function on numbered tasks, and yields pairs of number and result in order
#: of completion.
Runner = Callable[..., Iterator[tuple[int, Any]]]
#: Records of unloaded films by the scenes of these films.
UnloadedRecords = dict[Scene, Record]


def solve_scenes(
    scenes: Sequence[Scene], store: Store | None = None, **options: Any
) -> list[Record]:
    """Solve the scenes that have no stored record, and return the records of all scenes.

    Parameters
    ----------
    scenes : sequence of Scene
        Scenes to solve; equal and equivalent ones share a solve.
    store : Store, optional
        Store from which records are read, and to which new ones are added.
    **options
        ``processes``, ``scheduler`` and ``progress`` of `solve_planned`.

    Returns
    -------
    list of Record
        In the order of the scenes. Scenes whose solve has crashed have a record with the status
        `CRASHED`.
    """
    plan = plan_scenes(scenes, store)
    records = dict(solve_planned(plan, store, **options))
    return [records[first] for first in plan.first.tolist()]


def plan_scenes(scenes: Sequence[Scene], store: Store | None = None) -> SweepPlan:
    """Group the distinct scenes without a record in `store` into blocks that share a solve."""
    scenes = pin_profile_files(scenes)
    is_stored = None if store is None else [scene in store for scene in scenes]
    return plan_solves(scenes, is_stored)


def solve_planned(
    plan: SweepPlan,
    store: Store | None = None,
    *,
    processes: int | None = None,
    scheduler: str | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[tuple[int, Record]]:
    """Solve the distinct scenes of a plan, and yield their records.

    Unloaded films that need a solve of their own are solved before the scenes.

    Parameters
    ----------
    plan : SweepPlan
        The scenes, and the blocks of scenes that share a solve.
    store : Store, optional
        Store with the records of ``plan.stored``. New records are added as soon as they are made,
        except those of crashed scenes.
    processes : int, optional
        Number of processes, by default one for every core; 1 solves in the calling process.
    scheduler : str, optional
        Address of a Dask scheduler whose workers solve instead of local processes.
    progress : callable, optional
        Called with two numbers of distinct scenes: those solved so far, and all without a stored
        record.

    Yields
    ------
    index : int
        Index of a distinct scene in ``plan.scenes``: stored scenes first, then the others in order
        of completion.
    record : Record
    """
    logger.info(
        "%d stored scenes; %d scenes need %d solves",
        len(plan.stored),
        plan.missing,
        len(plan.blocks),
    )
    if store is not None:
        for index in plan.stored:
            record = store.get(plan.scenes[index])
            assert record is not None  # rows are never removed
            yield index, record
    options: dict[str, Any] = {"processes": processes, "scheduler": scheduler}
    films = _list_unloaded_films(plan)
    unloaded: UnloadedRecords = {}
    if films:
        records = solve_scenes(films, store, **options)
        unloaded = dict(zip(films, records, strict=True))
    run: Runner = partial(run_on_processes, processes=processes)
    if scheduler:
        run = partial(run_on_cluster, scheduler=scheduler)
    done = 0
    progress(done, plan.missing)
    for number, records in _solve_blocks(plan, store, run=run, unloaded=unloaded):
        indices = plan.blocks[number].indices
        done += len(indices)
        progress(done, plan.missing)
        yield from zip(indices, records, strict=True)


def _solve_blocks(
    plan: SweepPlan, store: Store | None, *, run: Runner, unloaded: UnloadedRecords
) -> Iterator[tuple[int, list[Record]]]:
    """Solve the blocks of a plan; yield each block's index and records after they are stored.

    Blocks that another program has solved since the plan was made are not solved, and come last.

    Parameters
    ----------
    plan : SweepPlan
        The plan of the solves.
    store : Store or None
        Store of records.
    run : Runner
        Runs the tasks, in this process or in others.
    unloaded : UnloadedRecords
        Records of the unloaded films.
    """
    if store is not None and plan.blocks:
        store.require_writable()
    solved_elsewhere: dict[int, list[Record]] = {}
    tasks = _list_tasks(plan, store, solved_elsewhere)
    for number, result in run(_solve_task, tasks):
        scenes = plan.scenes_of(number)
        records = _complete_records(scenes, result, unloaded)
        _store_records(scenes, records, store)
        yield number, records
    yield from solved_elsewhere.items()


def _list_tasks(
    plan: SweepPlan, store: Store | None, solved_elsewhere: dict[int, list[Record]]
) -> Iterator[tuple[int, SolveTask]]:
    """Yield the numbers and tasks of the blocks that still need a solve.

    If the store already has all records of a block, they are added to `solved_elsewhere` under the
    block's number instead.

    Parameters
    ----------
    plan : SweepPlan
        The plan of the solves.
    store : Store or None
        Store of records.
    solved_elsewhere : dict of int to list of Record
        Receives the records of blocks that are already stored.
    """
    for number, block in enumerate(plan.blocks):
        scenes = plan.scenes_of(number)
        stored = []
        if store is not None:
            records = [store.get(scene) for scene in scenes]
            stored = [record for record in records if record is not None]
        if len(stored) == len(scenes):
            solved_elsewhere[number] = stored
        else:
            yield number, SolveTask(scenes, block.frames)


def _complete_records(
    scenes: list[Scene], result: list[Record] | WorkerDied, unloaded: UnloadedRecords
) -> list[Record]:
    """Add the stress integrals of the unloaded films to the records of a task.

    If the worker died, the records of its scenes have the status `CRASHED`.

    Parameters
    ----------
    scenes : list of Scene
        Scenes of the task.
    result : list of Record or WorkerDied
        Result of the task.
    unloaded : UnloadedRecords
        Records of the unloaded films.
    """
    records = result
    if isinstance(records, WorkerDied):
        records = _make_crashed_records(scenes, records.reason)
    finished = []
    for scene, record in zip(scenes, records, strict=True):
        problem = Problem.from_scene(scene)
        solved_film = unloaded.get(problem.unloaded_scene)
        finished.append(add_unloaded_integrals(record, problem, solved_film))
    return finished


def _store_records(scenes: list[Scene], records: list[Record], store: Store | None) -> None:
    """Store the records of scenes that have not crashed; do nothing without a store.

    Parameters
    ----------
    scenes : list of Scene
        The scenes.
    records : list of Record
        Their records.
    store : Store or None
        Store of records.
    """
    if store is None:
        return
    pairs = zip(scenes, records, strict=True)
    store.put((scene, record) for scene, record in pairs if record.status != CRASHED)


def _list_unloaded_films(plan: SweepPlan) -> list[Scene]:
    """List the distinct scenes of unloaded films that need a solve of their own.

    A scene that is its own unloaded film is left out.
    """
    films: dict[Scene, None] = {}
    for number in range(len(plan.blocks)):
        for scene in plan.scenes_of(number):
            problem = Problem.from_scene(scene)
            if problem.unloaded is not None and problem.unloaded_scene != scene:
                films[problem.unloaded_scene] = None
    return list(films)


def _solve_task(task: SolveTask) -> list[Record]:
    """Solve the scenes of a task; after an error, return records with the status `CRASHED`.

    Only `GmshMissingError` is raised.
    """
    try:
        return make_records(task.scenes, task.frames)
    except GmshMissingError:  # no scene can be solved
        raise
    except Exception as error:  # must not end the solves of the other scenes
        return _make_crashed_records(task.scenes, f"{type(error).__name__}: {error}")


def _make_crashed_records(scenes: Sequence[Scene], reason: str) -> list[Record]:
    """Make a record with the status `CRASHED` and a reason for each scene."""
    records = []
    for scene in scenes:
        electrodes = tuple(electrode.name for electrode in scene.electrode_list)
        records.append(Record(CRASHED, reason, electrodes))
    return records
