"""Kinds of figures of the report on tracking.

pvdf-fem report reports/tracking/report.toml --kinds reports/tracking/special.py
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from pydantic import Field
from scipy.stats import norm

from pvdf_fem import Scene
from pvdf_fem.report.kind import FigureKind, Inputs
from pvdf_fem.view.figures import COLOURS, GREY, WIDTH_MM, make_figure
from reports.tracking.tasks import CostOfRows, LongStream, MixedFaults, SingleFaults

#: Verdicts on presses with their colours, in the order of the bars.
VERDICT_COLOURS = {
    "right": "#1b7f79",
    "flagged": "#7cc4a4",
    "excused": "0.8",
    "wrong": "#c8102e",
    "lost": "#f2c14e",
}
COUNTS = ("presses", *VERDICT_COLOURS, "phantom")
QUICK_TOLERANCE = 2e-2  #: Tolerance of the response of a preview.
QUICK_STEP = 12  #: A preview has every twelfth fault.
ROW_MM = 3.4  #: Height of a bar.
LARGEST_PULL = 4.0  #: Largest pull that is drawn.


class TrackedFigure(FigureKind):
    """A figure of simulated streams that are tracked; `tolerance` is that of the response."""

    tolerance: float = 5e-4

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return no scenes: tasks make their own."""
        return []

    def choose_tolerance(self, inputs: Inputs) -> float:
        """Return the tolerance of the response, coarse in a preview."""
        return QUICK_TOLERANCE if inputs.quick else self.tolerance


def count_verdicts(data: pd.DataFrame, by: str) -> pd.DataFrame:
    """Sum the verdicts of streams by a column, and count the faults without a message."""
    counts = data.groupby(by, sort=False)[list(COUNTS)].sum()
    unreported = data.groupby(by, sort=False).unreported
    counts["unreported"] = unreported.agg(lambda lists: lists.str.len().sum())
    return counts


def describe_counts(data: pd.DataFrame) -> str:
    """Describe the sums of the verdicts of all streams."""
    sums = data[list(COUNTS)].sum()
    unreported = int(data.unreported.str.len().sum())
    shares = [f"{sums[name]} {name}" for name in VERDICT_COLOURS]
    return (
        f"of {sums.presses} presses {', '.join(shares)}; {sums.phantom} phantoms,"
        f" {unreported} faults without a message"
    )


class VerdictBars(TrackedFigure):
    """A figure with a bar of verdicts for each fault."""

    @abstractmethod
    def count_by_fault(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the verdicts, by fault."""

    def make_axes(self, data: pd.DataFrame) -> Axes:
        """Return axes with a row for each fault."""
        return make_figure(WIDTH_MM, ROW_MM * len(self.count_by_fault(data)) + 22.0).subplots()

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw the shares of the verdicts, and the number of phantoms beside them."""
        counts = self.count_by_fault(data)
        lines = np.arange(len(counts))
        left = np.zeros(len(counts))
        for name, colour in VERDICT_COLOURS.items():
            shares = 100.0 * (counts[name] / counts.presses).to_numpy()
            axes.barh(lines, shares, left=left, color=colour, label=name, height=0.8)
            left += shares
        for line, phantoms in enumerate(counts.phantom):
            if phantoms:
                axes.text(101.0, line, f"+{phantoms}", fontsize=6, va="center", color="#c8102e")
        axes.set_yticks(lines, list(counts.index), fontsize=6)
        axes.grid(visible=False)
        axes.set(xlim=(0.0, 108.0), ylim=(len(counts) - 0.4, -0.6), xlabel="presses (%)")
        axes.legend(
            ncols=len(VERDICT_COLOURS), fontsize=6, loc="lower center", bbox_to_anchor=(0.4, 1.0)
        )


class FaultOutcomes(VerdictBars):
    """Streams with one fault each: a bar of verdicts for each fault."""

    kind: Literal["fault-outcomes"]
    streams: Annotated[int, Field(ge=1)] = 3

    stem: ClassVar[str] = "faults"
    rank: ClassVar[int] = 0

    def list_tasks(self, inputs: Inputs) -> list[SingleFaults]:
        """Return one task; a preview has only some of the faults."""
        streams, step = (1, QUICK_STEP) if inputs.quick else (self.streams, 1)
        scene = self.resolve_scene(inputs)
        return [SingleFaults(scene, streams, step, self.choose_tolerance(inputs))]

    def count_by_fault(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the verdicts on the streams of each fault."""
        return count_verdicts(data, "fault")

    def make_caption(self, data: pd.DataFrame) -> str:
        """Explain the verdicts."""
        return (
            "Right: place and force are within 4.5 stated deviations, or within 0.1 mm and 3 %."
            " Flagged: reported with another status than touch. Excused: not reported, but hidden"
            " by a gap, or while settling. Red numbers are touches where nothing pressed."
        )

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the counts and the CPU time of a row for each fault."""
        counts = count_verdicts(data, "fault")
        sums = data.groupby("fault", sort=False)[["cpu_s", "samples"]].sum()
        table = counts.astype(str)
        table["CPU µs a row"] = (1e6 * sums.cpu_s / sums.samples).map("{:.0f}".format)
        return table.reset_index()

    def make_claim(self, data: pd.DataFrame) -> str:
        """Return the counts of all faults."""
        return f"with {data.fault.nunique()} kinds of faults, {describe_counts(data)}"


class MixtureOutcomes(VerdictBars):
    """Streams with two random faults: a bar for each fault, and the streams with an error."""

    kind: Literal["mixture-outcomes"]
    streams: Annotated[int, Field(ge=1)] = 40

    stem: ClassVar[str] = "mixtures"
    rank: ClassVar[int] = 1

    def list_tasks(self, inputs: Inputs) -> list[MixedFaults]:
        """Return one task."""
        streams = 2 if inputs.quick else self.streams
        return [MixedFaults(self.resolve_scene(inputs), streams, self.choose_tolerance(inputs))]

    def count_by_fault(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the verdicts on the mixtures with each fault; each mixture counts for both."""
        by_fault = data.assign(fault=data.fault.str.split(" + ", regex=False)).explode("fault")
        return count_verdicts(by_fault, "fault").sort_index()

    def make_caption(self, data: pd.DataFrame) -> str:
        """Return the counts of all mixtures."""
        return (
            f"{len(data)} random mixtures: {describe_counts(data)}. A bar is about all mixtures"
            " with this fault, colours as above. The table has the mixtures with an error."
        )

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the mixtures with an error; all of them are in the CSV file."""
        error_counts = data.wrong + data.lost + data.phantom + data.unreported.str.len()
        bad = data[error_counts > 0]
        table = bad[["fault", *COUNTS]].astype(str)
        table["unreported"] = bad.unreported.map(", ".join)
        return table

    def make_claim(self, data: pd.DataFrame) -> str:
        """Return the counts of all mixtures."""
        return f"with {len(data)} random mixtures of two faults, {describe_counts(data)}"


class LongStreamPulls(TrackedFigure):
    """A long stream with a fault a minute: errors divided by their stated deviations."""

    kind: Literal["long-stream"]
    minutes: Annotated[int, Field(ge=1)] = 5

    stem: ClassVar[str] = "long"

    def list_tasks(self, inputs: Inputs) -> list[LongStream]:
        """Return one task."""
        minutes = 1 if inputs.quick else self.minutes
        return [LongStream(self.resolve_scene(inputs), minutes, self.choose_tolerance(inputs))]

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw the distribution of the pulls, and the normal distribution."""
        pulls = np.reshape(data.pulls.iloc[0], (-1, 3))
        grid = np.linspace(-LARGEST_PULL, LARGEST_PULL, 200)
        bins = np.linspace(-LARGEST_PULL, LARGEST_PULL, 33).tolist()
        for name, values, colour in zip(("x", "y", "force"), pulls.T, COLOURS, strict=False):
            rms = np.sqrt(np.mean(np.square(values)))
            label = f"{name}: rms {rms:.2f}"
            axes.hist(values, bins, density=True, histtype="step", color=colour, label=label)
        axes.plot(grid, norm.pdf(grid), color=GREY, label="normal distribution")
        axes.set(xlabel="error / stated deviation", ylabel="density", xlim=grid[[0, -1]])
        axes.legend()

    def make_caption(self, data: pd.DataFrame) -> str:
        """Return the counts, and the CPU time of a row."""
        row = data.iloc[0]
        return (
            f"{row.samples:,} samples at 1 kHz with a fault in each minute:"
            f" {describe_counts(data)}. A row takes {1e6 * row.cpu_s / row.samples:.0f} µs of a"
            f" processor, the slowest {1e3 * row.slowest_s:.1f} ms."
        )

    def make_claim(self, data: pd.DataFrame) -> str:
        """Return the counts."""
        hours = data.samples.iloc[0] / 3.6e6
        return f"in {hours:.2g} h with a fault a minute, {describe_counts(data)}"


class CostCourse(TrackedFigure):
    """CPU time of a row during a long hold."""

    kind: Literal["cost"]
    hold_s: float = 60.0

    stem: ClassVar[str] = "cost"
    size_mm: ClassVar[tuple[float, float]] = (WIDTH_MM, 60.0)

    def list_tasks(self, inputs: Inputs) -> Sequence[CostOfRows]:
        """Return one task."""
        hold_s = 5.0 if inputs.quick else self.hold_s
        return [CostOfRows(self.resolve_scene(inputs), hold_s, self.choose_tolerance(inputs))]

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw the mean CPU time of blocks of rows."""
        axes.plot(data.held_s, 1e6 * data.cpu_s)
        axes.axvline(0.0, color=GREY, linewidth=0.8)
        axes.set(xlabel="time since the start of the hold (s)", ylabel="CPU time of a row (µs)")
        axes.set_ylim(bottom=0.0)

    def make_caption(self, data: pd.DataFrame) -> str:
        """Return the times, and the growth of the memory."""
        numbers = measure_cost(data)
        return (
            "Means of 500 rows at 1 kHz. A quiet row takes {quiet_us:.0f} µs, a row in the first"
            " second of the hold {early_us:.0f} µs, and in the last {late_us:.0f} µs; the slowest"
            " row takes {slowest_ms:.1f} ms. From the fifth second to the last the tracker's memory"
            " grows by {growth_kB:.0f} kB."
        ).format_map(numbers)

    def make_claim(self, data: pd.DataFrame) -> str:
        """Return the times."""
        text = "a row takes {quiet_us:.0f} µs, and {late_us:.0f} µs after a hold of {held_s:.0f} s"
        return text.format_map(measure_cost(data))


def measure_cost(data: pd.DataFrame) -> dict[str, Any]:
    """Measure the CPU times of quiet and held rows, and the growth of the memory."""
    quiet = data[(data.held_s > -2.0) & (data.held_s < -0.5)]
    held = data[(data.held_s >= 0.0) & (data.held_s < data.held_s.max() - 1.5)]
    steady = held[held.held_s >= min(4.0, held.held_s.iloc[-1])]
    return {
        "quiet_us": 1e6 * quiet.cpu_s.mean(),
        "early_us": 1e6 * held.cpu_s.iloc[:2].mean(),
        "late_us": 1e6 * held.cpu_s.iloc[-2:].mean(),
        "slowest_ms": 1e3 * data.slowest_s.max(),
        "growth_kB": 1e-3 * (steady.memory_bytes.iloc[-1] - steady.memory_bytes.iloc[0]),
        "held_s": float(held.held_s.iloc[-1]),
    }
