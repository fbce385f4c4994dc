"""What the figures of several reports share: previews, colours, and names beside curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pvdf_fem.arrays import Array
from pvdf_fem.output import figures
from pvdf_fem.output.figures import COLOURS, LABEL_SIZE, new_figure, style

_is_preview: ContextVar[bool] = ContextVar("_is_preview", default=False)


@dataclass(frozen=True)
class Series:
    """A named curve or a named set of points."""

    label: str
    #: x, y: Coordinates; y is NaN where there is no value, (n,).
    x: Array
    y: Array


@contextmanager
def preview(is_preview: bool) -> Iterator[None]:
    """A context in which every figure that is saved says so if it belongs to a preview."""
    token = _is_preview.set(is_preview)
    try:
        yield
    finally:
        _is_preview.reset(token)


def save(figure: Figure, path: Path) -> None:
    """Write a figure; that of a preview has the word across it, faintly but large."""
    if _is_preview.get():
        look: dict[str, Any] = {"rotation": 25, "ha": "center", "va": "center", "zorder": 100}
        size = 0.16 * min(figure.bbox.width, 1.5 * figure.bbox.height) * 72.0 / figure.dpi
        figure.text(0.5, 0.5, "preview", fontsize=size, color=COLOURS[1], alpha=0.13, **look)
    if figure.legends and (layout := figure.get_layout_engine()):
        layout.execute(figure)  # a single pass leaves too little room beside a figure's legend
    figures.save(figure, path)


@contextmanager
def drawing(path: Path, width_mm: float, height_mm: float) -> Iterator[Figure]:
    """An empty figure in the style of the package, which is saved when the block ends."""
    with style():
        figure = new_figure(width_mm, height_mm)
        yield figure
        save(figure, path)


def colours(count: int) -> list[Any]:
    """Colours for `count` curves: distinct ones for up to four, an ordered scale for more."""
    if count <= 4:
        return list(COLOURS[:count])
    return list(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, count)))


def label_curves(ax: Axes, series: Sequence[Series], inks: Sequence[Any]) -> None:
    """Write the labels right of the axes, apart from each other, each with a line to its curve.

    Call it when the limits of the axes are final.

    Parameters
    ----------
    ax : Axes
    series : sequence of Series
    inks : sequence
        Colours of the series, for matplotlib.
    """
    shown = [pair for pair in zip(series, inks, strict=True) if np.isfinite(pair[0].y).any()]
    if not shown:
        return
    figure = ax.get_figure(root=True)
    assert figure is not None
    if layout := figure.get_layout_engine():
        layout.execute(figure)  # settles the height of the axes
    ends = np.array([_last(curve) for curve, _ in shown])
    pixels = ax.transData.transform(ends)[:, 1]
    line_height = 1.25 * LABEL_SIZE * figure.dpi / 72.0
    places = np.column_stack([np.zeros(len(ends)), _spread(pixels, line_height)])
    heights = ax.transData.inverted().transform(places)[:, 1]
    for (curve, ink), end, height in zip(shown, ends.tolist(), heights.tolist(), strict=True):
        ax.annotate(
            curve.label,
            xy=end,
            xytext=(1.03, height),
            textcoords=ax.get_yaxis_transform(),
            color=ink,
            fontsize=LABEL_SIZE,
            verticalalignment="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": ink, "linewidth": 0.5, "shrinkA": 0},
        )


def _last(curve: Series) -> tuple[float, float]:
    last = np.flatnonzero(np.isfinite(curve.y))[-1]
    return float(curve.x[last]), float(curve.y[last])


def _spread(heights: Array, gap: float) -> Array:
    """Heights (n,) moved so that they are at least `gap` apart, in the same order.

    Neighbours that come too close form a block, whose centre is the mean of its heights.
    """
    order = np.argsort(heights, kind="stable")
    blocks: list[tuple[float, int]] = []  # centre, size
    for height in heights[order]:
        centre, size = float(height), 1
        while blocks and centre - blocks[-1][0] < 0.5 * gap * (size + blocks[-1][1]):
            below, count = blocks.pop()
            centre = (centre * size + below * count) / (size + count)
            size += count
        blocks.append((centre, size))
    spread = np.empty(len(heights))
    spread[order] = [c + gap * (i - 0.5 * (n - 1)) for c, n in blocks for i in range(n)]
    return spread
