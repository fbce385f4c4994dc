"""The command `locate`, with a made-up model in the place of a built one."""

import pickle
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.response import response
from pvdf_fem.response.model import Domain
from pvdf_fem.response.response import reads_alike
from pvdf_fem.solvers.status import NotConvergedError
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

    def for_scene(self, scene, progress=None):
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
        for done in range(1, 41):
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


def test_a_touch_is_located_and_the_model_kept(built, file, command):
    arguments = ["locate", file, "--charges", given(), "--json"]
    done = command(*arguments)
    result = done.json
    [best] = result["touches"]
    assert [best[n] for n in ("x_mm", "y_mm", "rotation_deg", "force_N")] == pytest.approx(
        TOUCH, abs=1e-3
    )
    assert result["deviations"] == best["standard_deviations"]
    assert best["standard_deviations"]["x_mm"] > 0.01
    assert "building the model" in done.err
    assert "a remark" in done.err
    assert "40 s of one core" in done.err
    [(scene, *wanted)] = built
    assert (scene.probe.rotation_deg, wanted) == (0.0, [12.0, (0.1, 5.0), 1e-3])
    assert command(*arguments).err == ""
    assert len(built) == 1
    assert command(*arguments, "--set", "film.thickness_um=30").code == 0
    assert command(*arguments, "--tolerance", "1e-5").code == 0
    assert [call[3] for call in built] == [1e-3, 1e-3, 1e-5]


def test_other_electrodes_find_the_old_model(built, file, command):
    """Its file has the new electrodes then, unless it was named."""
    arguments = ["locate", file, "--charges", given()]
    named = ["--model", file.with_name("named.response")]
    for model, lines in (([], [1, 0]), (named, [1, 1])):
        assert command(*arguments, *model).code == 0
        files = list(file.parent.iterdir())
        for expected in lines:
            done = command(*arguments, *model, "--set", "electrodes.side_mm=2")
            assert (done.code, len(done.told)) == (0, expected)
        assert list(file.parent.iterdir()) == files
        moved = ["--set", "probe.x_mm=2", "--set", "load.force_N=2"]
        assert command(*arguments, *model, *moved).code == 0
    assert len(built) == 2


def test_the_scene_says_what_its_model_holds_for(built, file, command):
    wanted = "[model]\nreach_mm = 8\nforce_range_N = [0.2, 2]\ntolerance = 5e-3\n"
    file.write_text(file.read_text() + wanted)
    assert command("model", file, "--list").code == 3
    told = command("model", file, "--json").json
    assert (told["reach_mm"], told["force_range_N"]) == (8.0, [0.2, 2.0])
    assert [call[1:] for call in built] == [(8.0, (0.2, 2.0), 5e-3)]
    assert command("locate", file, "--charges", given()).code == 0
    (row,) = command("model", file, "--list", "--json").json["models"]
    assert (row["file"], row["serves"]) == (told["file"], True)
    assert len(built) == 1


def test_a_model_that_covers_what_is_asked_serves(built, file, command):
    arguments = ["locate", file, "--charges", given()]
    assert command(*arguments).code == 0
    assert command(*arguments, "--reach", "8", "--force-range", "0.2,2").code == 0
    assert len(built) == 1
    assert "12 mm" in command(*arguments, "--reach", "14").err
    assert [call[1] for call in built] == [12.0, 14.0]


def test_the_tolerance_follows_the_noise(built, file, command):
    assert command("locate", file, "--charges", given(), "--sigma", "0.05").code == 0
    assert built[0][3] == pytest.approx(5e-3)


def test_a_model_that_cannot_be_built_has_its_exit_code(built, file, monkeypatch, command):
    def build(*_, **__):
        raise NotConvergedError("probe at (0, 0) mm with 1 N: max_iterations")

    monkeypatch.setattr(sys.modules["pvdf_fem.response.build"], "build_response", build)
    done = command("locate", file, "--charges", given())
    assert done.code == 3
    assert "max_iterations" in done.err


def test_the_text_tells_values(built, file, command):
    text = command("locate", file, "--charges", given()).out
    assert re.search(r"rotation_deg +25", text)
    assert "±" in text
    text = command("locate", file, "--charges", given(), "--unknown", "x,y,force,rotation").out
    assert text.startswith("ambiguous: ")


def test_probes_are_weighed(built, file, command):
    other = file.with_name("triangle.toml")
    other.write_text("[probe]\n")
    arguments = ["locate", other, "--or", file, "--charges", given(), "--json"]
    done = command(*arguments, "--sigma", "0.002", "--set", "probe.rotation_deg=25")
    first, second = done.json["scenes"]
    assert first["scene"] == str(file)
    assert first["weight"] > 0.99
    assert first["weight"] + second["weight"] == pytest.approx(1.0)


def test_a_model_of_another_scene_is_refused(built, file, command):
    kept = ["locate", file, "--charges", given(), "--model", file.with_name("kept.response")]
    assert command(*kept).code == 0
    done = command(*kept, "--set", "probe.width_mm=12")
    assert done.code == 2
    assert "probe.width_mm = 12.0" in done.err


def test_all_mistakes_are_told_before_anything_is_built(built, file, command):
    arguments = ["--charges", "A=1,A=2,B", "--sigma", "x", "--noise=-1", "--unknown", "x,mass"]
    arguments += ["--force-range", "5,1", "--reach", "0", "--tolerance", "none"]
    assert command("locate", file, *arguments).mistakes == [
        "--charges A",
        "--charges B",
        "--sigma x",
        "--noise -1",
        "--unknown mass",
        "--reach 0",
        "--force-range 5,1",
        "--tolerance none",
    ]
    arguments = ["--charges", "A=1,E=2", "--unknown", "y,force", "--set", "probe.x_mm=13"]
    assert command("locate", file, *arguments).mistakes == ["charges.E", "known x_mm = 13"]
    bare = file.with_name("bare.toml")
    bare.write_text(Scene().to_toml())
    assert command("locate", bare, "--charges", "A=1").code == 2
    drawn = ["--or", file, "--plot", file.with_name("a.svg")]
    two = command("locate", file, "--charges", given(), "--touches", "2", *drawn)
    assert set(two.mistakes) == {"--plot", "--or"}
    assert not built


def test_reach_and_forces_are_those_of_full_solves_too(file, monkeypatch, command):
    asked = []

    def located(scene, charges, **how):
        asked.append((scene.model.reach_mm, scene.model.force_range_N, how["touches"]))
        raise NotConvergedError("no solve here")

    monkeypatch.setattr("pvdf_fem.touch.locate.locate", located)
    domain = ["--touches", "2", "--reach", "9", "--force-range", "0.2,3"]
    assert command("locate", file, "--charges", given(), *domain).code == 3
    assert asked == [(9.0, (0.2, 3.0), 2)]


def test_one_channel_tells_no_place(built, file, command):
    done = command("locate", file, "--charges", "A=900", "--json")
    assert done.code == 3
    result = done.json
    assert (result["status"], result["touches"]) == ("undetermined", [])


def test_the_likelihood_is_drawn_where_places_are_sought(built, file, tmp_path, command):
    touch = ["locate", file, "--charges", given(), "--plot", tmp_path / "a.svg"]
    assert command(*touch).code == 0
    assert "<svg" in (tmp_path / "a.svg").read_text()
    assert command(*touch, "--unknown", "x,force").mistakes == ["--plot"]
    table = ["locate", file, "--csv", tmp_path / "a.csv", "--plot", "b.svg"]
    assert command(*table).mistakes == ["--plot"]
