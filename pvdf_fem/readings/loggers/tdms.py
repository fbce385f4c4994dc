"""TDMS, the binary files of LabVIEW, DAQExpress, FlexLogger and VeriStand."""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import open_regular_file
from pvdf_fem.readings.loggers.logger_reader import (
    BLOCK_SAMPLES,
    LoggerChannel,
    LoggerReader,
    RegularClock,
)

#: Head of a segment: tag, contents, version, length without this head, length of the metadata.
LEAD_IN = struct.Struct("<4sIIQQ")
BIG_ENDIAN = 1 << 6  #: Bit of the contents of segments that LabVIEW does not write on PCs.
UNFINISHED = 2**64 - 1  #: Length of the last segment of a recording that was cut off.
#: The property with the time of the first sample, of type 0x44, a time stamp of 16 bytes.
START_TIME = re.compile(rb"wf_start_time\x44\0\0\0(.{16})", re.DOTALL)
#: Largest number of blocks of a file. npTDMS reads a whole segment to return a part of it, and a
#: file that was defragmented has one segment: 20 million samples of four channels take 314 s in
#: blocks of 65,536 samples, and 34 s in 32 blocks.
MAX_BLOCKS = 32


class TdmsReader(LoggerReader):
    """A reader of TDMS files by npTDMS.

    The file is opened as a stream, since npTDMS takes the positions of samples from a file
    ``.tdms_index`` beside it otherwise, even if that belongs to an older recording.
    """

    title = "TDMS"
    extensions = (".tdms",)
    package = "npTDMS"

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        nptdms = self.import_package("nptdms")
        # It warns of an incomplete segment on standard error; `notes` say so in our words.
        logging.getLogger("nptdms").setLevel(logging.ERROR)
        stream = stack.enter_context(open_regular_file(path, "a TDMS file"))
        try:
            self.file = stack.enter_context(nptdms.TdmsFile.open(stream))
        except Exception as error:  # npTDMS raises errors of struct, too
            raise self.make_format_error(error) from None
        self.channels = self._list_numeric_channels()
        starts = _count_starts(path)
        if starts > 1:
            self.notes.append(
                f"its parts have {starts} values of wf_start_time, of which the last is known: "
                "pauses between the parts are not in the times"
            )

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file begins with the tag of a TDMS segment."""
        return head[:4] == b"TDSm"

    def list_channels(self) -> list[LoggerChannel]:
        """Return the channels with numbers or times; unit and clock come from their properties."""
        described = []
        for address, channel in self.channels.items():
            properties = channel.properties
            unit = str(properties.get("unit_string", "")) or _find_scaled_unit(properties)
            described.append(LoggerChannel(address, unit, _make_clock(properties)))
        return described

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of samples of several channels, see `LoggerReader.read_columns`.

        In a file that was cut while it was written, the last segment has fewer samples of later
        channels. The samples that all channels have are read, and a note says so.
        """
        channels = [self.channels[address] for address in addresses]
        lengths = [len(channel) for channel in channels]
        count = min(lengths)
        if max(lengths) > count:
            longest = addresses[lengths.index(max(lengths))]
            shortest = addresses[lengths.index(count)]
            self.notes.append(
                f"{longest} has {max(lengths)} samples and {shortest} {count}: the first {count} "
                "of each are read"
            )
        block_samples = max(BLOCK_SAMPLES, count // MAX_BLOCKS)
        for start in range(0, count, block_samples):
            length = min(block_samples, count - start)
            yield [np.asarray(channel.read_data(start, length)) for channel in channels]

    def _list_numeric_channels(self) -> dict[str, Any]:
        """Return the channels of the file with numbers or times by their addresses."""
        channels = {}
        for group in self.file.groups():
            for channel in group.channels():
                if channel.dtype.kind in "iufM":
                    channels[f"{group.name}/{channel.name}"] = channel
        if self.file.file_status.incomplete_final_segment:
            self.notes.append("the last segment is incomplete: the recording was cut off")
        return channels


def _count_starts(path: Path) -> int:
    """Return the number of different values of ``wf_start_time`` in the segments of a file.

    A property of a channel has one value in npTDMS, that of the last segment, so that the segments
    are searched for the name of the property with its type and value.
    """
    values = set()
    size = path.stat().st_size
    with open_regular_file(path, "a TDMS file") as stream:
        place = 0
        while place + LEAD_IN.size <= size:
            stream.seek(place)
            _, contents, _, length, metadata_length = LEAD_IN.unpack(stream.read(LEAD_IN.size))
            if contents & BIG_ENDIAN or metadata_length > size:
                break
            for found in START_TIME.finditer(stream.read(metadata_length)):
                values.add(found[1])
            if length == UNFINISHED:
                break
            place += LEAD_IN.size + length
    return len(values)


def _find_scaled_unit(properties: Any) -> str:
    """Return the unit of the last scale of a channel, such as that of NI-DAQmx, or an empty one."""
    count = int(properties.get("NI_Number_Of_Scales", 0))
    for name in (f"NI_Scale[{count - 1}]_Scaled_Units", "NI_UnitDescription"):
        if properties.get(name):
            return str(properties[name])
    return ""


def _make_clock(properties: Any) -> RegularClock | None:
    """Return the clock that the properties of a waveform describe, or None."""
    interval_s = float(properties.get("wf_increment", 0.0))
    if not interval_s > 0.0:
        return None
    start = properties.get("wf_start_time")
    return RegularClock(
        interval_s,
        first_s=float(properties.get("wf_start_offset", 0.0)),
        start=None if start is None else _convert_time(start),
    )


def _convert_time(time: Any) -> datetime:
    """Convert a time of npTDMS, which is in UTC, to a datetime."""
    since_epoch_us = int(np.datetime64(time, "us").astype(np.int64))
    return datetime.fromtimestamp(1e-6 * since_epoch_us, UTC)
