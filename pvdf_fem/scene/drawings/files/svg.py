"""Read the curves and texts of an SVG file.

svgelements parses path data and transforms. The tree is walked here, because svgelements 1.9
misplaces nested ``svg`` elements and draws symbols, masks and markers that are only definitions.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pvdf_fem.files import read_bytes
from pvdf_fem.scene.drawings.content import (
    MAX_BYTES,
    MAX_DEPTH,
    NO_LAYER,
    DrawingContent,
    DrawingError,
    DrawnPath,
    DrawnText,
    Unit,
)
from pvdf_fem.scene.drawings.files.svg_shapes import Affine, Viewport, parse_transform, read_shape
from pvdf_fem.scene.drawings.files.svg_styles import (
    PIXELS,
    StyleSheet,
    get_tag,
    parse_length,
    resolve_length,
)
from pvdf_fem.scene.drawings.units import UNITS_MM

_GROUPS = ("g", "a", "switch")
_SHAPES = ("rect", "circle", "ellipse", "line", "polyline", "polygon", "path")
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_HREF = "{http://www.w3.org/1999/xlink}href"
#: Maximum depth of elements: each clone is within a few groups.
_MAX_ELEMENT_DEPTH = 4 * MAX_DEPTH
#: Estimated mean width of a character, and height of its middle above the base line, as fractions
#: of the font size.
_CHARACTER_WIDTH = 0.6
_CHARACTER_MIDDLE = 0.35
#: Elements that are drawn, but have no outline.
_PICTURES = ("image", "foreignObject")


class _Context(NamedTuple):
    """Where an element stands in the tree."""

    to_drawing: Affine  #: From the element's coordinates to those of the drawing, y upwards.
    viewport: Viewport
    groups: tuple[str, ...]  #: Ids, classes and labels of the elements around it.
    layer: str  #: Label or id of the innermost group that has one.
    is_hidden: bool
    depth: int


def read_svg(path: Path, layer: str | None) -> DrawingContent:
    """Read the visible curves and texts of an SVG file.

    Parameters
    ----------
    path : Path
        Path of an SVG file.
    layer : str or None
        Id, class, or label of an Inkscape layer, of the shapes to read or of a group around them;
        None for all shapes.

    Returns
    -------
    DrawingContent
        In units of the outer viewBox, with y upwards.

    Raises
    ------
    DrawingError
        If the file is no SVG file, or a shape cannot be read.
    FileError
        If the file cannot be read.
    ModuleNotFoundError
        If svgelements is not installed.
    """
    import svgelements  # noqa: F401  # needed for every path

    raw = read_bytes(path, MAX_BYTES, "a drawing")
    try:
        root = ElementTree.fromstring(raw)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        reason = f"is not an SVG file ({str(error)[:100]})"
        raise DrawingError(f"{reason}; save it again as plain SVG") from None
    if get_tag(root) != "svg":
        raise DrawingError(f"begins with <{get_tag(root)}>, not <svg>; save it as plain SVG")
    box = _read_view_box(root)
    unit, advice = _read_unit(root, box)
    content = DrawingContent(path, unit, unit_advice=advice)
    viewport = Viewport(box[2], box[3]) if box else _read_viewport_without_box(root)
    flip = Affine(np.diag([1.0, -1.0]), np.zeros(2))
    start = _Context(flip, viewport, groups=(), layer="", is_hidden=False, depth=0)
    walker = _Walker(root, content, layer=layer)
    walker.walk_children(root, start)
    return content


def _read_view_box(element: Element) -> tuple[float, float, float, float] | None:
    """Return x, y, width and height of a viewBox, or None without a valid one."""
    words = element.get("viewBox", "").replace(",", " ").split()
    try:
        x, y, width, height = map(float, words)
    except ValueError:
        return None
    return (x, y, width, height) if width > 0.0 and height > 0.0 else None


def _read_unit(
    root: Element, box: tuple[float, float, float, float] | None
) -> tuple[Unit | None, str]:
    """Return the unit of a drawing, stated by its size and viewBox, or why there is none."""
    if box is None:
        return None, "it has no viewBox"
    sizes_mm = []
    for name, extent in (("width", box[2]), ("height", box[3])):
        if name not in root.attrib:
            continue
        length = parse_length(root.attrib[name], f"<svg> {name}")
        if length.unit in ("", "%"):
            return None, f'its {name} is "{root.attrib[name]}", without a unit of length'
        sizes_mm.append(length.number * PIXELS[length.unit] * UNITS_MM["px"] / extent)
    if not sizes_mm:
        return None, "it has neither width nor height"
    if min(sizes_mm) <= 0.0:
        return None, "its width or height is not positive"
    if root.get("preserveAspectRatio", "").strip() == "none" and np.ptp(sizes_mm) > 1e-6:
        reason = 'stretches its drawing by preserveAspectRatio = "none"'
        raise DrawingError(f"{reason}; give width, height and viewBox the same ratio")
    sizes = f"width = {root.get('width')}, height = {root.get('height')}"
    statement = f"{sizes} and viewBox = {root.get('viewBox')}"
    scale = max(sizes_mm) if "slice" in root.get("preserveAspectRatio", "") else min(sizes_mm)
    return Unit(scale, statement), ""


def _read_viewport_without_box(root: Element) -> Viewport:
    """Return the size of a drawing without a viewBox, in pixels, as far as it is known."""
    sizes: list[float | None] = []
    for name in ("width", "height"):
        length = parse_length(root.get(name, "100%"), f"<svg> {name}")
        sizes.append(None if length.unit == "%" else length.number * PIXELS[length.unit])
    return Viewport(sizes[0], sizes[1])


@dataclass
class _Walker:
    """Adds the visible elements of an SVG tree to the content of a drawing.

    Parameters
    ----------
    root : Element
        The outer ``svg`` element.
    content : DrawingContent
        Receives curves and texts.
    layer : str or None
        Id, class or label of the shapes to read.
    """

    root: Element
    content: DrawingContent
    layer: str | None

    def __post_init__(self) -> None:
        """Index the elements by id, and read the style sheets."""
        self.by_id: dict[str, Element] = {}
        for element in self.root.iter():
            self.by_id.setdefault(element.get("id", ""), element)
        self.styles = StyleSheet(self.root.iter())

    def walk_children(self, element: Element, context: _Context) -> None:
        """Add what an element contains."""
        if context.depth > _MAX_ELEMENT_DEPTH:
            raise DrawingError("has groups in groups that do not end; simplify the drawing")
        for child in element:
            self._walk(child, context)

    def _walk(self, element: Element, context: _Context) -> None:
        """Add an element with what it contains, if it is visible."""
        tag = get_tag(element)
        if tag not in (*_GROUPS, *_SHAPES, *_PICTURES, "svg", "use", "text"):
            return
        self.content.count_entity()
        if self.styles.get_property(element, "display") == "none":
            return
        place = f"<{tag}> {element.get('id', '')}".strip()
        visibility = self.styles.get_property(element, "visibility")
        is_hidden = visibility in ("hidden", "collapse") or (
            context.is_hidden and visibility != "visible"
        )
        label = element.get(_LABEL, "")
        names = (element.get("id", ""), label, *element.get("class", "").split())
        to_drawing = context.to_drawing
        transform = self.styles.get_property(element, "transform")
        if transform and transform != "none":
            to_drawing = parse_transform(transform, place).then(to_drawing)
        inner = context._replace(
            to_drawing=to_drawing,
            groups=(*context.groups, *filter(None, names)),
            is_hidden=is_hidden,
            depth=context.depth + 1,
        )
        if tag in _GROUPS:
            named = label or element.get("id", "") or " ".join(element.get("class", "").split())
            self.walk_children(element, inner._replace(layer=named or context.layer))
        elif tag == "svg":
            self.walk_children(element, self._enter_viewport(element, inner, place, size=element))
        elif tag == "use":
            self._use(element, inner, place)
        elif is_hidden:
            return
        elif tag == "text":
            self._add_text(element, inner, place)
        elif tag in _PICTURES:
            self.content.ignored[tag] += 1
        else:
            self._add_shape(element, inner, place)

    def _use(self, element: Element, context: _Context, place: str) -> None:
        """Add the element to which a ``use`` refers, moved by x and y."""
        reference = element.get("href", element.get(_HREF, ""))
        target = self.by_id.get(reference.removeprefix("#")) if reference[:1] == "#" else None
        if target is None:
            reason = f'{place} refers to "{reference[:60]}", which the drawing does not have'
            raise DrawingError(f"{reason}; unlink the clone in the drawing program")
        if context.depth > _MAX_ELEMENT_DEPTH:
            raise DrawingError(f"{place} refers to itself; unlink the clone")
        x = resolve_length(element.get("x", "0"), context.viewport.width, f"{place} x")
        y = resolve_length(element.get("y", "0"), context.viewport.height, f"{place} y")
        moved = Affine(np.eye(2), np.array([x, y])).then(context.to_drawing)
        inner = context._replace(to_drawing=moved)
        if get_tag(target) == "symbol":
            names = filter(None, (target.get("id", ""), *target.get("class", "").split()))
            inner = inner._replace(groups=(*inner.groups, *names))
            self.walk_children(target, self._enter_viewport(target, inner, place, size=element))
        else:
            self._walk(target, inner)

    def _enter_viewport(
        self, element: Element, context: _Context, place: str, size: Element
    ) -> _Context:
        """Return the context within a nested ``svg`` or a ``symbol``.

        Parameters
        ----------
        element : Element
            The element, with its viewBox and, for ``svg``, its place.
        context : _Context
            The context of the element.
        place : str
            Name of the element in messages.
        size : Element
            The element that has width and height: the ``svg`` itself, or the ``use`` of a symbol.
        """
        viewport = context.viewport
        origin = np.zeros(2)
        if get_tag(element) == "svg":
            x = resolve_length(element.get("x", "0"), viewport.width, f"{place} x")
            y = resolve_length(element.get("y", "0"), viewport.height, f"{place} y")
            origin = np.array([x, y])
        box = _read_view_box(element)
        needs_size = box is not None or "width" in size.attrib
        if not needs_size:
            moved = Affine(np.eye(2), origin).then(context.to_drawing)
            return context._replace(to_drawing=moved)
        width_text = size.get("width", element.get("width", "100%"))
        height_text = size.get("height", element.get("height", "100%"))
        width = resolve_length(width_text, viewport.width, f"{place} width")
        if box is None:
            height = None
            if viewport.height is not None or "%" not in height_text:
                height = resolve_length(height_text, viewport.height, f"{place} height")
            moved = Affine(np.eye(2), origin).then(context.to_drawing)
            return context._replace(to_drawing=moved, viewport=Viewport(width, height))
        height = resolve_length(height_text, viewport.height, f"{place} height")
        fit = _fit_view_box(box, width, height, ratio=element.get("preserveAspectRatio", ""))
        placed = Affine(fit.frame, fit.shift + origin)
        return context._replace(
            to_drawing=placed.then(context.to_drawing), viewport=Viewport(box[2], box[3])
        )

    def _add_shape(self, element: Element, context: _Context, place: str) -> None:
        """Add the subpaths of a shape."""
        if abs(np.linalg.det(context.to_drawing.frame)) == 0.0:
            return
        is_selected = self.layer is None or self.layer in context.groups
        title = element.get(_LABEL, "")
        for child in element:
            if get_tag(child) == "title":
                title = " ".join("".join(child.itertext()).split())
        layer = self.layer if is_selected and self.layer else context.layer or NO_LAYER
        for subpath in read_shape(element, context.viewport, place):
            curves = []
            for curve in subpath.curves:
                curves += curve.transform(context.to_drawing.frame, context.to_drawing.shift)
            path = DrawnPath(
                curves,
                subpath.is_closed,
                label=place,
                layer=layer,
                title=title,
                identifier=element.get("id", ""),
            )
            self.content.add(path, is_selected)

    def _add_text(self, element: Element, context: _Context, place: str) -> None:
        """Add a text with its anchor and its estimated centre."""
        text = " ".join("".join(element.itertext()).split())
        anchor = []
        for name, reference in (("x", context.viewport.width), ("y", context.viewport.height)):
            found = element.get(name, "")
            for child in element.iter():
                found = found or child.get(name, "")
            first = (found or "0").replace(",", " ").split()[0]
            anchor.append(resolve_length(first, reference, f"{place} {name}"))
        size_text = self.styles.get_property(element, "font-size") or "0"
        try:
            size = resolve_length(size_text, None, place)
        except DrawingError:
            size = 0.0
        alignment = self.styles.get_property(element, "text-anchor")
        shares = {"middle": 0.0, "end": -0.5}
        across = shares.get(alignment, 0.5) * _CHARACTER_WIDTH * size * len(text)
        points = np.array([anchor, np.add(anchor, [across, -_CHARACTER_MIDDLE * size])])
        frame, shift = context.to_drawing
        self.content.texts.append(DrawnText(text, points @ frame.T + shift))


def _fit_view_box(
    box: tuple[float, float, float, float], width: float, height: float, ratio: str
) -> Affine:
    """Return the map from a viewBox to a viewport at the origin, by SVG's preserveAspectRatio."""
    low = np.array(box[:2])
    extent = np.array(box[2:])
    target = np.array([width, height])
    scales = target / extent
    if ratio.strip() != "none":
        scales = np.full(2, scales.max() if "slice" in ratio else scales.min())
    alignment = ratio.split()[0] if ratio.split() else "xMidYMid"
    shares = np.array([_read_share(alignment, "x"), _read_share(alignment, "Y")])
    gap = target - scales * extent
    return Affine(np.diag(scales), shares * gap - scales * low)


def _read_share(alignment: str, axis: str) -> float:
    """Return the share of the free space before the drawing: 0 for Min, 0.5 for Mid, 1 for Max."""
    for word, share in (("Min", 0.0), ("Max", 1.0)):
        if f"{axis}{word}" in alignment:
            return share
    return 0.5
