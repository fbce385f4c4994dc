"""Parquet tables that pandas and pyarrow write."""

import numpy as np
import pandas as pd
import pytest

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

SAMPLES = make_samples(70_000)  # more than a block
TIMES_S = np.arange(70_000) / 500.0


def test_a_column_of_times_in_ms_and_missing_cells(tmp_path):
    table = pd.DataFrame(dict(zip(NAMES, SAMPLES.T, strict=True)))
    table.insert(0, "t_ms", 1e3 * TIMES_S)
    table.loc[3, "B"] = np.nan
    table.to_parquet(tmp_path / "r.parquet")
    read = read_recording(tmp_path / "r.parquet")
    expected = SAMPLES.copy()
    expected[3, 1] = np.nan
    np.testing.assert_allclose(read.values, expected)
    np.testing.assert_allclose(read.times_s, TIMES_S)


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_an_index_of_dates_with_a_time_zone(tmp_path, unit):
    table = pd.DataFrame(dict(zip(NAMES, SAMPLES.T, strict=True)))
    start = pd.Timestamp("2026-05-01 12:00", tz="Europe/Berlin")
    index = start + pd.to_timedelta(TIMES_S, unit="s")
    table.index = index.as_unit(unit)
    table.to_parquet(tmp_path / "r.parquet")
    read = read_recording(tmp_path / "r.parquet")
    np.testing.assert_allclose(read.times_s, TIMES_S, atol=1e-9)
    assert "2026-05-01 10:00:00.000+00:00" in read.notes


def test_integers_with_missing_cells_decimals_and_units(tmp_path):
    stamps_ns = pa.array(1_777_000_000_000_000_000 + 2_000_000 * np.arange(3))
    units = {"unit": "mV"}
    fields = [
        pa.field("t_ns", pa.int64()),
        pa.field("A", pa.int16(), metadata=units),
        pa.field("B", pa.decimal128(6, 3), metadata=units),
    ]
    counts = pa.array([1, None, 3], pa.int16())
    decimals = pa.array([1.5, -2.25, 0.125]).cast(pa.decimal128(6, 3))
    table = pa.Table.from_arrays([stamps_ns, counts, decimals], schema=pa.schema(fields))
    parquet.write_table(table, tmp_path / "r.parquet")
    read = read_recording(tmp_path / "r.parquet", ("A", "B"))
    assert read.values[:, 0] == pytest.approx([1.0, np.nan, 3.0], nan_ok=True)
    assert read.values[:, 1] == pytest.approx([1.5, -2.25, 0.125])
    assert read.units == ["mV", "mV"]
    assert read.times_s == pytest.approx([0.0, 2e-3, 4e-3], abs=1e-12)


def test_a_rate_for_a_file_without_times(tmp_path):
    pd.DataFrame(dict(zip(NAMES, SAMPLES.T, strict=True))).to_parquet(tmp_path / "r.parquet")
    with pytest.raises(FileError, match="--rate"):
        read_recording(tmp_path / "r.parquet")
    read = read_recording(tmp_path / "r.parquet", rate_Hz=500.0)
    np.testing.assert_allclose(read.times_s, TIMES_S)
    np.testing.assert_allclose(read.values, SAMPLES)


def test_times_of_unknown_unit_are_refused(tmp_path):
    table = pd.DataFrame({"time": TIMES_S[:5], "A": SAMPLES[:5, 0]})
    table.to_parquet(tmp_path / "r.parquet")
    with pytest.raises(FileError, match="t_s=time"):
        read_recording(tmp_path / "r.parquet", ("A",))
    read = read_recording(tmp_path / "r.parquet", ("A",), channels={"A": "A", "t_ms": "time"})
    assert read.times_s == pytest.approx(1e-3 * TIMES_S[:5])
