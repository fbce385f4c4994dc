#!/bin/sh
# rosbags: the reader of ROS 2 bags leaves out messages that are in SQLite's write-ahead log.
#
# Versions: rosbags 0.11.9.
# Input:    a bag of ROS 2 whose database has the journal mode WAL, as `ros2 bag record
#           --storage-preset-profile resilient` makes it. The newest 30 of its 50 messages are still
#           in the file .db3-wal beside it, as after a power cut, or while it is being recorded. This
#           is a valid state of the database; SQLite reads all 50.
# Expected: Reader.messages() yields 50 messages; Reader.message_count says 50 by metadata.yaml.
# Seen:     it yields 20 and raises no error or warning, since it opens the file with immutable=1,
#           by which SQLite ignores the log.
# The script fails if that changes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
import shutil
import sqlite3
from importlib.metadata import version
from pathlib import Path

from rosbags.rosbag2 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
float64 = store.types["std_msgs/msg/Float64"]
with Writer(Path("recorded"), version=9) as writer:
    connection = writer.add_connection("/force", float64.__msgtype__, typestore=store)
    for i in range(50):
        data = store.serialize_cdr(float64(float(i)), float64.__msgtype__)
        writer.write(connection, 1_777_000_000_000_000_000 + i * 1_000_000, data)

# Move the newest messages to the log, and copy the folder while the database is open.
database = sqlite3.connect("recorded/recorded.db3")
newest = database.execute("SELECT * FROM messages WHERE id > 20").fetchall()
database.execute("DELETE FROM messages WHERE id > 20")
database.commit()
database.execute("PRAGMA journal_mode = WAL")
database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", newest)
database.commit()
shutil.copytree("recorded", "bag")
database.close()

print("rosbags", version("rosbags"), "sqlite", sqlite3.sqlite_version)
print("files:", *sorted(path.name for path in Path("bag").iterdir()))
with Reader(Path("bag")) as reader:
    promised = reader.message_count
    found = sum(1 for _ in reader.messages())
copy = sqlite3.connect("file:bag/recorded.db3?mode=ro", uri=True)
[(stored,)] = copy.execute("SELECT count(*) FROM messages")
print(f"rosbags: {found} messages of {promised}; SQLite: {stored}")
assert (promised, stored) == (50, 50)
assert found == 20, "rosbags reads the log: the behaviour has changed"
PYTHON
