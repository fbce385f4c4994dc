"""Files of responses: what was written is read, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from pvdf_fem import Response, build_response
from pvdf_fem.cli.main import main
from pvdf_fem.files import FileError
from pvdf_fem.response.model import Domain
from pvdf_fem.response.response_file import FORMAT, ResponseError
from tests.helpers.damage import damages, decayed, drawn
from tests.response import made_response as kept

ROOT = Path(__file__).parents[2]


def test_a_response_survives_a_file(tmp_path: Path) -> None:
    """And numbers of any type: a response that takes minutes must not be lost for the type of an
    argument of its build."""
    domain = Domain(np.int64(8), [np.float32(0.5), 5])  # type: ignore[arg-type]
    made = replace(kept.response(), domain=domain, error_bound=np.float32(0.25), remarks=("a",))
    made.save(tmp_path / "triangle.response")
    again = Response.load(str(tmp_path / "triangle.response"))
    assert (again.domain, again.error_bound) == (Domain(8.0, (0.5, 5.0)), 0.25)
    names = ("names", "scene", "error_bound", "tolerance", "remarks", "stress", "at_rest_pC")
    assert [getattr(again, name) for name in names] == [getattr(made, name) for name in names]
    made, touches = replace(made, domain=again.domain), [[1.0, -2.0, 33.0, 1.5]]
    for before, after in zip(made.evaluate(touches), again.evaluate(touches), strict=True):
        assert np.array_equal(before, after)
    assert os.listdir(tmp_path) == ["triangle.response"]


def refusal(path: Path) -> str:
    with pytest.raises(ResponseError) as caught:
        Response.load(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}: ")
    assert "pvdf-fem model" in line
    assert len(line) < len(str(path)) + 300
    return line


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged") / "a.response"


@given(data=damages(kept.response_bytes(), decayed))
@drawn(0.5)
def test_damage_is_found_wherever_it_is(data: bytes, path: Path) -> None:
    path.write_bytes(data)
    if data != kept.response_bytes():  # two accidents may cancel
        refusal(path)


FOREIGN = (
    *(b"", b"(lp0\nF1.0\na.", b"PK\x05\x06" + bytes(18), b"\x89PNG\r\n\x1a\n" + bytes(100)),
    *(b"SQLite format 3\0" + bytes(1000), bytes(5000), b"\x93NUMPY\x01\x00" + bytes(128)),
    kept.SCENE.read_bytes(),
)


@pytest.mark.parametrize("data", FOREIGN)
def test_other_files_are_told_apart(data: bytes, path: Path) -> None:
    path.write_bytes(data)
    assert "is not a response of this version" in refusal(path)
    path.write_bytes(FORMAT)
    assert "is damaged" in refusal(path)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "endless").symlink_to("/dev/zero")
    for name in ("", "pipe", "endless", "missing"):
        with pytest.raises(FileError, match=r": (is no regular file|cannot be read .*); give"):
            Response.load(tmp_path / name)


SAVER = """
import sys
from dataclasses import replace
from pvdf_fem import Response
from tests.response import made_response as kept
bound = float(sys.argv[2])
response = replace(kept.response(), error_bound=bound)
for _ in range(15):
    response.save(sys.argv[1])
    assert Response.load(sys.argv[1]).error_bound in (1.0, 2.0)
"""


def test_two_processes_save_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / "a.response"
    savers = [
        subprocess.Popen(
            [sys.executable, "-c", SAVER, str(path), bound], cwd=ROOT, stderr=subprocess.PIPE
        )
        for bound in ("1", "2")
    ]
    for saver in savers:
        _, err = saver.communicate(timeout=100)
        assert (saver.returncode, err.decode()) == (0, "")
    assert Response.load(path).error_bound in (1.0, 2.0)
    assert os.listdir(tmp_path) == ["a.response"]


def test_a_damaged_model_is_told_before_another_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two probes, the second one has a model, which is damaged."""
    from pvdf_fem.cli.response_model import ModelChoice

    for name, shape in (("first", "circle"), ("second", "triangle")):
        (tmp_path / f"{name}.toml").write_text(f'[probe]\nshape = "{shape}"\n')
    monkeypatch.setattr(
        ModelChoice, "path", lambda _, scene, name: tmp_path / f"{Path(name).stem}.response"
    )
    monkeypatch.setattr(sys.modules[build_response.__module__], "build_response", None)
    (tmp_path / "second.response").write_bytes(kept.response_bytes()[:-1])
    first, second = (str(tmp_path / f"{name}.toml") for name in ("first", "second"))
    assert main(["locate", first, "--or", second, "--charges", "A=9,B=7,C=6"]) == 2
    assert "second.response: is damaged" in capsys.readouterr().err
