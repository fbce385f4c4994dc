"""The command `locate`, with a made-up model in the place of a built one."""

import json
import pickle
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.cli.main import main
from pvdf_fem.response.model import Domain
from pvdf_fem.solution.solution import NotConvergedError
from tests.helpers.touch_models import bumps

TOUCH = np.array([3.0, -4.0, 25.0, 0.7])


class Kept:
    """A `Response` that is written and read as a pickle."""

    @staticmethod
    def load(path):
        return pickle.loads(path.read_bytes())


@pytest.fixture
def built(monkeypatch):
    """What was built: scene, reach and forces; the module of responses is replaced."""
    calls = []

    def build(scene, *, reach_mm, force_N, progress):
        progress(1, 2)
        calls.append((scene, reach_mm, force_N))
        model = bumps(scene.probe.shape, domain=Domain(reach_mm, force_N))
        object.__setattr__(model, "scene", scene)
        object.__setattr__(model, "save", lambda path: path.write_bytes(pickle.dumps(stored)))
        stored = bumps(scene.probe.shape, domain=Domain(reach_mm, force_N))
        object.__setattr__(stored, "scene", scene)
        return model

    replaced = {
        "response": SimpleNamespace(Response=Kept),
        "build": SimpleNamespace(build_response=build),
    }
    for name, module in replaced.items():
        monkeypatch.setitem(sys.modules, f"pvdf_fem.response.{name}", module)
    return calls


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text('[probe]\nshape = "rectangle"\nrotation_deg = 25.0\n')
    return path


def given(shape="rectangle", touch=TOUCH):
    charges = bumps(shape).evaluate(touch[None])[0][0]
    return ",".join(f"{n}={q:.6f}" for n, q in zip("ABCD", charges, strict=True))


def test_a_touch_is_located_and_the_model_kept(built, file, capsys):
    arguments = ["locate", str(file), "--charges", given(), "--json"]
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    result = json.loads(out)
    [best] = result["touches"]
    assert [best[n] for n in ("x_mm", "y_mm", "rotation_deg", "force_N")] == pytest.approx(
        TOUCH, abs=1e-3
    )
    assert best["standard_deviations"]["x_mm"] > 0.01
    assert result["deviations"] == best["standard_deviations"]
    assert "building the model" in err
    [(scene, reach, forces)] = built
    assert (scene.probe.rotation_deg, reach, forces) == (0.0, 12.0, (0.1, 5.0))
    assert main(arguments) == 0
    assert capsys.readouterr().err == ""
    assert len(built) == 1
    assert main([*arguments, "--set", "film.thickness_um=30"]) == 0
    assert len(built) == 2


def test_a_model_that_cannot_be_built_has_its_exit_code(built, file, monkeypatch, capsys):
    def build(scene, **domain):
        raise NotConvergedError("tolerance: 0.001 is missed by the response")

    monkeypatch.setattr(sys.modules["pvdf_fem.response.build"], "build_response", build)
    assert main(["locate", str(file), "--charges", given()]) == 3
    assert "is missed" in capsys.readouterr().err


def test_the_text_tells_values_and_remarks(built, file, capsys):
    assert main(["locate", str(file), "--charges", given(), "--unknown", "x,y,force,rotation"]) == 0
    text = capsys.readouterr().out
    assert "±" in text
    assert "remark      ambiguous" in text
    assert " of touch 1: each with a probability of 68 %" in text
    assert main(["locate", str(file), "--charges", given()]) == 0
    text = capsys.readouterr().out
    assert "rotation            25 (known) °" in text
    assert "with 1 degrees of freedom" in text


def test_probes_are_weighed(built, file, capsys):
    other = file.with_name("triangle.toml")
    other.write_text("[probe]\n")
    arguments = ["locate", str(other), "--or", str(file), "--charges", given(), "--json"]
    assert main([*arguments, "--sigma", "0.002", "--set", "probe.rotation_deg=25"]) == 0
    first, second = json.loads(capsys.readouterr().out)["scenes"]
    assert first["scene"] == str(file)
    assert first["weight"] > 0.99
    assert first["weight"] + second["weight"] == pytest.approx(1.0)


def test_a_model_of_another_scene_is_refused(built, file, capsys):
    path = file.with_name("kept.response")
    assert main(["locate", str(file), "--charges", given(), "--model", str(path)]) == 0
    turned = ["--set", "probe.width_mm=12"]
    assert main(["locate", str(file), "--charges", given(), "--model", str(path), *turned]) == 2
    assert "is of another film, probe or electrodes" in capsys.readouterr().err


def test_all_mistakes_are_told_before_anything_is_built(built, file, capsys):
    arguments = ["--charges", "A=1,A=2,B", "--sigma", "x", "--noise=-1", "--unknown", "x,mass"]
    assert main(["locate", str(file), *arguments, "--force-range", "5,1", "--reach", "0"]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "--charges A: given twice; remove one",
        "--charges B: write NAME=CHARGE, such as A=905.1",
        "--sigma x: give a number that is not negative",
        "--noise -1: give a number that is not negative",
        "--unknown mass: choose from x, y, force, rotation",
        "--reach 0: give a positive number",
        "--force-range 5,1: give two forces in N, such as 0.1,5",
    ]
    arguments = ["--charges", "A=1,E=2", "--unknown", "y,force", "--set", "probe.x_mm=13"]
    assert main(["locate", str(file), *arguments]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "charges.E: no such electrode; choose from A, B, C, D",
        "known x_mm = 13: beyond the 12 mm that the model reaches; build a larger one",
    ]
    bare = file.with_name("bare.toml")
    bare.write_text(Scene().to_toml())
    assert main(["locate", str(bare), "--charges", "A=1"]) == 2
    assert "has no [probe]" in capsys.readouterr().err
    assert not built
