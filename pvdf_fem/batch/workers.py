"""Tasks on processes that may die, local or on a Dask cluster."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from typing import Any, TypeVar

import joblib
from joblib.executor import get_memmapping_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from pvdf_fem.mesh.gmsh_libraries import GmshMissingError

Task = TypeVar("Task")
Result = TypeVar("Result")

_LIBRARIES = ("OMP", "OPENBLAS", "MKL", "BLIS")
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in _LIBRARIES}


class ClusterError(RuntimeError):
    """A cluster cannot be used; the text says why and what to do."""


class ClusterLostError(ClusterError):
    """A cluster stopped while it worked; the text says what to do."""


@dataclass(frozen=True)
class WorkerDied:
    """Replaces a missing result, with the reason."""

    reason: str


def run_on_processes(
    function: Callable[[Task], Result],
    tasks: Iterable[tuple[int, Task]],
    processes: int | None = None,
) -> Iterator[tuple[int, Result | WorkerDied]]:
    """Numbers and results of tasks in order of completion. When a process dies, the processes are
    replaced, and tasks without a result are done again separately. A task that kills its process
    again ends as `WorkerDied`. Of errors `GmshMissingError` alone is raised. Tasks are read when
    processes are free. By default there is a process per core; `processes` = 1 starts none.
    New processes run linear algebra on a single thread, and end with the calling process."""
    count = joblib.effective_n_jobs(-1 if processes is None else processes)
    if count == 1:
        for number, task in tasks:
            yield number, function(task)
        return
    # the processes stay for later calls, and joblib's own `Parallel` of a caller takes them over
    keep: Any = {"timeout": 300, "env": ONE_THREAD}
    keep |= {"initializer": exit_with_parent, "initargs": (os.getpid(),)}

    def executor() -> Any:
        return get_memmapping_executor(count, **keep)

    try:
        yield from _results(function, tasks, executor, lambda: count)
    except BaseException:  # nobody waits for what still runs
        executor().shutdown(kill_workers=True)
        raise


def exit_with_parent(parent: int) -> None:
    """End this process soon after its parent, perhaps after a kill."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_on_cluster(
    function: Callable[[Task], Result], tasks: Iterable[tuple[int, Task]], scheduler: str
) -> Iterator[tuple[int, Result | WorkerDied]]:
    """Task numbers and results from a Dask cluster's workers, in order of completion. The scheduler
    at an address like ``tcp://127.0.0.1:8786`` gives a dead worker's tasks to further workers, at
    most a few times. Tasks are read when workers are free. Raises `ClusterError` when dask is not
    installed or no scheduler answers, and `ClusterLostError` when it stops."""
    try:
        # otherwise a scheduler that stops is logged with its traceback
        quiet = dict.fromkeys(
            ("distributed", "distributed.client", "tornado", "asyncio"), "critical"
        )
        import_module("dask.config").set(logging=quiet)
        distributed: Any = import_module("distributed")
    except ImportError as error:
        advice = 'run: pip install "pvdf-fem[cluster]"'
        raise ClusterError(f"--scheduler {scheduler}: dask is missing; {advice}") from error
    try:
        client = distributed.Client(scheduler, timeout=20, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "start `dask scheduler` there, or correct the address"
        raise ClusterError(f"--scheduler {scheduler}: {error}; {advice}") from error
    with client:
        executor = client.get_executor(pure=False)
        try:
            yield from _results(
                function, tasks, lambda: executor, lambda: sum(client.nthreads().values())
            )
        except (OSError, CancelledError) as error:
            advice = "start it again, then repeat the command: what is solved is in the store"
            text = f"--scheduler {scheduler}: does not answer any more; {advice}"
            raise ClusterLostError(text) from error


def _results(
    function: Callable[[Task], Result],
    tasks: Iterable[tuple[int, Task]],
    executor: Callable[[], Executor],
    workers: Callable[[], int],
) -> Iterator[tuple[int, Result | WorkerDied]]:
    """Numbers of tasks and their results. Twice `workers` tasks are under way. An `executor` with a
    dead process has lost its tasks and is replaced."""
    tasks, running = iter(tasks), dict[Future[Result], tuple[int, Task]]()
    lost: list[tuple[int, Task]] = []
    while True:
        alone = bool(lost) and not running
        room = 0 if lost else max(1, 2 * workers()) - len(running)
        for task in [lost.pop()] if alone else islice(tasks, max(room, 0)):
            try:
                running[executor().submit(function, task[1])] = task
            except TerminatedWorkerError:  # of a process that died a moment ago
                lost.append(task)
        if not running and not lost:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        if any(map(_lost, done)):
            done, _ = wait(running)
        for future in sorted(done, key=_lost):
            number, _ = task = running.pop(future)
            if _lost(future) and not alone:
                lost.append(task)
            elif isinstance(error := future.exception(), GmshMissingError):
                raise error  # no task can be done
            elif error:
                yield number, WorkerDied(f"{type(error).__name__}: {error}")
            else:
                yield number, future.result()


def _lost(future: Future[Any]) -> bool:
    return isinstance(future.exception(), TerminatedWorkerError)
