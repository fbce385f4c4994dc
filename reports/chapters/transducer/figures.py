"""Figures of the transducer: sizes of all effects, and a finger's heat over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import blended_transform_factory

from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE
from reports.common.charge_figures import Series, colours, label_curves
from reports.common.figures import LEVEL_DASHES, RING, drawing
from reports.common.page import with_minus

#: Sizes that differ by less than this factor share a label, that of the bar first.
NEAR = 15.0
_LABEL: dict[str, Any] = {
    "textcoords": "offset points",
    "va": "center",
    "size": LABEL_SIZE,
    "bbox": {"fc": "white", "ec": "none", "pad": 0.5},
}


@dataclass(frozen=True)
class Bar:
    """An effect's largest change of a charge in percent, and the shifts of places in mm."""

    name: str
    percent: float
    shift_mm: float
    #: With the probe on a part of an electrode; NaN where that is not shown.
    on_percent: float
    on_shift_mm: float


def sizes_picture(bars: Sequence[Bar], error_percent: float, error_mm: float, path: Path) -> None:
    """Horizontal bars on log axes, beside the thesis's errors."""
    with drawing(path, 180, 20 + 6.2 * len(bars)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        percents = [(bar.percent, bar.on_percent) for bar in bars]
        shifts = [(bar.shift_mm, bar.on_shift_mm) for bar in bars]
        _draw_sizes(left, percents, 1e-2, 1e4, error_percent, "%")
        _draw_sizes(right, shifts, 1e-4, 1e4, error_mm, "mm")
        left.set_xlabel("largest change of a charge (%)")
        right.set_xlabel("shift of the place found (mm)")
        left.set_yticks(range(len(bars)), [bar.name for bar in bars])
        left.invert_yaxis()
        right.tick_params(left=False)


def _draw_sizes(
    ax: Axes, sizes: Sequence[tuple[float, float]], low: float, high: float, error: float, unit: str
) -> None:
    """Bars beside the electrode, rings on a part of it, and the measuring error as a line."""
    ax.set_axisbelow(True)
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ax.axvline(error, color=GREY, lw=1.0, ls=LEVEL_DASHES)
    for y, (beside, on) in enumerate(sizes):
        ink = COLOURS[1 if beside > error else 4]
        ax.barh(y, max(beside, low) - low, left=low, height=0.6, color=ink)
        ends, texts = [max(beside, low)], [_in_words(beside, low, unit)]
        if np.isfinite(on):
            ax.plot(max(on, low), y, **RING, color=COLOURS[0], mew=1.4, clip_on=False)
            ends.append(max(on, low))
            texts.append(_in_words(on, low, unit))
        if ends[-1] < NEAR * ends[0]:
            ends, texts = [max(ends)], ["; ".join(texts)]
        for end, text in zip(ends, texts, strict=True):
            ax.annotate(text, (end, y), (6, 0), **_LABEL)
    above = blended_transform_factory(ax.transData, ax.transAxes)
    label = f"thesis's error, {error:.2g} {unit}"
    ax.text(error, 1.01, label, transform=above, ha="center", size=LABEL_SIZE, color=GREY)
    ax.grid(axis="y", visible=False)


def _in_words(size: float, low: float, unit: str) -> str:
    """A size with its unit, in µm where mm are too large."""
    less, size = ("< ", low) if size < low else ("", size)
    if unit == "mm" and size < 0.1:
        return f"{less}{1e3 * size:.2g} µm"
    return f"{less}{size:.2g} {unit}"


def heat_picture(
    times_s: Sequence[float], shares: Mapping[str, Sequence[float]], noise: float, path: Path
) -> None:
    """A's charge by a finger's heat, in percent of that by its force, over the time of contact."""
    with drawing(path, 140, 85) as figure:
        ax = figure.subplots()
        lines = [Series(name, np.array(times_s), np.array(Q)) for name, Q in shares.items()]
        inks = colours(len(lines))
        ax.axhspan(-100.0 * noise, 100.0 * noise, color="0.9", lw=0)
        for line, ink in zip(lines, inks, strict=True):
            ax.plot(line.x, line.y, color=ink, marker="o", ms=3.0)
        ax.set_xscale("log")
        ax.set_yscale("symlog", linthresh=100.0 * noise)
        ticks = (-100, -30, -10, -3, -1, 0, 1)
        ax.set_yticks(ticks, [with_minus(str(tick)) for tick in ticks])
        ax.set(ylim=(-200.0, 2.0), xlabel="time of contact (s)")
        ax.set_ylabel("charge by heat over that by force (%)")
        ax.xaxis.set_major_formatter("{x:g}")
        label_curves(ax, lines, inks)
