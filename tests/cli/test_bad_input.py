"""Invalid input is refused, in words, at once; whatever it is."""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pvdf_fem.cli.main import main
from pvdf_fem.files import printable
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import MOST_BYTES
from reports import fuzz
from reports.robustness import kept
from reports.robustness.charge_inputs import wrong_charge_list
from reports.robustness.corpora import CORPORA
from reports.robustness.inputs import FILE, Input
from reports.robustness.oracle import documented, lost_values, wrong_scene
from tests.helpers.strategies import tables

ROOT = Path(__file__).parents[2]
VALID = b"[probe]\nx_mm = 5.0\n"


# --------------------------------------------------------------------------------------- fuzzing


def test_damaged_inputs_of_every_corpus() -> None:
    counts = fuzz.fuzz(400, seed=5)
    assert counts.complaints == []
    assert counts.inputs.total() == 400
    assert set(counts.inputs) == {corpus.__name__ for corpus in CORPORA}
    # accidents in comments harm nothing
    assert counts.accepted["damaged_scene"] > 0
    assert counts.refused["damaged_scene"] > 0


@pytest.mark.parametrize(
    ("given_input", "fault"),
    [
        (Input("solve", (FILE,), VALID, invalid=True), "accepted, though invalid"),
        (Input("solve", (FILE,), b"film = 1", named="film = 2: "), "does not name"),
        (Input("mesh", (FILE, "{folder}/new/a.msh"), VALID, named="a.stl"), "does not name"),
        (Input("store", (FILE, "no number"), b""), "traceback"),
        (Input("locate", (FILE, "--charges=A=1,B=2"), VALID, invalid=True), "accepted, though"),
    ],
)
def test_faults_are_found(given_input: Input, fault: str, tmp_path: Path) -> None:
    assert fault in fuzz.verdict(given_input, tmp_path).faults[0]


def test_the_oracles_find_wrong_charges_and_changed_responses() -> None:
    wrong = ("A=nan", "A=1,A=2", "E=1", "A=1_0", "A=0", "A", "A=1e13", "")
    assert all(wrong_charge_list(text) for text in wrong)
    assert wrong_charge_list("A=1, B = -2.5e-3") == ""
    assert kept.changed_response(kept.response()) == ""
    scene = kept.response().scene.with_(**{"film.thickness_um": 30.0})
    thick = replace(kept.response(), scene=scene)
    assert kept.changed_response({"scene.toml": thick}).startswith("scene = ")


@pytest.mark.parametrize(
    "text",
    [
        "[film]\nradius_mm = true",
        "[film]\nradius_mm = -1",
        "[film]\nRadius_mm = 45",
        "[flim]\nradius_mm = 45",
        "[film]\nthermal_expansion_per_K = nan",
        '[load]\nkind = "Dead"',
        '[load]\nforce_N = "1"',
        "[probe]\nx_mm = 44.0",
        '[probe]\nshape = "polygon"\nvertices_mm = [[0, 0], [1, 1], [1, 0], [0, 1]]',
        '[[electrodes]]\nname = "A"\nx_mm = 0\ny_mm = 0\n[[electrodes]]\nname = "B"\nx_mm = 2.9\n'
        "y_mm = 0",
    ],
)
def test_the_oracle_finds_what_is_wrong(text: str) -> None:
    assert wrong_scene(fuzz.tomllib.loads(text))


@given(tables())
def test_the_oracle_finds_nothing_wrong_with_valid_scenes(table: dict[str, Any]) -> None:
    assert wrong_scene(table) == ""
    assert lost_values(table, Scene.model_validate(table).model_dump()) == ""


_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from([5e-324, -0.0, 1e308, 1e-300, 10**400, "nan", b"", 1j, "\ud800", "a\nb"])
)
_VALUES = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=6,
)
_KEYS = [
    f"{section}.{key}" for section, keys in documented().items() for key in [*sorted(keys), "", "x"]
]
_KEYS += ["electrodes[0].x_mm", "electrodes.0.name", "electrodes[1]", "film", "probe", "electrodes"]


@settings(max_examples=200)
@given(st.dictionaries(st.sampled_from(_KEYS) | st.text(max_size=9), _VALUES, min_size=1))
def test_changes_of_any_value_give_a_valid_scene_or_a_complaint(changes: dict[str, Any]) -> None:
    scene, problems = None, ("",)
    try:
        scene = Scene().with_(**changes)
    except SceneError as error:
        problems = error.problems
    if scene is None:
        assert all(line.isprintable() and ": " in line for line in problems)
    else:
        assert wrong_scene(scene.model_dump(mode="json", exclude_none=True)) == ""
        assert Scene.parse(scene.to_toml()) == scene


@given(
    st.tuples(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6)),
    st.floats(-1.0, 1.0),
    st.sampled_from([1.0, 1 - 1e-16, 1 - 1e-12, 0.5]),
)
def test_an_accepted_film_has_a_positive_stiffness(
    moduli: tuple[float, float], sign: float, share: float
) -> None:
    ratio = math.copysign(share, sign) * math.sqrt(moduli[0] / moduli[1])
    try:
        film = Film(youngs_modulus_GPa=moduli, poisson_ratio=ratio)
    except ValueError:
        return
    stiffness = film.stiffness
    assert np.isfinite(stiffness).all()
    scale = np.sqrt(np.diag(stiffness))
    assert np.linalg.eigvalsh(stiffness / np.outer(scale, scale)).min() > 1e-12


# ----------------------------------------------------------------------------- files of all kinds


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _loop(path: Path) -> None:
    path.symlink_to(path)


def _large(path: Path) -> None:
    path.touch()
    os.truncate(path, 100_000_000)


STRANGE = {
    "directory": (Path.mkdir, "Is a directory"),
    "pipe": (_pipe, "is no regular file"),
    "loop": (_loop, "Too many levels of symbolic links"),
    "endless": (lambda path: path.symlink_to("/dev/zero"), "is no regular file"),
    "empty device": (lambda path: path.symlink_to(os.devnull), "is no regular file"),
    "100 MB": (_large, "has 100000000 bytes, more than 1000000"),
    "latin-1": (lambda path: path.write_bytes(b"\n# \xb5m"), "line 2 is not UTF-8"),
    "missing\x1b[31m\n": (lambda path: None, "missing\\x1b[31m\\n"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_no_text_file_is_refused_at_once(tmp_path: Path, name: str) -> None:
    make, told = STRANGE[name]
    path = tmp_path / name
    make(path)
    start = time.process_time()
    tracemalloc.start()
    with pytest.raises(SceneError) as caught:
        Scene.load(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert time.process_time() - start < 1.0
    assert peak < 10 * MOST_BYTES
    (line,) = caught.value.problems
    assert told in printable(line)


@pytest.mark.parametrize("ending", ["utf-16", "utf-16-le", "CR"])
def test_a_text_in_utf_16_or_with_carriage_returns_alone_is_named(
    tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """As scene, sweep and table: by what to save it as, not by what it is no ... of."""
    scene, path = tmp_path / "scene.toml", tmp_path / "file"
    scene.write_text("[probe]\n[readout]\nfeedback_capacitance_pF = 500\n")
    table = "x_mm,y_mm,rotation_deg,force_N,A,B,C,D\n1,1,0,1,905,731,600,640\n"
    for text, command in (
        ("[probe]\nx_mm = 3\n", ["solve", path]),
        ("scene = {}\n[[axes]]\nload.force_N = [1]\n", ["sweep", path]),
        ("A,B,C,D\n905,731,600,640\n", ["locate", scene, "--csv", path]),
        ("t_s,A,B,C,D\n0,905,731,600,640\n", ["track", scene, path]),
        (table, ["calibrate", scene, path]),
    ):
        codec = "utf-8" if ending == "CR" else ending
        path.write_bytes((text.replace("\n", "\r") if ending == "CR" else text).encode(codec))
        assert main([*map(str, command)]) == 2
        (told,) = capsys.readouterr().err.splitlines()
        assert told.startswith(f"{path}: ")
        assert {"utf-16": "UTF-16", "utf-16-le": "UTF-16", "CR": "CR"}[ending] in told


# ------------------------------------------------------------------------------------- processes


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"[load]\nforce_N = " + b"9" * 100_000, "an integer of thousands of digits"),
        (b"x = " + b"[" * 500_000, "nested too deeply"),
        (b"\0" * 100, "not TOML"),
        (b"[film]\nradius_mm = 1\nradius_mm = 2", "Cannot overwrite a value"),
        (b"[load]\nforce_N = 1" + b"\n" * 1_000_000, "more than 1000000"),
    ],
)
def test_a_process_refuses_in_little_memory(tmp_path: Path, data: bytes, told: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(data)
    run = subprocess.run(
        [sys.executable, "-m", "pvdf_fem", "solve", str(path), "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30)),
    )
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.count("\n") == 1
    assert told in run.stderr
