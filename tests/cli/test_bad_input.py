"""Invalid input is refused, in words, at once; whatever it is."""

from __future__ import annotations

import csv
import io
import math
import os
import resource
import subprocess
import sys
import tomllib
import tracemalloc
from collections.abc import Mapping
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.cli.main import main
from pvdf_fem.cli.program import LONGEST_LINE, MOST_LINES
from pvdf_fem.files import printable
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import MOST_BYTES, write_toml
from tests.helpers.damage import damages, drawn
from tests.helpers.streams import sensor
from tests.helpers.touch_models import bumps

ROOT = Path(__file__).parents[2]
MOST_TABLE = 2_000  #: Bytes of a damaged table, whose rows are all answered.

# --------------------------------------------------------------------------------- damaged inputs


class Begun(BaseException):
    """Raised where the work on an input begins that is accepted; holds what the work was given."""


def begin(*given: object, **_: object) -> None:
    raise Begun(given[0] if given else None)


#: The function with which the work of each command begins, and what stands in its place.
WORK: dict[str, tuple[str, Any]] = {
    "solve": ("pvdf_fem.derivatives.uncertainty.solve", begin),
    "mesh": ("pvdf_fem.mesh.gmsh_mesh.mesh_scene", begin),
    "modes": ("pvdf_fem.dynamics.modes.modes", begin),
    "sweep": ("pvdf_fem.sweeps.sweep.planned", begin),
    "locate": (
        "pvdf_fem.cli.locate_rows.model_of",
        lambda scene, *_: replace(bumps("rectangle"), scene=scene),
    ),
    "calibrate": ("pvdf_fem.calibration.calibrate.TouchModel", begin),
    "track": ("pvdf_fem.cli.track.model_of", lambda scene, *_: replace(sensor(), scene=scene)),
}


def judged(data: bytes, command: str, *words: str, codes: tuple[int, ...] = ()) -> Any:
    """Give a command a file, as ``{file}`` among its words: the lines with which the file is
    refused, or what the work is given. Other exit codes than that of a refusal must be in
    `codes`."""
    out, err = io.StringIO(), io.StringIO()
    with TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder, "input.dat")
        path.write_bytes(data)
        for place, instead in WORK.values():
            stack.enter_context(mock.patch(place, instead))
        stack.enter_context(redirect_stdout(out))
        stack.enter_context(redirect_stderr(err))
        try:
            code = main([command, *(str(path) if word == "{file}" else word for word in words)])
        except Begun as accepted:
            return accepted.args[0]
        except SystemExit as end:  # of the options' parser
            code = int(end.code or 0)
        assert [file.name for file in Path(folder).iterdir()] == ["input.dat"]
    if code in codes or (codes and out.getvalue()):  # rows are answered as they come
        return out.getvalue()
    lines = err.getvalue().removesuffix("\n").split("\n")
    assert (code, out.getvalue()) == (2, "")
    assert err.getvalue()
    assert len(lines) <= MOST_LINES + 1 or lines[0].startswith("usage: ")
    assert all(line.isprintable() and len(line) < LONGEST_LINE + 100 for line in lines)
    return lines


def holds(accepted: Any, written: Any) -> bool:
    """Whether an accepted scene has all values of a file."""
    if isinstance(written, Mapping):
        found = accepted if isinstance(accepted, Mapping) else {}
        return all(holds(found.get(key), written[key]) for key in written)
    if isinstance(written, list):
        return len(written) == len(accepted or ()) and all(map(holds, accepted, written))
    return bool(accepted == written)


TEXTS = [path.read_text("utf-8") for path in sorted((ROOT / "geometry").glob("*.toml"))]
SCENES = [text for text in TEXTS if "[[axes]]" not in text and "[[section" not in text]
LIST = '[[electrodes]]\nname = "β 2"\nx_mm = 9.0\ny_mm = 0.0\n[probe]\n'


@given(
    data=st.sampled_from([*SCENES, LIST]).flatmap(lambda text: damages(text.encode())),
    command=st.sampled_from(["solve", "mesh", "modes"]),
)
@drawn(1.0)
def test_damaged_scenes_are_refused_or_held(data: bytes, command: str) -> None:
    found = judged(data, command, "{file}", *(["film.msh"] if command == "mesh" else []))
    if isinstance(found, Scene):
        assert holds(found.model_dump(mode="json"), tomllib.loads(data.decode("utf-8-sig")))
        assert Scene.parse(found.to_toml()) == found


#: TOML of what no number is, with the way that a complaint shows it.
NO_NUMBERS = {
    "nan": "nan",
    "-inf": "-inf",
    "1e999": "inf",
    "1e308": "1e+308",
    "9" * 400: "an integer of 1329 bits",
    '"45"': '"45"',
    '"\\u0000\\u009b31m"': '"\\u0000\\x9b31m"',
    "2020-01-01": "2020-01-01",
    "{a.b = 1}": "a table",
}
NOT_POSITIVE = {"-1": "-1", "-1e-300": "-1e-300"}
#: Keys of numbers of either sign; other numbers are not negative.
SIGNED = ("x_mm", "y_mm", "rotation_deg", "first_angle_deg", "poisson_ratio", "d31_pC_N")
SIGNED += ("d32_pC_N", "thermal_expansion_per_K", "temperature_change_K", "pretension_N_m")


def numbers_of(tables: Mapping[str, Any]) -> list[tuple[dict[str, Any], str, str]]:
    """Table, key and full name of every number of a scene."""
    rows = [
        (row, f"{name}[{i}]" if isinstance(section, list) else name)
        for name, section in tables.items()
        for i, row in enumerate(section if isinstance(section, list) else [section])
    ]
    return [
        (row, key, f"{prefix}.{key}")
        for row, prefix in rows
        for key, value in row.items()
        if isinstance(value, float | int) and not isinstance(value, bool)
    ]


@given(data=st.data(), text=st.sampled_from([*SCENES, LIST]), by_set=st.booleans())
@drawn(1.0)
def test_a_wrong_value_is_named(data: st.DataObject, text: str, by_set: bool) -> None:
    """In a file, or by ``--set``, which needs no quotes."""
    written = Scene.parse(text).model_dump(mode="json", exclude_none=True)
    row, key, name = data.draw(st.sampled_from(numbers_of(written)))
    wrong = NO_NUMBERS | ({} if key in SIGNED else NOT_POSITIVE)
    toml, shown = data.draw(st.sampled_from([*wrong.items()]))
    if by_set:
        lines = judged(write_toml(written).encode(), "solve", "{file}", f"--set={name}={toml}")
    else:
        row[key] = "@wrong@"
        lines = judged(write_toml(written).replace('"@wrong@"', toml).encode(), "solve", "{file}")
    assert any(f"{name} = {shown}: " in line for line in lines)


CHANGE = b"electrodes[0].x_mm=9.5"
words = damages(CHANGE).map(
    lambda data: data[:100_000].replace(b"\0", b"").decode("utf-8", "surrogateescape")
)


@given(changes=st.lists(words, min_size=1, max_size=3))
@drawn(0.5)
def test_damaged_changes_are_refused_or_held(changes: list[str]) -> None:
    options = [f"--set={word}" for word in changes]
    found = judged(LIST.encode(), "solve", "{file}", *options)
    assert isinstance(found, list) or Scene.parse(found.to_toml()) == found


AXES = (
    "film.thickness_um = [9, 25, 110]",
    'load.force_N = { start = 0.1, stop = 10, count = 3, spacing = "log" }',
    'name = "place"\nprobe.x_mm = { start = 0, stop = 10, count = 3 }\nprobe.y_mm = [0, 1, 2]',
    'mapping = { electrode = "A", angles_deg = [0, 45], distances_mm = [0, 4, 8] }',
    'film.bending = [true, false, "auto"]',
    "[axes.numerics]\ntolerance = [1e-2, 1e-3]",
)
sweeps = st.permutations(AXES).map(
    lambda axes: "\n[[axes]]\n".join(['[scene.probe]\nshape = "triangle"', *axes[:2]]).encode()
)


@given(data=sweeps.flatmap(damages))
@drawn(0.7)
def test_damaged_sweeps_are_refused_or_spread(data: bytes) -> None:
    found = judged(data, "sweep", "{file}", "--plan", "--output", "charges.nc")
    assert isinstance(found, list) or all(isinstance(scene, Scene) for scene in found)


@given(word=damages(b"A=905.1,B=731.4,C=600.2,D=640.9"))
@drawn(0.5)
def test_damaged_charges_are_refused_or_located(word: str | bytes) -> None:
    text = word[:50_000].replace(b"\0", b"").decode("utf-8", "surrogateescape")
    option = f"--charges={text}"
    with mock.patch("pvdf_fem.cli.locate.model_of", begin):
        found = judged(b"[probe]\n", "locate", "{file}", option)
    if isinstance(found, Scene):
        items = [item.partition("=")[::2] for item in text.split(",")]
        names = [name.strip() for name, _ in items]
        assert sorted(names) == sorted({*names} & {*"ABCD"})
        assert all(0.0 < abs(float(value)) <= 1e12 for _, value in items)


#: A table for each command, the scene that it is for, and options.
TABLES = {
    "locate": (
        "id,A,B,C,D,rotation_deg\n" + 4 * "1,905,731,600,640,0\n",
        '[probe]\nshape = "rectangle"\n',
        ["{scene}", "--quick", "--csv", "{file}"],
    ),
    "calibrate": (
        "x_mm,y_mm,rotation_deg,force_N,A,B,C,D\n" + 4 * "1,-2,0,1,905,731,600,640\n",
        "[probe]\n",
        ["{scene}", "{file}"],
    ),
    "track": (
        "t_s,A,B,C,D\n" + "".join(f"0.{i},0.905,0.731,0.6,0.64\n" for i in range(9)),
        '[probe]\nshape = "circle"\n[readout]\nkind = "voltage"\ninput_resistance_MOhm = 1.0\n',
        ["{scene}", "{file}"],
    ),
}


@given(data=st.data(), command=st.sampled_from([*TABLES]))
@drawn(0.7)
def test_damaged_tables_are_refused_or_have_a_status_in_each_row(data: Any, command: str) -> None:
    text, scene, arguments = TABLES[command]
    with TemporaryDirectory() as folder:
        path = Path(folder, "scene.toml")
        path.write_text(scene)
        arguments = [word.replace("{scene}", str(path)) for word in arguments]
        table = data.draw(damages(text.encode()))[:MOST_TABLE]
        found = judged(table, command, *arguments, codes=(0, 3))
    if isinstance(found, str):
        assert all(row["status"] for row in csv.DictReader(io.StringIO(found, newline="")))


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
_KEYS = [name for _, _, name in numbers_of(Scene().with_(probe={}).model_dump(exclude_none=True))]
_KEYS += ["film", "film.", "film.compression", "load.kind", "probe", "probe.x", "electrodes"]
_KEYS += ["electrodes[1]", "electrodes.layout", "electrodes[0].x_mm", "electrodes.0.name"]


@given(st.dictionaries(st.sampled_from(_KEYS) | st.text(max_size=9), _VALUES, min_size=1))
@drawn(0.5)
def test_changes_of_any_value_give_a_valid_scene_or_a_complaint(changes: dict[str, Any]) -> None:
    scene, problems = None, ("",)
    try:
        scene = Scene().with_(**changes)
    except SceneError as error:
        problems = error.problems
    if scene is None:
        assert all(line.isprintable() and ": " in line for line in problems)
    else:
        assert Scene.parse(scene.to_toml()) == scene


@given(
    st.tuples(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6)),
    st.floats(-1.0, 1.0),
    st.sampled_from([1.0, 1 - 1e-16, 1 - 1e-12, 0.5]),
)
@drawn(0.5)
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
    "directory": Path.mkdir,
    "pipe": _pipe,
    "loop": _loop,
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "empty device": lambda path: path.symlink_to(os.devnull),
    "100 MB": _large,
    "latin-1": lambda path: path.write_bytes(b"\n# \xb5m"),
    "missing\x1b[31m\n": lambda path: None,
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_no_text_file_is_refused_at_once(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    STRANGE[name](path)
    tracemalloc.start()
    with pytest.raises(SceneError) as caught:
        Scene.load(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10 * MOST_BYTES
    (line,) = caught.value.problems
    assert printable(name) in printable(line)


# ------------------------------------------------------------------------------------- processes


@pytest.mark.parametrize(
    "data",
    [
        b"[load]\nforce_N = " + b"9" * 100_000,
        b"x = " + b"[" * 500_000,
        b"[load]\nforce_N = 1" + b"\n" * 1_000_000,
    ],
    ids=["a long number", "deep", "a long file"],
)
def test_a_process_refuses_in_little_memory(tmp_path: Path, data: bytes) -> None:
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
    assert "Error" not in run.stderr
