"""Write a drawing as SVG: one user unit is 1 mm, and the origin is the film's centre."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import replace_file
from pvdf_fem.scene.outlines.arc import Arc
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import Line, Outline
from pvdf_fem.scene.outlines.polygon import Polygon
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

_SVG = "http://www.w3.org/2000/svg"
_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def write_svg(sheet: Sheet, path: Path) -> None:
    """Write a drawing as SVG, with a group for each layer.

    Parameters
    ----------
    sheet : Sheet
        The drawing.
    path : Path
        File to write.
    """
    ElementTree.register_namespace("", _SVG)
    ElementTree.register_namespace("inkscape", _INKSCAPE)
    half = sheet.half_width
    root = Element(f"{{{_SVG}}}svg")
    root.set("width", f"{_format(2.0 * half)}mm")
    root.set("height", f"{_format(2.0 * half)}mm")
    root.set("viewBox", _join([-half, -half, 2.0 * half, 2.0 * half]))
    for layer in sheet.layers:
        group = _add(root, "g", id=layer.value, stroke=STYLES[layer].colour, fill="none")
        group.set("class", layer.value)
        group.set("stroke-width", _format(LINE_WIDTH))
        group.set(f"{{{_INKSCAPE}}}label", layer.value)
        group.set(f"{{{_INKSCAPE}}}groupmode", "layer")
        _fill_layer(group, sheet, layer)
    ElementTree.indent(root)
    with replace_file(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, "utf-8", xml_declaration=True)


def _fill_layer(group: Element, sheet: Sheet, layer: Layer) -> None:
    """Add the outlines, texts and dimensions of a layer to its group.

    Parameters
    ----------
    group : Element
        The group.
    sheet : Sheet
        The drawing.
    layer : Layer
        The layer.
    """
    number = 0
    for item in sheet.outlines:
        if item.layer is layer:
            number += 1
            shape = _add_outline(group, item.outline)
            shape.set("id", f"{layer.value.lower()}-{number}")
            shape.set(f"{{{_INKSCAPE}}}label", item.name)
            _add(shape, "title").text = item.name
    for label in sheet.labels:
        if label.layer is layer:
            _add_label(group, label, angle_deg=0.0)
    if layer is Layer.DIMENSIONS:
        for dimension in sheet.dimensions:
            _add_dimension(group, dimension)


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    """Add an SVG element."""
    return SubElement(parent, f"{{{_SVG}}}{tag}", attributes)


def _format(number: float) -> str:
    """Format a length in mm to 1e-12 m."""
    return f"{round(float(number), 9) + 0.0:.12g}"


def _join(numbers: Iterable[float]) -> str:
    """Format numbers with blanks between them."""
    return " ".join(_format(number) for number in numbers)


def _flip(points: Array) -> Array:
    """Return points with y downwards."""
    return points * np.array([1.0, -1.0])


def _add_outline(group: Element, outline: Outline) -> Element:
    """Add an outline: a circle, an ellipse, a polygon, or a path with arcs."""
    if isinstance(outline, Ellipse):
        x, y = _flip(outline.centre)
        if isinstance(outline, Circle):
            return _add(group, "circle", cx=_format(x), cy=_format(y), r=_format(outline.radius))
        first, second = np.linalg.norm(outline.axes, axis=0)
        along_x, along_y = outline.first
        angle_deg = -np.degrees(np.arctan2(along_y, along_x))
        shape = _add(group, "ellipse", cx=_format(x), cy=_format(y), rx=_format(first))
        shape.set("ry", _format(second))
        shape.set("transform", f"rotate({_join([angle_deg, x, y])})")
        return shape
    if isinstance(outline, Polygon):
        return _add(group, "polygon", points=_join(_flip(outline.vertices).ravel()))
    words = [f"M {_join(_flip(outline.defining_points[0]))}"]
    for side in outline.boundary:
        if isinstance(side, Arc):
            is_large = int(abs(side.angle) > np.pi)
            is_clockwise = int(side.bulge < 0.0)  # to the eye, as y points downwards
            radius = _join([side.radius, side.radius])
            end = _join(_flip(side.end))
            words.append(f"A {radius} 0 {is_large} {is_clockwise} {end}")
        elif isinstance(side, Line):
            words.append(f"L {_join(_flip(side.end))}")
    return _add(group, "path", d=" ".join([*words, "Z"]))


def _add_label(group: Element, label: Label, angle_deg: float) -> None:
    """Add a text about a point.

    Parameters
    ----------
    group : Element
        The group of its layer.
    label : Label
        The text.
    angle_deg : float
        Rotation, counter-clockwise.
    """
    x, y = _flip(label.centre)
    text = _add(group, "text", x=_format(x), fill=STYLES[label.layer].colour, stroke="none")
    size = label.height / CAPITAL_HEIGHT
    text.set("y", _format(y + 0.5 * label.height))  # y is that of the base line
    text.set("font-size", _format(size))
    text.set("font-family", "sans-serif")
    text.set("text-anchor", "middle")
    if angle_deg:
        text.set("transform", f"rotate({_join([-angle_deg, x, y])})")
    text.text = label.text


def _add_dimension(group: Element, dimension: Dimension) -> None:
    """Add a dimension as lines, arrowheads and a text."""
    strokes = draw_dimension(dimension)
    for start, end in _flip(strokes.lines):
        line = _add(group, "line", x1=_format(start[0]), y1=_format(start[1]))
        line.set("x2", _format(end[0]))
        line.set("y2", _format(end[1]))
    for corners in _flip(strokes.arrows):
        arrow = _add(group, "polygon", points=_join(corners.ravel()), stroke="none")
        arrow.set("fill", STYLES[Layer.DIMENSIONS].colour)
    label = Label(Layer.DIMENSIONS, dimension.text, strokes.text_centre, height=dimension.height)
    _add_label(group, label, angle_deg=strokes.text_angle_deg)
