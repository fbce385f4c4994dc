"""Files with messages of topics, such as bags of ROS 2, as channels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
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
    """The channels of one topic."""

    addresses: list[str]  #: Addresses of the numbers in a message.
    columns: list[int]  #: Indices of their columns in a row.


class _PendingRow:
    """The row of a stamp, to which messages of several topics contribute.

    Parameters
    ----------
    width : int
        Number of columns.
    topics : iterable of str
        Topics that contribute.
    """

    def __init__(self, width: int, topics: Iterable[str]) -> None:
        self.numbers = [np.nan] * width
        self.awaited = set(topics)  #: Topics of which no message has come.

    def add(self, topic: str, columns: Sequence[int], numbers: Sequence[float]) -> None:
        """Add the numbers of a message.

        Parameters
        ----------
        topic : str
            Topic of the message.
        columns : sequence of int
            Indices of the columns of its numbers.
        numbers : sequence of float
            Numbers of the message.
        """
        self.awaited.discard(topic)
        for column, number in zip(columns, numbers, strict=True):
            self.numbers[column] = number


class MessageReader(LoggerReader):
    """A reader of files with messages, whose subclasses open the file and read the messages.

    The channels are the numbers in the messages, as ``/topic/field/element``. Times are the stamps
    in the headers of the messages, at which a reading was taken, or else the times at which the
    messages were logged. Messages of several topics with the same stamp are one row.
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
        """Return the channel of stamps; a note names the topics whose messages have none.

        Parameters
        ----------
        channels : sequence of LoggerChannel
            Channels with readings.
        """
        topics = {self._channels[channel.address] for channel in channels}
        unstamped = sorted(topics - self._stamped_topics)
        if unstamped:
            listed = ", ".join(unstamped)
            self.notes.append(f"{listed}: has no stamps; times are those at which it was logged")
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

        A row is yielded as soon as a message of each topic has come, or after `MAX_PENDING` later
        stamps. Columns of topics that have sent no message by then are NaN.

        Parameters
        ----------
        fields : dict of str to _TopicFields
            Channels by topics.
        width : int
            Number of columns of a row.
        """
        pending: dict[int, _PendingRow] = {}
        has_all_stamps = self._stamped_topics >= set(fields)
        for message in self.read_messages(list(fields)):
            addresses, columns = fields[message.topic]
            stamp_ns = message.log_time_ns
            if has_all_stamps:
                stamp_ns = get_stamp_ns(message.content) or message.log_time_ns
            if stamp_ns not in pending:
                pending[stamp_ns] = _PendingRow(width, fields)
            numbers = get_numbers(message.content, addresses)
            pending[stamp_ns].add(message.topic, columns, numbers)
            while pending:
                oldest_ns = next(iter(pending))
                if pending[oldest_ns].awaited and len(pending) <= MAX_PENDING:
                    break
                yield oldest_ns, pending.pop(oldest_ns).numbers
        for stamp_ns, row in pending.items():
            yield stamp_ns, row.numbers


def _make_columns(stamps: list[int], rows: list[list[float]], has_stamps: bool) -> list[Array]:
    """Return the columns of rows.

    Parameters
    ----------
    stamps : list of int
        Stamps of the rows in ns.
    rows : list of list of float
        Numbers of the rows.
    has_stamps : bool
        Whether the first column is that of the stamps.
    """
    columns: list[Array] = list(np.array(rows, dtype=float).T)
    if has_stamps:
        columns[0] = np.array(stamps, dtype=np.int64)
    return columns
