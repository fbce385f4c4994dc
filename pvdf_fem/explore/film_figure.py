"""The film as a Bokeh figure, on which probes are dragged and turned."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bokeh import palettes
from bokeh.models import ColorBar, ColumnDataSource, CustomJS, LinearColorMapper, SaveTool
from bokeh.plotting import figure
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.explore.finding import Found
from pvdf_fem.explore.picture import QUANTITIES
from pvdf_fem.explore.state import View
from pvdf_fem.output.figures import COLOURS
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Electrode, Scene

NONE = Found([], {}, ())
_PATH = {"xs": "xs", "ys": "ys"}
_TEXT = {"text": "name", "text_align": "center", "text_baseline": "middle"}
_PROBE = {"line_color": COLOURS[1], "line_width": 2}
_FOUND = {"line_color": COLOURS[2], "line_width": 2}
_KNOB = {"x": "knob_x", "y": "knob_y", "size": 11, "fill_color": "white"}
#: What is drawn, from below: the columns, the kind of glyph and its look.
_LAYERS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("rim", "multi_polygons", {**_PATH, "fill_color": "white", "line_color": "black"}),
    ("electrodes", "patches", {**_PATH, "fill_color": "#ffffff80", "line_color": "black"}),
    ("electrodes", "text", {**_TEXT, "text_font_size": "12px"}),
    ("lines", "multi_line", {**_PATH, "line_color": "colour", "line_width": 1.5}),
    ("ellipses", "patches", {**_PATH, **_FOUND, "fill_color": COLOURS[2], "fill_alpha": "weight"}),
    ("ellipses", "scatter", {**_FOUND, "marker": "x", "size": 9}),
    ("probes", "patches", {**_PATH, **_PROBE, "fill_color": COLOURS[1], "fill_alpha": 0.1}),
    ("probes", "scatter", {**_KNOB, **_PROBE}),
)


class Scale(NamedTuple):
    """Colours of a field."""

    low: float
    high: float
    palette: tuple[str, ...]  #: From the lowest value to the highest.

    @classmethod
    def of(cls, image: Array, dark_to_light: tuple[str, ...]) -> Scale:
        """A scale that is palest at zero."""
        low, high = min(0.0, float(np.nanmin(image))), max(0.0, float(np.nanmax(image)))
        return cls(low, max(high, low + 1e-9), dark_to_light[:: 1 if -low > high else -1])

    def colours(self, image: Array) -> NDArray[np.uint32]:
        """Those of an image's pixels, for Bokeh; transparent where it is NaN."""
        shades = palettes.to_rgba_array(self.palette).view(np.uint32)[:, 0]
        outside = np.isnan(image)
        share = (np.where(outside, self.low, image) - self.low) / (self.high - self.low)
        steps = np.minimum(len(shades) * share, len(shades) - 1).astype(int)
        return np.where(outside, np.uint32(0), shades[steps])


class FilmFigure:
    """The figure of the film, and its data sources."""

    def __init__(self) -> None:
        self.drawn: tuple[float, tuple[Electrode, ...]] = 0.0, ()
        self.found: Found | None = None
        names = dict.fromkeys(["image", "dropped", "held", *(name for name, *_ in _LAYERS)])
        self.sources = {name: ColumnDataSource(name=name) for name in names}
        size = {"sizing_mode": "scale_width", "aspect_ratio": 1.15}
        self.model = plot = figure(**size, match_aspect=True, tools="wheel_zoom,reset", name="film")
        plot.xaxis.axis_label, plot.yaxis.axis_label = "x (mm)", "y (mm)"
        plot.grid.visible = False
        self.save = SaveTool(filename="pvdf_film")
        plot.add_tools(self.save)
        self.colours = LinearColorMapper()
        self.bar = ColorBar(color_mapper=self.colours)
        plot.add_layout(self.bar, "right")
        self.show_image(np.zeros((1, 1)), 1.0, first := next(iter(QUANTITIES)))
        self.show_scale(first)
        square = {"x": "x", "y": "x", "dw": "width", "dh": "width", "source": self.sources["image"]}
        field = plot.image_rgba("image", **square)
        self.field, plot.x_range.renderers, plot.y_range.renderers = field.glyph, [field], [field]
        for name, glyph, look in _LAYERS:
            getattr(plot, glyph)(source=self.sources[name], **look)
        drag = CustomJS(args=self.sources, code=Path(__file__).with_name("drag.js").read_text())
        for event in ("panstart", "pan", "panend"):
            plot.js_on_event(event, drag)

    def show_scene(self, view: View) -> None:
        """Draw film, electrodes and probes."""
        scene, radius = view.scene, view.scene.film.radius_mm
        if (outlines := (radius, scene.electrode_list)) != self.drawn:
            self.drawn = outlines
            self._draw_sensor(scene)
        self.sources["probes"].data = _probes(view)
        self.show_found(NONE)

    def _draw_sensor(self, scene: Scene) -> None:
        """Draw the film's rim and the electrodes."""
        radius = scene.film.radius_mm
        turns = np.linspace(0.0, 2.0 * np.pi, 361)
        circle = radius * np.column_stack([np.cos(turns), np.sin(turns)])
        square = 1.5 * radius * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        paths = _columns([square, circle])
        self.sources["rim"].data = {name: [[paths[name]]] for name in paths}
        names = [electrode.name for electrode in scene.electrode_list]
        outlines = _outlines([electrode.outline for electrode in scene.electrode_list])
        self.sources["electrodes"].data = {**outlines, "name": names}

    def show_image(self, image: Array, radius_mm: float, quantity: str) -> None:
        """Colour the film by the field of a solve, palest where it is zero."""
        self.scale = Scale.of(image, getattr(palettes, QUANTITIES[quantity].palette))
        square = {"image": [self.scale.colours(image)], "x": [-radius_mm], "width": [2 * radius_mm]}
        self.sources["image"].data = square

    def show_scale(self, quantity: str) -> None:
        """Draw the colour bar of the image, which takes a browser longer than the image."""
        self.colours.update(**self.scale._asdict())
        self.bar.title = QUANTITIES[quantity].label

    def show_found(self, found: Found) -> None:
        """Draw likely touches with their ellipses, and isocharge lines."""
        if found is self.found:
            return
        self.found = found
        ellipses, weights = [e for e, _ in found.ellipses], [0.6 * w for _, w in found.ellipses]
        centres = _points([ellipse[:-1].mean(axis=0) for ellipse in ellipses])
        self.sources["ellipses"].data = {**_columns(ellipses), **centres, "weight": weights}
        colours = [colour_of(i) for i, lines in enumerate(found.lines.values()) for _ in lines]
        lines = [line for lines in found.lines.values() for line in lines]
        self.sources["lines"].data = {**_columns(lines), "colour": colours}


def colour_of(electrode: int) -> str:
    """The colour of an electrode's bar and isocharge lines, by its number."""
    return COLOURS[electrode % len(COLOURS)]


def _columns(paths_mm: list[Array]) -> dict[str, list[Any]]:
    """Columns of lines or polygons of points (n, 2)."""
    return {name: [path[:, i].tolist() for path in paths_mm] for i, name in enumerate(_PATH)}


def _points(points_mm: list[Array]) -> dict[str, Any]:
    """Columns of points (2,)."""
    return dict(zip("xy", np.array(points_mm).reshape(-1, 2).T, strict=True))


def _outlines(outlines: list[Outline]) -> dict[str, Any]:
    """Columns of outlines and their centroids."""
    paths = [1e3 * np.array(outline.shape.exterior.coords) for outline in outlines]
    return {**_columns(paths), **_points([1e3 * outline.centroid for outline in outlines])}


def _probes(view: View) -> dict[str, Any]:
    """Columns of probes, with the knobs that turn them just beyond their reach."""
    touches = view.scene.loaded_probes
    columns = _outlines([touch.outline for touch in touches])
    columns["rotation_deg"] = [touch.probe.rotation_deg for touch in touches]
    columns["reach"] = np.array([1e3 * touch.outline.perimeter / 4.0 for touch in touches])
    turns = np.radians(columns["rotation_deg"]) + 0.5 * np.pi
    columns["knob_x"] = columns["x"] + columns["reach"] * np.cos(turns)
    columns["knob_y"] = columns["y"] + columns["reach"] * np.sin(turns)
    return {**columns, "key": [touch.key for touch in touches]}
