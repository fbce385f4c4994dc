"""Kinds of the report on accuracy: true errors against time, stated errors, stages, a sweep.

./run report accuracy
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import ClassVar, Literal

import numpy as np
import pandas as pd

from pvdf_fem.report.kind import Content, Inputs, Kind
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.scene import Scene
from reports.accuracy.cases import FINER, SOURCES, Case
from reports.accuracy.drawn import KINDS, drawn_scenes, finer
from reports.accuracy.figures import (
    HIGH,
    LOW,
    beside_peer,
    errors_against_time,
    group_row,
    percent,
    seconds,
    share,
    stage_bars,
    stated_against_true,
)
from reports.accuracy.measure import STAGES, Swept
from reports.accuracy.results import OURS, PEER, TELLING, OfCases, of_drawn, worst

ASKED = 1e-3  #: The tolerance of the verdict.


class ErrorVsTime(OfCases):
    """The true error of the worst charge against processor seconds, a curve for each case."""

    kind: Literal["error-vs-time"]

    stem: ClassVar[str] = "error-vs-time"
    rank: ClassVar[int] = 0

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Curves, the medians of all cases, and a table by tolerance."""
        frame = self.frame(inputs, results)
        runs = worst(frame)
        caption = (
            "Every curve is a case solved to tolerances from 1 % down; seconds are of one thread, "
            "with mesh and error estimate. True errors are against charges that are known by other "
            f"means, or by a solve that is {FINER:g} times finer."
        )
        groups = [rows for _, rows in frame.groupby("tolerance")][::-1]
        shown = pd.DataFrame([self._row(rows, runs) for rows in groups])
        return Content(caption, frame, errors_against_time(runs), shown, self._claim(runs))

    def _row(self, rows: pd.DataFrame, runs: pd.DataFrame) -> dict[str, str]:
        tolerance = float(rows.tolerance.iloc[0])
        found = runs[runs.tolerance == tolerance]
        return {
            "tolerance": percent(tolerance),
            "within it": f"{(found.true <= tolerance).sum()} of {rows.case.nunique()}",
            "worst error": percent(found.true.max()),
            "median s": seconds(found.seconds.median()),
            "longest s": seconds(found.seconds.max()),
        }

    def _claim(self, runs: pd.DataFrame) -> str:
        found = runs[runs.tolerance == ASKED]
        if found.empty:
            return ""
        met = "all" if (found.true <= ASKED).all() else (found.true <= ASKED).sum()
        return (
            f"a charge to {percent(ASKED)} takes {seconds(found.seconds.median())} s of one core "
            f"in the median of {len(found)} cases and {seconds(found.seconds.max())} s at most, "
            f"and {met} of them are as exact as that"
        )


class StatedErrors(OfCases):
    """Stated errors against true ones: of all cases, and of `count` drawn scenes of each kind."""

    kind: Literal["stated-errors"]
    count: int = 8

    stem: ClassVar[str] = "stated-errors"
    rank: ClassVar[int] = 1

    def drawn(self, inputs: Inputs) -> dict[str, list[Scene]]:
        """Drawn scenes by their kinds."""
        kinds, count = (list(KINDS)[:2], 1) if inputs.quick else (list(KINDS), self.count)
        return {kind: list(drawn_scenes(kind, count)) for kind in kinds}

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """All drawn scenes, each with a finer one."""
        drawn = [scene for scenes in self.drawn(inputs).values() for scene in scenes]
        return drawn + [finer(scene) for scene in drawn]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """A dot for each charge, and a table by groups."""
        known = self.frame(inputs, results)
        pieces = [known[known.code == OURS].assign(group="cases")]
        for kind, scenes in self.drawn(inputs).items():
            pieces += [of_drawn(scene, results).assign(group=kind) for scene in scenes]
        columns = ["group", "tolerance", "electrode", "true", "stated", "telling"]
        frame = pd.concat([piece[columns] for piece in pieces], ignore_index=True)
        told = frame[frame.telling].assign(ratio=frame.stated / frame.true)
        caption = (
            "A dot for each charge, both errors over the tolerance. Charges whose true error is "
            f"below {TELLING:g} times the doubt about it are left out. Lines: stated errors of "
            f"{LOW:g}, 1 and {HIGH:g} times the true ones."
        )
        groups = [of for _, of in told.groupby("group", sort=False)]
        shown = pd.DataFrame([group_row(of) for of in [*groups, told.assign(group="all")]])
        claim = (
            f"stated errors are {LOW:g} to {HIGH:g} times the true ones in "
            f"{share(told.ratio, LOW, HIGH)} of {len(told)} charges, and smaller in "
            f"{share(told.ratio, 0.0, LOW)}"
        )
        return Content(caption, frame, stated_against_true(told), shown, claim)


class CaseTable(OfCases):
    """What is known of each case, and by how much, beside the errors at the tolerances."""

    kind: Literal["cases"]

    stem: ClassVar[str] = "cases"

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """A row for each case."""
        frame = self.frame(inputs, results)
        rows, runs = [], worst(frame)
        for name, of in frame.groupby("case", sort=False):
            doubt = (of.doubt_pC / of.known_pC).abs().max()
            row = {"case": name, "known": SOURCES[of.source.iloc[0]], "to": percent(doubt)}
            found = runs[runs.case == name].set_index("tolerance")
            for tolerance in sorted(frame.tolerance.unique(), reverse=True):
                row[percent(tolerance)] = "–"
                if tolerance in found.index:
                    true, spent = found.true[tolerance], found.seconds[tolerance]
                    row[percent(tolerance)] = f"{percent(true)} in {seconds(spent)} s"
            rows.append(row)
        return Content("The worst charge at each tolerance.", frame, table=pd.DataFrame(rows))


class BesideNGSolve(OfCases):
    """True errors against seconds of this package and of NGSolve, a panel for each case, and the
    seconds of each to be within `errors`."""

    kind: Literal["beside-ngsolve"]
    errors: tuple[float, ...] = (1e-3, 1e-4)

    stem: ClassVar[str] = "beside-ngsolve"

    def chosen(self, inputs: Inputs) -> list[Case]:
        """The cases that NGSolve solves."""
        return [case for case in super().chosen(inputs) if case.peer]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Panels of the cases, and the seconds to be within `errors`."""
        names = [case.name for case in self.chosen(inputs)]
        frame = self.frame(inputs, results)
        runs = worst(frame)
        table, told = self._table(runs, names)
        caption = (
            "NGSolve's orders on Netgen's curved meshes, of which the best are drawn, chosen "
            "afterwards and without error estimates; this package finds its mesh and its error "
            f"itself. One thread, no imports. {told}"
        )
        if find_spec("ngsolve") is None:
            caption = "NGSolve is not installed, and left out: pip install 'pvdf-fem[peers]'."
        return Content(caption, frame, beside_peer(runs, names), table)

    def _table(self, runs: pd.DataFrame, names: Sequence[str]) -> tuple[pd.DataFrame | None, str]:
        """Seconds of the fastest runs that are within `errors`, and the median ratios in words."""
        rows, ratios = [], dict[float, list[float]]()
        for name in names:
            row = {"case": name}
            for error in self.errors:
                within = runs[(runs.case == name) & (runs.true <= error)]
                ours, theirs = (within[within.code == code].seconds.min() for code in (OURS, PEER))
                row[f"s to {percent(error)}"] = seconds(ours)
                row[f"{PEER}, {percent(error)}"] = seconds(theirs)
                if np.isfinite([ours, theirs]).all():
                    ratios.setdefault(error, []).append(theirs / ours)
            rows.append(row)
        if not ratios:
            return None, ""
        told = " and ".join(
            f"{np.median(of):.1f} times the time to {percent(error)} ({len(of)} cases)"
            for error, of in ratios.items()
        )
        return pd.DataFrame(rows), f"In the median {PEER} takes {told}."


class Stages(OfCases):
    """Seconds of mesh, solve and estimate of some cases."""

    kind: Literal["stages"]

    stem: ClassVar[str] = "stages"
    rank: ClassVar[int] = 2

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """A bar for each case and tolerance."""
        frame = self.frame(inputs, results).drop_duplicates(["case", "tolerance"])
        total = frame[list(STAGES)].sum()
        parts = ", ".join(f"{name} {total[name] / total.sum():.0%}" for name in STAGES)
        return Content(f"Of all these seconds: {parts}.", frame, stage_bars(frame))


class SweepCost(Kind):
    """Seconds of a scene in a sweep, and alone, by tolerance."""

    kind: Literal["sweep-cost"]
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    places: int = 8

    stem: ClassVar[str] = "sweep-cost"

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """None: a sweep whose time is measured is a task."""
        return []

    def list_tasks(self, inputs: Inputs) -> list[Swept]:
        """A sweep for each tolerance."""
        scene = self.resolve_scene(inputs)
        asked, places = (self.tolerances[:1], 2) if inputs.quick else (self.tolerances, self.places)
        return [Swept(scene.with_(**{"numerics.tolerance": of}), places) for of in asked]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """A row for each tolerance."""
        frame = pd.DataFrame(
            {"tolerance": task.scene.numerics.tolerance, **row}
            for task in self.list_tasks(inputs)
            for row in results.get_rows(task)
        )
        shown = {
            "tolerance": frame.tolerance.map(percent),
            "solves": [f"{row.solves} for {row.scenes} scenes" for row in frame.itertuples()],
            "ms in the sweep": (1e3 * frame.seconds).map("{:.1f}".format),
            "ms alone": (1e3 * frame.alone).map("{:.0f}".format),
            "ratio": (frame.alone / frame.seconds).map("{:.1f}".format),
        }
        return Content("Processor time of a scene.", frame, table=pd.DataFrame(shown))
