"""TDMS files that npTDMS writes."""

import numpy as np
import pytest

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording

nptdms = pytest.importorskip("nptdms")

SAMPLES = make_samples()
START = np.datetime64("2026-05-01T12:00:00")


def write_tdms(path, samples, names=NAMES, segments=1, **properties):
    described = {"wf_increment": 1e-3, "wf_start_time": START, "unit_string": "mV"} | properties
    with nptdms.TdmsWriter(path) as writer:
        for part in np.array_split(samples, segments):
            channels = [
                nptdms.ChannelObject("Film", name, column, described)
                for name, column in zip(names, part.T, strict=True)
            ]
            writer.write_segment(channels)
    return path


def test_samples_times_units_and_start(tmp_path):
    read = read_recording(write_tdms(tmp_path / "r.tdms", SAMPLES, segments=3))
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(1e-3 * np.arange(50))
    assert read.units == ["mV"] * 4
    assert read.recording.rate_Hz == pytest.approx(1000.0)
    assert read.recording.start.isoformat() == "2026-05-01T12:00:00+00:00"
    assert not read.notes


def test_the_first_sample_is_late_by_the_offset_once(tmp_path):
    read = read_recording(write_tdms(tmp_path / "r.tdms", SAMPLES, wf_start_offset=2.5))
    assert read.times_s[0] == pytest.approx(2.5)


def test_a_stale_index_beside_the_file_is_ignored(tmp_path):
    path = write_tdms(tmp_path / "r.tdms", SAMPLES)
    with nptdms.TdmsWriter(str(tmp_path / "old.tdms"), index_file=True) as writer:
        writer.write_segment([nptdms.ChannelObject("Film", name, SAMPLES[:3, 0]) for name in NAMES])
    (tmp_path / "old.tdms_index").rename(tmp_path / "r.tdms_index")
    assert read_recording(path).values == pytest.approx(SAMPLES)


def test_a_file_that_was_cut_has_the_rows_of_all_channels(tmp_path):
    path = write_tdms(tmp_path / "r.tdms", SAMPLES, segments=2)
    content = path.read_bytes()
    path.write_bytes(content[: -2 * 25 * 8 - 40])  # D, C and five samples of B
    read = read_recording(path)
    assert read.values == pytest.approx(SAMPLES[:25])
    assert "incomplete" in read.notes
    assert "25" in read.notes


def test_raw_integers_are_scaled_as_the_channel_says(tmp_path):
    scale = {
        "NI_Scaling_Status": "unscaled",
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 2e-3,
        "NI_Scale[0]_Linear_Y_Intercept": 0.5,
        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
    }
    raw = np.arange(200, dtype=np.int16).reshape(50, 4)
    read = read_recording(write_tdms(tmp_path / "r.tdms", raw, **scale))
    assert read.values == pytest.approx(0.5 + 2e-3 * raw)


def test_channels_are_chosen_by_address_or_name(tmp_path):
    path = write_tdms(tmp_path / "r.tdms", SAMPLES, ["ai0", "ai1", "ai2", "ai3"])
    read = read_recording(path, channels={"B": "Film/ai3", "A": "ai1"})
    assert read.names == ["A", "B"]
    assert read.values == pytest.approx(SAMPLES[:, [1, 3]])
    with pytest.raises(FileError, match="A=Film/ai0,B=Film/ai1,C=Film/ai2,D=Film/ai3"):
        read_recording(path)


def test_times_of_a_channel_of_stamps(tmp_path):
    path = tmp_path / "r.tdms"
    stamps = START.astype("datetime64[us]") + np.cumsum(np.full(50, 2000)).astype("timedelta64[us]")
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("Film", "Time", stamps)]
            + [nptdms.ChannelObject("Film", n, c) for n, c in zip(NAMES, SAMPLES.T, strict=True)]
        )
    read = read_recording(path)
    assert read.times_s == pytest.approx(2e-3 * np.arange(50), abs=2e-6)
    assert "2026-05-01 12:00:00.002" in read.notes


def test_a_recording_that_was_started_again_is_noticed(tmp_path):
    """npTDMS has the start of the last part only, for all samples."""
    path = write_tdms(tmp_path / "r.tdms", SAMPLES[:20], segments=3)
    later = START + np.timedelta64(3600, "s")
    write_tdms(tmp_path / "later.tdms", SAMPLES[20:], wf_start_time=later)
    path.write_bytes(path.read_bytes() + (tmp_path / "later.tdms").read_bytes())
    read = read_recording(path)
    assert read.values == pytest.approx(SAMPLES)
    assert "2 values of wf_start_time" in read.notes


def test_channels_of_different_rates_are_refused(tmp_path):
    path = tmp_path / "r.tdms"
    with nptdms.TdmsWriter(path) as writer:
        for name, increment in zip(NAMES, (1e-3, 1e-3, 2e-3, 1e-3), strict=True):
            properties = {"wf_increment": increment}
            writer.write_segment([nptdms.ChannelObject("G", name, SAMPLES[:, 0], properties)])
    with pytest.raises(FileError, match="G/A and G/C are sampled at 1000 and 500 Hz"):
        read_recording(path)
