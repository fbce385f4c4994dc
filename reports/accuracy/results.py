"""What was measured, as tables: a row for each charge of each solve, beside what is known of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd

from pvdf_fem.report.data import Name
from pvdf_fem.report.kind import Inputs, Kind
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.scene import Scene
from reports.accuracy.cases import Case, cases
from reports.accuracy.drawn import finer
from reports.accuracy.measure import ByNGSolve, Known, Timed

OURS, PEER = "pvdf_fem", "NGSolve"
#: A difference tells the true error if it is this multiple of the doubt about what is known.
TELLING = 2.0
PREVIEW = (1e-2, 1e-3)  #: Tolerances of a preview.


class OfCases(Kind):
    """A kind about the cases of a `file`, by default all of them, solved to `tolerances`, with the
    medians of `rounds` solves; NGSolve solves them in `orders` on meshes of sizes times `factors`.
    """

    file: str = "cases.toml"
    only: tuple[Name, ...] = ()
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5)
    rounds: int = 3
    orders: tuple[int, ...] = ()
    factors: tuple[float, ...] = (1.0,)

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """None: solves whose time is measured are tasks."""
        return []

    def chosen(self, inputs: Inputs) -> list[Case]:
        """The cases, of which a preview has a few."""
        every = [case for case in cases(self.file) if not self.only or case.name in self.only]
        return [case for case in every if case.preview] if inputs.quick else every

    def solves(self, case: Case, inputs: Inputs) -> dict[float, Timed]:
        """The solves of a case by tolerance."""
        asked = PREVIEW if inputs.quick else self.tolerances
        rounds = 1 if inputs.quick else self.rounds
        return {
            tolerance: Timed(case.scene.with_(**{"numerics.tolerance": tolerance}), rounds)
            for tolerance in asked
            if tolerance >= case.finest
        }

    def peers(self, case: Case, inputs: Inputs) -> list[ByNGSolve]:
        """What NGSolve solves of a case."""
        if not (case.peer and self.orders and find_spec("ngsolve")):
            return []
        rounds = 1 if inputs.quick else 2
        return [ByNGSolve(case.scene, self.orders, self.factors, rounds)]

    def list_tasks(self, inputs: Inputs) -> Sequence[Task]:
        """What is known of each case, and all solves."""
        found: list[Task] = []
        for case in self.chosen(inputs):
            found += filter(None, [truth_of(case)])
            found += [*self.solves(case, inputs).values(), *self.peers(case, inputs)]
        return found

    def frame(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """A row for each charge of each completed solve; `NothingToShowError` without any."""
        rows = [row for case in self.chosen(inputs) for row in self._rows(case, inputs, results)]
        if not rows:
            raise NothingToShowError("no case has both a solve and charges that are known")
        return with_errors(pd.DataFrame(rows))

    def _rows(self, case: Case, inputs: Inputs, results: ReportResults) -> Iterator[dict[str, Any]]:
        about: dict[str, Any] = {"case": case.name, "source": case.source}
        known: dict[str, tuple[float, float]] = {}
        with suppress(NothingToShowError):  # the reason stands below the figure
            known = known_of(case, results)
        runs: list[tuple[Task, dict[str, Any]]] = [
            (task, {"code": OURS, "tolerance": tolerance})
            for tolerance, task in self.solves(case, inputs).items()
        ]
        runs += [(task, {"code": PEER}) for task in self.peers(case, inputs)]
        for task, how in runs:
            with suppress(NothingToShowError):
                for row in results.get_rows(task):
                    charge, doubt = known.get(row.get("electrode") or "", (np.nan, np.nan))
                    yield {**about, **how, **row, "known_pC": charge, "doubt_pC": doubt}


def truth_of(case: Case) -> Task | None:
    """The task that tells the charges of a case; None where other codes told them."""
    if case.truth == "codes":
        return None
    return Timed(case.finer) if case.truth == "finer" else Known(case.scene, case.truth)


def known_of(case: Case, results: ReportResults) -> dict[str, tuple[float, float]]:
    """Charges that are known and the doubt about them in pC, by electrode."""
    task = truth_of(case)
    rows: Rows = [{"electrode": k, "charge_pC": q} for k, q in case.charges_pC.items()]
    if task is not None:
        rows = [row for row in results.get_rows(task) if "electrode" in row]
    return {
        row["electrode"]: (row["charge_pC"], row.get("stated_pC", case.doubt * row["charge_pC"]))
        for row in rows
    }


def with_errors(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with true and stated errors relative to the charge, and whether the true one is
    told by what is known."""
    frame = frame.reindex(columns=[*dict.fromkeys([*frame.columns, "charge_pC", "stated_pC"])])
    size, error = frame.known_pC.abs(), (frame.charge_pC - frame.known_pC).abs()
    return frame.assign(
        true=error / size,
        stated=frame.stated_pC / size,
        telling=error > TELLING * frame.doubt_pC.abs(),
    )


def worst(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each solve: that of the charge with the largest true error."""
    by = [name for name in ("case", "code", "tolerance", "order", "mesh") if name in frame]
    converged = frame[frame.true.notna()]
    return converged.loc[converged.groupby(by, dropna=False, sort=False).true.idxmax()]


def of_drawn(scene: Scene, results: ReportResults) -> pd.DataFrame:
    """The errors of a drawn scene, a row for each electrode."""
    names, pair = [electrode.name for electrode in scene.electrode_list], [scene, finer(scene)]
    charges, known = results.get_charges(pair, names, "total")
    stated, doubt = results.get_errors(pair, names)
    table = {"electrode": names, "charge_pC": charges, "stated_pC": stated}
    table |= {"known_pC": known, "doubt_pC": doubt}
    return with_errors(pd.DataFrame(table)).assign(tolerance=scene.numerics.tolerance)
