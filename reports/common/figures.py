"""What the figures of several chapters share: their frame, and curves with the thesis's markers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from pvdf_fem.output import figures
from pvdf_fem.output.figures import COLOURS, new_figure, style
from pvdf_fem.scene.outlines.outline import Outline
from reports.common.charge_figures import (
    Dashed,
    charge_against_force,
    charge_against_rotation,
    differences,
)
from reports.common.comparison import Comparison, curves, sound_differences

#: Dashes of a line that marks a level or a limit.
LEVEL_DASHES = (0, (4, 3))
#: How the marker of a printed number looks.
RING: dict[str, Any] = {"marker": "o", "linestyle": "none", "markerfacecolor": "none"}

_OVER = {
    "force_N": (charge_against_force, "force (N)"),
    "rotation_deg": (charge_against_rotation, "rotation of the probe (°)"),
}

_is_preview: ContextVar[bool] = ContextVar("_is_preview", default=False)


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


def draw_compared(
    ax: Axes, groups: dict[str, list[Comparison]], x: str, dashed: Dashed | None = None
) -> None:
    """Our charges as curves and the thesis's as markers, in one colour for each group.

    `x` is ``force_N`` or ``rotation_deg``.
    """
    draw, _ = _OVER[x]
    draw(ax, curves(groups, x), curves(groups, x, "thesis_pC"), dashed=dashed)


def draw_differences(ax: Axes, groups: dict[str, list[Comparison]], x: str) -> None:
    """The differences of the charges that `draw_compared` draws, in the same colours."""
    _, label = _OVER[x]
    differences(ax, sound_differences(groups, x), label)


def draw_outline(ax: Axes, outline: Outline, **look: Any) -> None:
    """The outline of an electrode or of a probe, in mm."""
    ax.add_patch(Polygon(1e3 * np.array(outline.shape.exterior.coords), **look))


def frame(
    ax: Axes, title: str, reach_mm: float, centre_mm: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Limits, labels and title of a map with equal scales."""
    x, y = centre_mm
    ax.set(xlim=(x - reach_mm, x + reach_mm), ylim=(y - reach_mm, y + reach_mm))
    ax.set(xlabel="x (mm)", ylabel="y (mm)", title=title, aspect="equal")
