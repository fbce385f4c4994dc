"""What is computed for a figure: charges of scenes, and rows of tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.reporting.task import Rows, Task, key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solve import rest_forces
from pvdf_fem.sweeps.store import Record
from pvdf_fem.sweeps.workers import Died


class NothingToShow(Exception):  # noqa: N818
    """Too few scenes have charges, or a task has no rows; the text says why."""


class Solved:
    """Records by scene, and rows of tasks by their keys. Charges are in pC, NaN where a solve gave
    none."""

    def __init__(self, found: Mapping[Any, Record | Rows | Died]) -> None:
        self._found: Mapping[Any, Any] = found

    def rows(self, task: Task) -> Rows:
        """The rows of a task; raises `NothingToShow` where the task raised."""
        found: Rows | Died = self._found[key(task)]
        if isinstance(found, Died):
            raise NothingToShow(_told(task, found))
        return found

    def charges(self, scenes: Sequence[Scene], names: Sequence[str], reading: str) -> Array:
        """Charges (scenes, names) of electrodes."""
        rows = [self._row(scene, names, "charges_pC") for scene in scenes]
        values = np.array(rows, dtype=float).reshape(len(scenes), len(names))
        return values - rests(scenes, names) if reading == "change" else values

    def errors(self, scenes: Sequence[Scene], names: Sequence[str]) -> Array:
        """Estimated discretisation errors (scenes, names) of the charges."""
        rows = [self._row(scene, names, "charge_errors_pC") for scene in scenes]
        return np.array(rows, dtype=float).reshape(len(scenes), len(names))

    def table(
        self,
        scenes: Sequence[Scene],
        names: Sequence[str],
        reading: str,
        theirs: Array | None = None,
    ) -> pd.DataFrame:
        """A row for each scene and electrode, with the charges (scenes, names) of others."""
        ours = self.charges(scenes, names, reading)
        given = np.full(ours.shape, np.nan) if theirs is None else theirs
        columns = {"charge_pC": given, "computed_pC": ours, "error_pC": self.errors(scenes, names)}
        frame = pd.DataFrame({name: values.ravel() for name, values in columns.items()})
        frame["difference_percent"] = 100.0 * (frame.computed_pC / frame.charge_pC - 1.0)
        frame.insert(0, "electrode", list(names) * len(scenes))
        return frame

    def failures(self, scenes: Sequence[Scene], tasks: Sequence[Task]) -> list[str]:
        """Reasons why scenes have no charges, with the number of scenes, and tasks no rows."""
        found: dict[str, int] = {}
        for record in (self._found[scene] for scene in dict.fromkeys(scenes)):
            if not record.converged:
                reason = f"{record.status}: {record.reason}"
                found[reason] = found.get(reason, 0) + 1
        told = [f"{count} without charges: {reason}" for reason, count in found.items()]
        results = ((task, self._found[key(task)]) for task in tasks)
        return told + [_told(task, of) for task, of in results if isinstance(of, Died)]

    def _row(self, scene: Scene, names: Sequence[str], what: str) -> list[float]:
        record, film = self._found[scene], scene.film
        if not record.converged:
            return [np.nan] * len(names)
        how = film.d31_pC_N, film.d32_pC_N, scene.numerics.observable
        charges: dict[str, float] = getattr(record, what)(*how)
        return [charges.get(name, np.nan) for name in names]


def _told(task: Task, end: Died) -> str:
    return f"{type(task).__name__}: {end.reason}"


def rests(scenes: Sequence[Scene], names: Sequence[str]) -> Array:
    """Charges (scenes, names) of the films without a touch, in pC."""
    values = np.full((len(scenes), len(names)), np.nan)
    for row, scene in zip(values, scenes, strict=True):
        film = scene.film
        charges = rest_forces(scene, needed=False).charges((film.d31_pC_N, film.d32_pC_N))
        known = dict(zip((e.name for e in scene.electrode_list), charges.tolist(), strict=True))
        row[:] = [known.get(name, np.nan) for name in names]
    return values
