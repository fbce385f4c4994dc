"""The table ``[electrodes]`` of a scene whose electrodes are read from a drawing."""

from __future__ import annotations

from typing import Annotated, Literal

from pvdf_fem.scene.drawings.units import UNITS_MM
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.placed.placed_shape import ROTATION
from pvdf_fem.scene.shapes.shape import COORDINATE


class Drawing(Section):
    """Electrodes that are read from a DXF or SVG file; each closed outline is one.

    The scene then has a list of electrodes, and no longer needs the drawing. They are sorted
    counter-clockwise from +x about the film's centre, and one at the centre is the last. Texts
    within or next to the outlines name them.
    """

    drawing: Annotated[str, Key(example="pads.dxf")]
    """Path of the drawing, relative to the scene file; with pvdf-fem[drawings]."""
    layer: Annotated[str | None, Key(example="ELECTRODES")] = None
    """Layer of the outlines; in SVG the id, the class or the Inkscape label of shapes or of a group
    around them. By default all that is visible."""
    unit: Annotated[str | None, Key(words=UNITS_MM, example="mm")] = None
    """Unit of the coordinates (px: 1/96 in); required if the file states none."""
    origin_mm: Annotated[tuple[float, float], COORDINATE] = (0.0, 0.0)
    """The film's centre in the drawing, [x, y] as its coordinates are counted, in SVG downwards."""
    rotation_deg: Annotated[float, ROTATION] = 0.0
    """Rotation of the drawing about this point, counter-clockwise."""
    names: Literal["auto", "text", "title", "layer", "id", "letters"] = "auto"
    """Source of the names. auto: texts, else titles and labels of SVG, else layers if each outline
    has its own, else the letters A, B, C, ... in order."""
    tolerance_um: Annotated[float, Key("µm", (1e-3, 1000.0))] = 1.0
    """Distance up to which splines are approximated by arcs, and open lines are joined."""
