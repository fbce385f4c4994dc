"""How the format of a file is found, and what is said if it cannot be read."""

import gzip
import subprocess
import sys
from contextlib import ExitStack

import pytest

from pvdf_fem.files import FileError
from pvdf_fem.readings.loggers import logger_reader
from pvdf_fem.readings.loggers.channel_choice import parse_channel_choice
from pvdf_fem.readings.loggers.registry import READERS, find_reader, open_reader

#: First bytes of each format.
HEADS = {
    "TDMS": b"TDSm",
    "LVM": b"\xef\xbb\xbfLabVIEW Measurement\t\n",
    "XDF": b"XDF:",
    "MCAP": b"\x89MCAP0\r\n",
    "ROS 2 bag": b"SQLite format 3\0",
    "HDF5": bytes(2048) + b"\x89HDF\r\n\x1a\n",
    "MATLAB": b"MATLAB 5.0 MAT-file, written by a test",
    "WAV": b"RIFF\0\0\0\0WAVEfmt ",
    "Parquet": b"PAR1",
}


def test_every_reader_has_a_head():
    assert list(HEADS) == [reader.title for reader in READERS]


@pytest.mark.parametrize("title", HEADS)
def test_the_format_is_found_whatever_the_extension(tmp_path, title):
    for name in ("r.csv", "r.tdms", "r"):
        path = tmp_path / name
        path.write_bytes(HEADS[title])
        assert find_reader(path).title == title


def test_text_is_a_table_even_with_the_extension_of_a_logger(tmp_path):
    (tmp_path / "r.tdms").write_text("t_s,A\n0,1\n")
    assert find_reader(tmp_path / "r.tdms") is None


def test_other_binary_files_with_the_extension_of_a_logger_are_refused(tmp_path):
    (tmp_path / "r.tdms").write_bytes(bytes(100))
    with pytest.raises(FileError, match="neither TDMS"):
        find_reader(tmp_path / "r.tdms")
    (tmp_path / "r.tdms_index").write_bytes(b"TDSh" + bytes(100))
    with pytest.raises(FileError, match=r"index of a TDMS file; give the file \.tdms"):
        find_reader(tmp_path / "r.tdms_index")


@pytest.mark.parametrize(
    ("head", "advice"),
    [
        (gzip.compress(b"t_s,A\n0,1\n", mtime=0), "gunzip"),
        (b"PK\x03\x04" + bytes(30), "CSV"),
        (b"CDF\x01" + bytes(30), "NetCDF-3, which is not read"),
    ],
)
def test_files_that_are_no_tables_are_named_with_the_way_to_convert_them(tmp_path, head, advice):
    (tmp_path / "r.csv").write_bytes(head)
    with pytest.raises(FileError, match=advice):
        find_reader(tmp_path / "r.csv")


@pytest.mark.parametrize(
    "title", [reader.title for reader in READERS if reader.package not in ("", "scipy")]
)
def test_a_missing_package_is_named_with_the_way_to_install_it(tmp_path, monkeypatch, title):
    def refuse(module):
        raise ImportError(module)

    monkeypatch.setattr(logger_reader, "import_module", refuse)
    path = tmp_path / "r"
    path.write_bytes(HEADS[title] + bytes(100))
    with ExitStack() as stack, pytest.raises(FileError, match=r'pip install "pvdf-fem\[loggers\]"'):
        open_reader(path, stack)


def test_no_package_of_a_reader_is_imported_with_the_registry():
    script = (
        "import sys, pvdf_fem.readings.loggers.open_recording\n"
        "found = {'nptdms', 'pyxdf', 'mcap', 'rosbags', 'h5py', 'soundfile', 'pyarrow', 'scipy'}\n"
        "print(sorted(found & set(sys.modules)))\n"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert result.stdout.strip() == "[]"


def test_folders_of_bags(tmp_path):
    with ExitStack() as stack, pytest.raises(FileError, match=r"without a \.db3 or \.mcap file"):
        open_reader(tmp_path, stack)
    for name in ("bag_0.mcap", "bag_1.mcap", "bag_10.mcap"):
        (tmp_path / name).write_bytes(HEADS["MCAP"])
    listed = "bag_0.mcap, bag_1.mcap, bag_10.mcap; give one"
    with ExitStack() as stack, pytest.raises(FileError, match=listed):
        open_reader(tmp_path, stack)


def test_choices_of_channels():
    text = "A=Group/ai0, B=force, left/c,t_ms=Time"
    assert parse_channel_choice(text) == {"A": "Group/ai0", "B": "force, left/c", "t_ms": "Time"}
    with pytest.raises(ValueError, match="has no ="):
        parse_channel_choice("Group/ai0")
    with pytest.raises(ValueError, match="A occurs twice"):
        parse_channel_choice("A=1,A=2")
