"""Kinds of the report on accuracy: true errors against time, stated errors, stages, a sweep.

./run report accuracy
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from pvdf_fem.output.figures import COLOURS, GREY, HALO, LABEL_SIZE, new_figure
from pvdf_fem.reporting.drawing import WIDTH_MM
from pvdf_fem.reporting.kind import Content, Inputs, Kind
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.reporting.task import Task
from pvdf_fem.scene.scene import Scene
from reports.accuracy.cases import FINER, SOURCES
from reports.accuracy.drawn import KINDS, drawn_scenes
from reports.accuracy.measure import STAGES, Swept
from reports.accuracy.results import OURS, PEER, TELLING, OfCases, with_errors, worst

LOW, HIGH = 0.3, 3.0  #: Between these multiples of the true error a stated error is a good one.
ASKED = 1e-3  #: The tolerance of the verdict.
LEAST = 1e-8  #: The smallest error that is drawn.
COLOUR = dict(zip(SOURCES, COLOURS, strict=False))


class ErrorVsTime(OfCases):
    """The true error of the worst charge against processor seconds, a curve for each case."""

    kind: Literal["error-vs-time"]

    stem: ClassVar[str] = "error-vs-time"
    rank: ClassVar[int] = 0

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """Curves, the medians of all cases, and a table by tolerance."""
        frame = self.frame(inputs, solved)
        runs = worst(frame)
        figure = new_figure(WIDTH_MM, 92.0)
        ax = figure.subplots()
        for _, rows in runs.groupby("case", sort=False):
            look = {"color": COLOUR[rows.source.iloc[0]], "linewidth": 0.8, "alpha": 0.7}
            ax.plot(rows.seconds, rows.true.clip(LEAST), "o-", markersize=2.2, **look)
        for source, colour in COLOUR.items():
            ax.plot([], [], color=colour, label=f"known by {SOURCES[source]}")
        medians = runs.groupby("tolerance")[["seconds", "true"]].median()
        ax.plot(medians.seconds, medians.true, "ks", markersize=5.0, label="medians")
        for tolerance, row in medians.iterrows():
            about: dict[str, Any] = {"textcoords": "offset points", "path_effects": [HALO]}
            words = f"asked for {percent(float(str(tolerance)))}"
            ax.annotate(words, (row.seconds, row.true), (7, 3), fontsize=LABEL_SIZE, **about)
        ax.set(xscale="log", yscale="log", xlabel="processor seconds")
        ax.set_ylabel("true relative error of the worst charge")
        ax.legend()
        caption = (
            "Every curve is a case solved to tolerances from 1 % down; seconds are of one thread, "
            "with mesh and error estimate. True errors are against charges that are known by other "
            f"means, or by a solve that is {FINER:g} times finer."
        )
        shown = pd.DataFrame([self._row(rows, runs) for rows in by(frame, "tolerance")])
        return Content(caption, frame, figure, shown, claim=self._claim(runs))

    def _row(self, rows: pd.DataFrame, runs: pd.DataFrame) -> dict[str, str]:
        tolerance = float(rows.tolerance.iloc[0])
        found = runs[runs.tolerance == tolerance]
        asked = rows.case.nunique()
        return {
            "tolerance": percent(tolerance),
            "cases": str(asked),
            "within it": str(int((found.true <= tolerance).sum())),
            "worst error": percent(found.true.max()),
            "median error": percent(found.true.median()),
            "median s": f"{found.seconds.median():.2f}",
            "longest s": f"{found.seconds.max():.2f}",
        }

    def _claim(self, runs: pd.DataFrame) -> str:
        found = runs[runs.tolerance == ASKED]
        if found.empty:
            return ""
        met = int((found.true <= ASKED).sum())
        return (
            f"a charge to {percent(ASKED)} takes {found.seconds.median():.2f} s of one core in the "
            f"median of {len(found)} cases, {found.seconds.max():.2g} s at most, and {met} of them "
            "are within it"
        )


class StatedErrors(OfCases):
    """Stated errors against true ones: of all cases, and of `count` drawn scenes of each kind."""

    kind: Literal["stated-errors"]
    count: int = 8

    stem: ClassVar[str] = "stated-errors"
    rank: ClassVar[int] = 1

    def drawn(self, inputs: Inputs) -> dict[str, list[tuple[Scene, Scene]]]:
        """Drawn scenes with finer ones by their kinds."""
        count = 1 if inputs.quick else self.count
        return {
            kind: [(scene, finer(scene)) for scene in drawn_scenes(kind, count)]
            for kind in list(KINDS)[: 2 if inputs.quick else None]
        }

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """All drawn scenes."""
        return [scene for of in self.drawn(inputs).values() for pair in of for scene in pair]

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A dot for each charge, and a table by groups."""
        known = self.frame(inputs, solved)
        known = known[known.code == OURS].assign(group="cases")
        pieces = [known, *self._of_drawn(inputs, solved)]
        columns = ["group", "case", "tolerance", "electrode", "true", "stated", "telling"]
        frame = pd.concat([piece[columns] for piece in pieces if len(piece)])
        told = frame[frame.telling].assign(ratio=frame.stated / frame.true)
        figure = new_figure(WIDTH_MM, 100.0)
        draw_stated(figure.subplots(), told)
        good, below = share(told.ratio, LOW, HIGH), share(told.ratio, 0.0, LOW)
        caption = (
            "A dot for each charge whose true error is told: known to less than "
            f"1/{TELLING:g} of it. Lines: stated errors of 0.3, 1 and 3 times the true ones."
        )
        rows = [group_row(of) for of in [*by(told, "group"), told.assign(group="all")]]
        claim = (
            f"stated errors are between {LOW:g} and {HIGH:g} times the true ones in {good} of "
            f"{len(told)} charges and below in {below}"
        )
        return Content(caption, frame, figure, pd.DataFrame(rows), claim=claim)

    def _of_drawn(self, inputs: Inputs, solved: Solved) -> list[pd.DataFrame]:
        found = []
        for kind, pairs in self.drawn(inputs).items():
            for number, (scene, better) in enumerate(pairs):
                names = [electrode.name for electrode in scene.electrode_list]
                charges, known = (solved.charges([s], names, "total")[0] for s in (scene, better))
                stated, doubt = (solved.errors([s], names)[0] for s in (scene, better))
                about = {"group": kind, "case": number, "tolerance": scene.numerics.tolerance}
                table = {"electrode": names, "charge_pC": charges, "stated_pC": stated}
                table |= {"known_pC": known, "doubt_pC": doubt}
                found.append(with_errors(pd.DataFrame(table)).assign(**about))
        return found


def finer(scene: Scene) -> Scene:
    """A drawn scene to a finer tolerance."""
    return scene.with_(**{"numerics.tolerance": scene.numerics.tolerance / FINER})


def draw_stated(ax: Axes, told: pd.DataFrame) -> None:
    """Dots in units of the tolerance, and lines of equal ratios."""
    for group, colour in zip(told.group.unique(), COLOURS, strict=False):
        rows = told[told.group == group]
        scaled = rows.true / rows.tolerance, rows.stated / rows.tolerance
        ax.plot(*scaled, "o", color=colour, markersize=2.6, alpha=0.7, label=group)
    ends = np.array(ax.get_xlim()) if told.empty else np.array([1e-4, 10.0])
    for ratio in (LOW, 1.0, HIGH):
        dashes = "-" if ratio == 1.0 else "--"
        ax.plot(ends, ratio * ends, dashes, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
    ax.set(xlabel="true error / tolerance", ylabel="stated error / tolerance")
    ax.legend()


def group_row(of: pd.DataFrame) -> dict[str, str]:
    """A row of the table of stated errors."""
    over = of.true / of.tolerance
    return {
        "scenes": str(of.group.iloc[0]),
        "charges": str(len(of)),
        "0.3 to 3": share(of.ratio, LOW, HIGH),
        "below 0.3": share(of.ratio, 0.0, LOW),
        "above 3": share(of.ratio, HIGH, math.inf),
        "median ratio": f"{of.ratio.median():.2f}",
        "worst error / tolerance": f"{over.max():.2f}",
    }


class CaseTable(OfCases):
    """What is known of each case, and by how much, beside the errors at the tolerances."""

    kind: Literal["cases"]

    stem: ClassVar[str] = "cases"

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A row for each case."""
        frame = self.frame(inputs, solved)
        rows, runs = [], worst(frame)
        for of in by(frame, "case"):
            row = {"case": of.case.iloc[0], "known by": SOURCES[of.source.iloc[0]]}
            row["to"] = percent((of.doubt_pC / of.known_pC).abs().max())
            found = runs[runs.case == row["case"]].set_index("tolerance")
            for tolerance in sorted(frame.tolerance.dropna().unique(), reverse=True):
                cell = "–"
                if tolerance in found.index:
                    at = found.loc[tolerance]
                    cell = f"{percent(at.true)} in {at.seconds:.2f} s"
                row[percent(tolerance)] = cell
            rows.append(row)
        return Content("The worst charge at each tolerance.", frame, shown=pd.DataFrame(rows))


class BesideNGSolve(OfCases):
    """The true error against seconds of this package and of NGSolve, a panel for each case."""

    kind: Literal["beside-ngsolve"]

    stem: ClassVar[str] = "beside-ngsolve"

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """Panels, and a table of seconds to be within errors."""
        names = [case.name for case in self.chosen(inputs) if case.peer]
        frame = self.frame(inputs, solved)
        frame = frame[frame.case.isin(names)]
        runs = worst(frame)
        columns = min(len(names), 3)
        rows = -(-len(names) // columns)
        figure = new_figure(1.25 * WIDTH_MM, 12.0 + 52.0 * rows)
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for ax, name in zip(axes.flat, names, strict=False):
            for code, dashes, colour in ((OURS, "o-", COLOURS[0]), (PEER, "s:", COLOURS[1])):
                of = best(runs[(runs.case == name) & (runs.code == code)])
                ax.plot(of.seconds, of.true, dashes, color=colour, markersize=3.0, label=code)
            ax.set(xscale="log", yscale="log", title=name)
        for ax in axes.flat[len(names) :]:
            ax.set_axis_off()
        axes.flat[0].legend()
        figure.supxlabel("processor seconds", fontsize=LABEL_SIZE + 1.0)
        figure.supylabel("true error of the worst charge", fontsize=LABEL_SIZE + 1.0)
        table, claim = self._table(runs, names)
        return Content(self._caption(claim), frame, figure, table)

    def _caption(self, claim: str) -> str:
        if find_spec("ngsolve") is None:
            return "NGSolve is not installed, and left out: pip install 'pvdf-fem[peers]'."
        return (
            "NGSolve's orders on Netgen's curved meshes, of which the best are drawn, chosen "
            "afterwards and without error estimates; this package finds its mesh and its error "
            f"itself. One thread, no imports.{claim}"
        )

    def _table(self, runs: pd.DataFrame, names: Sequence[str]) -> tuple[pd.DataFrame | None, str]:
        rows, ratios = [], dict[float, list[float]]()
        for name in names:
            row = {"case": name}
            for error in self.tolerances:
                within = runs[(runs.case == name) & (runs.true <= error)]
                ours, theirs = (within[within.code == c].seconds.min() for c in (OURS, PEER))
                row[f"{percent(error)}: s"] = f"{ours:.2f}" if math.isfinite(ours) else "–"
                row[f"{PEER}"] = ""
                del row[f"{PEER}"]
                row[f"{percent(error)}: {PEER} s"] = f"{theirs:.2f}" if theirs > 0 else "–"
                if ours > 0 and theirs > 0:
                    ratios.setdefault(error, []).append(theirs / ours)
            rows.append(row)
        if not ratios:
            return None, ""
        told = "; ".join(
            f"within {percent(error)} in {np.median(of):.1f} times the time ({len(of)} cases)"
            for error, of in ratios.items()
        )
        return pd.DataFrame(rows), f" In the median NGSolve is {told}."


class Stages(OfCases):
    """Seconds of mesh, solve and estimate of some cases."""

    kind: Literal["stages"]

    stem: ClassVar[str] = "stages"
    rank: ClassVar[int] = 2

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A bar for each case and tolerance."""
        frame = self.frame(inputs, solved).drop_duplicates(["case", "tolerance"])
        names = [f"{row.case}, {percent(row.tolerance)}" for row in frame.itertuples()]
        figure = new_figure(WIDTH_MM, 24.0 + 6.0 * len(names))
        ax, start = figure.subplots(), np.zeros(len(names))
        for stage, colour in zip(STAGES, COLOURS, strict=False):
            ax.barh(names, frame[stage], left=start, color=colour, height=0.6, label=stage)
            start += frame[stage].to_numpy()
        ax.invert_yaxis()
        ax.set_xlabel("seconds")
        figure.legend(loc="outside upper left", ncols=len(STAGES))
        total = frame[list(STAGES)].sum()
        parts = ", ".join(f"{name} {total[name] / total.sum():.0%}" for name in STAGES)
        return Content(f"Of all these seconds: {parts}.", frame, figure)


class SweepCost(Kind):
    """Seconds of a scene in a sweep, and alone, by tolerance."""

    kind: Literal["sweep-cost"]
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    places: int = 8

    stem: ClassVar[str] = "sweep-cost"

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """None: a sweep whose time is measured is a task."""
        return []

    def tasks(self, inputs: Inputs) -> Sequence[Task]:
        """A sweep for each tolerance."""
        scene = self.scene(inputs)
        asked, places = (self.tolerances[:1], 2) if inputs.quick else (self.tolerances, self.places)
        return [Swept(scene.with_(**{"numerics.tolerance": of}), places) for of in asked]

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A row for each tolerance."""
        rows = []
        for task in self.tasks(inputs):
            (row,) = solved.rows(task)
            rows.append({"tolerance": task.scene.numerics.tolerance, **row})
        frame = pd.DataFrame(rows)
        shown = pd.DataFrame(
            {
                "tolerance": frame.tolerance.map(percent),
                "scenes": frame.scenes.map(str),
                "solves": frame.solves.map(str),
                "ms in the sweep": (1e3 * frame.seconds).map("{:.1f}".format),
                "ms alone": (1e3 * frame.alone).map("{:.0f}".format),
                "ratio": (frame.alone / frame.seconds).map("{:.1f}".format),
            }
        )
        return Content("Processor time of a scene.", frame, shown=shown)


def by(frame: pd.DataFrame, name: str) -> list[pd.DataFrame]:
    """The rows of each value of a column."""
    return [rows for _, rows in frame.groupby(name, sort=name == "tolerance")]


def best(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs that no other one beats in both time and error, by time."""
    runs = runs.sort_values(["seconds", "true"])
    return runs[runs.true <= runs.true.cummin()]


def percent(part: float) -> str:
    """A part in percent, of two digits."""
    return f"{100.0 * part:.2g} %".replace("-", "−") if part >= 1e-6 else f"{part:.1e}"


def share(ratios: pd.Series, low: float, high: float) -> str:
    """How many ratios are within limits, in percent."""
    return f"{100.0 * ((ratios >= low) & (ratios < high)).mean():.0f} %" if len(ratios) else "–"
