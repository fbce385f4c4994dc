"""MCAP, the files of ROS 2 and Foxglove."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from pvdf_fem.files import open_regular_file
from pvdf_fem.readings.loggers.messages.message_reader import MessageReader, StampedMessage

END = b"\x89MCAP0\r\n"  #: The last bytes of a complete file, which are also the first.


class _Topic(NamedTuple):
    """A topic, and the function that decodes its messages; None for other encodings."""

    name: str
    decode: Callable[[bytes], Any] | None


class McapReader(MessageReader):
    """A reader of MCAP files by mcap, with messages of ROS 2 or in JSON.

    A complete file is read in the order in which its messages were logged. The file of a recorder
    that was killed lacks the index at its end, without which mcap finds no messages. Such a file is
    read in the order of its records.
    """

    title = "MCAP"
    extensions = (".mcap",)
    package = "mcap"

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.stream: BinaryIO
        self.reader_module: Any
        self.factories: list[Any]
        super().__init__(path, stack)

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file begins with the tag of MCAP."""
        return head.startswith(END)

    def open_file(self) -> None:
        """Open the file, and check whether it is complete."""
        self.reader_module = self.import_package("mcap.reader")
        self.factories = [self.import_package("mcap_ros2.decoder").DecoderFactory()]
        self.stream = self.stack.enter_context(open_regular_file(self.path, "an MCAP file"))
        self.stream.seek(-len(END), 2)
        self.is_complete = self.stream.read() == END
        if not self.is_complete:
            self.notes.append("the file has no end: the recording was cut off")

    def read_messages(self, topics: Sequence[str] | None) -> Iterator[StampedMessage]:
        """Yield the messages of topics, or of all topics, that can be decoded."""
        known: dict[int, _Topic] = {}
        for schema, channel, message in self._read_records(topics):
            if channel.id not in known:
                known[channel.id] = self._find_decoder(schema, channel)
            topic = known[channel.id]
            if topic.decode is not None:
                decoded = topic.decode(message.data)
                yield StampedMessage(topic.name, message.log_time, decoded)

    def _read_records(self, topics: Sequence[str] | None) -> Iterator[tuple[Any, Any, Any]]:
        """Yield schema, channel and message for each message of some topics, or of all."""
        self.stream.seek(0)
        if self.is_complete:
            yield from self.reader_module.make_reader(self.stream).iter_messages(topics)
        else:
            yield from self._read_incomplete_file(topics)

    def _read_incomplete_file(self, topics: Sequence[str] | None) -> Iterator[tuple[Any, Any, Any]]:
        """Yield the same as `_read_records` from a file that lacks its end."""
        records = self.import_package("mcap.records")
        stream_reader = self.import_package("mcap.stream_reader")
        cut_error = self.import_package("mcap.exceptions").McapError
        schemas: dict[int, Any] = {0: None}
        channels: dict[int, Any] = {}
        try:
            for record in stream_reader.StreamReader(self.stream).records:
                if isinstance(record, records.Schema):
                    schemas[record.id] = record
                elif isinstance(record, records.Channel):
                    channels[record.id] = record
                elif isinstance(record, records.Message):
                    channel = channels[record.channel_id]
                    if topics is None or channel.topic in topics:
                        yield schemas.get(channel.schema_id), channel, record
        except (cut_error, struct.error):  # the last record is cut
            return

    def _find_decoder(self, schema: Any, channel: Any) -> _Topic:
        """Return the topic of a channel with the decoder for the encoding of its messages.

        If there is no decoder, the topic is added to `skipped_topics`.
        """
        encoding = channel.message_encoding
        if encoding == "json":
            return _Topic(channel.topic, json.loads)
        for factory in self.factories:
            decode = factory.decoder_for(encoding, schema)
            if decode is not None:
                return _Topic(channel.topic, decode)
        kind = f"{encoding} ({schema.encoding})" if schema else encoding
        self.skipped_topics[channel.topic] = kind
        return _Topic(channel.topic, None)
