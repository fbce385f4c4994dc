"""Kinds of the report on stability: ranges of parameters, extreme scenes, and scaling laws."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from pydantic import Field

from pvdf_fem.report.data import Changes
from pvdf_fem.report.kind import (
    QUICK_TOLERANCE,
    FigureKind,
    Inputs,
    Kind,
    prefix_errors,
)
from pvdf_fem.report.kinds.curve import Values
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Section
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.view.figures import COLOURS, GREY, MARKERS, WIDTH_MM, get_figure, make_figure
from pvdf_fem.view.labels import format_axis_label
from reports.stability.endings import CRASHED, ExtremeScene, RangeValue, RatioOfScenes

CONVERGED = str(Status.CONVERGED)
QUICK_SCENES = 10  #: Number of extreme scenes of a preview.
QUICK_VALUES = 3  #: Number of values of a range in a preview.
ACCURATE = "error below a tenth of the tolerance"
WITHIN = "below the tolerance"
STATED = "above it, and stated so"
UNDERSTATED = "above three stated errors"
UNKNOWN = "no known charge"
#: Colours by how accurate a charge is; errors are in tolerances.
CLASS_COLOURS = {
    ACCURATE: "#1b7f79",
    WITHIN: "#7cc4a4",
    STATED: "#f2c14e",
    UNDERSTATED: "#c8102e",
    UNKNOWN: "white",
}
#: Largest error over the stated one where this is right, as in the report on accuracy.
STATED_FACTOR = 3.0
NO_RESULT_COLOUR = "0.78"  #: Colour of a value without a result.
TILE_MM = 4.0  #: Height of a range's tiles.
ROW_MM = 9.5  #: Height of a range's row.
LEAST_SHOWN = 1e-4  #: Smallest error that is drawn, in tolerances.
RESULT_COLUMNS = ("error", "stated_error", "scaled", "seconds", "unknowns")


class Strip(Section):
    """A range of values of a key, and how the charges there are known.

    `reference` is ``one-dimension`` or, where no one-dimensional problem is known, ``finer``.
    """

    name: str
    key: str
    values: Values
    reference: Literal["one-dimension", "finer"] = "one-dimension"
    set: Changes = Field(default_factory=dict)

    def list_tasks(self, inputs: Inputs, changes: Changes) -> list[RangeValue]:
        """Return a task for each value, for a few of them in a preview."""
        values = list(self.values)
        if inputs.quick:
            chosen = np.linspace(0, len(values) - 1, QUICK_VALUES).astype(int)
            values = [values[i] for i in chosen]
        with prefix_errors(f"strips.{self.name}"):
            scene = inputs.change_scene(changes, self.set)
        return [RangeValue(scene, self.key, value, self.reference) for value in values]


class Ranges(FigureKind):
    """Outcomes of scenes along ranges of keys: a row of tiles for each range."""

    kind: Literal["ranges"]
    strips: tuple[Strip, ...]

    stem: ClassVar[str] = "ranges"
    rank: ClassVar[int] = 0

    def list_tasks(self, inputs: Inputs) -> list[RangeValue]:
        """Return a solve for each value of each range."""
        tasks = []
        for strip in self.strips:
            tasks += strip.list_tasks(inputs, self.set)
        return tasks

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return a row for each value of each range."""
        rows = []
        for strip in self.strips:
            about = {"range": strip.name, "reference": strip.reference}
            for task in strip.list_tasks(inputs, self.set):
                rows += [{**about, **row} for row in results.get_rows(task)]
        return _complete_columns(pd.DataFrame(rows))

    def make_axes(self, data: pd.DataFrame) -> Axes:
        """Return axes with a row for each range."""
        return make_figure(WIDTH_MM, ROW_MM * len(self.strips) + 26.0).subplots()

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw the tiles of all ranges, and their legend."""
        letters = _choose_letters(data)
        for line, strip in enumerate(self.strips):
            _draw_strip(
                axes, line, strip=strip, rows=data[data.range == strip.name], letters=letters
            )
        axes.set(xlim=(0.0, 1.0), ylim=(len(self.strips) - 0.05, -0.55))
        axes.axis("off")
        patches = []
        for name, colour in CLASS_COLOURS.items():
            patches.append(Patch(facecolor=colour, edgecolor="0.3", label=name))
        for status, letter in letters.items():
            label = f"{letter}: {status.replace('_', ' ')}"
            patches.append(Patch(facecolor=NO_RESULT_COLOUR, label=label))
        get_figure(axes).legend(handles=patches, loc="outside lower center", ncols=2, fontsize=7)

    def make_caption(self, data: pd.DataFrame) -> str:
        """Explain the tiles and times."""
        return "Tiles are values from the first to the last; times are the largest CPU seconds."

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return a row for each range."""
        rows = []
        for name, values in data.groupby("range", sort=False):
            converged = values[values.status == CONVERGED]
            others = Counter(values.status[values.status != CONVERGED])
            endings = [f"{count} {status.replace('_', ' ')}" for status, count in others.items()]
            rows.append(
                {
                    "range": name,
                    "solved": f"{len(converged)} of {len(values)}",
                    "others": ", ".join(endings) if endings else "–",
                    "beside": str(values.reference.iloc[0]).replace("-", " "),
                    "worst error / tolerance": _format_number(converged.error.max()),
                    "seconds": f"{values.seconds.max():.2f}",
                }
            )
        return pd.DataFrame(rows)

    def make_claim(self, data: pd.DataFrame) -> str:
        """Return how many scenes converge, and their largest error."""
        converged = data[data.status == CONVERGED]
        return (
            f"along {len(self.strips)} ranges of keys {len(converged)} of {len(data)} scenes"
            f" converge, with errors of at most {_format_number(converged.error.max())} tolerances"
            " compared with one-dimensional problems and finer solves, and the others end with a"
            " status that gives the reason"
        )


def _complete_columns(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table with all columns that a solve may give."""
    columns = dict.fromkeys([*frame.columns, *RESULT_COLUMNS])
    return frame.reindex(columns=list(columns))


def _classify(error: float, stated_error: float) -> str:
    """Return how accurate a charge is, from its error and the stated one in tolerances."""
    if not np.isfinite(error):
        return UNKNOWN
    if error > 1.0:
        return UNDERSTATED if error > STATED_FACTOR * stated_error else STATED
    return WITHIN if error > 0.1 else ACCURATE


def _choose_letters(frame: pd.DataFrame) -> dict[str, str]:
    """Return a letter for each status without a result."""
    letters: dict[str, str] = {}
    for status in dict.fromkeys(frame.status[frame.status != CONVERGED]):
        candidates = [letter for letter in status if letter != "_"]
        unused = [letter for letter in candidates if letter not in letters.values()]
        letters[status] = unused[0] if unused else "?"
    return letters


def _draw_strip(
    ax: Axes, line: int, strip: Strip, rows: pd.DataFrame, letters: Mapping[str, str]
) -> None:
    """Draw the tiles of a range under its name.

    Parameters
    ----------
    ax : Axes
        The axes, with a line for each range.
    line : int
        Number of the range.
    strip : Strip
        The range.
    rows : DataFrame
        Its values.
    letters : mapping of str to str
        Letters of the statuses without a result.
    """
    label = format_axis_label(re.sub(r"\[\d+\]$", "", strip.key))
    unit = label[label.rfind("(") + 1 : -1] if label.endswith(")") else ""
    first = f"{rows.value.iloc[0]:g}".replace("-", "−")
    last = f"{rows.value.iloc[-1]:g}".replace("-", "−")
    title = f"{strip.name}: {first} … {last} {unit}".rstrip()
    ax.text(0.0, line - 0.08, title, fontsize=8, va="bottom")
    seconds = rows.seconds[rows.seconds > 0.0]
    if len(seconds):
        text = f"≤ {seconds.max():.2f} s"
        ax.text(1.0, line - 0.08, text, fontsize=7, ha="right", va="bottom")
    width = 1.0 / len(rows)
    height = TILE_MM / ROW_MM
    middle = line + 0.5 * height
    for i, row in enumerate(rows.itertuples()):
        is_converged = row.status == CONVERGED
        colour = NO_RESULT_COLOUR
        if is_converged:
            colour = CLASS_COLOURS[_classify(row.error, row.stated_error)]
        ax.barh(
            middle,
            0.97 * width,
            height,
            left=(i + 0.015) * width,
            facecolor=colour,
            edgecolor="0.5" if colour == "white" else "white",
            linewidth=1.5,
        )
        if not is_converged:
            letter = letters[row.status]
            ax.text((i + 0.5) * width, middle, letter, fontsize=7, ha="center", va="center")


def _format_number(value: float) -> str:
    """Format a number with two digits; a dash stands for NaN."""
    return f"{value:.2g}" if np.isfinite(value) else "–"


@dataclass(frozen=True, eq=False)
class ExtremeData:
    """Extreme scenes: all columns, and those of the CSV file."""

    scenes: pd.DataFrame
    frame: pd.DataFrame


class Extremes(Kind):
    """Random extreme scenes: their strains, errors or times, or a table of their statuses."""

    kind: Literal["extremes"]
    show: Literal["map", "errors", "times", "statuses"]
    count: int
    seed: int
    tolerance: float = 1e-3

    stem: ClassVar[str] = "extremes"

    def list_tasks(self, inputs: Inputs) -> list[ExtremeScene]:
        """Return a task for each scene."""
        count = self.count
        tolerance = self.tolerance
        if inputs.quick:
            count = min(count, QUICK_SCENES)
            tolerance = max(tolerance, QUICK_TOLERANCE)
        return [ExtremeScene(number, self.seed, tolerance) for number in range(count)]

    def collect_data(self, inputs: Inputs, results: ReportResults) -> ExtremeData:
        """Return a row for each scene."""
        scenes = _complete_columns(super().collect_data(inputs, results))
        columns = {
            "map": [column for column in scenes.columns if column != "scene"],
            "errors": ["number", "status", "finer", "enlarged", "error", "stated_error", "scaled"],
            "times": ["number", "status", "unknowns", "seconds"],
            "statuses": ["number", "status", "reason", "scene"],
        }
        return ExtremeData(scenes, scenes.reindex(columns=columns[self.show]))

    def make_figure(self, data: ExtremeData) -> Figure | None:
        """Return the figure of strains, errors or times."""
        if self.show == "statuses":
            return None
        figure = make_figure(WIDTH_MM, 95.0 if self.show == "map" else 80.0)
        axes = figure.subplots()
        if self.show == "map":
            _draw_strains(axes, data.scenes)
        elif self.show == "errors":
            _draw_errors(axes, data.scenes)
        else:
            _draw_times(axes, data.scenes)
        return figure

    def make_caption(self, data: ExtremeData) -> str:
        """Explain the marks and numbers."""
        scenes = data.scenes
        if self.show == "map":
            return "Each mark is a scene; both strains span the ranges of all keys."
        if self.show == "statuses":
            return "The meaning of each status."
        if self.show == "times":
            return (
                f"Median {scenes.seconds.median():.2f} s, at most {scenes.seconds.max():.1f} s with"
                " one thread. Each solve has a budget of work, and ends with a status when this is"
                " spent."
            )
        scaled = scenes.scaled.dropna()
        return (
            "The worst charge of each scene, compared with a solve to a tenth of the tolerance, and"
            " with the scene with all lengths 3.7 times and all moduli 0.21 times as large, whose"
            f" charges are in proportion: in the median within {scaled.median():.1g}, at most"
            f" {scaled.max():.1g} tolerances. Values below {LEAST_SHOWN:g} are drawn at"
            f" {LEAST_SHOWN:g}."
        )

    def make_table(self, data: ExtremeData) -> pd.DataFrame | None:
        """Return the statuses with their numbers of scenes and their advice."""
        if self.show != "statuses":
            return None
        advice = {str(status): status.advice for status in Status}
        advice[CRASHED] = "an exception, which must not happen"
        rows = []
        for status, count in Counter(data.scenes.status).most_common():
            rows.append((status.replace("_", " "), str(count), advice[status]))
        return pd.DataFrame(rows, columns=["status", "scenes", "what it means, and what to change"])

    def make_claim(self, data: ExtremeData) -> str:
        """Return how the scenes end, and the largest error."""
        if self.show != "map":
            return ""
        scenes = data.scenes
        converged = int((scenes.status == CONVERGED).sum())
        crashed = int((scenes.status == CRASHED).sum())
        refused = len(scenes) - converged - crashed
        known = scenes[scenes.error.notna()]
        above = int((known.error > np.maximum(known.stated_error, 1.0)).sum())
        return (
            f"of {len(scenes)} extreme scenes {converged} converge, {refused} end with a status"
            f" that gives the reason, and {crashed or 'none'} with an exception; compared with"
            f" finer solves of {len(known)} of them the worst error is"
            f" {_format_number(known.error.max())} tolerances, and {above or 'none'} is above both"
            " tolerance and stated error"
        )


def _draw_strains(ax: Axes, scenes: pd.DataFrame) -> None:
    """Draw the strain of the unloaded film over that of the load, by status."""
    rest = scenes.rest_strain.where(scenes.rest_strain.abs() > 1e-9, 0.0)
    _draw_by_status(ax, scenes, scenes.load_strain, rest)
    ax.set(xscale="log", xlabel="strain of the load, (F/(E h a))$^{2/3}$")
    ax.set_yscale("symlog", linthresh=1e-7)
    ax.set(ylabel="strain of the unloaded film; below zero the film is slack")
    ax.set(ylim=(2.0 * min(rest.min(), -1e-6), 2.0 * max(rest.max(), 1e-6)))


def _draw_errors(ax: Axes, scenes: pd.DataFrame) -> None:
    """Draw stated errors over the differences from known charges."""
    if not scenes.error.notna().any():
        raise NothingToShowError("no scene has a finer result")
    for label, column, marker, colour in (
        ("finer solve", "error", "o", COLOURS[0]),
        ("enlarged scene", "scaled", "x", COLOURS[1]),
    ):
        rows = scenes[scenes[column].notna()]
        x = rows[column].clip(lower=LEAST_SHOWN)
        y = rows[f"stated_{column}"].clip(lower=LEAST_SHOWN)
        ax.plot(x, y, marker, color=colour, markersize=4, alpha=0.8, label=label)
    limits = [LEAST_SHOWN, 10.0]
    ax.plot(limits, limits, color=GREY, linewidth=0.8)
    ax.axvline(1.0, color=GREY, linestyle="--", linewidth=0.8)
    ax.set(xscale="log", yscale="log", xlabel="difference from a known charge / tolerance")
    ax.set_ylabel("stated error / tolerance")
    ax.legend(loc="lower right")


def _draw_times(ax: Axes, scenes: pd.DataFrame) -> None:
    """Draw processor seconds over the unknowns of the last mesh, by status."""
    meshed = scenes[scenes.unknowns > 0]
    _draw_by_status(ax, meshed, meshed.unknowns, meshed.seconds)
    ax.set(xscale="log", yscale="log", xlabel="unknowns on the last mesh")
    ax.set_ylabel("CPU seconds of a solve")


def _draw_by_status(ax: Axes, scenes: pd.DataFrame, x: pd.Series, y: pd.Series) -> None:
    """Draw a mark for each scene by status, the converged ones first.

    Parameters
    ----------
    ax : Axes
        The axes.
    scenes : DataFrame
        A row for each scene.
    x, y : Series
        Coordinates of the scenes.
    """
    statuses = sorted(set(scenes.status), key=lambda status: (status != CONVERGED, status))
    for number, status in enumerate(statuses):
        is_here = scenes.status == status
        look: dict[str, Any] = {"color": COLOURS[number % len(COLOURS)], "markersize": 4}
        label = f"{status.replace('_', ' ')} ({is_here.sum()})"
        ax.plot(x[is_here], y[is_here], MARKERS[number], label=label, alpha=0.8, **look)
    get_figure(ax).legend(loc="outside upper left", ncols=2, fontsize=7)


class Pair(Section):
    """Two scenes with a known ratio of their charges or deflections."""

    law: str
    quantity: Literal["charge", "deflection"]
    first: Changes
    second: Changes
    ratio: float


class Laws(Kind):
    """Ratios of scenes, compared with the ratios of scaling laws."""

    kind: Literal["laws"]
    laws: tuple[Pair, ...]

    stem: ClassVar[str] = "laws"

    def list_tasks(self, inputs: Inputs) -> Sequence[RatioOfScenes]:
        """Return two solves for each law."""
        scene = self.resolve_scene(inputs)
        tasks = []
        for law in self.laws:
            first = scene.with_(**law.first)
            second = scene.with_(**law.second)
            tasks.append(RatioOfScenes(first, second, law.quantity))
        return tasks

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return a row for each law."""
        rows = []
        for law, task in zip(self.laws, self.list_tasks(inputs), strict=True):
            [row] = results.get_rows(task)
            difference = row["ratio"] / law.ratio - 1.0
            rows.append((law.law, row["ratio"], law.ratio, difference))
        return pd.DataFrame(rows, columns=["law", "computed", "exact", "difference"])

    def make_caption(self, data: pd.DataFrame) -> str:
        """Explain the comparison."""
        return "Ratios of two solves on one mesh."

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the ratios with their digits."""
        return data.assign(
            computed=data.computed.map("{:.10g}".format),
            exact=data.exact.map("{:g}".format),
            difference=data.difference.map("{:.0e}".format),
        )
