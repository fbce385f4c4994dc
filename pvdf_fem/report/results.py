"""Computed data for a figure: charges by scene, and rows by task."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.batch.store import Record
from pvdf_fem.batch.workers import WorkerDied
from pvdf_fem.report.task import Rows, Task, compute_key
from pvdf_fem.scene.scene import Scene

#: What reads a record, by an observable: values by electrode for d31 and d32.
Reader: TypeAlias = Callable[[Record, str], Callable[[tuple[float, float]], Array]]


class NothingToShowError(Exception):
    """Too few scenes have charges, or a task has no rows; the text says why."""


class ReportResults:
    """Records by scene, and rows of tasks by their keys. Charges are in pC, NaN where a solve gave
    none."""

    def __init__(self, found: Mapping[Any, Record | Rows | WorkerDied]) -> None:
        self._found: Mapping[Any, Any] = found

    def rows(self, task: Task) -> Rows:
        """The rows of a task; raises `NothingToShowError` where the task raised."""
        found: Rows | WorkerDied = self._found[compute_key(task)]
        if isinstance(found, WorkerDied):
            raise NothingToShowError(_told(task, found))
        return found

    def charges(self, scenes: Sequence[Scene], names: Sequence[str], reading: str) -> Array:
        """Charges (scenes, names) of electrodes."""
        totals = self._values(scenes, names, lambda record, of: record.integrals_by(of).charges)
        return totals - self.rests(scenes, names) if reading == "change" else totals

    def rests(self, scenes: Sequence[Scene], names: Sequence[str]) -> Array:
        """Charges (scenes, names) of the films without a touch."""
        return self._values(scenes, names, lambda record, _: record.unloaded.charges)

    def errors(self, scenes: Sequence[Scene], names: Sequence[str]) -> Array:
        """Estimated discretisation errors (scenes, names) of the charges."""
        return self._values(scenes, names, lambda record, of: record.integrals_by(of).charge_errors)

    def table(
        self,
        scenes: Sequence[Scene],
        names: Sequence[str],
        reading: str,
        theirs: Array | None = None,
    ) -> pd.DataFrame:
        """Rows by scene and electrode, with data charges (scenes, names)."""
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
        results = ((task, self._found[compute_key(task)]) for task in tasks)
        return told + [_told(task, of) for task, of in results if isinstance(of, WorkerDied)]

    def warnings(self, scenes: Sequence[Scene]) -> list[str]:
        """How many scenes have warnings, and the first warning."""
        every = ((*one.warnings, *self._found[one].warnings) for one in dict.fromkeys(scenes))
        warned = [told for told in every if told]
        if not warned:
            return []
        return [f"{len(warned)} of the scenes have warnings, such as: {warned[0][0]}"]

    def _values(self, scenes: Sequence[Scene], names: Sequence[str], what: Reader) -> Array:
        values = np.full((len(scenes), len(names)), np.nan)
        for row, scene in zip(values, scenes, strict=True):
            record, d = self._found[scene], (scene.film.d31_pC_N, scene.film.d32_pC_N)
            found = what(record, str(scene.numerics.observable))(d).tolist()
            known = dict(zip(record.electrodes, found, strict=True))
            row[:] = [known.get(name, np.nan) for name in names]
        return values


def _told(task: Task, end: WorkerDied) -> str:
    return f"{type(task).__name__}: {end.reason}"
