"""Write a drawing as DXF with ezdxf, in mm."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.files import replace_file
from pvdf_fem.scene.drawings.arc_fit import fit_arcs
from pvdf_fem.scene.drawings.curves import EllipticArc
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.polygon import Polygon
from pvdf_fem.view.drawings.sheet import STYLES, Dimension, Label, Layer, Sheet
from pvdf_fem.view.drawings.strokes import ARROW_LENGTH, EXTENSION, GAP

if TYPE_CHECKING:
    from ezdxf.layouts.layout import Modelspace

#: Versions that can be written; machines and programs of before 2000 read only R12.
VERSIONS = ("R2010", "R12")
#: Distance in mm of the arcs that replace an ellipse in R12, which has no ellipses.
R12_TOLERANCE = 1e-4
#: AutoCAD's code for the diameter sign.
_DIAMETER = "%%c"
#: Gap between the text of a dimension and its line as a fraction of the text's height.
_TEXT_GAP = 0.25


def write_dxf(sheet: Sheet, path: Path, version: str = "R2010") -> None:
    """Write a drawing as DXF.

    Parameters
    ----------
    sheet : Sheet
        The drawing.
    path : Path
        File to write.
    version : str
        One of `VERSIONS`.

    Raises
    ------
    ModuleNotFoundError
        If ezdxf is not installed.
    """
    from ezdxf.enums import TextEntityAlignment
    from ezdxf.filemanagement import new

    # R12 states no unit, about which ezdxf warns even if none is given
    log = logging.getLogger("ezdxf")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        document = new(version, units=0 if version == "R12" else 4)  # 4: mm
    finally:
        log.setLevel(level)
    if version != "R12":
        document.header["$MEASUREMENT"] = 1
    for layer in sheet.layers:
        document.layers.add(layer.value, color=STYLES[layer].colour_index)
    space = document.modelspace()
    for item in sheet.outlines:
        _add_outline(space, item.outline, item.layer, version=version)
    for label in sheet.labels:
        _add_label(space, label, TextEntityAlignment.MIDDLE_CENTER)
    for dimension in sheet.dimensions:
        _add_dimension(space, dimension)
    half = sheet.half_width
    document.header["$EXTMIN"] = (-half, -half, 0.0)
    document.header["$EXTMAX"] = (half, half, 0.0)
    if version != "R12":
        document.set_modelspace_vport(height=2.0 * half, center=(0.0, 0.0))
    with replace_file(path) as temporary:
        document.saveas(temporary)


def _add_outline(space: Modelspace, outline: Outline, layer: Layer, version: str) -> None:
    """Add an outline as a circle, an ellipse or a closed polyline with bulges.

    Parameters
    ----------
    space : Modelspace
        The model space of the file.
    outline : Outline
        The outline in mm.
    layer : Layer
        Its layer.
    version : str
        Version of DXF; R12 has polylines of arcs in place of ellipses.
    """
    attributes = {"layer": layer.value}
    if isinstance(outline, Circle):
        space.add_circle(outline.centre.tolist(), outline.radius, dxfattribs=attributes)
        return
    if isinstance(outline, Ellipse) and version != "R12":
        first, second = np.linalg.norm(outline.axes, axis=0)
        major = int(second > first)  # DXF has the longer axis first
        axis = outline.axes[:, major]
        ratio = min(first, second) / max(first, second)
        space.add_ellipse(
            (*outline.centre, 0.0), (*axis, 0.0), ratio=float(ratio), dxfattribs=attributes
        )
        return
    rows = _list_vertices(outline)
    if version == "R12":
        space.add_polyline2d(rows, format="xyb", close=True, dxfattribs=attributes)
    else:
        space.add_lwpolyline(rows, format="xyb", close=True, dxfattribs=attributes)


def _list_vertices(outline: Outline) -> list[tuple[float, float, float]]:
    """Return x, y and bulge of the vertices of an outline; of an ellipse, of arcs along it."""
    if isinstance(outline, ArcPolygon):
        vertices = outline.vertices
        bulges = outline.bulges
    elif isinstance(outline, Ellipse):
        whole = EllipticArc(outline.centre, outline.axes, first_angle=0.0, sweep=2.0 * np.pi)
        sides = fit_arcs(whole, R12_TOLERANCE)
        vertices = np.array([side.first for side in sides])
        bulges = np.array([side.bulge for side in sides])
    else:
        assert isinstance(outline, Polygon)
        vertices = outline.vertices
        bulges = np.zeros(len(vertices))
    rows = np.column_stack([vertices, bulges])
    return [(x, y, bulge) for x, y, bulge in rows.tolist()]


def _add_label(space: Modelspace, label: Label, alignment: Any) -> None:
    """Add a text about a point.

    Parameters
    ----------
    space : Modelspace
        The model space of the file.
    label : Label
        The text.
    alignment : TextEntityAlignment
        The alignment of ezdxf that puts the middle of a text on a point.
    """
    text = space.add_text(label.text, height=label.height, dxfattribs={"layer": label.layer.value})
    text.set_placement(label.centre.tolist(), align=alignment)


def _add_dimension(space: Modelspace, dimension: Dimension) -> None:
    """Add an aligned dimension, which programs show with the length that they measure."""
    height = dimension.height
    start = dimension.start
    end = dimension.end
    along = end - start
    # ezdxf measures the distance of the line to the left of the direction
    left = np.array([-along[1], along[0]]) / dimension.length
    style: dict[str, float] = {
        "dimtxt": height,
        "dimasz": ARROW_LENGTH * height,
        "dimexe": EXTENSION * height,
        "dimexo": GAP * height,
        "dimgap": _TEXT_GAP * height,
        "dimdec": 3,  # decimals
        "dimzin": 8,  # without zeros at the end
        "dimtad": 1,  # text above the line
        "dimdsep": ord("."),
    }
    colour = STYLES[Layer.DIMENSIONS].colour_index
    style |= dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), colour)
    prefix = dimension.prefix.replace("⌀", _DIAMETER)
    created = space.add_aligned_dim(
        p1=start.tolist(),
        p2=end.tolist(),
        distance=float(dimension.offset @ left),
        text=f"{prefix}<>",
        override={**style, "dimscale": 1.0, "dimlfac": 1.0},
        dxfattribs={"layer": Layer.DIMENSIONS.value},
    )
    created.render()
