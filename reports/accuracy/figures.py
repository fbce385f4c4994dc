"""Figures of the report on accuracy, and numbers as its tables show them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from pvdf_fem.view.figures import COLOURS, GREY, HALO, LABEL_SIZE, WIDTH_MM, make_figure
from reports.accuracy.cases import SOURCES
from reports.accuracy.measure import STAGES
from reports.accuracy.results import OURS, PEER

LOW, HIGH = 0.3, 3.0  #: Between these multiples of the true error a stated error is a good one.
LEAST = 1e-8  #: The smallest error that is drawn.
COLOUR = dict(zip(SOURCES, COLOURS, strict=False))


def errors_against_time(runs: pd.DataFrame) -> Figure:
    """A curve for each case, coloured by what is known of it, and the medians by tolerance."""
    figure = make_figure(WIDTH_MM, 92.0)
    ax = figure.subplots()
    for _, rows in runs.groupby("case", sort=False):
        colour = COLOUR[rows.source.iloc[0]]
        ax.plot(rows.seconds, rows.true.clip(LEAST), "-", color=colour, linewidth=0.8, alpha=0.7)
        ax.plot(rows.seconds, rows.true.clip(LEAST), "o", color=colour, markersize=2.2)
    for source, colour in COLOUR.items():
        ax.plot([], [], color=colour, label=f"known {SOURCES[source]}")
    medians = runs.groupby("tolerance")[["seconds", "true"]].median()
    ax.plot(
        medians.seconds, medians.true, "ks", markersize=5.0, label="medians by tolerance", zorder=4
    )
    about: dict[str, Any] = {"textcoords": "offset points", "path_effects": [HALO], "zorder": 5}
    about |= {"fontsize": LABEL_SIZE, "fontweight": "bold"}
    for row in medians.reset_index().itertuples():
        ax.annotate(percent(row.tolerance), (row.seconds, row.true), (6, 3), **about)
    ax.set(xlabel="processor seconds", ylabel="true error of the worst charge")
    logarithmic(ax)
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def logarithmic(ax: Axes) -> None:
    """Seconds and errors on logarithmic scales, with plain numbers and percents at the ticks."""
    ax.set(xscale="log", yscale="log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.yaxis.set_major_formatter(lambda error, _: percent(error))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())


def stated_against_true(told: pd.DataFrame) -> Figure:
    """Dots in units of the tolerance by group, and lines of equal ratios."""
    figure = make_figure(WIDTH_MM, 100.0)
    ax, ends = figure.subplots(), np.array([1e-4, 10.0])
    for group, colour in zip(told.group.unique(), COLOURS, strict=False):
        rows = told[told.group == group]
        scaled = rows.true / rows.tolerance, rows.stated / rows.tolerance
        ax.plot(*scaled, "o", color=colour, markersize=2.6, alpha=0.7, label=group)
    for ratio in (LOW, 1.0, HIGH):
        dashes = "-" if ratio == 1.0 else "--"
        ax.plot(ends, ratio * ends, dashes, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
    ax.set(xlabel="true error / tolerance", ylabel="stated error / tolerance")
    ax.legend()
    return figure


def beside_peer(runs: pd.DataFrame, names: Sequence[str]) -> Figure:
    """True errors against seconds of both codes, a panel for each case."""
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure = make_figure(1.25 * WIDTH_MM, 12.0 + 52.0 * rows)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for ax, name in zip(axes.flat, names, strict=False):
        for code, dashes, colour in ((OURS, "o-", COLOURS[0]), (PEER, "s:", COLOURS[1])):
            of = best(runs[(runs.case == name) & (runs.code == code)])
            ax.plot(of.seconds, of.true, dashes, color=colour, markersize=3.0, label=code)
        ax.set_title(name)
        logarithmic(ax)
    for ax in axes.flat[len(names) :]:
        ax.set_axis_off()
    for ax in axes.flat[len(names) - columns : len(names)]:
        ax.tick_params(labelbottom=True)
    axes.flat[0].legend()
    figure.supxlabel("processor seconds", fontsize=LABEL_SIZE + 1.0)
    figure.supylabel("true error of the worst charge", fontsize=LABEL_SIZE + 1.0)
    return figure


def stage_bars(frame: pd.DataFrame) -> Figure:
    """A bar of the seconds of stages for each case and tolerance."""
    names = [f"{row.case}, {percent(row.tolerance)}" for row in frame.itertuples()]
    figure = make_figure(WIDTH_MM, 24.0 + 6.0 * len(names))
    ax, start = figure.subplots(), np.zeros(len(names))
    for stage, colour in zip(STAGES, COLOURS, strict=False):
        ax.barh(names, frame[stage], left=start, color=colour, height=0.6, label=stage)
        start += frame[stage].to_numpy()
    ax.invert_yaxis()
    ax.set_xlabel("processor seconds")
    figure.legend(loc="outside upper left", ncols=len(STAGES))
    return figure


def best(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs that no other one beats in both time and error, by time."""
    runs = runs.sort_values(["seconds", "true"])
    return runs[runs.true <= runs.true.cummin()]


def group_row(of: pd.DataFrame) -> dict[str, str]:
    """Stated errors of a group of charges: how good they are."""
    over = of.true / of.tolerance
    return {
        "scenes": str(of.group.iloc[0]),
        "charges": str(len(of)),
        f"{LOW:g} to {HIGH:g}": share(of.ratio, LOW, HIGH),
        f"below {LOW:g}": share(of.ratio, 0.0, LOW),
        "worst error / tolerance": f"{over.max():.2f}",
    }


def seconds(value: float) -> str:
    """Seconds, or a dash for none."""
    return f"{value:.2f}" if math.isfinite(value) else "–"


def percent(part: float) -> str:
    """A part in percent, of two digits; as a power of ten where it is below a millionth."""
    text = f"{100.0 * part:.2g} %" if part >= 1e-6 else f"{100.0 * part:.0e} %"
    return text.replace("e-0", "e-").replace("-", "−")


def share(ratios: pd.Series, low: float, high: float) -> str:
    """How many ratios are within limits, in percent."""
    if ratios.empty:
        return "–"
    part = 100.0 * float(((ratios >= low) & (ratios < high)).mean())
    return f"{part:.{int(0.0 < part < 1.0)}f} %"
