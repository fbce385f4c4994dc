"""Where the time of a solve goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Clock:
    """Adds up the seconds of named stages."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self._stages[stage] = self._stages.get(stage, 0.0) + elapsed

    def seconds(self) -> dict[str, float]:
        """Seconds by stage, and ``total`` since the clock was made."""
        return {**self._stages, "total": time.perf_counter() - self._start}
