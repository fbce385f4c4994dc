"""Drawings of the report on accuracy, and numbers as its tables show them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from pvdf_fem.view.figures import (
    COLOURS,
    GREY,
    HALO,
    LABEL_SIZE,
    WIDTH_MM,
    get_figure,
    make_figure,
)
from reports.accuracy.cases import SOURCES
from reports.accuracy.measure import STAGES
from reports.accuracy.results import OURS, PEER

#: A stated error is a good one between these multiples of the true error.
GOOD_LOW = 0.3
GOOD_HIGH = 3.0
LEAST_ERROR = 1e-8  #: The smallest error that is drawn.
#: Colours by the kind of truth.
SOURCE_COLOURS = dict(zip(SOURCES, COLOURS, strict=False))


def draw_errors_against_time(ax: Axes, runs: pd.DataFrame) -> None:
    """Draw a curve for each case, coloured by how its charges are known, and medians by tolerance.

    Parameters
    ----------
    ax : Axes
        The axes.
    runs : DataFrame
        A row for each solve.
    """
    for _, rows in runs.groupby("case", sort=False):
        colour = SOURCE_COLOURS[rows.source.iloc[0]]
        errors = rows.true.clip(LEAST_ERROR)
        ax.plot(rows.seconds, errors, "-", color=colour, linewidth=0.8, alpha=0.7)
        ax.plot(rows.seconds, errors, "o", color=colour, markersize=2.2)
    for source, colour in SOURCE_COLOURS.items():
        ax.plot([], [], color=colour, label=f"known {SOURCES[source]}")
    medians = runs.groupby("tolerance")[["seconds", "true"]].median()
    look: dict[str, Any] = {"markersize": 5.0, "zorder": 4}
    ax.plot(medians.seconds, medians.true, "ks", label="medians by tolerance", **look)
    for row in medians.reset_index().itertuples():
        ax.annotate(
            format_percent(row.tolerance),
            (row.seconds, row.true),
            (6, 3),
            textcoords="offset points",
            path_effects=[HALO],
            zorder=5,
            fontsize=LABEL_SIZE,
            fontweight="bold",
        )
    ax.set(xlabel="processor seconds", ylabel="true error of the worst charge")
    set_log_scales(ax)
    get_figure(ax).legend(loc="outside upper left", ncols=2)


def set_log_scales(ax: Axes) -> None:
    """Give axes logarithmic scales, with seconds and percents at the ticks."""
    ax.set(xscale="log", yscale="log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.yaxis.set_major_formatter(lambda error, _: format_percent(error))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())


def draw_stated_against_true(ax: Axes, charges: pd.DataFrame) -> None:
    """Draw stated over true errors in units of the tolerance, and lines of equal ratios.

    Parameters
    ----------
    ax : Axes
        The axes.
    charges : DataFrame
        A row for each charge, with its ``group``.
    """
    limits = np.array([1e-4, 10.0])
    for group, colour in zip(charges.group.unique(), COLOURS, strict=False):
        rows = charges[charges.group == group]
        true = rows.true / rows.tolerance
        stated = rows.stated / rows.tolerance
        ax.plot(true, stated, "o", color=colour, markersize=2.6, alpha=0.7, label=group)
    for ratio in (GOOD_LOW, 1.0, GOOD_HIGH):
        dashes = "-" if ratio == 1.0 else "--"
        ax.plot(limits, ratio * limits, dashes, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xscale="log", yscale="log", xlim=limits, ylim=limits)
    ax.set(xlabel="true error / tolerance", ylabel="stated error / tolerance")
    ax.legend()


def make_case_panels(count: int) -> list[Axes]:
    """Return the axes of a new figure with a panel for each case, three in a row."""
    columns = min(count, 3)
    rows = math.ceil(count / columns)
    figure = make_figure(1.25 * WIDTH_MM, 12.0 + 52.0 * rows)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for ax in axes.flat[count:]:
        ax.set_axis_off()
    for ax in axes.flat[count - columns : count]:
        ax.tick_params(labelbottom=True)
    return list(axes.flat[:count])


def draw_beside_peer(axes: Sequence[Axes], runs: pd.DataFrame, names: Sequence[str]) -> None:
    """Draw true errors over seconds of both codes.

    Parameters
    ----------
    axes : sequence of Axes
        A panel for each case.
    runs : DataFrame
        A row for each solve.
    names : sequence of str
        Names of the cases.
    """
    for ax, name in zip(axes, names, strict=True):
        for code, dashes, colour in ((OURS, "o-", COLOURS[0]), (PEER, "s:", COLOURS[1])):
            best = select_best(runs[(runs.case == name) & (runs.code == code)])
            ax.plot(best.seconds, best.true, dashes, color=colour, markersize=3.0, label=code)
        ax.set_title(name)
        set_log_scales(ax)
    axes[0].legend()
    figure = get_figure(axes[0])
    figure.supxlabel("processor seconds", fontsize=LABEL_SIZE + 1.0)
    figure.supylabel("true error of the worst charge", fontsize=LABEL_SIZE + 1.0)


def make_bar_axes(count: int) -> Axes:
    """Return the axes of a new figure with horizontal bars."""
    return make_figure(WIDTH_MM, 24.0 + 6.0 * count).subplots()


def draw_stages(ax: Axes, frame: pd.DataFrame) -> None:
    """Draw the seconds of the stages of each solve as a bar.

    Parameters
    ----------
    ax : Axes
        The axes.
    frame : DataFrame
        A row for each solve.
    """
    names = [f"{row.case}, {format_percent(row.tolerance)}" for row in frame.itertuples()]
    start = np.zeros(len(names))
    for stage, colour in zip(STAGES, COLOURS, strict=False):
        ax.barh(names, frame[stage], left=start, color=colour, height=0.6, label=stage)
        start += frame[stage].to_numpy()
    ax.invert_yaxis()
    ax.set_xlabel("processor seconds")
    get_figure(ax).legend(loc="outside upper left", ncols=len(STAGES))


def select_best(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs to which no other one is superior in both time and error, by time."""
    runs = runs.sort_values(["seconds", "true"])
    return runs[runs.true <= runs.true.cummin()]


def summarize_group(charges: pd.DataFrame) -> dict[str, str]:
    """Return a row of the table: how good the stated errors of a group of charges are."""
    largest = (charges.true / charges.tolerance).max()
    return {
        "scenes": str(charges.group.iloc[0]),
        "charges": str(len(charges)),
        f"{GOOD_LOW:g} to {GOOD_HIGH:g}": format_share(charges.ratio, GOOD_LOW, GOOD_HIGH),
        f"below {GOOD_LOW:g}": format_share(charges.ratio, 0.0, GOOD_LOW),
        "worst error / tolerance": f"{largest:.2f}",
    }


def format_seconds(value: float) -> str:
    """Format seconds; a dash stands for NaN."""
    return f"{value:.2f}" if math.isfinite(value) else "–"


def format_percent(share: float) -> str:
    """Format a share in percent with two digits, or as a power of ten below a millionth."""
    text = f"{100.0 * share:.2g} %" if share >= 1e-6 else f"{100.0 * share:.0e} %"
    return text.replace("e-0", "e-").replace("-", "−")


def format_share(ratios: pd.Series, low: float, high: float) -> str:
    """Format the share of ratios from `low` to below `high` in percent."""
    if ratios.empty:
        return "–"
    percent = 100.0 * float(((ratios >= low) & (ratios < high)).mean())
    decimals = 1 if 0.0 < percent < 1.0 else 0
    return f"{percent:.{decimals}f} %"
