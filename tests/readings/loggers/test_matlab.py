"""MATLAB files of version 5, which scipy writes."""

import numpy as np
import pytest
from scipy.io import savemat

from tests.helpers.recordings import NAMES, make_samples, read_recording

SAMPLES = make_samples()


def test_a_matrix_with_a_rate(tmp_path):
    savemat(tmp_path / "r.mat", {"readings": SAMPLES, "Fs": 2000.0})
    read = read_recording(tmp_path / "r.mat")
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(np.arange(50) / 2000.0)


@pytest.mark.parametrize("compression", [False, True])
def test_fields_of_a_struct_with_times(tmp_path, compression):
    fields = {name: column[:, None] for name, column in zip(NAMES, SAMPLES.T, strict=True)}
    log = {"film": fields | {"t_s": 1e-3 * np.arange(50)}}
    savemat(tmp_path / "r.mat", {"log": log}, do_compression=compression)
    read = read_recording(tmp_path / "r.mat")
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(1e-3 * np.arange(50))
    assert read.recording.columns[0].heading == "log/film/A"
