"""A process that answers requests, the newest first and the outdated never."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor

from pvdf_fem.sweeps.workers import ONE_THREAD, end_with

Done = Callable[[Any], None]


class Worker:
    """A process of its own for one function, with one request at a time.

    Each owner, such as a page in a browser, has one request that waits: the newest. A request that
    works for longer than `patience_s` after its owner asked again is given up with the process,
    which is replaced. `niceness` is that of the process.
    """

    def __init__(
        self, function: Callable[..., Any], patience_s: float = 1.0, niceness: int = 0
    ) -> None:
        self._function, self._patience, self._niceness = function, patience_s, niceness
        self._waiting: dict[Any, tuple[Done, tuple[Any, ...]]] = {}
        self._working: tuple[Any, float] | None = None  # whose request, and since when
        self._round = 0
        self._lock = threading.RLock()
        self._executor = self._started()

    def ask(self, owner: Any, done: Done, *arguments: Any) -> None:
        """Have the function's result, or its exception, given to `done`, in another thread."""
        with self._lock:
            self._waiting.pop(owner, None)
            self._waiting[owner] = done, arguments
            if self._working is None:
                self._next()
            elif self._working[0] == owner:
                left = self._working[1] + self._patience - time.monotonic()
                timer = threading.Timer(max(left, 0.0), self._give_up, [self._round, owner])
                timer.daemon = True
                timer.start()

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._waiting.clear()
            self._round += 1
            self._executor.shutdown(wait=False, kill_workers=True)

    def _started(self) -> ProcessPoolExecutor:
        start = os.getpid(), self._niceness
        return ProcessPoolExecutor(1, initializer=_start, initargs=start, env=ONE_THREAD)

    def _next(self) -> None:
        if not self._waiting:
            self._working = None
            return
        owner = next(iter(self._waiting))
        done, arguments = self._waiting.pop(owner)
        self._working, self._round = (owner, time.monotonic()), self._round + 1
        future = self._executor.submit(_answer, self._function, *arguments)
        future.add_done_callback(lambda f, number=self._round: self._finish(number, done, f))

    def _finish(self, number: int, done: Done, future: Any) -> None:
        with self._lock:
            if number != self._round:  # it was given up
                return
            if died := future.exception():
                self._executor = self._started()
            self._next()
        done(died or future.result())

    def _give_up(self, number: int, owner: Any) -> None:
        with self._lock:
            if number == self._round and self._working and owner in self._waiting:
                self._round += 1
                self._executor.shutdown(wait=False, kill_workers=True)
                self._executor = self._started()
                self._next()


def _start(parent: int, niceness: int) -> None:
    """Begin a process that ends with its parent."""
    end_with(parent)
    with suppress(AttributeError):  # not every system has it
        os.nice(niceness)


def _answer(function: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return function(*arguments)
    except Exception as error:
        return error
