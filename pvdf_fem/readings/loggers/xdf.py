"""XDF, the files of Lab Streaming Layer's LabRecorder."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.loggers.logger_reader import LoggerChannel, LoggerReader

TIME_NAME = "time_stamps"  #: Name of the stamps of a stream, in addresses.


class XdfReader(LoggerReader):
    """A reader of XDF files by pyxdf, which loads them whole.

    Clock offsets are applied. The stamps are not smoothed, since pyxdf would join the parts before
    and after a gap of up to 1 s or 500 samples, so that all later samples would come too early.
    """

    title = "XDF"
    extensions = (".xdf", ".xdfz", ".xdf.gz")
    package = "pyxdf"

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        pyxdf = self.import_package("pyxdf")
        logging.getLogger("pyxdf").setLevel(logging.CRITICAL)
        try:
            streams, _ = pyxdf.load_xdf(
                str(path), synchronize_clocks=True, dejitter_timestamps=False
            )
        except Exception as error:  # pyxdf raises errors of struct and of XML, too
            raise self.make_format_error(error) from None
        self.streams = _name_streams(streams)

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file begins with the tag of XDF."""
        return head[:4] == b"XDF:"

    def list_channels(self) -> list[LoggerChannel]:
        """Return the channels of all streams with numbers, as STREAM/CHANNEL."""
        channels = []
        for name, stream in self.streams.items():
            for label, unit in _list_labels(stream):
                channels.append(LoggerChannel(f"{name}/{label}", unit))
        return channels

    def find_time_channel(self, channels: Sequence[LoggerChannel]) -> LoggerChannel:
        """Return the stamps of the stream that the channels belong to."""
        streams = {self._find_stream(channel.address) for channel in channels}
        if len(streams) > 1:
            listed = ", ".join(sorted(streams))
            raise self.make_error(f"channels of several streams, {listed}; choose those of one")
        return LoggerChannel(f"{streams.pop()}/{TIME_NAME}", "s")

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield all samples of several channels at once, see `LoggerReader.read_columns`."""
        columns = []
        for address in addresses:
            name = self._find_stream(address)
            stream = self.streams[name]
            wanted = address.removeprefix(f"{name}/")
            if wanted == TIME_NAME:
                columns.append(np.asarray(stream["time_stamps"], dtype=float))
            else:
                labels = [label for label, _ in _list_labels(stream)]
                samples = np.asarray(stream["time_series"])
                columns.append(samples[:, labels.index(wanted)])
        yield columns

    def _find_stream(self, address: str) -> str:
        """Return the name of the stream that an address leads to; names may have slashes."""
        names = [name for name in self.streams if address.startswith(f"{name}/")]
        return max(names, key=len)


def _name_streams(streams: Sequence[Any]) -> dict[str, Any]:
    """Return the streams with numbers by their names; of equal names, later ones get a number."""
    named: dict[str, Any] = {}
    for stream in streams:
        info = stream["info"]
        if info["channel_format"][0] == "string":
            continue
        name = info["name"][0] or "stream"
        unique = name
        if name in named:
            unique = f"{name}#{info['stream_id']}"
        named[unique] = stream
    return named


def _list_labels(stream: Any) -> list[tuple[str, str]]:
    """Return the label and the unit of each channel; channels without labels are numbered from 1.

    By the conventions of LSL they are ``desc/channels/channel/label`` and ``unit`` in the
    description of the stream.
    """
    info = stream["info"]
    count = int(info["channel_count"][0])
    described: list[Any] = []
    for channels in _list_children(info.get("desc"), "channels"):
        described += _list_children([channels], "channel")
    labels = []
    for i in range(count):
        channel = described[i] if len(described) == count else {}
        label = _get_text(channel, "label") or str(i + 1)
        labels.append((label, _get_text(channel, "unit")))
    if len({label for label, _ in labels}) < count:  # such as the same label for all
        labels = [(str(i + 1), unit) for i, (_, unit) in enumerate(labels)]
    return labels


def _list_children(elements: Any, name: str) -> list[Any]:
    """Return the children with a name of all the XML elements in a list, as pyxdf gives them."""
    children: list[Any] = []
    for element in elements or []:
        if isinstance(element, dict):
            children += element.get(name) or []
    return [child for child in children if child is not None]


def _get_text(element: Any, name: str) -> str:
    """Return the text of the child with a name of an XML element, or an empty text."""
    texts = element.get(name) if isinstance(element, dict) else None
    return str(texts[0] or "").strip() if texts else ""
