"""The history of a solve: a record of each mesh, the reason for the last one, and the times."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Stop(StrEnum):
    """Reason why no further mesh was made."""

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
    """Summary of the solve on one mesh."""

    elements: int
    unknowns: int
    iterations: int  #: Number of Newton iterations that led to the result.
    #: Largest estimated relative error of a charge; None without convergence.
    worst_error: float | None
    seconds: float  #: Wall-clock time of meshing, solve and error estimate in s.
    status: str  #: A value of `Status`.
    #: Name, status and number of iterations of each solver that failed on this mesh.
    failed_attempts: tuple[tuple[str, str, int], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return a dict for JSON, with a list of dicts of the failed attempts under ``tried``."""
        row = dict(vars(self))
        row.pop("failed_attempts")
        row["tried"] = [
            {"solver": solver, "status": status, "iterations": iterations}
            for solver, status, iterations in self.failed_attempts
        ]
        return row


class StageTimer:
    """Timer that sums up the wall-clock time of named stages.

    Its instances are called in ``with`` statements: ``with timer("solve"): ...``.
    """

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time of a ``with`` block to a stage, even if the block raises an exception."""
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self._stages[stage] = self._stages.get(stage, 0.0) + elapsed

    def seconds(self) -> dict[str, float]:
        """Return seconds by stage, and as ``total`` the seconds since the timer was created."""
        return {**self._stages, "total": time.perf_counter() - self._start}
