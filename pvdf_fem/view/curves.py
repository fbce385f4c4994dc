"""Curves of charges in panels: data as rings with strips of differences, names at curve ends."""

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

#: Look of charges of data.
RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "white"}
DOT_SIZE = 2.4  #: Size in points of the dots at solved scenes.
SAMPLES = 121  #: Number of points of a smooth curve.
#: Room for one letter of the names at curve ends, over the width of all panels.
LETTER_WIDTH = 0.018
#: Largest distance between the ends of curves that have names beside them, over a panel's width.
MAX_END_DISTANCE = 0.2
LEGEND_COLUMNS = 7
LINE_HEIGHT = 1.15  #: Distance of neighbouring labels over their size.
MAX_PASSES = 60  #: Largest number of passes over the labels to move them apart.


class Panel(NamedTuple):
    """The curves of one panel.

    The rows of `frame` have the columns ``curve`` (a name), ``x``, ``computed_pC`` and
    ``charge_pC``. Rows without a ``charge_pC`` are points of the curves. The others are data:
    rings, with their differences from ``computed_pC`` in a strip below the panel.
    """

    title: str
    frame: pd.DataFrame

    @property
    def has_data(self) -> bool:
        """Whether there are charges of data."""
        return bool(self.frame.charge_pC.notna().any())


class PanelAxes(NamedTuple):
    """The axes of a panel, and of the strip of differences below it where there are data."""

    main: Axes
    strip: Axes | None


class LabelledPoint(NamedTuple):
    """A name with its colour at a point, such as the last point of a curve."""

    x: float
    y: float
    name: str
    colour: Any


def choose_curve_colours(count: int) -> list[Any]:
    """Return colours of curves: the common colours for a few, ordered shades for many."""
    if count <= len(COLOURS):
        return list(COLOURS[:count])
    shades = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, count))
    return [tuple(shade) for shade in shades]


def make_curve_axes(rows: Sequence[Sequence[Panel]]) -> list[list[PanelAxes]]:
    """Return empty axes of a new figure for panels in rows.

    Parameters
    ----------
    rows : sequence of sequence of Panel
        The panels row by row, equally many in each row.

    Returns
    -------
    list of list of PanelAxes
        The axes row by row.
    """
    columns = len(rows[0])
    row_has_data = [any(panel.has_data for panel in row) for row in rows]
    heights = []
    for has_data in row_has_data:
        heights += [3.0, 1.0] if has_data else [3.0]
    panel_height = 64.0 if len(rows) == 1 else 40.0
    width = WIDTH_MM if columns < 3 else 1.25 * WIDTH_MM
    figure = make_figure(width, 12.0 + len(rows) * panel_height + sum(row_has_data) * 22.0)
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
    for row, has_data in zip(rows, row_has_data, strict=True):
        mains = next(grid_rows)
        strips = next(grid_rows) if has_data else [None] * columns
        axes.append([])
        for panel, main, strip in zip(row, mains, strips, strict=True):
            if strip is not None and not panel.has_data:
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
    """Draw panels with smooth curves through computed charges, and rings for data.

    Parameters
    ----------
    rows : sequence of sequence of Panel
        The panels row by row.
    axes : sequence of sequence of PanelAxes
        Their axes, as `make_curve_axes` returns them.
    x_label, y_label : str
        Labels of the axes, with units.
    is_logarithmic : bool
        Whether both axes have logarithmic scales.
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
    room = LETTER_WIDTH * len(rows[0]) * max(map(len, names))
    _label_curves(colours, ends, room=room, is_logarithmic=is_logarithmic)


def _label_curves(
    colours: Mapping[str, Any],
    ends: Sequence[tuple[Axes, Sequence[LabelledPoint]]],
    room: float,
    is_logarithmic: bool,
) -> None:
    """Write the names of curves at their ends, or above all panels where some end early.

    Parameters
    ----------
    colours : mapping of str to colours
        Colours of the curves by name.
    ends : sequence of (Axes, sequence of CurveEnd)
        The panels with the ends of their curves.
    room : float
        Width of the longest name over the width of a panel.
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
        first.set_xlim(low, high * (high / low) ** room)
    else:
        first.set_xlim(low, high + room * (high - low))
    for ax, panel_ends in ends:
        label_points(ax, panel_ends)


def _draw_panel(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> list[LabelledPoint]:
    """Draw the curves with dots, and the data as rings; return the ends of the curves."""
    ends = []
    computed = frame[frame.charge_pC.isna()]
    for name, rows in computed.groupby("curve", sort=False):
        x = rows.x.to_numpy(float)
        charges = rows.computed_pC.to_numpy(float)
        colour = colours[str(name)]
        ax.plot(*_interpolate(x, charges), color=colour)
        ax.plot(x, charges, "o", color=colour, markersize=DOT_SIZE)
        if charges.size and np.isfinite(charges[-1]):
            ends.append(LabelledPoint(x[-1], charges[-1], name=str(name), colour=colour))
    data = frame[frame.charge_pC.notna()]
    for name, rows in data.groupby("curve"):
        ax.plot(rows.x, rows.charge_pC, **RING, markeredgecolor=colours[str(name)], zorder=4)
    return ends


def _draw_differences(ax: Axes, frame: pd.DataFrame, colours: Mapping[str, Any]) -> None:
    """Draw the differences of computed charges from the data in percent."""
    data = frame[frame.charge_pC.notna()]
    for name, rows in data.groupby("curve"):
        percent = 100.0 * (rows.computed_pC / rows.charge_pC - 1.0)
        ax.plot(rows.x, percent, **RING, markeredgecolor=colours[str(name)], markersize=3.5)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.margins(y=0.2)


def _set_log_scales(ax: Axes) -> None:
    """Give both axes logarithmic scales with plain numbers at their ticks."""
    ax.set(xscale="log", yscale="log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def _interpolate(x: Array, y: Array) -> tuple[Array, Array]:
    """Return a curve through points (n,) with finite y that does not oscillate between them."""
    is_finite = np.isfinite(y)
    x = x[is_finite]
    y = y[is_finite]
    if len(x) < 2:
        return x, y
    dense = np.linspace(x[0], x[-1], SAMPLES)
    return dense, Akima1DInterpolator(x, y, method="makima")(dense)


def label_points(ax: Axes, points: Sequence[LabelledPoint]) -> None:
    """Write names right of points, moved vertically where they would overlap."""
    if not points:
        return
    figure = get_figure(ax)
    size = LABEL_SIZE - 0.5
    figure.draw_without_rendering()  # lays the figure out
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


def space_labels(places: Array, width: float, gap: float) -> Array:
    """Return heights of labels that do not overlap.

    Parameters
    ----------
    places : ndarray, shape (n, 2)
        Where the labels begin, in pixels.
    width : float
        Width of the longest label in pixels.
    gap : float
        Smallest distance in height of labels that are within a width, in pixels.

    Returns
    -------
    ndarray, shape (n,)
        Heights close to those of the places.
    """
    heights = places[:, 1].copy()
    order = np.argsort(heights, kind="stable").tolist()
    neighbours = []
    for lower, upper in combinations(order, 2):
        if abs(places[lower, 0] - places[upper, 0]) < width:
            neighbours.append((lower, upper))
    for _ in range(MAX_PASSES):
        for lower, upper in neighbours:
            overlap = max(gap - (heights[upper] - heights[lower]), 0.0)
            heights[lower] -= 0.5 * overlap
            heights[upper] += 0.5 * overlap
    return heights
