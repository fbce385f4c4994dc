"""Input decks: their loads, their limits, and that they are read back."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.files import FileError
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.problem.problem import Problem
from pvdf_fem.studies.decks.deck_mesh import make_straight_mesh
from pvdf_fem.view.deck.deck_file import InputDeck
from pvdf_fem.view.deck.deck_loads import compute_deck_loads
from pvdf_fem.view.deck.deck_reader import read_deck_grid
from pvdf_fem.view.deck.deck_scene import find_scene_difference, format_scene_comments
from pvdf_fem.view.deck.dialect import DIALECTS
from pvdf_fem.view.files.mesh_grid import MeshGrid
from tests.helpers.discs import uniform_mesh
from tests.validation.calculix import SCENES

TRIANGLE = SCENES["dead triangle"]
TWO = [{"shape": "circle", "x_mm": 0, "y_mm": 4, "radius_mm": 2}]
TWO += [{"shape": "square", "side_mm": 3, "x_mm": 5, "y_mm": 4, "force_N": 0.5}]


def make_deck(scene: Scene, program: str = "calculix") -> InputDeck:
    grid = MeshGrid.from_mesh(uniform_mesh(scene, 4.0), order=1)
    grid = grid.with_patches({name: grid.patches[name] for name in collect_outlines(scene)})
    loads = compute_deck_loads(Problem.from_scene(scene), make_straight_mesh(grid))
    return InputDeck(scene, grid, loads, DIALECTS[program])


def read_areas(grid: MeshGrid) -> np.ndarray:
    corners = grid.points[grid.triangles]
    return 0.5 * np.linalg.det(corners[:, 1:] - corners[:, :1])


@pytest.mark.parametrize("profile", ["uniform", "gaussian"])
def test_dead_forces_add_up_to_the_force_at_its_centroid(profile):
    scene = TRIANGLE.with_(**{"load.profile": profile, "load.tangential_N": [0.2, -0.1]})
    deck = make_deck(scene)
    assert not deck.loads.pressures.any()
    np.testing.assert_allclose(deck.loads.forces.sum(axis=0), [0.2, -0.1, 1.0], rtol=1e-12)
    place = deck.loads.forces[:, 2] @ deck.grid.points
    np.testing.assert_allclose(1e3 * place, [5.0714, 0.8757], atol=1e-4)


def test_pressures_on_the_same_elements_are_added():
    """CalculiX takes only the last of two pressures on an element."""
    film = {"pressure_Pa": 200.0, "pressure_follows": True}
    scene = TRIANGLE.with_(film=film, probe=TWO, load={"kind": "follower", "force_N": 1.0})
    deck = make_deck(scene)
    areas = read_areas(deck.grid)
    total = 200.0 * areas.sum() + 1.5
    assert deck.loads.pressures @ areas == pytest.approx(total, rel=1e-10)
    assert not deck.loads.forces.any()
    text = deck.format()
    assert text.count("*DLOAD\n") == len(np.unique(deck.loads.pressures)) == 3


def test_weight_is_a_force_on_all_nodes():
    deck = make_deck(TRIANGLE.with_(probe=None, film={"gravity_m_s2": -9.81}))
    area = read_areas(deck.grid).sum()
    weight = -9.81 * 1760.0 * 25e-6 * area
    assert deck.loads.forces[:, 2].sum() == pytest.approx(weight, rel=1e-10)


@pytest.mark.parametrize("program", DIALECTS)
@pytest.mark.parametrize("name", SCENES)
def test_decks_obey_the_limits_of_the_programs_and_are_read_back(tmp_path, program, name):
    deck = make_deck(SCENES[name], program)
    text = deck.format()
    path = tmp_path / "film.inp"
    path.write_text(text, "ascii")
    for line in text.splitlines():
        words = [word.strip() for word in line.split(",")]
        assert len(words) <= 16  # CalculiX counts those of comments, too
        if line.startswith("*"):
            continue
        assert max(map(len, words)) <= 20
    grid = read_deck_grid(path, SCENES[name])
    np.testing.assert_allclose(grid.points, deck.grid.points, rtol=1e-12, atol=1e-17)
    np.testing.assert_array_equal(grid.triangles, deck.grid.triangles)
    assert list(grid.patches) == list(deck.grid.patches)
    for patch, elements in grid.patches.items():
        np.testing.assert_array_equal(elements, deck.grid.patches[patch])


@pytest.mark.parametrize("damage", ["*NODE", "*ELEMENT", "*ELSET, ELSET=electrode_A", "1, "])
def test_other_files_are_no_decks(tmp_path, damage):
    path = tmp_path / "film.inp"
    path.write_text(make_deck(TRIANGLE).format().replace(f"\n{damage}", "\n** "), "ascii")
    with pytest.raises(FileError, match=r"film\.inp"):
        read_deck_grid(path, TRIANGLE)


TAPE = {"x_mm": 0.0, "y_mm": 0.0, "thickness_um": 9.0, "youngs_modulus_GPa": 3.0}


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({"load.kind": "follower"}, False),
        ({"probe.x_mm": 9.5}, False),
        ({"film.pressure_Pa": 20.0}, False),
        ({"film.patches": [TAPE]}, False),
        ({"film.d31_pC_N": 23.0, "numerics.tolerance": 1e-4, "film.permittivity": 12.0}, True),
    ],
)
def test_a_deck_is_read_for_its_own_scene_only(tmp_path, changes, is_same):
    """Changes that leave the deck as it is are allowed, such as those of charge coefficients."""
    path = tmp_path / "film.inp"
    path.write_text(make_deck(TRIANGLE).format(), "ascii")
    other = TRIANGLE.with_(**changes)
    if is_same:
        assert len(read_deck_grid(path, other).triangles)
        return
    with pytest.raises(FileError, match=next(iter(changes)).rpartition(".")[2]):
        read_deck_grid(path, other)


def test_scenes_with_long_lists_in_comments_are_recognized():
    vertices = [[-9.0, -9.0], [9.0, -9.0], [9.125, 9.0], [0.0, 4.5], [-9.0, 9.0]]
    scene = TRIANGLE.with_(probe={"shape": "polygon", "vertices_mm": vertices})
    comments = format_scene_comments(scene)
    assert find_scene_difference(comments, scene) == ""
    vertices[-1] = [-9.0, 9.5]
    other = scene.with_(**{"probe.vertices_mm": vertices})
    assert "probe.vertices_mm" in find_scene_difference(comments, other)
