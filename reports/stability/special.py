"""Kinds of the report on stability: ranges of parameters, extreme scenes, and scaling laws."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from pydantic import Field

from pvdf_fem.report.data import Changes
from pvdf_fem.report.kind import QUICK_TOLERANCE, Content, Inputs, Kind, prefix_errors
from pvdf_fem.report.kinds.curve import Values
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Section
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.view.figures import COLOURS, GREY, MARKERS, WIDTH_MM, get_figure, make_figure
from pvdf_fem.view.labels import format_axis_label
from reports.stability.endings import CRASHED, Extreme, Law, OnStrip

CONVERGED = str(Status.CONVERGED)
QUICK_SCENES = 10  #: Extreme scenes of a preview.
QUICK_VALUES = 3  #: Values of a range in a preview.
#: Names of how exact a charge is, with colours; errors are in tolerances.
CLASSES = {
    "error below a tenth of the tolerance": "#1b7f79",
    "below the tolerance": "#7cc4a4",
    "above it, and stated so": "#f2c14e",
    "above three stated errors": "#c8102e",
    "no known charge": "white",
}
TRUST = 3.0  #: A stated error is right within this factor, as in the report on accuracy.
NONE_ELSE = "0.78"  #: Colour of a refusal.
FACES = 4.0  #: Height of a range's tiles in mm.
ROW = 9.5  #: Height of a range's row in mm.


class Strip(Section):
    """Values of a key, and what tells the charges there.

    `reference` is ``one-dimension`` or, where no problem in one dimension is known, ``finer``.
    """

    name: str
    key: str
    values: Values
    reference: Literal["one-dimension", "finer"] = "one-dimension"
    set: Changes = Field(default_factory=dict)

    def list_tasks(self, inputs: Inputs, changes: Changes) -> list[OnStrip]:
        """A task for each value."""
        values = list(self.values)
        if inputs.quick:
            values = [values[i] for i in np.linspace(0, len(values) - 1, QUICK_VALUES).astype(int)]
        with prefix_errors(f"strips.{self.name}"):
            scene = inputs.change_scene(changes, self.set)
        return [OnStrip(scene, self.key, value, self.reference) for value in values]


class Ranges(Kind):
    """How scenes end along ranges of keys: a row of tiles for each range."""

    kind: Literal["ranges"]
    strips: tuple[Strip, ...]

    stem: ClassVar[str] = "ranges"
    rank: ClassVar[int] = 0

    def list_tasks(self, inputs: Inputs) -> list[OnStrip]:
        """A solve for each value of each range."""
        return [task for strip in self.strips for task in strip.list_tasks(inputs, self.set)]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Tiles, and a table with a row for each range."""
        rows = [
            {"range": strip.name, "reference": strip.reference, **row}
            for strip in self.strips
            for task in strip.list_tasks(inputs, self.set)
            for row in results.get_rows(task)
        ]
        frame = _filled(pd.DataFrame(rows))
        figure = make_figure(WIDTH_MM, ROW * len(self.strips) + 26.0)
        ax, letters = figure.subplots(), _letters(frame)
        for line, strip in enumerate(self.strips):
            _draw_strip(ax, line, strip, frame[frame["range"] == strip.name], letters)
        ax.set(xlim=(0.0, 1.0), ylim=(len(self.strips) - 0.05, -0.55))
        ax.axis("off")
        patches = [Patch(facecolor=c, edgecolor="0.3", label=name) for name, c in CLASSES.items()]
        patches += [
            Patch(facecolor=NONE_ELSE, label=f"{letter}: {status.replace('_', ' ')}")
            for status, letter in letters.items()
        ]
        figure.legend(handles=patches, loc="outside lower center", ncols=2, fontsize=7)
        caption = "Tiles are values from the first to the last; times are the largest CPU seconds."
        return Content(caption, frame, figure, _shown(frame), self._claim(frame))

    def _claim(self, frame: pd.DataFrame) -> str:
        converged = frame[frame.status == CONVERGED]
        return (
            f"along {len(self.strips)} ranges of keys {len(converged)} of {len(frame)} scenes"
            f" converge, with errors of at most {_number(converged.error.max())} tolerances beside"
            " problems in one dimension and finer solves, and the others are refused by name"
        )


def _filled(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with all columns that tasks may give."""
    numbers = ["error", "stated_error", "scaled", "seconds", "unknowns"]
    return frame.reindex(columns=list(dict.fromkeys([*frame.columns, *numbers])))


def _class(row: Any) -> str:
    """How exact the charge of a row is."""
    names = list(CLASSES)
    if not np.isfinite(row.error):
        return names[4]
    if row.error > 1.0:
        return names[3 if row.error > TRUST * row.stated_error else 2]
    return names[int(row.error > 0.1)]


def _letters(frame: pd.DataFrame) -> dict[str, str]:
    """Letters of the statuses without a result."""
    found: dict[str, str] = {}
    for status in dict.fromkeys(frame.status[frame.status != CONVERGED]):
        found[status] = next(c for c in [*status, "?"] if c not in found.values() and c != "_")
    return found


def _draw_strip(
    ax: Axes, line: int, strip: Strip, rows: pd.DataFrame, letters: Mapping[str, str]
) -> None:
    """The tiles of a range under its name."""
    words = format_axis_label(re.sub(r"\[\d+\]$", "", strip.key))
    unit = words[words.rfind("(") + 1 : -1] if words.endswith(")") else ""
    first, last = (f"{rows.value.iloc[i]:g}".replace("-", "−") for i in (0, -1))
    ends = f"{first} … {last} {unit}".rstrip()
    ax.text(0.0, line - 0.08, f"{strip.name}: {ends}", fontsize=8, va="bottom")
    seconds = rows.seconds[rows.seconds > 0.0]
    if len(seconds):
        ax.text(1.0, line - 0.08, f"≤ {seconds.max():.2f} s", fontsize=7, ha="right", va="bottom")
    width, height = 1.0 / len(rows), FACES / ROW
    for i, row in enumerate(rows.itertuples()):
        converged = row.status == CONVERGED
        colour = CLASSES[_class(row)] if converged else NONE_ELSE
        box: dict[str, Any] = {"facecolor": colour, "edgecolor": "white", "linewidth": 1.5}
        if colour == "white":
            box["edgecolor"] = "0.5"
        ax.barh(line + 0.5 * height, 0.97 * width, height, left=(i + 0.015) * width, **box)
        if not converged:
            place = (i + 0.5) * width, line + 0.5 * height
            ax.text(*place, letters[row.status], fontsize=7, ha="center", va="center")


def _shown(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each range."""
    rows = []
    for name, of in frame.groupby("range", sort=False):
        converged = of[of.status == CONVERGED]
        others = Counter(of.status[of.status != CONVERGED])
        ends = ", ".join(f"{n} {s.replace('_', ' ')}" for s, n in others.items()) or "–"
        beside = str(of.reference.iloc[0]).replace("-", " ")
        count, worst = f"{len(converged)} of {len(of)}", _number(converged.error.max())
        rows.append((name, count, ends, beside, worst, f"{of.seconds.max():.2f}"))
    heads = ["range", "solved", "others", "beside", "worst error / tolerance", "seconds"]
    return pd.DataFrame(rows, columns=heads)


def _number(value: float) -> str:
    return f"{value:.2g}" if np.isfinite(value) else "–"


class Extremes(Kind):
    """Extreme scenes, drawn with a seed: where they are, how exact, how long, or how they end."""

    kind: Literal["extremes"]
    show: Literal["map", "errors", "times", "statuses"]
    count: int
    seed: int
    tolerance: float = 1e-3

    stem: ClassVar[str] = "extremes"

    def list_tasks(self, inputs: Inputs) -> list[Extreme]:
        """A task for each scene."""
        count = min(self.count, QUICK_SCENES) if inputs.quick else self.count
        tolerance = max(self.tolerance, QUICK_TOLERANCE) if inputs.quick else self.tolerance
        return [Extreme(number, self.seed, tolerance) for number in range(count)]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """A figure, or the table of statuses."""
        rows = [row for task in self.list_tasks(inputs) for row in results.get_rows(task)]
        of: Content = getattr(self, f"_{self.show}")(_filled(pd.DataFrame(rows)))
        return of

    def _map(self, frame: pd.DataFrame) -> Content:
        figure = make_figure(WIDTH_MM, 95.0)
        ax = figure.subplots()
        rest = frame.rest_strain.where(frame.rest_strain.abs() > 1e-9, 0.0)
        _by_status(ax, frame, frame.load_strain, rest)
        ax.set(xscale="log", xlabel="strain of the load, (F/(E h a))$^{2/3}$")
        ax.set_yscale("symlog", linthresh=1e-7)
        ax.set(ylabel="strain at rest; below zero the film is slack")
        ax.set(ylim=(2.0 * min(rest.min(), -1e-6), 2.0 * max(rest.max(), 1e-6)))
        ends, wrong = Counter(frame.status == CONVERGED), int((frame.status == CRASHED).sum())
        known = frame[frame.error.notna()]
        beyond = int((known.error > np.maximum(known.stated_error, 1.0)).sum())
        claim = (
            f"of {len(frame)} extreme scenes {ends[True]} converge, {ends[False] - wrong} are"
            f" refused by name and {wrong or 'none'} ends otherwise; beside finer solves of"
            f" {len(known)} of them the worst error is {_number(known.error.max())} tolerances, and"
            f" {beyond or 'none'} is above both tolerance and stated error"
        )
        caption = "Each mark is a scene; both strains span the ranges of all keys."
        return Content(caption, frame.drop(columns="scene"), figure, claim=claim)

    def _errors(self, frame: pd.DataFrame) -> Content:
        known = frame[frame.error.notna()]
        if known.empty:
            raise NothingToShowError("no scene has a finer result")
        figure = make_figure(WIDTH_MM, 80.0)
        ax = figure.subplots()
        least = 1e-4
        for name, column, marker, colour in (
            ("finer solve", "error", "o", COLOURS[0]),
            ("enlarged scene", "scaled", "x", COLOURS[1]),
        ):
            of = frame[frame[column].notna()]
            x, y = of[column].clip(lower=least), of[f"stated_{column}"].clip(lower=least)
            ax.plot(x, y, marker, color=colour, markersize=4, alpha=0.8, label=name)
        ends = [least, 10.0]
        ax.plot(ends, ends, color=GREY, linewidth=0.8)
        ax.axvline(1.0, color=GREY, linestyle="--", linewidth=0.8)
        ax.set(xscale="log", yscale="log", xlabel="difference from a known charge / tolerance")
        ax.set_ylabel("stated error / tolerance")
        ax.legend(loc="lower right")
        scaled = frame.scaled.dropna()
        caption = (
            f"The worst charge of each scene beside a solve to a tenth of the tolerance, and beside"
            f" the scene with all lengths 3.7 times, all moduli 0.21 times as large, whose charges"
            f" are in proportion: in the median within {scaled.median():.1g}, at most"
            f" {scaled.max():.1g} tolerances. Values below {least:g} stand at {least:g}."
        )
        columns = ["number", "status", "finer", "enlarged", "error", "stated_error", "scaled"]
        return Content(caption, frame.reindex(columns=columns), figure)

    def _times(self, frame: pd.DataFrame) -> Content:
        solved, figure = frame[frame.unknowns > 0], make_figure(WIDTH_MM, 80.0)
        ax = figure.subplots()
        _by_status(ax, solved, solved.unknowns, solved.seconds)
        ax.set(xscale="log", yscale="log", xlabel="unknowns on the last mesh")
        ax.set_ylabel("CPU seconds of a solve")
        caption = (
            f"Median {frame.seconds.median():.2f} s, at most {frame.seconds.max():.1f} s with one"
            " thread. Each solve has a budget of work, after which it ends by name."
        )
        return Content(caption, frame[["number", "status", "unknowns", "seconds"]], figure)

    def _statuses(self, frame: pd.DataFrame) -> Content:
        advice = {str(status): status.advice for status in Status}
        advice[CRASHED] = "an exception, which must not happen"
        counts = Counter(frame.status)
        rows = [
            (status.replace("_", " "), str(count), advice[status])
            for status, count in counts.most_common()
        ]
        heads = ["status", "scenes", "what it means, and what to change"]
        shown = pd.DataFrame(rows, columns=heads)
        frame = frame[["number", "status", "reason", "scene"]]
        return Content("The words of each status.", frame, table=shown)


def _by_status(ax: Axes, frame: pd.DataFrame, x: pd.Series, y: pd.Series) -> None:
    """Marks by status, the converged ones first."""
    statuses = sorted(set(frame.status), key=lambda status: (status != CONVERGED, status))
    for number, status in enumerate(statuses):
        of = frame.status == status
        look: dict[str, Any] = {"color": COLOURS[number % len(COLOURS)], "markersize": 4}
        label = f"{status.replace('_', ' ')} ({of.sum()})"
        ax.plot(x[of], y[of], MARKERS[number], label=label, alpha=0.8, **look)
    get_figure(ax).legend(loc="outside upper left", ncols=2, fontsize=7)


class Pair(Section):
    """Two scenes whose charges, or deflections, are in a ratio that is known."""

    law: str
    quantity: Literal["charge", "deflection"]
    first: Changes
    second: Changes
    ratio: float


class Laws(Kind):
    """Ratios of scenes beside the ratios that scaling laws give."""

    kind: Literal["laws"]
    laws: tuple[Pair, ...]

    stem: ClassVar[str] = "laws"

    def list_tasks(self, inputs: Inputs) -> Sequence[Law]:
        """Two solves for each law."""
        scene = self.resolve_scene(inputs)
        return [
            Law(scene.with_(**law.first), scene.with_(**law.second), law.quantity)
            for law in self.laws
        ]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """A table of ratios."""
        found = [results.get_rows(task)[0]["ratio"] for task in self.list_tasks(inputs)]
        frame = pd.DataFrame(
            {"law": [of.law for of in self.laws], "computed": found}
            | {"exact": [of.ratio for of in self.laws]}
        )
        frame["difference"] = frame.computed / frame.exact - 1.0
        shown = frame.assign(
            computed=frame.computed.map("{:.10g}".format),
            exact=frame.exact.map("{:g}".format),
            difference=frame.difference.map("{:.0e}".format),
        )
        return Content("Ratios of two solves on one mesh.", frame, table=shown)
