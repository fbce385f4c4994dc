"""The table `comparison`: each charge of the data beside the computed one, and the differences."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pydantic import Field

from pvdf_fem.output.figures import GREY, HALO, look_of, new_figure
from pvdf_fem.reporting import drawing
from pvdf_fem.reporting.data import Name, Readings
from pvdf_fem.reporting.kind import Content, Inputs, Kind, NothingToShow, chosen
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, problem

NAMED = 2  #: Number of the largest differences that have a name in the figure.
COLUMNS = ["electrode", "charge_pC", "computed_pC", "error_pC", "difference_percent"]


class Comparison(Kind):
    """Each reading of the `data` beside the computed charge, and a figure of the differences.

    A difference is computed less measured, in percent of the measured charge. `electrodes` are by
    default all that have readings.
    """

    kind: Literal["comparison"]
    data: Name
    electrodes: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None

    stem: ClassVar[str] = "charges"
    rank: ClassVar[int] = 3

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """A scene for each row that has a reading."""
        readings, scenes, names = self._asked(inputs)
        given = np.isfinite(readings.charges(scenes, names, "total")).any(axis=1)
        return [scene for scene, has in zip(scenes, given, strict=True) if has]

    def _asked(self, inputs: Inputs) -> tuple[Readings, list[Scene], tuple[str, ...]]:
        readings, scene = self.readings(inputs), self.scene(inputs)
        assert readings is not None  # `data` is required
        names = chosen(self.electrodes or readings.names, scene)
        if not any(name in readings.names for name in names):
            reason = "has no readings of the electrodes; add columns with their names"
            raise SceneError([problem("data", self.data, reason)])
        return readings, readings.scenes(scene), names

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A row for each reading."""
        readings, scenes, names = self._asked(inputs)
        reading = self.read_as(inputs)
        theirs = readings.charges(scenes, names, reading)
        rows, columns = np.nonzero(np.isfinite(theirs))
        needed = [scenes[i] for i in rows]
        number = np.arange(len(rows)), columns
        frame = readings.shown.iloc[rows].reset_index(drop=True)
        frame["electrode"] = [names[j] for j in columns]
        frame["charge_pC"] = theirs[rows, columns]
        frame["computed_pC"] = solved.charges(needed, names, reading)[number]
        frame["error_pC"] = solved.errors(needed, names)[number]
        frame["difference_percent"] = 100.0 * (frame.computed_pC / frame.charge_pC - 1.0)
        difference = frame.difference_percent.to_numpy()
        if not np.isfinite(difference).any():
            raise NothingToShow("none of the scenes has charges")
        bias, size = np.nanmedian(difference), np.abs(difference)
        median, worst = float(np.nanmedian(size)), float(np.nanmax(size))
        what = readings.source.what
        caption = (
            f"Computed less {what} charge, in percent of it: bias {drawing.signed(bias, 2)} %, "
            f"median size {median:.2f} %, worst {worst:.2f} %. Bars: estimated errors of our solves."
        )
        claim = (
            f"the {np.isfinite(size).sum()} {what} charges and the computed ones differ by "
            f"{median:.2g} % in the median and {worst:.2g} % at most"
        )
        figure = _figure(frame, names, _row_names(readings), rows, what)
        return Content(caption, frame, figure, _shown(frame, what), claim)


def _row_names(readings: Readings) -> list[str]:
    """What tells the rows apart: their labels, else all their cells."""
    labels = list(readings.source.labels) or list(readings.shown.columns)
    return [", ".join(map(str, row)) for row in readings.frame[labels].to_numpy()]


def _figure(
    frame: pd.DataFrame, names: tuple[str, ...], row_names: list[str], rows: np.ndarray, what: str
) -> Figure:
    """Differences over the charges, the largest ones named."""
    figure = new_figure(drawing.WIDTH_MM, 78.0)
    ax = figure.subplots()
    for number, name in enumerate(names):
        own = frame[frame.electrode == name]
        look = {**look_of(number), "linestyle": "none", "label": name}
        bars = 100.0 * own.error_pC / own.charge_pC.abs()
        ax.errorbar(own.charge_pC, own.difference_percent, bars, elinewidth=0.7, **look)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    median = frame.difference_percent.median()
    ax.axhline(median, color=GREY, linewidth=0.8, linestyle="--")
    ax.annotate(
        f"median {drawing.signed(median, 2)} %", (1.0, median), (0.0, 2.0),
        xycoords=ax.get_yaxis_transform(), textcoords="offset points", ha="right", va="bottom",
        color=GREY, fontsize=7.5, path_effects=[HALO],
    )  # fmt: skip
    for i in frame.difference_percent.abs().nlargest(NAMED).index:
        at = frame.charge_pC[i], frame.difference_percent[i]
        right = at[0] > frame.charge_pC.mean()
        ax.annotate(
            row_names[rows[i]], at, (-6.0 if right else 6.0, 0.0), textcoords="offset points",
            ha="right" if right else "left", va="center", fontsize=7.0, color=GREY,
            path_effects=[HALO],
        )  # fmt: skip
    ax.set(xlabel=f"{what} charge (pC)", ylabel="computed less that (%)")
    figure.legend(loc="outside upper left", ncols=8, title="electrode")
    return figure


def _shown(frame: pd.DataFrame, what: str) -> pd.DataFrame:
    """The table of the page: places as they are, charges with the digits that are sure."""
    keys = [column for column in frame.columns if column not in COLUMNS]
    shown = frame[keys].map(lambda cell: f"{cell:g}" if isinstance(cell, float) else str(cell))
    shown["electrode"] = frame.electrode
    shown[f"{what} (pC)"] = [drawing.sure(value, 0.5) for value in frame.charge_pC]
    shown["computed (pC)"] = [
        drawing.sure(value, error)
        for value, error in zip(frame.computed_pC, frame.error_pC, strict=True)
    ]
    shown["± (pC)"] = [f"{error:.1g}" for error in frame.error_pC]
    shown["diff. (%)"] = [drawing.signed(value, 2) for value in frame.difference_percent]
    return shown
