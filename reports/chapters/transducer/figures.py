"""Figures of the transducer: sizes of all effects, and a finger's heat over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import blended_transform_factory

from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE
from reports.chapters.transducer.effects import Place
from reports.common.charge_figures import Series, colours, label_curves
from reports.common.figures import LEVEL_DASHES, RING, drawing


@dataclass(frozen=True)
class Bar:
    """An effect's largest change of a charge in percent, and the shifts of places in mm."""

    name: str
    percent: float
    shift_mm: float
    #: With the probe on a part of an electrode; NaN where that is not shown.
    on_percent: float
    on_shift_mm: float


def sizes_picture(
    bars: Sequence[Bar], error_percent: float, error_mm: float, path: Path
) -> None:
    """Horizontal bars on log axes, beside the thesis's errors."""
    with drawing(path, 180, 20 + 6.2 * len(bars)) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        percents = [(bar.percent, bar.on_percent) for bar in bars]
        shifts = [(bar.shift_mm, bar.on_shift_mm) for bar in bars]
        _draw_sizes(left, percents, 1e-2, 1e3, error_percent, "%")
        _draw_sizes(right, shifts, 1e-4, 1e2, error_mm, "mm")
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
    for y, (beside, on) in enumerate(sizes):
        over = beside > error
        ax.barh(y, max(beside, low) - low, left=low, height=0.6, color=COLOURS[1 if over else 4])
        if np.isfinite(on):
            ax.plot(max(on, low), y, **RING, color=COLOURS[0], mew=1.4)
        text = f"{beside:.2g} {unit}" if beside > low else f"< {low:g} {unit}"
        at = (max(beside, on if np.isfinite(on) else 0.0, low), y)
        ax.annotate(text, at, (6, 0), textcoords="offset points", va="center", size=LABEL_SIZE)
    ax.axvline(error, color=GREY, lw=1.0, ls=LEVEL_DASHES)
    above = blended_transform_factory(ax.transData, ax.transAxes)
    ax.text(
        error, 1.01, f"thesis's error, {error:.2g} {unit}",
        transform=above, ha="center", size=LABEL_SIZE, color=GREY,
    )  # fmt: skip
    ax.grid(axis="y", visible=False)


def heat_picture(
    times_s: Sequence[float], shares: Mapping[str, Sequence[float]], noise: float, path: Path
) -> None:
    """Share that a finger's heat has of the force's charge of A, over the time of contact."""
    with drawing(path, 130, 80) as figure:
        ax = figure.subplots()
        lines = [
            Series(name, np.array(times_s), 100.0 * np.abs(values))
            for name, values in shares.items()
        ]
        inks = colours(len(lines))
        for line, ink in zip(lines, inks, strict=True):
            ax.plot(line.x, line.y, color=ink, marker="o", ms=3.0)
        ax.axhline(100.0 * noise, color=GREY, lw=1.0, ls=LEVEL_DASHES)
        ax.annotate(
            "noise", (times_s[0], 100.0 * noise), (0, 3), textcoords="offset points", color=GREY
        )
        ax.set(xscale="log", yscale="log")
        ax.set_xlabel("time of contact (s)")
        ax.set_ylabel("charge of A by heat over that of the force (%)")
        label_curves(ax, lines, inks)


def places_in_words(place: Place) -> str:
    """A place for text and tables."""
    return f"({place[0]:g}, {place[1]:g}) mm"
