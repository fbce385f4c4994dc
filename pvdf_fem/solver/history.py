"""The history of a solve: a row for every mesh, why it ended, and where its time went."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Stop(StrEnum):
    """Why no further mesh was made."""

    ACCURATE = "every result is within the tolerance"
    GIVEN_MESH = "the mesh was given"
    SECONDS = "a finer mesh would need more work than numerics.max_seconds allows; raise it"
    UNKNOWNS = "a finer mesh would need more unknowns than numerics.max_unknowns allows; raise it"
    MESHES = "the largest number of meshes was made"
    MESH_FAILED = "gmsh could not make the next mesh"
    FINER_FAILED = "Newton's method failed on the next mesh"
    NO_EQUILIBRIUM = "there is no result on the last mesh"
    NO_MESH = "there is no mesh"


@dataclass(frozen=True)
class MeshRecord:
    """The solve on one mesh."""

    elements: int
    unknowns: int
    iterations: int  #: Newton iterations that led to the result.
    #: Largest estimated charge error, relative to the magnitude of its contributions; None without
    #: convergence.
    worst_error: float | None
    seconds: float  #: Wall-clock time of mesh, solve and estimate in s.
    status: str
    #: Solvers that failed before: name, status and number of iterations of each.
    failed_attempts: tuple[tuple[str, str, int], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the row as plain values for JSON, with the failed attempts under ``tried``."""
        row = {**vars(self)}
        row.pop("failed_attempts")
        row["tried"] = [
            {"solver": solver, "status": status, "iterations": iterations}
            for solver, status, iterations in self.failed_attempts
        ]
        return row


class StageTimer:
    """Wall-clock seconds of the stages of a solve, added up by name."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time that a ``with`` block takes to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self._stages[stage] = self._stages.get(stage, 0.0) + elapsed

    def seconds(self) -> dict[str, float]:
        """Return the seconds by stage, and as ``total`` those since the timer was made."""
        return {**self._stages, "total": time.perf_counter() - self._start}
