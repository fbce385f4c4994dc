"""The command: what it prints where, its exit codes, and that it complains before it computes."""

from __future__ import annotations

import ast
import re
import signal
import subprocess
import sys
from argparse import Namespace
from functools import partial
from pathlib import Path

import meshio
import pytest
from matplotlib.image import imread

from pvdf_fem import Scene, __version__, solve
from pvdf_fem.cli.program import scene_of
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.files import printable
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Air, Load, Numerics, Readout, Stage
from pvdf_fem.scene.scene_file import examples
from pvdf_fem.scene.shapes import ELECTRODES, LAYOUTS, PROBES
from pvdf_fem.solvers.newton import NewtonOptions

ROOT = Path(__file__).parents[2]
SCENE = '[probe]\nshape = "rectangle"\nx_mm = 3.0\n[numerics]\ntolerance = 1e-2\n'


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def no_solve(monkeypatch):
    """Mistakes must be told before anything is meshed or solved."""

    def fail(*_, **__):
        pytest.fail("computed in spite of mistakes")

    for place in (
        "dynamics.forced.respond",  # first, since it imports the others
        "dynamics.modes.modes",
        "solution.solve.solve",
        "solution.refinement.mesh_scene",
        "mesh.gmsh_mesh.mesh_scene",
    ):
        monkeypatch.setattr(f"pvdf_fem.{place}", fail)


def untimed(result):
    """A result without its times."""
    meshes = [{**mesh, "seconds": 0} for mesh in result.get("history", [])]
    return {**result, "seconds": 0, "history": meshes}


def python(code, *arguments):
    """What a script prints, at the root of the checkout."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


def test_solve_imports_only_what_it_needs(tmp_path):
    scene = tmp_path / "triangle.toml"
    scene.write_text(examples()["triangle"])
    printed = python(
        "import sys\n"
        "from pvdf_fem.__main__ import main\n"
        f"sys.argv = ['pvdf-fem', 'solve', {str(scene)!r}, '--set', 'numerics.tolerance=0.05']\n"
        "assert main() == 0\n"
        "print({name for m in sys.modules for name in (m, m.partition('.')[0])})"
    )
    imported = ast.literal_eval(printed.splitlines()[-1])
    assert imported >= {"gmsh", "pydantic", "scipy.sparse.linalg", "skfem"}
    rest = "constants fft integrate interpolate ndimage optimize signal spatial special stats"
    slow = {f"scipy.{name}" for name in rest.split()}
    slow |= {"contourpy", "dask", "jinja2", "joblib", "matplotlib", "meshio", "multiprocessing"}
    assert not imported & {*slow, "pandas", "sqlite3", "tqdm", "xarray"}


def test_help_and_version_import_nothing_slow():
    code = (
        "import sys\n"
        "from pvdf_fem.cli.main import main\n"
        "for arguments in (['--help'], ['solve', '--help'], ['--version']):\n"
        "    try:\n        main(arguments)\n"
        "    except SystemExit:\n        pass\n"
        "slow = {'numpy', 'scipy', 'pydantic', 'skfem', 'gmsh', 'meshio', 'matplotlib'}\n"
        "print(slow & set(sys.modules))\n"
    )
    assert python(code).endswith(f"pvdf-fem {__version__}\nset()\n")


def test_examples_are_listed_and_printed(command):
    lines = command("example").out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(examples())
    text = command("example", "triangle").out
    assert Scene.parse(text) == Scene.example("triangle")
    assert command("example", "triangel").mistakes == ['"triangel"']


# ---------------------------------------------------------------------------------------- solve


def test_json_is_the_solution(scene, command):
    run = command("solve", scene, "--json", "--set", "load.force_N=2")
    expected = solve(Scene.parse(SCENE).with_(**{"load.force_N": 2.0})).to_json()
    assert (run.code, run.err) == (0, "")
    assert run.out.count("\n") == 1
    assert untimed(run.json) == untimed(expected)
    assert run.json["charges_pC"].keys() == run.json["charge_errors_pC"].keys() == set("ABCD")


def test_table_has_each_charge_with_its_error(scene, command):
    run = command("solve", scene)
    solution = solve(Scene.load(scene))
    assert (run.code, run.err) == (0, "")
    rows = re.findall(r"^([A-Z]) +([\d.]+) +([\d.e-]+) .*$", run.out, re.MULTILINE)
    assert [name for name, _, _ in rows] == list("ABCD")
    for name, charge, error in rows:
        # rounding changes a charge by less than its error, and the error by less than a tenth
        bound = solution.charge_errors_pC[name]
        assert float(charge) == pytest.approx(solution.charges_pC[name], abs=0.1 * bound)
        assert float(error) == pytest.approx(bound, rel=0.1)
    assert f"{solution.deflection_max_mm:.4g} mm" in run.out
    assert all(text in run.out for text in solution.left_out)


def test_charges_without_error_are_printed(tmp_path, command):
    """No probe: the stress is uniform, 48 pC by the thesis's film, and there is no error."""
    (tmp_path / "empty.toml").touch()
    text = command("solve", tmp_path / "empty.toml").out
    zero = r"0 +0\.00000000 +0"
    assert re.search(rf"^A +48\.00000000 +0 +48\.00000000 +{zero}$", text, re.MULTILINE)


def test_set_stretches_and_lays_out(tmp_path, command):
    (scene := tmp_path / "bare.toml").touch()
    pair = ["--set", "film.pretension_N_m=[12, 5]", "--set", "electrodes.layout=ring"]
    run = command("solve", scene, *pair, "--set", "electrodes.count=5", "--json")
    assert list(run.json["rest_charges_pC"]) == list("ABCDE")
    assert run.json["rest_charges_pC"]["E"] == pytest.approx(9.0 * 8.0 * 17.0 / 25.0)


def test_set_merges_tables(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("[film]\nradius_mm = 40\npretension_N_m = 9\n")
    tables = ["film={thickness_um=12}", "film={d31_pC_N=10}"]
    changes = {"film.thickness_um": 12.0, "film.d31_pC_N": 10.0}
    scene = scene_of(Namespace(scene=path, settings=tables))
    assert scene == Scene.load(path).with_(**changes)


@pytest.mark.parametrize(
    ("change", "key", "value"),
    [
        ('load.kind="follower"', "load", {"kind": "follower"}),
        (" load.force_N = 2 ", "load", {"force_N": 2.0}),
        ("numerics.observable=thesis-edge", "numerics", {"observable": "thesis-edge"}),
        ("film.youngs_modulus_GPa=[2.5, 2.0]", "film", {"youngs_modulus_GPa": (2.5, 2.0)}),
    ],
)
def test_set_takes_toml_and_bare_words(scene, change, key, value):
    changes = ["film.d31_pC_N=0", "film.d31_pC_N=1", change]  # the last of a key counts
    changed = scene_of(Namespace(scene=scene, settings=changes))
    assert value.items() <= dict(getattr(changed, key)).items()
    assert changed.film.d31_pC_N == 1.0


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
def test_keys_that_a_change_leaves_out_are_told(tmp_path, capsys, settings, lost):
    """Those of the file, not defaults, and none that a change names."""
    (path := tmp_path / "scene.toml").write_text(
        "[probe]\nside_mm = 7.5\n[film]\ntemperature_change_K = -2.0\n"
        '[load]\nkind = "rigid"\ncontact = "stuck"\n'
    )
    scene_of(Namespace(scene=path, settings=settings))
    told = capsys.readouterr().err.splitlines()
    assert len(told) == len(lost)
    assert all(key in line for key, line in zip(lost, told, strict=True))


# ------------------------------------------------------------------------------------- mistakes


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize("name", ["solve", "mesh", "modes"])
def test_mistakes_of_a_file_are_told_together(tmp_path, command, name):
    path = tmp_path / "scene.toml"
    path.write_text("[film]\nradius_mm = -45.0\n[load]\nforce = 2\n[numerics]\ntolerance = nan\n")
    file = [tmp_path / "a.msh"] if name == "mesh" else []
    mistakes = command(name, path, *file, "--set", "probe.shape").mistakes
    keys = {"film.radius_mm = -45.0", "load.force = 2", "numerics.tolerance = nan"}
    assert len(mistakes) == 4
    assert set(mistakes) == {"--set probe.shape", *keys}


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize(
    "change",
    ["load.force_N", "=2", "load.force_N=", "load.kind=2,5", "load.force_N=2N", "probe.x_mm=1\ny"],
)
def test_changes_that_are_none(scene, command, change):
    mistakes = command("solve", scene, "--set", change, "--set", "load.force_N=-1").mistakes
    assert mistakes == [f"--set {printable(change)}", "load.force_N = -1"]


SPHERE = ["probe={shape='sphere', radius_mm=5}", "load.kind=contact"]
RIVALS = "film.pretension_N_m=9", "film.temperature_change_K=-2"


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize(
    ("changes", "mistake"),
    [
        (["load.force_N=-1"], "load.force_N = -1"),
        (["load.kind=ded"], 'load.kind = "ded"'),
        (["lod.kind=dead"], "lod = a table"),
        (["self=3"], "self = 3"),
        (RIVALS, "film.temperature_change_K = -2"),
        ([*SPHERE, "load={force_N=0.5, depth_mm=2}"], "load.force_N = 0.5"),
        ([*SPHERE, "load.force_N=0.5", "load.depth_mm=2"], "load.force_N = 0.5"),
        (["film.radius_mm=-1e9", "film.radius_mm=2e9"], "film.radius_mm = 2000000000.0"),
    ],
)
def test_changes_that_the_scene_refuses(scene, command, changes, mistake):
    settings = [word for change in changes for word in ("--set", change)]
    assert command("solve", scene, *settings).mistakes == [mistake]


def test_a_profile_that_is_not_there(scene, command):
    mistakes = command("solve", scene, "--set", 'load.profile="none.csv"').mistakes
    assert mistakes == ['load.profile = "none.csv"']


@pytest.mark.usefixtures("no_solve")
def test_a_change_of_one_key_in_two_spellings_is_one_change(tmp_path, command):
    path = tmp_path / "list.toml"
    path.write_text('[[electrodes]]\nname = "A"\nx_mm = 9\ny_mm = 0\n')
    values = ("electrodes[0].x_mm=-1e9", "electrodes.0.x_mm=2e9")
    changes = [word for value in values for word in ("--set", value)]
    assert command("solve", path, *changes).mistakes == ["electrodes[0].x_mm = 2000000000.0"]


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize("count", ["0", "-3", "1000", "2.0", "1_0", "٣", 5000 * "9"])
def test_modes_without_a_number(scene, command, count):
    assert command("modes", scene, "--count", count).mistakes == [f"--count {count[:60]}"]


@pytest.mark.parametrize("name", ["locate", "calibrate", "track"])
def test_jobs_for_one_probe_refuse_a_list(tmp_path, command, name):
    (path := tmp_path / "two.toml").write_text("[[probe]]\n[[probe]]\nx_mm = 12.0\n")
    rest = {"locate": ["--charges=A=1,B=2,C=3,D=4"], "calibrate": [path], "track": ["-"]}
    assert command(name, path, *rest[name]).mistakes == ['probe = ["triangle", "triangle"]']


def test_an_unknown_command_is_told_the_nearest(command):
    run = command("slove", "scene.toml")
    assert run.code == 2
    assert "solve" in run.err


# -------------------------------------------------------------------------------------- outputs


@pytest.mark.usefixtures("no_solve")
def test_outputs_are_checked_before_the_solve(scene, tmp_path, command):
    for vtu, plot in (("nowhere/a.vtu", "nowhere/a.png"), ("a.txt", "a.dxf")):
        files = [tmp_path / vtu, tmp_path / plot]
        run = command("solve", scene, "--vtu", files[0], "--plot", files[1])
        assert run.mistakes == [*map(str, files)]
    assert command("mesh", scene, tmp_path / "a.stl").mistakes == [str(tmp_path / "a.stl")]
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_an_output_never_overwrites_an_input_or_another_output(scene, tmp_path, command, link):
    for name in ("a.vtu", "a.png", "a.msh", "a.nc"):
        link(tmp_path / name, scene)
    (tmp_path / "b.vtu").write_text("b")
    link(tmp_path / "b.svg", tmp_path / "b.vtu")
    sweep = tmp_path / "sweep.toml"
    sweep.write_text('scene = "scene.toml"\n[[axes]]\nload.force_N = [1.0]\n')
    link(tmp_path / "s.nc", sweep)
    new = tmp_path / "new.nc"
    commands = [
        (["solve", scene, "--vtu", tmp_path / "a.vtu"], "a.vtu"),
        (["solve", scene, "--plot", tmp_path / "a.png"], "a.png"),
        (["solve", scene, "--vtu", tmp_path / "b.vtu", "--plot", tmp_path / "b.svg"], "b.svg"),
        (["mesh", scene, tmp_path / "a.msh"], "a.msh"),
        (["sweep", sweep, "--output", tmp_path / "a.nc"], "a.nc"),
        (["sweep", sweep, "--output", tmp_path / "s.nc"], "s.nc"),
        (["sweep", sweep, "--output", new, "--store", tmp_path / "a.nc"], "a.nc"),
        (["sweep", sweep, "--output", new, "--store", sweep], "sweep.toml"),
        (["sweep", sweep, "--output", new, "--store", new], "new.nc"),
        (["sweep", sweep, "--plan", "--store", scene], "scene.toml"),
    ]
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments, output in commands:
        assert command(*arguments).mistakes == [str(tmp_path / output)]
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_files_are_written(scene, tmp_path, command):
    vtu, plot = tmp_path / "a.vtu", tmp_path / "a.png"
    run = command("solve", scene, "--json", "--vtu", vtu, "--plot", plot)
    assert (run.code, run.err) == (0, "")
    deflection = meshio.read(vtu).point_data["displacement_m"][:, 2]
    # the largest is not at a node
    assert 0.99 < 1e3 * deflection.max() / run.json["deflection_max_mm"] <= 1.0 + 1e-12
    pixels = imread(plot)[..., :3]
    border = [pixels[:3], pixels[-3:], pixels[:, :3].swapaxes(0, 1), pixels[:, -3:].swapaxes(0, 1)]
    assert all((strip == 1.0).all() for strip in border)  # no label is cut
    assert {path.name for path in tmp_path.iterdir()} == {"scene.toml", "a.vtu", "a.png"}


def test_a_map_of_a_quantity_that_there_is_not_is_refused_before_the_solve(tmp_path, command):
    (scene := tmp_path / "scene.toml").touch()
    drawn = ["solve", scene, "--plot", tmp_path / "a.svg", "--quantity"]
    for name in ("strain", "contact"):
        assert command(*drawn, name).mistakes == ["--quantity"]
    assert command("solve", scene, "--quantity", "stress").code == 2  # without --plot
    assert command(*drawn, "stress").code == 0
    assert "<svg" in (tmp_path / "a.svg").read_text()[:1000]


@pytest.fixture
def two_iterations(monkeypatch):
    few = partial(NewtonOptions, max_iterations=2)
    monkeypatch.setattr("pvdf_fem.solvers.ladder.NewtonOptions", few)


@pytest.mark.usefixtures("two_iterations")
def test_no_charges_unless_converged(scene, tmp_path, command):
    solving = ["solve", scene, "--vtu", tmp_path / "a.vtu"]
    run = command(*solving, "--json")
    assert (run.code, run.json["status"]) == (3, "max_iterations")
    assert "load.force_N" in run.json["reason"]
    assert "charges_pC" not in run.json
    run = command(*solving)
    assert (run.code, run.out) == (3, "")
    assert "max_iterations" in run.err
    assert not (tmp_path / "a.vtu").exists()


def test_doubts_are_told_with_and_without_charges(tmp_path, command, request):
    scene = tmp_path / "flat.toml"
    scene.write_text("[load]\nforce_N = 2.0\n")
    assert "load" in command("solve", scene).out.splitlines()[1]
    request.getfixturevalue("two_iterations")
    scene.write_text('[film]\nd31_pC_N = 23e-12\n[probe]\nshape = "circle"\n')
    run = command("solve", scene)
    assert (run.code, run.out) == (3, "")
    assert "film.d31_pC_N = 2.3e-11" in run.err.splitlines()[-1]


# ------------------------------------------------------------------------------- mesh and modes


def test_mesh_writes_patches_and_is_solved_on(scene, tmp_path, command):
    mesh = tmp_path / "a.msh"
    run = command("mesh", scene, mesh)
    assert (run.code, run.err) == (0, "")
    grid = meshio.read(mesh)
    assert {*(f"electrode {name}" for name in "ABCD"), "probe"} < set(grid.field_data)
    assert str(len(grid.cells[0].data)) in run.out
    given = command("solve", scene, "--mesh", mesh, "--json").json
    assert len(given["history"]) == 1
    for name, charge in solve(Scene.load(scene)).charges_pC.items():
        assert given["charges_pC"][name] == pytest.approx(charge, rel=1e-2)
    other = command("solve", scene, "--set", "probe.x_mm=4", "--mesh", mesh)
    assert set(other.mistakes) == {str(mesh)}


def test_modes(scene, tmp_path, command):
    scene.write_text(SCENE)
    run = command("modes", scene, "--count", 2, "--loaded", "--json")
    expected = modes(Scene.load(scene), 2, loaded=True).to_json()
    assert (run.code, run.err) == (0, "")
    assert untimed(run.json) == untimed(expected)
    assert len(run.json["frequencies_Hz"]) == 2
    run = command("modes", scene, "--plot", tmp_path / "a.svg")
    rows = re.findall(r"^(\d) .* ([\d.]+) +[\d.e-]+$", run.out, re.MULTILINE)
    assert [number for number, _ in rows] == list("123456")
    assert float(rows[0][1]) == pytest.approx(117.05, rel=1e-2)
    assert "<svg" in (tmp_path / "a.svg").read_text()[:1000]


def test_modes_of_a_film_without_tension(scene, command):
    slack = ["modes", scene, "--set", "film.temperature_change_K=0"]
    run = command(*slack)
    assert (run.code, run.out) == (3, "")
    assert "singular_tangent" in run.err
    assert "film.temperature_change_K" in run.err
    run = command(*slack, "--json")
    assert (run.code, run.err) == (3, "")
    assert "frequencies_Hz" not in run.json


# ----------------------------------------------------------------------------------- help, pipes


def test_help_names_every_key_of_a_scene(command):
    told = command("--help").out
    models = [Air, Film, Load, Numerics, Readout, Stage]
    models += [*PROBES.values(), *ELECTRODES.values(), *LAYOUTS.values()]
    keys = {key for model in models for key in model.model_fields}
    assert not {key for key in keys if not re.search(rf"\b{key}\b", told)}
    assert command().out == told
    assert command().code == 2


def test_keys_are_told_by_words(command):
    assert Scene.parse(command("keys").out) == Scene()
    told = command("keys", "side_mm", "tension-field").out
    assert re.findall(r"^#?(\w+) = ", told, re.M) == ["compression", "side_mm", "side_mm"]
    sections = ["[film]", "[electrodes]", "[probe]"]
    assert re.findall(r"^\[.*\]$", told, re.M) == sections
    assert "film.thickness_um" in command("keys", "uncertain").out
    assert command("keys", "thicknes_um").mistakes == ["thicknes_um"]


@pytest.mark.parametrize("name", ["solve", "mesh", "modes", "respond"])
def test_examples_of_the_help_are_valid(scene, tmp_path, monkeypatch, command, name):
    monkeypatch.chdir(tmp_path)
    command("mesh", "scene.toml", "scene.msh")
    text = command(name, "--help").out
    shown = re.findall(rf"^  pvdf-fem ({name} .*)$", text, re.MULTILINE)
    assert shown
    for example in shown:
        assert command(*example.split()).code == 0, example


def test_closed_pipe_is_no_error(scene):
    command = [sys.executable, "-m", "pvdf_fem", "solve", scene, "--json"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, text=True, cwd=ROOT, **pipes)
    process.stdout.close()
    _, err = process.communicate(timeout=60)
    # once gmsh was there, the signal ends the process, which a shell also shows as 141
    assert process.returncode in (141, -signal.SIGPIPE)
    assert err == ""
