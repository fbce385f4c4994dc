"""What each command gives: exit code, the keys and values of Python's results, and files."""

from __future__ import annotations

import ast
import csv
import io
import re
import shlex
import signal
import subprocess
import sys
from argparse import Namespace
from functools import partial
from pathlib import Path

import meshio
import numpy as np
import pytest
import xarray
from matplotlib.image import imread

from pvdf_fem import Scene, __version__, calibrate, dataset, modes, respond, solve
from pvdf_fem.cli.program import scene_of
from pvdf_fem.scene.scene_file import examples, key_texts
from pvdf_fem.solvers.newton import NewtonOptions
from tests.helpers.touch_models import bumps
from tests.helpers.touched_sensor import SCENE as TOUCHED
from tests.helpers.touched_sensor import TRUE, made, made_up

ROOT = Path(__file__).parents[2]


def untimed(result):
    """A result without its times."""
    meshes = [{**mesh, "seconds": 0} for mesh in result.get("history", [])]
    return {**result, "seconds": 0, "history": meshes}


def python(code):
    """What a script prints, at the root of the checkout."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("solve scene.toml --set load.force_N=2", lambda s: solve(s.with_(load={"force_N": 2.0}))),
        ("modes scene.toml --count 2 --loaded", lambda s: modes(s, 2, loaded=True)),
    ],
)
def test_json_is_the_result_of_python(folder, command, line, found):
    run = command(*line.split(), "--json")
    assert (run.code, run.err, run.out.count("\n")) == (0, "", 1)
    assert untimed(run.json) == untimed(found(Scene.load("scene.toml")).to_json())


def test_tables_have_the_values_of_python(folder, command):
    """A charge is rounded to less than its error, and the error to less than a tenth."""
    solution, frequencies = solve("scene.toml"), modes("scene.toml").frequencies_Hz
    rows = re.findall(
        r"^([A-Z]) +([\d.]+) +([\d.e-]+) .*$", command("solve", "scene.toml").out, re.M
    )
    assert [name for name, _, _ in rows] == list("ABCD")
    for name, charge, error in rows:
        bound = solution.charge_errors_pC[name]
        assert float(charge) == pytest.approx(solution.charges_pC[name], abs=0.1 * bound)
        assert float(error) == pytest.approx(bound, rel=0.1)
    rows = re.findall(r"^\d .* ([\d.]+) +[\d.e-]+$", command("modes", "scene.toml").out, re.M)
    assert [float(row) for row in rows] == pytest.approx(frequencies, rel=1e-3)
    # without a probe the stress is uniform, 48 pC by the thesis's film, and there is no error
    line = r"^A +48\.00000000 +0 +48\.00000000 +0 +0\.00000000 +0$"
    assert re.search(line, command("solve", "bare.toml").out, re.M)


def test_a_response_by_frequency_is_that_of_python(folder, command):
    run = command("respond", "disc.toml", "--frequencies", "2:50:2", "--plot", "a.svg")
    expected = respond("disc.toml", [2.0, 50.0]).columns()
    rows = list(csv.DictReader(io.StringIO(run.out)))
    assert (run.code, list(rows[0])) == (0, list(expected))
    for name, values in expected.items():
        np.testing.assert_allclose([float(row[name]) for row in rows], values, rtol=1e-9)
    told = command("respond", "disc.toml", "--frequencies", "50", "--json").json
    np.testing.assert_allclose(told["A_real_V_N"], expected["A_real_V_N"][1], rtol=1e-6)
    assert len(told["left_out"]) == len(run.told)
    assert "<svg" in Path("a.svg").read_text()[:1000]


@pytest.mark.parametrize(
    ("line", "code", "status"),
    [
        ("solve scene.toml --vtu a.vtu", 3, "max_iterations"),
        ("modes scene.toml --set film.temperature_change_K=0 --plot a.svg", 3, "singular_tangent"),
        ("modes scene.toml --loaded", 3, "max_iterations"),
    ],
)
def test_what_has_not_converged_has_a_status_and_no_result(
    folder, command, monkeypatch, line, code, status
):
    few = partial(NewtonOptions, max_iterations=2)
    monkeypatch.setattr("pvdf_fem.solvers.ladder.NewtonOptions", few)
    run = command(*line.split(), "--json")
    assert (run.code, run.err, run.json["status"]) == (code, "", status)
    assert not {"charges_pC", "frequencies_Hz"} & run.json.keys()
    run = command(*line.split())
    assert (run.code, run.out) == (code, "")
    assert status in run.err
    assert not list(folder.glob("a.*"))


def test_doubts_about_a_scene_are_told_with_and_without_charges(folder, command):
    """A coefficient in C/N, also where unknowns are too few."""
    doubt = "film.d31_pC_N = 2.3e-11"
    tiny = ["--set", "film.d31_pC_N=2.3e-11"]
    assert doubt in command("solve", "scene.toml", *tiny).out
    few = ["--set", "numerics.max_unknowns=100", "--set", "numerics.tolerance=1e-6"]
    run = command("solve", "scene.toml", *tiny, *few)
    assert (run.code, run.told[-1]) == (3, doubt)


def test_patches_of_a_mesh_file_are_solved_on(folder, command):
    run = command("mesh", "scene.toml", "a.msh")
    grid = meshio.read("a.msh")
    assert (run.code, run.err) == (0, "")
    assert {*(f"electrode {name}" for name in "ABCD"), "probe"} < set(grid.field_data)
    given = command("solve", "scene.toml", "--mesh", "a.msh", "--json").json
    assert len(given["history"]) == 1
    assert given["charges_pC"] == pytest.approx(solve("scene.toml").charges_pC, rel=5e-2)
    other = command("solve", "scene.toml", "--set", "probe.x_mm=4", "--mesh", "a.msh")
    assert set(other.mistakes) == {"a.msh"}


def test_files_of_a_solution_are_whole(folder, command):
    run = command("solve", "scene.toml", "--json", "--vtu", "a.vtu", "--plot", "a.png")
    deflection = meshio.read("a.vtu").point_data["displacement_m"][:, 2]
    # the largest is not at a node
    assert 0.99 < 1e3 * deflection.max() / run.json["deflection_max_mm"] <= 1.0 + 1e-12
    pixels = imread("a.png")[..., :3]
    border = [pixels[:3], pixels[-3:], pixels[:, :3].swapaxes(0, 1), pixels[:, -3:].swapaxes(0, 1)]
    assert all((strip == 1.0).all() for strip in border)  # no label is cut


#: Command lines that write a picture, whatever else they do.
DRAWN = [
    "modes scene.toml --count 2",
    "solve bare.toml --quantity stress",
    "design disc.toml --vary electrodes.side_mm=2,3 --step 6",
    "locate disc.toml --charges A=600,B=500,C=400,D=500",
]


@pytest.mark.parametrize("line", DRAWN)
def test_pictures_are_drawn(folder, models, command, line):
    assert command(*line.split(), "--plot", "a.svg").code in (0, 3)
    assert "<svg" in Path("a.svg").read_text()[:1000]
    assert {path.name for path in folder.glob("a*")} == {"a.svg"}


# ---------------------------------------------------------------------- studies with made-up models


def test_touches_for_estimators_are_those_of_python(folder, models, command):
    asked = "--touches 30 --seed 5 --sigma 0.03 --noise 2 --set film.thickness_um=20"
    assert command("dataset", "disc.toml", *asked.split(), "--output", "touches.nc").code == 0
    sensor = Scene.load("disc.toml").with_(**{"film.thickness_um": 20.0})
    expected = dataset(sensor, 30, 5, 0.03, noise_pC=2.0, model=bumps("circle"))
    assert models == [sensor]
    with xarray.open_dataset("touches.nc") as kept:
        np.testing.assert_array_equal(kept.reading_pC, expected.reading_pC)
        assert kept.attrs["scene"] == expected.attrs["scene"]


def test_designs_are_printed_and_written(folder, models, command):
    vary = "--set electrodes.layout=ring --vary electrodes.count=4,6 --vary"
    vary += " 'electrodes.ring_radius_mm=[7, 9.5]' --noise 0.02 --step 4 --output a.nc"
    told = command("design", "disc.toml", *shlex.split(vary), "--json").json
    assert (told["noise"], told["step_mm"], len(models)) == (0.02, 4.0, 1)
    keys = [(of["count"], of["ring_radius_mm"]) for of in told["designs"]]
    assert keys == [(4, 7), (4, 9.5), (6, 7), (6, 9.5)]
    with xarray.open_dataset("a.nc") as data:
        medians = [of["place_deviation_median_mm"] for of in told["designs"]]
        np.testing.assert_array_equal(data.place_deviation_median_mm.values.ravel(), medians)
        assert data.place_deviation_mm.dims[-2:] == ("y_mm", "x_mm")
    thick = "film.thickness_um={start=10, stop=20, count=2}"
    run = command("design", "disc.toml", "--vary", thick, "--step", 6, "--output", "a.csv")
    assert (run.code, len(models), len(run.out.splitlines())) == (0, 3, 3)
    with open("a.csv") as table:
        assert [float(row["thickness_um"]) for row in csv.DictReader(table)] == [10.0, 20.0]


@pytest.mark.parametrize("count", [6, 4])
def test_a_sensor_is_calibrated_or_has_a_status(folder, command, monkeypatch, count):
    made_up(monkeypatch)
    placed = {key: value for key, value in TRUE.items() if key.startswith("stage.")}
    scene = TOUCHED.with_(**placed)
    Path("sensor.toml").write_text(scene.to_toml())
    columns = {key: values[:count] for key, values in made(6, sigma=0.01, place_sd=0.3).items()}
    with open("touches.csv", "w", newline="") as file:
        csv.writer(file).writerows([columns, *zip(*columns.values(), strict=True)])
    unknown = "film.pretension_N_m,gains"
    asked = ["calibrate", "sensor.toml", "touches.csv", "--unknown", unknown, "--place-sd", "0.3"]
    written = ["--output", "found.toml", "--page", "page.html"]
    run = command(*asked, *written, "--json")
    expected = calibrate(scene, "touches.csv", unknown.split(","), place_sd=0.3)
    assert (run.code, run.json["status"]) == ((0 if count == 6 else 3), str(expected.status))
    assert run.json == expected.to_json()
    assert Path("found.toml").exists() == (count == 6)
    if count == 6:
        assert (
            Scene.load("found.toml").readout.gain["A"] == run.json["parameters"]["gain.A"]["value"]
        )
        page = Path("page.html").read_text()
        assert page.count("<svg") == 3
        assert "http" not in page.replace("http://www.w3.org", "").replace("http://purl", "")
    else:
        told = command(*asked)
        assert (told.code, told.out, told.told[0]) == (3, "", run.json["status"])


# ------------------------------------------------------------------------------- changes by options


@pytest.mark.parametrize(
    ("settings", "key", "value"),
    [
        (['load.kind="follower"'], "load.kind", "follower"),
        ([" load.force_N = 2 "], "load.force_N", 2.0),
        (["numerics.observable=thesis-edge"], "numerics.observable", "thesis-edge"),
        (["film.youngs_modulus_GPa=[2.5, 2.0]"], "film.youngs_modulus_GPa", (2.5, 2.0)),
        (["film.d31_pC_N=0", "film.d31_pC_N=1"], "film.d31_pC_N", 1.0),
        (["film={thickness_um=12}", "film={d31_pC_N=10}"], "film.thickness_um", 12.0),
        (["electrodes.layout=ring", "electrodes.count=5"], "electrodes.count", 5),
    ],
)
def test_changes_are_toml_or_bare_words_and_the_last_counts(folder, settings, key, value):
    changed = scene_of(Namespace(scene="scene.toml", settings=settings))
    section, _, name = key.partition(".")
    assert getattr(getattr(changed, section), name) == value


@pytest.mark.parametrize(
    ("settings", "lost"),
    [
        (["probe.shape=circle"], ["probe.side_mm = 7.5"]),
        (["load={kind='dead', force_N=2}"], ['load.contact = "stuck"']),
        (
            ["load.kind=dead", "film.pretension_N_m=9"],
            ["film.temperature_change_K = -2.0", 'load.contact = "stuck"'],
        ),
        (["probe.x_mm=1", "electrodes.layout=three"], []),
    ],
)
def test_keys_that_a_change_leaves_out_are_told(folder, capsys, settings, lost):
    """Keys of the file, not defaults, and none that a change names."""
    Path("set.toml").write_text(
        "[probe]\nside_mm = 7.5\n[film]\ntemperature_change_K = -2.0\n"
        '[load]\nkind = "rigid"\ncontact = "stuck"\n'
    )
    scene_of(Namespace(scene="set.toml", settings=settings))
    told = capsys.readouterr().err.splitlines()
    assert len(told) == len(lost)
    assert all(key in line for key, line in zip(lost, told, strict=True))


# ------------------------------------------------------------------------ help, examples, processes


def test_help_has_every_key_and_examples_that_are_valid(folder, models, command):
    told = command("--help").out
    assert not {key.name for key in key_texts() if not re.search(rf"\b{key.name}\b", told)}
    assert (command().code, command().out) == (2, told)
    command("mesh", "scene.toml", "scene.msh")
    for name in ("solve", "mesh", "modes", "respond", "keys"):
        shown = re.findall(rf"^  pvdf-fem ({name} [^>\n]*)", command(name, "--help").out, re.M)
        scene = "disc.toml" if name == "respond" else "scene.toml"
        for example in shown:
            assert command(*example.replace("scene.toml", scene).split()).code == 0, example
        assert shown


def test_keys_and_examples_are_printed_by_name(command):
    assert Scene.parse(command("keys").out) == Scene()
    told = command("keys", "side_mm", "tension-field").out
    assert re.findall(r"^#?(\w+) = ", told, re.M) == ["compression", "side_mm", "side_mm"]
    assert re.findall(r"^\[.*\]$", told, re.M) == ["[film]", "[electrodes]", "[probe]"]
    listed = command("example").out.splitlines()
    assert [line.split()[0] for line in listed] == sorted(examples())
    assert Scene.parse(command("example", "triangle").out) == Scene.example("triangle")
    run = command("slove", "scene.toml")
    assert (run.code, "solve" in run.err) == (2, True)


def test_a_process_imports_only_what_it_needs(tmp_path):
    scene = tmp_path / "triangle.toml"
    scene.write_text(examples()["triangle"])
    asked = ["solve", str(scene), "--set", "numerics.tolerance=0.05"]
    printed = python(
        "import sys\n"
        "from pvdf_fem.cli.main import main\n"
        f"for arguments in (['--help'], ['solve', '--help'], ['--version'], {asked}):\n"
        "    try:\n        main(arguments)\n"
        "    except SystemExit:\n        pass\n"
        "    print({name for m in sys.modules for name in (m, m.partition('.')[0])})"
    )
    assert f"pvdf-fem {__version__}\n" in printed
    helping, solving = (ast.literal_eval(re.findall("^{.*}$", printed, re.M)[at]) for at in (2, 3))
    assert not helping & {"numpy", "scipy", "pydantic", "skfem", "gmsh", "meshio", "matplotlib"}
    assert solving >= {"gmsh", "pydantic", "scipy.sparse.linalg", "skfem"}
    rest = "constants fft integrate interpolate ndimage optimize signal spatial special stats"
    slow = {f"scipy.{name}" for name in rest.split()}
    slow |= {"contourpy", "dask", "jinja2", "joblib", "matplotlib", "meshio", "multiprocessing"}
    assert not solving & {*slow, "pandas", "sqlite3", "tqdm", "xarray"}


def test_a_closed_pipe_is_no_error(folder, command, monkeypatch):
    """Once gmsh was there, the signal ends the process, which a shell also shows as 141."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    solving = [sys.executable, "-m", "pvdf_fem", "solve", folder / "scene.toml", "--json"]
    with subprocess.Popen(solving, cwd=ROOT, **pipes) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode in (141, -signal.SIGPIPE)
    # the picture of a response is there all the same

    def closed(*_, **__):
        raise BrokenPipeError

    monkeypatch.setattr("pandas.DataFrame.to_csv", closed)
    responding = ["respond", "disc.toml", "--frequencies", "20", "--plot", "a.svg"]
    assert command(*responding).code == 141
    assert Path("a.svg").exists()
