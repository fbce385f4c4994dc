"""Scenes: defaults, SI values, changes and round trips."""

from __future__ import annotations

import itertools
import json
import math
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pvdf_fem.scene.scene import Film, Scene, SceneError
from pvdf_fem.scene.scene_file import write_toml
from pvdf_fem.sweeps.grid import Grid
from tests.helpers.strategies import electrode, scenes, tables

GEOMETRY = Path(__file__).parents[2] / "geometry"


# defaults and SI values


def test_empty_file_is_the_thesis_sensor_without_a_probe():
    scene = Scene.parse("")
    assert scene == Scene()
    assert scene.probe is None
    assert scene.film.radius == 0.045
    assert scene.film.thickness == 25e-6
    assert scene.film.density == 1760.0
    assert scene.film.strain_at_rest == pytest.approx(np.array([110e-6, 110e-6, 0.0]), rel=1e-15)
    assert (scene.film.d31, scene.film.d32) == (8e-12, 8e-12)
    assert scene.load.force == 1.0
    assert (scene.load.kind, scene.numerics.observable) == ("dead", "material")
    assert scene.numerics.tolerance == 1e-3


def test_an_empty_probe_table_is_the_thesis_triangle_at_the_centre():
    probe = Scene.parse("[probe]").probe
    assert probe is not None
    assert probe.outline.area == pytest.approx(49e-6 * math.sqrt(3) / 4)
    assert probe.outline.centroid == pytest.approx([0.0, 0.0], abs=1e-15)
    assert probe.outline.vertices[0] == pytest.approx([0.0, 7e-3 / math.sqrt(3)])


@pytest.mark.parametrize(
    ("layout", "centres_mm"),
    [
        ("four", {"A": (10, 0), "B": (0, 10), "C": (-10, 0), "D": (0, -10)}),
        ("three", {"A": (0, -10), "B": (75**0.5, 5), "C": (-(75**0.5), 5)}),
    ],
)
def test_layouts(layout, centres_mm):
    scene = Scene.parse(f'[electrodes]\nlayout = "{layout}"')
    assert [e.name for e in scene.electrode_list] == list(centres_mm)
    for e in scene.electrode_list:
        assert e.outline.centroid == pytest.approx(1e-3 * np.array(centres_mm[e.name]), abs=1e-15)
        offsets = np.abs(e.outline.vertices - e.outline.centroid)
        assert offsets == pytest.approx(1.5e-3, rel=1e-12)  # edges along x and y


def test_a_ring_without_further_keys_is_the_layout_four():
    ring = Scene.parse('[electrodes]\nlayout = "ring"')
    assert ring.electrode_list == Scene().electrode_list


def test_electrodes_of_a_ring():
    text = '[electrodes]\nlayout = "ring"\ncount = 6\nfirst_angle_deg = 30\ncentre = true\n'
    scene = Scene.parse(text + 'shape = "rectangle"\nwidth_mm = 4\nheight_mm = 2')
    assert [e.name for e in scene.electrode_list] == list("ABCDEFG")
    angles = np.radians([30, 90, 150, 210, 270, 330])
    expected = np.vstack([10.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1), [[0, 0]]])
    places = [[e.x_mm, e.y_mm] for e in scene.electrode_list]
    assert places == pytest.approx(expected, abs=1e-14)
    for e in scene.electrode_list:  # none is turned
        offsets = np.abs(e.outline.vertices - e.outline.centroid)
        assert offsets == pytest.approx(np.tile([2e-3, 1e-3], (4, 1)), rel=1e-9)


def test_isotropic_stiffness():
    E, nu = 2e9, 0.34
    m = 1 - nu**2
    expected = [[E / m, nu * E / m, 0], [nu * E / m, E / m, 0], [0, 0, E / (2 * (1 + nu))]]
    assert Film().stiffness == pytest.approx(np.array(expected))


def test_orthotropic_compliance():
    film = Film(youngs_modulus_GPa=(2, 1), poisson_ratio=0.3, shear_modulus_GPa=0.5)
    compliance = [[1 / 2e9, -0.3 / 2e9, 0], [-0.3 / 2e9, 1 / 1e9, 0], [0, 0, 1 / 0.5e9]]
    assert np.linalg.inv(film.stiffness) == pytest.approx(np.array(compliance))


def test_shear_modulus_of_huber_is_isotropic_for_equal_moduli():
    pair = Film(youngs_modulus_GPa=(2.0, 2.0))
    assert pair.stiffness == pytest.approx(Film().stiffness)
    # by hand: sqrt(4 * 1) / (2 (1 + sqrt(0.4 * 0.1)))
    film = Film(youngs_modulus_GPa=(4, 1), poisson_ratio=0.4)
    assert film.stiffness[2, 2] == pytest.approx(2e9 / 2.4)


@given(scene=scenes())
def test_every_stiffness_is_positive_definite(scene):
    assert np.linalg.eigvalsh(scene.film.stiffness).min() > 0


def test_polygon_vertices_are_relative_to_its_place_and_turned_about_it():
    probe = Scene.parse(
        '[probe]\nshape = "polygon"\nx_mm = 5\nrotation_deg = 90\n'
        "vertices_mm = [[1, 0], [3, 0], [3, 1]]"
    ).probe
    assert probe is not None
    expected = {(5.0, 1.0), (5.0, 3.0), (4.0, 3.0)}
    assert {tuple(v) for v in (probe.outline.vertices * 1e3).round(12)} == expected


def test_files_of_the_geometry_folder():
    others = {"mapping_lines", "thickness_spacing", "report"}
    grid = Grid.load(GEOMETRY / "thickness_spacing.toml")
    ends = [
        replace(axis, values={key: (along[0], along[-1]) for key, along in axis.values.items()})
        for axis in grid.axes
    ]
    assert len(replace(grid, axes=tuple(ends)).scenes()) == 2**4
    paths = [path for path in GEOMETRY.glob("*.toml") if path.stem not in others]
    found = {path.stem: Scene.example(path.stem) for path in paths}
    assert found["triangle"] == Scene.load(GEOMETRY / "triangle.toml")
    assert found["four_electrodes"] == Scene()
    assert [e.name for e in found["three_electrodes"].electrode_list] == ["A", "B", "C"]
    assert found["uniaxial"].film.d31 == 18e-12
    assert found["uniaxial"].film.d32 == 2e-12
    areas = {n: s.probe.outline.area for n, s in found.items() if s.probe is not None}
    assert areas == pytest.approx(
        {
            "triangle": 49e-6 * math.sqrt(3) / 4,
            "rectangle": 98e-6,
            "disc": math.pi * 1e-6,
            "uniaxial": 98e-6,
            "ring": math.pi * 4e-6,
            "sphere": math.pi * 25e-6,
        }
    )
    assert found["triangle"].probe.outline.centroid == pytest.approx([5.0714e-3, 0.8757e-3])


@pytest.mark.parametrize(
    ("name", "told"),
    [("triangel", "did you mean triangle?"), ("mapping_lines", "choose from disc, four_electr")],
)
def test_what_is_no_example_scene_is_refused_with_those_there_are(name, told):
    with pytest.raises(SceneError, match=f'"{name}": is no example; {re.escape(told)}'):
        Scene.example(name)


def test_scenes_built_directly_are_checked_too():
    with pytest.raises(SceneError, match="over the rim"):
        Scene(film=Film(radius_mm=11.0))
    with pytest.raises(SceneError) as caught:
        Scene(film={"thickness_um": -1, "thicknes": 2}, probe=Scene().electrode_list[0])
    thickness, unknown, shape = caught.value.problems
    assert thickness.startswith("film.thickness_um = -1: must be positive; give")
    assert unknown.startswith("film.thicknes = 2: is no key there; did you mean")
    assert shape.startswith('probe.shape = "square": is not known; choose from triangle')
    assert Scene(film={"thickness_um": 9}).film.thickness_um == 9.0


@pytest.mark.parametrize(
    ("text", "doubt"),
    [
        ("[load]\nforce_N = 2.0", "nothing presses, since there is no probe"),
        ("[film]\nd31_pC_N = 23e-12", "were 23 pC/N meant, which are 2.3e-11 C/N?"),
        ("[film]\nd33_pC_N = -30e-12", "film.d33_pC_N = -3e-11: is in pC/N; were -30 pC/N meant"),
        ("[film]\nthickness_um = 0.04", "were 40 µm meant, which are 0.04 mm?"),
        (
            "[film]\nradius_mm = 0.045\n[electrodes]\nring_radius_mm = 0.01\nside_mm = 0.003",
            "were 45 mm meant, which are 0.045 m?",
        ),
        ('[probe]\nshape = "circle"\n[load]\nforce_N = 500.0', "were 4.9 N meant"),
        ("[film]\nd31_pC_N = 0.0\nthickness_um = 0.5", None),
        ('[probe]\nshape = "circle"\n[load]\nforce_N = 2.0', None),
    ],
)
def test_doubts_ask_what_was_meant(text, doubt):
    doubts = Scene.parse(text).doubts
    assert len(doubts) == (doubt is not None)
    assert all(doubt in told for told in doubts)


def test_scenes_are_frozen():
    scene = Scene()
    with pytest.raises(AttributeError):
        scene.film = Film()
    with pytest.raises(AttributeError):
        scene.film.radius_mm = 1.0
    assert scene in {Scene()}


# changes


def test_with_changes_dotted_keys_and_leaves_the_scene_alone():
    scene = Scene()
    other = scene.with_(**{"load.force_N": 2, "film.radius_mm": np.float64(40), "probe.x_mm": 1})
    assert (other.load.force, other.film.radius) == (2.0, 0.04)
    assert other.probe is not None
    assert (other.probe.shape, other.probe.x_mm) == ("triangle", 1.0)
    assert scene == Scene()


@pytest.mark.parametrize("key", ["electrodes.1.x_mm", "electrodes[1].x_mm"])
def test_with_reaches_into_the_list_of_electrodes(key):
    scene = Scene.parse(electrode() + electrode("B", x_mm=9))
    assert [e.x_mm for e in scene.with_(**{key: np.int64(5)}).electrode_list] == [0.0, 5.0]


def test_with_replaces_and_removes_sections():
    scene = Scene.load(GEOMETRY / "triangle.toml")
    assert scene.with_(probe=None) == Scene()
    assert Scene().with_(probe=scene.probe) == scene
    assert scene.with_(electrodes=scene.electrode_list).electrode_list == scene.electrode_list


def test_with_a_new_shape_drops_the_sizes_of_the_old_one():
    scene = Scene.load(GEOMETRY / "triangle.toml")
    for changes in ({"probe.radius_mm": 2.0}, {"probe.shape": "circle"}):
        changes |= {"probe.shape": "circle"}
        probe = scene.with_(**changes).probe
        assert probe is not None
        assert probe.outline.radius == changes.get("probe.radius_mm", 1.0) / 1e3
        assert (probe.x_mm, probe.y_mm) == (5.0714, 0.8757)


def test_with_another_kind_of_load_drops_the_contact():
    stuck = Scene().with_(**{"load.kind": "rigid", "load.contact": "stuck"})
    assert stuck.load.contact == "stuck"
    assert stuck.with_(**{"load.kind": "dead"}) == Scene()
    assert Scene().with_(**{"load.kind": "rigid"}).load.contact == "sliding"
    with pytest.raises(SceneError, match=r'load\.contact = "stuck"'):
        stuck.with_(**{"load.kind": "dead", "load.contact": "stuck"})


def test_with_reports_all_mistakes():
    changes = {
        "load.force": 2.0,
        "film.radius_mm.x": 1,
        "electrodes.0.x_mm": 1.0,
        "probe.side_mm": -1,
        "": 1,
    }
    with pytest.raises(SceneError) as caught:
        Scene().with_(**changes)
    assert {line.split(" = ")[0] for line in caught.value.problems} == {
        "load.force",
        "film.radius_mm.x",
        "electrodes.0.x_mm",
        "probe.side_mm",
        '""',
    }


@pytest.mark.parametrize("key", ["electrodes.2.x_mm", "electrodes.2", "electrodes.-1"])
def test_with_refuses_electrodes_that_are_not_there(key):
    scene = Scene.parse(electrode() + electrode("B", x_mm=9))
    with pytest.raises(SceneError, match="leads nowhere"):
        scene.with_(**{key: 5.0})


def test_limits_that_are_not_given_stay_out_of_files_and_keys():
    scene = Scene()
    assert scene.numerics.max_unknowns is None
    assert scene.numerics.max_seconds is None
    assert "max_" not in scene.to_toml()
    limited = scene.with_(**{"numerics.max_unknowns": np.int64(200_000), "numerics.max_seconds": 9})
    assert (limited.numerics.max_unknowns, limited.numerics.max_seconds) == (200_000, 9.0)
    assert "max_unknowns = 200000\nmax_seconds = 9.0\n" in limited.to_toml()
    assert limited.with_(**{"numerics.max_unknowns": None, "numerics.max_seconds": None}) == scene


# round trips


@given(scene=scenes())
@settings(deadline=None)
def test_toml_and_json_round_trips(scene):
    assert Scene.parse(scene.to_toml()) == scene
    assert Scene.model_validate_json(scene.model_dump_json()) == scene
    assert scene.with_() == scene
    assert pickle.loads(pickle.dumps(scene)) == scene


@given(table=tables(), data=st.data())
@settings(deadline=None)
def test_a_file_equals_its_changes_from_the_default(table, data):
    """Every key set by `with_`, in any order, makes the scene of the file, with the same JSON."""
    pairs = {
        f"{section}.{key}": value
        for section, keys in table.items()
        if isinstance(keys, dict)
        for key, value in keys.items()
    }
    if isinstance(table["electrodes"], list):
        pairs["electrodes"] = table["electrodes"]
    shuffled = dict(data.draw(st.permutations(list(pairs.items()))))
    scene = Scene.parse(write_toml(table))
    assert Scene().with_(**shuffled) == scene
    assert Scene().with_(**shuffled).model_dump_json() == scene.model_dump_json()


def test_json_is_canonical():
    texts = ["", "[film]\nradius_mm = 45", "[load]\nforce_N = 1.0\n[film]\nradius_mm = 45.0"]
    assert len({Scene.parse(text).model_dump_json() for text in texts}) == 1
    minus = Scene.parse("[probe]\nx_mm = -0.0")
    assert minus.model_dump_json() == Scene.parse("[probe]").model_dump_json()
    assert json.loads(Scene().model_dump_json())["film"]["radius_mm"] == 45.0


@given(scene=scenes())
@settings(deadline=None)
def test_electrodes_of_valid_scenes_lie_inside_and_apart(scene):
    outlines = [e.outline for e in scene.electrode_list]
    assert max(o.reach for o in outlines) <= scene.film.radius
    for a, b in itertools.combinations(outlines, 2):
        # shapely's discs are inscribed polygons, so they do not overlap either
        assert a.shape.intersection(b.shape).area <= 1e-9 * min(a.area, b.area)


def test_scenes_are_read_without_the_solver():
    code = (
        "import sys, pvdf_fem.scene.scene;"
        "print({'gmsh', 'skfem', 'scipy', 'matplotlib'} & {m.split('.')[0] for m in sys.modules})"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=GEOMETRY.parent,
    )
    assert done.stdout.strip() == "set()"
