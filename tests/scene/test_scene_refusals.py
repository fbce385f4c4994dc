"""Scenes that are refused, and in which words."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from pvdf_fem.scene.scene import Scene, SceneError
from tests.helpers.strategies import electrode


def problems(text: str) -> tuple[str, ...]:
    with pytest.raises(SceneError) as caught:
        Scene.parse(text)
    return caught.value.problems


RING = '[electrodes]\nlayout = "ring"\n'
POLYGON = '[probe]\nshape = "polygon"\n'

REFUSALS = [
    # unknown keys
    ("thickness = 25", "thickness = 25", "choose from film, electrodes"),
    ("[films]", "films = a table", "did you mean film?"),
    ("[film]\nthicknes_um = 30", "film.thicknes_um = 30", "did you mean thickness_um?"),
    ("[electrodes]\nside = 2", "electrodes.side = 2", "did you mean side_mm?"),
    (electrode(sid_mm=2), "electrodes[0].sid_mm = 2", "did you mean side_mm?"),
    ("[probe]\nx = 2", "probe.x = 2", "choose from x_mm"),
    ('[probe]\nshape = "circle"\nside_mm = 7', "probe.side_mm = 7", "choose from"),
    ("[load]\nforce = 2", "load.force = 2", "did you mean force_N?"),
    ("[numerics]\norder = 2", "numerics.order = 2", "choose from tolerance"),
    # wrong types
    ("film = 3", "film = 3", "must be a table"),
    ("probe = 3", "probe = 3", "must be a table"),
    ("electrodes = 3", "electrodes = 3", "must be a table"),
    ("electrodes = [3]", "electrodes[0] = 3", "must be a table"),
    ("[film]\nyoungs_modulus_GPa = [1]", "film.youngs_modulus_GPa[1] = (nothing)", "required"),
    ("[film]\nyoungs_modulus_GPa = [1, 2, 3]", "film.youngs_modulus_GPa = [1, 2, 3]", "at most 2"),
    ('[film]\nyoungs_modulus_GPa = ["1", 2]', 'film.youngs_modulus_GPa[0] = "1"', "a number"),
    (electrode(name=3), "electrodes[0].name = 3", "must be text"),
    ("[probe]\nshape = 3", "probe.shape = 3", "choose from triangle"),
    (POLYGON + "vertices_mm = 3", "probe.vertices_mm = 3", "must be a list"),
    (POLYGON + "vertices_mm = [[0, 0], [1, 0], [1, '']]", 'probe.vertices_mm[2][1] = ""', "number"),
    # choices
    ('[electrodes]\nlayout = "five"', 'electrodes.layout = "five"', "four, three, ring"),
    (RING + 'shape = "triangle"', 'electrodes.shape = "triangle"', "did you mean rectangle?"),
    (RING + "shape = 3", "electrodes.shape = 3", "choose from square, rectangle"),
    ('[probe]\nshape = "rectangl"', 'probe.shape = "rectangl"', "did you mean rectangle?"),
    (electrode(shape="triangle"), 'electrodes[0].shape = "triangle"', "did you mean rectangle?"),
    ('[load]\nkind = "ded"', 'load.kind = "ded"', "did you mean dead?"),
    ('[load]\nkind = "rigid"\ncontact = "glued"', 'load.contact = "glued"', "sliding, stuck"),
    ('[load]\ncontact = "stuck"', 'load.contact = "stuck"', 'kind = "rigid" only'),
    ('[numerics]\nobservable = "edge"', 'numerics.observable = "edge"', "thesis-edge"),
    # numbers
    ("[film]\nthickness_um = 0", "film.thickness_um = 0", "must be positive"),
    ("[film]\nthickness_um = 1e9", "film.thickness_um = 1000000000.0", "too large"),
    ("[probe]\nside_mm = 0", "probe.side_mm = 0", "must be positive"),
    ("[numerics]\ntolerance = 0.5", "numerics.tolerance = 0.5", "too large"),
    ("[numerics]\ntolerance = 1e-8", "numerics.tolerance = 1e-08", "too small"),
    ("[numerics]\nmax_unknowns = 99", "numerics.max_unknowns = 99", "from 100 to 1e+07 unknowns"),
    ("[numerics]\nmax_unknowns = 6e4", "numerics.max_unknowns = 60000.0", "a whole number"),
    ("[numerics]\nmax_seconds = 0.0", "numerics.max_seconds = 0.0", "must be positive"),
    ("[numerics]\nmax_seconds = 2e6", "numerics.max_seconds = 2000000.0", "too large"),
    ("[film]\npermittivity = 0.9", "film.permittivity = 0.9", "from 1 to 1e+06"),
    ("[film]\npretension_N_m = 2e6", "film.pretension_N_m = 2000000.0", "to 1e+06 N/m"),
    ('[film]\npretension_N_m = "9"', 'film.pretension_N_m = "9"', "must be a number"),
    ("[film]\npretension_N_m = [9]", "film.pretension_N_m[1] = (nothing)", "required"),
    ("[film]\npretension_N_m = [9, 8, 7]", "film.pretension_N_m = [9, 8, 7]", "at most 2"),
    ("[film]\npretension_N_m = [9, inf]", "film.pretension_N_m[1] = inf", "finite"),
    (
        "[film]\npretension_N_m = [9, 8]\ntemperature_change_K = -1",
        "film.temperature_change_K = -1",
        "stands beside film.pretension_N_m = [9.0, 8.0]; remove one of the two",
    ),
    # elasticity
    ("[film]\npoisson_ratio = 0.5", "film.poisson_ratio = 0.5", "[0, 0.5)"),
    ("[film]\npoisson_ratio = -0.1", "film.poisson_ratio = -0.1", "[0, 0.5)"),
    # the default 0.34 does not suit every pair
    ("[film]\nyoungs_modulus_GPa = [1, 10]", "film.poisson_ratio = 0.34", "below 0.316"),
    # electrodes
    ("electrodes = []", "electrodes = []", "at least 1"),
    ('[[electrodes]]\nname = "A"\ny_mm = 0', "electrodes[0].x_mm = (nothing)", "required"),
    ("[[electrodes]]\nx_mm = 0\ny_mm = 0", "electrodes[0].name = (nothing)", "required"),
    (electrode(shape="circle"), "electrodes[0].radius_mm = (nothing)", "required"),
    (electrode(""), 'electrodes[0].name = ""', "is no name"),
    (electrode(" A"), 'electrodes[0].name = " A"', "is no name"),
    (electrode("A\tB"), 'electrodes[0].name = "A\\tB"', "is no name"),
    (electrode("a/b"), 'electrodes[0].name = "a/b"', "simpler name"),
    (electrode() + electrode(x_mm=9), 'electrodes[1].name = "A"', "the name of electrodes[0]"),
    (electrode() + electrode("B", x_mm=2.9), "electrodes[1].x_mm = 2.9", "overlaps electrodes[0]"),
    ("[electrodes]\nring_radius_mm = 2", "electrodes.ring_radius_mm = 2.0", "A and B overlap"),
    ("[film]\nradius_mm = 0.045", "electrodes.ring_radius_mm = 10.0", "were 45 mm meant"),
    # lists as one table, and tables as lists
    ('[electrodes]\nname = "A"', 'electrodes.name = "A"', "begin each with [[electrodes]]"),
    ("[film.patches]\nx_mm = 1", "film.patches = a table", "begin each with [[film.patches]]"),
    ("[[load]]\nforce_N = 1", "load = [a table]", "must be one table; begin it with [load]"),
    # rings
    ("[electrodes]\ncount = 6", "electrodes.count = 6", 'is for layout = "ring" only'),
    (RING + "cout = 6", "electrodes.cout = 6", "did you mean count?"),
    (RING + "count = 0", "electrodes.count = 0", "must be positive"),
    (RING + "count = 26", "electrodes.count = 26", "from 1 to 25 electrodes"),
    (RING + "count = 6.0", "electrodes.count = 6.0", "a whole number"),
    (RING + "count = 24", "electrodes.ring_radius_mm = 10.0", "count or electrodes.side_mm small"),
    (RING + "centre = 1", "electrodes.centre = 1", "must be true or false"),
    (RING + "rotation_deg = 9", "electrodes.rotation_deg = 9", "is no key there"),
    (RING + 'shape = "circle"', "electrodes.radius_mm = (nothing)", "is required"),
    (
        RING + 'shape = "circle"\nradius_mm = 1\nside_mm = 3',
        "electrodes.side_mm = 3",
        "choose from layout, count, ring_radius_mm, first_angle_deg, centre, shape, radius_mm",
    ),
    (
        RING + 'shape = "ellipse"\nsemi_axes_mm = [2, 1e-3]',
        "electrodes.semi_axes_mm = [2, 0.001]",
        "is too thin",
    ),
    (
        RING + 'shape = "polygon"\nvertices_mm = [[0, 0], [1, 1], [1, 0], [0, 1]]',
        "electrodes.vertices_mm = [[0, 0], ",
        "crosses or touches",
    ),
    (
        RING + 'shape = "polygon"\nvertices_mm = [[0, 0], [1, 1], ["1", 0]]',
        'electrodes.vertices_mm[2][0] = "1"',
        "must be a number",
    ),
    (RING + "ring_radius_mm = 2\ncentre = true", "electrodes.ring_radius_mm = 2.0", "A and B over"),
    (
        RING + "ring_radius_mm = 2.5\ncount = 2\ncentre = true",
        "electrodes.ring_radius_mm = 2.5",
        "electrodes A and C overlap",
    ),
    (RING + "ring_radius_mm = 44", "electrodes.ring_radius_mm = 44.0", "over the rim"),
    (
        RING + 'shape = "circle"\nradius_mm = 1\n[numerics]\nobservable = "thesis-edge"',
        'electrodes.shape = "circle"',
        "thesis-edge",
    ),
    # over the rim
    ("[electrodes]\nring_radius_mm = 44", "electrodes.ring_radius_mm = 44.0", "over the rim"),
    (electrode(x_mm=-44), "electrodes[0].x_mm = -44.0", "over the rim at film.radius_mm = 45"),
    ("[probe]\ny_mm = 42", "probe.y_mm = 42.0", "over the rim at film.radius_mm = 45"),
    ("[probe]\nside_mm = 80", "probe.side_mm = 80.0", "make it smaller"),
    ('[probe]\nshape = "circle"\nradius_mm = 46', "probe.radius_mm = 46.0", "reaches 1 mm over"),
    # polygons
    (POLYGON, "probe.vertices_mm = (nothing)", "required"),
    (POLYGON + "vertices_mm = [[0, 0], [1, 0]]", "probe.vertices_mm = [[0, 0], ", "at least 3"),
    (
        POLYGON + "vertices_mm = [[0, 0], [1, 1], [1, 0], [0, 1]]",
        "probe.vertices_mm = [[0, 0], ",
        "crosses or touches",
    ),
    (
        POLYGON + "vertices_mm = [[0, 0], [1, 1], [2, 2]]",
        "probe.vertices_mm = [[0, 0], ",
        "on a line",
    ),
    (POLYGON + f"vertices_mm = [{1001 * '[0, 0],'}]", "probe.vertices_mm = [[0, 0], ", "1000"),
    # combinations
    (
        electrode(shape="circle", radius_mm=1) + '[numerics]\nobservable = "thesis-edge"',
        'electrodes[0].shape = "circle"',
        "thesis-edge",
    ),
    (
        electrode(rotation_deg=45) + '[numerics]\nobservable = "thesis-edge"',
        "electrodes[0].rotation_deg = 45.0",
        "multiple of 90",
    ),
    (
        '[probe]\nshape = "circle"\nradius_mm = 45\n[load]\nkind = "rigid"',
        'load.kind = "rigid"',
        "on the clamped rim",
    ),
]


@pytest.mark.parametrize(("text", "key_and_value", "advice"), REFUSALS)
def test_refusals_name_key_value_and_what_to_change(text, key_and_value, advice):
    (line,) = problems(text)
    head, reason = line.split(": ", maxsplit=1)
    assert key_and_value in head
    assert advice in reason


def test_all_mistakes_of_a_file_are_reported_at_once():
    text = """
        bogus = 1
        [film]
        thicknes_um = 30
        poisson_ratio = 0.7
        [[electrodes]]
        name = "A"
        x_mm = 0
        y_mm = 44
        [[electrodes]]
        name = "B"
        x_mm = "1"
        y_mm = 0
        [[electrodes]]
        name = "A"
        x_mm = 1
        y_mm = 44
        [probe]
        x_mm = 43
        [load]
        kind = "ded"
        force_N = -1
    """
    told = problems(text)
    assert [line.split(" = ")[0] for line in told] == [
        "film.poisson_ratio",
        "film.thicknes_um",
        "electrodes[1].x_mm",
        "load.kind",
        "load.force_N",
        "bogus",
        # and what is wrong between the parts that are valid by themselves
        "electrodes[0].y_mm",
        "electrodes[2].y_mm",
        "electrodes[2].name",
        "electrodes[2].x_mm",
        "probe.x_mm",
    ]


def test_a_broken_radius_hides_the_rim_but_not_the_overlaps():
    told = problems("[film]\nradius_mm = -1\n[probe]\nx_mm = 43\n[electrodes]\nring_radius_mm = 1")
    assert [line.split(" = ")[0] for line in told] == [
        "film.radius_mm",
        "electrodes.ring_radius_mm",
    ]


@pytest.mark.parametrize(
    "text",
    [
        '[probe]\nshape = "circle"\nradius_mm = 45',  # the whole film
        '[probe]\nshape = "rectangle"\nwidth_mm = 54\nheight_mm = 72',  # corners on the rim
        '[probe]\nshape = "circle"\nradius_mm = 15\nx_mm = 18\ny_mm = 24',
        electrode() + electrode("B", x_mm=3),
        electrode() + electrode("B", x_mm=0.3 + 2.7, y_mm=3),
        electrode(shape="circle", radius_mm=2) + electrode("B", x_mm=3.5),
    ],
)
def test_touching_is_allowed(text):
    Scene.parse(text)


@pytest.mark.parametrize(
    ("raw", "where"),
    [
        (b"[film]\nradius_mm == 45", "line 2"),
        (b"[film]\nradius_mm = 45\n[film]", "line 3"),
        (b"[film]\n# \xb5m", "line 2"),
        ("[film]".encode("utf-16"), "UTF-16"),
        (b"#" * 1_000_001, "more than 1000000"),
    ],
)
def test_unreadable_files_are_refused_with_path_and_line(tmp_path, raw, where):
    path = tmp_path / "scene.toml"
    path.write_bytes(raw)
    with pytest.raises(SceneError) as caught:
        Scene.load(path)
    (line,) = caught.value.problems
    assert str(path) in line
    assert where in line


@pytest.mark.parametrize("name", ["", "missing.toml", "null\0.toml"])
def test_paths_without_a_file_are_refused(tmp_path, name):
    path = tmp_path / name
    with pytest.raises(SceneError, match="cannot be read") as caught:
        Scene.load(path)
    assert str(path) in str(caught.value)


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("[load]\nforce_N = 2", encoding="utf-8-sig")
    assert Scene.load(str(path)).load.force == 2.0


RING = [[math.cos(t), math.sin(t)] for t in np.linspace(0, 6.28, 700).round(3)]
CATASTROPHES = {
    "deep lists": "x = " + "[" * 300_000,
    "deep lists, closed": "[load]\nforce_N = " + "[" * 300 + "]" * 300,
    "deep keys": ".".join("a" * 300_000) + " = 1",
    "deep quoted keys": " . ".join(['"a"'] * 100_000) + " = 1",
    "deep headings": "[" + ".".join("a" * 300_000) + "]",
    "deep inline keys": "x = {" + ".".join("a" * 300_000) + " = 1}",
    "decimal digits": "[load]\nforce_N = " + "1" * 900_000,
    "hexadecimal digits": "[load]\nkind = 0x" + "f" * 900_000,
    "long key": "[load]\n" + "k" * 900_000 + " = 1",
    "long text": '[load]\nkind = "' + "k" * 900_000 + '"',
    "many keys": "\n".join(f"k{i} = 1" for i in range(80_000)),
    "many vertices": POLYGON + "vertices_mm = [" + "['', 0]," * 100_000 + "]",
    "many electrodes": electrode() * 20_000,
    "many long outlines": "".join(
        electrode(f"E{i}", shape="polygon", vertices_mm=RING) for i in range(30)
    ),
}


@pytest.mark.parametrize("text", CATASTROPHES.values(), ids=CATASTROPHES.keys())
def test_catastrophic_files_are_refused_briefly(text):
    told = problems(text)
    assert len(told) <= 101
    assert max(map(len, told)) < 400


def test_an_unpaired_surrogate_is_refused_in_words_that_can_be_printed():
    with pytest.raises(SceneError) as caught:
        Scene().with_(electrodes=[{"name": "\ud800", "x_mm": 0, "y_mm": 0}])
    assert b"ud800" in str(caught.value).encode()
    assert len(caught.value.problems) == 1


def test_scene_error_survives_the_way_back_from_a_worker():
    with pytest.raises(SceneError) as caught:
        Scene.parse("[film]\nradius_mm = -1", "somewhere.toml")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert copy.problems == caught.value.problems
    assert str(copy) == str(caught.value)
    assert "somewhere.toml" in str(copy)
