"""The command: what it prints where, its exit codes, and that it complains before it computes."""

from __future__ import annotations

import ast
import json
import re
import signal
import subprocess
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import meshio
import pytest
from matplotlib.image import imread
from pydantic import BaseModel

from pvdf_fem import Scene, __version__, solve
from pvdf_fem.cli import main as cli
from pvdf_fem.cli.program import scene_of
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.files import printable
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Air, Load, Numerics, Readout, Stage
from pvdf_fem.scene.scene_file import examples
from pvdf_fem.scene.shapes import ELECTRODES, PROBES, RINGS, Layout
from pvdf_fem.solvers.newton import NewtonOptions

ROOT = Path(__file__).parents[2]
SCENE = '[probe]\nshape = "rectangle"\nx_mm = 3.0\n'


class Run:
    """Exit code, standard output and standard error of a command in this process."""

    def __init__(self, arguments: Sequence[object], capture: pytest.CaptureFixture[str]) -> None:
        try:
            self.code: Any = cli.main([str(argument) for argument in arguments])
        except SystemExit as exit_:  # of argparse
            self.code = exit_.code
        self.out, self.err = capture.readouterr()

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    @property
    def mistakes(self) -> list[str]:
        """Lines of standard error, of a run that must have refused its input."""
        assert (self.code, self.out) == (2, "")
        return self.err.splitlines()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_solve_imports_only_what_it_needs(tmp_path):
    scene = tmp_path / "triangle.toml"
    scene.write_text(examples()["triangle"])
    code = (
        "import sys\n"
        "from pvdf_fem.__main__ import main\n"
        f"sys.argv = ['pvdf-fem', 'solve', {str(scene)!r}, '--set', 'numerics.tolerance=0.05']\n"
        "assert main() == 0\n"
        "print({name for m in sys.modules for name in (m, m.partition('.')[0])})"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    imported = ast.literal_eval(done.stdout.splitlines()[-1])
    assert imported >= {"gmsh", "pydantic", "scipy.sparse.linalg", "skfem"}
    rest = "constants fft integrate interpolate ndimage optimize signal spatial special stats"
    slow = {f"scipy.{name}" for name in rest.split()}
    slow |= {"contourpy", "dask", "jinja2", "joblib", "matplotlib", "meshio", "multiprocessing"}
    assert not imported & {*slow, "pandas", "sqlite3", "tqdm", "xarray"}


def test_examples_are_listed_and_printed(capsys):
    lines = Run(["example"], capsys).out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(examples())
    assert "triangle           Four electrodes and a triangular probe" in "\n".join(lines)
    text = Run(["example", "triangle"], capsys).out
    assert Scene.parse(text) == Scene.example("triangle")
    told = ['"triangel": is no example; did you mean triangle?']
    assert Run(["example", "triangel"], capsys).mistakes == told


def _untimed(result: dict[str, Any]) -> dict[str, Any]:
    """A result without its times."""
    meshes = [{**mesh, "seconds": 0} for mesh in result.get("history", [])]
    return {**result, "seconds": 0, "history": meshes}


@pytest.fixture
def no_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mistakes must be told before anything is meshed or solved."""

    def fail(*_: object, **__: object) -> None:
        pytest.fail("computed in spite of mistakes")

    for place in (
        "dynamics.forced.respond",  # first, since it imports the others
        "dynamics.modes.modes",
        "solution.solve.solve",
        "solution.refinement.mesh_scene",
        "mesh.gmsh_mesh.mesh_scene",
    ):
        monkeypatch.setattr(f"pvdf_fem.{place}", fail)


# ---------------------------------------------------------------------------------------- solve


def test_json_is_the_solution(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = Run(["solve", scene, "--json", "--set", "load.force_N=2"], capsys)
    expected = solve(Scene.parse(SCENE).with_(**{"load.force_N": 2.0})).to_json()
    assert (run.code, run.err) == (0, "")
    assert run.out.count("\n") == 1
    assert _untimed(run.json) == _untimed(expected)
    assert run.json["charges_pC"].keys() == run.json["charge_errors_pC"].keys() == set("ABCD")


def test_table_has_each_charge_with_its_error(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Run(["solve", scene], capsys)
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
    assert all(text in run.out for text in ("converged", "material", *solution.left_out))


def test_charges_without_error_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No probe: the stress is uniform, 48 pC by the thesis's film, and there is no error."""
    (tmp_path / "empty.toml").touch()
    text = Run(["solve", tmp_path / "empty.toml"], capsys).out
    zero = r"0 +0\.00000000 +0"
    assert re.search(rf"^A +48\.00000000 +0 +48\.00000000 +{zero}$", text, re.MULTILINE)


def test_set_stretches_and_lays_out(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pair = ["--set", "film.pretension_N_m=[12, 5]", "--set", "electrodes.layout=ring"]
    run = Run(["solve", scene, *pair, "--set", "electrodes.count=5", "--json"], capsys)
    assert list(run.json["rest_charges_pC"]) == list("ABCDE")
    assert run.json["rest_charges_pC"]["E"] == pytest.approx(9.0 * 8.0 * 17.0 / 25.0)
    both = ["--set", "film.pretension_N_m=9", "--set", "film.temperature_change_K=-2"]
    (mistake,) = Run(["solve", scene, *both], capsys).mistakes
    assert "film.temperature_change_K = -2: stands beside film.pretension_N_m = 9.0" in mistake


def test_set_merges_tables_and_refuses_rivals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.toml"
    path.write_text("[film]\nradius_mm = 40\npretension_N_m = 9\n")
    tables = ["film={thickness_um=12}", "film={d31_pC_N=10}"]
    changes = {"film.thickness_um": 12.0, "film.d31_pC_N": 10.0}
    scene = scene_of(Namespace(scene=path, settings=tables))
    assert scene == Scene.load(path).with_(**changes)
    path.write_text('[probe]\nshape = "sphere"\nradius_mm = 5\n[load]\nkind = "contact"\n')
    both = ["--set", "load.force_N=0.5", "--set", "load.depth_mm=2"]
    for changes in (both, ["--set", "load={force_N=0.5, depth_mm=2}"]):
        (mistake,) = Run(["solve", path, *changes], capsys).mistakes
        assert mistake.startswith("load.force_N = 0.5: ")


@pytest.mark.parametrize(
    ("change", "key", "value"),
    [
        ("load.force_N=2", "load", {"force_N": 2.0}),
        ("load.kind=follower", "load", {"kind": "follower"}),
        ('load.kind="follower"', "load", {"kind": "follower"}),
        ("numerics.observable=thesis-edge", "numerics", {"observable": "thesis-edge"}),
        (" load.force_N = 2 ", "load", {"force_N": 2.0}),
        ("film.youngs_modulus_GPa=[2.5, 2.0]", "film", {"youngs_modulus_GPa": (2.5, 2.0)}),
        ("electrodes.layout=three", "electrodes", {"layout": "three"}),
    ],
)
def test_set_takes_toml_and_bare_words(
    scene: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    change: str,
    key: str,
    value: dict[str, Any],
) -> None:
    seen = []

    def spy(scene: Scene, **_: object) -> Any:
        seen.append(scene)
        raise KeyboardInterrupt

    monkeypatch.setattr("pvdf_fem.solution.solve.solve", spy)
    assert Run(["solve", scene, "--set", "film.d31_pC_N=1", "--set", change], capsys).code == 130
    changed = getattr(seen[0], key)
    assert value.items() <= dict(changed).items()
    assert seen[0].film.d31_pC_N == 1.0


def test_last_change_of_a_key_counts(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes = ["--set", "load.force_N=-5", "--set", "load.force_N=0"]
    assert Run(["solve", scene, *changes, "--json"], capsys).json["deflection_max_mm"] == 0.0


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize("command", ["solve", "mesh", "modes"])
def test_mistakes_of_a_file_are_told_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("[film]\nradius_mm = -45.0\n[load]\nforce = 2\n[numerics]\ntolerance = nan\n")
    file = [tmp_path / "a.msh"] if command == "mesh" else []
    mistakes = Run([command, path, *file, "--set", "probe.shape"], capsys).mistakes
    keys = ("film.radius_mm = -45.0: ", "load.force = 2: ", "numerics.tolerance = nan: ")
    for start in ("--set probe.shape: ", *keys):
        assert sum(line.startswith(start) for line in mistakes) == 1
    assert len(mistakes) == 4


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize(
    "change",
    [
        "load.force_N",
        "=2",
        "load.force_N=",
        "load.kind=2,5",
        "load.force_N=2N",
        "probe.x_mm=1\ny=2",
    ],
)
def test_changes_that_are_none(
    scene: Path, capsys: pytest.CaptureFixture[str], change: str
) -> None:
    run = Run(["solve", scene, "--set", change, "--set", "load.force_N=-1"], capsys)
    assert run.err.startswith(f"--set {printable(change)}: ")
    assert run.mistakes[-1].startswith("load.force_N = -1: ")


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("load.force_N=-1", "load.force_N = -1: is too small"),
        ("load.kind=ded", 'load.kind = "ded": is not known; did you mean dead?'),
        ("lod.kind=dead", "lod = a table: is no key there; did you mean load?"),
        ("probe.x_mm=44", "probe"),
        ("self=3", "self = 3: is no key there"),
    ],
)
def test_changes_that_the_scene_refuses(
    scene: Path, capsys: pytest.CaptureFixture[str], change: str, told: str
) -> None:
    (mistake,) = Run(["solve", scene, "--set", change], capsys).mistakes
    assert mistake.startswith(told)


@pytest.mark.usefixtures("no_solve")
def test_outputs_are_checked_before_the_solve(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = tmp_path / "nowhere"
    run = Run(["solve", scene, "--vtu", nowhere / "a.vtu", "--plot", nowhere / "a.png"], capsys)
    assert [line.split(": ")[0] for line in run.mistakes] == [
        f"{nowhere}/a.vtu",
        f"{nowhere}/a.png",
    ]
    run = Run(["solve", scene, "--vtu", tmp_path / "a.txt", "--plot", tmp_path / "a.dxf"], capsys)
    vtu, plot = run.mistakes
    assert "a.txt" in vtu
    assert ".vtu" in vtu
    assert "a.dxf" in plot
    assert ".png" in plot
    run = Run(["mesh", scene, tmp_path / "a.stl"], capsys)
    assert "a.stl" in run.mistakes[0]
    assert ".msh" in run.mistakes[0]
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_an_output_never_overwrites_an_input_or_another_output(
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    link: Callable[[Path, Path], None],
) -> None:
    for name in ("a.vtu", "a.png", "a.msh", "a.nc"):
        link(tmp_path / name, scene)
    (tmp_path / "b.vtu").write_text("b")
    link(tmp_path / "b.svg", tmp_path / "b.vtu")
    sweep = tmp_path / "sweep.toml"
    sweep.write_text('scene = "scene.toml"\n[[axes]]\nload.force_N = [1.0]\n')
    link(tmp_path / "s.nc", sweep)
    new = tmp_path / "new.nc"
    commands: list[tuple[list[object], str, Path]] = [
        (["solve", scene, "--vtu", tmp_path / "a.vtu"], "a.vtu", scene),
        (["solve", scene, "--plot", tmp_path / "a.png"], "a.png", scene),
        (["solve", scene, "--vtu", tmp_path / "b.vtu", "--plot", tmp_path / "b.svg"], "b.svg", new),
        (["mesh", scene, tmp_path / "a.msh"], "a.msh", scene),
        (["sweep", sweep, "--output", tmp_path / "a.nc"], "a.nc", scene),
        (["sweep", sweep, "--output", tmp_path / "s.nc"], "s.nc", sweep),
        (["sweep", sweep, "--output", new, "--store", tmp_path / "a.nc"], "a.nc", scene),
        (["sweep", sweep, "--output", new, "--store", sweep], "sweep.toml", sweep),
        (["sweep", sweep, "--output", new, "--store", new], "new.nc", new),
        (["sweep", sweep, "--plan", "--store", scene], "scene.toml", scene),
    ]
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments, output, overwritten in commands:
        (mistake,) = Run(arguments, capsys).mistakes
        assert mistake.startswith(f"{tmp_path / output}: would overwrite ")
        assert overwritten == new or str(overwritten) in mistake
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_sweep_of_no_file_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in ([], ["--plan"], ["--plan", "--output", "."]):
        assert all(": " in line for line in Run(["sweep", ".", *arguments], capsys).mistakes)


@pytest.mark.usefixtures("no_solve")
def test_a_change_of_one_key_in_two_spellings_is_one_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "list.toml"
    path.write_text('[[electrodes]]\nname = "A"\nx_mm = 9\ny_mm = 0\n')
    values = ("electrodes[0].x_mm=-1e9", "electrodes.0.x_mm=1e9", "electrodes[0].x_mm=2e9")
    changes = [word for value in values for word in ("--set", value)]
    (mistake,) = Run(["solve", path, *changes], capsys).mistakes
    assert mistake.startswith("electrodes[0].x_mm = 2000000000.0: ")


def test_a_plot_s_labels_are_complete(scene, tmp_path, capsys):
    plot = tmp_path / "a.png"
    assert Run(["solve", scene, "--plot", plot], capsys).code == 0
    pixels = imread(plot)[..., :3]
    border = [pixels[:3], pixels[-3:], pixels[:, :3].swapaxes(0, 1), pixels[:, -3:].swapaxes(0, 1)]
    assert all((strip == 1.0).all() for strip in border)


def test_doubts_are_told_with_and_without_charges(tmp_path, capsys, monkeypatch):
    scene = tmp_path / "flat.toml"
    scene.write_text("[load]\nforce_N = 2.0\n")
    run = Run(["solve", scene], capsys)
    warning = run.out.splitlines()[1]
    assert warning.startswith("warning: load: nothing presses, since there is no probe")
    monkeypatch.setattr(
        "pvdf_fem.solvers.ladder.NewtonOptions", partial(NewtonOptions, max_iterations=2)
    )
    scene.write_text('[film]\nd31_pC_N = 23e-12\n[probe]\nshape = "circle"\n')
    run = Run(["solve", scene], capsys)
    assert (run.code, run.out) == (3, "")
    assert run.err.splitlines()[-1].startswith("warning: film.d31_pC_N = 2.3e-11: is in pC/N")


def test_files_are_written(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vtu, plot = tmp_path / "a.vtu", tmp_path / "a.svg"
    run = Run(["solve", scene, "--json", "--vtu", vtu, "--plot", plot], capsys)
    assert (run.code, run.err) == (0, "")
    deflection = meshio.read(vtu).point_data["displacement_m"][:, 2]
    # the largest is not at a node
    assert 0.99 < 1e3 * deflection.max() / run.json["deflection_max_mm"] <= 1.0 + 1e-12
    assert "<svg" in plot.read_text()[:1000]
    assert {path.name for path in tmp_path.iterdir()} == {"scene.toml", "a.vtu", "a.svg"}


@pytest.mark.parametrize("as_json", [True, False])
def test_no_charges_unless_converged(
    scene: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    as_json: bool,
) -> None:
    monkeypatch.setattr(
        "pvdf_fem.solvers.ladder.NewtonOptions", partial(NewtonOptions, max_iterations=2)
    )
    flags = ["--json"] if as_json else []
    run = Run(["solve", scene, "--vtu", tmp_path / "a.vtu", *flags], capsys)
    assert run.code == 3
    assert not (tmp_path / "a.vtu").exists()
    told = run.json["status"] + run.json["reason"] if as_json else run.err
    assert "max_iterations" in told
    assert "lower load.force_N" in told
    if as_json:
        assert "charges_pC" not in run.json
    else:
        assert run.out == ""
        assert run.err.count("\n") == 1


# ------------------------------------------------------------------------------- mesh and modes


def test_mesh_writes_the_patches(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Run(["mesh", scene, tmp_path / "a.msh", "--set", "electrodes.layout=three"], capsys)
    assert (run.code, run.err) == (0, "")
    grid = meshio.read(tmp_path / "a.msh")
    assert {"electrode A", "electrode B", "electrode C", "probe"} < set(grid.field_data)
    assert f"{len(grid.cells[0].data)} triangles" in run.out


def test_solve_on_a_mesh_from_a_file(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = tmp_path / "a.msh"
    Run(["mesh", scene, mesh], capsys)
    given = Run(["solve", scene, "--mesh", mesh, "--json"], capsys).json
    first, last = given["history"], solve(Scene.load(scene)).to_json()
    assert len(first) == 1
    assert given["stop"] == "the mesh was given"
    for name, charge in last["charges_pC"].items():
        assert given["charges_pC"][name] == pytest.approx(charge, rel=1e-3)
    other = ["solve", scene, "--set", "probe.x_mm=4", "--mesh", mesh]
    mistakes = Run(other, capsys).mistakes
    assert mistakes[0].startswith(f"{mesh}: probe: the mesh does not follow its outline of 98 mm2")


def test_modes(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_text(f"{SCENE}[numerics]\ntolerance = 1e-2")
    run = Run(["modes", scene, "--count", 2, "--loaded", "--json"], capsys)
    expected = modes(Scene.load(scene), 2, loaded=True).to_json()
    assert (run.code, run.err) == (0, "")
    assert _untimed(run.json) == _untimed(expected)
    assert len(run.json["frequencies_Hz"]) == 2
    run = Run(["modes", scene], capsys)
    rows = re.findall(r"^(\d) .* ([\d.]+) +[\d.e-]+$", run.out, re.MULTILINE)
    assert [number for number, _ in rows] == list("123456")
    assert float(rows[0][1]) == pytest.approx(117.05, rel=1e-2)


def test_modes_of_a_film_without_tension(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slack = ["modes", scene, "--set", "film.temperature_change_K=0"]
    run = Run(slack, capsys)
    assert (run.code, run.out) == (3, "")
    assert "singular_tangent" in run.err
    assert "film.temperature_change_K below zero" in run.err
    run = Run([*slack, "--json"], capsys)
    assert (run.code, run.err) == (3, "")
    assert "frequencies_Hz" not in run.json


@pytest.mark.usefixtures("no_solve")
@pytest.mark.parametrize("count", ["0", "-3", "1000", "2.0", "1_0", "٣", 5000 * "9"])
def test_modes_without_a_number(
    scene: Path, capsys: pytest.CaptureFixture[str], count: str
) -> None:
    (mistake,) = Run(["modes", scene, "--count", count], capsys).mistakes
    assert mistake.startswith(f"--count {count[:60]}: is out of range; give 1 to ")


@pytest.mark.parametrize("command", ["locate", "calibrate", "track"])
def test_jobs_for_one_probe_refuse_a_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    (path := tmp_path / "two.toml").write_text("[[probe]]\n[[probe]]\nx_mm = 12.0\n")
    rest = {"locate": ["--charges=A=1,B=2,C=3,D=4"], "calibrate": [path], "track": ["-"]}
    (mistake,) = Run([command, path, *rest[command]], capsys).mistakes
    assert mistake.startswith('probe = ["triangle", "triangle"]: is a list [[probe]]')


def test_a_profile_that_is_not_there(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (mistake,) = Run(["solve", scene, "--set", 'load.profile="none.csv"'], capsys).mistakes
    assert mistake.startswith('load.profile = "none.csv": cannot be used')


# -------------------------------------------------------------------------- help, pipes, signals


def test_help_names_every_key_of_a_scene(capsys: pytest.CaptureFixture[str]) -> None:
    told = Run(["--help"], capsys).out
    models: list[type[BaseModel]] = [Air, Film, Layout, Load, Numerics, Readout, Stage]
    models += [*PROBES.values(), *ELECTRODES.values(), *RINGS.values()]
    keys = {key for model in models for key in model.model_fields}
    missing = {key for key in keys if not re.search(rf"\b{key}\b", told)}
    assert not missing


def test_keys_are_told_by_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert Scene.parse(Run(["keys"], capsys).out) == Scene()
    told = Run(["keys", "side_mm", "tension-field"], capsys).out
    assert re.findall(r"^#?(\w+) = ", told, re.M) == [
        "compression",
        "side_mm",
        "side_mm",
        "side_mm",
    ]
    assert re.findall(r"^\[.*\]$", told, re.M) == [
        "[film]",
        "[electrodes]",
        "[[electrodes]]",
        "[probe]",
    ]
    run = Run(["keys", "thicknes_um"], capsys)
    assert (run.code, run.mistakes) == (
        2,
        ["thicknes_um: is in no key and its meaning; did you mean thickness_um?"],
    )


@pytest.mark.parametrize("command", ["solve", "mesh", "modes", "respond"])
def test_examples_of_the_help_are_valid(
    scene: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Run(["mesh", "scene.toml", "scene.msh"], capsys)
    text = Run([command, "--help"], capsys).out
    examples = re.findall(rf"^  pvdf-fem ({command} .*)$", text, re.MULTILINE)
    assert examples
    for example in examples:
        assert Run(example.split(), capsys).code == 0, example


def python(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "pvdf_fem", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
        **options,
    )


def test_help_and_version_import_nothing_slow() -> None:
    code = (
        "import sys\n"
        "from pvdf_fem.cli.main import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "finally:\n"
        "    slow = {'numpy', 'scipy', 'pydantic', 'skfem', 'gmsh', 'meshio', 'matplotlib'}\n"
        "    print(slow & set(sys.modules))\n"
    )
    for arguments in (["--help"], ["solve", "--help"], ["--version"]):
        run = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            capture_output=True,
            text=True,
            check=True,
            cwd=Path(__file__).parents[2],
        )
        assert run.stdout.endswith("set()\n")
    assert run.stdout.startswith(f"pvdf-fem {__version__}\n")


def test_no_command_prints_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert Run([], capsys).out == Run(["--help"], capsys).out
    assert Run([], capsys).code == 2


def test_an_unknown_command_is_told_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    run = Run(["slove", "scene.toml"], capsys)
    assert run.code == 2
    assert "slove is no command; did you mean solve?" in run.err


@pytest.mark.parametrize(
    ("settings", "lost"),
    [
        (["probe.shape=circle"], ["probe.side_mm = 7.5"]),
        (["probe={shape='circle'}"], ["probe.side_mm = 7.5"]),
        (["load={kind='dead', force_N=2}"], ['load.contact = "stuck"']),
        (
            ["load.kind=dead", "film.pretension_N_m=9"],
            ["film.temperature_change_K = -2.0", 'load.contact = "stuck"'],
        ),
        (["probe.x_mm=1", "electrodes.layout=three"], []),
    ],
)
def test_keys_that_a_change_leaves_out_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], settings: list[str], lost: list[str]
) -> None:
    """Those of the file, not defaults, and none that a change names."""
    (path := tmp_path / "scene.toml").write_text(
        "[probe]\nside_mm = 7.5\n[film]\ntemperature_change_K = -2.0\n"
        '[load]\nkind = "rigid"\ncontact = "stuck"\n'
    )
    options = Namespace(scene=path, settings=settings)
    scene_of(options)
    told = capsys.readouterr().err.splitlines()
    assert [line.partition(": leaves out ")[2].partition(", a key")[0] for line in told] == lost


def test_closed_pipe_is_no_error(scene: Path) -> None:
    process = python("solve", scene, "--json")
    assert process.stdout is not None
    process.stdout.close()
    _, err = process.communicate(timeout=60)
    # once gmsh was there, the signal ends the process, which a shell also shows as 141
    assert process.returncode in (141, -signal.SIGPIPE)
    assert err == ""


def test_a_map_of_a_quantity_that_there_is_not_is_refused_before_the_solve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text("")
    for name, reason in (("strain", "choose from deflection"), ("contact", "has no contact")):
        command = ["solve", scene, "--plot", tmp_path / "a.svg", "--quantity", name]
        run = Run(command, capsys)
        assert run.code == 2
        assert run.err.startswith("--quantity: ")
        assert reason in run.err
    assert Run(["solve", scene, "--quantity", "stress"], capsys).code == 2  # without --plot
    assert Run([*command[:-1], "stress"], capsys).code == 0
    assert "<svg" in (tmp_path / "a.svg").read_text()[:1000]


def test_modes_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, plot = tmp_path / "scene.toml", tmp_path / "a.svg"
    scene.write_text("[numerics]\ntolerance = 0.05\n")
    assert Run(["modes", scene, "--count", "2", "--plot", plot], capsys).code == 0
    assert "<svg" in plot.read_text()[:1000]
