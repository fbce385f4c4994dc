"""The output of each command: exit code, the values of Python's results, and files."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
from argparse import Namespace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray

from pvdf_fem import Scene, __version__, calibrate, dataset, modes, respond, solve
from pvdf_fem.cli.options import read_scene
from pvdf_fem.scene.materials.catalogue import FILM_NAMES, LAYER_NAMES
from pvdf_fem.scene.scene_file import read_examples, read_key_texts
from pvdf_fem.solver.nonlinear.deferred_newton import NewtonOptions
from tests.helpers.bump_response import make_bump_response
from tests.helpers.touched_sensor import SCENE as TOUCHED
from tests.helpers.touched_sensor import TRUE, make_columns, patch_solver

ROOT = Path(__file__).parents[2]


def is_svg(name):
    return "<svg" in Path(name).read_text()[:1000]


def without_times(result):
    """Return a result without its times."""
    meshes = [{**mesh, "seconds": 0} for mesh in result.get("history", [])]
    return {**result, "seconds": 0, "history": meshes}


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("solve scene.toml --set load.force_N=2", lambda s: solve(s.with_(load={"force_N": 2.0}))),
        ("modes scene.toml --count 2 --loaded", lambda s: modes(s, 2, loaded=True)),
        ("respond disc.toml --frequencies 50", lambda _: respond("disc.toml", [50.0])),
    ],
)
def test_json_and_text_are_the_result_of_python(folder, command, line, found):
    run, expected = command(*line.split(), "--json"), found(Scene.from_file("scene.toml"))
    assert (run.code, run.err, run.out.count("\n")) == (0, "", 1)
    assert without_times(run.json) == without_times(json.loads(json.dumps(expected.to_json())))
    run = command(*line.split(), "--plot", "a.svg")
    tables = [text.splitlines()[:6] for text in (run.out, str(expected))]  # times follow
    assert (run.code, tables[0]) == (0, tables[1])
    assert is_svg("a.svg")


def test_a_response_is_csv_by_frequency(folder, command):
    run = command("respond", "disc.toml", "--frequencies", "2:600:2")
    expected = respond("disc.toml", [2.0, 600.0])
    found = pd.read_csv(io.StringIO(run.out))
    pd.testing.assert_frame_equal(found, expected.to_dataframe(), rtol=1e-9)
    assert (run.code, len(run.stderr_keys)) == (0, len(expected.neglected))


@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("solve scene.toml --vtu a.vtu --set film.d31_pC_N=2.3e-11", "max_iterations"),
        ("modes scene.toml --set film.temperature_change_K=0 --plot a.svg", "singular_tangent"),
        ("respond disc.toml --plot a.svg", "max_iterations"),
    ],
)
def test_without_convergence_there_is_a_status_and_no_result(
    folder, command, monkeypatch, line, status
):
    few = partial(NewtonOptions, max_iterations=2)
    monkeypatch.setattr("pvdf_fem.solver.nonlinear.fallback.NewtonOptions", few)
    run = command(*line.split())
    assert (run.code, run.out, status in run.err) == (3, "", True)
    assert ("film.d31_pC_N = 2.3e-11" in run.stderr_keys) == ("solve" in line)  # a warning
    run = command(*line.split(), "--json")
    assert (run.code, list(folder.glob("a.*"))) == (3, [])
    if "respond" not in line:
        assert (run.err, run.json["status"]) == ("", status)
        assert not {"charges_pC", "frequencies_Hz"} & run.json.keys()


def test_a_mesh_file_is_solved_with_its_patches(folder, command):
    run = command("mesh", "scene.toml", "a.msh")
    assert (run.code, run.err) == (0, "")
    options = "--mesh a.msh --json --vtu a.vtu --plot a.svg --quantity stress"
    result = command("solve", "scene.toml", *options.split()).json
    assert len(result["history"]) == 1
    assert result["charges_pC"] == pytest.approx(solve("scene.toml").charges_pC, rel=5e-2)
    assert is_svg("a.svg")
    assert Path("a.vtu").exists()
    other = command("solve", "scene.toml", "--set", "probe.x_mm=4", "--mesh", "a.msh")
    assert set(other.error_keys) == {"a.msh"}


def test_the_style_of_a_mesh_file_is_chosen_by_options(folder, command):
    run = command("mesh", "scene.toml", "a.inp", "--element", "m3d3")
    assert (run.code, run.err) == (0, "")
    assert "TYPE=M3D3" in Path("a.inp").read_text()
    run = command("mesh", "scene.toml", "a.msh", "--format", "msh22", "--order", "1")
    assert (run.code, run.err) == (0, "")
    assert Path("a.msh").read_text().startswith("$MeshFormat\n2.2 0 8")
    for options in ("a.xdmf", "b.inp --element C3D4", "b.inp --element S6 --order 1"):
        refused = command("mesh", "scene.toml", *options.split())
        assert (refused.code, refused.out) == (2, "")
    assert not Path("b.inp").exists()


def test_a_deck_is_written_or_refused_by_key(folder, command):
    written = command("deck", "scene.toml", "a.inp", "--tolerance", "0.02", "--json")
    assert (written.code, written.err) == (0, "")
    assert written.json["mesh_error"] <= 0.02
    assert "*MEMBRANE SECTION" in Path("a.inp").read_text()
    for options, key in (
        ("b.inp --set load.kind=rigid", "load.kind"),
        ("b.inp --set film.bending=true", "film.bending"),
        ("b.inp --tolerance 0", "--tolerance 0"),
        ("b.dat", "b.dat"),
        ("--tolerance 0.02", "FILE.inp"),
        ("--read a.dat", "a.dat"),
    ):
        refused = command("deck", "scene.toml", *options.split())
        assert (refused.code, refused.out) == (2, "")
        assert key in refused.err
    assert not list(Path().glob("b.*"))


# ------------------------------------------------------------------- studies with made-up responses


def test_a_dataset_is_that_of_python(folder, made_up_responses, command):
    options = "--touches 30 --seed 5 --sigma 0.03 --noise 2 --set film.thickness_um=20"
    assert command("dataset", "disc.toml", *options.split(), "--output", "touches.nc").code == 0
    sensor = Scene.from_file("disc.toml").with_(**{"film.thickness_um": 20.0})
    expected = dataset(sensor, 30, 5, 0.03, noise_pC=2.0, response=make_bump_response("circle"))
    assert made_up_responses == [sensor]
    with xarray.open_dataset("touches.nc") as dataset_file:
        np.testing.assert_array_equal(dataset_file.reading_pC, expected.reading_pC)
        assert dataset_file.attrs["scene"] == expected.attrs["scene"]


def test_designs_are_printed_drawn_and_written(folder, made_up_responses, command):
    thick = "film.thickness_um={start=10, stop=20, count=2}"
    options = "design disc.toml --set electrodes.layout=ring --sigma 0.02 --step 6 --vary"
    line = [*options.split(), "electrodes.count=4,6", "--vary", thick]
    result = command(*line, "--json", "--output", "a.csv", "--plot", "a.svg").json
    assert (result["noise"], result["step_mm"], len(made_up_responses)) == (0.02, 6.0, 2)
    keys = [(of["count"], of["thickness_um"]) for of in result["designs"]]
    assert keys == [(4, 10.0), (4, 20.0), (6, 10.0), (6, 20.0)]
    pd.testing.assert_frame_equal(pd.read_csv("a.csv"), pd.DataFrame(result["designs"]))
    assert is_svg("a.svg")
    run = command(*line)
    assert (run.code, len(run.out.splitlines())) == (0, 5)


@pytest.mark.parametrize("count", [6, 4])
def test_a_sensor_is_calibrated_or_has_a_status(folder, command, monkeypatch, count):
    patch_solver(monkeypatch)
    placed = {key: value for key, value in TRUE.items() if key.startswith("stage.")}
    scene = TOUCHED.with_(**placed)
    Path("sensor.toml").write_text(scene.to_toml())
    columns = {
        key: values[:count] for key, values in make_columns(6, sigma=0.01, place_sd=0.3).items()
    }
    with open("touches.csv", "w", newline="") as file:
        csv.writer(file).writerows([columns, *zip(*columns.values(), strict=True)])
    unknown, priors = "film.pretension_N_m,gains", {"gains": 0.2}
    line = ["calibrate", "sensor.toml", "touches.csv", "--unknown", unknown, "--place-sd", "0.3"]
    line += ["--prior", "gains=0.2"]
    run = command(*line, "--output", "found.toml", "--page", "page.html", "--json")
    expected = calibrate(scene, "touches.csv", unknown.split(","), place_sd=0.3, priors=priors)
    assert (run.code, run.json) == ((0 if count == 6 else 3), expected.to_json())
    assert "<svg" in Path("page.html").read_text()
    assert Path("found.toml").exists() == (count == 6)
    text = command(*line)
    if count == 6:
        gain = Scene.from_file("found.toml").readout.gain["A"]
        assert gain == run.json["parameters"]["gain.A"]["value"]
        assert (text.code, text.err, text.out) == (0, "", f"{expected}\n")
    else:
        assert (text.code, text.out, text.stderr_keys[0]) == (3, "", run.json["status"])


# ------------------------------------------------------------------------------- changes by options


def test_the_last_change_counts_and_lost_keys_are_reported(folder, capsys):
    """Lost are keys of the file, not defaults, and none that a change names."""
    Path("set.toml").write_text(
        "[probe]\nside_mm = 7.5\nx_mm = 2\n[film]\ntemperature_change_K = -2.0\n"
        '[load]\nkind = "rigid"\ncontact = "stuck"\n'
    )
    changes = ["probe.shape=circle", "load.kind=dead", "electrodes.layout=three", "probe.x_mm=1"]
    changes += ["film={thickness_um=12, density_kg_m3=900}", "film={thickness_um=10}"]
    changes += ["film.pretension_N_m=9", "load.force_N=2", "load.force_N=3"]
    changed = read_scene(Namespace(scene="set.toml", settings=changes))
    assert (changed.film.thickness_um, changed.film.density_kg_m3) == (10.0, 900.0)
    assert changed.load.force_N == 3.0
    lost = ["film.temperature_change_K = -2.0", "probe.side_mm = 7.5", 'load.contact = "stuck"']
    lines = capsys.readouterr().err.splitlines()
    assert [[key for key in lost if key in line] for line in lines] == [[key] for key in lost]


# ----------------------------------------------------------------------------- names and processes


def test_keys_and_examples_are_printed_by_name(command):
    assert command("--version").out == f"pvdf-fem {__version__}\n"
    text = command("--help").out
    assert not {key.name for key in read_key_texts() if not re.search(rf"\b{key.name}\b", text)}
    assert Scene.parse(command("keys").out) == Scene()
    assert {"[probe]", "[[electrodes]]"} <= set(command("keys", "ellipse").out.splitlines())
    text = command("keys", "ring_radius", "tension-field", "tilt").out
    assert re.findall(r"^#?(\w+) = ", text, re.M) == ["compression", "ring_radius_mm", "tilt"]
    assert re.findall(r"^\[.*\]$", text, re.M) == ["[film]", "[electrodes]", "[load]"]
    listed = command("example").out.splitlines()
    assert [line.split()[0] for line in listed] == sorted(read_examples())
    assert Scene.parse(command("example", "triangle").out) == Scene.example("triangle")
    run = command("slove", "scene.toml")
    assert (run.code, "solve" in run.err) == (2, True)
    for words in (["--force", "2"], ["--force=2"]):
        assert "--set load.force_N=2" in command("solve", "scene.toml", *words).err


def test_materials_are_printed_as_table_json_scene_and_patch(command):
    names = set(FILM_NAMES) | set(LAYER_NAMES)
    lines = command("materials").out.splitlines()
    assert names <= {line.split()[0] for line in lines if line}
    table = command("materials", "--json").json
    assert {one["name"] for kind in ("films", "layers") for one in table[kind]} == names
    for name in names:
        one = command("materials", name, "--json").json
        text = command("materials", name).out
        sources = {
            source["citation"] for p in one["properties"].values() for source in p["sources"]
        }
        assert not [citation for citation in sources if citation not in text]
        assert Scene.parse(command("materials", name, "--patch").out).film.patches
    assert Scene.parse(command("materials", "pet", "--scene").out).film.material == "pet"


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["pat"], "name"),
        (["silver-ink", "--scene"], "silver-ink"),
        (["--scene"], "--scene"),
        (["--patch"], "--patch"),
    ],
)
def test_wrong_names_of_materials_are_refused(command, words, key):
    run = command("materials", *words)
    assert (run.code, run.out) == (2, "")
    assert run.err.startswith(key)


HEAVY = "numpy scipy pydantic skfem gmsh meshio matplotlib"
SLOW = "contourpy dask jinja2 joblib matplotlib meshio multiprocessing pandas sqlite3 tqdm xarray "
SLOW += "scipy.constants scipy.fft scipy.integrate scipy.interpolate scipy.ndimage scipy.optimize "
SLOW += "scipy.signal scipy.spatial scipy.special scipy.stats"


@pytest.mark.parametrize(
    ("line", "absent"),
    [
        ("solve --help", HEAVY),
        ("solve triangle.toml --set numerics.tolerance=0.05", SLOW),
    ],
)
def test_a_process_imports_only_what_it_needs(folder, line, absent):
    Path("triangle.toml").write_text(read_examples()["triangle"])
    code = f"from pvdf_fem.cli.main import main; main({line.split()})"
    code = f"import atexit, sys; atexit.register(lambda: print(*sys.modules)); {code}"
    printed = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert not {*absent.split()} & {*printed.splitlines()[-1].split()}
