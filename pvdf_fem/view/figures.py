"""Figures: their common style, reproducible files, and drawings of the film with electrodes.

Nothing here changes matplotlib's global state. Make a figure with `make_figure` within
`use_style()`, draw on its axes, and write it with `save_figure`.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as Patch
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox
from numpy.typing import ArrayLike
from shapely import Point

from pvdf_fem.arrays import Array
from pvdf_fem.files import replace_file
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.placed.electrode import Electrode
from pvdf_fem.view.placed_label import PlacedLabel

# The style of all figures. Its keys have the type Any, because matplotlib's stubs ask for literals.
_STYLE: dict[Any, Any] = matplotlib.rc_params_from_file(
    Path(__file__).with_suffix(".mplstyle"), use_default_template=False
)
#: The colours of lines.
COLOURS: tuple[str, ...] = tuple(_STYLE["axes.prop_cycle"].by_key()["color"])
GREY = "0.45"
WIDTH_MM = 120.0  #: Width of a figure in a report: readable on a phone.
DIVERGING = "RdBu_r"  #: Colour map for values of both signs; zero is white.
MARKERS = "os^Dv<>pP*"  #: A marker for each electrode, besides its colour.
#: Width of a map divided by its height above which its colour bar is below it.
FLAT_MAP = 2.5
LABEL_SIZE = 8.0  #: Size of labels in points.
#: A white outline that makes lines and texts readable on any colour.
HALO = withStroke(linewidth=1.8, foreground="white")
DPI = 200.0  #: Resolution of raster images in pixels per inch.

# Without these settings SVG files would have random identifiers.
_REPRODUCIBLE: dict[Any, Any] = {"svg.hashsalt": "pvdf_fem", "svg.fonttype": "path"}
# Metadata with a date or a version by format; None removes them.
_NO_DATE: dict[str, dict[str, None]] = {
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
    ".png": {"Software": None},
}


@contextmanager
def use_style() -> Iterator[None]:
    """Apply the common style to figures that are made within this context."""
    with matplotlib.rc_context(_STYLE):
        yield


class NotebookFigure(Figure):
    """A figure without a window, which notebooks show as PNG."""

    def _repr_png_(self) -> bytes:
        """Return the figure as the content of a PNG file."""
        return render_figure(self, ".png")


def make_figure(width_mm: float = 160.0, height_mm: float = 100.0) -> Figure:
    """Make an empty figure of the given size that does not belong to a window."""
    mm_per_inch = 25.4
    return NotebookFigure(figsize=(width_mm / mm_per_inch, height_mm / mm_per_inch), dpi=DPI)


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file; the same figure always gives the same bytes.

    Parameters
    ----------
    figure : Figure
        The figure, whose layout is computed and then remains as it is.
    path : path
        File to write; its extension chooses the format.

    Raises
    ------
    FileError
        If the file cannot be written.
    ValueError
        If the format is unknown. The message lists the formats of matplotlib.
    """
    path = Path(path)
    # rendered to memory first, because some of matplotlib's writers fail on a full disk
    content = render_figure(figure, path.suffix.lower())
    with replace_file(path) as temporary:
        temporary.write_bytes(content)


def render_figure(figure: Figure, suffix: str) -> bytes:
    """Return a figure as the content of a file with the extension `suffix`, such as ``.svg``.

    The layout of the figure is computed and then remains as it is.
    """
    with matplotlib.rc_context({**_STYLE, **_REPRODUCIBLE}):
        layout = figure.get_layout_engine()
        if layout is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")  # otherwise the layout is computed twice more
        content = io.BytesIO()
        figure.savefig(content, format=suffix[1:], dpi=DPI, metadata=_NO_DATE.get(suffix))
    return content.getvalue()


def make_map_axes() -> Axes:
    """Make a new figure with room for a map and a colour bar, and return the axes of the map."""
    figure = make_figure(120.0, 100.0)
    figure.set_layout_engine("compressed")  # the default layout cuts labels beside a colour bar
    return figure.subplots()


def get_figure(ax: Axes) -> Figure:
    """Return the figure to which axes belong."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    return figure


def add_colour_bar(ax: Axes, drawn: ScalarMappable, label: str, **options: Any) -> None:
    """Add a colour bar beside a map, or below the map of a flat film.

    Parameters
    ----------
    ax : Axes
        The map.
    drawn : ScalarMappable
        The artist whose colours the bar explains.
    label : str
        Label of the colour bar, with unit.
    **options
        Additional arguments of matplotlib's `Figure.colorbar`.
    """
    left, right = ax.get_xlim()
    low, high = ax.get_ylim()
    ratio = abs((right - left) / (high - low))
    figure = get_figure(ax)
    if ax.get_aspect() != 1.0 or ratio < FLAT_MAP:
        figure.colorbar(drawn, ax=ax, label=label, fraction=0.046, pad=0.03, **options)
        return
    # beside a flat map of equal axes, a bar would be too short for its labels
    below = ax.inset_axes((0.0, -0.2 * ratio, 1.0, 0.03 * ratio))
    figure.colorbar(drawn, cax=below, label=label, orientation="horizontal", **options)


def get_line_style(number: int) -> dict[str, Any]:
    """Return the colour, line style and marker of the curve with index `number`.

    Curves with the same colour have alternately solid and dashed lines.
    """
    cycle, colour = divmod(number, len(COLOURS))
    return {
        "color": COLOURS[colour],
        "linestyle": "-" if cycle % 2 == 0 else "--",
        "marker": MARKERS[number % len(MARKERS)],
    }


class ColourScale(NamedTuple):
    """A colour map of matplotlib, and the values at its ends."""

    name: str
    low: float
    high: float


def choose_colours(
    values: ArrayLike, sequential: str = "viridis", both_signs: float = 0.05
) -> ColourScale:
    """Choose a diverging colour map for values of both signs, and a sequential one for others.

    Parameters
    ----------
    values : array_like
        The values to show, without NaN.
    sequential : str
        Colour map for values of one sign. It is reversed if the largest magnitude is negative.
    both_signs : float
        Values are of both signs if the largest positive and the largest negative magnitude are
        above this fraction of the largest magnitude.

    Returns
    -------
    ColourScale
        `DIVERGING` from minus to plus the largest magnitude, or the sequential colour map from the
        minimum to the maximum.
    """
    low = float(np.min(values))
    high = float(np.max(values))
    largest_positive = max(high, 0.0)
    largest_negative = max(-low, 0.0)
    largest = max(largest_positive, largest_negative)
    if min(largest_positive, largest_negative) > both_signs * largest:
        return ColourScale(DIVERGING, -largest, largest)
    is_negative = -low > high
    return ColourScale(f"{sequential}_r" if is_negative else sequential, low, high)


def draw_rim(
    ax: Axes, rim: Outline, reach_mm: float | None = None, centre_mm: ArrayLike = (0.0, 0.0)
) -> None:
    """Draw the film's rim, and set the limits and labels of the axes.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on. Both scales become equal, and the grid is switched off.
    rim : Outline
        Outline of the film in m.
    reach_mm : float, optional
        Half the width in mm of the visible region around the centre of the film. Default: the whole
        film.
    centre_mm : array_like, shape (2,)
        Centre of the film in mm.
    """
    ax.plot(*_list_corners_mm(rim).T, color="black", linewidth=1.0)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    if reach_mm is None:
        low_mm, high_mm = np.reshape(rim.inscribed_polygon.bounds, (2, 2)) * 1e3
        centre = 0.5 * (low_mm + high_mm)
        half_widths = 0.51 * (high_mm - low_mm)
    else:
        centre = np.asarray(centre_mm, dtype=float)
        half_widths = np.full(2, 1.02 * reach_mm)
    left, lower = centre - half_widths
    right, upper = centre + half_widths
    ax.set(xlim=(left, right), ylim=(lower, upper))
    ax.grid(False)


def _list_corners_mm(outline: Outline) -> Array:
    """Return the corners in mm of the polygon inscribed in an outline, closed, shape (n, 2)."""
    return 1e3 * np.array(outline.inscribed_polygon.exterior.coords)


def draw_electrode(ax: Axes, outline: Outline, lines: Sequence[str], veil: float = 0.0) -> None:
    """Draw an electrode's outline with lines of text beside it or inside it.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    outline : Outline
        Outline of the electrode in m.
    lines : sequence of str
        Lines of text, with the electrode's name first. If all of them would cover lines or texts,
        only the name is drawn.
    veil : float
        Opacity of a white area inside the outline that covers the map, from 0 to 1.
    """
    corners_mm = _list_corners_mm(outline)
    ax.add_patch(Patch(corners_mm, facecolor="white", edgecolor="none", alpha=veil))
    ax.add_patch(Patch(corners_mm, fill=False, linewidth=0.9, path_effects=[HALO]))
    box_mm = Bbox([corners_mm.min(axis=0), corners_mm.max(axis=0)])
    ax.add_artist(PlacedLabel(box_mm, "\n".join(lines), LABEL_SIZE))


def draw_film(
    ax: Axes, rim: Outline, electrodes: Iterable[Electrode], reach_mm: float | None = None
) -> None:
    """Draw the film's rim, and the electrodes with their names.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on, whose limits and labels are set.
    rim : Outline
        Outline of the film in m.
    electrodes : iterable of Electrode
        Electrodes of the film.
    reach_mm : float, optional
        Half the width of the visible region in mm. Default: the whole film. The region is enlarged
        to show all of each electrode that is closer to the film's centre than `reach_mm`.
    """
    electrodes = list(electrodes)
    half_width = reach_mm
    if reach_mm is not None:
        centre = Point(0.0, 0.0)
        for electrode in electrodes:
            shape = electrode.outline.inscribed_polygon
            if 1e3 * shape.distance(centre) < reach_mm:
                half_width = max(half_width, 1e3 * np.abs(shape.bounds).max())
    draw_rim(ax, rim, half_width)
    for electrode in electrodes:
        draw_electrode(ax, electrode.outline, [electrode.name])


def draw_labelled_contours(
    ax: Axes,
    x: Array,
    y: Array,
    values: Array,
    levels: Iterable[float],
    occupied: Array,
    min_size: float = 0.25,
    inner: float = 0.75,
) -> None:
    """Draw lines of equal value, and label each of them unless it is short.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    x, y : ndarray, shape (n, m)
        Coordinates in mm of the points of a grid.
    values : ndarray, shape (n, m)
        Values at the points.
    levels : iterable of float
        Values of the lines. Levels outside of the range of `values` are not drawn.
    occupied : ndarray, shape (k, 2)
        Points in mm, such as the centres of electrodes. Each label is placed as far as possible
        from these and from the earlier labels.
    min_size : float
        Lines that are not longer than this fraction of the width of the grid, along x and along y,
        get no label.
    inner : float
        Labels farther from the origin than this fraction of the largest x are avoided.
    """
    visible = [level for level in levels if values.min() < level < values.max()]
    if not visible:
        return
    lines = ax.contour(x, y, values, visible, colors="black", linewidths=0.9)
    labels: list[tuple[float, float]] = []
    for path in lines.get_paths():
        vertices = np.asarray(path.vertices)
        if np.ptp(vertices, axis=0).max() <= min_size * np.ptp(x):
            continue
        to_avoid = [*occupied, *labels]
        distances = np.linalg.norm(vertices[:, None] - to_avoid, axis=-1).min(axis=1)
        is_far_out = np.linalg.norm(vertices, axis=1) > inner * x.max()
        distances[is_far_out] *= 1e-3
        best = distances.argmax()
        labels.append((vertices[best, 0], vertices[best, 1]))
    texts = ax.clabel(lines, visible, fmt="%.4g", fontsize=7, manual=labels)
    for artist in (lines, *texts):
        artist.set_path_effects([HALO])


def make_panels(
    count: int, abreast: int = 2, panel_mm: float = 45.0, share_y: bool = True
) -> tuple[Figure, list[Axes]]:
    """Make a new figure with square panels in rows; two in a row are readable on a phone.

    Parameters
    ----------
    count : int
        Number of panels.
    abreast : int
        Maximum number of panels in a row.
    panel_mm : float
        Width of a panel in mm.
    share_y : bool
        Whether all panels have the same limits along y. Those along x are always the same.

    Returns
    -------
    figure : Figure
    panels : list of Axes
        The axes of the panels, row by row from the upper left.
    """
    rows = math.ceil(count / abreast)
    columns = min(count, abreast)
    figure = make_figure(panel_mm * columns + 30.0, (panel_mm + 8.0) * rows + 10.0)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=share_y)
    for ax in axes.flat[count:]:
        ax.remove()
    for ax in axes.flat[count - columns : count]:  # also panels above an empty position
        ax.tick_params(labelbottom=True)
    return figure, list(axes.flat[:count])
