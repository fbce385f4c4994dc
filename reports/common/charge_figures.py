"""Curves of charges beside the thesis's, with labels, on a given `ax`.

A point whose solve failed has NaN for its value; it leaves a gap in its curve and a cross on the
lower axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from scipy.interpolate import CubicSpline, PchipInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE

#: Makes a smooth function from the coordinates of points.
Interpolation = Callable[[Array, Array], Callable[[Array], Array]]

#: Dashes of a printed equation.
EQUATION_DASHES = (0, (5, 2))
# The look of the thesis's points.
_THESIS: dict[str, Any] = {
    "marker": "o",
    "linestyle": "none",
    "markerfacecolor": "none",
    "markeredgewidth": 1.1,
}


@dataclass(frozen=True)
class Series:
    """A named curve or a named set of points."""

    label: str
    #: x, y: Coordinates; y is NaN where there is no value, (n,).
    x: Array
    y: Array


@dataclass(frozen=True)
class Dashed:
    """Dashed curves beside ours, with their name in the legend."""

    name: str
    #: Curves in the order of ours, in whose colours they are drawn.
    curves: Sequence[Series]


def charge_against_rotation(
    ax: Axes,
    ours: Sequence[Series],
    thesis: Sequence[Series] = (),
    *,
    others: str = "thesis",
    dashed: Dashed | None = None,
    between: Sequence[Series] = (),
) -> None:
    """Charges (pC) against the probe's rotation (degrees); `others` names the markers.

    `between`, if given, has a curve for each of `ours`, to be drawn in place of a smooth one.
    """
    # a spline would overshoot at the maxima, which lie at computed points
    _charges(
        ax,
        ours,
        thesis,
        interpolation=PchipInterpolator,
        others=others,
        dashed=dashed,
        between=between,
    )
    ax.set_xlabel("rotation of the probe (°)")
    _degrees(ax)
    label_curves(ax, ours, colours(len(ours)))


def charge_against_force(
    ax: Axes,
    ours: Sequence[Series],
    thesis: Sequence[Series] = (),
    *,
    others: str = "thesis",
    dashed: Dashed | None = None,
) -> None:
    """Charges (pC) against the force (N); `others` names the markers."""
    _charges(ax, ours, thesis, others=others, dashed=dashed)
    ax.set_xlabel("force (N)")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    label_curves(ax, ours, colours(len(ours)))


def charge_against_distance(
    ax: Axes,
    ours: Sequence[Series],
    thesis: Sequence[Series] = (),
    reference: str = "electrode",
    *,
    labelled: bool = True,
    between: Sequence[Series] = (),
) -> None:
    """Charges (pC) against the probe's distance (mm) from the centre of `reference`.

    Curves that nearly coincide are better left without labels (``labelled=False``). `between`, if
    given, has a curve for each of `ours`, to be drawn through its points instead of a spline.
    """
    _charges(ax, ours, thesis, between=between)
    ax.set_xlabel(f"distance from the centre of {reference} (mm)")
    ax.set_xlim(left=0.0)
    if labelled:
        label_curves(ax, ours, colours(len(ours)))


def differences(ax: Axes, series: Sequence[Series], x_label: str) -> None:
    """Differences in percent over any abscissa, with lines at zero and ±2 %."""
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    for level in (-2.0, 2.0):
        ax.axhline(level, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    for curve, colour in zip(series, colours(len(series)), strict=True):
        ax.plot(curve.x, curve.y, "o-", color=colour, linewidth=0.7, markersize=3)
    ax.set_ylim(*_limits(series, 2.3))
    ax.set_xlabel(x_label)
    ax.set_ylabel("ours − thesis (%)")
    if x_label.endswith("(°)"):
        _degrees(ax)
    else:
        ax.set_xlim(left=0.0)
    label_curves(ax, series, colours(len(series)))


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


def _charges(
    ax: Axes,
    ours: Sequence[Series],
    thesis: Sequence[Series],
    *,
    interpolation: Interpolation = CubicSpline,
    between: Sequence[Series] = (),
    others: str = "thesis",
    dashed: Dashed | None = None,
) -> None:
    """Our points joined by smooth curves, the thesis's as markers in the same colour."""
    inks = colours(len(ours))
    by_label = dict(zip((points.label for points in ours), inks, strict=True))
    curves = between or [_smooth(points, interpolation) for points in ours]
    for points, curve, ink in zip(ours, curves, inks, strict=True):
        ax.plot(curve.x, curve.y, color=ink)
        ax.plot(points.x, points.y, ".", color=ink, markersize=3)
        _mark_failures(ax, points, ink)
    for points in thesis:
        ax.plot(points.x, points.y, **_THESIS, markeredgecolor=by_label[points.label])
    if dashed:
        for curve, ink in zip(dashed.curves, inks, strict=True):
            smooth = _smooth(curve, interpolation)
            ax.plot(smooth.x, smooth.y, color=ink, linestyle=EQUATION_DASHES, linewidth=1.0)
    ax.set_ylabel("charge (pC)")
    if thesis or dashed:
        _legend_above(ax, others if thesis else "", dashed.name if dashed else "")


def _legend_above(ax: Axes, others: str, dashed: str) -> None:
    """A legend of all kinds of points and curves above the axes, where no point can be."""
    keys = [Line2D([], [], color=GREY, marker=".", markersize=3, label="this work")]
    if others:
        keys.append(Line2D([], [], **_THESIS, markeredgecolor=GREY, label=others))
    if dashed:
        keys.append(Line2D([], [], color=GREY, lw=1.0, linestyle=EQUATION_DASHES, label=dashed))
    ax.legend(
        handles=keys,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.0,
        ncols=len(keys),
        columnspacing=1.2,
        handletextpad=0.5,
    )


def _smooth(points: Series, interpolation: Interpolation) -> Series:
    """A smooth curve through points; the points themselves if less than four or without a value."""
    if len(points.x) < 4 or not np.isfinite(points.y).all():
        return points
    x = np.linspace(points.x[0], points.x[-1], 200)
    return Series(points.label, x, interpolation(points.x, points.y)(x))


def _mark_failures(ax: Axes, points: Series, ink: Any) -> None:
    for x in points.x[~np.isfinite(points.y)]:
        ax.plot([x], [0.0], "x", color=ink, transform=ax.get_xaxis_transform(), clip_on=False)
        ax.annotate(
            "failed",
            (x, 0.0),
            (3.0, 3.0),
            xycoords=ax.get_xaxis_transform(),
            textcoords="offset points",
            color=ink,
            fontsize=LABEL_SIZE - 1.0,
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


def _limits(series: Sequence[Series], least: float) -> tuple[float, float]:
    """Limits of an axis that hold all values, and reach at least to ±`least`."""
    values = np.concatenate([curve.y for curve in series]) if series else np.zeros(0)
    values = values[np.isfinite(values)]
    return min(values.min(initial=0.0) - 0.2, -least), max(values.max(initial=0.0) + 0.2, least)


def _degrees(ax: Axes) -> None:
    left, right = ax.dataLim.intervalx
    ticks = np.arange(0.0, 361.0, 30.0)
    ax.set_xticks(ticks[(ticks >= left - 1.0) & (ticks <= right + 1.0)])
