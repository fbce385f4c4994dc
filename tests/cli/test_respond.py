"""The command `respond`: its table, JSON, figure, and refusals."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene, respond
from pvdf_fem.cli.main import main

SCENE = '[probe]\nshape = "circle"\n[readout]\n[numerics]\ntolerance = 0.05\n'


@pytest.fixture
def scene(tmp_path: Path) -> str:
    (path := tmp_path / "scene.toml").write_text(SCENE)
    return str(path)


def test_table_json_and_figure_of_a_response(
    scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plot, span = tmp_path / "response.svg", ["--frequencies", "2:50:2"]
    assert main(["respond", scene, *span, "--plot", str(plot)]) == 0
    told = capsys.readouterr()
    assert "left out: damping by the film" in told.err
    rows = list(csv.DictReader(io.StringIO(told.out)))
    expected = respond(Scene.parse(SCENE), [2.0, 50.0]).columns()
    assert list(rows[0]) == list(expected)
    for name, values in expected.items():
        np.testing.assert_allclose([float(row[name]) for row in rows], values, rtol=1e-9)
    assert b"frequency" in plot.read_bytes() or plot.stat().st_size > 10_000
    assert main(["respond", scene, "--frequencies", "50", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(told["A_real_V_N"], expected["A_real_V_N"][1], rtol=1e-6)
    assert any("air" in text for text in told["left_out"])


def test_a_closed_pipe_leaves_the_figure(
    scene: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def closed(*_: object, **__: object) -> None:
        raise BrokenPipeError

    plot = tmp_path / "response.svg"
    monkeypatch.setattr("pandas.DataFrame.to_csv", closed)
    assert main(["respond", scene, "--frequencies", "20", "--plot", str(plot)]) == 141
    assert plot.exists()


@pytest.mark.parametrize("span", ["", "0", "-1", "5:1", "1:2:3:4", "1:2:2.5", "1:9e9", "nan", "1:"])
def test_frequencies_that_are_none(
    scene: str, span: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["respond", scene, f"--frequencies={span}"]) == 2
    assert f"--frequencies {span}: is out of range; give" in capsys.readouterr().err


def test_a_film_without_equilibrium(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    changes = ["--set", "film.temperature_change_K=0", "--set", "load.force_N=0"]
    assert main(["respond", scene, "--frequencies", "20", *changes]) == 3
    assert "not converged" in capsys.readouterr().err


def test_a_scene_without_a_probe(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path := tmp_path / "bare.toml").write_text("")
    assert main(["respond", str(path)]) == 2
    assert "probe = (nothing)" in capsys.readouterr().err
