"""The command ``pvdf-fem design``, with made-up charges in place of a model."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import xarray

from pvdf_fem.cli.main import main
from pvdf_fem.cli.studies import design as command
from tests.helpers.touch_models import bumps

TOML = """
[electrodes]
layout = "ring"
shape = "circle"
radius_mm = 1.0
[probe]
shape = "circle"
"""
VARY = ["--vary", "electrodes.count=4,6", "--vary", "electrodes.ring_radius_mm=[7, 9.5]"]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The file of a scene; models are counted."""
    file, models = tmp_path / "ring.toml", []

    def model_of(film, *_, as_kept):
        models.append(film)
        return bumps("circle").for_scene(film)

    monkeypatch.setattr(command, "model_of", model_of)
    file.write_text(TOML)
    return file, models


def test_designs_are_printed_drawn_and_written(scene, tmp_path, capsys):
    file, models = scene
    picture, output = tmp_path / "design.png", tmp_path / "design.nc"
    written = ["--json", "--plot", str(picture), "--output", str(output)]
    assert main(["design", str(file), *VARY, "--noise", "0.02", "--step", "4", *written]) == 0
    result = json.loads(capsys.readouterr().out)
    assert len(models) == 1
    assert (result["noise"], result["step_mm"]) == (0.02, 4.0)
    keys = [(of["count"], of["ring_radius_mm"]) for of in result["designs"]]
    assert keys == [(4, 7), (4, 9.5), (6, 7), (6, 9.5)]
    with xarray.open_dataset(output) as data:
        medians = [of["place_deviation_median_mm"] for of in result["designs"]]
        np.testing.assert_array_equal(data.place_deviation_median_mm.values.ravel(), medians)
        assert data.place_deviation_mm.dims[-2:] == ("y_mm", "x_mm")
    assert picture.stat().st_size > 0


def test_a_table_for_people_and_one_for_spreadsheets(scene, tmp_path, capsys):
    file, models = scene
    output = tmp_path / "design.csv"
    vary = ["--vary", "film.thickness_um={start=10, stop=20, count=2}", "--step", "6"]
    assert main(["design", str(file), *vary, "--output", str(output)]) == 0
    captured = capsys.readouterr()
    assert len(models) == 2
    assert "2 models" in captured.err
    assert len(captured.out.splitlines()) == 3
    with output.open() as table:
        rows = list(csv.DictReader(table))
    assert [float(row["thickness_um"]) for row in rows] == [10.0, 20.0]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (["--vary", "electrodes.count"], "--vary electrodes.count"),
        (["--vary", "electrodes.count=4", "--vary", "electrodes.count=6"], "--vary"),
        (["--vary", "electrodes.count=30"], "electrodes.count = 30"),
        (["--vary", "probe.y_mm=1,2"], "probe.y_mm"),
        (["--noise", "much"], "--noise much"),
        (["--noise-pC", "-1"], "--noise-pC -1"),
        (["--step", "50"], "step_mm = 50"),
        (["--output", "design.txt"], "design.txt"),
        (["--force-range", "2,3"], "load.force_N = 1"),
        (["--vary", "film.thickness_um=9,25", "--model", "one.response"], "--model"),
    ],
)
def test_bad_input_is_refused_before_any_model(scene, options, key, capsys):
    file, models = scene
    assert main(["design", str(file), *options]) == 2
    captured = capsys.readouterr()
    assert (captured.out, models) == ("", [])
    assert key in captured.err
