"""Run tasks on processes that may die, local ones or those of a Dask cluster."""

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


#: Seconds after which idle processes end.
IDLE_SECONDS = 300


class ClusterError(RuntimeError):
    """A cluster cannot be used; the text says why and what to do."""


class ClusterLostError(ClusterError):
    """A cluster stopped while it worked; the text says what to do."""


@dataclass(frozen=True)
class WorkerDied:
    """The result of a task whose process died, or that raised an error."""

    reason: str


def run_on_processes(
    function: Callable[[Task], Result],
    tasks: Iterable[tuple[int, Task]],
    processes: int | None = None,
) -> Iterator[tuple[int, Result | WorkerDied]]:
    """Run a function on tasks in local processes.

    New processes run linear algebra on a single thread, and end with the calling process. If a
    process dies, the processes are replaced, and tasks without a result are run again one by one.
    If the caller stops early or an error is raised, all processes are killed.

    Parameters
    ----------
    function : callable
        Function of a task that returns its result.
    tasks : iterable of (int, task)
        Tasks with their numbers; the iterable is read as processes become free.
    processes : int, optional
        Number of processes, by default one for every core. 1 runs the tasks in the calling process.

    Yields
    ------
    number : int
        The number of a task, in order of completion.
    result : Result or WorkerDied
        `WorkerDied` for a task whose process dies twice, or that raises an error in a process.

    Raises
    ------
    GmshMissingError
        If a task raises it, since no other task can be run then. In the calling process every error
        of a task is raised.
    """
    count = joblib.effective_n_jobs(-1 if processes is None else processes)
    if count == 1:
        for number, task in tasks:
            yield number, function(task)
        return
    # the processes stay for later calls, and joblib's own `Parallel` of a caller takes them over
    options: dict[str, Any] = {
        "timeout": IDLE_SECONDS,
        "env": ONE_THREAD,
        "initializer": exit_with_parent,
        "initargs": (os.getpid(),),
    }

    def get_executor() -> Any:
        return get_memmapping_executor(count, **options)

    try:
        yield from _run_tasks(
            function, tasks, get_executor=get_executor, count_workers=lambda: count
        )
    except BaseException:  # nobody waits for tasks that still run
        get_executor().shutdown(kill_workers=True)
        raise


def exit_with_parent(parent: int) -> None:
    """Start a thread that ends this process soon after its parent, even if that is killed.

    Parameters
    ----------
    parent : int
        Process id of the parent.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_on_cluster(
    function: Callable[[Task], Result], tasks: Iterable[tuple[int, Task]], scheduler: str
) -> Iterator[tuple[int, Result | WorkerDied]]:
    """Run a function on tasks by the workers of a Dask cluster.

    The scheduler gives the tasks of a dead worker to others, at most a few times.

    Parameters
    ----------
    function : callable
        Function of a task that returns its result.
    tasks : iterable of (int, task)
        Tasks with their numbers; the iterable is read as workers become free.
    scheduler : str
        Address of the scheduler, like ``tcp://127.0.0.1:8786``.

    Yields
    ------
    number : int
        The number of a task, in order of completion.
    result : Result or WorkerDied
        `WorkerDied` for a task that raises an error.

    Raises
    ------
    GmshMissingError
        If a task raises it, since no other task can be run then.
    ClusterError
        If dask is not installed, or no scheduler answers.
    ClusterLostError
        If the scheduler stops answering.
    """
    client = _connect_to_scheduler(scheduler)
    with client:
        executor = client.get_executor(pure=False)
        try:
            yield from _run_tasks(
                function,
                tasks,
                get_executor=lambda: executor,
                count_workers=lambda: sum(client.nthreads().values()),
            )
        except (OSError, CancelledError) as error:
            advice = "start it again, then repeat the command: what is solved is in the store"
            text = f"--scheduler {scheduler}: does not answer any more; {advice}"
            raise ClusterLostError(text) from error


def _connect_to_scheduler(scheduler: str) -> Any:
    """Connect to a Dask scheduler; raise `ClusterError` without dask or without an answer."""
    try:
        # otherwise a scheduler that stops is logged with its traceback
        loggers = ("distributed", "distributed.client", "tornado", "asyncio")
        import_module("dask.config").set(logging=dict.fromkeys(loggers, "critical"))
        distributed: Any = import_module("distributed")
    except ImportError as error:
        advice = 'run: pip install "pvdf-fem[cluster]"'
        raise ClusterError(f"--scheduler {scheduler}: dask is missing; {advice}") from error
    try:
        return distributed.Client(scheduler, timeout=20, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "start `dask scheduler` there, or correct the address"
        raise ClusterError(f"--scheduler {scheduler}: {error}; {advice}") from error


def _run_tasks(
    function: Callable[[Task], Result],
    tasks: Iterable[tuple[int, Task]],
    *,
    get_executor: Callable[[], Executor],
    count_workers: Callable[[], int],
) -> Iterator[tuple[int, Result | WorkerDied]]:
    """Run tasks on an executor, and yield their numbers and results in order of completion.

    Up to twice as many tasks as workers are submitted at a time. If a process dies, its executor
    loses all its tasks; `get_executor` then returns a new one, and the lost tasks are submitted one
    by one.

    Parameters
    ----------
    function : callable
        Computes the result of a task.
    tasks : iterable of tuple of int and task
        Numbered tasks.
    get_executor : callable
        Returns the executor that is in use.
    count_workers : callable
        Returns the number of its workers.
    """
    remaining = iter(tasks)
    running: dict[Future[Result], tuple[int, Task]] = {}
    lost: list[tuple[int, Task]] = []
    while True:
        is_single = bool(lost) and not running
        if is_single:
            submitted = [lost.pop()]
        else:
            # lost tasks come first; they wait until no other task runs
            room = 0 if lost else max(1, 2 * count_workers()) - len(running)
            submitted = list(islice(remaining, max(room, 0)))
        for numbered in submitted:
            try:
                future = get_executor().submit(function, numbered[1])
            except TerminatedWorkerError:  # of a process that died a moment ago
                lost.append(numbered)
            else:
                running[future] = numbered
        if not running and not lost:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        if any(_is_lost(future) for future in done):
            done, _ = wait(running)  # the other tasks of the executor are lost or done, too
        for future in sorted(done, key=_is_lost):
            numbered = running.pop(future)
            if _is_lost(future) and not is_single:
                lost.append(numbered)
            else:
                result: Result | WorkerDied = _get_result(future)
                yield numbered[0], result


def _get_result(future: Future[Result]) -> Result | WorkerDied:
    """Return the result of a task, or its error as `WorkerDied`; raise `GmshMissingError`."""
    error = future.exception()
    if isinstance(error, GmshMissingError):
        raise error
    if error:
        return WorkerDied(f"{type(error).__name__}: {error}")
    return future.result()


def _is_lost(future: Future[Any]) -> bool:
    """Return whether a finished task was lost because a process of its executor died."""
    return isinstance(future.exception(), TerminatedWorkerError)
