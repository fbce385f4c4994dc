"""XDF files by the specification, as Lab Streaming Layer's LabRecorder writes them."""

import numpy as np
import pytest

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording, write_xdf

pytest.importorskip("pyxdf")

SAMPLES = make_samples(600)
LABELS = [(name, "mV") for name in NAMES]
#: Two gaps, of 0.3 s and 2 s.
STAMPS_S = 100.0 + 2e-3 * np.arange(600) + 0.3 * (np.arange(600) >= 200)
STAMPS_S[400:] += 2.0


def test_gaps_are_kept_and_labels_and_units_are_read(tmp_path):
    write_xdf(tmp_path / "r.xdf", [("film", LABELS, 500.0, STAMPS_S, SAMPLES)])
    read = read_recording(tmp_path / "r.xdf")
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(STAMPS_S)
    assert read.units == ["mV"] * 4


def test_missing_stamps_follow_the_nominal_rate(tmp_path):
    stamps_s = np.where(np.arange(600) % 10 == 0, STAMPS_S, np.nan)
    write_xdf(tmp_path / "r.xdf", [("film", LABELS, 500.0, stamps_s, SAMPLES)])
    assert read_recording(tmp_path / "r.xdf").times_s == pytest.approx(STAMPS_S)


def test_clock_offsets_are_applied(tmp_path):
    offsets = [(1, time_s, 7.5) for time_s in np.arange(100.0, 104.0, 0.5)]
    write_xdf(tmp_path / "r.xdf", [("film", LABELS, 500.0, STAMPS_S, SAMPLES)], offsets)
    assert read_recording(tmp_path / "r.xdf").times_s == pytest.approx(STAMPS_S + 7.5)


def test_streams_are_chosen_by_name(tmp_path):
    streams = [
        ("left/film", LABELS, 500.0, STAMPS_S, SAMPLES),
        ("right", LABELS, 500.0, STAMPS_S + 1.0, -SAMPLES),
    ]
    write_xdf(tmp_path / "r.xdf", streams)
    with pytest.raises(FileError, match="several channels A: left/film/A, right/A"):
        read_recording(tmp_path / "r.xdf")
    read = read_recording(tmp_path / "r.xdf", channels={n: f"left/film/{n}" for n in NAMES})
    assert read.values == pytest.approx(SAMPLES)
    with pytest.raises(FileError, match="several streams, left/film, right"):
        read_recording(tmp_path / "r.xdf", channels={"A": "left/film/A", "B": "right/B"})


def test_two_streams_of_one_name_are_told_apart(tmp_path):
    streams = [("film", LABELS, 0.0, STAMPS_S, scale * SAMPLES) for scale in (1.0, 2.0)]
    write_xdf(tmp_path / "r.xdf", streams)
    read = read_recording(tmp_path / "r.xdf", channels={"A": "film#2/A"})
    assert read.values[:, 0] == pytest.approx(2.0 * SAMPLES[:, 0])


def test_the_part_before_a_cut_is_read(tmp_path):
    path = tmp_path / "r.xdf"
    write_xdf(path, [("film", LABELS, 500.0, STAMPS_S, SAMPLES)] * 2)
    path.write_bytes(path.read_bytes()[:-1000])
    read = read_recording(path, channels={name: f"film/{name}" for name in NAMES})
    assert read.values == pytest.approx(SAMPLES)
