"""Nothing that lies in a folder of results is ever executed."""

from __future__ import annotations

import io
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Response
from pvdf_fem.sweeps.store import Store, StoreError


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


def test_records_and_models_in_the_results_are_not_executed(hostile, executed, tmp_path):
    store, model = tmp_path / "results.db", tmp_path / "a.response"
    with Store(store):
        pass
    for path in (store, model):
        path.write_bytes(hostile)
    with pytest.raises(StoreError):
        Store(store).__enter__()
    with pytest.raises(ValueError, match=r"a\.response"):
        Response.load(model)
    assert not executed.exists()
