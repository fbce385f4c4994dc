"""A drawing of a scene at scale 1:1, independent of its file format: outlines, names, dimensions.

All lengths are in mm, with the origin at the film's centre and y upwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.polygon import Polygon
from pvdf_fem.scene.placed.electrode import Electrode
from pvdf_fem.scene.scene import Scene

#: Free margin around the film, as a fraction of its radius, for dimensions.
MARGIN = 0.3
#: Height of the text of dimensions as a fraction of the film's radius.
TEXT_HEIGHT = 0.04
#: Height of capitals as a fraction of the font size of SVG and PDF.
CAPITAL_HEIGHT = 0.72
#: Width of lines in mm.
LINE_WIDTH = 0.1
#: Approximate width of a character as a fraction of its height.
CHARACTER_WIDTH = 0.8


class Layer(Enum):
    """A layer of a drawing; its value is the layer's name in the file."""

    RIM = "RIM"  #: The clamped edge: a cut, or the frame's inner edge.
    ELECTRODES = "ELECTRODES"  #: Outlines to print or to cut, and nothing else.
    PATCHES = "PATCHES"
    PROBE = "PROBE"
    NAMES = "NAMES"
    DIMENSIONS = "DIMENSIONS"


class LayerStyle(NamedTuple):
    """The colour of a layer."""

    colour: str  #: As SVG and PDF write it.
    colour_index: int  #: The index of the colour in AutoCAD.


STYLES = {
    Layer.RIM: LayerStyle("#ff0000", 1),
    Layer.ELECTRODES: LayerStyle("#000000", 7),
    Layer.PATCHES: LayerStyle("#008000", 3),
    Layer.PROBE: LayerStyle("#ff00ff", 6),
    Layer.NAMES: LayerStyle("#0000ff", 5),
    Layer.DIMENSIONS: LayerStyle("#808080", 8),
}


class DrawnOutline(NamedTuple):
    """An outline with the name of its electrode, patch or probe."""

    layer: Layer
    name: str
    outline: Outline  #: In mm.


class Label(NamedTuple):
    """A text about a point."""

    layer: Layer
    text: str
    centre: Array  #: In mm, shape (2,).
    height: float  #: In mm.


class Dimension(NamedTuple):
    """The distance of two points, drawn on a line beside them."""

    start: Array  #: In mm, shape (2,).
    end: Array  #: In mm, shape (2,).
    offset: Array  #: From the points to the line, perpendicular to it, in mm, shape (2,).
    prefix: str  #: Such as ``⌀`` or ``R``.
    height: float  #: Height of the text in mm.

    @property
    def length(self) -> float:
        """Distance in mm."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def text(self) -> str:
        """The distance with its prefix, to 1 µm."""
        return f"{self.prefix}{round(self.length, 3):g}"


@dataclass
class Sheet:
    """A drawing before it is written to a file.

    Parameters
    ----------
    half_width : float
        Half of the width and height of the square sheet in mm.
    title : str
        A text below the film.
    outlines : list of DrawnOutline
        Outlines of the rim, electrodes, patches and probes.
    labels : list of Label
        Names of the electrodes, and the title.
    dimensions : list of Dimension
        Dimensions; empty if none are drawn.
    """

    half_width: float
    title: str
    outlines: list[DrawnOutline] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)
    dimensions: list[Dimension] = field(default_factory=list)

    @property
    def layers(self) -> list[Layer]:
        """The layers that are not empty, in their order."""
        used = {item.layer for item in self.outlines} | {item.layer for item in self.labels}
        if self.dimensions:
            used.add(Layer.DIMENSIONS)
        return [layer for layer in Layer if layer in used]


def make_sheet(scene: Scene, *, probe: bool = False, dimensions: bool = True) -> Sheet:
    """Make the drawing of a scene.

    Parameters
    ----------
    scene : Scene
        The scene with film, electrodes and patches.
    probe : bool
        Whether to draw the outlines of probes, too.
    dimensions : bool
        Whether to draw dimensions and a title.

    Returns
    -------
    Sheet
    """
    radius = 1e3 * scene.film.reach
    title = f"scale 1:1, mm, {describe_rim(scene.film)}"
    sheet = Sheet((1.0 + MARGIN) * radius, title)
    rim = _to_mm(scene.film.outline)
    sheet.outlines.append(DrawnOutline(Layer.RIM, "rim", rim))
    for electrode in scene.electrode_list:
        outline = _to_mm(electrode.outline)
        sheet.outlines.append(DrawnOutline(Layer.ELECTRODES, electrode.name, outline))
        sheet.labels.append(_make_name(electrode.name, outline, radius))
    for number, patch in enumerate(scene.film.patches or (), start=1):
        name = f"patch {number}"
        sheet.outlines.append(DrawnOutline(Layer.PATCHES, name, _to_mm(patch.outline)))
    if probe:
        for loaded in scene.loaded_probes:
            outline = _to_mm(loaded.outline)
            sheet.outlines.append(DrawnOutline(Layer.PROBE, loaded.patch, outline))
    if dimensions:
        sheet.dimensions += _make_dimensions(scene, radius)
        height = TEXT_HEIGHT * radius
        centre = np.array([0.0, -sheet.half_width + 1.5 * height])
        sheet.labels.append(Label(Layer.DIMENSIONS, title, centre, height=height))
    return sheet


def _to_mm(outline: Outline) -> Outline:
    """Return an outline in mm."""
    if isinstance(outline, Circle):
        return Circle(1e3 * outline.centre, 1e3 * outline.radius)
    if isinstance(outline, Ellipse):
        return Ellipse(1e3 * outline.centre, 1e3 * outline.first, second=1e3 * outline.second)
    if isinstance(outline, ArcPolygon):
        return ArcPolygon(1e3 * outline.vertices, outline.bulges)
    assert isinstance(outline, Polygon)
    return Polygon(1e3 * outline.vertices)


def _make_name(name: str, outline: Outline, radius: float) -> Label:
    """Make the name of an electrode, small enough to fit into its outline.

    Parameters
    ----------
    name : str
        The name.
    outline : Outline
        Outline of the electrode in mm.
    radius : float
        Radius of the film in mm, to which the largest and the smallest height are proportional.

    Returns
    -------
    Label
    """
    polygon = outline.inscribed_polygon
    centre = np.array(polygon.centroid.coords[0])
    if outline.compute_signed_distances(centre[None])[0] > 0.0:  # outside of a concave outline
        centre = np.array(polygon.representative_point().coords[0])
    room = -2.0 * float(outline.compute_signed_distances(centre[None])[0])
    height = min(TEXT_HEIGHT * radius, 0.6 * room, room / (CHARACTER_WIDTH * len(name)))
    return Label(Layer.NAMES, name, centre, height=max(height, 0.005 * radius))


def _make_dimensions(scene: Scene, radius: float) -> Iterator[Dimension]:
    """Yield the dimensions of the rim, the ring of electrodes, and one electrode of each shape."""
    height = TEXT_HEIGHT * radius
    yield from _make_rim_dimensions(scene.film, height)
    electrodes = scene.electrode_list
    seen = []
    for electrode in electrodes:
        if electrode.geometry not in seen:
            seen.append(electrode.geometry)
            yield from _make_electrode_dimensions(electrode, height)
    places = np.array([[one.x_mm, one.y_mm] for one in electrodes])
    distances = np.linalg.norm(places, axis=1)
    on_ring = distances > 1e-6 * radius
    if on_ring.sum() > 1 and np.ptp(distances[on_ring]) < 1e-6 * radius:
        first = int(np.flatnonzero(on_ring)[0])
        x, y = places[first] / distances[first]
        sideways = np.array([y, -x])
        extent_mm = 1e3 * _compute_extent(electrodes[first].outline, sideways)
        offset = (extent_mm + 1.5 * height) * sideways
        yield Dimension(np.zeros(2), places[first], offset, prefix="R", height=height)


def describe_rim(film: Film) -> str:
    """Describe the rim by its sizes in mm.

    Parameters
    ----------
    film : Film
        The film.

    Returns
    -------
    str
        Such as ``rim 90`` for a disc, otherwise ``rim 60 × 40``.
    """
    left, low, right, high = film.bounds_mm
    width = f"{round(right - left, 3):g}"
    return f"rim {width}" if film.is_disc else f"rim {width} × {round(high - low, 3):g}"


def _make_rim_dimensions(film: Film, height: float) -> Iterator[Dimension]:
    """Yield the diameter of a disc below it, or the width and the height of another film."""
    left, low, right, high = film.bounds_mm
    gap = 0.5 * MARGIN * 1e3 * film.reach
    rim = np.array(_to_mm(film.outline).inscribed_polygon.exterior.coords)
    level_y = _find_level(rim[:, 0], rim[:, 1])
    below = np.array([0.0, low - level_y - gap])
    ends = np.array([[left, level_y], [right, level_y]])
    prefix = "⌀" if film.is_disc else ""
    yield Dimension(ends[0], ends[1], below, prefix=prefix, height=height)
    if not film.is_disc:
        level_x = _find_level(rim[:, 1], rim[:, 0])
        beside = np.array([left - level_x - gap, 0.0])
        ends = np.array([[level_x, low], [level_x, high]])
        yield Dimension(ends[0], ends[1], beside, prefix="", height=height)


def _find_level(along: Array, across: Array) -> float:
    """Find where a dimension of the rim begins, so that its lines do not cover straight sides.

    Parameters
    ----------
    along, across : ndarray of shape (n,)
        Coordinates of the rim along the dimension and across it, in mm.

    Returns
    -------
    float
        The lowest coordinate across it at which the rim has either end of the dimension.
    """
    tolerance = 1e-9 * float(np.ptp(along))
    is_first = along <= along.min() + tolerance
    is_last = along >= along.max() - tolerance
    return float(min(across[is_first].min(), across[is_last].min()))


def _compute_extent(outline: Outline, direction: Array) -> float:
    """Compute how far an outline reaches along a direction from its centroid, in m."""
    points = np.array(outline.inscribed_polygon.exterior.coords)
    return float(((points - outline.centroid) @ direction).max())


def _make_electrode_dimensions(electrode: Electrode, height: float) -> Iterator[Dimension]:
    """Yield width and height of an electrode in its own axes, or the diameter of a circle."""
    outline = _to_mm(electrode.outline)
    angle = np.radians(electrode.rotation_deg)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    if isinstance(outline, Circle):
        along, across = np.eye(2)
    axes = np.stack([along, across])
    points = np.array(outline.inscribed_polygon.exterior.coords) @ axes.T
    if isinstance(outline, Ellipse):  # the corners of the inscribed polygon include the vertices
        reach = np.linalg.norm(axes @ outline.axes, axis=1)
        points = axes @ outline.centre + np.stack([-reach, reach])
    low = points.min(axis=0)
    high = points.max(axis=0)
    text_height = min(height, 0.5 * float((high - low).min()))
    gap = 1.5 * text_height
    prefix = "⌀" if isinstance(outline, Circle) else ""
    top = np.array([[low[0], high[1]], [high[0], high[1]]]) @ axes
    yield Dimension(top[0], top[1], gap * across, prefix=prefix, height=text_height)
    if not isinstance(outline, Circle):
        side = np.array([[high[0], low[1]], [high[0], high[1]]]) @ axes
        yield Dimension(side[0], side[1], gap * along, prefix="", height=text_height)
