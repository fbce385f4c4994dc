"""The command ``pvdf-fem calibrate``."""

import csv
import json

import pytest

from pvdf_fem import Scene
from pvdf_fem.cli.main import main
from tests.helpers.touched_sensor import SCENE, TRUE, made, made_up

PLACED = {key: value for key, value in TRUE.items() if key.startswith("stage.")}


@pytest.fixture
def files(tmp_path, monkeypatch):
    made_up(monkeypatch)
    scene, touches = tmp_path / "scene.toml", tmp_path / "touches.csv"
    scene.write_text(SCENE.with_(**PLACED).to_toml())

    def write(columns):
        with open(touches, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))

    write(made(6, sigma=0.01, place_sd=0.3))
    return tmp_path, [str(scene), str(touches), "--unknown", "film.pretension_N_m,gains"], write


def test_a_sensor_is_calibrated_and_written(files, capsys):
    folder, arguments, _ = files
    sensor, page = folder / "sensor.toml", folder / "page.html"
    options = ["--place-sd", "0.3", "--json", "--output", str(sensor), "--page", str(page)]
    assert main(["calibrate", *arguments, *options]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "calibrated"
    gain = result["parameters"]["gain.A"]
    assert Scene.load(sensor).readout.gain["A"] == gain["value"]
    text = page.read_text()
    assert text.count("<svg") == 3
    assert "http" not in text.replace("http://www.w3.org", "").replace("http://purl", "")
    assert main(["solve", str(sensor), "--set", "probe.x_mm=3"]) == 0


def test_what_is_not_calibrated_has_its_own_exit_code(files, capsys):
    folder, arguments, write = files
    write({name: column[:4] for name, column in made(6, sigma=0.01, place_sd=0.3).items()})
    sensor = folder / "sensor.toml"
    options = ["--place-sd", "0.3", "--output", str(sensor)]
    assert main(["calibrate", *arguments, *options]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("too_few_touches: 4 touches")
    assert "parameter" not in captured.err  # no table without rows
    assert not sensor.exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--sigma", "much"], "--sigma much: give a number"),
        (["--prior", "gains"], "--prior gains"),
        (["--unit", "mV"], "unit = 'mV'"),
        (["--output", "sensor.csv"], "sensor.csv: has no extension"),
    ],
)
def test_bad_input_is_refused(files, options, said, capsys):
    _, arguments, _ = files
    assert main(["calibrate", *arguments, *options]) == 2
    assert said in capsys.readouterr().err
