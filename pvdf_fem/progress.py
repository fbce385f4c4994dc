"""Progress of long jobs: finished work and an estimate of the remaining time."""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

#: A function that is called with finished work and total work, in any unit. The total may change.
Progress = Callable[[float, float], None]

#: Seconds between two lines of progress if standard error is not a terminal.
LINE_INTERVAL_S = 2.0
#: Format of the progress bar on a terminal, with the variables of tqdm.
BAR_FORMAT = "{percentage:3.0f}% {bar:20} {n:.0f} of {total:.0f} {unit}, {remaining} left"


def ignore_progress(done: float, total: float) -> None:
    """Do nothing: the `Progress` of a silent job."""


@contextmanager
def show_progress(
    unit: str, requested: Progress | bool | None = None, after_s: float = 2.0
) -> Iterator[Progress]:
    """Show the progress of a job on standard error within this context.

    On a terminal this is a progress bar of tqdm, which disappears at the end. Otherwise it is a
    line every few seconds.

    Parameters
    ----------
    unit : str
        Unit of the work, such as "solves".
    requested : callable or bool, optional
        A callable is yielded unchanged, and nothing is shown on standard error. True always shows
        the progress, False never does, and None shows it if standard error is a terminal.
    after_s : float
        Time in seconds before anything is shown, so that short jobs are silent.

    Yields
    ------
    callable
        The `Progress` that the job calls with finished and total work.
    """
    if callable(requested):
        yield requested
        return
    on_terminal = sys.stderr is not None and sys.stderr.isatty()
    is_shown = on_terminal if requested is None else requested
    if sys.stderr is None or not is_shown:
        yield ignore_progress
    elif on_terminal:
        bar = _ProgressBar(unit, after_s)
        try:
            yield bar
        finally:
            bar.close()
    else:
        yield _ProgressLines(unit, after_s)


class _ProgressBar:
    """A progress bar of tqdm that appears after `after_s` seconds."""

    def __init__(self, unit: str, after_s: float) -> None:
        self.unit = unit
        self.after_s = after_s
        self.start = time.monotonic()
        self.bar: Any = None

    def __call__(self, done: float, total: float) -> None:
        """Show finished and total work."""
        if self.bar is None:
            elapsed_s = time.monotonic() - self.start
            if elapsed_s < self.after_s or not 0 < done < total:
                return
            self.bar = _open_bar(self.unit, elapsed_s)
            self.bar.total = total
            self.bar.n = done
            self.bar.refresh()
        self.bar.total = total
        self.bar.update(done - self.bar.n)

    def close(self) -> None:
        """Remove the bar from the terminal."""
        if self.bar is not None:
            self.bar.close()


def _open_bar(unit: str, elapsed_s: float) -> Any:
    """Make a bar of tqdm, not yet drawn, for a job that began `elapsed_s` seconds ago."""
    from tqdm import tqdm  # imported here, since most commands end before they show a bar

    class Bar(tqdm):  # type: ignore[misc]
        monitor_interval = 0  # no thread that redraws the bar

    bar = Bar(
        unit=unit,
        bar_format=BAR_FORMAT,
        leave=False,
        delay=1e-9,  # not drawn before its first refresh
        miniters=0,  # redrawn at intervals of time only
        smoothing=0.0,  # the remaining time follows from the mean speed since the start
    )
    bar.start_t -= elapsed_s
    return bar


class _ProgressLines:
    """Lines of progress on standard error, one every `LINE_INTERVAL_S` seconds."""

    def __init__(self, unit: str, after_s: float) -> None:
        self.unit = unit
        self.after_s = after_s
        self.start = time.monotonic()
        self.last_line = -math.inf

    def __call__(self, done: float, total: float) -> None:
        """Print a line with finished and total work, unless the last line is too recent."""
        now = time.monotonic()
        elapsed_s = now - self.start
        is_due = elapsed_s >= self.after_s and now - self.last_line >= LINE_INTERVAL_S
        if not is_due or not 0 < done < total:
            return
        self.last_line = now
        remaining = format_remaining_time(elapsed_s * (total - done) / done)
        print(f"{done:.0f} of {total:.0f} {self.unit}, {remaining} left", file=sys.stderr)


def format_remaining_time(seconds: float) -> str:
    """Format a duration in words: in seconds below two minutes, else in minutes."""
    if seconds < 120.0:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60.0:.0f} min"


class SolveCounter:
    """A counter of solves that reports each one to a `Progress`.

    Parameters
    ----------
    progress : callable
        The `Progress` to report to.
    expected : int
        Expected number of solves. If there are more, the reported total grows with them.
    """

    def __init__(self, progress: Progress, expected: int) -> None:
        self.progress = progress
        self.expected = expected
        self.done = 0

    def __call__(self) -> None:
        """Count one more solve, and report the number of solves."""
        self.done += 1
        self.progress(self.done, max(self.expected, self.done))


class TaskRunner:
    """A runner of tasks on several processes that reports CPU seconds to a `Progress`.

    The remaining work is estimated from the durations of finished tasks with the same function.

    Parameters
    ----------
    processes : int, optional
        Number of processes. Default: one per core.
    progress : callable
        The `Progress` to report to, in seconds of one core. Default: nothing is reported.
    """

    def __init__(self, processes: int | None = None, progress: Progress = ignore_progress) -> None:
        self.processes = processes
        self.progress = progress
        self.seconds: dict[str, list[float]] = {}  #: Durations of finished tasks, by function name.

    def run(self, tasks: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        """Run tasks, and yield their results in order.

        Parameters
        ----------
        tasks : sequence of tuple
            Each task is a function followed by its arguments.

        Yields
        ------
        object
            The result of the next task, in the order of `tasks`.
        """
        import joblib

        names = [function.__name__ for function, *_ in tasks]
        waiting = Counter(names)
        all_cores = -1
        processes = all_cores if self.processes is None else self.processes
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            parallel = joblib.Parallel(processes, return_as="generator")
            results = parallel(joblib.delayed(_time_task)(*task) for task in tasks)
            for name, (result, seconds) in zip(names, results, strict=True):
                self.seconds.setdefault(name, []).append(seconds)
                waiting[name] -= 1
                self._report_task_seconds(waiting)
                yield result

    def _report_task_seconds(self, waiting: Counter[str]) -> None:
        """Report finished and expected seconds if a task of each function has finished.

        `waiting` is the number of unfinished tasks by function name.
        """
        if not self.seconds.keys() >= waiting.keys():
            return
        done_s = 0.0
        remaining_s = 0.0
        for name, durations in self.seconds.items():
            done_s += sum(durations)
            remaining_s += waiting[name] * sum(durations) / len(durations)
        self.progress(done_s, done_s + remaining_s)


def _time_task(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Call a function, and return its result and its CPU time in seconds."""
    start = time.process_time()
    result = function(*arguments)
    return result, time.process_time() - start
