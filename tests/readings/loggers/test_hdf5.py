"""HDF5 files that h5py, pandas and xarray would write, and those of MATLAB 7.3."""

import numpy as np
import pytest

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording

h5py = pytest.importorskip("h5py")

SAMPLES = make_samples()
TIMES_S = 1e-3 * np.arange(50)


def test_arrays_of_a_group_with_times_and_units(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        group = file.create_group("run/film")
        for name, column in zip(NAMES, SAMPLES.T, strict=True):
            group.create_dataset(name, data=column, compression="gzip").attrs["units"] = "mV"
        group["time"] = 1e3 * TIMES_S
        group["time"].attrs["units"] = "ms"
    read = read_recording(tmp_path / "r.h5")
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(TIMES_S)
    assert read.units == ["mV"] * 4


@pytest.mark.parametrize("transpose", [False, True])
def test_the_longer_axis_of_a_matrix_is_time(tmp_path, transpose):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        data = file.create_dataset("data", data=SAMPLES.T if transpose else SAMPLES)
        data.attrs["sampling_rate"] = 1000.0
    read = read_recording(tmp_path / "r.h5")
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(TIMES_S)
    assert "A=data/0" in read.notes


@pytest.mark.parametrize("count", [4, 50])
def test_a_matrix_of_matlab_is_transposed(tmp_path, count):
    """MATLAB's data(50, 4) is (4, 50) in h5py; of a square matrix only that tells the axes."""
    with h5py.File(tmp_path / "r.mat", "w", userblock_size=512) as file:
        for name, values in {"data": SAMPLES[:count], "fs": np.array([[1000.0]])}.items():
            file[name] = values.T
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with (tmp_path / "r.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    read = read_recording(tmp_path / "r.mat")
    assert read.values == pytest.approx(SAMPLES[:count])
    assert read.times_s == pytest.approx(TIMES_S[:count])


def test_a_table_with_named_columns(tmp_path):
    table = np.zeros(50, dtype=[("time_ns", "i8"), *((name, "f4") for name in NAMES)])
    table["time_ns"] = 1_777_000_000_123_000_000 + np.arange(50) * 1_000_000
    for name, column in zip(NAMES, SAMPLES.T, strict=True):
        table[name] = column
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["log"] = table
    read = read_recording(tmp_path / "r.h5")
    assert read.values == pytest.approx(SAMPLES, rel=1e-6)
    assert read.times_s == pytest.approx(TIMES_S, abs=1e-12)


def test_packed_integers_are_scaled(tmp_path):
    raw = np.array([[1, 2, 3, 4], [5, 6, -99, 8], [1, 1, 1, 1], [0, 0, 0, 0], [2, 2, 2, 2]])
    with h5py.File(tmp_path / "r.nc", "w") as file:
        file.attrs["dt"] = 1e-3
        for name, column in zip(NAMES, raw.T, strict=True):
            file[name] = column.astype("i2")
            file[name].attrs.update(scale_factor=0.5, add_offset=1.0, _FillValue=np.int16(-99))
    read = read_recording(tmp_path / "r.nc")
    expected = 0.5 * raw + 1.0
    expected[1, 2] = np.nan
    assert read.values == pytest.approx(expected, nan_ok=True)
    assert read.recording.rate_Hz == pytest.approx(1000.0)


def test_channels_of_different_lengths_are_refused(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file.attrs["fs"] = 1000.0
        for i, name in enumerate(NAMES):
            file[name] = SAMPLES[i:, 0]
    with pytest.raises(FileError, match="A 50, B 49, C 48, D 47"):
        read_recording(tmp_path / "r.h5")
