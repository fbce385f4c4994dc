"""Kinds of the report on accuracy: true errors against time, stated errors, stages, a sweep.

./run report accuracy
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from pvdf_fem.report.kind import FigureKind, Inputs, Kind
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import WIDTH_MM
from reports.accuracy.cases import FINER, SOURCES, Case
from reports.accuracy.drawn import KINDS, draw_scenes, refine
from reports.accuracy.figures import (
    GOOD_HIGH,
    GOOD_LOW,
    draw_beside_peer,
    draw_errors_against_time,
    draw_stages,
    draw_stated_against_true,
    format_percent,
    format_seconds,
    format_share,
    make_bar_axes,
    make_case_panels,
    summarize_group,
)
from reports.accuracy.measure import STAGES, SweepTimes
from reports.accuracy.results import (
    OURS,
    PEER,
    RESOLVED_RATIO,
    CaseKind,
    collect_drawn_scene,
    select_worst,
)

VERDICT_TOLERANCE = 1e-3  #: The tolerance of the verdict.


class ErrorVsTime(CaseKind, FigureKind):
    """The true error of the worst charge against processor seconds, a curve for each case."""

    kind: Literal["error-vs-time"]

    stem: ClassVar[str] = "error-vs-time"
    rank: ClassVar[int] = 0
    size_mm: ClassVar[tuple[float, float]] = (WIDTH_MM, 92.0)

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw the cases and the medians."""
        draw_errors_against_time(axes, select_worst(data))

    def make_caption(self, data: pd.DataFrame) -> str:
        """Explain the curves, seconds and errors."""
        return (
            "Every curve is a case solved to tolerances from 1 % down; seconds are of one thread, "
            "with mesh and error estimate. True errors are differences from charges that are known "
            f"by other means, or from a solve that is {FINER:g} times finer."
        )

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return errors and seconds by tolerance."""
        runs = select_worst(data)
        rows = []
        for tolerance, charges in reversed(list(data.groupby("tolerance"))):
            solves = runs[runs.tolerance == tolerance]
            row = {
                "tolerance": format_percent(tolerance),
                "within it": f"{(solves.true <= tolerance).sum()} of {charges.case.nunique()}",
                "worst error": format_percent(solves.true.max()),
                "median s": format_seconds(solves.seconds.median()),
                "longest s": format_seconds(solves.seconds.max()),
            }
            rows.append(row)
        return pd.DataFrame(rows)

    def make_claim(self, data: pd.DataFrame) -> str:
        """Return seconds and errors at the tolerance of the verdict."""
        runs = select_worst(data)
        solves = runs[runs.tolerance == VERDICT_TOLERANCE]
        if solves.empty:
            return ""
        is_within = solves.true <= VERDICT_TOLERANCE
        accurate = "all" if is_within.all() else is_within.sum()
        return (
            f"a charge to {format_percent(VERDICT_TOLERANCE)} takes "
            f"{format_seconds(solves.seconds.median())} s of one core in the median of "
            f"{len(solves)} cases and {format_seconds(solves.seconds.max())} s at most, and "
            f"{accurate} of them are within this tolerance"
        )


@dataclass(frozen=True, eq=False)
class StatedErrorData:
    """Charges with their errors: all of them, and those whose true error is known."""

    frame: pd.DataFrame
    resolved: pd.DataFrame


class StatedErrors(CaseKind, FigureKind):
    """Stated errors against true ones: of all cases, and of `count` random scenes of each kind."""

    kind: Literal["stated-errors"]
    count: int = 8

    stem: ClassVar[str] = "stated-errors"
    rank: ClassVar[int] = 1
    size_mm: ClassVar[tuple[float, float]] = (WIDTH_MM, 100.0)

    def draw_random_scenes(self, inputs: Inputs) -> dict[str, list[Scene]]:
        """Return random scenes by kind, few of them in a preview."""
        kinds = list(KINDS)
        count = self.count
        if inputs.quick:
            kinds = kinds[:2]
            count = 1
        return {kind: list(draw_scenes(kind, count)) for kind in kinds}

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return all random scenes, and a finer one for each."""
        scenes = []
        for drawn in self.draw_random_scenes(inputs).values():
            scenes += drawn
        return scenes + [refine(scene) for scene in scenes]

    def collect_data(self, inputs: Inputs, results: ReportResults) -> StatedErrorData:
        """Return a row for each charge of the cases and of the random scenes."""
        cases = super().collect_data(inputs, results)
        frames = [cases[cases.code == OURS].assign(group="cases")]
        for kind, scenes in self.draw_random_scenes(inputs).items():
            for scene in scenes:
                frames.append(collect_drawn_scene(scene, results).assign(group=kind))
        columns = ["group", "tolerance", "electrode", "true", "stated", "telling"]
        frame = pd.concat([frame[columns] for frame in frames], ignore_index=True)
        resolved = frame[frame.telling]
        return StatedErrorData(frame, resolved.assign(ratio=resolved.stated / resolved.true))

    def draw(self, data: StatedErrorData, axes: Axes) -> None:
        """Draw a dot for each charge."""
        draw_stated_against_true(axes, data.resolved)

    def make_caption(self, data: StatedErrorData) -> str:
        """Explain the dots and lines."""
        return (
            "A dot for each charge, both errors over the tolerance. Charges whose true error is "
            f"below {RESOLVED_RATIO:g} times the doubt about it are left out. Lines: stated errors "
            f"of {GOOD_LOW:g}, 1 and {GOOD_HIGH:g} times the true ones."
        )

    def make_table(self, data: StatedErrorData) -> pd.DataFrame:
        """Return a row for each group, and one for all."""
        groups = [charges for _, charges in data.resolved.groupby("group", sort=False)]
        groups.append(data.resolved.assign(group="all"))
        return pd.DataFrame([summarize_group(charges) for charges in groups])

    def make_claim(self, data: StatedErrorData) -> str:
        """Return the shares of good and of too small stated errors."""
        ratios = data.resolved.ratio
        return (
            f"stated errors are {GOOD_LOW:g} to {GOOD_HIGH:g} times the true ones in "
            f"{format_share(ratios, GOOD_LOW, GOOD_HIGH)} of {len(ratios)} charges, and smaller in "
            f"{format_share(ratios, 0.0, GOOD_LOW)}"
        )


class CaseTable(CaseKind):
    """How the charges of each case are known, and how well, beside the errors of solves."""

    kind: Literal["cases"]

    stem: ClassVar[str] = "cases"

    def make_caption(self, data: pd.DataFrame) -> str:
        """Explain the errors."""
        return "The worst charge at each tolerance."

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return a row for each case."""
        runs = select_worst(data)
        tolerances = sorted(data.tolerance.unique(), reverse=True)
        rows = []
        for name, charges in data.groupby("case", sort=False):
            doubt = (charges.doubt_pC / charges.known_pC).abs().max()
            source = SOURCES[charges.source.iloc[0]]
            row = {"case": name, "known": source, "to": format_percent(doubt)}
            solves = runs[runs.case == name].set_index("tolerance")
            for tolerance in tolerances:
                text = "–"
                if tolerance in solves.index:
                    error = format_percent(solves.true[tolerance])
                    text = f"{error} in {format_seconds(solves.seconds[tolerance])} s"
                row[format_percent(tolerance)] = text
            rows.append(row)
        return pd.DataFrame(rows)


@dataclass(frozen=True, eq=False)
class PeerData:
    """Charges of the cases that NGSolve solves, and the names of the cases."""

    frame: pd.DataFrame
    names: list[str]


class BesideNGSolve(CaseKind, FigureKind):
    """True errors against seconds of this package and of NGSolve, a panel for each case.

    The table has the seconds of each code to be within `errors`.
    """

    kind: Literal["beside-ngsolve"]
    errors: tuple[float, ...] = (1e-3, 1e-4)

    stem: ClassVar[str] = "beside-ngsolve"

    def list_cases(self, inputs: Inputs) -> list[Case]:
        """Return the cases that NGSolve solves."""
        return [case for case in super().list_cases(inputs) if case.peer]

    def collect_data(self, inputs: Inputs, results: ReportResults) -> PeerData:
        """Return a row for each charge of each solve."""
        names = [case.name for case in self.list_cases(inputs)]
        return PeerData(super().collect_data(inputs, results), names)

    def make_axes(self, data: PeerData) -> list[Axes]:
        """Return a panel for each case."""
        return make_case_panels(len(data.names))

    def draw(self, data: PeerData, axes: Sequence[Axes]) -> None:
        """Draw the best runs of both codes."""
        draw_beside_peer(axes, select_worst(data.frame), data.names)

    def make_caption(self, data: PeerData) -> str:
        """Explain the comparison, and give the median ratios of the times."""
        if find_spec("ngsolve") is None:
            return "NGSolve is not installed, and left out: pip install 'pvdf-fem[peers]'."
        caption = (
            "Of NGSolve's orders on Netgen's curved meshes the best are drawn, chosen afterwards "
            "and without error estimates; this package finds its mesh and its error itself. One "
            "thread, no imports. "
        )
        ratios = []
        for error in self.errors:
            times = self._find_times(data, error)
            both = [ours_theirs for ours_theirs in times if np.isfinite(ours_theirs).all()]
            if both:
                ratio = np.median([theirs / ours for ours, theirs in both])
                percent = format_percent(error)
                ratios.append(f"{ratio:.1f} times the time to {percent} ({len(both)} cases)")
        if ratios:
            caption += f"In the median {PEER} takes {' and '.join(ratios)}."
        return caption

    def make_table(self, data: PeerData) -> pd.DataFrame | None:
        """Return the seconds of both codes to be within the errors."""
        columns: dict[str, list[str]] = {"case": data.names}
        is_compared = False
        for error in self.errors:
            times = self._find_times(data, error)
            is_compared = is_compared or any(np.isfinite(pair).all() for pair in times)
            percent = format_percent(error)
            columns[f"s to {percent}"] = [format_seconds(ours) for ours, _ in times]
            columns[f"{PEER}, {percent}"] = [format_seconds(theirs) for _, theirs in times]
        return pd.DataFrame(columns) if is_compared else None

    def _find_times(self, data: PeerData, error: float) -> list[tuple[float, float]]:
        """Return the seconds of both codes' fastest runs within an error, for each case."""
        runs = select_worst(data.frame)
        times = []
        for name in data.names:
            within = runs[(runs.case == name) & (runs.true <= error)]
            ours = within[within.code == OURS].seconds.min()
            theirs = within[within.code == PEER].seconds.min()
            times.append((ours, theirs))
        return times


class Stages(CaseKind, FigureKind):
    """Seconds of mesh, solve and estimate of some cases."""

    kind: Literal["stages"]

    stem: ClassVar[str] = "stages"
    rank: ClassVar[int] = 2

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return a row for each solve."""
        charges = super().collect_data(inputs, results)
        return charges.drop_duplicates(["case", "tolerance"])

    def make_axes(self, data: pd.DataFrame) -> Axes:
        """Return axes with room for the bars."""
        return make_bar_axes(len(data))

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw a bar for each case and tolerance."""
        draw_stages(axes, data)

    def make_caption(self, data: pd.DataFrame) -> str:
        """Return the shares of the stages in all seconds."""
        total = data[list(STAGES)].sum()
        shares = [f"{stage} {total[stage] / total.sum():.0%}" for stage in STAGES]
        return f"Of all these seconds: {', '.join(shares)}."


class SweepCost(Kind):
    """Seconds of a scene in a sweep, and alone, by tolerance."""

    kind: Literal["sweep-cost"]
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    places: int = 8

    stem: ClassVar[str] = "sweep-cost"

    def list_tasks(self, inputs: Inputs) -> list[SweepTimes]:
        """Return a sweep for each tolerance."""
        scene = self.resolve_scene(inputs)
        tolerances = self.tolerances[:1] if inputs.quick else self.tolerances
        places = 2 if inputs.quick else self.places
        tasks = []
        for tolerance in tolerances:
            changed = scene.with_(**{"numerics.tolerance": tolerance})
            tasks.append(SweepTimes(changed, places))
        return tasks

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return a row for each tolerance."""
        rows = []
        for task in self.list_tasks(inputs):
            for row in results.get_rows(task):
                rows.append({"tolerance": task.scene.numerics.tolerance, **row})
        return pd.DataFrame(rows)

    def make_caption(self, data: pd.DataFrame) -> str:
        """Explain the times."""
        return "Processor time of a scene."

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the times in milliseconds."""
        return pd.DataFrame(
            {
                "tolerance": data.tolerance.map(format_percent),
                "solves": [f"{row.solves} for {row.scenes} scenes" for row in data.itertuples()],
                "ms in the sweep": (1e3 * data.seconds).map("{:.1f}".format),
                "ms alone": (1e3 * data.alone).map("{:.0f}".format),
                "ratio": (data.alone / data.seconds).map("{:.1f}".format),
            }
        )
