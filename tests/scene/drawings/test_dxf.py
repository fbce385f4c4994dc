"""Electrodes from DXF files that ezdxf writes."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import ezdxf
import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.scene import SceneError

#: Sine of half a bulge's angle, for arcs as splines: control points of a quarter of a circle.
QUARTER = np.array([[1.0, 0.0], [1.0, 0.5522847498], [0.5522847498, 1.0], [0.0, 1.0]])
MIRRORED = {"extrusion": (0.0, 0.0, -1.0)}
D_SHAPE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 1.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
D_AREA = 4.0 + math.pi / 2.0
D_CENTROID = (math.pi / 2.0 + 2.0 / 3.0) / D_AREA


@pytest.fixture
def drawing(tmp_path, monkeypatch):
    """A new DXF file in mm, and the scene that is read from it by `read`."""
    monkeypatch.chdir(tmp_path)
    return NewDrawing("R2010", units=4)


class NewDrawing:
    """A DXF file that is written and read."""

    def __init__(self, version: str, units: int) -> None:
        logging.getLogger("ezdxf").setLevel(logging.ERROR)
        self.document = ezdxf.new(version, units=units)
        self.space = self.document.modelspace()
        self.film: dict[str, object] = {}

    def read(self, **keys):
        """Save the file, and return the electrodes by name."""
        self.document.saveas("pads.dxf")
        scene = Scene(film=self.film, electrodes={"drawing": "pads.dxf", **keys})
        assert Scene.parse(scene.to_toml()) == scene
        return {electrode.name: electrode for electrode in scene.electrode_list}

    def refuse(self, **keys) -> str:
        """Save the file, and return the only error of its scene."""
        with pytest.raises(SceneError) as error:
            self.read(**keys)
        [problem] = error.value.problems
        return problem


def area_mm2(electrode) -> float:
    return 1e6 * electrode.outline.area


def centroid_mm(electrode):
    return pytest.approx(1e3 * electrode.outline.centroid, abs=1e-6)


def test_shapes_keep_their_kind_with_names_by_the_texts_inside(drawing):
    space = drawing.space
    space.add_circle((10.0, 0.0), 2.0)
    space.add_lwpolyline([(-2, 8), (2, 8), (2, 11), (-2, 11)], close=True)
    space.add_lwpolyline([(-12, -1, 0), (-8, -1, 1), (-8, 1, 0), (-12, 1, 1)], "xyb", close=True)
    space.add_ellipse((0.0, -10.0), (3.0, 1.0), 0.5)
    space.add_lwpolyline([(10, 10), (15, 10), (10, 13)], close=True)
    for name, place in {"E": (9, -1), "N": (-1, 9), "W": (-11, 0), "S": (0, -10)}.items():
        space.add_text(name, height=1.0).set_placement(place)
    space.add_mtext("NE", dxfattribs={"insert": (13, 13), "char_height": 1.0})
    found = drawing.read()
    shapes = {name: electrode.shape for name, electrode in found.items()}
    assert shapes == {
        **{"E": "circle", "NE": "polygon", "N": "rectangle"},
        **{"W": "polyline", "S": "ellipse"},
    }
    assert (found["E"].radius_mm, found["N"].width_mm, found["N"].height_mm) == (2.0, 4.0, 3.0)
    assert area_mm2(found["W"]) == pytest.approx(8.0 + math.pi, rel=1e-12)
    assert area_mm2(found["S"]) == pytest.approx(5.0 * math.pi, rel=1e-9)


def test_letters_are_counter_clockwise_from_x_and_the_centre_is_the_last(drawing):
    places = [(0, 0), (0, -10), (-10, 0), (10, -1e-9), (0, 10), (20, 0)]
    for place in places:
        drawing.space.add_circle(place, 1.0)
    found = drawing.read(names="letters")
    order = [(10, 0), (20, 0), (0, 10), (-10, 0), (0, -10), (0, 0)]
    for (name, electrode), place in zip(found.items(), order, strict=True):
        assert (name, centroid_mm(electrode)) == ("ABCDEF"[order.index(place)], place)


def test_mirrored_entities_are_where_they_are_seen(drawing):
    """The centre of a circle with the extrusion (0, 0, -1) is given in mirrored coordinates."""
    space = drawing.space
    space.add_circle((10.0, 0.0), 2.0, dxfattribs=MIRRORED)
    space.add_arc((-5.0, 5.0), 2.0, 0.0, 180.0, dxfattribs=MIRRORED)
    space.add_line((3.0, 5.0), (7.0, 5.0))
    space.add_lwpolyline(D_SHAPE, "xyb", close=True, dxfattribs=MIRRORED)
    arc, mirrored, circle = drawing.read().values()
    assert centroid_mm(circle) == (-10.0, 0.0)
    assert centroid_mm(arc) == (5.0, 5.0 + 8.0 / (3.0 * math.pi))
    assert centroid_mm(mirrored) == (-D_CENTROID, 0.0)


def test_blocks_are_read_with_arrays_scales_mirrors_and_nesting(drawing):
    blocks = drawing.document.blocks
    blocks.new("PAD").add_circle((0, 0), 1.0)
    blocks.new("DEE").add_lwpolyline(D_SHAPE, "xyb", close=True)
    blocks.new("NEST").add_blockref("DEE", (0, 0), dxfattribs={"rotation": 90})
    array = {"row_count": 3, "column_count": 2, "row_spacing": 5, "column_spacing": 6}
    drawing.space.add_blockref("PAD", (10, -5), dxfattribs=array)
    drawing.space.add_blockref("DEE", (-10, 0), dxfattribs={"xscale": -1})
    drawing.space.add_blockref("NEST", (-10, 10), dxfattribs={"xscale": 2, "yscale": 2})
    drawing.space.add_blockref("DEE", (0, -20), dxfattribs={"xscale": 2, "yscale": 1})
    drawing.space.add_blockref("PAD", (0, 20), dxfattribs={"xscale": 2, "rotation": 30})
    found = list(drawing.read(tolerance_um=0.1).values())
    circles = [one for one in found if one.shape == "circle"]
    grid = {(x, y) for x in (10.0, 16.0) for y in (-5.0, 0.0, 5.0)}
    assert {(one.x_mm, one.y_mm) for one in circles} == grid
    ellipse, nested, mirrored, stretched = [one for one in found if one.shape != "circle"]
    assert sorted(ellipse.semi_axes_mm) == [1.0, 2.0]
    assert ellipse.rotation_deg == pytest.approx(30.0)
    assert area_mm2(nested) == pytest.approx(4.0 * D_AREA)
    assert centroid_mm(nested) == (-10.0, 10.0 + 2.0 * D_CENTROID)
    assert centroid_mm(mirrored) == (-10.0 - D_CENTROID, 0.0)
    assert area_mm2(stretched) == pytest.approx(2.0 * D_AREA, abs=1e-4 * 8.0)


def test_attributes_of_blocks_name_their_outlines(drawing):
    block = drawing.document.blocks.new("PAD")
    block.add_circle((0, 0), 1.0)
    block.add_attdef("NAME", (0, 0))
    for name, x in {"S1": 5.0, "S2": -5.0}.items():
        drawing.space.add_blockref("PAD", (x, 0)).add_auto_attribs({"NAME": name})
    assert {name: e.x_mm for name, e in drawing.read().items()} == {"S1": 5.0, "S2": -5.0}


def test_layers_name_outlines_without_texts(drawing):
    drawing.space.add_circle((5.0, 0.0), 1.0, dxfattribs={"layer": "right"})
    drawing.space.add_circle((-5.0, 0.0), 1.0, dxfattribs={"layer": "left"})
    assert list(drawing.read()) == ["right", "left"]
    assert list(drawing.read(names="letters")) == ["A", "B"]


def test_hidden_layers_are_left_out_and_the_layer_is_chosen_in_any_case(drawing):
    layers = drawing.document.layers
    layers.add("PADS")
    layers.add("OFF").off()
    layers.add("COLD").freeze()
    for number, layer in enumerate(("PADS", "OFF", "COLD")):
        attributes = {"layer": layer}
        drawing.space.add_circle((10.0 * number, 0.0), 1.0, dxfattribs=attributes)
    invisible = {"layer": "PADS", "invisible": 1}
    drawing.space.add_circle((0.0, 10.0), 1.0, dxfattribs=invisible)
    drawing.space.add_circle((0.0, 0.0), 45.0, dxfattribs={"layer": "RIM"})
    assert len(drawing.read(layer="pads")) == 1
    for message in (drawing.refuse(), drawing.refuse(layer="OFF"), drawing.refuse(layer="NO")):
        assert "PADS (1), RIM (1)" in message
    assert "electrodes.layer" in drawing.refuse(layer="OFF")
    assert "off or frozen: OFF (1), COLD (1)" in drawing.refuse(layer="OFF")


@pytest.mark.parametrize("radius", [1.5, 6.0])
def test_a_circle_of_open_splines_becomes_one_shape_within_the_tolerance(drawing, radius):
    """Inkscape's DXF 14 has four to six open splines for a circle, with six decimals."""
    for quarter in range(4):
        angle = 0.5 * math.pi * quarter
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        points = np.round(radius * QUARTER @ turn.T, 6)
        points = np.column_stack([points, np.zeros(4)])
        # one of them runs the other way
        drawing.space.add_open_spline(points[::-1] if quarter == 2 else points, degree=3)
    [pad] = drawing.read().values()
    exact = Circle(np.zeros(2), 1e-3 * radius)
    points, _ = pad.outline.make_boundary_rule(50)
    # the splines themselves are up to 2.7e-4 of the radius outside of the circle
    excess = exact.compute_signed_distances(points)
    assert -1e-6 < excess.min() < excess.max() < 1e-6 + 2.8e-7 * radius
    loose = drawing.read(tolerance_um=5.0)["A"]
    assert loose.shape == "circle"


def test_splines_are_followed_to_the_tolerance_by_few_arcs(drawing):
    """A rational spline is an exact quarter of a circle: arcs follow it exactly."""
    weights = [1.0, math.sqrt(0.5), 1.0]
    drawing.space.add_rational_spline([(3, 0, 0), (3, 3, 0), (0, 3, 0)], weights, degree=2)
    drawing.space.add_line((0, 3), (0, 0))
    drawing.space.add_line((0, 0), (3, 0))
    [sector] = drawing.read().values()
    assert area_mm2(sector) == pytest.approx(9.0 * math.pi / 4.0, rel=1e-9)
    assert len(sector.bulges) == 4


def test_areas_of_splines_converge_with_the_tolerance(drawing):
    corners = [(0, 0, 0), (5, 0, 0), (5, 5, 0), (0, 5, 0)]
    drawing.space.add_spline().set_closed(corners, degree=3)
    # the area of the uniform cubic B-spline by fine sampling of ezdxf's own evaluation
    tool = drawing.space[0].construction_tool()
    points = np.array([(p.x, p.y) for p in tool.approximate(200_000)])
    x, y = points.T
    exact = abs(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    counts = []
    for tolerance_um in (10.0, 1.0, 0.1):
        [pad] = drawing.read(tolerance_um=tolerance_um).values()
        perimeter_mm = 1e3 * pad.outline.perimeter
        assert area_mm2(pad) == pytest.approx(exact, abs=1e-3 * tolerance_um * perimeter_mm)
        counts.append(len(pad.bulges))
    # the number of arcs grows with the third root of the accuracy
    assert counts[2] <= 5 * counts[0]


def test_the_frame_of_a_fitted_polyline_is_left_out(drawing):
    polyline = drawing.space.add_polyline2d([(0, 0), (30, 0), (30, 30), (0, 30)], close=True)
    polyline.dxf.flags |= 4
    for vertex in polyline.vertices:
        vertex.dxf.flags |= 16
    for place in [(1, 0), (2, 0), (3, 1), (3, 2), (2, 3), (1, 3), (0, 2), (0, 1)]:
        polyline.append_vertex(place, dxfattribs={"flags": 8})
    [pad] = drawing.read().values()
    assert area_mm2(pad) == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("units", "size_mm"), [(1, 25.4), (4, 1.0), (5, 10.0), (6, 1000.0), (9, 0.0254), (13, 1e-3)]
)
def test_the_unit_is_that_of_the_header(tmp_path, monkeypatch, units, size_mm):
    monkeypatch.chdir(tmp_path)
    drawing = NewDrawing("R2010", units=units)
    drawing.space.add_circle((10.0 / size_mm, 0.0), 2.0 / size_mm)
    [pad] = drawing.read().values()
    assert (pad.x_mm, pad.radius_mm) == pytest.approx((10.0, 2.0))


@pytest.mark.parametrize("has_header", [True, False])
def test_a_file_without_a_unit_needs_one(tmp_path, monkeypatch, has_header):
    """ezdxf says metres for a file without a header."""
    monkeypatch.chdir(tmp_path)
    header = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n0\nENDSEC\n" if has_header else ""
    circle = "0\nCIRCLE\n8\n0\n10\n10.0\n20\n0.0\n40\n2.0\n"
    text = f"{header}0\nSECTION\n2\nENTITIES\n{circle}0\nENDSEC\n0\nEOF\n"
    (tmp_path / "pads.dxf").write_text(text)
    table = {"drawing": "pads.dxf"}
    with pytest.raises(SceneError, match=r"electrodes\.unit: is required"):
        Scene(electrodes=table)
    [pad] = Scene(electrodes={**table, "unit": "mm"}).electrode_list
    assert (pad.x_mm, pad.radius_mm) == (10.0, 2.0)


def test_a_unit_that_contradicts_the_header_is_refused(drawing):
    drawing.space.add_circle((10.0, 0.0), 2.0)
    assert len(drawing.read(unit="mm")) == 1
    assert "$INSUNITS = 4 (mm)" in drawing.refuse(unit="in")
    assert "mm, cm, m, um" in drawing.refuse(unit="parsec")


def test_origin_and_rotation_place_the_drawing_on_the_film(drawing):
    drawing.space.add_circle((30.0, 22.0), 1.0)
    [pad] = drawing.read(origin_mm=[20.0, 20.0], rotation_deg=90.0).values()
    assert (pad.x_mm, pad.y_mm) == (-2.0, 10.0)


def _add_gap(space):
    space.add_line((0, 0), (3, 0))
    space.add_line((3, 0), (3, 3))
    space.add_line((3, 3.002), (0, 0))


def _add_branch(space):
    for ends in [((0, 0), (3, 0)), ((3, 0), (3, 3)), ((3, 3), (0, 0)), ((0, 0), (0, 3))]:
        space.add_line(*ends)
    space.add_line((0, 3), (3, 3))


def _add_hatch(space):
    space.add_hatch().paths.add_polyline_path([(0, 0), (3, 0), (3, 3)])


#: Drawings that are refused, and the place, entity or number that the message has.
REFUSED = {
    "gap": (_add_gap, ["(3, 3)", "(3, 3.002)", "2 µm"]),
    "branch": (_add_branch, ["meet at (0, 0)"]),
    "open": (lambda space: space.add_lwpolyline([(0, 0), (3, 0), (3, 3)]), ["LWPOLYLINE 2F"]),
    "hatch only": (_add_hatch, ["HATCH (1)"]),
    "empty": (lambda space: None, ["no visible curve"]),
    "crossing": (
        lambda space: space.add_lwpolyline([(0, 0), (3, 3), (3, 0), (0, 3)], close=True),
        ["LWPOLYLINE 2F", "1.5 1.5"],
    ),
    "overlap": (
        lambda space: [space.add_circle((x, 0), 3.0) for x in (0, 5)],
        ["CIRCLE 2F", "CIRCLE 30", "overlaps", "move them apart"],
    ),
    "hole": (
        lambda space: [space.add_circle((0, 0), radius) for radius in (3, 1)],
        ["CIRCLE 30", "lies within", "CIRCLE 2F"],
    ),
    "over the rim": (lambda space: space.add_circle((44, 0), 3.0), ["CIRCLE 2F", "2 mm beyond"]),
    "far away": (lambda space: space.add_circle((1e9, 0), 3.0), ["CIRCLE 2F", "unit"]),
    "not a number": (lambda space: space.add_circle((math.nan, 0), 3.0), ["CIRCLE 2F"]),
    "tilted": (
        lambda space: space.add_circle((0, 0), 3.0, dxfattribs={"extrusion": (0, 1, 1)}),
        ["CIRCLE 2F", "flatten"],
    ),
    "wide": (
        lambda space: space.add_lwpolyline([(-1, 0, 0.5, 0.5, 1), (1, 0, 0.5, 0.5, 1)], close=True),
        ["LWPOLYLINE 2F", "0.5"],
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_outlines_are_refused_by_entity_and_place(drawing, name):
    add, words = REFUSED[name]
    add(drawing.space)
    message = drawing.refuse()
    assert message.startswith('electrodes.drawing = "pads.dxf": ')
    assert [word for word in words if word not in message] == []


def test_a_gap_closes_with_the_tolerance_that_the_message_names(drawing):
    _add_gap(drawing.space)
    assert "electrodes.tolerance_um = 2" in drawing.refuse()
    [pad] = drawing.read(tolerance_um=2.001).values()
    assert area_mm2(pad) == pytest.approx(4.5, abs=3e-3)


def test_arrays_and_blocks_without_end_are_refused(drawing):
    block = drawing.document.blocks.new("PAD")
    block.add_circle((0, 0), 1.0)
    spacing = {"row_count": 30_000, "column_count": 30_000, "row_spacing": 1, "column_spacing": 1}
    drawing.space.add_blockref("PAD", (0, 0), dxfattribs=spacing)
    assert "900000000 copies of block PAD" in drawing.refuse()
    drawing.space.delete_all_entities()
    block.add_blockref("PAD", (1, 0))
    drawing.space.add_blockref("PAD", (0, 0))
    assert "blocks in blocks" in drawing.refuse()


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_cut_or_wrong_file_is_refused(drawing, tmp_path, share):
    drawing.space.add_circle((10.0, 0.0), 2.0)
    drawing.read()
    text = (tmp_path / "pads.dxf").read_text()
    (tmp_path / "cut.dxf").write_text(text[: int(share * len(text))])
    with pytest.raises(SceneError, match=r'electrodes\.drawing = "cut.dxf": '):
        Scene(electrodes={"drawing": "cut.dxf"})


def test_errors_of_the_drawing_and_of_other_tables_come_together(drawing):
    drawing.space.add_circle((44.0, 0.0), 3.0)
    drawing.document.saveas("pads.dxf")
    with pytest.raises(SceneError) as error:
        Scene(
            electrodes={"drawing": "pads.dxf"},
            film={"thickness_um": -1.0},
            readout={"gain": {"X": 2.0}},
        )
    keys = [problem.partition(" = ")[0] for problem in error.value.problems]
    assert keys == ["electrodes.drawing", "film.thickness_um"]


def test_the_path_is_relative_to_the_scene_file(drawing, tmp_path, monkeypatch):
    drawing.space.add_circle((10.0, 0.0), 2.0)
    drawing.read()
    scene_file = tmp_path / "scene.toml"
    scene_file.write_text('[electrodes]\ndrawing = "pads.dxf"\n')
    monkeypatch.chdir("/")
    assert Scene.from_file(scene_file).electrode_list[0].x_mm == 10.0
    with pytest.raises(SceneError, match="No such file"):
        Scene.parse(scene_file.read_text())


def test_a_drawing_replaces_a_layout_or_a_list(drawing):
    drawing.space.add_circle((10.0, 0.0), 2.0)
    drawing.read()
    changes = {"electrodes.drawing": "pads.dxf", "electrodes.layer": "0"}
    for scene in (Scene(), Scene.parse(Scene(electrodes={"drawing": "pads.dxf"}).to_toml())):
        assert scene.with_(**changes).electrode_list[0].shape == "circle"
    with pytest.raises(SceneError, match=r"give electrodes\.drawing with it"):
        Scene().with_(**{"electrodes.layer": "0"})


def test_a_missing_extra_is_named(drawing, monkeypatch):
    drawing.space.add_circle((10.0, 0.0), 2.0)
    drawing.document.saveas("pads.dxf")
    monkeypatch.setitem(__import__("sys").modules, "ezdxf.filemanagement", None)
    with pytest.raises(SceneError, match=r'pip install "pvdf-fem\[drawings\]"'):
        Scene(electrodes={"drawing": "pads.dxf"})


def test_a_real_file_of_inkscape_is_read_without_its_unit():
    """Its circle is four open splines and its rectangle four lines, with y upwards."""
    path = str(Path(__file__).with_name("inkscape_1_2.dxf"))
    table = {"drawing": path, "unit": "mm"}
    with pytest.raises(SceneError, match=r"origin_mm = \[45, 44\]"):
        Scene(electrodes=table)
    with pytest.raises(SceneError, match=r"unit: is required .* 0 \(no unit\)"):
        Scene(electrodes={"drawing": path})
    pads = Scene(electrodes={**table, "origin_mm": [45.0, 45.0]}).electrode_list
    assert [pad.shape for pad in pads] == ["circle", "polyline", "rectangle", "polyline"]
    areas = [4.0 * math.pi, 12.0 + math.pi, 16.0, 8.0 * math.pi]
    assert [area_mm2(pad) for pad in pads] == pytest.approx(areas, rel=1e-4)
    places = [(10.0, 0.0), (0.0, 10.0), (-10.0, 0.0), (0.0, -12.0)]
    assert np.array([(pad.x_mm, pad.y_mm) for pad in pads]) == pytest.approx(
        np.array(places), abs=1e-4
    )


def test_pads_are_compared_with_the_rim_of_any_film(drawing):
    drawing.space.add_circle((25, 0), 2.0)
    [pad] = drawing.read().values()
    assert pad.x_mm == pytest.approx(25.0)
    drawing.film = {"shape": "rectangle", "width_mm": 60.0, "height_mm": 40.0}
    assert drawing.read()
    drawing.film = {"shape": "rectangle", "width_mm": 40.0, "height_mm": 60.0}
    message = drawing.refuse()
    assert "7 mm beyond the rim at film.width_mm = 40.0" in message
    assert "origin_mm = [25, 0]" in message
