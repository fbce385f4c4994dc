"""Nothing that lies in a folder of results is ever executed."""

from __future__ import annotations

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


@pytest.mark.parametrize("form", ["pickle", "npz"])
def test_records_and_models_in_the_results_are_not_executed(tmp_path: Path, form: str) -> None:
    """Files that would execute, which is shown first, when they are read as they might be."""
    executed, path = tmp_path / "executed", tmp_path / "a.response"
    hostile = np.array([Hostile(executed)], dtype=object)
    with path.open("wb") as file:
        pickle.dump(hostile, file) if form == "pickle" else np.savez(file, material=hostile)
    found = np.load(path, allow_pickle=True)
    assert form == "pickle" or found["material"].size
    executed.rmdir()
    with pytest.raises(StoreError):
        Store(path).__enter__()
    with pytest.raises(ValueError, match=r"a\.response"):
        Response.load(path)
    assert not executed.exists()
