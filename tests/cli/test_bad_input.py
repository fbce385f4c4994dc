"""Damaged input of each kind gives error messages, or is accepted with its remaining values."""

from __future__ import annotations

import csv
import io
import os
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pvdf_fem.cli.program import MAX_LINE_LENGTH, MAX_LINES
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import MAX_BYTES
from tests.helpers.damage import damages, drawn

MAX_TABLE_BYTES = 500  #: Bytes of a damaged table, whose rows are all answered.

LIST = '[[electrodes]]\nname = "β 2"\nx_mm = 9.0\ny_mm = 0.0\n[probe]\n'
ROOT = Path(__file__).parents[2]
TEXTS = [path.read_text("utf-8") for path in sorted((ROOT / "geometry").glob("*.toml"))]
SCENES = [text for text in TEXTS if "[[axes]]" not in text and "[[section" not in text]
AXES = """[scene.probe]
shape = "triangle"
[[axes]]
load.force_N = { start = 0.1, stop = 10, count = 3, spacing = "log" }
[[axes]]
name = "place"
probe.x_mm = { start = 0, stop = 10, count = 3 }
probe.y_mm = [0, 1, 2]
[[axes]]
mapping = { electrode = "A", angles_deg = [0, 45], distances_mm = [0, 4, 8] }
[[axes]]
film.bending = [true, false, "auto"]
"""
STREAM = "t_s,A,B,C,D\n" + "".join(f"0.{i},0.905,0.731,0.6,0.64\n" for i in range(9))

TOUCHES = "x_mm,y_mm,rotation_deg,force_N,A,B,C,D\n" + 4 * "1,-2,0,1,905,731,600,640\n"


def are_scenes(*scenes):
    return all(Scene.parse(scene.to_toml()) == scene for scene in scenes)


def has_a_status_in_each_row(table):
    return all(row["status"] for row in csv.DictReader(io.StringIO(table, newline="")))


#: Command lines with the file or the word ``{}``, texts to be damaged, and a check of the arguments
#: of the work, or of the rows of the output.
INPUTS = {
    "scene": ("solve {}", [*SCENES, LIST], are_scenes),
    "change": ("solve list.toml --set={}", ["electrodes[0].x_mm=9.5"], are_scenes),
    "sweep": ("sweep {} --plan --output charges.nc", [AXES], lambda scenes: are_scenes(*scenes)),
    "charges": (
        "locate scene.toml --charges={}",
        ["A=905.1,B=731.4,C=600.2,D=6e2"],
        lambda _, charges: {*charges} <= {*"ABCD"} and all(charges.values()),
    ),
    "readings": (
        "locate scene.toml --quick --csv {}",
        ["id,A,B,C,D,rotation_deg\n" + 2 * "1,905,731,600,640,0\n"],
        has_a_status_in_each_row,
    ),
    "touches": ("calibrate wired.toml {}", [TOUCHES], lambda scene, *_: are_scenes(scene)),
    "stream": ("track sensor.toml {}", [STREAM], has_a_status_in_each_row),
}


@pytest.mark.parametrize("name", INPUTS)
@given(data=st.data())
@settings(drawn(0.6), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_input_is_an_error_or_a_valid_input(
    name, data, folder, made_up_responses, work_begun, command
):
    line, texts, is_valid = INPUTS[name]
    damaged = data.draw(st.sampled_from(texts).flatmap(lambda text: damages(text.encode())))
    if is_valid is has_a_status_in_each_row:
        damaged = damaged[:MAX_TABLE_BYTES]
    if "={}" in line:  # a word, as long as a system takes
        word = damaged[:100_000].replace(b"\0", b"").decode("utf-8", "surrogateescape")
    else:
        word = "input.dat"
        Path(word).write_bytes(damaged)
    before = {*folder.iterdir()}
    try:
        run = command(*(part.replace("{}", word) for part in line.split()))
    except work_begun as accepted:
        valid = is_valid(*accepted.args)
    else:
        valid = run.out and is_valid(run.out)  # rows are answered one by one
        if not valid:
            lines = run.stderr_keys
            assert (run.code, run.out, bool(lines)) == (2, "", True)
            assert len(lines) <= MAX_LINES + 1 or lines[0] == "usage"
            lines = run.err.splitlines()
            assert all(line.isprintable() and len(line) < MAX_LINE_LENGTH + 100 for line in lines)
            return
    assert valid
    assert {*folder.iterdir()} == before


# ------------------------------------------------------------------------ paths that are no files


NOT_TEXT_FILES = {
    "directory": Path.mkdir,
    "pipe": os.mkfifo,
    "endless": lambda path: path.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("name", NOT_TEXT_FILES)
def test_a_path_that_is_not_a_text_file_is_an_error_at_once(tmp_path, name):
    path = tmp_path / name
    NOT_TEXT_FILES[name](path)
    tracemalloc.start()
    with pytest.raises(SceneError) as caught:
        Scene.from_file(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10 * MAX_BYTES
    (line,) = caught.value.problems
    assert name in line
