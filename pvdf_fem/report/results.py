"""Computed results of a report: charges by scene, and rows by task."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pvdf_fem.arrays import Array
from pvdf_fem.batch.store import Record
from pvdf_fem.batch.workers import WorkerDied
from pvdf_fem.report.task import Rows, Task, compute_key
from pvdf_fem.scene.scene import Scene


class NothingToShowError(Exception):
    """Too few scenes have charges, or a task has no rows; the text says why."""


class ReportResults:
    """The records of solved scenes, and the rows of completed tasks.

    Parameters
    ----------
    results : mapping
        Records by scene, and rows by the keys of tasks (`compute_key`). A failed task has
        `WorkerDied` instead of rows.
    """

    def __init__(self, results: Mapping[Any, Record | Rows | WorkerDied]) -> None:
        self._results: Mapping[Any, Any] = results

    def get_rows(self, task: Task) -> Rows:
        """Return the rows of a task.

        Raises
        ------
        NothingToShowError
            If the task failed.
        """
        rows: Rows | WorkerDied = self._results[compute_key(task)]
        if isinstance(rows, WorkerDied):
            raise NothingToShowError(_describe_failure(task, rows))
        return rows

    def get_charges(self, scenes: Sequence[Scene], names: Sequence[str], reading: str) -> Array:
        """Return the computed charges of electrodes by scene.

        Parameters
        ----------
        scenes : sequence of Scene, length n
            Solved scenes.
        names : sequence of str, length m
            Names of the electrodes.
        reading : {"total", "change"}
            Whether the charge of the unloaded film is subtracted.

        Returns
        -------
        ndarray, shape (n, m)
            In pC; NaN for a scene without charges or without the electrode.
        """
        charges = self._read_values_from_records(scenes, names, _read_charges)
        if reading == "change":
            return charges - self.get_unloaded_charges(scenes, names)
        return charges

    def get_unloaded_charges(self, scenes: Sequence[Scene], names: Sequence[str]) -> Array:
        """Return the charges of the unloaded films in pC, an array of shape (scenes, names)."""
        return self._read_values_from_records(scenes, names, _read_charges_without_load)

    def get_errors(self, scenes: Sequence[Scene], names: Sequence[str]) -> Array:
        """Return estimated discretisation errors in pC, an array of shape (scenes, names)."""
        return self._read_values_from_records(scenes, names, _read_charge_errors)

    def make_table(
        self,
        scenes: Sequence[Scene],
        names: Sequence[str],
        reading: str,
        data_pC: Array | None = None,
    ) -> pd.DataFrame:
        """Return computed charges beside charges of the data.

        Parameters
        ----------
        scenes : sequence of Scene, length n
            Solved scenes.
        names : sequence of str, length m
            Names of the electrodes.
        reading : {"total", "change"}
            Whether the charge of the unloaded film is subtracted.
        data_pC : ndarray, shape (n, m), optional
            Charges of the data, NaN where there is none.

        Returns
        -------
        DataFrame
            A row for each scene and electrode, n m in all, with the columns ``electrode``,
            ``charge_pC`` (of the data), ``computed_pC``, ``error_pC`` and ``difference_percent``
            (computed minus data, in percent of the data).
        """
        computed = self.get_charges(scenes, names, reading)
        if data_pC is None:
            data_pC = np.full(computed.shape, np.nan)
        frame = pd.DataFrame(
            {
                "electrode": list(names) * len(scenes),
                "charge_pC": data_pC.ravel(),
                "computed_pC": computed.ravel(),
                "error_pC": self.get_errors(scenes, names).ravel(),
            }
        )
        frame["difference_percent"] = 100.0 * (frame.computed_pC / frame.charge_pC - 1.0)
        return frame

    def describe_failures(self, scenes: Sequence[Scene], tasks: Sequence[Task]) -> list[str]:
        """Describe why scenes have no charges and tasks have no rows.

        Parameters
        ----------
        scenes : sequence of Scene
            Solved scenes.
        tasks : sequence of Task
            Completed tasks.

        Returns
        -------
        list of str
            A line for each distinct reason with the number of scenes, then a line for each failed
            task.
        """
        reasons: Counter[str] = Counter()
        for scene in dict.fromkeys(scenes):
            record: Record = self._results[scene]
            if not record.converged:
                reasons[f"{record.status}: {record.reason}"] += 1
        lines = [f"{count} without charges: {reason}" for reason, count in reasons.items()]
        for task in tasks:
            rows = self._results[compute_key(task)]
            if isinstance(rows, WorkerDied):
                lines.append(_describe_failure(task, rows))
        return lines

    def describe_warnings(self, scenes: Sequence[Scene]) -> list[str]:
        """Return one line with the number of scenes with warnings and an example.

        The list is empty if no scene has warnings.
        """
        first_warnings = []
        for scene in dict.fromkeys(scenes):
            warnings = [*scene.warnings, *self._results[scene].warnings]
            if warnings:
                first_warnings.append(warnings[0])
        if not first_warnings:
            return []
        count = len(first_warnings)
        return [f"{count} of the scenes have warnings, such as: {first_warnings[0]}"]

    def _read_values_from_records(
        self,
        scenes: Sequence[Scene],
        names: Sequence[str],
        read: Callable[[Record, Scene], Array],
    ) -> Array:
        """Read a value of each electrode from the records of scenes.

        Parameters
        ----------
        scenes : sequence of Scene, length n
            Solved scenes.
        names : sequence of str, length m
            Names of the electrodes.
        read : callable
            Returns the values of a record's electrodes, shape (electrodes,).

        Returns
        -------
        ndarray, shape (n, m)
            NaN for electrodes that a scene does not have.
        """
        values = np.full((len(scenes), len(names)), np.nan)
        for i, scene in enumerate(scenes):
            record = self._results[scene]
            by_name = dict(zip(record.electrodes, read(record, scene).tolist(), strict=True))
            for j, name in enumerate(names):
                values[i, j] = by_name.get(name, np.nan)
        return values


def _get_coefficients(scene: Scene) -> tuple[float, float]:
    """Return d31 and d32 in pC/N."""
    return scene.film.d31_pC_N, scene.film.d32_pC_N


def _read_charges(record: Record, scene: Scene) -> Array:
    """Return the charges of a record's electrodes in pC, by the scene's observable."""
    integrals = record.integrals_by(str(scene.numerics.observable))
    return integrals.charges(_get_coefficients(scene))


def _read_charges_without_load(record: Record, scene: Scene) -> Array:
    """Return the charges of a record's electrodes in pC on the unloaded film."""
    return record.unloaded.charges(_get_coefficients(scene))


def _read_charge_errors(record: Record, scene: Scene) -> Array:
    """Return the estimated errors of a record's charges in pC, by electrode."""
    integrals = record.integrals_by(str(scene.numerics.observable))
    return integrals.charge_errors(_get_coefficients(scene))


def _describe_failure(task: Task, failure: WorkerDied) -> str:
    """Return the class name of a task and the reason of its failure."""
    return f"{type(task).__name__}: {failure.reason}"
