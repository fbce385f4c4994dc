"""The table `comparison`: data charges beside computed charges, and the differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pydantic import Field

from pvdf_fem.problem.problem import Problem
from pvdf_fem.report.data import SHORT, Readings, format_cell
from pvdf_fem.report.kind import Content, ElectrodeKind, Inputs, prefix_errors
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.sensitivity.uncertainty import require_differentiable, uncertainty
from pvdf_fem.view import curves as drawing
from pvdf_fem.view.figures import GREY, HALO, get_line_style, make_figure

NAMED = 1  #: Number of the largest differences that have a name in the figure.


@dataclass(frozen=True)
class Spread(Task):
    """Standard deviations of a scene's charges by its uncertain values, in pC."""

    scene: Scene

    def run(self) -> Rows:
        """A row for each electrode."""
        found = uncertainty(self.scene)
        both = {"total": found.charges_pC, "change": found.charge_changes_pC}
        return [
            {"electrode": name, **{k: of[name] for k, of in both.items()}} for name in both["total"]
        ]


class Comparison(ElectrodeKind):
    """Readings in `data` beside computed charges, and a figure of the differences.

    A difference is computed less measured, in percent of the measured charge. By default
    `electrodes` are the electrodes with readings. With `uncertain` values of the scene differences
    are also told over their standard deviation by these values and our errors (ASME V&V 20).
    """

    kind: Literal["comparison"]
    data: Annotated[str, Field(min_length=1)]

    stem: ClassVar[str] = "charges"
    rank: ClassVar[int] = 3

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """Scenes for rows with a reading."""
        readings, scenes, names = self._asked(inputs)
        given = np.isfinite(readings.charges(scenes, names, "total")).any(axis=1)
        return [scenes[row] for row in np.flatnonzero(given)]

    def tasks(self, inputs: Inputs) -> Sequence[Task]:
        """Deviations of the charges, where the scene has uncertain values."""
        scenes = dict.fromkeys(self.scenes(inputs))
        with prefix_errors("scene"):
            for scene in scenes:
                require_differentiable(Problem.from_scene(scene))
        return [Spread(scene) for scene in scenes if scene.uncertain]

    def _asked(self, inputs: Inputs) -> tuple[Readings, list[Scene], tuple[str, ...]]:
        readings, scene = self.readings(inputs), self.scene(inputs)
        assert readings is not None  # `data` is required
        names = self.names(scene) if self.electrodes else readings.names
        if not any(name in readings.names for name in names):
            reason = "has no readings of the electrodes; add columns with their names"
            raise SceneError([format_error("data", self.data, reason)])
        return readings, readings.scenes(scene), names

    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """A row for each reading."""
        readings, scenes, names = self._asked(inputs)
        reading, what = self.read_as(inputs), readings.source.what
        theirs = readings.charges(scenes, names, reading)
        given = np.flatnonzero(np.isfinite(theirs).any(axis=1))
        charges = solved.table([scenes[row] for row in given], names, reading, theirs[given])
        rows = np.repeat(given, len(names))
        frame = readings.shown.iloc[rows].reset_index(drop=True).join(charges)
        frame["row"] = np.array(readings.row_names())[rows]
        frame["scene"] = np.repeat(np.arange(len(given)), len(names))
        frame = frame[frame.charge_pC.notna()].reset_index(drop=True)
        size = frame.difference_percent.abs()
        if not size.notna().any():
            raise NothingToShowError("none of the scenes has charges")
        bias = drawing.format_signed(frame.difference_percent.median(), 2)
        over = self._over_deviations(frame, [scenes[row] for row in given], solved, reading)
        caption = (
            f"Below: computed less {what} charge, in percent of it; bias {bias} %, median size "
            f"{size.median():.2f} %, worst {size.max():.2f} %. Bars: errors of our solves.{over}"
        )
        claim = (
            f"the {size.notna().sum()} {what} charges and the computed ones differ by "
            f"{size.median():.2g} % in the median and {size.max():.2g} % at most"
        )
        kept = [*readings.source.labels, *SHORT] if readings.source.labels else []
        figure, shown = _figure(frame, names, what), _shown(frame, charges, kept, what)
        return Content(caption, frame.drop(columns=["row", "scene"]), figure, shown, claim)

    def _over_deviations(
        self, frame: pd.DataFrame, scenes: Sequence[Scene], solved: ReportResults, reading: str
    ) -> str:
        """Add the differences over their standard deviations to a frame; what there is to say."""
        if not (scenes and scenes[0].uncertain):
            return ""
        known = {
            (number, row["electrode"]): row[reading]
            for number, scene in enumerate(scenes)
            for row in solved.rows(Spread(scene))
        }
        pairs = zip(frame.scene, frame.electrode, strict=True)
        deviations = np.hypot([known[pair] for pair in pairs], frame.error_pC)
        frame["difference_over_deviation"] = (frame.computed_pC - frame.charge_pC) / deviations
        share = 100.0 * float((frame.difference_over_deviation.abs() <= 2.0).mean())
        return f" By the uncertain values {share:.0f} % are within two standard deviations."


def _figure(frame: pd.DataFrame, names: tuple[str, ...], what: str) -> Figure:
    """Computed over measured charges, and below the differences, with names at the largest."""
    figure = make_figure(drawing.WIDTH_MM, 106.0)
    ax, strip = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": [3.0, 2.0]})
    for number, name in enumerate(names):
        own = frame[frame.electrode == name]
        look = {**get_line_style(number), "linestyle": "none", "markersize": 4.0}
        ax.plot(own.charge_pC, own.computed_pC, **look, label=name)
        bars = 100.0 * own.error_pC / own.charge_pC.abs()
        strip.errorbar(own.charge_pC, own.difference_percent, bars, elinewidth=0.7, **look)
    ax.axline((frame.charge_pC.mean(),) * 2, slope=1.0, color=GREY, linewidth=0.8, zorder=1)
    strip.axhline(0.0, color=GREY, linewidth=0.8)
    middle = 0.5 * (frame.charge_pC.max() + frame.charge_pC.min())
    for i in frame.difference_percent.abs().nlargest(NAMED).index:
        at = frame.charge_pC[i], frame.difference_percent[i]
        side, aside = ("right", -6.0) if at[0] > middle else ("left", 6.0)
        words = strip.annotate(frame.row[i], at, (aside, 0.0), textcoords="offset points")
        words.set(ha=side, va="center", fontsize=7.0, color=GREY, path_effects=[HALO])
    ax.set_ylabel("computed charge (pC)")
    strip.set(xlabel=f"{what} charge (pC)", ylabel="difference (%)")
    ax.legend(loc="upper left", ncols=2 if len(names) > 4 else 1, title="electrode")
    return figure


def _shown(
    frame: pd.DataFrame, charges: pd.DataFrame, kept: Sequence[str], what: str
) -> pd.DataFrame:
    """The page's table: named keys, by default every key, and charges with sure digits."""
    own = (*charges.columns, "row", "scene", "difference_over_deviation")
    keys = [key for key in frame.columns if key not in own and (key in kept or not kept)]
    shown = frame[keys].map(format_cell)
    shown["electrode"] = frame.electrode
    shown[f"{what} (pC)"] = [drawing.format_significant(value, 0.5) for value in frame.charge_pC]
    pairs = zip(frame.computed_pC, frame.error_pC, strict=True)
    shown["computed (pC)"] = [drawing.format_significant(value, error) for value, error in pairs]
    shown["± (pC)"] = [f"{error:.1g}" for error in frame.error_pC]
    shown["diff. (%)"] = [drawing.format_signed(value, 2) for value in frame.difference_percent]
    if "difference_over_deviation" in frame:
        shown["diff. (σ)"] = [drawing.format_signed(of) for of in frame.difference_over_deviation]
    return shown
