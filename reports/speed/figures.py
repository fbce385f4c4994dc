"""Figures of the report on error against run time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE, new_figure, style
from reports.common.figures import save
from reports.speed.cases import BenchmarkCase, Reference
from reports.speed.growth import Size
from reports.speed.runs import GOAL, OURS, UNIFORM, TimedRun
from reports.speed.stages import STAGES

#: Width of all figures in mm.
WIDTH_MM = 185.0
#: Relative error at which smaller ones are drawn.
LEAST_ERROR = 1e-8
MARKERS = "osD^v"


@dataclass(frozen=True)
class Look:
    """How the runs of one method are drawn."""

    label: str
    colour: str
    marker: str
    line: str

    @property
    def options(self) -> dict[str, Any]:
        """Options of `Axes.plot`."""
        return {
            "color": self.colour,
            "marker": self.marker,
            "linestyle": self.line,
            "markersize": 3.5,
            "linewidth": 1.1,
            "label": self.label,
        }


def our_looks(orders: Sequence[int]) -> dict[tuple[str, str], Look]:
    """Looks of this code's methods: solid for a tolerance, dashed for uniform families."""
    looks = {}
    for order, colour in zip(orders, COLOURS, strict=False):
        marker = MARKERS[order - 1]
        for method, line in ((GOAL, "-"), (UNIFORM, "--")):
            name = f"order {order}, {method}"
            looks[OURS, name] = Look(name, colour, marker, line)
    return looks


def peer_looks(keys: Iterable[tuple[str, str]]) -> dict[tuple[str, str], Look]:
    """Looks of order 3 of this code in the first colour, and of each peer's method in another."""
    looks = {key: look for key, look in our_looks((3,)).items() if key in set(keys)}
    for key, look in looks.items():
        looks[key] = replace(look, colour=COLOURS[0], label=f"{OURS}, {look.label}")
    for number, (code, method) in enumerate(sorted(set(keys) - set(looks))):
        if code != OURS:
            colour, marker = COLOURS[1 + number % 6], MARKERS[number % 5]
            looks[code, method] = Look(f"{code}, {method}", colour, marker, ":")
    return looks


def work_precision(
    path: Path,
    cases: Sequence[BenchmarkCase],
    runs: Sequence[TimedRun],
    references: dict[str, Reference],
    looks: dict[tuple[str, str], Look],
    abscissa: str,
    columns: int = 3,
) -> None:
    """Draw the error of the worst charge against `abscissa`, a panel for each case.

    `abscissa` is ``seconds``, ``solving`` or ``unknowns``. Failed runs are crosses on the axis.
    """
    rows = -(-len(cases) // columns)
    with style():
        figure = new_figure(WIDTH_MM, 48.0 * rows + 32.0)  # panels and the legend above them
        axes = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for ax, case in zip(axes, cases, strict=False):
            case_runs = [run for run in runs if run.job.case.name == case.name]
            for (code, method), look in looks.items():
                method_runs = [r for r in case_runs if (r.job.code, r.job.method) == (code, method)]
                _curve(ax, method_runs, look, abscissa)
            ax.axhspan(LEAST_ERROR, max(references[case.name].doubt, LEAST_ERROR), color="0.92")
            ax.set(xscale="log", yscale="log")
            ax.set_title(case.title, fontsize=8)
        _label_decades(axes[0])
        for ax in axes[len(cases) :]:
            ax.set_axis_off()
        handles = [Line2D([], [], **look.options) for look in looks.values()]
        handles.append(Line2D([], [], color="0.92", linewidth=6, label="doubt of the reference"))
        handles.append(Line2D([], [], color=GREY, marker="x", linestyle="none", label="failed"))
        figure.legend(handles=handles, loc="outside upper center", ncols=3)
        label = {
            "unknowns": "unknowns",
            "solving": "seconds, without estimates that a method can do without",
        }
        figure.supxlabel(label.get(abscissa, "seconds"), fontsize=9)
        figure.supylabel("relative error of the worst charge", fontsize=9)
        save(figure, path)


def _label_decades(ax: Axes) -> None:
    """Widen the abscissae to a decade; up to two of them have labels at 1, 2 and 5."""
    low, high = np.log10(ax.get_xlim())
    beyond = max(0.0, 0.5 * (1.0 - (high - low)))
    ax.set_xlim(10.0 ** (low - beyond), 10.0 ** (high + beyond))
    ax.xaxis.set_minor_formatter(NullFormatter())
    if high - low < 2.0:
        for set_formatter in (ax.xaxis.set_major_formatter, ax.xaxis.set_minor_formatter):
            set_formatter(lambda x, _: f"{x:g}" if f"{x:.0e}"[0] in "125" else "")


def _curve(ax: Axes, runs: Sequence[TimedRun], look: Look, abscissa: str) -> None:
    converged = [run for run in runs if run.converged]
    x = [
        run.outcome.unknowns if abscissa == "unknowns" else getattr(run, abscissa)
        for run in converged
    ]
    y = [max(run.error, LEAST_ERROR) for run in converged]
    ax.plot(x, y, **look.options)
    for number, _ in enumerate(run for run in runs if not run.converged):
        place = 0.97 - 0.04 * number
        ax.plot([place], [0.02], "x", color=look.colour, transform=ax.transAxes, clip_on=False)


def stage_bars(path: Path, shares: dict[str, dict[str, float]]) -> None:
    """Draw shares of the stages as stacked bars, one for each key of `shares`."""
    with style():
        figure = new_figure(WIDTH_MM, 25.0 + 5.5 * len(shares))
        ax = figure.subplots()
        places = np.arange(len(shares))[::-1]
        total = np.array([seconds["total"] for seconds in shares.values()])
        starts = np.zeros(len(shares))
        for stage, colour in zip(STAGES, COLOURS, strict=False):
            width = 100.0 * np.array([seconds[stage] for seconds in shares.values()]) / total
            ax.barh(places, width, left=starts, color=colour, label=stage, height=0.7)
            starts += width
        for place, seconds in zip(places.tolist(), total.tolist(), strict=True):
            ax.text(101.0, place, f"{seconds:.2f} s", va="center", fontsize=LABEL_SIZE)
        ax.set_yticks(places, list(shares))
        ax.set(xlabel="share of the seconds (%)", xlim=(0.0, 100.0))
        ax.grid(axis="y", visible=False)
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(STAGES))
        save(figure, path)


def against_tolerance(path: Path, runs: Sequence[TimedRun]) -> None:
    """Draw seconds and true error over tolerance against 1/tolerance, a line for each case."""
    names = list(dict.fromkeys(run.job.case.name for run in runs))
    with style():
        figure = new_figure(WIDTH_MM, 85.0)
        seconds_ax, error_ax = figure.subplots(1, 2)
        for number, name in enumerate(names):
            case_runs = sorted(
                (run for run in runs if run.job.case.name == name and run.converged),
                key=lambda run: -run.job.setting,
            )
            look = {
                "color": COLOURS[number % len(COLOURS)],
                "marker": MARKERS[number % 5],
                "linewidth": 0.9,
                "markersize": 3.5,
                "label": name,
            }
            x = [1.0 / run.job.setting for run in case_runs]
            seconds_ax.plot(x, [run.seconds for run in case_runs], **look)
            error_ax.plot(x, [run.error / run.job.setting for run in case_runs], **look)
        error_ax.axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
        seconds_ax.set(ylabel="seconds, estimate included")
        error_ax.set(ylabel="true error / tolerance")
        for ax in (seconds_ax, error_ax):
            ax.set(xscale="log", yscale="log", xlabel="1 / tolerance")
        figure.legend(
            *seconds_ax.get_legend_handles_labels(),
            loc="outside lower center",
            ncols=6,
            fontsize=7.5,
        )
        save(figure, path)


def growth(path: Path, sizes: Sequence[Size]) -> None:
    """Draw seconds by stage, and memory, against unknowns."""
    solved = [size for size in sizes if size.seconds is not None]
    x = [size.unknowns for size in solved]
    with style():
        figure = new_figure(WIDTH_MM, 75.0)
        seconds_ax, memory_ax = figure.subplots(1, 2)
        for stage, colour in zip(("total", "solve", "estimate", "mesh"), COLOURS, strict=False):
            y = [(size.seconds or {}).get(stage, np.nan) for size in solved]
            seconds_ax.plot(x, y, "o-", color=colour, label=stage)
        memory_ax.plot(x, [size.memory_MiB for size in solved], "o-", label="largest")
        memory_ax.plot(
            x, [size.idle_MiB for size in solved], "--", color=GREY, label="after the imports"
        )
        seconds_ax.set(ylabel="seconds")
        memory_ax.set(ylabel="memory (MiB)")
        for ax in (seconds_ax, memory_ax):
            ax.set(xscale="log", yscale="log", xlabel="unknowns")
            ax.legend()
        save(figure, path)


def effectivity(path: Path, ratios: dict[str, list[float]]) -> None:
    """Draw histograms of estimated over true error, by method."""
    bins = np.linspace(-1.5, 1.5, 31)
    count = max(len(ratios), 1)
    with style():
        figure = new_figure(WIDTH_MM, 20.0 + 26.0 * -(-count // 2))
        axes = list(figure.subplots(-(-count // 2), 2, sharex=True, squeeze=False).flat)
        for ax, (method, values) in zip(axes, sorted(ratios.items()), strict=False):
            logs = np.clip(np.log10(np.maximum(values, 1e-12)), bins[0], bins[-1])
            ax.hist(logs, bins, color=COLOURS[0 if GOAL in method else 4])
            ax.axvline(0.0, color=GREY, linewidth=0.9)
            for limit in (0.3, 3.0):
                ax.axvline(np.log10(limit), color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
            ax.set_title(f"{method}: {len(values)} charges")
        for ax in axes[len(ratios) :]:
            ax.set_axis_off()
        figure.supxlabel("log10 (estimated / true error); outermost bars: beyond", fontsize=9)
        figure.supylabel("charges", fontsize=9)
        save(figure, path)
