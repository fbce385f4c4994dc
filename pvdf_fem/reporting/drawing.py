"""What figures of all kinds share: panels, names at the ends of curves, data as rings, labels."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS, GREY, HALO, LABEL_SIZE, figure_of, new_figure

#: Width of a figure in mm: as wide as a phone shows it with readable texts.
WIDTH_MM = 120.0
RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "white"}
DOT_SIZE = 2.4  #: Size in points of the dots at solved scenes.
ROOM = 0.13  #: Room for names at the right end of curves, over the axes' width.
LINE_HEIGHT = 1.15  #: Distance of the lines of labels over their size.
SAME = 5e-3  #: Curves closer than this share of the largest value have one name.
PANEL_TITLES = {"total": "charge (pC)", "change": "change by the touch (pC)"}
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
class Panel:
    """Axes of curves, and below them the axes of differences in percent, if any."""

    curves: Axes
    differences: Axes | None


def panels(titles: Sequence[Sequence[str]], label: str, differences: bool) -> list[list[Panel]]:
    """A figure of panels in rows, each with its title, that share their horizontal axis."""
    rows, columns = len(titles), len(titles[0])
    height = (62.0 if rows == 1 else 48.0) + 20.0 * differences
    figure = new_figure(WIDTH_MM if columns == 1 else 1.3 * WIDTH_MM, 12.0 + rows * height)
    ratios = [3.0, 1.0] if differences else [1.0]
    axes = figure.subplots(
        rows * len(ratios), columns, squeeze=False, sharex=True, sharey="row",
        gridspec_kw={"height_ratios": ratios * rows},
    )  # fmt: skip
    step, made = len(ratios), []
    for i, row in enumerate(titles):
        made.append([])
        for j, title in enumerate(row):
            strip = axes[i * step + 1, j] if differences else None
            made[-1].append(Panel(axes[i * step, j], strip))
            axes[i * step, j].set_title(title)
        axes[i * step, 0].set_ylabel(label)
        if differences:
            axes[i * step + 1, 0].set_ylabel("diff. (%)")
    return made


def mark_data(panel: Panel, x: Array, y: Array, computed: Array, colour: Any) -> None:
    """Draw others' charges as rings, and below them how much the computed charges differ."""
    panel.curves.plot(x, y, **RING, markeredgecolor=colour, zorder=4)
    if panel.differences is not None:
        percent = 100.0 * (computed / y - 1.0)
        panel.differences.plot(x, percent, **RING, markeredgecolor=colour, markersize=3.5)


def finish_strips(rows: Sequence[Sequence[Panel]]) -> None:
    """Centre the axes of differences at zero, all alike."""
    strips = [panel.differences for row in rows for panel in row if panel.differences]
    values = [np.asarray(line.get_ydata(), float) for ax in strips for line in ax.lines]
    finite = np.concatenate([np.zeros(1), *values])
    most = 1.25 * max(float(np.nanmax(np.abs(finite))), 0.1)
    for ax in strips:
        ax.axhline(0.0, color=GREY, linewidth=0.8)
        ax.set_ylim(-most, most)


@dataclass(frozen=True)
class End:
    """A name at the end of a curve."""

    x: float
    y: float
    words: str
    colour: Any


def label_ends(ax: Axes, ends: Sequence[End]) -> None:
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


def room_for_names(ax: Axes, share: float = ROOM) -> None:
    """Widen the horizontal axis for names at the ends of curves."""
    low, high = ax.get_xlim()
    if ax.get_xscale() == "log":
        ax.set_xlim(low, high * (high / low) ** share)
    else:
        ax.set_xlim(low, high + share * (high - low))


def merged(curves: dict[str, Array]) -> dict[str, Array]:
    """Curves by name, those that coincide under one name: ``A, C``."""
    size = max((float(np.nanmax(np.abs(c), initial=0.0)) for c in curves.values()), default=0.0)
    found: list[tuple[list[str], Array]] = []
    for name, curve in curves.items():
        for names, other in found:
            if np.allclose(curve, other, rtol=0.0, atol=SAME * size, equal_nan=True):
                names.append(name)
                break
        else:
            found.append(([name], curve))
    return {", ".join(names): curve for names, curve in found}


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


def finish(figure: Figure) -> Figure:
    """Lay a figure out, so that what is placed by pixels stays there."""
    figure.draw_without_rendering()
    return figure
