"""Curves of charges in panels, with readings as rings and labels at the ends of curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from scipy.interpolate import Akima1DInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.view.figures import (
    COLOURS,
    GREY,
    HALO,
    LABEL_SIZE,
    WIDTH_MM,
    get_figure,
    make_figure,
)

#: Style of the markers of readings.
RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "white"}
DOT_SIZE = 2.4  #: Size in points of the dots at solved scenes.
SAMPLES = 121  #: Number of points of a smooth curve.
#: Width of a character of the labels at curve ends, as a fraction of the width of all panels.
LETTER_WIDTH = 0.018
#: Maximum distance between the ends of labelled curves, as a fraction of a panel's width.
MAX_END_DISTANCE = 0.2
LEGEND_COLUMNS = 7
LINE_HEIGHT = 1.15  #: Distance between neighbouring labels divided by their font size.
MAX_PASSES = 60  #: Maximum number of iterations that move labels apart.


class Panel(NamedTuple):
    """The curves of one panel.

    The rows of `frame` have the columns ``curve`` (a name), ``x``, ``computed_pC`` and
    ``charge_pC``. A row whose ``charge_pC`` is NaN is a point of a curve. Any other row is a
    reading ``charge_pC``, drawn as a ring, and the charge ``computed_pC`` for comparison: their
    difference is drawn in a strip below the panel.
    """

    title: str
    frame: pd.DataFrame

    @property
    def has_readings(self) -> bool:
        """Whether any row is a reading."""
        return bool(self.frame.charge_pC.notna().any())


class PanelAxes(NamedTuple):
    """The axes of a panel, and of the strip of differences below it if it has readings."""

    main: Axes
    strip: Axes | None


class LabelledPoint(NamedTuple):
    """A point with a name and a colour, such as the last point of a curve."""

    x: float
    y: float
    name: str
    colour: Any


def choose_curve_colours(count: int) -> list[Any]:
    """Return a colour for each of `count` curves.

    These are the first of `COLOURS`, or a graded colour map if there are more curves than those.
    """
    if count <= len(COLOURS):
        return list(COLOURS[:count])
    shades = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, count))
    return [tuple(shade) for shade in shades]


def make_curve_axes(rows: Sequence[Sequence[Panel]]) -> list[list[PanelAxes]]:
    """Make a new figure with empty axes for panels, and for the strips below those with readings.

    Parameters
    ----------
    rows : sequence of sequence of Panel
        The rows of panels, each with the same number of panels.

    Returns
    -------
    list of list of PanelAxes
        The axes of each panel, in the order of `rows`.
    """
    columns = len(rows[0])
    row_has_strips = [any(panel.has_readings for panel in row) for row in rows]
    heights = []
    for has_strips in row_has_strips:
        heights += [3.0, 1.0] if has_strips else [3.0]
    panel_height = 64.0 if len(rows) == 1 else 40.0
    width = WIDTH_MM if columns < 3 else 1.25 * WIDTH_MM
    figure = make_figure(width, 12.0 + len(rows) * panel_height + sum(row_has_strips) * 22.0)
    grid = figure.subplots(
        len(heights),
        columns,
        squeeze=False,
        sharex=True,
        sharey="row",
        gridspec_kw={"height_ratios": heights},
    )
    grid_rows = iter(grid)
    axes: list[list[PanelAxes]] = []
    for row, has_strips in zip(rows, row_has_strips, strict=True):
        mains = next(grid_rows)
        strips = next(grid_rows) if has_strips else [None] * columns
        axes.append([])
        for panel, main, strip in zip(row, mains, strips, strict=True):
            if strip is not None and not panel.has_readings:
                strip.remove()
                main.tick_params(labelbottom=True)
                strip = None
            axes[-1].append(PanelAxes(main, strip))
    return axes


def draw_curves(
    rows: Sequence[Sequence[Panel]],
    axes: Sequence[Sequence[PanelAxes]],
    x_label: str,
    y_label: str,
    is_logarithmic: bool = False,
) -> None:
    """Draw panels with smooth curves through computed charges, and readings as rings.

    Parameters
    ----------
    rows : sequence of sequence of Panel
        The rows of panels. Curves of one name have the same colour in all of them.
    axes : sequence of sequence of PanelAxes
        The axes of the panels, from `make_curve_axes`.
    x_label, y_label : str
        Labels of the axes, with units.
    is_logarithmic : bool
        Whether the axes of charges and of x are logarithmic.
    """
    names: dict[str, None] = {}
    for row in rows:
        for panel in row:
            names |= dict.fromkeys(panel.frame.curve)
    colours = dict(zip(names, choose_curve_colours(len(names)), strict=True))
    ends = []
    for row, row_axes in zip(rows, axes, strict=True):
        row_axes[0].main.set_ylabel(y_label)
        strips = [panel_axes.strip for panel_axes in row_axes if panel_axes.strip is not None]
        if strips:
            strips[0].set_ylabel("diff. (%)")
        for panel, (main, strip) in zip(row, row_axes, strict=True):
            if is_logarithmic:
                _set_log_scales(main)
            ends.append((main, _draw_panel(main, panel.frame, colours)))
            main.set_title(panel.title)
            if strip is not None:
                _draw_differences(strip, panel.frame, colours)
            if x_label.endswith("(°)"):
                main.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 1.5, 3, 4.5, 9, 10]))
    get_figure(axes[0][0].main).supxlabel(x_label)
    label_width = LETTER_WIDTH * len(rows[0]) * max(map(len, names))
    _label_curves(colours, ends, label_width=label_width, is_logarithmic=is_logarithmic)


def _label_curves(
    colours: Mapping[str, Any],
    ends: Sequence[tuple[Axes, Sequence[LabelledPoint]]],
    label_width: float,
    is_logarithmic: bool,
) -> None:
    """Label curves at their ends, or in a legend above all panels if some curves end early.

    Curves end early if the x of the ends differ by more than `MAX_END_DISTANCE`. Otherwise, the
    common x axis is lengthened to make room for the labels.

    Parameters
    ----------
    colours : mapping of str to colour
        Colours of the curves by name.
    ends : sequence of tuple of Axes and sequence of LabelledPoint
        The axes of each panel with the last points of its curves.
    label_width : float
        Width of the longest name as a fraction of the width of a panel.
    is_logarithmic : bool
        Whether the axes have logarithmic scales.
    """
    first = ends[0][0]
    low, high = first.get_xlim()
    last_x = [end.x for _, panel_ends in ends for end in panel_ends]
    if last_x and max(last_x) - min(last_x) > MAX_END_DISTANCE * (high - low):
        lines = [Line2D([], [], color=colour) for colour in colours.values()]
        position: dict[str, Any] = {"loc": "outside upper left", "ncols": LEGEND_COLUMNS}
        get_figure(first).legend(lines, list(colours), **position)
        return
    if is_logarithmic:
        first.set_xlim(low, high * (high / low) ** label_width)
    else:
        first.set_xlim(low, high + label_width * (high - low))
    for ax, panel_ends in ends:
        label_points(ax, panel_ends)


def _draw_panel(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> list[LabelledPoint]:
    """Draw the curves with dots, and the readings as rings.

    Parameters
    ----------
    ax : Axes
        Axes of the panel.
    frame : DataFrame
        The points of the curves and the readings, see `Panel`.
    colours : mapping of str to colour
        Colours of the curves by name.

    Returns
    -------
    list of LabelledPoint
        The last point of each curve, without curves whose last charge is infinite or NaN.
    """
    ends = []
    computed = frame[frame.charge_pC.isna()]
    for name, rows in computed.groupby("curve", sort=False):
        x = rows.x.to_numpy(float)
        charges = rows.computed_pC.to_numpy(float)
        colour = colours[str(name)]
        ax.plot(*_interpolate_curve_points(x, charges), color=colour)
        ax.plot(x, charges, "o", color=colour, markersize=DOT_SIZE)
        if charges.size and np.isfinite(charges[-1]):
            ends.append(LabelledPoint(x[-1], charges[-1], name=str(name), colour=colour))
    data = frame[frame.charge_pC.notna()]
    for name, rows in data.groupby("curve"):
        ax.plot(rows.x, rows.charge_pC, **RING, markeredgecolor=colours[str(name)], zorder=4)
    return ends


def _draw_differences(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> None:
    """Draw the differences between computed charges and readings, in percent of the readings.

    Parameters
    ----------
    ax : Axes
        The axes.
    frame : DataFrame
        Rows of the curves.
    colours : mapping of str to colour
        Colours of the curves.
    """
    data = frame[frame.charge_pC.notna()]
    for name, rows in data.groupby("curve"):
        percent = 100.0 * (rows.computed_pC / rows.charge_pC - 1.0)
        ax.plot(rows.x, percent, **RING, markeredgecolor=colours[str(name)], markersize=3.5)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.margins(y=0.2)


def _set_log_scales(ax: Axes) -> None:
    """Make both axes logarithmic, with ticks at 1, 2 and 5 times powers of ten."""
    ax.set(xscale="log", yscale="log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def _interpolate_curve_points(x: Array, y: Array) -> tuple[Array, Array]:
    """Interpolate points by a modified Akima spline, which does not oscillate between them.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Increasing coordinates of the points.
    y : ndarray, shape (n,)
        Values at the points. Points whose value is infinite or NaN are left out.

    Returns
    -------
    x, y : ndarray, shape (m,)
        `SAMPLES` points of the spline, or the remaining points if there are fewer than two.
    """
    is_finite = np.isfinite(y)
    x = x[is_finite]
    y = y[is_finite]
    if len(x) < 2:
        return x, y
    dense = np.linspace(x[0], x[-1], SAMPLES)
    return dense, Akima1DInterpolator(x, y, method="makima")(dense)


def label_points(ax: Axes, points: Sequence[LabelledPoint]) -> None:
    """Write the name of each point to its right, moved vertically if names would overlap.

    A name that is moved far is connected to its point by a line. The layout of the figure is
    computed first, so that axes and limits must not change afterwards.
    """
    if not points:
        return
    figure = get_figure(ax)
    size = LABEL_SIZE - 0.5
    figure.draw_without_rendering()  # computes the layout, which defines the pixels
    pixels_per_point = figure.dpi / 72.0
    pixels = ax.transData.transform([(point.x, point.y) for point in points])
    letters = max(len(point.name) for point in points)
    width = letters * 0.65 * size * pixels_per_point
    heights = space_labels(pixels, width, LINE_HEIGHT * size * pixels_per_point)
    shifts = (heights - pixels[:, 1]) / pixels_per_point
    for point, shift in zip(points, shifts, strict=True):
        look: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": size}
        gap = 3.0
        if abs(shift) > 0.6 * size:
            look["arrowprops"] = {"arrowstyle": "-", "color": point.colour, "lw": 0.5}
            gap = 8.0
        label = ax.annotate(
            point.name, (point.x, point.y), (gap, shift), color=point.colour, **look
        )
        label.set(in_layout=False, path_effects=[HALO], zorder=5)


def space_labels(positions: Array, width: float, gap: float) -> Array:
    """Compute vertical positions of labels that do not overlap.

    Parameters
    ----------
    positions : ndarray, shape (n, 2)
        Preferred positions of the left ends of the labels in pixels.
    width : float
        Width of the longest label in pixels.
    gap : float
        Minimum vertical distance in pixels between labels that overlap horizontally.

    Returns
    -------
    ndarray, shape (n,)
        Vertical positions in pixels, close to the preferred ones. With very many labels, some
        overlaps may remain after `MAX_PASSES` iterations.
    """
    heights = positions[:, 1].copy()
    order = np.argsort(heights, kind="stable").tolist()
    neighbours = []
    for lower, upper in combinations(order, 2):
        if abs(positions[lower, 0] - positions[upper, 0]) < width:
            neighbours.append((lower, upper))
    for _ in range(MAX_PASSES):
        for lower, upper in neighbours:
            overlap = max(gap - (heights[upper] - heights[lower]), 0.0)
            heights[lower] -= 0.5 * overlap
            heights[upper] += 0.5 * overlap
    return heights
