"""The command ``draw``."""

from __future__ import annotations

import pytest

from pvdf_fem import Scene
from pvdf_fem.cli.main import main


@pytest.fixture
def scene_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "scene.toml"
    path.write_text(Scene.example("triangle").to_toml(), "utf-8")
    return path


def test_a_drawn_scene_is_read_again_from_its_drawing(scene_file, capsys):
    assert main(["draw", str(scene_file), "pads.dxf", "--set", "film.radius_mm=30"]) == 0
    assert "rim 60 mm, electrodes A, B, C, D" in capsys.readouterr().out
    text = '[electrodes]\ndrawing = "pads.dxf"\nlayer = "{layer}"\n'
    scene_file.write_text(text.format(layer="ELECTRODES"), "utf-8")
    assert main(["draw", str(scene_file), "again.svg", "--probe", "--no-dimensions"]) == 0
    assert "rim 90 mm, electrodes A, B, C, D" in capsys.readouterr().out
    scene_file.write_text(text.format(layer="PADS"), "utf-8")
    assert main(["draw", str(scene_file), "again.svg"]) == 2
    assert 'electrodes.layer = "PADS"' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "word"), [(["pads.png"], ".dxf .svg .pdf"), (["pads.svg", "--r12"], "--r12")]
)
def test_wrong_files_and_options_are_refused(scene_file, capsys, arguments, word):
    assert main(["draw", str(scene_file), *arguments]) == 2
    assert word in capsys.readouterr().err
