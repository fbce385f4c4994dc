"""Figures of the report on error against run time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE, new_figure, save, style
from reports.speed.cases import Case, Reference
from reports.speed.growth import Size
from reports.speed.runs import GOAL, OURS, UNIFORM, Run
from reports.speed.stages import STAGES

WIDTH_MM, PANEL_MM, LEGEND_MM = 185.0, 48.0, 32.0
TITLE_SIZE = 8
COLUMNS = 3
MARKERS = "osD^v"
#: Errors below this are drawn on it.
LEAST_ERROR = 1e-8


@dataclass(frozen=True)
class Look:
    """How the runs of one method are drawn."""

    label: str
    colour: str
    marker: str
    line: str

    @property
    def options(self) -> dict[str, Any]:
        """For `Axes.plot`."""
        return {
            "color": self.colour,
            "marker": self.marker,
            "linestyle": self.line,
            "markersize": 3.5,
            "linewidth": 1.1,
            "label": self.label,
        }


def our_looks(orders: Sequence[int]) -> dict[tuple[str, str], Look]:
    """Filled and solid: meshes for the tolerance; open and dashed: uniform families."""
    looks = {}
    for order, colour in zip(orders, COLOURS, strict=False):
        marker = MARKERS[order - 1]
        for method, line in ((GOAL, "-"), (UNIFORM, "--")):
            name = f"order {order}, {method}"
            looks[OURS, name] = Look(name, colour, marker, line)
    return looks


def peer_looks(keys: Iterable[tuple[str, str]]) -> dict[tuple[str, str], Look]:
    """Order 3 of this code in the first colour, each method of a peer in one of its own."""
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
    cases: Sequence[Case],
    runs: Sequence[Run],
    references: dict[str, Reference],
    looks: dict[tuple[str, str], Look],
    abscissa: str,
) -> None:
    """A panel for each case: error of the worst charge against `abscissa`.

    `abscissa` is ``seconds``, ``solving`` or ``unknowns``. Failed runs are crosses on the axis.
    """
    rows = -(-len(cases) // COLUMNS)
    with style():
        figure = new_figure(WIDTH_MM, PANEL_MM * rows + LEGEND_MM)
        axes = list(figure.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False).flat)
        for ax, case in zip(axes, cases, strict=False):
            mine = [run for run in runs if run.job.case.name == case.name]
            for (code, method), look in looks.items():
                some = [r for r in mine if (r.job.code, r.job.method) == (code, method)]
                _curve(ax, some, look, abscissa)
            ax.axhspan(LEAST_ERROR, max(references[case.name].doubt, LEAST_ERROR), color="0.92")
            ax.set(xscale="log", yscale="log")
            ax.set_title(case.title, fontsize=TITLE_SIZE)
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


def _curve(ax: Axes, runs: Sequence[Run], look: Look, abscissa: str) -> None:
    good = [run for run in runs if run.converged]
    x = [run.outcome.unknowns if abscissa == "unknowns" else getattr(run, abscissa) for run in good]
    y = [max(run.error, LEAST_ERROR) for run in good]
    ax.plot(x, y, **look.options)
    for number, _ in enumerate(run for run in runs if not run.converged):
        place = 0.97 - 0.04 * number
        ax.plot([place], [0.02], "x", color=look.colour, transform=ax.transAxes, clip_on=False)


def stage_bars(path: Path, shares: dict[str, dict[str, float]]) -> None:
    """Shares of the stages as stacked bars, one for each key of `shares`, with its seconds."""
    with style():
        figure = new_figure(WIDTH_MM, 25.0 + 5.5 * len(shares))
        ax = figure.subplots()
        places = np.arange(len(shares))[::-1]
        total = np.array([seconds["total"] for seconds in shares.values()])
        left = np.zeros(len(shares))
        for stage, colour in zip(STAGES, COLOURS, strict=False):
            width = 100.0 * np.array([seconds[stage] for seconds in shares.values()]) / total
            ax.barh(places, width, left=left, color=colour, label=stage, height=0.7)
            left += width
        for place, seconds in zip(places.tolist(), total.tolist(), strict=True):
            ax.text(101.0, place, f"{seconds:.2f} s", va="center", fontsize=LABEL_SIZE)
        ax.set_yticks(places, list(shares))
        ax.set(xlabel="share of the seconds (%)", xlim=(0.0, 100.0))
        ax.grid(axis="y", visible=False)
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(STAGES))
        save(figure, path)


def against_tolerance(path: Path, runs: Sequence[Run]) -> None:
    """Seconds, and true error over tolerance, against 1/tolerance; a line for each case."""
    names = list(dict.fromkeys(run.job.case.name for run in runs))
    with style():
        figure = new_figure(WIDTH_MM, 85.0)
        above, below = figure.subplots(1, 2)
        for number, name in enumerate(names):
            some = sorted(
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
            x = [1.0 / run.job.setting for run in some]
            above.plot(x, [run.seconds for run in some], **look)
            below.plot(x, [run.error / run.job.setting for run in some], **look)
        below.axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
        above.set(ylabel="seconds, estimate included")
        below.set(ylabel="true error / tolerance")
        for ax in (above, below):
            ax.set(xscale="log", yscale="log", xlabel="1 / tolerance")
        figure.legend(
            *above.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=7.5
        )
        save(figure, path)


def growth(path: Path, sizes: Sequence[Size]) -> None:
    """Seconds by stage and memory against unknowns."""
    good = [size for size in sizes if size.seconds is not None]
    x = [size.unknowns for size in good]
    with style():
        figure = new_figure(WIDTH_MM, 75.0)
        left, right = figure.subplots(1, 2)
        for stage, colour in zip(("total", "solve", "estimate", "mesh"), COLOURS, strict=False):
            y = [(size.seconds or {}).get(stage, np.nan) for size in good]
            left.plot(x, y, "o-", color=colour, label=stage)
        right.plot(x, [size.memory_MiB for size in good], "o-", label="largest")
        right.plot(x, [size.idle_MiB for size in good], "--", color=GREY, label="after the imports")
        left.set(ylabel="seconds")
        right.set(ylabel="memory (MiB)")
        for ax in (left, right):
            ax.set(xscale="log", yscale="log", xlabel="unknowns")
            ax.legend()
        save(figure, path)


def effectivity(path: Path, found: dict[str, list[float]]) -> None:
    """Histograms of estimated over true error, by method."""
    bins = np.linspace(-1.5, 1.5, 31)
    count = max(len(found), 1)
    with style():
        figure = new_figure(WIDTH_MM, 20.0 + 26.0 * -(-count // 2))
        axes = list(figure.subplots(-(-count // 2), 2, sharex=True, squeeze=False).flat)
        for ax, (method, values) in zip(axes, sorted(found.items()), strict=False):
            logs = np.clip(np.log10(np.maximum(values, 1e-12)), bins[0], bins[-1])
            ax.hist(logs, bins, color=COLOURS[0 if GOAL in method else 4])
            ax.axvline(0.0, color=GREY, linewidth=0.9)
            for limit in (0.3, 3.0):
                ax.axvline(np.log10(limit), color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
            ax.set_title(f"{method}: {len(values)} charges")
        for ax in axes[len(found) :]:
            ax.set_axis_off()
        figure.supxlabel("log10 (estimated / true error); outermost bars: beyond", fontsize=9)
        figure.supylabel("charges", fontsize=9)
        save(figure, path)
