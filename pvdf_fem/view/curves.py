"""Common parts of figures: panels, names at the ends of curves, data as rings, labels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, TypeAlias

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from scipy.interpolate import Akima1DInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import split_unit
from pvdf_fem.view.figures import COLOURS, GREY, HALO, LABEL_SIZE, get_figure, make_figure

#: Width of a figure in mm: readable on a phone.
WIDTH_MM = 120.0
RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "white"}
DOT_SIZE = 2.4  #: Size in points of the dots at solved scenes.
#: Room per letter for names at the right ends of curves, over the panels' width.
ROOM = 0.018
#: Largest distance between curve ends with names beside them, over the width.
EARLY = 0.2
LEGEND_COLUMNS = 7
LINE_HEIGHT = 1.15  #: Distance of the lines of labels over their size.
MOST_PASSES = 60  #: Over the names, to move them apart.
SAMPLES = 121  #: Of a curve.
READING_LABELS = {"total": "charge (pC)", "change": "change by the touch (pC)"}


def format_axis_label(key: str) -> str:
    """A key of a scene in words, with its unit: ``film.thickness_um`` is film thickness (µm)."""
    words, unit = split_unit(key)
    words = words.removeprefix("load ").removeprefix("numerics ")
    return f"{words} ({unit.replace('degrees', '°')})" if unit else words


def format_value(key: str, value: Any) -> str:
    """A value of a key, a number with its unit: ``25 µm``."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    unit = split_unit(key)[1].replace("degrees", "°")
    return f"{value:g}{'' if unit == '°' else ' '}{unit}" if unit else f"{key} = {value:g}"


def choose_curve_colours(count: int) -> list[Any]:
    """Colours for curves: the common colours for a few curves, ordered shades for many."""
    if count <= len(COLOURS):
        return list(COLOURS[:count])
    shades = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, count))
    return [tuple(shade) for shade in shades]


#: A name with colour at a point, for instance at a curve's end.
End: TypeAlias = tuple[float, float, str, Any]


def draw_curves(
    panels: Sequence[Sequence[tuple[str, pd.DataFrame]]],
    x_label: str,
    y_label: str,
    log: bool = False,
) -> Figure:
    """Panels in rows from titles and tables, with a curve through every group of rows.

    The tables have the columns ``curve``, ``x``, ``computed_pC`` and ``charge_pC``. Rows without a
    ``charge_pC`` are points of a curve; further data are rings, with their differences below the
    panels.
    """
    names = list(dict.fromkeys(name for row in panels for _, of in row for name in of.curve))
    colours, ends = dict(zip(names, choose_curve_colours(len(names)), strict=True)), []
    with_data = [any(of.charge_pC.notna().any() for _, of in row) for row in panels]
    heights = [share for has in with_data for share in ([3.0, 1.0] if has else [3.0])]
    large, columns = 64.0 if len(panels) == 1 else 40.0, len(panels[0])
    wide = WIDTH_MM if columns < 3 else 1.25 * WIDTH_MM
    figure = make_figure(wide, 12.0 + len(panels) * large + sum(with_data) * 22.0)
    shared: dict[str, Any] = {"squeeze": False, "sharex": True, "sharey": "row"}
    shared["gridspec_kw"] = {"height_ratios": heights}
    axes = iter(figure.subplots(len(heights), columns, **shared))
    for row, has in zip(panels, with_data, strict=True):
        mains = next(axes)
        mains[0].set_ylabel(y_label)
        for ax, (title, frame) in zip(mains, row, strict=True):
            if log:
                _log_scales(ax)
            ends.append((ax, _draw_curves(ax, frame, colours)))
            ax.set_title(title)
        if has:
            _draw_strips(mains, next(axes), [frame for _, frame in row], colours)
        for ax in mains if x_label.endswith("(°)") else ():
            ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 9, 10]))
    figure.supxlabel(x_label)
    _name_curves(colours, ends, ROOM * columns * max(map(len, names)), log)
    return figure


def _name_curves(
    colours: Mapping[str, Any], ends: Sequence[tuple[Axes, Sequence[End]]], room: float, log: bool
) -> None:
    """Write the names of curves at their ends, or above all panels where some end early."""
    first, last = ends[0][0], [x for _, of in ends for x, *_ in of]
    low, high = first.get_xlim()
    if last and max(last) - min(last) > EARLY * (high - low):
        lines = [Line2D([], [], color=colour) for colour in colours.values()]
        where: dict[str, Any] = {"loc": "outside upper left", "ncols": LEGEND_COLUMNS}
        get_figure(first).legend(lines, list(colours), **where)
        return
    first.set_xlim(low, high * (high / low) ** room if log else high + room * (high - low))
    for ax, of in ends:
        label_points(ax, of)


def _draw_strips(
    mains: Sequence[Axes],
    strips: Sequence[Axes],
    frames: Sequence[pd.DataFrame],
    colours: Mapping[str, Any],
) -> None:
    """Draw the differences from the data below the panels with data."""
    drawn = [bool(frame.charge_pC.notna().any()) for frame in frames]
    strips[drawn.index(True)].set_ylabel("diff. (%)")
    for main, strip, frame, is_drawn in zip(mains, strips, frames, drawn, strict=True):
        if is_drawn:
            _draw_differences(strip, frame, colours)
        else:
            strip.remove()
            main.tick_params(labelbottom=True)


def _draw_curves(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> list[End]:
    """Curves with dots through computed charges, and rings for data."""
    own, ends = frame[frame.charge_pC.isna()], []
    for name, rows in own.groupby("curve", sort=False):
        x, q = rows.x.to_numpy(float), rows.computed_pC.to_numpy(float)
        colour = colours[str(name)]
        ax.plot(*_smooth(x, q), color=colour)
        ax.plot(x, q, "o", color=colour, markersize=DOT_SIZE)
        if q.size and np.isfinite(q[-1]):
            ends.append((x[-1], q[-1], str(name), colour))
    for name, rows in frame[frame.charge_pC.notna()].groupby("curve"):
        ax.plot(rows.x, rows.charge_pC, **RING, markeredgecolor=colours[str(name)], zorder=4)
    return ends


def _draw_differences(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> None:
    data = frame[frame.charge_pC.notna()]
    for name, rows in data.groupby("curve"):
        percent = 100.0 * (rows.computed_pC / rows.charge_pC - 1.0)
        ax.plot(rows.x, percent, **RING, markeredgecolor=colours[str(name)], markersize=3.5)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.margins(y=0.2)


def _log_scales(ax: Axes) -> None:
    """Logarithmic axes, whose ticks are plain numbers."""
    ax.set(xscale="log", yscale="log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def _smooth(x: Array, y: Array) -> tuple[Array, Array]:
    """A curve through points with values, without waves in between."""
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    if len(x) < 2:
        return x, y
    along = np.linspace(x[0], x[-1], SAMPLES)
    return along, Akima1DInterpolator(x, y, method="makima")(along)


def label_points(ax: Axes, ends: Sequence[End]) -> None:
    """Write names right of points, staggered vertically to avoid overlaps."""
    if not ends:
        return
    figure, size = get_figure(ax), LABEL_SIZE - 0.5
    figure.draw_without_rendering()  # lays the figure out
    point = figure.dpi / 72.0
    at = ax.transData.transform([end[:2] for end in ends])
    width = max(len(name) for _, _, name, _ in ends) * 0.65 * size * point
    heights = space_labels(at, width, LINE_HEIGHT * size * point)
    for (x, y, name, colour), moved in zip(ends, (heights - at[:, 1]) / point, strict=True):
        look: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": size}
        if abs(moved) > 0.6 * size:
            look["arrowprops"] = {"arrowstyle": "-", "color": colour, "lw": 0.5}
        aside = 8.0 if "arrowprops" in look else 3.0
        words = ax.annotate(name, (x, y), (aside, moved), color=colour, **look)
        words.set(in_layout=False, path_effects=[HALO], zorder=5)


def space_labels(at: Array, width: float, gap: float) -> Array:
    """Heights (n,) of labels near places (n, 2), a gap apart where they are within a width."""
    order, heights = np.argsort(at[:, 1], kind="stable").tolist(), at[:, 1].copy()
    pairs = [(a, b) for a, b in combinations(order, 2) if abs(at[a, 0] - at[b, 0]) < width]
    for _ in range(MOST_PASSES):
        for a, b in pairs:
            lack = max(gap - (heights[b] - heights[a]), 0.0)
            heights[[a, b]] += [-0.5 * lack, 0.5 * lack]
    return heights


def format_significant(value: float, error: float = 0.0) -> str:
    """A number with the digits that its error leaves, at most five; a dash for none."""
    if not math.isfinite(value):
        return "–"
    digits = 5 if not error > 0.0 else math.floor(math.log10(max(abs(value), error) / error)) + 2
    magnitude = math.floor(math.log10(abs(value))) if value else 0
    decimals = max(min(digits, 5) - 1 - magnitude, 0)
    return f"{value:.{decimals}f}".replace("-", "−")


def format_signed(value: float, decimals: int = 1) -> str:
    """A number with its sign."""
    return f"{value:+.{decimals}f}".replace("-", "−") if math.isfinite(value) else "–"


def join_words(words: Sequence[str]) -> str:
    """Words in a sentence: ``A, B and C``."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else list(words))
