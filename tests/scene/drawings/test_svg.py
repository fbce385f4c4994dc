"""Electrodes from SVG files, by the rules of SVG 1.1 and 2."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.scene.scene import SceneError

SPACES = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    ' xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)
#: One user unit is 1 mm, and the origin is in the middle.
SIZE = 'width="100mm" height="100mm" viewBox="-50 -50 100 100"'


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def read(body: str, size: str = SIZE, **keys):
    """Write an SVG file, and return its electrodes by name."""
    Path("pads.svg").write_text(f"<svg {SPACES} {size}>{body}</svg>", "utf-8")
    scene = Scene(electrodes={"drawing": "pads.svg", **keys})
    assert Scene.parse(scene.to_toml()) == scene
    return {electrode.name: electrode for electrode in scene.electrode_list}


def refuse(body: str, size: str = SIZE, **keys) -> str:
    """Write an SVG file, and return the only error of its scene."""
    with pytest.raises(SceneError) as error:
        read(body, size, **keys)
    [problem] = error.value.problems
    return problem


def read_one(body: str, size: str = SIZE, **keys):
    """Return the only electrode of a drawing."""
    [electrode] = read(body, size, **keys).values()
    return electrode


def place(electrode) -> tuple[float, float]:
    return electrode.x_mm, electrode.y_mm


#: Shapes with their kind, their centroid in mm (y upwards) and their area in mm².
SHAPES = {
    "rect": ('<rect x="5" y="-4" width="4" height="2"/>', "rectangle", (7, 3), 8.0),
    "circle": ('<circle cx="3" cy="-10" r="2"/>', "circle", (3, 10), 4 * math.pi),
    "ellipse": ('<ellipse cx="-10" cy="1" rx="3" ry="1"/>', "ellipse", (-10, -1), 3 * math.pi),
    "polygon": ('<polygon points="-3,9 3,9 0,12"/>', "polygon", (0, -10), 9.0),
    "rounded": (
        '<rect x="4" y="-2" width="6" height="4" rx="1"/>',
        *("polyline", (7, 0), 24 - 4 + math.pi),
    ),
    "one radius too large": (
        '<rect x="-2" y="8" width="4" height="4" rx="99"/>',
        *("circle", (0, -10), 4 * math.pi),
    ),
    "arcs": (
        '<path d="M 8 0 a2 2 0 1 0 4 0 a 2 2 0 10-4 0 Z"/>',
        *("circle", (10, 0), 4 * math.pi),
    ),
    "slot": (
        '<path d="M -3 5 h 6 a 2 2 0 0 1 0 4 H -3 a 2 2 0 0 1 0 -4"/>',
        *("polyline", (0, -7), 24 + 4 * math.pi),
    ),
    "lines that meet": (
        '<line x1="0" y1="0" x2="4" y2="0"/><polyline points="4 0 4 -3 0 -3 0 0"/>',
        *("rectangle", (2, 1.5), 12.0),
    ),
    "two circles' worth of ellipse": (
        '<path d="M -3 0 A 3 1 0 0 1 3 0 A 3 1 0 0 1 -3 0 z"/>',
        *("ellipse", (0, 0), 3 * math.pi),
    ),
    "scaled": (
        '<circle r="2" transform="translate(5,6) scale(2 1)"/>',
        *("ellipse", (5, -6), 8 * math.pi),
    ),
    "turned": (
        '<g transform="rotate(90)"><circle r="1" cx="7"/></g>',
        *("circle", (0, -7), math.pi),
    ),
    "mirrored": (
        '<path transform="matrix(-1 0 0 1 0 0)" d="M 2 -1 h 2 a 1 1 0 0 1 0 2 h -2 z"/>',
        *("polyline", (-(4 * 3 + math.pi / 2 * (4 + 4 / (3 * math.pi))) / (4 + math.pi / 2), 0)),
        4 + math.pi / 2,
    ),
    "clone": (
        '<defs><circle id="c" r="1"/></defs><use href="#c" x="3" transform="scale(2)"/>',
        *("circle", (6, 0), 4 * math.pi),
    ),
    "symbol": (
        '<symbol id="s" viewBox="0 0 10 10"><rect width="10" height="10"/></symbol>'
        '<use xlink:href="#s" x="-2" y="-12" width="4" height="4"/>',
        *("rectangle", (0, 10), 16.0),
    ),
    # a square viewBox in the middle of a wide viewport
    "nested svg": (
        '<svg x="5" y="5" width="20" height="10" viewBox="0 0 10 10">'
        '<rect x="10%" y="10%" width="80%" height="80%"/></svg>',
        *("rectangle", (15, -10), 64.0),
    ),
    "nested svg to the left": (
        '<svg x="5" y="5" width="20" height="10" viewBox="0 0 10 10"'
        ' preserveAspectRatio="xMinYMin meet"><rect x="1" y="1" width="8" height="8"/></svg>',
        *("rectangle", (10, -10), 64.0),
    ),
    "percent": ('<circle cx="10%" cy="-10%" r="2%"/>', "circle", (10, 10), 4 * math.pi),
    "units": ('<circle cx="96px" r="0.0in" /><rect x="1in" width="96" height="1in"/>', None, 0, 0),
    "only visible": (
        '<style>/* a */ .hid, #x { display: none } .y{visibility:hidden}</style>'
        '<g class="hid"><circle r="9"/></g><circle id="x" r="8"/><circle class="b y" r="3"/>'
        '<circle r="7" style="display:none"/><g display="none"><circle r="6"/></g>'
        '<mask><circle r="5"/></mask><clipPath><circle r="4"/></clipPath>'
        '<marker><circle r="4"/></marker><symbol><circle r="3"/></symbol><circle cx="9" r="1"/>',
        *("circle", (9, 0), math.pi),
    ),
}  # fmt: skip
del SHAPES["units"]


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_where_a_browser_draws_them(name):
    body, shape, centroid, area = SHAPES[name]
    electrode = read_one(body)
    assert electrode.shape == shape
    assert 1e3 * electrode.outline.centroid == pytest.approx(centroid, abs=1e-6)
    assert 1e6 * electrode.outline.area == pytest.approx(area, rel=1e-9)


def test_bezier_curves_are_followed_to_the_tolerance():
    """The area of closed Bézier curves by Green's theorem is that of their control points."""
    body = '<path d="M 0 0 C 0 4 6 4 6 0 Q 3 -6 0 0"/>'
    t = np.linspace(0.0, 1.0, 20_001)[:, None]
    upper = 12 * t * (1 - t) ** 2 * [0, 1] + 3 * t**2 * (1 - t) * [6, 4] + t**3 * [6, 0]
    lower = (1 - t) ** 2 * [6, 0] + 2 * t * (1 - t) * [3, -6]
    x, y = np.concatenate([upper[:-1], lower[:-1]]).T
    exact = abs(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    for tolerance_um in (10.0, 1.0):
        electrode = read_one(body, tolerance_um=tolerance_um)
        assert 1e6 * electrode.outline.area == pytest.approx(exact, abs=20e-3 * tolerance_um)


CIRCLE = '<circle cx="10" cy="20" r="2"/>'


@pytest.mark.parametrize(
    ("size", "unit_mm"),
    [
        ('width="25.4mm" height="25.4mm" viewBox="0 0 25.4 25.4"', 1.0),
        ('width="1in" viewBox="0 0 100 30"', 0.254),
        ('width="72pt" height="1in" viewBox="0 0 96 96"', 25.4 / 96.0),
        ('width="960px" height="960px" viewBox="0 0 960 960"', 25.4 / 96.0),
        # the smaller scale counts, the rest of the page stays empty
        ('width="200mm" height="50mm" viewBox="0 0 100 100"', 0.5),
    ],
)
def test_the_unit_is_that_of_size_and_view_box(size, unit_mm):
    electrode = read_one(CIRCLE, size)
    found = [electrode.x_mm, electrode.y_mm, electrode.radius_mm]
    assert found == pytest.approx([10.0 * unit_mm, -20.0 * unit_mm, 2.0 * unit_mm])


@pytest.mark.parametrize(
    "size",
    [
        *("", 'viewBox="0 0 100 100"', 'width="100" height="100" viewBox="0 0 100 100"'),
        *('width="100%" viewBox="0 0 100 100"', 'width="100mm" height="100mm"'),
    ],
)
def test_a_drawing_without_a_unit_needs_one(size):
    assert refuse(CIRCLE, size).startswith("electrodes.unit: is required")
    assert place(read_one(CIRCLE, size, unit="mm")) == (10.0, -20.0)
    assert place(read_one(CIRCLE, size, unit="mm", origin_mm=[10.0, 10.0])) == (0.0, -10.0)


def test_a_unit_that_contradicts_the_size_is_refused():
    size = 'width="1in" height="1in" viewBox="0 0 96 96"'
    assert 'electrodes.unit = "mm": contradicts' in refuse(CIRCLE, size, unit="mm")
    assert read_one(CIRCLE, size, unit="px").x_mm == pytest.approx(10.0 * 25.4 / 96.0)


LAYERS = """
<g id="layer1" class="print" inkscape:label="Pads" inkscape:groupmode="layer">
  <circle cx="10" r="2" id="p1"><title>North</title></circle>
  <circle cx="-10" r="2" id="p2" inkscape:label="South"/>
</g>
<g inkscape:label="Rim"><circle r="45"/></g>"""


@pytest.mark.parametrize("layer", ["layer1", "print", "Pads"])
def test_layers_are_ids_classes_and_labels(layer):
    assert list(read(LAYERS, layer=layer)) == ["North", "South"]
    assert list(read(LAYERS, layer=layer, names="id")) == ["p1", "p2"]
    assert list(read(LAYERS, layer=layer, names="letters")) == ["A", "B"]


def test_an_unknown_layer_lists_those_there_are():
    assert "Pads (2), Rim (1)" in refuse(LAYERS, layer="Padz")
    assert "Pads (2), Rim (1)" in refuse(LAYERS)


@pytest.mark.parametrize(("names", "name"), [("title", "West"), ("id", "w")])
@pytest.mark.parametrize("data", ["M0,0 C9,9 -9,9 0,0", "M0,0 C9,9 -9,9 0,0 Z"])
def test_a_single_curve_that_ends_where_it_begins_keeps_title_and_id(data, names, name):
    path = f'<path id="w" d="{data}"><title>West</title></path>'
    assert list(read(path, names=names)) == [name]


def test_texts_name_outlines_and_a_lone_nameless_outline_is_refused():
    right = '<text x="9.5" y="0" font-size="1">R</text><circle cx="10" r="2"/>'
    left = '<circle cx="-10" r="2"/>'
    below = '<text x="-10" y="-3" font-size="1" text-anchor="middle">L</text>'
    assert list(read(right + left + below)) == ["R", "L"]
    assert "(-10, 0)" in refuse(right + left)
    assert "R and L" in refuse(right + left + below.replace('x="-10" y="-3"', 'x="10" y="1"'))
    assert list(read(right + left, names="letters")) == ["A", "B"]


@pytest.mark.parametrize(
    ("body", "word"),
    [
        ('<path id="p" d="M 0 0 L 3 0 L 3 3"/>', "<path> p"),
        ('<path d="M 0 0 X 3 0 L 3 3 z"/>', "path data"),
        ('<path d="M 0 0 L 1e999 0 L 3 3 z"/>', "not finite"),
        ('<circle r="2em"/>', "2em"),
        ('<use href="#none"/>', "#none"),
        ('<g id="a"><use href="#a"/></g>', "end"),
        ('<circle r="2" transform="rotate3d(1)"/>', "rotate3d"),
        ('<circle r="2" transform="translate(10mm)"/>', "10mm"),
        ('<image width="3" height="3"/>', "image (1)"),
        ('<circle r="0"/>', "no visible curve"),
        ("<g><circle></g>", "not an SVG file"),
    ],
)
def test_what_cannot_be_read_is_named(body, word):
    assert word in refuse(body)


def test_clones_of_clones_do_not_take_forever():
    groups = ['<g id="g0" visibility="hidden"><circle r="1"/></g>']
    for level in range(1, 12):
        uses = f'<use href="#g{level - 1}"/>' * 10
        groups.append(f'<g id="g{level}">{uses}</g>')
    assert "entities" in refuse("".join(groups))
