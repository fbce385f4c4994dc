"""Tasks on processes that may die, of this machine or of a Dask cluster."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

Task = TypeVar("Task")
Result = TypeVar("Result")

# Deaths of processes without a result between them after which the next task is run alone.
MOST_DEATHS = 2


class ClusterError(RuntimeError):
    """A cluster cannot be used; the text says why and what to do."""


@dataclass(frozen=True)
class Died:
    """Stands for the result of a task that has none, and says why."""

    reason: str


def on_processes(
    function: Callable[[Task], Result], tasks: Mapping[int, Task], processes: int
) -> Iterator[tuple[int, Result | Died]]:
    """Numbers of tasks and their results as they come.

    When a process dies, all processes are replaced, and the tasks without a result are done again.
    A task that kills its process even when it is alone ends as `Died`.

    Parameters
    ----------
    function : callable
        Makes a result from a task; must not raise.
    tasks : mapping of int to task
    processes : int
        Number of processes, -1 for all cores; 1 works in this one. Each process has one thread of
        linear algebra.
    """
    left, deaths = dict(tasks), 0
    while left:
        alone = deaths > MOST_DEATHS
        now = dict(itertools.islice(left.items(), 1)) if alone else left
        try:
            for number, result in _parallel(function, now, 2 if alone else processes):
                del left[number]
                deaths = 0
                yield number, result
        except TerminatedWorkerError:
            deaths += 1
            if alone:
                number = next(iter(now))
                del left[number]
                yield number, Died("its process died")


def _parallel(
    function: Callable[[Task], Result], tasks: Mapping[int, Task], processes: int
) -> Iterator[tuple[int, Result]]:
    calls = (joblib.delayed(_numbered)(function, *item) for item in list(tasks.items()))
    with joblib.parallel_config("loky", inner_max_num_threads=1):
        parallel = joblib.Parallel(processes, return_as="generator_unordered", batch_size=1)
        results = parallel(calls)
        try:
            for result in results:  # noqa: UP028, "yield from" would close it, with a warning
                yield result
        finally:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # joblib warns of tasks that are cut short
                results.close()


def _numbered(function: Callable[[Task], Result], number: int, task: Task) -> tuple[int, Result]:
    return number, function(task)


def on_cluster(
    function: Callable[[Task], Result], tasks: Mapping[int, Task], scheduler: str
) -> Iterator[tuple[int, Result | Died]]:
    """Numbers of tasks and their results as they come from the workers of a Dask cluster.

    The scheduler gives the tasks of a worker that died to other workers, a few times at the most.

    Parameters
    ----------
    function : callable
    tasks : mapping of int to task
    scheduler : str
        Its address, such as ``tcp://127.0.0.1:8786``.

    Raises
    ------
    ClusterError
        When dask is not installed or no scheduler answers.
    """
    try:
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
        futures = {client.submit(function, task, pure=False): n for n, task in tasks.items()}
        for future in distributed.as_completed(futures, loop=client.loop):
            reason = future.exception()
            died = reason is not None
            number = futures[future]
            yield number, Died(f"{type(reason).__name__}: {reason}") if died else future.result()
            future.release()
