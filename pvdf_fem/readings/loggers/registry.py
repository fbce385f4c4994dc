"""The formats of logger files. A new reader is added to `READERS`."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path

from pvdf_fem.files import FileError, open_regular_file
from pvdf_fem.readings.loggers.arrays.hdf5 import Hdf5Reader
from pvdf_fem.readings.loggers.arrays.matlab import MatlabReader
from pvdf_fem.readings.loggers.logger_reader import LoggerReader
from pvdf_fem.readings.loggers.lvm import LvmReader
from pvdf_fem.readings.loggers.messages.mcap import McapReader
from pvdf_fem.readings.loggers.messages.ros_bag import RosBagReader
from pvdf_fem.readings.loggers.parquet import ParquetReader
from pvdf_fem.readings.loggers.tdms import TdmsReader
from pvdf_fem.readings.loggers.wav import WavReader
from pvdf_fem.readings.loggers.xdf import XdfReader

READERS: tuple[type[LoggerReader], ...] = (
    TdmsReader,
    LvmReader,
    XdfReader,
    McapReader,
    RosBagReader,
    Hdf5Reader,
    MatlabReader,
    WavReader,
    ParquetReader,
)

#: Number of bytes from which a format is recognised; the signature of HDF5 may come late.
HEAD_BYTES = 4096
TDMS_INDEX_TAG = b"TDSh"
NETCDF3_TAG = b"CDF"
#: First bytes of files that are not read, with the end of the message that refuses them.
UNREAD_TAGS = {
    b"\x1f\x8b": "is compressed by gzip; unpack it, for example by: gunzip FILE",
    b"PK\x03\x04": "is a ZIP archive, such as a sheet of Excel; save it as CSV, or unpack it",
    b"\xd0\xcf\x11\xe0": "is an old document, such as an Excel workbook; save the sheet as CSV",
}


def find_reader(path: Path) -> type[LoggerReader] | None:
    """Return the reader for a file by its first bytes, whatever its extension.

    Parameters
    ----------
    path : Path
        A file, or the folder of a ROS 2 bag.

    Returns
    -------
    type of LoggerReader, or None
        None if the file has none of the formats, such as a table.

    Raises
    ------
    FileError
        If the file cannot be read, or has the extension of a format but is binary and not of any.
    """
    with open_regular_file(path, "a table or a recording") as file:
        head = file.read(HEAD_BYTES)
    for reader in READERS:
        if reader.is_recognised(head):
            return reader
    if head.startswith(TDMS_INDEX_TAG):
        raise FileError(f"{path}: is the index of a TDMS file; give the file .tdms beside it")
    for tag, reason in UNREAD_TAGS.items():
        if head.startswith(tag):
            raise FileError(f"{path}: {reason}")
    if head.startswith(NETCDF3_TAG) and b"\0" in head:
        advice = "convert it, for example by: nccopy -k nc4 OLD NEW; or write CSV or Parquet"
        raise FileError(f"{path}: is NetCDF-3, which is not read; {advice}")
    by_extension = [reader for reader in READERS if path.suffix.lower() in reader.extensions]
    if by_extension and (b"\0" in head or not head):
        title = by_extension[0].title
        reason = f"is neither {title} nor another known format"
        raise FileError(f"{path}: {reason}; copy it from the logger again")
    return None


def open_reader(path: Path, stack: ExitStack) -> LoggerReader | None:
    """Open a file by the reader of its format.

    Parameters
    ----------
    path : Path
        A file, or the folder of a ROS 2 bag with a single file.
    stack : ExitStack
        Context in which the file stays open.

    Returns
    -------
    LoggerReader or None
        None if the file has none of the formats.

    Raises
    ------
    FileError
        If the file cannot be read, or its format needs a package that is not installed.
    """
    file = find_bag_file(path) if path.is_dir() else path
    reader = find_reader(file)
    return None if reader is None else reader(file, stack)


def find_bag_file(folder: Path) -> Path:
    """Return the file in the folder of a ROS 2 bag.

    Raises
    ------
    FileError
        If the folder has none or several.
    """
    bags = [path for path in folder.iterdir() if path.suffix in (".db3", ".mcap")]
    if len(bags) == 1:
        return bags[0]
    if not bags:
        raise FileError(f"{folder}: is a folder without a .db3 or .mcap file; give a file")
    names = ", ".join(path.name for path in sorted(bags, key=_list_numbers))
    raise FileError(f"{folder}: has the files {names}; give one of them")


def _list_numbers(path: Path) -> list[int]:
    """Return the numbers in the name of a file, by which the parts of a bag are sorted."""
    return [int(number) for number in re.findall(r"\d+", path.name)]
