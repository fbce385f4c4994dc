"""What is taken where a scene is asked for."""

from types import SimpleNamespace

import pytest

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.given import scene_of

SCENE = Scene().with_(**{"probe.shape": "circle", "film.thickness_um": 12.0})


@pytest.mark.parametrize("kind", [str, lambda path: path])
def test_a_path_is_read(tmp_path, kind):
    path = tmp_path / "mine.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    assert scene_of(kind(path)) == SCENE


def test_tables_and_dotted_keys_make_a_scene():
    assert scene_of({"probe": {"shape": "circle"}, "film.thickness_um": 12.0}) == SCENE


def test_a_scene_and_a_result_of_one_are_taken():
    assert scene_of(SCENE) is SCENE
    assert scene_of(SimpleNamespace(scene=SCENE)) is SCENE


@pytest.mark.parametrize("given", [None, 3, [1.0], SimpleNamespace(scene=2)])
def test_anything_else_is_refused(given):
    with pytest.raises(TypeError, match="scene = "):
        scene_of(given)


def test_mistakes_are_those_of_the_file_or_the_table(tmp_path):
    with pytest.raises(SceneError):
        scene_of(tmp_path / "none.toml")
    with pytest.raises(SceneError, match=r"film\.radius"):
        scene_of({"film": {"radius": 2}})


def test_a_scene_is_changed_by_a_dict_and_not_in_place():
    changed = Scene().with_({"probe": {"shape": "circle"}, "film.thickness_um": 12.0})
    assert changed == SCENE
    with pytest.raises(AttributeError, match=r"Scene\.with_"):
        changed.film.thickness_um = 25.0
    assert changed == SCENE
