"""Bags of ROS 2 in SQLite, with the extension ``.db3``."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any

from pvdf_fem.readings.loggers.messages.message_reader import MessageReader, StampedMessage

ZSTANDARD_MAGIC = b"\x28\xb5\x2f\xfd"  #: The first bytes of a message that is compressed.


class RosBagReader(MessageReader):
    """A reader of ROS 2 bags by SQLite; rosbags decodes their messages.

    The reader of rosbags itself opens the database as one that never changes, so that it misses
    messages that are still in the write-ahead log beside it after a crash. SQLite reads them.
    """

    title = "ROS 2 bag"
    extensions = (".db3",)
    package = "rosbags"

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file begins with the tag of SQLite."""
        return head.startswith(b"SQLite format 3\0")

    def open_file(self) -> None:
        """Open the database, and collect the definitions of the messages in it."""
        self.types = self.import_package("rosbags.typesys")
        self.store = self.types.get_typestore(self.types.Stores.LATEST)
        database = sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=ro", uri=True)
        self.database = self.stack.enter_context(closing(database))
        try:
            tables = {row[0] for row in self._execute("SELECT name FROM sqlite_master")}
        except sqlite3.Error as error:
            raise self.make_format_error(error) from None
        if not {"topics", "messages"} <= tables:
            raise self.make_error("is a database, but not a bag of ROS 2; give a bag")
        if "message_definitions" in tables:
            self._register_definitions()
        #: Name and type of each topic by its number.
        self.topics: dict[int, tuple[str, str]] = {}
        for number, name, kind in self._execute("SELECT id, name, type FROM topics"):
            if kind in self.store.fielddefs:
                self.topics[number] = (name, kind)
            else:
                self.skipped_topics[name] = kind

    def read_messages(self, topics: Sequence[str] | None) -> Iterator[StampedMessage]:
        """Yield the messages of topics with known types, in the order in which they were logged."""
        numbers = [
            number for number, (name, _) in self.topics.items() if topics is None or name in topics
        ]
        marks = ", ".join("?" for _ in numbers)
        rows = self._execute(
            f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})"
            " ORDER BY timestamp, id",
            numbers,
        )
        for number, log_time_ns, data in rows:
            name, kind = self.topics[number]
            if data.startswith(ZSTANDARD_MAGIC):
                raise self.make_error(
                    "its messages are compressed; convert it by: ros2 bag convert"
                )
            content = self.store.deserialize_cdr(data, kind)
            yield StampedMessage(name, log_time_ns, content)

    def _execute(self, command: str, values: Sequence[Any] = ()) -> Any:
        """Execute a command of SQL."""
        return self.database.execute(command, values)

    def _register_definitions(self) -> None:
        """Register the definitions of messages in the bag that the store lacks."""
        rows = self._execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        for kind, encoding, text in rows:
            known = self.store.fielddefs
            if kind in known:
                continue
            if encoding == "ros2msg":
                definitions = self.types.get_types_from_msg(text, kind)
            elif encoding == "ros2idl":
                definitions = self.types.get_types_from_idl(text)
            else:
                continue
            self.store.register({name: d for name, d in definitions.items() if name not in known})
