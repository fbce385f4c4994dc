"""Tasks on processes that may die, of this machine or of a Dask cluster."""

from __future__ import annotations

import itertools
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar

import joblib
from joblib.executor import get_memmapping_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

Task = TypeVar("Task")
Result = TypeVar("Result")

# Deaths of processes without a result between them after which the next task is run alone.
MOST_DEATHS = 2
_LIBRARIES = ("OMP", "OPENBLAS", "MKL", "BLIS")
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in _LIBRARIES}


class ClusterError(RuntimeError):
    """A cluster cannot be used; the text says why and what to do."""


class ClusterLostError(ClusterError):
    """A cluster stopped while it worked; the text says what to do."""


@dataclass(frozen=True)
class Died:
    """Stands for the result of a task that has none, and says why."""

    reason: str


def on_processes(
    function: Callable[[Task], Result], tasks: Iterable[tuple[int, Task]], processes: int
) -> Iterator[tuple[int, Result | Died]]:
    """Numbers of tasks and their results as they come. When a process dies, all processes are
    replaced, and the tasks without a result are done again. A task that kills its process even when
    it is alone ends as `Died`. The function must not raise; tasks are read as far as processes are
    free. There are as many processes as cores if their number is -1; with 1 this one works. Each
    has one thread of linear algebra, and ends when this one does."""
    count = joblib.effective_n_jobs(processes)
    if count == 1:
        for number, task in tasks:
            yield number, function(task)
        return
    tasks, again, deaths = iter(tasks), deque[tuple[int, Task]](), 0
    running: dict[Future[Result], tuple[int, Task]] = {}
    executor = _executor(count)
    try:
        while True:
            alone = deaths > MOST_DEATHS
            while len(running) < (1 if alone else 2 * count):
                item = again.popleft() if again else next(tasks, None)
                if item is None:
                    break
                try:
                    running[executor.submit(function, item[1])] = item
                except TerminatedWorkerError:  # of a process that died a moment ago
                    again.appendleft(item)
                    executor = _executor(count)
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            if died := any(map(_has_died, done)):  # then all processes end
                done, _ = wait(running)
            for future in sorted(done, key=_has_died):
                number, task = running.pop(future)
                if not _has_died(future):
                    deaths = 0
                    yield number, future.result()
                elif alone:
                    yield number, Died("its process died")
                else:
                    again.append((number, task))
            deaths += died
    finally:
        # a shutdown may log an exception
        for process in list(executor._processes) if running else ():
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        wait(running)


def _has_died(future: Any) -> bool:
    return isinstance(future.exception(), TerminatedWorkerError)


def _executor(count: int) -> Any:
    """Processes that stay for later calls for 300 s. They are joblib's own, which a caller's
    `joblib.Parallel` takes over."""
    ends = {"initializer": end_with, "initargs": (os.getpid(),)}
    return get_memmapping_executor(count, timeout=300, env=ONE_THREAD, **ends)


def end_with(parent: int) -> None:
    """End this process soon after its parent, which may have been killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def on_cluster(
    function: Callable[[Task], Result], tasks: Iterable[tuple[int, Task]], scheduler: str
) -> Iterator[tuple[int, Result | Died]]:
    """Numbers of tasks and their results as they come from the workers of a Dask cluster. The
    scheduler, of an address such as ``tcp://127.0.0.1:8786``, gives the tasks of a worker that died
    to other workers, a few times at the most. Tasks are read as far as workers are free. Raises
    `ClusterError` when dask is not installed or no scheduler answers, and `ClusterLostError` when
    it stops."""
    try:
        # otherwise a scheduler that stops is logged with its traceback
        quiet = dict.fromkeys(
            ("distributed", "distributed.client", "tornado", "asyncio"), "critical"
        )
        import_module("dask.config").set(logging=quiet)
        distributed: Any = import_module("distributed")
    except ImportError as error:
        advice = "install it with: pip install 'pvdf-fem[cluster]'"
        raise ClusterError(f"--scheduler {scheduler}: dask is missing; {advice}") from error
    try:
        client = distributed.Client(scheduler, timeout=20, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "start `dask scheduler` there, or correct the address"
        raise ClusterError(f"--scheduler {scheduler}: {error}; {advice}") from error
    with client:
        try:
            yield from _by_workers(client, function, iter(tasks))
        except (OSError, CancelledError) as error:
            advice = "start it again, then repeat the command: what is solved is in the store"
            text = f"--scheduler {scheduler}: does not answer any more; {advice}"
            raise ClusterLostError(text) from error


def _by_workers(
    client: Any, function: Callable[[Task], Result], tasks: Iterator[tuple[int, Task]]
) -> Iterator[tuple[int, Result | Died]]:
    completed = import_module("distributed").as_completed(loop=client.loop)
    running: dict[Any, int] = {}

    def submit() -> None:
        room = max(1, 2 * sum(client.nthreads().values())) - len(running)
        for number, task in itertools.islice(tasks, max(room, 0)):
            future = client.submit(function, task, pure=False)
            running[future] = number
            completed.add(future)

    submit()
    for future in completed:
        number, error = running.pop(future), future.exception()
        if future.cancelled():
            raise CancelledError
        yield number, Died(f"{type(error).__name__}: {error}") if error else future.result()
        future.release()
        submit()
