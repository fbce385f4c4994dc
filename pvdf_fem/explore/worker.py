"""A process that works for pages, while they stay responsive."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from pvdf_fem.sweeps.workers import ONE_THREAD, end_with


class Worker:
    """A process for one function, with one thread of linear algebra and its own niceness."""

    def __init__(self, function: Callable[..., Any], niceness: int = 0) -> None:
        self.function, self.niceness, self._turn = function, niceness, asyncio.Lock()
        self._start()

    async def answer(self, wanted: Callable[[], bool], *arguments: Any) -> Any:
        """The function's result or exception; None unless it is wanted when its turn comes."""
        async with self._turn:
            if not wanted():
                return None
            try:
                return await asyncio.wrap_future(self._process.submit(self.function, *arguments))
            except TerminatedWorkerError as error:
                self._start()
                return error
            except Exception as error:
                return error

    def close(self) -> None:
        """End the process."""
        self._process.shutdown(wait=False, kill_workers=True)

    def _start(self) -> None:
        begin = {"initializer": _begin, "initargs": (os.getpid(), self.niceness)}
        self._process = ProcessPoolExecutor(1, env=ONE_THREAD, **begin)


def _begin(parent: int, niceness: int) -> None:
    end_with(parent)
    if hasattr(os, "nice"):  # not every system has it
        os.nice(niceness)
