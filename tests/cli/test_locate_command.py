"""The command `locate`, with a made-up model in the place of a built one."""

import json
import pickle
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.cli.main import main
from pvdf_fem.response import response
from pvdf_fem.response.model import Domain
from pvdf_fem.response.response import reads_alike
from pvdf_fem.solution.solution import NotConvergedError
from tests.helpers.touch_models import bumps

TOUCH = np.array([3.0, -4.0, 25.0, 0.7])


class Kept:
    """A `Response` that is written and read as a pickle."""

    remarks = ("a remark",)
    spline = None

    def __init__(self, model, scene, tolerance=1e-3):
        self.model, self.scene, self.tolerance = model, scene, tolerance

    def __getattr__(self, name):
        if name == "model":
            raise AttributeError
        return getattr(self.model, name)

    def for_scene(self, scene):
        read = Kept(self.model, scene, self.tolerance)
        read.spline = self.spline if reads_alike(self.scene, scene) else object()
        return read

    def save(self, path):
        path.write_bytes(pickle.dumps((self.model, self.scene, self.tolerance)))

    @staticmethod
    def load(path):
        return Kept(*pickle.loads(path.read_bytes()))


@pytest.fixture
def built(monkeypatch):
    """What was built: scene, reach and forces; the module of responses is replaced."""
    calls = []

    def build(scene, reach_mm, force_N, tolerance, *, file, progress):
        for done in range(41):
            progress(done, 40)
        calls.append((scene, reach_mm, force_N, tolerance))
        stand_in = bumps(scene.probe.shape, domain=Domain(reach_mm, force_N))
        model = Kept(stand_in, scene, tolerance)
        model.save(file)
        return model

    monkeypatch.setattr(response, "Response", Kept)
    module = SimpleNamespace(build_response=build)
    monkeypatch.setitem(sys.modules, "pvdf_fem.response.build", module)
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
    assert "a remark" in err
    assert [line for line in err.splitlines() if line.endswith(" solves")] == [
        f"{done} of 40 solves" for done in range(4, 41, 4)
    ]
    [(scene, *wanted)] = built
    assert (scene.probe.rotation_deg, wanted) == (0.0, [12.0, (0.1, 5.0), 1e-3])
    assert main(arguments) == 0
    assert capsys.readouterr().err == ""
    assert len(built) == 1
    assert main([*arguments, "--set", "film.thickness_um=30"]) == 0
    assert main([*arguments, "--tolerance", "1e-5"]) == 0
    assert [call[3] for call in built] == [1e-3, 1e-3, 1e-5]


def test_other_electrodes_find_the_old_model(built, file, capsys):
    """Its file has the new electrodes then, unless it was named."""
    arguments = ["locate", str(file), "--charges", given()]
    named = ["--model", str(file.with_name("named.response"))]
    for model, lines in (([], [1, 0]), (named, [1, 1])):
        assert main([*arguments, *model]) == 0
        files = list(file.parent.iterdir())
        capsys.readouterr()
        for expected in lines:
            assert main([*arguments, *model, "--set", "electrodes.side_mm=2"]) == 0
            err = capsys.readouterr().err.splitlines()
            assert len(err) == expected
            assert all("anew for other electrodes, d31 or d32" in line for line in err)
        assert list(file.parent.iterdir()) == files
        assert main([*arguments, *model, "--set", "probe.x_mm=2", "--set", "load.force_N=2"]) == 0
    assert len(built) == 2


def test_the_scene_says_what_its_model_holds_for(built, file, capsys):
    wanted = "[model]\nreach_mm = 8\nforce_range_N = [0.2, 2]\ntolerance = 5e-3\n"
    file.write_text(file.read_text() + wanted)
    assert main(["model", str(file), "--list"]) == 3
    assert main(["model", str(file), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["reach_mm"], told["force_range_N"]) == (8.0, [0.2, 2.0])
    assert [call[1:] for call in built] == [(8.0, (0.2, 2.0), 5e-3)]
    assert main(["locate", str(file), "--charges", given()]) == 0
    assert main(["model", str(file), "--list", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out.splitlines()[-1])["models"]
    assert (row["file"], row["serves"]) == (told["file"], True)
    assert len(built) == 1


def test_a_model_that_covers_what_is_asked_serves(built, file, capsys):
    arguments = ["locate", str(file), "--charges", given()]
    assert main(arguments) == 0
    assert main([*arguments, "--reach", "8", "--force-range", "0.2,2"]) == 0
    assert len(built) == 1
    capsys.readouterr()
    assert main([*arguments, "--reach", "14"]) == 0
    told = capsys.readouterr().err
    assert "does not serve: it holds for 12 mm about the centre, 0.1 to 5 N only" in told
    assert [call[1] for call in built] == [12.0, 14.0]


def test_the_tolerance_follows_the_noise(built, file):
    arguments = ["locate", str(file), "--charges", given(), "--sigma", "0.05"]
    assert main(arguments) == 0
    assert built[0][3] == pytest.approx(5e-3)


def test_a_model_that_cannot_be_built_has_its_exit_code(built, file, monkeypatch, capsys):
    def build(*_, **__):
        raise NotConvergedError("probe at (0, 0) mm with 1 N: max_iterations")

    monkeypatch.setattr(sys.modules["pvdf_fem.response.build"], "build_response", build)
    assert main(["locate", str(file), "--charges", given()]) == 3
    assert "1 N: max_iterations" in capsys.readouterr().err


def test_the_text_tells_values_and_remarks(built, file, capsys):
    assert main(["locate", str(file), "--charges", given(), "--unknown", "x,y,force,rotation"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("ambiguous: ")
    assert "±" in text
    assert main(["locate", str(file), "--charges", given()]) == 0
    text = capsys.readouterr().out
    assert re.search(r"rotation_deg +25 +known", text)
    assert re.search(r"degrees of freedom +1", text)


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
    err = capsys.readouterr().err
    assert "probe.width_mm = 12.0 is 14.0 there" in err
    assert err.endswith("build a response of this scene, or name another file\n")


def test_all_mistakes_are_told_before_anything_is_built(built, file, capsys):
    arguments = ["--charges", "A=1,A=2,B", "--sigma", "x", "--noise=-1", "--unknown", "x,mass"]
    arguments += ["--force-range", "5,1", "--reach", "0", "--tolerance", "none"]
    assert main(["locate", str(file), *arguments]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "--charges A: given twice; remove one",
        "--charges B: write NAME=CHARGE, such as A=905.1",
        "--sigma x: give a number that is not negative",
        "--noise -1: give a number that is not negative",
        "--unknown mass: choose from x, y, force, rotation, tangential, temperature",
        "--reach 0: give a positive number",
        "--force-range 5,1: give two forces in N, such as 0.1,5",
        "--tolerance none: give a positive number",
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


def test_an_option_that_two_touches_do_not_have_is_named(file, tmp_path, capsys):
    chosen = ["--touches", "2", "--plot", str(tmp_path / "a.svg")]
    assert main(["locate", str(file), "--charges", given(), *chosen]) == 2
    told = capsys.readouterr().err
    assert "--plot: is not for --touches 2" in told
    assert "--or" not in told


def test_the_likelihood_is_drawn_where_places_are_sought(built, file, tmp_path, capsys):
    touch = ["locate", str(file), "--charges", given(), "--plot", str(tmp_path / "a.svg")]
    assert main(touch) == 0
    assert "Likelihood" not in capsys.readouterr().out
    assert "<svg" in (tmp_path / "a.svg").read_text()
    assert main([*touch, "--unknown", "x,force"]) == 2
    assert "--plot: draws places" in capsys.readouterr().err
    table = ["locate", str(file), "--csv", str(tmp_path / "a.csv"), "--plot", "b.svg"]
    assert main(table) == 2
    assert "--plot: is for single touches" in capsys.readouterr().err
