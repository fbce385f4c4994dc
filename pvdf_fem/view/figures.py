"""Figures: functions that draw on a given `ax`, a common style, and reproducible files.

Nothing here touches matplotlib's global state: make a `matplotlib.figure.Figure` within `style()`,
draw on its axes, and write it with `save_figure`.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as Patch
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox, IdentityTransform
from numpy.typing import ArrayLike
from shapely import Point

from pvdf_fem.arrays import Array
from pvdf_fem.files import replace_file
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.placed.electrode import Electrode

# The look of all figures; matplotlib's stubs ask for literal keys.
_STYLE: dict[Any, Any] = matplotlib.rc_params_from_file(
    Path(__file__).with_suffix(".mplstyle"), use_default_template=False
)
#: The colours of lines.
COLOURS: tuple[str, ...] = tuple(_STYLE["axes.prop_cycle"].by_key()["color"])
GREY = "0.45"
WIDTH_MM = 120.0  #: Width of a figure in a report: readable on a phone.
DIVERGING = "RdBu_r"  #: Colours of values of both signs, white at zero.
MARKERS = "os^Dv<>pP*"  #: A marker for each electrode, besides its colour.
LABEL_SIZE = 8.0  #: Size of labels in points.
HALO = withStroke(linewidth=1.8, foreground="white")  #: Shows lines and texts on any colour.
DPI = 200.0  #: Pixels per inch of pictures without lines.

# Settings without which SVG files have random identifiers.
_REPRODUCIBLE: dict[Any, Any] = {"svg.hashsalt": "pvdf_fem", "svg.fonttype": "path"}
# Metadata that would tell a date or a version, by format.
_NO_DATE: dict[str, dict[str, None]] = {
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
    ".png": {"Software": None},
}


@contextmanager
def use_style() -> Iterator[None]:
    """A context in which new figures have the common look."""
    with matplotlib.rc_context(_STYLE):
        yield


class NotebookFigure(Figure):
    """A figure without a window, shown by notebooks."""

    def _repr_png_(self) -> bytes:
        return render_figure(self, ".png")


def make_figure(width_mm: float = 160.0, height_mm: float = 100.0) -> Figure:
    """An empty figure that belongs to no window."""
    return NotebookFigure(figsize=(width_mm / 25.4, height_mm / 25.4), dpi=DPI)  # in inches


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure in the format of the path's extension; the same figure gives the same bytes.
    Raises `FileError`, and ValueError with matplotlib's extensions."""
    path = Path(path)
    content = render_figure(figure, path.suffix.lower())  # a full disk confuses some writers
    with replace_file(path) as temporary:
        temporary.write_bytes(content)


def render_figure(figure: Figure, suffix: str) -> bytes:
    """The file that `save_figure` writes for an extension with its dot."""
    with matplotlib.rc_context({**_STYLE, **_REPRODUCIBLE}):
        if layout := figure.get_layout_engine():
            layout.execute(figure)
            figure.set_layout_engine("none")  # or matplotlib lays out twice more
        content = io.BytesIO()
        figure.savefig(content, format=suffix[1:], dpi=DPI, metadata=_NO_DATE.get(suffix))
    return content.getvalue()


def make_map_axes() -> Axes:
    """Axes for a map in a new figure."""
    figure = make_figure(120.0, 100.0)
    figure.set_layout_engine("compressed")  # the other one cuts labels beside a colour bar
    return figure.subplots()


def get_figure(ax: Axes) -> Figure:
    """The figure that axes belong to."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    return figure


def add_colour_bar(ax: Axes, drawn: ScalarMappable, label: str, **ticks: Any) -> None:
    """Put a colour bar beside a map."""
    get_figure(ax).colorbar(drawn, ax=ax, label=label, fraction=0.046, pad=0.03, **ticks)


def get_line_style(number: int) -> dict[str, Any]:
    """Colour, dashes and marker for an electrode's curve."""
    turn, colour = divmod(number, len(COLOURS))
    look = {"color": COLOURS[colour], "linestyle": ("-", "--")[turn % 2]}
    return {**look, "marker": MARKERS[number % len(MARKERS)]}


def choose_colours(
    values: ArrayLike, sequential: str = "viridis", both_signs: float = 0.05
) -> tuple[str, float, float]:
    """A colour map with its limits: `DIVERGING` about zero for values with both signs, else a
    sequential map over the values, reversed for negative values. Values with the rarer sign below
    the share `both_signs` of the largest magnitude do not count."""
    low, high = float(np.min(values)), float(np.max(values))
    small, large = sorted([max(high, 0.0), max(-low, 0.0)])
    if small > both_signs * large:
        return DIVERGING, -large, large
    return sequential + "_r" * (-low > high), low, high


def draw_rim(
    ax: Axes, radius_mm: float, reach_mm: float, centre_mm: ArrayLike = (0.0, 0.0)
) -> None:
    """Draw the film's rim on axes in mm that reach this far from the film's centre."""
    (x, y), angle = np.asarray(centre_mm, dtype=float), np.linspace(0.0, 2.0 * np.pi, 361)
    rim = x + radius_mm * np.cos(angle), y + radius_mm * np.sin(angle)
    ax.plot(*rim, color="black", linewidth=1.0)
    wide = 1.02 * reach_mm
    ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    ax.set(xlim=(x - wide, x + wide), ylim=(y - wide, y + wide))
    ax.grid(False)


def draw_electrode(ax: Axes, outline: Outline, words: Sequence[str], veil: float = 0.0) -> None:
    """An electrode's outline on axes in mm, and words beside it, or in it where there is room."""
    corners = 1e3 * np.array(outline.shape.exterior.coords)
    ax.add_patch(Patch(corners, facecolor="white", edgecolor="none", alpha=veil))
    ax.add_patch(Patch(corners, fill=False, linewidth=0.9, path_effects=[HALO]))
    ax.add_artist(_Label(Bbox([corners.min(axis=0), corners.max(axis=0)]), "\n".join(words)))


def draw_film(
    ax: Axes, radius_mm: float, electrodes: Iterable[Electrode], reach_mm: float | None = None
) -> None:
    """Draw the film's rim and electrodes with their names, as far as some mm from the centre, and
    further where this would cut an electrode."""
    drawn, reach = list(electrodes), radius_mm if reach_mm is None else reach_mm
    shapes = [electrode.outline.shape for electrode in drawn]
    begun = [shape.bounds for shape in shapes if 1e3 * shape.distance(Point(0.0, 0.0)) < reach]
    draw_rim(ax, radius_mm, max([reach, *(1e3 * np.abs(bounds).max() for bounds in begun)]))
    for electrode in drawn:
        draw_electrode(ax, electrode.outline, [electrode.name])


def draw_labelled_contours(
    ax: Axes,
    x: Array,
    y: Array,
    values: Array,
    levels: Iterable[float],
    occupied: Array,
    least: float = 0.25,
    inner: float = 0.75,
) -> None:
    """Lines of equal charge, named once, far from occupied places (n, 2). Lines smaller than the
    part `least` of the map have no names; names stand within the part `inner`."""
    inside = [level for level in levels if values.min() < level < values.max()]
    if not inside:
        return
    lines = ax.contour(x, y, values, inside, colors="black", linewidths=0.9)
    at = list[tuple[float, float]]()
    for places in (np.asarray(path.vertices) for path in lines.get_paths()):
        ways = np.linalg.norm(places[:, None] - [*occupied, *at], axis=-1).min(axis=1)
        ways[np.linalg.norm(places, axis=1) > inner * x.max()] *= 1e-3
        if np.ptp(places, axis=0).max() > least * np.ptp(x):
            at.append((places[ways.argmax(), 0], places[ways.argmax(), 1]))
    words = ax.clabel(lines, inside, fmt="%.4g", fontsize=7, manual=at)
    for drawn in (lines, *words):
        drawn.set_path_effects([HALO])


class _Label(Text):
    """Words beside a box in mm, which find their place when they are drawn, to scale."""

    def __init__(self, box_mm: Bbox, words: str) -> None:
        super().__init__(text=words, fontsize=LABEL_SIZE, ha="center", va="center")
        self.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0})
        self.set(transform=IdentityTransform(), in_layout=False)
        self.box_mm, self.words = box_mm, words

    def draw(self, renderer: RendererBase) -> None:
        """Draw a visible box's words where they hide the fewest lines and words; where all would
        hide some, the first line of words alone."""
        ax: Any = self.axes
        if (seen := Bbox.intersection(self.box_mm.transformed(ax.transData), ax.bbox)) is None:
            return
        for words in (self.words, self.words.partition("\n")[0]):
            self.set_text(words)
            middle, hidden = self._place(renderer, seen)
            if not hidden:
                break
        self.set_position((middle[0], middle[1]))
        super().draw(renderer)

    def _place(self, renderer: RendererBase, seen: Bbox) -> tuple[tuple[float, float], int]:
        """Middle of the words beside a seen box, in pixels, and how many lines and words they hide
        there."""
        ax: Any = self.axes
        paths = [x.get_path().transformed(x.get_transform()) for x in (*ax.lines, *ax.patches)]
        earlier = takewhile(lambda text: text is not self, ax.texts)
        boxes = [text.get_window_extent(renderer) for text in earlier]
        margin: Any = renderer.points_to_pixels(2.0)
        half = 0.5 * np.array(self.get_window_extent(renderer).size) + margin
        (low, high), (least, most) = np.reshape([seen.extents, ax.bbox.extents], (2, 2, 2))
        middles = 0.5 * (low + high) + self._ways() * (0.5 * (high - low) + half + margin)
        middles = np.clip(middles, least + half, most - half)
        hidden = []
        for place in (Bbox([middle - half, middle + half]) for middle in middles):
            lines = sum(path.intersects_bbox(place, filled=False) for path in paths)
            hidden.append(lines + place.count_overlaps(boxes))
        best = int(np.argmin(hidden))
        x, y = middles[best].tolist()
        return (x, y), hidden[best]

    def _ways(self) -> Array:
        """Ways from the box, (ways, 2): to its sides, that away from the film's centre first, then
        towards its corners, and none."""
        around = np.stack(np.meshgrid(*[np.linspace(1.0, -1.0, 5)] * 2), axis=-1).reshape(-1, 2)
        ways = around[np.isin(np.abs(around).max(axis=1), [0.0, 1.0])]
        away = np.round(np.mean([self.box_mm.p0, self.box_mm.p1], axis=0), 3)
        return ways[np.lexsort([-ways @ away, np.abs(np.abs(ways).sum(axis=1) - 1.0)])]
