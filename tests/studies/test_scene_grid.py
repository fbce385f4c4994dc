"""Grids of scenes: sweep files and tables of axes, and all of their errors at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.scene.scene_file import quote
from pvdf_fem.studies.scene_grid import SceneGrid
from pvdf_fem.studies.sweep_axis import RESERVED_NAMES
from tests.helpers.refusals import refused

GEOMETRY = Path(__file__).parents[2] / "geometry"
BASE = Scene().with_(**{"probe.shape": "triangle"})
THREE = BASE.with_(**{"electrodes.layout": "three"})
FORCE = {"load.force_N": [1]}
#: The table of a mapping with 16,000 places.
LINES = {"electrode": "A", "angles_deg": list(range(2000))}


def find_axis_errors(axes) -> list[str]:
    """Return keys and values of the errors in axes."""
    return refused(lambda: SceneGrid.from_tables(BASE, axes).scenes())


def test_axes_are_lists_or_ranges_and_the_last_varies_fastest():
    forces = {"start": 0.1, "stop": 10.0, "count": 3, "spacing": "log"}
    grid = SceneGrid.from_tables(
        BASE,
        [
            {"film.thickness_um": [9, 110.0]},
            {"load": {"force_N": forces}, "name": "F"},
            {"probe.x_mm": {"start": 0, "stop": 1, "count": 5}, "probe.y_mm": np.arange(5.0)},
        ],
    )
    assert grid.shape == (2, 3, 5)
    assert [axis.name for axis in grid.axes] == ["thickness_um", "F", "x_mm"]
    scenes = grid.scenes()
    assert len(scenes) == 30
    assert [scene.film.thickness_um for scene in scenes[::15]] == [9.0, 110.0]
    assert [scene.load.force_N for scene in scenes[:15:5]] == pytest.approx([0.1, 1.0, 10.0])
    places = [(scene.probe.x_mm, scene.probe.y_mm) for scene in scenes[:5]]
    assert places == [(0.0, 0.0), (0.25, 1.0), (0.5, 2.0), (0.75, 3.0), (1.0, 4.0)]


def test_a_mapping_scheme_is_an_axis_of_places_on_lines_from_an_electrode():
    lines = {"electrode": "A", "angles_deg": [90, 35], "distances_mm": [0, 4, 8], "reach_mm": 10}
    (axis,) = SceneGrid.from_tables(THREE, [{"mapping": lines}]).axes
    c = np.cos(np.radians(35.0))
    s = np.sin(np.radians(35.0))
    # The last place on the slanting line is 10.03 mm from the film's centre.
    vertical = [[0, -10], [0, -6], [0, -2]]
    slanting = [[0, -10], [4 * c, -10 + 4 * s], [8 * c, -10 + 8 * s]]
    places = np.transpose([axis.values["probe.x_mm"], axis.values["probe.y_mm"]])
    assert places == pytest.approx(np.array(vertical + slanting), abs=1e-9)
    assert axis.extra_coordinates["angle_deg"] == (90.0,) * 3 + (35.0,) * 3
    assert axis.extra_coordinates["distance_mm"] == pytest.approx([0.0, 4.0, 8.0] * 2)


def test_places_beyond_the_reach_are_left_out():
    """On the line sideways only the electrode's centre is within the reach."""
    lines = {
        "electrode": "A",
        "angles_deg": [0, 90],
        "distances_mm": [0, 4, 8],
        "reach_mm": 10,
    }
    (axis,) = SceneGrid.from_tables(THREE, [{"mapping": lines}]).axes
    assert axis.extra_coordinates["angle_deg"] == (0.0, 90.0, 90.0, 90.0)
    assert SceneGrid.from_file(GEOMETRY / "mapping_lines.toml").shape == (21, 2, 2)


def test_the_scene_of_a_sweep_file_is_beside_it(tmp_path):
    (tmp_path / "scene.toml").write_text("[load]\nforce_N = 3.0\n[probe]\n")
    text = 'scene = "scene.toml"\n[[axes]]\nfilm.thickness_um = [9, 25]\n'
    (tmp_path / "sweep.toml").write_text(text)
    scenes = SceneGrid.from_file(tmp_path / "sweep.toml").scenes()
    values = [(scene.load.force_N, scene.film.thickness_um) for scene in scenes]
    assert values == [(3.0, 9.0), (3.0, 25.0)]


WRONG_AXES = """
scen = 3
[[axes]]
load.force_N = { start = 0, stop = 1, count = 3, spacing = "log" }
[[axes]]
load.force_N = { start = 1, stop = 2, cuont = 3 }
[[axes]]
probe.x_mm = 3
[[axes]]
probe = { x_mm = [1, 2], y_mm = [1, 2, 3] }
[[axes]]
mapping = { electrode = "Z", angles_deg = [0] }
[[axes]]
mapping = { electrode = "A", angles = [0] }
[[axes]]
mapping = { electrode = "A", angles_deg = [0] }
[[axes]]
name = "empty"
"""
#: Errors beside those of the axes, by scene: lines are only placed on a scene without errors.
SCENE_ERRORS = {
    "{}": ["axes[4].mapping.electrode 'Z'", "axes[6].mapping.scene"],
    "{ film = { radius_mm = -1 } }": ["film.radius_mm = -1"],
}


@pytest.mark.parametrize("scene", SCENE_ERRORS)
def test_all_errors_of_a_file_are_reported_at_once(scene, tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(f"scene = {scene}{WRONG_AXES}")
    expected = [
        *SCENE_ERRORS[scene],
        "scen = 3",
        "axes[0].load.force_N.start = 0.0",
        "axes[1].load.force_N.count",
        "axes[1].load.force_N.cuont = 3",
        "axes[2].probe.x_mm = 3",
        "axes[3]",
        "axes[5].mapping.angles_deg",
        "axes[5].mapping.angles = [0]",
        "axes[7]",
    ]
    assert sorted(refused(SceneGrid.from_file, path)) == sorted(expected)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[[axes]]\nload.force_N = [1]", "scene"),
        ('scene = "none.toml"\n[[axes]]\nload.force_N = [1]', "none.toml"),
        ("scene = {}\n[axes]\nload.force_N = [1]", "axes"),
        ("x =", "sweep.toml"),
    ],
)
def test_a_file_needs_a_scene_and_a_list_of_axes(text, key, tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    [error] = refused(SceneGrid.from_file, path)
    assert key in error


@pytest.mark.parametrize(
    ("axes", "key"),
    [
        ([], "axes"),
        ([FORCE, {"load.force_N": [2]}], 'axes[1] = "load.force_N"'),
        ([{"load.force_N": list(range(2000))}, {"film.d31_pC_N": list(range(2000))}], "axes"),
        ([{**FORCE, "name": "x_mm"}, {"load.kind": ["dead"], "name": "x_mm"}], "axes"),
        ([{**FORCE, "name": "angle_deg"}, {"mapping": LINES}], 'axes[0].name = "angle_deg"'),
        ([{"electrodes[0].x_mm": [9], "electrodes.0.x_mm": [8]}], "axes[0].electrodes.0.x_mm"),
        ([{"electrodes[0].x_mm": [9]}, {"electrodes.00.x_mm": [8], "name": "b"}], "axes[1]"),
        ([{"probe": [{"x_mm": 1}]}, {"probe.x_mm": [2]}], 'axes[1] = "probe.x_mm"'),
        ([{"probe": [{}], "probe.x_mm": [1]}, {"probe": [{}], "name": "b"}], "axes[1]"),
        ([{"mapping": {**LINES, "distances_mm": list(range(500_000))}}], "axes[0].mapping"),
        ([{"mapping": {"electrode": "A", "angles_deg": [0]}, **FORCE}], "axes[0].load.force_N"),
        ([{"mapping": {**LINES, "distances_mm": [4, 4]}}], "axes[0].mapping.distances_mm"),
        ([{"mapping": {**LINES, "distances_mm": [12]}}], "axes[0].mapping.angles_deg 0"),
        ([{**FORCE, "name": f"n{i}"} for i in range(64)], "axes = 64"),
    ],
)
def test_axes_that_conflict_are_rejected(axes, key):
    assert any(error.startswith(key) for error in find_axis_errors(axes))


@pytest.mark.parametrize(
    "name",
    [*sorted(RESERVED_NAMES), "a/b", "it's", "int", "string7", "-a", "a ", "e\u0301", 61 * "a"],
)
def test_names_that_a_file_cannot_hold_are_rejected(name):
    axes = [{"load.force_N": [1.0]}, {"film.d31_pC_N": [8.0], "name": name}]
    assert find_axis_errors(axes) == [f"axes[1].name = {quote(name)}"]


def test_tables_may_vary_beside_keys_that_they_do_not_have():
    probes = [{"shape": "triangle"}, {"shape": "circle", "radius_mm": 2.0}]
    scenes = SceneGrid.from_tables(BASE, [{"probe": probes}, {"probe.x_mm": [0.0, 3.0]}]).scenes()
    values = [(scene.probe.shape, scene.probe.x_mm) for scene in scenes[1:3]]
    assert values == [("triangle", 3), ("circle", 0)]


def test_equal_errors_of_several_scenes_are_reported_once():
    axes = [{"electrodes.ring_radius_mm": [1, 10, 50]}, {"load.force_N": [1, 2]}]
    assert len(find_axis_errors(axes)) == 2
