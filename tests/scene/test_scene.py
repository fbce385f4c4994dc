"""Scenes: defaults, SI values, examples, and what is no matter of a solve."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem.batch.keys import make_record_key
from pvdf_fem.problem.equivalence import MECHANICAL_EFFECTS
from pvdf_fem.scene.keys import select_by_effect
from pvdf_fem.scene.scene import Film, Scene
from pvdf_fem.scene.scene_file import quote
from pvdf_fem.scene.stage import Stage
from pvdf_fem.studies.scene_grid import SceneGrid
from tests.helpers.refusals import refused

GEOMETRY = Path(__file__).parents[2] / "geometry"


def test_empty_file_is_the_thesis_sensor_without_a_probe():
    scene = Scene.parse("")
    assert scene == Scene()
    assert scene.probe is None
    film = scene.film
    assert (film.radius, film.thickness, film.density) == (0.045, 25e-6, 1760.0)
    assert film.prestrain == pytest.approx(np.array([110e-6, 110e-6, 0.0]), rel=1e-15)
    assert (film.d31, film.d32) == (8e-12, 8e-12)
    assert (scene.load.force, scene.load.kind) == (1.0, "dead")
    assert (scene.numerics.tolerance, scene.numerics.observable) == (1e-3, "material")
    assert Scene.parse("[probe]").probe.outline.area == pytest.approx(49e-6 * math.sqrt(3) / 4)
    assert "max_" not in scene.to_toml()


def test_electrodes_of_a_ring():
    ring = {"layout": "ring", "count": 3, "first_angle_deg": 270.0}
    of_layouts = [Scene(electrodes={"layout": name}).electrode_list for name in ("ring", "three")]
    assert of_layouts == [Scene(electrodes=e).electrode_list for e in ({"layout": "four"}, ring)]
    table = {**ring, "shape": "rectangle", "width_mm": 4.0, "height_mm": 2.0}
    scene = Scene(electrodes={**table, "count": 6, "first_angle_deg": 30.0, "centre": True})
    assert [e.name for e in scene.electrode_list] == list("ABCDEFG")
    places = np.array([complex(e.x_mm, e.y_mm) for e in scene.electrode_list])
    expected = [*(10.0 * np.exp(1j * np.radians([30, 90, 150, 210, 270, 330]))), 0.0]
    assert places == pytest.approx(np.array(expected), abs=1e-14)
    for e in scene.electrode_list:  # none is turned
        offsets = np.abs(e.outline.vertices - e.outline.centroid)
        assert offsets == pytest.approx(np.tile([2e-3, 1e-3], (4, 1)), rel=1e-9)


@pytest.mark.parametrize(
    ("film", "constants"),
    [
        (Film(), (2e9, 2e9, 0.34, 1e9 / 1.34)),
        (Film(shear_modulus_GPa=0.5), (2e9, 2e9, 0.34, 0.5e9)),
        # Huber's by hand: sqrt(4 * 1) / (2 (1 + sqrt(0.4 * 0.1)))
        (Film(youngs_modulus_GPa=(4, 1), poisson_ratio=0.4), (4e9, 1e9, 0.4, 2e9 / 2.4)),
    ],
)
def test_stiffness_is_the_inverse_of_the_compliance(film, constants):
    E1, E2, nu, G = constants
    compliance = [[1 / E1, -nu / E1, 0], [-nu / E1, 1 / E2, 0], [0, 0, 1 / G]]
    assert np.linalg.inv(film.stiffness) == pytest.approx(np.array(compliance))


def test_loads_on_the_whole_film_add_up():
    film = Film(pressure_Pa=100.0, gravity_m_s2=-1000.0)
    weight_Pa = -1000.0 * 1760.0 * 25e-6
    assert film.distributed_force == pytest.approx(abs(100.0 + weight_Pa) * math.pi * 0.045**2)
    assert Film().is_flat_unloaded
    assert not film.is_flat_unloaded


@pytest.mark.parametrize(
    ("keys", "alpha", "cooled"),
    [
        ({}, 110e-6, 0.0),
        ({"bonded": "before stretching"}, 110e-6, 2.0),
        ({"bonded": "before stretching", "thermal_expansion_per_K": 1e-5}, 1e-5, 2.0),
    ],
)
def test_the_prestrain_of_a_layer_follows_bonding_and_warming(keys, alpha, cooled):
    patch = {"x_mm": 0.0, "y_mm": 0.0, "thickness_um": 9.0, "youngs_modulus_GPa": 2.0, **keys}
    film = Film(patches=[patch], temperature_change_K=-2.0, warming_K=0.5)
    [layer] = film.layers.values()
    expected = [alpha * (cooled - 0.5), alpha * (cooled - 0.5), 0.0]
    assert layer.prestrain == pytest.approx(np.array(expected), rel=1e-12)
    assert layer.stiffness == pytest.approx(film.stiffness, rel=1e-12)
    assert (layer.density, layer.expansion) == (film.density, alpha)


def test_rim_displacement_extends_into_the_film_as_harmonics():
    """A point (x, y) moves by g (x, y), with g = c0 + r (c1 cos t + s1 sin t) + r^2 (...)."""
    radius, coefficients = 0.045, (3.0, 1.0, -2.0, 0.5, 0.25)
    places = np.random.default_rng(4).uniform(-0.03, 0.03, (9, 2))

    def moved(places):
        r, t = np.linalg.norm(places, axis=1) / radius, np.arctan2(places[:, 1], places[:, 0])
        first = r * (1.0 * np.cos(t) - 2.0 * np.sin(t))
        second = r**2 * (0.5 * np.cos(2 * t) + 0.25 * np.sin(2 * t))
        return 1e-6 * (3.0 + first + second)[:, None] * places / radius

    steps = 1e-7 * np.eye(2)
    along_x, along_y = ((moved(places + h) - moved(places - h)) / 2e-7 for h in steps)
    strain = [along_x[:, 0], along_y[:, 1], along_x[:, 1] + along_y[:, 0]]
    found = Film(rim_displacement_um=coefficients).compute_rim_strain(places)
    assert found == pytest.approx(np.transpose(strain), rel=1e-6, abs=1e-9)


def test_polygon_vertices_are_relative_to_its_place_and_rotated_about_it():
    table = {"shape": "polygon", "vertices_mm": [[1, 0], [3, 0], [3, 1]]}
    probe = Scene(probe={**table, "x_mm": 5.0, "rotation_deg": 90.0}).probe
    expected = {(5.0, 1.0), (5.0, 3.0), (4.0, 3.0)}
    assert {tuple(v) for v in (probe.outline.vertices * 1e3).round(12)} == expected


def test_files_of_the_geometry_folder():
    grid = SceneGrid.from_file(GEOMETRY / "thickness_spacing.toml")
    ends = [
        replace(axis, values={key: (along[0], along[-1]) for key, along in axis.values.items()})
        for axis in grid.axes
    ]
    assert len(replace(grid, axes=tuple(ends)).scenes()) == 2**4
    others = {"mapping_lines", "thickness_spacing", "report", "triangel"}
    for name in {path.stem for path in GEOMETRY.glob("*.toml")} - others:
        assert Scene.example(name) == Scene.from_file(GEOMETRY / f"{name}.toml")
    assert Scene.example("four_electrodes") == Scene()
    for name in others:
        assert refused(Scene.example, name) == [f'"{name}"']


def test_a_load_without_a_probe_gives_a_warning():
    [warning] = Scene.parse("[load]\nforce_N = 500.0").warnings
    assert warning.startswith("load: ")
    assert Scene.parse("[film]\nd31_pC_N = 0.0\n[probe]\n[load]\nforce_N = 2.0").warnings == ()


def test_equal_scenes_have_equal_texts():
    texts = ["", "[film]\nradius_mm = 45", "[load]\nforce_N = 1.0\n[film]\nradius_mm = 45.0"]
    assert len({Scene.parse(text).model_dump_json() for text in texts}) == 1
    minus = Scene.parse("[probe]\nx_mm = -0.0")
    assert minus.model_dump_json() == Scene.parse("[probe]").model_dump_json()
    assert json.loads(Scene().model_dump_json())["film"]["radius_mm"] == 45.0


def test_readout_stage_and_model_do_not_affect_a_solve():
    readout = {"kind": {"A": "voltage"}, "input_resistance_MOhm": 1.0, "gain": {"B": 0.97}}
    readout |= {"range_V": {"A": 5.0, "C": [-0.1, 3.3]}, "mains_Hz": 60.0, "settling_s": 2.0}
    scene = Scene(readout=readout, stage={"x_mm": 0.4}, model={"tolerance": "auto"})
    scene = scene.with_(uncertain={"film.thickness_um": "5.5 %", "load.force_N": 0.1})
    assert scene != scene.with_(**{"readout.gain.B": 0.96})
    assert scene != scene.with_(**{"readout.range_V.A": 4.0})
    assert scene.model.tolerance is None
    assert make_record_key(scene) == make_record_key(Scene())
    assert select_by_effect(scene, *MECHANICAL_EFFECTS) == select_by_effect(
        Scene(), *MECHANICAL_EFFECTS
    )


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("range_V", 5.0),
        ("range_V", [-0.1, 3.3]),
        ("range_V", {"A": 5.0, "D": [0.0, 4.5]}),
        ("mains_Hz", 0.0),
        ("mains_Hz", 49.98),
        ("settling_s", 2.0),
    ],
)
def test_keys_of_streams_and_ranges_survive_files_and_are_written_only_if_given(key, value):
    scene = Scene(readout={key: value})
    assert json.loads(scene.model_dump_json())["readout"][key] == value
    for again in (Scene.parse(scene.to_toml()), Scene.model_validate_json(scene.model_dump_json())):
        assert (again, hash(again)) == (scene, hash(scene))
    default = scene.with_(readout={key: type(scene.readout).model_fields[key].default})
    assert default == Scene(readout={})
    for text in (default.model_dump_json(), default.to_toml()):
        assert key not in text


def test_the_films_centre_and_axes_on_the_stage():
    stage = Stage(x_mm=1.0, y_mm=2.0, rotation_deg=90.0)
    places, rotations = stage.to_stage([[0.0, 0.0], [10.0, 0.0]], [0.0, 5.0])
    np.testing.assert_allclose(places, [[1.0, 2.0], [1.0, 12.0]], atol=1e-12)
    assert rotations.tolist() == [90.0, 95.0]
    np.testing.assert_allclose(stage.to_film(places, rotations)[0], [[0, 0], [10, 0]], atol=1e-12)


def test_values_in_messages_are_shortened_where_they_are_nested_deeply():
    assert quote([[[1, "a"]]]) == '[[[1, "a"]]]'
    assert quote([[[[1]]], 2]) == "[[[[...]]], 2]"
