"""The command ``pvdf-fem dataset``, with made-up charges in place of a model."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
import xarray

from pvdf_fem import Scene, dataset
from pvdf_fem.cli.main import main
from pvdf_fem.cli.studies import dataset as command
from tests.helpers.touch_models import bumps


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The file of a scene; models are counted."""
    file, models = tmp_path / "disc.toml", []

    def model_of(sensor, *_):
        models.append(sensor)
        return bumps("circle").for_scene(sensor)

    monkeypatch.setattr(command, "model_of", model_of)
    file.write_text('[probe]\nshape = "circle"\n')
    return file, models


def test_a_file_has_what_python_gives(scene, tmp_path, capsys):
    file, models = scene
    output = tmp_path / "touches.nc"
    asked = ["--touches", "30", "--seed", "5", "--sigma", "0.03", "--noise", "2"]
    given = ["--set", "film.thickness_um=20", *asked, "--output", str(output)]
    assert main(["dataset", str(file), *given]) == 0
    assert len(models) == 1
    assert str(output) in capsys.readouterr().out
    sensor = Scene.load(file).with_(**{"film.thickness_um": 20.0})
    expected = dataset(sensor, 30, 5, 0.03, noise_pC=2.0, model=bumps("circle"))
    with xarray.open_dataset(output) as kept:
        np.testing.assert_array_equal(kept.reading_pC, expected.reading_pC)
        assert kept.attrs["scene"] == expected.attrs["scene"]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (["--touches", "many"], "touches = many"),
        (["--touches", "0"], "touches = 0"),
        (["--seed", "1.5"], "seed = 1.5"),
        (["--sigma", "much"], "--sigma much"),
        (["--noise", "-1"], "--noise -1"),
        (["--output", "touches.txt"], "touches.txt"),
        (["--output", "touches.parquet"], "pvdf-fem[parquet]"),
        (["--reach", "60"], "--reach 60"),
        (["--set", "load.kind=rigid"], "load.kind"),
    ],
)
def test_bad_input_is_refused_before_any_model(scene, options, key, capsys, monkeypatch):
    file, models = scene
    monkeypatch.chdir(file.parent)
    # whether it is installed or not
    monkeypatch.setattr(command, "find_spec", lambda name: importlib.util.find_spec("no_" + name))
    given = options if "--output" in options else [*options, "--output", "touches.nc"]
    assert main(["dataset", str(file), *given]) == 2
    captured = capsys.readouterr()
    assert (captured.out, models) == ("", [])
    assert key in captured.err
    assert not list(file.parent.glob("touches.*"))
