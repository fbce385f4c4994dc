"""Files with messages of topics, such as bags of ROS 2, as channels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.loggers.logger_reader import (
    BLOCK_SAMPLES,
    LoggerChannel,
    LoggerReader,
)
from pvdf_fem.readings.loggers.messages.fields import get_numbers, get_stamp_ns, list_numbers

TIME_ADDRESS = "<stamp>"  #: Address of the channel of stamps, which are integers in ns since 1970.
#: Number of messages from which the topics and their fields are learned.
FIRST_MESSAGES = 2000
#: Largest number of stamps for which messages of some topics may be awaited.
MAX_PENDING = 1000


class StampedMessage(NamedTuple):
    """A message of a topic."""

    topic: str
    log_time_ns: int
    content: Any


class _TopicFields(NamedTuple):
    """The topic of some channels, their addresses in its messages, and their columns."""

    addresses: list[str]
    columns: list[int]


class MessageReader(LoggerReader):
    """A reader of files with messages, whose subclasses open the file and read the messages.

    The channels are the numbers in the messages, as ``/topic/field/element``. Times are the stamps
    in the headers of the messages, which tell when a reading was taken, or else the times at which
    the messages were logged. Channels of several topics have a row for each stamp.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        #: Encodings by the topics that cannot be read.
        self.skipped_topics: dict[str, str] = {}
        self._channels: dict[str, str] = {}  #: Topics by the addresses of channels.
        self._stamped_topics: set[str] = set()
        self.open_file()
        self._learn_channels()

    @abstractmethod
    def open_file(self) -> None:
        """Open the file."""

    @abstractmethod
    def read_messages(self, topics: Sequence[str] | None) -> Iterator[StampedMessage]:
        """Yield the messages of some topics, or of all, from the beginning of the file."""

    def list_channels(self) -> list[LoggerChannel]:
        """Return the numbers in the first messages of all topics as channels."""
        return [LoggerChannel(address) for address in self._channels]

    def find_time_channel(self, channels: Sequence[LoggerChannel]) -> LoggerChannel:
        """Return the channel of stamps."""
        topics = {self._channels[channel.address] for channel in channels}
        unstamped = sorted(topics - self._stamped_topics)
        if unstamped:
            listed = ", ".join(unstamped)
            self.notes.append(f"{listed}: has no stamps; the times are those of logging")
        return LoggerChannel(TIME_ADDRESS, "ns")

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of samples of several channels, see `LoggerReader.read_columns`."""
        fields = self._group_by_topic(addresses)
        has_stamps = addresses[0] == TIME_ADDRESS
        stamps: list[int] = []
        rows: list[list[float]] = []
        for stamp_ns, row in self._read_rows(fields, len(addresses)):
            stamps.append(stamp_ns)
            rows.append(row)
            if len(rows) == BLOCK_SAMPLES:
                yield _make_columns(stamps, rows, has_stamps)
                stamps = []
                rows = []
        if rows:
            yield _make_columns(stamps, rows, has_stamps)

    def _learn_channels(self) -> None:
        """Find topics and channels in the first messages."""
        for i, message in enumerate(self.read_messages(None)):
            for address in list_numbers(message.content):
                self._channels.setdefault(f"{message.topic}/{address}", message.topic)
            if get_stamp_ns(message.content) is not None:
                self._stamped_topics.add(message.topic)
            if i >= FIRST_MESSAGES:
                break
        if not self._channels and self.skipped_topics:
            listed = ", ".join(f"{topic}: {kind}" for topic, kind in self.skipped_topics.items())
            reason = f"no topic with messages of ROS 2 or in JSON ({listed})"
            raise self.make_error(f"{reason}; record one, or convert the file")

    def _group_by_topic(self, addresses: Sequence[str]) -> dict[str, _TopicFields]:
        """Return the addresses within messages and the columns of channels, by topics."""
        fields: dict[str, _TopicFields] = {}
        for column, address in enumerate(addresses):
            if address == TIME_ADDRESS:
                continue
            topic = self._channels[address]
            of_topic = fields.setdefault(topic, _TopicFields([], []))
            of_topic.addresses.append(address.removeprefix(f"{topic}/"))
            of_topic.columns.append(column)
        return fields

    def _read_rows(
        self, fields: dict[str, _TopicFields], width: int
    ) -> Iterator[tuple[int, list[float]]]:
        """Yield stamps in ns with rows of numbers, in the order of the first message of a stamp.

        The rows of several topics are held until a message of each has come, or until
        `MAX_PENDING` later stamps have; numbers of topics without one are NaN.
        """
        pending: dict[int, list[float]] = {}
        awaited: dict[int, set[str]] = {}
        has_all_stamps = self._stamped_topics >= set(fields)
        for message in self.read_messages(list(fields)):
            of_topic = fields[message.topic]
            stamp_ns = message.log_time_ns
            if has_all_stamps:
                stamp_ns = get_stamp_ns(message.content) or message.log_time_ns
            numbers = get_numbers(message.content, of_topic.addresses)
            if len(fields) == 1:
                row = [np.nan] * width
                for column, number in zip(of_topic.columns, numbers, strict=True):
                    row[column] = number
                yield stamp_ns, row
                continue
            row = pending.setdefault(stamp_ns, [np.nan] * width)
            for column, number in zip(of_topic.columns, numbers, strict=True):
                row[column] = number
            awaited.setdefault(stamp_ns, set(fields)).discard(message.topic)
            while pending:
                oldest = next(iter(pending))
                if awaited[oldest] and len(pending) <= MAX_PENDING:
                    break
                del awaited[oldest]
                yield oldest, pending.pop(oldest)
        yield from pending.items()


def _make_columns(stamps: list[int], rows: list[list[float]], has_stamps: bool) -> list[Array]:
    """Return the columns of rows; the first one has the stamps, if they are wanted."""
    columns: list[Array] = list(np.array(rows, dtype=float).T)
    if has_stamps:
        columns[0] = np.array(stamps, dtype=np.int64)
    return columns
