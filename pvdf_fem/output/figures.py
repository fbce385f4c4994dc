"""Figures: functions that draw on a given `ax`, one style, and reproducible files.

Nothing here touches matplotlib's global state: make a `matplotlib.figure.Figure` within `style()`,
draw on its axes, and write it with `save`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as Patch
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from pvdf_fem.files import replacing
from pvdf_fem.scene.outlines.outline import Outline

# The look of all figures; matplotlib's stubs ask for literal keys.
_STYLE: dict[Any, Any] = matplotlib.rc_params_from_file(
    Path(__file__).with_suffix(".mplstyle"), use_default_template=False
)
#: The colours of lines.
COLOURS: tuple[str, ...] = tuple(_STYLE["axes.prop_cycle"].by_key()["color"])
GREY = "0.45"
LABEL_SIZE = 8.0  #: Size of labels in points.
HALO = withStroke(linewidth=2.2, foreground="white")  #: Shows lines and texts on any colour.
#: The look of an electrode's edge.
EDGE: dict[str, Any] = {
    "edgecolor": "black",
    "linewidth": 0.9,
    "path_effects": [HALO],
}
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
def style() -> Iterator[None]:
    """A context in which new figures have the look that all figures share."""
    with matplotlib.rc_context(_STYLE):
        yield


class Picture(Figure):
    """A figure that belongs to no window and that notebooks show."""

    def _repr_png_(self) -> bytes:
        return content_of(self, ".png")


def new_figure(width_mm: float = 160.0, height_mm: float = 100.0) -> Figure:
    """An empty figure that belongs to no window."""
    return Picture(figsize=(width_mm / 25.4, height_mm / 25.4), dpi=DPI)  # in inches


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure in the format of the path's extension; the same figure gives the same bytes.
    Raises ValueError, which lists the extensions that matplotlib writes, and `FileError`."""
    path = Path(path)
    content = content_of(figure, path.suffix.lower())  # a full disk confuses some writers
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def content_of(figure: Figure, suffix: str) -> bytes:
    """The file that `save` writes for an extension with its dot."""
    with matplotlib.rc_context({**_STYLE, **_REPRODUCIBLE}):
        if layout := figure.get_layout_engine():
            layout.execute(figure)
            figure.set_layout_engine("none")  # or matplotlib lays out twice more
        content = io.BytesIO()
        figure.savefig(content, format=suffix[1:], dpi=DPI, metadata=_NO_DATE.get(suffix))
    return content.getvalue()


def figure_of(ax: Axes) -> Figure:
    """The figure that axes belong to."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    return figure


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


def draw_outline(ax: Axes, outline: Outline, **look: Any) -> None:
    """Draw an outline on axes in mm, without face and edge unless `look` has them."""
    corners = 1e3 * np.array(outline.shape.exterior.coords)
    ax.add_patch(Patch(corners, **{"facecolor": "none", "edgecolor": "none", **look}))


def name_outline(ax: Axes, outline: Outline, words: Sequence[str]) -> None:
    """Words beside an electrode's outline, on the side away from the film's centre."""
    centre = 1e3 * outline.centroid
    low_x, low_y, high_x, high_y = 1e3 * np.array(outline.shape.bounds)
    direction = centre / (np.linalg.norm(centre) or 1.0)
    sideways = abs(direction[0]) > 0.5
    beyond = direction[0 if sideways else 1] >= 0.0
    sign = 4.0 if beyond else -4.0
    if sideways:
        place, offset = (high_x if beyond else low_x, centre[1]), (sign, 0.0)
        align: dict[str, Any] = {"ha": "left" if beyond else "right", "va": "center"}
    else:
        place, offset = (centre[0], high_y if beyond else low_y), (0.0, sign)
        align = {"ha": "center", "va": "bottom" if beyond else "top"}
    ax.annotate(
        ("\n" if sideways else "  ").join(words),
        place,
        offset,
        textcoords="offset points",
        fontsize=LABEL_SIZE,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
        clip_on=True,
        **align,
    )
