"""Figures: functions that draw on a given `ax`, one style, and reproducible files.

Nothing here touches matplotlib's global state: make a `matplotlib.figure.Figure` within `style()`,
draw on its axes, and write it with `save`. A point whose solve failed has NaN for its value; it
leaves a gap in its curve and a cross on the lower axis.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import shapely
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon as Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation as TriangleGrid
from scipy.interpolate import CubicSpline, PchipInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.files import replacing
from pvdf_fem.mesh.gmsh_mesh import PROBE, electrode_patch, outlines
from pvdf_fem.scene.scene import Electrode
from pvdf_fem.solution.solution import Solution

#: Makes a smooth function from the coordinates of points.
Interpolation = Callable[[Array, Array], Callable[[Array], Array]]

#: Okabe and Ito's colours, told apart with every kind of colour vision; yellow is left out, since
#: it is too light for lines.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
GREY = "0.45"
#: Size of labels in points.
LABEL_SIZE = 8.0

# The look of all figures; matplotlib's stubs ask for literal keys.
_STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.prop_cycle": cycler(color=COLOURS),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9,
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}
# Settings without which SVG files have random identifiers.
_REPRODUCIBLE: dict[Any, Any] = {"svg.hashsalt": "pvdf_fem", "svg.fonttype": "path"}
# Metadata that would tell a date or a version, by format.
_NO_DATE: dict[str, dict[str, None]] = {
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
    ".png": {"Software": None},
}


@dataclass(frozen=True)
class Series:
    """A named curve or a named set of points."""

    label: str
    #: x, y: Coordinates; y is NaN where there is no value, (n,).
    x: Array
    y: Array


@contextmanager
def style() -> Iterator[None]:
    """A context in which new figures have the look that all figures share."""
    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(width_mm: float = 160.0, height_mm: float = 100.0) -> Figure:
    """An empty figure that belongs to no window."""
    return Figure(figsize=(width_mm / 25.4, height_mm / 25.4))  # in inches


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure in the format of the path's extension; the same figure gives the same bytes.

    Raises
    ------
    ValueError
        For an extension that matplotlib does not write; the text lists those it does.
    FileError
        When the file cannot be written.
    """
    path = Path(path)
    with matplotlib.rc_context({**_STYLE, **_REPRODUCIBLE}):
        if layout := figure.get_layout_engine():
            layout.execute(figure)
            figure.set_layout_engine("none")  # or matplotlib lays out twice more
        suffix, content = path.suffix.lower(), io.BytesIO()  # a full disk confuses some writers
        figure.savefig(content, format=suffix[1:], dpi=200, metadata=_NO_DATE.get(suffix))
    with replacing(path) as temporary:
        temporary.write_bytes(content.getvalue())


def charge_against_rotation(
    ax: Axes, ours: Sequence[Series], thesis: Sequence[Series] = (), *, others: str = "thesis"
) -> None:
    """Charges (pC) against the probe's rotation (degrees); `others` names the markers."""
    # a spline would overshoot at the maxima, which lie at computed points
    _charges(ax, ours, thesis, interpolation=PchipInterpolator, others=others)
    ax.set_xlabel("rotation of the probe (°)")
    _degrees(ax)
    label_curves(ax, ours, colours(len(ours)))


def charge_against_force(
    ax: Axes, ours: Sequence[Series], thesis: Sequence[Series] = (), *, others: str = "thesis"
) -> None:
    """Charges (pC) against the force (N); `others` names the markers."""
    _charges(ax, ours, thesis, others=others)
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
    figure = _figure(ax)
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


def deflection_map(ax: Axes, solution: Solution, *, reach_mm: float | None = None) -> None:
    """Filled contours of the deflection with electrodes, probe and charges.

    Parameters
    ----------
    ax : Axes
        Its figure gets a colour bar.
    solution : Solution
        Converged; otherwise its `NotConvergedError` is raised.
    reach_mm : float, optional
        Half the width of the shown part of the film; the whole film is shown when not given.
    """
    grid, w = solution.basis.refinterp(solution.displacement[:, 2], nrefs=2)
    levels = _levels(np.append(1e3 * w, solution.deflection_max_mm))
    x, y = 1e3 * grid.p
    filled = ax.tricontourf(TriangleGrid(x, y, grid.t.T), 1e3 * w, levels=levels, cmap="Blues")
    _figure(ax).colorbar(filled, ax=ax, label="deflection (mm)", fraction=0.046, pad=0.03)
    radius = solution.scene.film.radius_mm
    reach = radius if reach_mm is None else reach_mm
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(radius * np.cos(angle), radius * np.sin(angle), color="black", linewidth=1.0)
    patches = outlines(solution.scene)
    for electrode in solution.scene.electrode_list:
        outline = patches[electrode_patch(electrode.name)]
        _draw_outline(ax, outline.shape, facecolor="white", alpha=0.55)
        _draw_outline(ax, outline.shape, edgecolor="black", linewidth=0.9)
        _name_electrode(ax, electrode, solution.charges_pC[electrode.name])
    if PROBE in patches:
        _draw_outline(ax, patches[PROBE].shape, edgecolor=COLOURS[1], linewidth=1.4)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    ax.set(xlim=(-1.02 * reach, 1.02 * reach), ylim=(-1.02 * reach, 1.02 * reach))
    ax.grid(False)


def _charges(
    ax: Axes,
    ours: Sequence[Series],
    thesis: Sequence[Series],
    *,
    interpolation: Interpolation = CubicSpline,
    between: Sequence[Series] = (),
    others: str = "thesis",
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
    ax.set_ylabel("charge (pC)")
    if thesis:
        _legend_above(ax, others)


def _legend_above(ax: Axes, others: str) -> None:
    """A legend of our points and the others' above the axes, where no point can be."""
    ours_key = Line2D([], [], color=GREY, marker=".", markersize=3, label="this work")
    others_key = Line2D([], [], **_THESIS, markeredgecolor=GREY, label=others)
    ax.legend(
        handles=[ours_key, others_key],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.0,
        ncols=2,
    )


# The look of the thesis's points.
_THESIS: dict[str, Any] = {
    "marker": "o",
    "linestyle": "none",
    "markerfacecolor": "none",
    "markeredgewidth": 1.1,
}


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


def _levels(w: Array) -> Array:
    """About ten round levels that enclose all deflections; a flat film gets a small range."""
    low, high = min(float(w.min()), 0.0), float(w.max())
    ticks = MaxNLocator(10, min_n_ticks=2).tick_values(low, high if high > low else low + 1e-9)
    return np.asarray(ticks)


def _draw_outline(ax: Axes, shape: shapely.Polygon, **look: Any) -> None:
    """Draw a shape in metres on axes in mm, without face and edge unless `look` has them."""
    corners = 1e3 * np.array(shape.exterior.coords)
    ax.add_patch(Patch(corners, **{"facecolor": "none", "edgecolor": "none", **look}))


def _name_electrode(ax: Axes, electrode: Electrode, charge_pC: float) -> None:
    """Name and charge beside an electrode, on the side away from the film's centre."""
    outline = electrode.outline
    centre = 1e3 * outline.centroid
    low_x, low_y, high_x, high_y = 1e3 * np.array(outline.shape.bounds)
    direction = centre / (np.linalg.norm(centre) or 1.0)
    sideways = abs(direction[0]) > 0.5
    sign = 1.0 if direction[0 if sideways else 1] >= 0.0 else -1.0
    if sideways:
        place = (high_x if sign > 0 else low_x, centre[1])
        align: dict[str, Any] = {"ha": "left" if sign > 0 else "right", "va": "center"}
        offset = (4.0 * sign, 0.0)
    else:
        place = (centre[0], high_y if sign > 0 else low_y)
        align = {"ha": "center", "va": "bottom" if sign > 0 else "top"}
        offset = (0.0, 4.0 * sign)
    ax.annotate(
        ("\n" if sideways else "  ").join([electrode.name, f"{charge_pC:.1f} pC"]),
        place,
        offset,
        textcoords="offset points",
        fontsize=LABEL_SIZE,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
        clip_on=True,
        **align,
    )


def _figure(ax: Axes) -> Figure:
    figure = ax.get_figure(root=True)
    assert figure is not None
    return figure
