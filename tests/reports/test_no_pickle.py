"""Nothing that lies in a folder of results is ever executed."""

from __future__ import annotations

import ast
import io
import os
import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Response
from pvdf_fem.sweeps.store import Store, StoreError

ROOT = Path(__file__).parents[2]
#: Modules that execute what they read, and functions of others that do.
EXECUTING = {
    "pickle",
    "_pickle",
    "cPickle",
    "dill",
    "cloudpickle",
    "marshal",
    "shelve",
    "jsonpickle",
}
FUNCTIONS = {"read_pickle", "allow_pickle", "Memory", "unsafe_load", "Unpickler"}
READERS = {"joblib": {"load", "dump", "Memory"}, "torch": {"load"}, "yaml": {"load"}}


def executing(source: str) -> Iterator[str]:
    """What a source uses that executes what it reads from a file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (
                alias.name for alias in node.names if set(alias.name.split(".")) & EXECUTING
            )
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")
            names = {alias.name for alias in node.names}
            if set(module) & EXECUTING or names & (EXECUTING | FUNCTIONS):
                yield ast.unparse(node)
            if names & READERS.get(module[0], set()):
                yield ast.unparse(node)
        elif isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            if not (isinstance(node.value, ast.Constant) and node.value.value is False):
                yield f"allow_pickle={ast.unparse(node.value)}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in FUNCTIONS | READERS.get(node.value.id, set()):
                yield ast.unparse(node)
        elif isinstance(node, ast.Call) and "import" in ast.unparse(node.func):
            texts = [a.value for a in node.args if isinstance(a, ast.Constant)]
            yield from (text for text in texts if str(text).split(".")[0] in EXECUTING)


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "import os, marshal as m",
        "from pickle import loads",
        "from joblib import load",
        "import joblib\njoblib.load('a')",
        "joblib.Memory('folder')",
        "np.load(path, allow_pickle=True)",
        "np.load(path, allow_pickle=maybe)",
        "import joblib.externals.cloudpickle",
        "from joblib.externals import cloudpickle",
        "import_module('shelve')",
        "__import__('pickle')",
        "pandas.read_pickle('a')",
    ],
)
def test_what_executes_is_found(source: str) -> None:
    assert list(executing(source))


def test_no_source_executes_what_it_reads() -> None:
    paths = [path for top in ("pvdf_fem", "reports") for path in ROOT.glob(f"{top}/**/*.py")]
    found = {
        str(path.relative_to(ROOT)): list(executing(path.read_text(encoding="utf-8")))
        for path in paths
    }
    assert len(found) > 100
    assert {path: uses for path, uses in found.items() if uses} == {}


class Hostile:
    """Its pickle makes a folder when it is read."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.folder),)


@pytest.fixture
def executed(tmp_path: Path) -> Path:
    """A folder that is there once a hostile file has been executed."""
    return tmp_path / "executed"


@pytest.fixture(params=["pickle", "npy", "npz"])
def hostile(request: pytest.FixtureRequest, executed: Path) -> bytes:
    """A file that executes when it is read as it might be."""
    if request.param == "pickle":
        return pickle.dumps(Hostile(executed))
    array, file = np.array([Hostile(executed)], dtype=object), io.BytesIO()
    if request.param == "npy":
        np.save(file, array, allow_pickle=True)
    else:
        np.savez(file, offsets_mm=array, material=array)
    return file.getvalue()


def test_the_hostile_files_would_execute(hostile: bytes, executed: Path) -> None:
    array = np.load(io.BytesIO(hostile), allow_pickle=True)
    if isinstance(array, np.lib.npyio.NpzFile):
        array["offsets_mm"]
    assert executed.is_dir()


def replace_all(folder: Path, data: bytes) -> int:
    """Put the data in the place of every file; returns their number."""
    files = [path for path in folder.iterdir() if path.is_file()]
    for path in files:
        path.write_bytes(data)
    return len(files)


def test_records_and_models_in_the_results_are_not_executed(
    hostile: bytes, executed: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    with Store(folder / "results.db"):
        pass
    (folder / "a.response").touch()
    assert replace_all(folder, hostile) >= 2
    with pytest.raises(StoreError):
        Store(folder / "results.db").__enter__()
    with pytest.raises(ValueError, match="is not a response"):
        Response.load(folder / "a.response")
    assert not executed.exists()
