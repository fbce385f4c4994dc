"""Examples in the docstrings of public names run; what they print is not compared."""

from __future__ import annotations

import csv
import doctest
import shutil

import numpy as np
import pytest

import pvdf_fem
from pvdf_fem.scene.scene_file import get_example_text, read_examples

#: The sensor of the examples: a disc, whose response is built in seconds.
SENSOR = pvdf_fem.Scene(
    probe={"shape": "circle", "radius_mm": 3.0},
    readout={"reading": "change"},
    model={"reach_mm": 4.0, "force_range_N": [0.3, 1.0], "tolerance": 3e-2},
)


def read_examples_of(name: str) -> str:
    """Return the examples of a public name and of its methods."""
    documented = doctest.DocTestFinder().find(getattr(pvdf_fem, name), name)
    return "".join(example.source for test in documented for example in test.examples)


@pytest.mark.parametrize("name", pvdf_fem.__all__)
def test_every_public_name_has_an_example(name):
    assert read_examples_of(name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write the files that examples read to a folder."""
    folder = tmp_path_factory.mktemp("examples")
    folder.joinpath("report.toml").write_text(get_example_text("report", read_examples()))
    folder.joinpath("sensor.toml").write_text(SENSOR.to_toml())
    with folder.joinpath("touches.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["x_mm", "y_mm", "rotation_deg", "force_N", *"ABCD"])
        for x, y in 3.0 * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1), (0, 0), (1, 0)]):
            touch = {"probe.x_mm": x, "probe.y_mm": y, "load.force_N": 0.5}
            changes = pvdf_fem.solve(SENSOR.with_(touch)).charge_changes_pC
            table.writerow([x, y, 0.0, 0.5, *changes.values()])
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", pvdf_fem.__all__)
def test_examples_run(name, folder, monkeypatch):
    examples = read_examples_of(name)
    if "ccx" in examples and not shutil.which("ccx"):
        pytest.skip("ccx is not installed")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # a few solves need no further processes
    monkeypatch.setenv("MPLBACKEND", "agg")
    exec(examples, {public: getattr(pvdf_fem, public) for public in pvdf_fem.__all__})
