"""What figures of all kinds share: panels, names at the ends of curves, data as rings, labels."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from scipy.interpolate import CubicSpline

from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS, GREY, HALO, LABEL_SIZE, figure_of, new_figure

#: Width of a figure in mm: as wide as a phone shows it with readable texts.
WIDTH_MM = 120.0
RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "white"}
DOT_SIZE = 2.4  #: Size in points of the dots at solved scenes.
ROOM = 0.13  #: Room for names at the right end of curves, over the axes' width.
LINE_HEIGHT = 1.15  #: Distance of the lines of labels over their size.
SAME = 5e-3  #: Curves closer than this share of the largest value have one name.
SAMPLES = 121  #: Of a curve.
LEAST_FOR_CURVE = 4  #: Points that a cubic spline goes through.
READING_LABELS = {"total": "charge (pC)", "change": "change by the touch (pC)"}
_SIGNS = {"um": "µm", "deg": "°", "MOhm": "MΩ", "pC_N": "pC/N", "kg_m3": "kg/m³", "N_m": "N/m"}
_SIGNS |= {"per_K": "1/K", "uC_m2K": "µC/m²K", "m2_s": "m²/s"}
_UNITS = (*_SIGNS, "mm", "GPa", "pF", "pC", "K", "N", "V", "s", "Hz")


def axis_label(key: str) -> str:
    """A key of a scene in words, with its unit: ``film.thickness_um`` is film thickness (µm)."""
    pattern = "|".join(sorted(_UNITS, key=len, reverse=True))
    found = re.search(rf"_({pattern})$", key)
    words = re.sub(r"[._]", " ", key[: found.start()] if found else key)
    words = words.removeprefix("load ").removeprefix("numerics ")
    return f"{words} ({_SIGNS.get(found[1], found[1])})" if found else words


def value_label(key: str, value: float) -> str:
    """A value of a key with its unit: ``25 µm``."""
    found = re.search(r"\((.+)\)$", axis_label(key))
    unit = found[1] if found else ""
    return f"{value:g}{'' if unit == '°' else ' '}{unit}".rstrip() if unit else f"{key} = {value:g}"


def colours_for(count: int) -> list[Any]:
    """Colours of curves: those of all figures for a few, shades in their order for many."""
    if count <= 5:
        return list(COLOURS[:count])
    shades = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, count))
    return [tuple(shade) for shade in shades]


@dataclass(frozen=True)
class End:
    """A name at the end of a curve."""

    x: float
    y: float
    words: str
    colour: Any


def curves_figure(
    panels: Sequence[Sequence[tuple[str, pd.DataFrame]]],
    x_label: str,
    y_label: str,
    log: bool = False,
) -> Figure:
    """Panels in rows, each of a title and a table, with a curve through each group of its rows.

    The tables have the columns ``curve``, ``x``, ``computed_pC`` and ``charge_pC``. Rows without the
    latter are points of a curve, the others are rings, and their differences stand below.
    """
    tables = pd.concat([frame for row in panels for _, frame in row])
    strips, names = bool(tables.charge_pC.notna().any()), list(dict.fromkeys(tables.curve))
    rows, columns, per_row = len(panels), len(panels[0]), 1 + strips
    height = (64.0 if rows == 1 else 46.0) + 22.0 * strips
    figure = new_figure(WIDTH_MM if columns == 1 else 1.25 * WIDTH_MM, 12.0 + rows * height)
    heights = {"height_ratios": [3.0, 1.0][:per_row] * rows}
    shared: dict[str, Any] = {"squeeze": False, "sharex": True, "sharey": "row"}
    axes = figure.subplots(rows * per_row, columns, gridspec_kw=heights, **shared)
    colours, ends = dict(zip(names, colours_for(len(names)), strict=True)), []
    for i, row in enumerate(panels):
        for j, (title, frame) in enumerate(row):
            ax = axes[i * per_row, j]
            if log:
                _log_scales(ax)
            ends.append((ax, _draw_curves(ax, frame, colours)))
            ax.set_title(title)
            if strips:
                _draw_differences(axes[i * per_row + 1, j], frame, colours)
        axes[i * per_row, 0].set_ylabel(y_label)
        if strips:
            axes[i * per_row + 1, 0].set_ylabel("diff. (%)")
    for ax in axes[-1]:
        ax.set_xlabel(x_label)
    _room_for_names(axes[0, 0], log)
    for ax, of in ends:
        _label_ends(ax, of)
    return figure


def _draw_curves(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> list[End]:
    """Curves through computed charges with dots, and rings for those of others."""
    own, ends = frame[frame.charge_pC.isna()], []
    curves = {str(name): rows for name, rows in own.groupby("curve", sort=False)}
    for names, rows in _merged(curves).items():
        x, q = rows.x.to_numpy(float), rows.computed_pC.to_numpy(float)
        colour = colours[names.split(", ")[0]]
        ax.plot(*_smooth(x, q), color=colour)
        ax.plot(x, q, "o", color=colour, markersize=DOT_SIZE)
        if q.size and np.isfinite(q[-1]):
            ends.append(End(x[-1], q[-1], names, colour))
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
    """A curve through the points that have values: a cubic spline, or chords between few points."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < LEAST_FOR_CURVE:
        return x, y
    along = np.linspace(x[0], x[-1], SAMPLES)
    return along, CubicSpline(x, y)(along)


def _merged(curves: Mapping[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    """Curves by name, those that coincide under one name: ``A, C``."""
    found: list[tuple[list[str], pd.DataFrame]] = []
    size = max((float(rows.computed_pC.abs().max()) for rows in curves.values()), default=0.0)
    for name, rows in curves.items():
        values = rows[["x", "computed_pC"]].to_numpy(float)
        for names, other in found:
            those = other[["x", "computed_pC"]].to_numpy(float)
            if those.shape == values.shape and np.allclose(
                values, those, rtol=1e-9, atol=[1e-6, SAME * size], equal_nan=True
            ):
                names.append(name)
                break
        else:
            found.append(([name], rows))
    return {", ".join(names): rows for names, rows in found}


def _label_ends(ax: Axes, ends: Sequence[End]) -> None:
    """Write names right of the ends of curves, above each other where they would overlap."""
    figure = figure_of(ax)
    figure.draw_without_rendering()
    points = figure.dpi / 72.0
    size, gap = LABEL_SIZE - 0.5, (LABEL_SIZE - 0.5) * LINE_HEIGHT * points
    at = ax.transData.transform([(end.x, end.y) for end in ends]).reshape(-1, 2)
    width = max(len(end.words) for end in ends) * 0.65 * size * points
    low, high = ax.get_window_extent().intervaly
    heights = spread(at, width, gap, low + 0.5 * gap, high)
    for end, (x, y), height in zip(ends, at.tolist(), heights.tolist(), strict=True):
        moved = abs(height - y) > 0.6 * gap
        words = ax.annotate(
            end.words, (end.x, end.y), ((8.0 if moved else 3.0), (height - y) / points),
            textcoords="offset points", va="center", color=end.colour, fontsize=size,
            path_effects=[HALO], zorder=5, annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": end.colour, "lw": 0.5} if moved else None,
        )  # fmt: skip
        words.set_in_layout(False)


def spread(at: Array, width: float, gap: float, low: float, high: float) -> Array:
    """Heights (n,) of labels near places (n, 2), a gap apart where they are within a width."""
    order = np.argsort(at[:, 1], kind="stable")
    heights = np.clip(at[:, 1], low, high)
    for _ in range(60):
        moved = False
        for a, b in ((a, b) for k, a in enumerate(order) for b in order[k + 1 :]):
            lack = gap - (heights[b] - heights[a])
            if abs(at[a, 0] - at[b, 0]) < width and lack > 1e-6:
                heights[a] -= 0.5 * lack
                heights[b] += 0.5 * lack
                moved = True
        heights = np.clip(heights, low, high)
        if not moved:
            break
    return heights


def _room_for_names(ax: Axes, log: bool) -> None:
    """Widen the horizontal axis for names at the ends of curves."""
    low, high = ax.get_xlim()
    wider = high * (high / low) ** ROOM if log else high + ROOM * (high - low)
    ax.set_xlim(low, wider)


def sure(value: float, error: float = 0.0) -> str:
    """A number with the digits that its error leaves, at most five; a dash for none."""
    if not math.isfinite(value):
        return "–"
    digits = 5 if not error > 0.0 else math.floor(math.log10(max(abs(value), error) / error)) + 2
    magnitude = math.floor(math.log10(abs(value))) if value else 0
    decimals = max(min(digits, 5) - 1 - magnitude, 0)
    return f"{value:.{decimals}f}".replace("-", "−")


def signed(value: float, decimals: int = 1) -> str:
    """A number with its sign."""
    return f"{value:+.{decimals}f}".replace("-", "−") if math.isfinite(value) else "–"


def listed(words: Sequence[str]) -> str:
    """Words in a sentence: ``A, B and C``."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else list(words))
