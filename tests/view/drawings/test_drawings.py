"""Drawings at scale 1:1: scenes come back from them, and pages have the sizes of the scene."""

from __future__ import annotations

import math
import re
import zlib
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import matplotlib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene, draw, solve
from pvdf_fem.scene.outlines.arc_polygon import find_arc_polygon_defect
from pvdf_fem.scene.registry import FLAT_SHAPES
from tests.helpers.damage import drawn

MICROMETRE = 1e-6
sizes = st.floats(0.3, 4.0)


@st.composite
def stars(draw_value: st.DrawFn) -> list[list[float]]:
    """Vertices of a polygon that its centre sees."""
    radii = draw_value(st.lists(sizes, min_size=3, max_size=9))
    angles = 2.0 * np.pi * np.arange(len(radii)) / len(radii)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1).tolist()


@st.composite
def arc_stars(draw_value: st.DrawFn) -> dict[str, object]:
    """Keys of a polyline with straight sides and arcs."""
    vertices = draw_value(stars())
    bulge = st.sampled_from([0.0, 0.1, 0.3, -0.1, 1e-3])
    bulges = draw_value(st.lists(bulge, min_size=len(vertices), max_size=len(vertices)))
    if find_arc_polygon_defect(vertices, bulges):
        bulges = [0.0] * len(vertices)
    return {"vertices_mm": vertices, "bulges": bulges}


GEOMETRIES = {
    "circle": st.fixed_dictionaries({"radius_mm": sizes}),
    "ellipse": st.tuples(sizes, sizes).map(lambda axes: {"semi_axes_mm": list(axes)}),
    "rectangle": st.fixed_dictionaries({"width_mm": sizes, "height_mm": sizes}),
    "square": st.fixed_dictionaries({"side_mm": sizes}),
    "triangle": st.fixed_dictionaries({"side_mm": sizes}),
    "polygon": stars().map(lambda vertices: {"vertices_mm": vertices}),
    "polyline": arc_stars(),
}


@st.composite
def scenes(draw_value: st.DrawFn) -> Scene:
    """A film with an electrode of each shape, at random angles."""
    electrodes = []
    for number, (shape, keys) in enumerate(GEOMETRIES.items()):
        angle = 2.0 * math.pi * number / len(GEOMETRIES)
        electrodes.append(
            {
                "name": f"E{number}",
                "x_mm": 25.0 * math.cos(angle) + draw_value(st.floats(-1.0, 1.0)),
                "y_mm": 25.0 * math.sin(angle) + draw_value(st.floats(-1.0, 1.0)),
                "rotation_deg": draw_value(st.sampled_from([0.0, 90.0, 33.0, -170.0])),
                "shape": shape,
                **draw_value(keys),
            }
        )
    return Scene(electrodes=electrodes)


def read_back(scene: Scene, path, **options) -> Scene:
    """Draw a scene, and read a scene with the electrodes of the drawing."""
    draw(scene, path, **options)
    unit = {"unit": "mm"} if options.get("dxf_version") == "R12" else {}
    return Scene(
        film=scene.film,
        probe=scene.probe,
        electrodes={"drawing": str(path), "layer": "ELECTRODES", **unit},
    )


def test_every_shape_is_drawn():
    assert set(GEOMETRIES) == set(FLAT_SHAPES)


@pytest.mark.parametrize("file", ["pads.dxf", "pads.svg", "r12.dxf"])
@given(scene=scenes())
@drawn(0.3)
def test_electrodes_come_back_from_a_drawing_within_a_micrometre(tmp_path_factory, file, scene):
    version = {"dxf_version": "R12"} if file == "r12.dxf" else {}
    path = tmp_path_factory.mktemp("drawings") / file
    back = {one.name: one.outline for one in read_back(scene, path, **version).electrode_list}
    assert back.keys() == {one.name for one in scene.electrode_list}
    for electrode in scene.electrode_list:
        outline = electrode.outline
        found = back[electrode.name]
        slack = MICROMETRE * outline.perimeter
        assert found.area == pytest.approx(outline.area, abs=slack)
        assert found.centroid == pytest.approx(outline.centroid, abs=MICROMETRE)
        points, _ = outline.make_boundary_rule(20)
        assert np.abs(found.compute_signed_distances(points)).max() < MICROMETRE


@pytest.mark.parametrize("extension", ["dxf", "svg"])
def test_charges_of_a_scene_from_a_drawing_are_equal(tmp_path, extension):
    scene = Scene(
        electrodes=[
            {"name": "E", "shape": "circle", "radius_mm": 2.0, "x_mm": 10.0, "y_mm": 0.0},
            {
                "name": "N",
                "shape": "polyline",
                "vertices_mm": [[-2, -1], [2, -1], [2, 1], [-2, 1]],
                "bulges": [0.0, 1.0, 0.0, 1.0],
                "x_mm": 0.0,
                "y_mm": 12.0,
                "rotation_deg": 20.0,
            },
        ],
        probe={"shape": "triangle", "side_mm": 5.0, "x_mm": 3.0},
    )
    back = solve(read_back(scene, tmp_path / f"pads.{extension}"))
    expected = solve(scene)
    # another vertex is the first one, so that gmsh makes other elements
    for name, charge in expected.charges_pC.items():
        error = expected.charge_errors_pC[name]
        assert back.charges_pC[name] == pytest.approx(charge, abs=0.2 * error)


SCENE = Scene(
    film={
        "radius_mm": 47.3,
        "patches": [
            {"shape": "square", "side_mm": 6.0, "x_mm": -25.0, "y_mm": 5.0, "thickness_um": 30.0}
        ],
    },
    electrodes=[
        {"name": "E 1", "shape": "circle", "radius_mm": 2.0, "x_mm": 10.0, "y_mm": 0.0},
        {"name": "Ö", "shape": "ellipse", "semi_axes_mm": [2.0, 4.0], "x_mm": 0.0, "y_mm": 20.0},
        {
            "name": "slot",
            "shape": "polyline",
            "vertices_mm": [[-2, -1], [2, -1], [2, 1], [-2, 1]],
            "bulges": [0.0, 1.0, 0.0, 1.0],
            "x_mm": 0.0,
            "y_mm": -20.0,
        },
    ],
    probe={"shape": "triangle", "side_mm": 5.0},
)


@pytest.mark.parametrize("version", ["R2010", "R12"])
def test_a_dxf_file_has_outlines_in_mm_on_layers_of_their_own(tmp_path, version):
    path = tmp_path / "pads.dxf"
    draw(SCENE, path, probe=True, dxf_version=version)
    document = ezdxf.readfile(path)
    assert not document.audit().errors
    assert document.units == (0 if version == "R12" else 4)
    kinds = {}
    for entity in document.modelspace():
        kinds.setdefault(entity.dxf.layer, set()).add(entity.dxftype())
    polyline = "POLYLINE" if version == "R12" else "LWPOLYLINE"
    ellipse = set() if version == "R12" else {"ELLIPSE"}
    assert kinds == {
        "RIM": {"CIRCLE"},
        "ELECTRODES": {"CIRCLE", polyline} | ellipse,
        "PATCHES": {polyline},
        "PROBE": {polyline},
        "NAMES": {"TEXT"},
        "DIMENSIONS": {"DIMENSION", "TEXT"},
    }
    measured = [d.get_measurement() for d in document.modelspace().query("DIMENSION")]
    assert measured[0] == pytest.approx(94.6)
    assert sorted(measured[1:]) == pytest.approx([2.0, 4.0, 4.0, 6.0, 8.0])


@pytest.mark.parametrize(
    "film",
    [
        {"shape": "rectangle", "width_mm": 60.0, "height_mm": 40.0},
        {"shape": "polygon", "vertices_mm": [[-30, -20], [30, -10], [30, 20], [-25, 20]]},
        {"shape": "ellipse", "semi_axes_mm": [30.0, 20.0]},
    ],
)
def test_dimensions_of_the_rim_do_not_cover_its_sides(tmp_path, film):
    path = tmp_path / "pads.dxf"
    draw(Scene().with_(film=film), path)
    width, height = list(ezdxf.readfile(path).modelspace().query("DIMENSION"))[:2]
    assert [width.get_measurement(), height.get_measurement()] == pytest.approx([60.0, 40.0])
    rim = Scene().with_(film=film).film.outline
    for dimension in (width, height):
        for point in (dimension.dxf.defpoint2, dimension.dxf.defpoint3):
            away = np.array(dimension.dxf.defpoint.vec2 - point.vec2)
            away[1 if dimension is height else 0] = 0.0
            on_line = np.array(point.vec2) + np.linspace(0.0, 1.0, 20)[:, None] * away
            distances = rim.compute_signed_distances(1e-3 * on_line)
            assert distances.min() > -1e-9  # in m
            assert (distances < 1e-6).sum() <= 1


def test_an_svg_file_states_its_size_and_has_real_arcs(tmp_path):
    path = tmp_path / "pads.svg"
    draw(SCENE, path)
    root = ElementTree.parse(path).getroot()
    width = float(root.get("width").removesuffix("mm"))
    assert root.get("viewBox").split()[2] == f"{width:g}"
    groups = {group.get("id"): group for group in root}
    assert list(groups) == ["RIM", "ELECTRODES", "PATCHES", "NAMES", "DIMENSIONS"]
    [rim] = groups["RIM"]
    assert float(rim.get("r")) == 47.3
    tags = [shape.tag.rpartition("}")[2] for shape in groups["ELECTRODES"]]
    assert tags == ["circle", "ellipse", "path"]
    assert groups["ELECTRODES"][2].get("d").count("A") == 2


def test_a_drawing_without_dimensions_has_no_layer_for_them(tmp_path):
    path = tmp_path / "pads.svg"
    draw(SCENE, path, dimensions=False)
    assert [group.get("id") for group in ElementTree.parse(path).getroot()][-1] == "NAMES"


def read_pdf_paths(path) -> tuple[float, list[np.ndarray]]:
    """Read the width of a page and the end points of its curves, in mm about the page's centre."""
    content = path.read_bytes()
    width = float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)[1])
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL)
    pages = [text for text in map(decompress, streams) if b" re\n" in text or b" m\n" in text]
    paths = []
    for line in pages[0].decode("latin-1").splitlines():
        *numbers, operator = line.split() or [""]
        if operator == "m":
            paths.append([])
        if operator in ("m", "l", "c"):
            paths[-1].append([float(number) for number in numbers[-2:]])
    to_mm = 25.4 / 72.0
    return to_mm * width, [to_mm * (np.array(one) - 0.5 * width) for one in paths]


def decompress(data: bytes) -> bytes:
    try:
        return zlib.decompress(data)
    except zlib.error:
        return b""


def test_a_pdf_page_and_its_paths_have_the_sizes_of_the_scene(tmp_path):
    """Matplotlib would thin long outlines and crop the page by these settings."""
    path = tmp_path / "pads.pdf"
    vertices = [[10 * math.cos(a), 10 * math.sin(a)] for a in np.linspace(0.0, 6.28, 900)]
    scene = SCENE.with_(
        electrodes=[{"name": "P", "shape": "polygon", "vertices_mm": vertices, **CENTRE}]
    )
    with matplotlib.rc_context({"savefig.bbox": "tight", "path.simplify": True}):
        draw(scene, path)
    width, paths = read_pdf_paths(path)
    assert width == pytest.approx(2.0 * 1.3 * 47.3, abs=1e-3)
    rim = paths[0]
    assert np.linalg.norm(rim, axis=1) == pytest.approx(47.3, abs=1e-3)
    assert np.ptp(rim, axis=0) == pytest.approx(94.6, abs=1e-3)
    polygon = paths[1]
    exact = scene.electrode_list[0].outline.corners
    assert len(polygon) >= len(exact)
    assert polygon[: len(exact)] == pytest.approx(1e3 * np.array(exact), abs=1e-3)


CENTRE = {"x_mm": 0.0, "y_mm": 0.0}


@pytest.mark.parametrize(
    ("path", "options", "word"),
    [("pads.png", {}, ".dxf .svg .pdf"), ("pads.dxf", {"dxf_version": "R13"}, "R12")],
)
def test_unknown_formats_and_versions_are_refused(tmp_path, path, options, word):
    with pytest.raises(ValueError, match=re.escape(word)):
        draw(SCENE, tmp_path / path, **options)


def test_the_picture_of_the_guide_is_the_drawing_of_its_scene(tmp_path):
    guide = Path(__file__).parents[3] / "reports" / "guide"
    page = guide.joinpath("drawings.md").read_text("utf-8")
    [text] = re.findall(r"%%writefile sensor\.toml\n(.*?)```", page, re.DOTALL)
    draw(Scene.parse(text), tmp_path / "pads.svg")
    drawn = (tmp_path / "pads.svg").read_text("utf-8")
    assert drawn == guide.joinpath("static", "pads.svg").read_text("utf-8")
