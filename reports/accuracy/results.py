"""Tables of measured charges and times: a row for each charge of each solve."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pvdf_fem.report.data import Name
from pvdf_fem.report.kind import Inputs, Kind
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.task import Task
from pvdf_fem.scene.scene import Scene
from reports.accuracy.cases import Case, read_cases
from reports.accuracy.drawn import refine
from reports.accuracy.measure import KnownCharges, NGSolveRuns, TimedSolve

OURS = "pvdf_fem"
PEER = "NGSolve"
#: Smallest difference from a known charge that shows the true error, over the doubt about this.
RESOLVED_RATIO = 2.0
PREVIEW_TOLERANCES = (1e-2, 1e-3)
#: Columns by which solves are distinguished.
RUN_COLUMNS = ("case", "code", "tolerance", "order", "mesh")


class KnownCharge(NamedTuple):
    """A charge that is known, and the doubt about it, in pC."""

    charge_pC: float
    doubt_pC: float


UNKNOWN = KnownCharge(np.nan, np.nan)


class CaseKind(Kind):
    """A kind about the cases of a `file`, by default all of them, solved to `tolerances`.

    Times are medians of `rounds` solves. NGSolve solves the cases in `orders`, on meshes whose
    sizes are those of this package times `factors`.
    """

    file: str = "cases.toml"
    only: tuple[Name, ...] = ()
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5)
    rounds: int = 3
    orders: tuple[int, ...] = ()
    factors: tuple[float, ...] = (1.0,)

    def list_cases(self, inputs: Inputs) -> list[Case]:
        """Return the cases, a few of them in a preview."""
        cases = read_cases(self.file)
        if self.only:
            cases = [case for case in cases if case.name in self.only]
        if inputs.quick:
            cases = [case for case in cases if case.preview]
        return cases

    def list_solves(self, case: Case, inputs: Inputs) -> dict[float, TimedSolve]:
        """Return the solves of a case by tolerance."""
        tolerances = PREVIEW_TOLERANCES if inputs.quick else self.tolerances
        rounds = 1 if inputs.quick else self.rounds
        solves = {}
        for tolerance in tolerances:
            if tolerance >= case.finest:
                scene = case.scene.with_(**{"numerics.tolerance": tolerance})
                solves[tolerance] = TimedSolve(scene, rounds)
        return solves

    def list_peer_runs(self, case: Case, inputs: Inputs) -> list[NGSolveRuns]:
        """Return the runs of NGSolve for a case, none where it is not installed."""
        if not (case.peer and self.orders and find_spec("ngsolve")):
            return []
        rounds = 1 if inputs.quick else 2
        return [NGSolveRuns(case.scene, self.orders, factors=self.factors, rounds=rounds)]

    def list_tasks(self, inputs: Inputs) -> Sequence[Task]:
        """Return the tasks that give the known charges, and all runs."""
        tasks: list[Task] = []
        for case in self.list_cases(inputs):
            truth = make_truth_task(case)
            if truth is not None:
                tasks.append(truth)
            tasks += self.list_solves(case, inputs).values()
            tasks += self.list_peer_runs(case, inputs)
        return tasks

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return a row for each charge of each completed solve, with its errors.

        Parameters
        ----------
        inputs : Inputs
            The report's scene and data.
        results : ReportResults
            Rows of the tasks.

        Returns
        -------
        DataFrame
            Case, run, charge, and the columns of `add_errors`.

        Raises
        ------
        NothingToShowError
            Where no solve is completed.
        """
        rows = []
        for case in self.list_cases(inputs):
            rows += self._collect_case(case, inputs, results)
        if not rows:
            raise NothingToShowError("no case has both a solve and charges that are known")
        return add_errors(pd.DataFrame(rows))

    def _collect_case(
        self, case: Case, inputs: Inputs, results: ReportResults
    ) -> list[dict[str, Any]]:
        """Return the rows of a case."""
        known: dict[str, KnownCharge] = {}
        with suppress(NothingToShowError):  # the reason stands below the figure
            known = get_known_charges(case, results)
        runs: list[tuple[Task, dict[str, Any]]] = []
        for tolerance, task in self.list_solves(case, inputs).items():
            runs.append((task, {"code": OURS, "tolerance": tolerance}))
        for peer_task in self.list_peer_runs(case, inputs):
            runs.append((peer_task, {"code": PEER}))
        rows = []
        for run_task, run in runs:
            with suppress(NothingToShowError):
                for row in results.get_rows(run_task):
                    truth = known.get(row.get("electrode", ""), UNKNOWN)
                    about = {"case": case.name, "source": case.source, **run}
                    columns = {"known_pC": truth.charge_pC, "doubt_pC": truth.doubt_pC}
                    rows.append({**about, **row, **columns})
        return rows


def make_truth_task(case: Case) -> Task | None:
    """Return the task that gives the known charges of a case, None for charges of other codes."""
    if case.truth == "codes":
        return None
    if case.truth == "finer":
        return TimedSolve(case.finer)
    return KnownCharges(case.scene, case.truth)


def get_known_charges(case: Case, results: ReportResults) -> dict[str, KnownCharge]:
    """Return the known charges of a case by electrode."""
    task = make_truth_task(case)
    known = {}
    if task is None:
        for name, charge in case.charges_pC.items():
            known[name] = KnownCharge(charge, case.doubt * charge)
        return known
    for row in results.get_rows(task):
        if "electrode" in row:  # not so where a solve failed
            charge = row["charge_pC"]
            doubt = row.get("stated_pC", case.doubt * charge)
            known[row["electrode"]] = KnownCharge(charge, doubt)
    return known


def add_errors(frame: pd.DataFrame) -> pd.DataFrame:
    """Add the errors of charges to a table.

    Parameters
    ----------
    frame : DataFrame
        With the columns ``charge_pC``, ``stated_pC``, ``known_pC`` and ``doubt_pC``.

    Returns
    -------
    DataFrame
        Also with ``true`` and ``stated``, the errors over the known charge, and ``telling``,
        whether the true error is clearly larger than the doubt about the known charge.
    """
    columns = dict.fromkeys([*frame.columns, "charge_pC", "stated_pC"])
    frame = frame.reindex(columns=list(columns))
    size = frame.known_pC.abs()
    error = (frame.charge_pC - frame.known_pC).abs()
    return frame.assign(
        true=error / size,
        stated=frame.stated_pC / size,
        telling=error > RESOLVED_RATIO * frame.doubt_pC.abs(),
    )


def select_worst(frame: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each solve: that of the charge with the largest true error."""
    columns = [name for name in RUN_COLUMNS if name in frame]
    known = frame[frame.true.notna()]
    return known.loc[known.groupby(columns, dropna=False, sort=False).true.idxmax()]


def collect_drawn_scene(scene: Scene, results: ReportResults) -> pd.DataFrame:
    """Return the errors of a random scene beside its finer solve, a row for each electrode."""
    names = [electrode.name for electrode in scene.electrode_list]
    scenes = [scene, refine(scene)]
    charges, known = results.get_charges(scenes, names, "total")
    stated, doubt = results.get_errors(scenes, names)
    frame = pd.DataFrame(
        {
            "electrode": names,
            "charge_pC": charges,
            "stated_pC": stated,
            "known_pC": known,
            "doubt_pC": doubt,
        }
    )
    return add_errors(frame).assign(tolerance=scene.numerics.tolerance)
