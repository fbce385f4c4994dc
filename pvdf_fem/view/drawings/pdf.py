"""Write a drawing as PDF at scale 1:1 with matplotlib.

Matplotlib leaves out points of long lines and crops pages by default: both change sizes, so the
page is placed in points, and lines are not simplified.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Curve
from matplotlib.text import Text
from matplotlib.transforms import Affine2D, Transform

from pvdf_fem.arrays import Array
from pvdf_fem.files import replace_file
from pvdf_fem.scene.outlines.arc import Arc
from pvdf_fem.scene.outlines.outline import EllipseCurve, Line, Outline
from pvdf_fem.view.drawings.sheet import (
    CAPITAL_HEIGHT,
    LINE_WIDTH,
    STYLES,
    Dimension,
    Label,
    Layer,
    Sheet,
)
from pvdf_fem.view.drawings.strokes import draw_dimension

MM_PER_INCH = 25.4
POINTS_PER_MM = 72.0 / MM_PER_INCH
#: Maximum angle of a Bézier curve: its distance from the arc is 4e-7 of the radius.
BEZIER_ANGLE = np.pi / 6.0


def write_pdf(sheet: Sheet, path: Path) -> None:
    """Write a drawing as a PDF page whose size is that of the sheet.

    Parameters
    ----------
    sheet : Sheet
        The drawing.
    path : Path
        File to write.
    """
    with matplotlib.rc_context({"path.simplify": False, "path.snap": False}):
        figure = _make_figure(sheet)
        with replace_file(path) as temporary:
            # the canvas writes pages of the figure's size, whatever savefig.bbox is
            canvas: Any = FigureCanvasPdf(figure)
            canvas.print_pdf(temporary, metadata={"Title": sheet.title})


def _make_figure(sheet: Sheet) -> Figure:
    """Make a figure of the sheet's size with everything on it."""
    width_inch = 2.0 * sheet.half_width / MM_PER_INCH
    figure = Figure(figsize=(width_inch, width_inch), dpi=72.0)
    figure.patch.set_visible(False)
    to_inches = Affine2D().translate(sheet.half_width, sheet.half_width).scale(1.0 / MM_PER_INCH)
    to_page = to_inches + figure.dpi_scale_trans
    for item in sheet.outlines:
        _add_path(figure, _make_outline_path(item.outline), item.layer, transform=to_page)
    for label in sheet.labels:
        _add_label(figure, label, angle_deg=0.0, transform=to_page)
    for dimension in sheet.dimensions:
        _add_dimension(figure, dimension, to_page)
    return figure


def _add_path(figure: Figure, path: Curve, layer: Layer, transform: Transform) -> None:
    """Add a line of a layer.

    Parameters
    ----------
    figure : Figure
        The figure.
    path : Path of matplotlib
        The line in mm.
    layer : Layer
        The layer, which has the colour.
    transform : Transform
        From mm to the page.
    """
    patch = PathPatch(path, fill=False, edgecolor=STYLES[layer].colour, transform=transform)
    patch.set(linewidth=LINE_WIDTH * POINTS_PER_MM, joinstyle="round")
    figure.add_artist(patch)


def _make_outline_path(outline: Outline) -> Curve:
    """Make the path of an outline, with Bézier curves along its arcs."""
    points: list[Array] = []
    codes: list[np.uint8] = []
    for side in outline.boundary:
        if isinstance(side, Line):
            pieces = side.end[None]
            code = Curve.LINETO
            first = side.start
        else:
            pieces = _make_bezier_points(side)
            code = Curve.CURVE4
            first = pieces[0]
            pieces = pieces[1:]
        if not points:
            points.append(first[None])
            codes.append(Curve.MOVETO)
        points.append(pieces)
        codes += [code] * len(pieces)
    vertices = np.concatenate([*points, points[0]])
    return Curve(vertices, [*codes, Curve.CLOSEPOLY])


def _make_bezier_points(side: Arc | EllipseCurve) -> Array:
    """Make the control points of cubic Bézier curves along an arc, shape (3 n + 1, 2).

    Notes
    -----
    The control points of an arc of the angle φ on the unit circle are 4/3 tan(φ/4) from its ends.
    """
    if isinstance(side, Arc):
        x, y = side.start - side.centre
        axes = np.array([[x, -y], [y, x]])
        sweep = side.angle
    else:
        axes = side.axes
        sweep = 2.0 * np.pi
    count = int(np.ceil(abs(sweep) / BEZIER_ANGLE - 1e-9))
    step = sweep / count
    angles = step * np.arange(count + 1)
    on_circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    tangents = 4.0 / 3.0 * np.tan(0.25 * step) * on_circle[:, ::-1] * np.array([-1.0, 1.0])
    pieces = [on_circle[:1]]
    for number in range(count):
        first = on_circle[number] + tangents[number]
        second = on_circle[number + 1] - tangents[number + 1]
        pieces.append(np.stack([first, second, on_circle[number + 1]]))
    return side.centre + np.concatenate(pieces) @ axes.T


def _add_label(figure: Figure, label: Label, angle_deg: float, transform: Transform) -> None:
    """Add a text about a point.

    Parameters
    ----------
    figure : Figure
        The figure.
    label : Label
        The text.
    angle_deg : float
        Rotation, counter-clockwise.
    transform : Transform
        From mm to the page.
    """
    x, y = label.centre
    text = Text(x, y, label.text, color=STYLES[label.layer].colour, transform=transform)
    size = label.height / CAPITAL_HEIGHT * POINTS_PER_MM
    text.set(fontsize=size, ha="center", va="center_baseline")
    text.set(rotation=angle_deg, rotation_mode="anchor", parse_math=False)
    figure.add_artist(text)


def _add_dimension(figure: Figure, dimension: Dimension, transform: Transform) -> None:
    """Add a dimension as lines, arrowheads and a text.

    Parameters
    ----------
    figure : Figure
        The figure.
    dimension : Dimension
        The dimension.
    transform : Transform
        From mm to the page.
    """
    strokes = draw_dimension(dimension)
    for ends in strokes.lines:
        _add_path(figure, Curve(ends), Layer.DIMENSIONS, transform=transform)
    for corners in strokes.arrows:
        colour = STYLES[Layer.DIMENSIONS].colour
        arrow = PathPatch(Curve(corners), facecolor=colour, edgecolor="none", transform=transform)
        figure.add_artist(arrow)
    label = Label(Layer.DIMENSIONS, dimension.text, strokes.text_centre, height=dimension.height)
    _add_label(figure, label, angle_deg=strokes.text_angle_deg, transform=transform)
