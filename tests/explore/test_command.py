"""The command `pvdf-fem explore` where it cannot serve its page."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from pvdf_fem.cli.main import main
from pvdf_fem.scene.scene_file import example_text, examples


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "scene.toml"
    path.write_text(example_text("triangle", examples()), encoding="utf-8")
    return str(path)


def test_a_port_that_is_none_and_a_scene_that_is_none_are_told_together(file, capsys):
    assert main(["explore", file, "--port", "70000", "--set", "film.radius_mm=-1"]) == 2
    told = capsys.readouterr().err
    assert "--port 70000" in told
    assert "film.radius_mm" in told


def test_a_taken_port_is_refused(file, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert main(["explore", file, "--no-browser", "--port", port]) == 2
    assert f"--port {port}" in capsys.readouterr().err
