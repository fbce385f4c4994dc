"""Bad input: each mistake is told by its key, with exit code 2, before anything is computed."""

from __future__ import annotations

import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest

SPHERE = "--set \"probe={shape='sphere',radius_mm=5}\" --set load.kind=contact"
TWO = 'probe = ["triangle", "triangle"]'
WRONG = ["film.radius_mm = -45.0", "load.force = 2", "numerics.tolerance = nan"]

#: Command lines in the folder of `conftest.py`, and all keys that their complaints begin with.
REFUSED = [
    # a scene and its changes
    ("solve wrong.toml --set probe.shape", ["--set probe.shape", *WRONG]),
    ("mesh wrong.toml a.msh", WRONG),
    ("modes wrong.toml --count 0", ["--count 0", *WRONG]),
    ("solve scene.toml --set load.force_N", ["--set load.force_N"]),
    ("solve scene.toml --set =2 --set load.kind=2,5", ["--set =2", "--set load.kind=2,5"]),
    ("solve scene.toml --set load.force_N=", ["--set load.force_N="]),
    ("solve scene.toml --set load.force_N=2N", ["--set load.force_N=2N"]),
    ("solve scene.toml --set 'probe.x_mm=1\ny'", [r"--set probe.x_mm=1\ny"]),
    ("solve scene.toml --set load.force_N=-1", ["load.force_N = -1"]),
    ("solve scene.toml --set load.kind=ded", ['load.kind = "ded"']),
    ("solve scene.toml --set lod.kind=dead --set self=3", ["self = 3", "lod = a table"]),
    (
        "solve scene.toml --set film.pretension_N_m=9 --set film.temperature_change_K=-2",
        ["film.temperature_change_K = -2"],
    ),
    (f"solve scene.toml {SPHERE} --set load={{depth_mm=2,force_N=0.5}}", ["load.force_N = 0.5"]),
    (
        "solve scene.toml --set film.radius_mm=-1e9 --set film.radius_mm=2e9",
        ["film.radius_mm = 2000000000.0"],
    ),
    (
        "solve list.toml --set electrodes[0].x_mm=-1e9 --set electrodes.0.x_mm=2e9",
        ["electrodes[0].x_mm = 2000000000.0"],
    ),
    ("solve scene.toml --set load.profile=\"'none.csv'\"", ['load.profile = "none.csv"']),
    # words that no option takes
    ("solve scene.toml --force 2", ["--force"]),
    ("solve scene.toml --plt=a.png", ["--plt=a.png"]),
    ("solve scene.toml load.force_N=2", ["load.force_N=2"]),
    ("solve sweep.toml", ['scene = "disc.toml"', "axes = [a table]"]),
    # numbers of options
    *((f"modes scene.toml --count {n}", [f"--count {n}"]) for n in ("-3", "1000", "2.0", "1_0")),
    (f"modes scene.toml --count {5000 * '9'}", [f"--count {60 * '9'}"]),
    *(
        (f"respond disc.toml --frequencies={span}", [f"--frequencies {span}"])
        for span in ("0", "-1", "5:1", "1:2:3:4", "1:2:2.5", "1:9e9", "nan", "1:")
    ),
    ("respond bare.toml", ["probe = (nothing)"]),
    (
        "calibrate wired.toml known.csv --sigma much --prior gains",
        ["--sigma much", "--prior gains"],
    ),
    ("calibrate wired.toml known.csv --unit mV", ["unit = 'mV'"]),
    ("dataset disc.toml --output a.nc --touches many", ["touches = many"]),
    ("dataset disc.toml --output a.nc --touches 0 --seed 1.5", ["touches = 0", "seed = 1.5"]),
    ("dataset disc.toml --output a.nc --sigma much --noise -1", ["--sigma much", "--noise -1"]),
    ("dataset disc.toml --output a.nc --reach 60", ["--reach 60"]),
    ("dataset disc.toml --output a.parquet", ["a.parquet"]),
    ("dataset disc.toml --output a.nc --set load.kind=rigid", ["load.kind"]),
    ("design disc.toml --vary electrodes.count", ["--vary electrodes.count="]),
    ("design disc.toml --vary load.force_N=1 --vary load.force_N=2", ["--vary"]),
    ("design disc.toml --vary electrodes.side_mm=90", 2 * ["electrodes.ring_radius_mm = 10.0"]),
    ("design disc.toml --vary probe.y_mm=1,2", ["probe.y_mm = [1, 2]"]),
    ("design disc.toml --noise much --noise-pC -1", ["--noise much", "--noise-pC -1"]),
    ("design disc.toml --step 50", ["step_mm = 50.0"]),
    ("design disc.toml --force-range 2,3", ["load.force_N = 1"]),
    ("design disc.toml --vary film.thickness_um=9,25 --model one.response", ["--model"]),
    (
        "locate scene.toml --charges A=1,A=2,B --sigma x --noise=-1 --unknown x,mass "
        "--force-range 5,1 --reach 0 --tolerance none",
        [
            *("--charges A", "--charges B", "--sigma x", "--noise -1", "--unknown mass"),
            *("--reach 0", "--force-range 5,1", "--tolerance none"),
        ],
    ),
    (
        "locate scene.toml --charges A=1,E=2 --unknown y,force --set probe.x_mm=13",
        ["charges.E", "known x_mm = 13"],
    ),
    ("locate bare.toml --charges A=1", ["bare.toml"]),
    ("locate disc.toml --csv cells.csv --sigma 2", ["sigma = 2.0"]),
    (
        "track disc.toml signals.csv --unknown z --reach 0",
        ["--unknown z", "--reach 0", "--unknown"],
    ),
    ("track disc.toml signals.csv --unknown x,y", ["--unknown"]),
    ("sweep sweep.toml --processes 0", ["--processes 0"]),
    # scenes that a command is not for
    ("locate two.toml --charges A=1,B=2,C=3,D=4", [TWO]),
    ("calibrate two.toml known.csv", [TWO]),
    ("track two.toml -", [TWO]),
    ("track scene.toml signals.csv", ["--unit V"]),
    ("locate scene.toml --changes A=1 --unit V", ["--unit V"]),
    # options that do not go together
    ("locate scene.toml --charges A=1 --unknown x,force --plot a.svg", ["--plot"]),
    ("locate scene.toml --charges A=1 --touches 2 --plot a.svg --or disc.toml", ["--or", "--plot"]),
    ("locate scene.toml --csv cells.csv --plot a.svg --or disc.toml", ["--or", "--plot"]),
    ("locate scene.toml --csv cells.csv --unknown x,force", ["--unknown"]),
    (
        "locate scene.toml --charges A=1 --quick --output x.csv --reading total",
        ["--quick", "--reading", "--output"],
    ),
    ("solve scene.toml --quantity stress", ["--quantity"]),
    ("solve bare.toml --plot a.svg --quantity strain", ["--quantity"]),
    ("solve bare.toml --plot a.svg --quantity contact", ["--quantity"]),
    # names
    ("example triangel", ['"triangel"']),
    ("keys thicknes_um", ["thicknes_um"]),
    # outputs: unknown formats, folders that are not there, inputs, and each other
    ("solve scene.toml --vtu no/a.vtu --plot no/a.png", ["no/a.vtu", "no/a.png"]),
    ("solve scene.toml --vtu a.txt --plot a.dxf", ["a.txt", "a.dxf"]),
    ("mesh scene.toml a.stl", ["a.stl"]),
    ("calibrate wired.toml known.csv --output a.csv --page a.txt", ["a.csv", "a.txt"]),
    ("dataset disc.toml --output a.txt", ["a.txt"]),
    ("design disc.toml --output a.txt", ["a.txt"]),
    ("locate disc.toml --csv cells.csv --output a.txt", ["a.txt"]),
    ("locate disc.toml --csv cells.csv --output cells.csv", ["cells.csv"]),
    ("solve scene.toml --vtu {link}.vtu", ["{link}.vtu"]),
    ("solve scene.toml --plot {link}.png", ["{link}.png"]),
    ("solve scene.toml --vtu b.vtu --plot {link}.svg", ["{link}.svg"]),
    ("mesh scene.toml {link}.msh", ["{link}.msh"]),
    ("sweep sweep.toml --output {link}.nc", ["{link}.nc"]),
    ("sweep sweep.toml --output a.nc --store {link}.nc", ["{link}.nc"]),
    ("sweep sweep.toml --output a.nc --store sweep.toml", ["sweep.toml"]),
    ("sweep sweep.toml --output a.nc --store a.nc", ["a.nc"]),
    ("sweep sweep.toml --plan --store disc.toml", ["disc.toml"]),
]
#: Where work begins.
WORK = ("dynamics.modes.modes", "solution.refinement.mesh_scene", "mesh.gmsh_mesh.mesh_scene")
WORK += ("sweeps.sweep.planned", "calibration.calibrate.TouchModel")


@pytest.fixture
def at_work(folder, models, monkeypatch):
    """Names of what has begun to be computed."""
    begun: list[str] = []
    for place in WORK:
        monkeypatch.setattr(f"pvdf_fem.{place}", lambda *_, at=place, **__: begun.append(at))
    # whether it is installed or not
    find = "pvdf_fem.cli.studies.dataset.find_spec"
    monkeypatch.setattr(find, lambda name: None if name == "pyarrow" else find_spec(name))
    return begun


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize(("line", "keys"), REFUSED)
def test_mistakes_are_told_by_key_before_anything_is_computed(
    folder, models, at_work, command, line, keys
):
    for link in ("soft", "hard"):
        for ending in ("vtu", "png", "svg", "msh", "nc"):
            target = (
                "b.vtu" if ending == "svg" else "sweep.toml" if ending == "nc" else "scene.toml"
            )
            folder.joinpath("b.vtu").touch()
            path = folder / f"{link}.{ending}"
            path.symlink_to(folder / target) if link == "soft" else path.hardlink_to(target)
    before = contents(folder)
    for link in ("soft", "hard") if "{link}" in line else ("",):
        run = command(*shlex.split(line.replace("{link}", link)))
        told = [key.strip() for key in run.mistakes]
        assert told == [key.replace("{link}", link) for key in keys]
    assert contents(folder) == before
    assert (models, at_work) == ([], [])


@pytest.mark.parametrize(
    "line",
    [
        "track disc.toml signals.csv",
        *("locate disc.toml --changes A=5,B=4,C=3 " + of for of in ("", "--touches 1")),
    ],
)
def test_a_film_without_charges_at_rest_is_refused_before_a_model_is_built(
    folder, models, command, line
):
    run = command(*line.split(), "--set", "film.temperature_change_K=1")
    assert run.mistakes == ["film.temperature_change_K = 1.0"]
    assert not models
