"""What is taken where a scene is asked for."""

from types import SimpleNamespace

import pytest

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.given import scene_of

TABLES = {"probe": {"shape": "circle"}, "film.thickness_um": 12.0}
SCENE = Scene().with_(TABLES)


def test_a_file_tables_a_scene_and_a_result_are_taken(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    for given in (path, str(path), TABLES, SCENE, SimpleNamespace(scene=SCENE)):
        assert scene_of(given) == SCENE


@pytest.mark.parametrize("given", [None, 3, [1.0], SimpleNamespace(scene=2)])
def test_anything_else_is_refused(given):
    with pytest.raises(TypeError, match="scene = "):
        scene_of(given)


def test_mistakes_are_those_of_the_file_or_the_table(tmp_path):
    for given in (tmp_path / "none.toml", {"film": {"radius": 2}}):
        with pytest.raises(SceneError):
            scene_of(given)
