"""Sound files that soundfile and scipy write."""

import numpy as np
import pytest
from scipy.io import wavfile

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording

soundfile = pytest.importorskip("soundfile")

SAMPLES = make_samples(100_000)
FULL_SCALE_V = dict.fromkeys(NAMES, 2.5)
#: Half a step of each format, of full scale.
ROUNDING = {"PCM_U8": 2**-7, "PCM_16": 2**-15, "PCM_24": 2**-23, "PCM_32": 2**-31, "FLOAT": 2**-24}


@pytest.mark.parametrize("subtype", ROUNDING)
def test_all_widths_have_the_same_scale(tmp_path, subtype):
    soundfile.write(tmp_path / "r.wav", SAMPLES, 4000, subtype=subtype)
    read = read_recording(tmp_path / "r.wav", full_scale_V=FULL_SCALE_V)
    assert np.abs(read.values / 2.5 - SAMPLES).max() <= ROUNDING[subtype]
    np.testing.assert_allclose(read.times_s, np.arange(100_000) / 4000.0)
    assert read.units == ["V"] * 4
    assert "A=1, B=2, C=3, D=4" in read.notes


def test_integers_of_scipy_have_the_same_scale(tmp_path):
    raw = np.array([[2**30, -(2**30), 0, 2**20]], dtype=np.int32)
    wavfile.write(tmp_path / "r.wav", 1000, raw)
    read = read_recording(tmp_path / "r.wav", full_scale_V=FULL_SCALE_V)
    assert read.values == pytest.approx(2.5 * np.array([[0.5, -0.5, 0.0, 2.0**-11]]))


def test_integers_at_the_ends_are_full_scale(tmp_path):
    raw = np.array([[32767, 32766, -32768, -32767]], dtype=np.int16)
    wavfile.write(tmp_path / "r.wav", 1000, raw)
    read = read_recording(tmp_path / "r.wav", full_scale_V=FULL_SCALE_V)
    assert read.values[0, [0, 2, 3]].tolist() == [2.5, -2.5, -2.5]
    assert read.values[0, 1] == pytest.approx(2.5 * 32766 / 32768)


def test_floats_beyond_one_are_kept(tmp_path):
    samples = np.array([[1.5, -3.0, 1.0, -1.0]])
    wavfile.write(tmp_path / "r.wav", 1000, samples)
    read = read_recording(tmp_path / "r.wav", full_scale_V=FULL_SCALE_V)
    assert read.values == pytest.approx(2.5 * samples)


def test_channels_by_number_and_full_scale_by_electrode(tmp_path):
    soundfile.write(tmp_path / "r.flac", SAMPLES, 4000)
    full_scale_V = {"A": 1.0, "B": 10.0}
    channels = {"A": "4", "B": "2"}
    read = read_recording(tmp_path / "r.flac", channels=channels, full_scale_V=full_scale_V)
    np.testing.assert_allclose(read.values, SAMPLES[:, [3, 1]] * [1.0, 10.0], atol=4e-4)


def test_full_scale_must_be_given(tmp_path):
    soundfile.write(tmp_path / "r.wav", SAMPLES, 4000)
    with pytest.raises(FileError, match=r"readout\.full_scale_V .*--full-scale"):
        read_recording(tmp_path / "r.wav")


def test_a_header_without_a_length_is_refused(tmp_path):
    """As a recorder leaves it that was stopped hard; soundfile finds no samples, in silence."""
    path = tmp_path / "r.wav"
    soundfile.write(path, SAMPLES, 4000)
    content = bytearray(path.read_bytes())
    place = content.find(b"data") + 4
    content[place : place + 4] = bytes(4)
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"no samples.*ignore-length"):
        read_recording(path, full_scale_V=FULL_SCALE_V)
