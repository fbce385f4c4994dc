"""Read the curves and texts of a DXF file with ezdxf."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import read_bytes
from pvdf_fem.scene.drawings.content import (
    MAX_BYTES,
    MAX_DEPTH,
    DrawingContent,
    DrawingError,
    DrawnPath,
    DrawnText,
    Unit,
)
from pvdf_fem.scene.drawings.curves import Curve, Side, Spline, make_elliptic_curves
from pvdf_fem.scene.drawings.units import HEADER_UNITS

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

#: Maximum number of copies of a block in an array.
MAX_COPIES = 10_000
#: Flag of those vertices of a spline-fitted polyline that are only its control points.
_FRAME_VERTEX = 16
#: Estimated mean width of a character as a fraction of the text's height.
_CHARACTER_WIDTH = 0.7


def read_dxf(path: Path, layer: str | None) -> DrawingContent:
    """Read the visible curves and texts in the model space of a DXF file.

    Layers that are off or frozen and invisible entities are left out.

    Parameters
    ----------
    path : Path
        Path of an ASCII or binary DXF file, R12 or newer.
    layer : str or None
        Layer of the curves to read, in any case; None for those of all layers.

    Returns
    -------
    DrawingContent

    Raises
    ------
    DrawingError
        If the file is no valid DXF file, or a curve on the layer cannot be an outline.
    FileError
        If the file cannot be read.
    ModuleNotFoundError
        If ezdxf is not installed.
    """
    from ezdxf.filemanagement import readfile

    raw = read_bytes(path, MAX_BYTES, "a drawing")
    try:
        document = readfile(path)
    except Exception as error:  # ezdxf raises StopIteration, KeyError and others for cut files
        reason = f"is not a whole DXF file ({type(error).__name__}: {str(error)[:100]})"
        raise DrawingError(f"{reason}; save it again as DXF R2010 or R12") from None
    unit, advice = _read_unit(raw, document)
    content = DrawingContent(path, unit, unit_advice=advice)
    reader = _Reader(document, content, layer=layer)
    for entity in document.modelspace():
        reader.add(entity, block="", block_layer=None, depth=0)
    return content


def _read_unit(raw: bytes, document: Document) -> tuple[Unit | None, str]:
    """Return the unit that a file's header states, and otherwise the reason why there is none.

    ezdxf gives metres to a file without a header, so that the file itself is searched.
    """
    header = raw[: max(raw.find(b"ENDSEC"), 0)]
    if not re.search(rb"\$INSUNITS\s*[\r\n\0]", header):
        return None, "its header has no $INSUNITS"
    code = int(document.header.get("$INSUNITS", 0))
    if code == 0:
        return None, "its header says $INSUNITS = 0 (no unit)"
    unit = HEADER_UNITS.get(code)
    if unit is None or unit.size_mm is None:
        name = f" ({unit.name})" if unit else ""
        reason = f"its header says $INSUNITS = {code}{name}, a unit that no electrode is drawn in"
        raise DrawingError(f"{reason}; set the unit in the drawing")
    return Unit(unit.size_mm, f"$INSUNITS = {code} ({unit.name})"), ""


@dataclass(frozen=True)
class _Reader:
    """Adds the entities of a DXF file to the content of a drawing.

    Parameters
    ----------
    document : Document
        The file, read by ezdxf.
    content : DrawingContent
        Receives curves and texts.
    layer : str or None
        Layer of the curves to read; None for all layers.
    """

    document: Document
    content: DrawingContent
    layer: str | None

    def add(self, entity: Any, block: str, block_layer: str | None, depth: int) -> None:
        """Add an entity with all that it contains, if it is visible.

        Parameters
        ----------
        entity : DXFEntity
            An entity of the model space or of a block, in world coordinates.
        block : str
            Name of the block from which the entity is; empty for the model space.
        block_layer : str or None
            Layer of the block's insert, which replaces the layer 0 within the block.
        depth : int
            Number of blocks around the entity.
        """
        self.content.count_entity()
        kind = entity.dxftype()
        layer = entity.dxf.get("layer", "0")
        if block_layer is not None and layer == "0":
            layer = block_layer
        if entity.dxf.get("invisible", 0):
            return
        if kind == "INSERT":
            if not self._is_frozen(layer):
                self._add_insert(entity, layer, depth=depth)
            return
        if self._is_hidden(layer):
            self.content.hidden_layers[layer] += 1
            return
        if kind in ("TEXT", "MTEXT", "ATTRIB"):
            self.content.texts.append(_read_text(entity))
            return
        label = f"{kind} in block {block}" if block else f"{kind} {entity.dxf.get('handle', '')}"
        is_selected = self.layer is None or layer.casefold() == self.layer.casefold()
        read = _READERS.get(kind)
        if read is None:
            self.content.ignored[kind] += is_selected
            return
        if is_selected:
            _require_plane(entity, label, layer)
        curves, is_closed = read(entity, f"{label} on layer {layer}")
        self.content.add(
            DrawnPath(curves, is_closed, label=label.strip(), layer=layer), is_selected
        )

    def _add_insert(self, insert: Any, layer: str, depth: int) -> None:
        """Add all copies of a block, and the texts of its attributes."""
        name = insert.dxf.get("name", "")
        if depth > MAX_DEPTH:
            reason = f"has blocks in blocks, deeper than {MAX_DEPTH} at block {name}"
            raise DrawingError(f"{reason}; explode them")
        if insert.mcount > MAX_COPIES:
            reason = f"has an array of {insert.mcount} copies of block {name}"
            raise DrawingError(f"{reason}; draw each electrode once, on a layer of its own")
        for attribute in insert.attribs:
            if not (attribute.dxf.get("invisible", 0) or attribute.is_invisible):
                self.add(attribute, block=name, block_layer=layer, depth=depth)
        copies = insert.multi_insert() if insert.mcount > 1 else [insert]
        for copy in copies:
            for entity in copy.virtual_entities():
                self.add(entity, block=name, block_layer=layer, depth=depth + 1)

    def _is_frozen(self, layer: str) -> bool:
        """Return whether a layer is frozen."""
        layers = self.document.layers
        return layer in layers and layers.get(layer).is_frozen()

    def _is_hidden(self, layer: str) -> bool:
        """Return whether a layer is off or frozen."""
        layers = self.document.layers
        return layer in layers and (layers.get(layer).is_off() or layers.get(layer).is_frozen())


def _require_plane(entity: Any, label: str, layer: str) -> None:
    """Refuse an entity that does not lie parallel to the xy plane."""
    if entity.dxftype() in ("LINE", "SPLINE"):  # in world coordinates, whatever the extrusion
        return
    normal = entity.dxf.get("extrusion", (0.0, 0.0, 1.0))
    x, y, _ = tuple(normal)
    if max(abs(x), abs(y)) > 1e-9:
        reason = f"{label} on layer {layer} is not parallel to the xy plane"
        raise DrawingError(f"{reason}; flatten the drawing")


def _to_plane(point: Any) -> Array:
    """Return x and y of a point of ezdxf, shape (2,)."""
    return np.array([point.x, point.y])


def _read_line(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read a straight line."""
    first = _to_plane(entity.dxf.start)
    last = _to_plane(entity.dxf.end)
    return ([Side(first, last)] if (first != last).any() else []), False


def _read_circle(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read a circle or an arc; the centre is in the entity's own axes, which may be mirrored."""
    ocs = entity.ocs()
    centre = _to_plane(ocs.to_wcs(entity.dxf.center))
    radius = float(entity.dxf.radius)
    if radius <= 0.0:
        return [], False
    # the entity's own x axis, mirrored together with the direction of rotation
    along = _to_plane(ocs.to_wcs((1.0, 0.0, 0.0)))
    across = _to_plane(ocs.to_wcs((0.0, 1.0, 0.0)))
    axes = radius * np.stack([along, across], axis=-1)
    if entity.dxftype() == "CIRCLE":
        return make_elliptic_curves(centre, axes, first_angle=0.0, sweep=2.0 * np.pi), True
    first = np.radians(entity.dxf.start_angle)
    sweep = float(np.mod(np.radians(entity.dxf.end_angle) - first, 2.0 * np.pi)) or 2.0 * np.pi
    is_whole = abs(sweep - 2.0 * np.pi) < 1e-9
    return make_elliptic_curves(centre, axes, first_angle=float(first), sweep=sweep), is_whole


def _read_ellipse(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read an ellipse or an arc of one, whose centre and axis are in world coordinates."""
    major = _to_plane(entity.dxf.major_axis)
    minor = _to_plane(entity.minor_axis)
    first = float(entity.dxf.start_param)
    sweep = float(np.mod(entity.dxf.end_param - first, 2.0 * np.pi))
    is_whole = min(sweep, 2.0 * np.pi - sweep) < 1e-9
    if is_whole:
        sweep = 2.0 * np.pi
    axes = np.stack([major, minor], axis=-1)
    centre = _to_plane(entity.dxf.center)
    return make_elliptic_curves(centre, axes, first_angle=first, sweep=sweep), is_whole


def _read_light_polyline(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read a polyline with bulges."""
    widths = [entity.dxf.get("const_width", 0.0)]
    for start_and_end in entity.get_points("se"):
        widths += start_and_end
    _require_no_width(widths, label)
    ocs = entity.ocs()
    vertices = []
    bulges = []
    for x, y, bulge in entity.get_points("xyb"):
        vertices.append(_to_plane(ocs.to_wcs((x, y, 0.0))))
        bulges.append(bulge)
    mirrored = ocs.transform and ocs.uz.z < 0.0
    return _make_sides(vertices, bulges, is_closed=bool(entity.closed), is_mirrored=mirrored)


def _read_polyline(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read a polyline of single vertices, without the control points of a fitted spline."""
    if not (entity.is_2d_polyline or entity.is_3d_polyline):
        return [], False
    vertices = []
    bulges = []
    widths = [entity.dxf.get(f"default_{end}_width", 0.0) for end in ("start", "end")]
    ocs = entity.ocs()
    for vertex in entity.vertices:
        if vertex.dxf.get("flags", 0) & _FRAME_VERTEX:
            continue
        location = vertex.dxf.location
        vertices.append(_to_plane(ocs.to_wcs(location) if entity.is_2d_polyline else location))
        bulges.append(float(vertex.dxf.get("bulge", 0.0)))
        widths += [vertex.dxf.get(f"{end}_width", 0.0) for end in ("start", "end")]
    _require_no_width(widths, label)
    mirrored = entity.is_2d_polyline and ocs.transform and ocs.uz.z < 0.0
    return _make_sides(vertices, bulges, is_closed=bool(entity.is_closed), is_mirrored=mirrored)


def _require_no_width(widths: list[float], label: str) -> None:
    """Refuse a polyline with a width, whose visible outline is not the polyline."""
    if max(widths) > 0.0:
        reason = f"{label} has a width of {max(widths):g}, so that its outline is not the line"
        raise DrawingError(f"{reason}; draw the outline with a width of 0")


def _make_sides(
    vertices: list[Array], bulges: list[float], is_closed: bool, is_mirrored: bool
) -> tuple[list[Curve], bool]:
    """Make the sides of a polyline, without those of zero length."""
    if len(vertices) < 2:
        return [], False
    handedness = -1.0 if is_mirrored else 1.0
    ends = [*vertices[1:], vertices[0]]
    sides: list[Curve] = []
    for number in range(len(vertices) if is_closed else len(vertices) - 1):
        if (vertices[number] != ends[number]).any():
            bulge = handedness * bulges[number]
            sides.append(Side(vertices[number], ends[number], bulge if abs(bulge) > 1e-9 else 0.0))
    return sides, is_closed


def _read_spline(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read a B-spline; one that has only fit points is interpolated by ezdxf."""
    spline = entity.construction_tool()
    points = np.array([[point.x, point.y] for point in spline.control_points])
    weights = np.array(spline.weights() or np.ones(len(points)), dtype=float)
    knots = np.array(spline.knots(), dtype=float)
    curve = Spline(spline.degree, knots, points=points, weights=weights)
    extent = float(np.ptp(points, axis=0).max())
    is_closed = float(np.abs(curve.start - curve.end).max()) <= 1e-9 * extent
    return [curve], is_closed


def _read_solid(entity: Any, label: str) -> tuple[list[Curve], bool]:
    """Read a filled triangle or quadrilateral."""
    vertices = [_to_plane(point) for point in entity.wcs_vertices(close=False)]
    return _make_sides(vertices, [0.0] * len(vertices), is_closed=True, is_mirrored=False)


def _read_text(entity: Any) -> DrawnText:
    """Read a text with its anchor and its estimated centre."""
    if entity.dxftype() == "MTEXT":
        lines = entity.plain_text(split=True)
        height = float(entity.dxf.char_height)
        place = _locate_paragraph(entity)
    else:
        lines = [entity.plain_text()]
        height = float(entity.dxf.height)
        place = _locate_line(entity)
    text = " ".join(" ".join(lines).split())
    width = _CHARACTER_WIDTH * height * max(map(len, lines), default=0)
    across = place.offset * np.array([width, height])
    cosine = np.cos(place.angle)
    sine = np.sin(place.angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    return DrawnText(text, np.stack([place.anchor, place.anchor + turn @ across]))


class _TextPlace(NamedTuple):
    """Where a text is."""

    anchor: Array  #: The point at which the text is aligned, shape (2,).
    offset: Array  #: From there to the centre, as fractions of width and height, shape (2,).
    angle: float  #: Rotation in radians.


def _locate_paragraph(entity: Any) -> _TextPlace:
    """Locate an MTEXT, which is attached at one of nine points."""
    row, column = divmod(int(entity.dxf.attachment_point) - 1, 3)
    offset = np.array([0.5 - 0.5 * column, -0.5 + 0.5 * row])
    angle = float(np.radians(entity.get_rotation()))
    return _TextPlace(_to_plane(entity.dxf.insert), offset, angle)


def _locate_line(entity: Any) -> _TextPlace:
    """Locate a TEXT or ATTRIB by the name of its alignment."""
    alignment, first, second = entity.get_placement()
    ocs = entity.ocs()
    anchor = _to_plane(ocs.to_wcs(first))
    name = alignment.name
    offset = np.array([0.5, 0.5])
    if second is not None:  # between two points
        anchor = 0.5 * (anchor + _to_plane(ocs.to_wcs(second)))
        offset[0] = 0.0
    if "CENTER" in name or "MIDDLE" in name:
        offset[0] = 0.0
    if name.startswith("MIDDLE"):
        offset[1] = 0.0
    if "RIGHT" in name:
        offset[0] = -0.5
    if name.startswith("TOP"):
        offset[1] = -0.5
    return _TextPlace(anchor, offset, float(np.radians(entity.dxf.get("rotation", 0.0))))


#: Functions that read an entity's curves, and whether these are closed, by the entity's type.
_READERS = {
    "LINE": _read_line,
    "CIRCLE": _read_circle,
    "ARC": _read_circle,
    "ELLIPSE": _read_ellipse,
    "LWPOLYLINE": _read_light_polyline,
    "POLYLINE": _read_polyline,
    "SPLINE": _read_spline,
    "SOLID": _read_solid,
    "TRACE": _read_solid,
}
