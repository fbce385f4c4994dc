"""Progress in long jobs: finished work, and time for the rest at this pace."""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

#: Called with finished work and total work, in an arbitrary unit. The work in all may change.
Progress = Callable[[float, float], None]


def ignore_progress(done: float, total: float) -> None:
    """A `Progress` that shows nothing."""


@contextmanager
def show_progress(
    unit: str, asked: Progress | bool | None = None, after_s: float = 2.0
) -> Iterator[Progress]:
    """The progress of a job.

    Parameters
    ----------
    unit : str
        What the work is counted in, such as "solves".
    asked : callable or bool, optional
        A `Progress` is taken as it is. Otherwise work and remaining time are written on standard
        error: always if true, never if false, and by default where standard error is a terminal.
    after_s : float
        Jobs that take less are silent.
    """
    if callable(asked):
        yield asked
        return
    terminal = sys.stderr is not None and sys.stderr.isatty()
    if sys.stderr is None or asked is False or not (asked or terminal):
        yield ignore_progress
        return
    begun, told_at = time.monotonic(), -math.inf

    def show(done: float, total: float) -> None:
        nonlocal told_at
        now = time.monotonic()
        pause_s = 0.1 if terminal else after_s
        if not 0 < done < total or now - begun < after_s or now - told_at < pause_s:
            return
        told_at, left = now, format_remaining_time((now - begun) * (total - done) / done)
        text = f"{done:.0f} of {total:.0f} {unit}, {left} left"
        # a terminal has a single line, rewritten
        sys.stderr.write(f"\r{text}\x1b[K" if terminal else f"{text}\n")
        sys.stderr.flush()

    try:
        yield show
    finally:
        if terminal and told_at > begun:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def format_remaining_time(seconds: float) -> str:
    """A time as a person says it: to a second, from two minutes on in minutes."""
    return f"about {seconds:.0f} s" if seconds < 120.0 else f"about {seconds / 60.0:.0f} min"


class SolveCounter:
    """Tells a `Progress` about solves with an expected number."""

    def __init__(self, progress: Progress, expected: int) -> None:
        self.progress, self.expected, self.done = progress, expected, 0

    def __call__(self) -> None:
        """One solve more."""
        self.done += 1
        self.progress(self.done, max(self.expected, self.done))


class TaskRunner:
    """Runs tasks on processes, and tells a `Progress` in seconds on a core.

    The rest is estimated from earlier tasks with the same function.
    """

    def __init__(self, processes: int | None = None, progress: Progress = ignore_progress) -> None:
        self.processes, self.progress = processes or -1, progress
        self.seconds: dict[str, list[float]] = {}  #: Of each task that is done, by function.

    def run(self, tasks: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        """What functions return for arguments, each a tuple with the function first, in order."""
        import joblib

        names = [function.__name__ for function, *_ in tasks]
        left = Counter(names)
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            parallel = joblib.Parallel(self.processes, return_as="generator")
            results = parallel(joblib.delayed(_timed)(*task) for task in tasks)
            for name, (result, seconds) in zip(names, results, strict=True):
                self.seconds.setdefault(name, []).append(seconds)
                left[name] -= 1
                if self.seconds.keys() >= left.keys():
                    done = sum(map(sum, self.seconds.values()))
                    ahead = sum(n * statistics.mean(self.seconds[kind]) for kind, n in left.items())
                    self.progress(done, done + ahead)
                yield result


def _timed(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Result of a function, and its CPU time in seconds."""
    begun = time.process_time()
    result = function(*arguments)
    return result, time.process_time() - begun
